"""Sphere, capsule and cylinder: solids about the z axis."""

import math

import jax.numpy as jnp
import numpy as np

from icjax.geometry._shape import MassProperties, Probes, Shape, corner, length_and_direction
from icjax.typing import Scalar, Vector3


class Sphere(Shape):
    """Ball about the origin. **Fields**: `radius` m, positive."""

    radius: Scalar

    def __init__(self, radius: Scalar | float):
        self.radius = jnp.asarray(radius)

    def signed_distance(self, p: Vector3) -> Scalar:
        """Distance of `p` (m) from the surface, negative inside, m."""
        return length_and_direction(p)[0] - self.radius

    def normal(self, p: Vector3) -> Vector3:
        """Outward unit normal at the point of the surface closest to `p`."""
        return length_and_direction(p)[1]

    def mass_properties(self) -> MassProperties:
        """V = 4 pi r^3 / 3, inertia 2 V r^2 / 5."""
        volume = 4.0 / 3.0 * math.pi * self.radius**3
        eye = jnp.eye(3, dtype=volume.dtype)
        return MassProperties(volume, jnp.zeros_like(eye[0]), 0.4 * volume * self.radius**2 * eye)

    def probes(self, direction: Vector3) -> Probes:
        """The ball itself."""
        return Probes(jnp.zeros((1, 3), self.radius.dtype), self.radius[None])


class Capsule(Shape):
    """Cylinder about the z axis between two half balls.

    **Fields**: `radius` m; `half_length` from the origin to the centre of a half ball, m.
    """

    radius: Scalar
    half_length: Scalar

    def __init__(self, radius: Scalar | float, half_length: Scalar | float):
        self.radius, self.half_length = jnp.asarray(radius), jnp.asarray(half_length)

    def _from_the_axis(self, p: Vector3):
        along = jnp.clip(p[2], -self.half_length, self.half_length)
        return length_and_direction(p - jnp.stack([jnp.zeros_like(along), jnp.zeros_like(along), along]))

    def signed_distance(self, p: Vector3) -> Scalar:
        """Distance of `p` (m) from the surface, negative inside, m."""
        return self._from_the_axis(p)[0] - self.radius

    def normal(self, p: Vector3) -> Vector3:
        """Outward unit normal at the point of the surface closest to `p`."""
        return self._from_the_axis(p)[1]

    def mass_properties(self) -> MassProperties:
        """Cylinder and half balls, these moved outward by the half length (their own centres 3 r / 8 farther)."""
        r, h = self.radius, self.half_length
        rod, ball = 2.0 * math.pi * r**2 * h, 4.0 / 3.0 * math.pi * r**3
        along = rod * r**2 / 2.0 + ball * 0.4 * r**2
        across = rod * (r**2 / 4.0 + h**2 / 3.0) + ball * (0.4 * r**2 + h**2 + 0.75 * r * h)
        inertia = jnp.diag(jnp.stack([across, across, along]))
        return MassProperties(rod + ball, jnp.zeros_like(inertia[0]), inertia)

    def probes(self, direction: Vector3) -> Probes:
        """The two balls."""
        ends = self.half_length * jnp.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]], self.half_length.dtype)
        return Probes(ends, jnp.stack([self.radius, self.radius]))


_SPREAD = np.array([(math.cos(2 * math.pi * k / 3), math.sin(2 * math.pi * k / 3)) for k in range(3)])


class Cylinder(Shape):
    """Round cylinder about the z axis with flat ends.

    **Fields**: `radius` m; `half_length` from the origin to an end, m.
    """

    radius: Scalar
    half_length: Scalar

    def __init__(self, radius: Scalar | float, half_length: Scalar | float):
        self.radius, self.half_length = jnp.asarray(radius), jnp.asarray(half_length)

    def _corner(self, p: Vector3):
        out, radial = length_and_direction(p[:2])
        side = jnp.where(p[2] < 0.0, -1.0, 1.0).astype(p.dtype)
        distance, gradient = corner(jnp.stack([out - self.radius, side * p[2] - self.half_length]))
        return distance, jnp.concatenate([gradient[0] * radial, (gradient[1] * side)[None]])

    def signed_distance(self, p: Vector3) -> Scalar:
        """Distance of `p` (m) from the surface, negative inside, m."""
        return self._corner(p)[0]

    def normal(self, p: Vector3) -> Vector3:
        """Outward unit normal at the point of the surface closest to `p`; outside an edge, from there to `p`."""
        return self._corner(p)[1]

    def mass_properties(self) -> MassProperties:
        """V = 2 pi r^2 h, inertia V r^2 / 2 along and V (r^2 / 4 + h^2 / 3) across."""
        r, h = self.radius, self.half_length
        volume = 2.0 * math.pi * r**2 * h
        across = volume * (r**2 / 4.0 + h**2 / 3.0)
        inertia = jnp.diag(jnp.stack([across, across, volume * r**2 / 2.0]))
        return MassProperties(volume, jnp.zeros_like(inertia[0]), inertia)

    def probes(self, direction: Vector3) -> Probes:
        """On both edges the point farthest along the direction, and those a third of a turn from it."""
        _, (c, s) = length_and_direction(direction[:2])
        turned = jnp.stack([jnp.stack([c, -s]), jnp.stack([s, c])])
        ring = self.radius * (jnp.asarray(_SPREAD, turned.dtype) @ turned.T)
        ends = self.half_length * jnp.repeat(jnp.array([-1.0, 1.0], ring.dtype), 3)
        centre = jnp.concatenate([jnp.tile(ring, (2, 1)), ends[:, None]], axis=1)
        return Probes(centre, jnp.zeros(6, ring.dtype))
