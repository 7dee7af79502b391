"""Half-space."""

import jax.numpy as jnp

from icjax.geometry._shape import MassProperties, Probes, Shape
from icjax.typing import Float, Real


class Plane(Shape):
    """Half-space of solid behind a plane: `signed_distance(p) = n^T (p - point)`.

    **Arguments**

    - `point`: a point of the plane, m, world.
    - `normal`: outward direction, any length but zero, world.
    """

    point: Float[Real, "3"]
    normal_direction: Float[Real, "3"]

    def __init__(self, point: Float[Real, "3"], normal: Float[Real, "3"]):
        self.point = jnp.asarray(point)
        self.normal_direction = jnp.asarray(normal)

    def signed_distance(self, p: Float[Real, "3"]) -> Float[Real, ""]:
        """Distance of `p` (m) from the plane, negative inside the solid, m."""
        return jnp.dot(self.normal(p), p - self.point)

    def closest_point(self, p: Float[Real, "3"]) -> Float[Real, "3"]:
        """Point of the plane closest to `p`, m."""
        return p - self.signed_distance(p) * self.normal(p)

    def normal(self, p: Float[Real, "3"]) -> Float[Real, "3"]:
        """Outward unit normal (the same at every `p`)."""
        return self.normal_direction / jnp.sqrt(jnp.sum(self.normal_direction**2))

    def mass_properties(self) -> MassProperties:
        """**Errors**: `ValueError`, always."""
        raise ValueError("a half-space has no mass; only fixed and driven bodies can be planes")

    def probes(self, direction: Float[Real, "3"]) -> Probes:
        """**Errors**: `ValueError`, always."""
        raise ValueError("a half-space has no corners; only fixed and driven bodies can be planes")
