"""What is touched: a plate over a force sensor, flat or with a bump."""

import dataclasses
import math

import numpy as np


@dataclasses.dataclass(frozen=True)
class Bump:
    """Upper half of an ellipsoid with world-parallel axes: `centre` (m, world) and `radii` (m, along x, y, z)."""

    centre: tuple[float, float, float]
    radii: tuple[float, float, float]

    def __post_init__(self):
        if not all(math.isfinite(value) for value in self.centre):
            raise ValueError(f"centre of the bump must be finite, got {self.centre}")
        if self.centre[1] != 0.0:
            raise ValueError(f"centre of the bump must lie in the plane y = 0 of the finger, got {self.centre}")
        if not all(1e-4 <= value <= 0.2 for value in self.radii):
            raise ValueError(f"radii of the bump must be between 0.0001 and 0.2 m, got {self.radii}")


@dataclasses.dataclass(frozen=True)
class Surface:
    """A plate whose top is at `height` (m, world), with Coulomb friction and, if asked, a bump.

    `lowered` (m) takes plate, bump and sensor out of reach for a catch trial.
    """

    friction: float = 0.8
    height: float = 0.0
    bump: Bump | None = None
    lowered: float = 0.0

    def __post_init__(self):
        if not (math.isfinite(self.friction) and 0.0 <= self.friction <= 3.0):
            raise ValueError(f"friction must be between 0 and 3, got {self.friction}")
        if not (math.isfinite(self.height) and math.isfinite(self.lowered)):
            raise ValueError(f"height and lowered must be finite, got {self.height} and {self.lowered}")

    @property
    def top(self) -> float:
        """Height of the plate's top as it stands, m."""
        return self.height - self.lowered


SENSOR_DEPTH = 0.030
"""Reference point of the sensor's moments below the plate's top, m."""

SENSOR_ROTATION = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Sensor axes in the world: v_W = SENSOR_ROTATION v_S, so that pressing down reads positive Fz."""

PLATE_MARKERS = {
    "PL1": (-0.1, -0.07, 0.004),
    "PL2": (0.1, -0.07, 0.004),
    "PL3": (0.1, 0.07, 0.004),
    "PL4": (-0.1, 0.07, 0.004),
}
"""Positions on the plate, relative to the middle of its top, m."""
