"""What a ball stands in while no finger holds it: a ring of beads."""

import dataclasses
import math

import numpy as np


@dataclasses.dataclass(frozen=True)
class Stand:
    """A ring of `count` beads on the table about the world's origin, with the table's friction.

    `radius` m: of the circle of their middles; `bead` m: of a bead. A ball rests on the beads: it can be turned, it
    can be lifted out, and it is rolled out by a horizontal force of about its weight times the slope of the beads.
    """

    radius: float = 0.014
    bead: float = 0.003
    count: int = 12

    def __post_init__(self):
        for name, least, most in (("radius", 0.002, 0.1), ("bead", 0.001, 0.02), ("count", 3, 100)):
            value = getattr(self, name)
            if not (least <= value <= most):
                raise ValueError(f"stand: {name} must be between {least} and {most}, got {value}")

    @property
    def places(self) -> np.ndarray:
        """Middles of the beads [bead, 3], m."""
        angle = 2.0 * math.pi * np.arange(self.count) / self.count
        return np.column_stack(
            [self.radius * np.cos(angle), self.radius * np.sin(angle), np.full(self.count, self.bead)]
        )

    def height_of(self, radius: float) -> float:
        """Of the middle of a ball that rests in it, above the table, m. **Errors**: `ValueError` for one too small."""
        if radius + self.bead <= self.radius:
            raise ValueError(f"a ball of radius {radius} m falls through the stand of radius {self.radius} m")
        return self.bead + math.sqrt((radius + self.bead) ** 2 - self.radius**2)
