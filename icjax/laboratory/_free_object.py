"""What is grasped: a free rigid body that stands on a table."""

import dataclasses
import math

import numpy as np

SIZES = {"box": 3, "wedge": 3, "sphere": 1, "cylinder": 2}
"""Shapes and the number of lengths that each one has."""

TABLE_FRICTION = 0.6
"""Coulomb coefficient between the table and every object."""


@dataclasses.dataclass(frozen=True)
class FreeObject:
    """A rigid body of even density. Thumb and fingers close along x; z is up.

    - `name`: of the object and of its recording.
    - `shape`, `size` (m): "box" and "wedge" have widths along x, y and z; "sphere" a diameter; "cylinder", upright, a
      diameter and a height. `taper` (rad): the gripped faces of a wedge lean so far from the vertical, the top being
      narrower; its width along x is that at half height.
    - `mass`: kg. `friction`: Coulomb coefficient against the fingertips.
    """

    name: str
    shape: str = "box"
    size: tuple[float, ...] = (0.032, 0.070, 0.052)
    mass: float = 0.020
    friction: float = 0.8
    taper: float = 0.0

    def __post_init__(self):
        what = f"object '{self.name}'"
        if not self.name or not all(letter.isalnum() or letter in "_-" for letter in self.name):
            raise ValueError(f"name of an object must be letters, digits, _ or -, got {self.name!r}")
        if self.shape not in SIZES:
            raise ValueError(f"{what}: shape must be one of {', '.join(SIZES)}, got {self.shape!r}")
        if len(self.size) != SIZES[self.shape]:
            raise ValueError(f"{what}: size of a {self.shape} needs {SIZES[self.shape]} lengths, got {self.size}")
        if not all(0.01 <= value <= 0.2 for value in self.size):
            raise ValueError(f"{what}: size must lie between 0.01 and 0.2 m, got {self.size}")
        if not (0.002 <= self.mass <= 2.0):
            raise ValueError(f"{what}: mass must be between 0.002 and 2 kg, got {self.mass}")
        if not (math.isfinite(self.friction) and 0.0 <= self.friction <= 3.0):
            raise ValueError(f"{what}: friction must be between 0 and 3, got {self.friction}")
        if self.taper != 0.0 and self.shape != "wedge":
            raise ValueError(f"{what}: taper belongs to a wedge, not to a {self.shape}")
        if self.shape == "wedge" and not (self.taper > 0.0 and self._narrow > 0.002):
            raise ValueError(f"{what}: taper must be above 0 and leave a top of 2 mm, got {self.taper} rad")

    @property
    def width(self) -> float:
        """Along x at half height, m."""
        return self.size[0]

    @property
    def height(self) -> float:
        """Along z, m; the object's frame lies half of it above the table, axes parallel to the world's."""
        return self.size[-1]

    @property
    def _narrow(self) -> float:
        return self.size[0] - self.height * math.tan(self.taper)

    def vertices(self) -> np.ndarray:
        """Corners of a wedge in its frame, m."""
        lean = math.tan(self.taper)
        corners = [
            (sx * (0.5 * self.size[0] - sz * 0.5 * self.height * lean), sy * 0.5 * self.size[1], sz * 0.5 * self.height)
            for sx in (-1, 1)
            for sy in (-1, 1)
            for sz in (-1, 1)
        ]
        return np.asarray(corners)
