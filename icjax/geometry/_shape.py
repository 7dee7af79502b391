"""What every solid can say about a point: how far its surface is, and in which direction."""

from abc import abstractmethod
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from icjax.spatial import Pose
from icjax.typing import Float, Int, Real, Scalar, Vector3


class MassProperties(NamedTuple):
    """Of a solid of density one: `volume` m3, `com` its centre, m, `inertia` about that centre, m5."""

    volume: Scalar
    com: Vector3
    inertia: Float[Real, "3 3"]


class Probes(NamedTuple):
    """Small spheres that touch the surface from within: where a solid meets another one first.

    **Fields**: `centre` m; `radius` m, zero at corners.
    """

    centre: Float[Real, "probe 3"]
    radius: Float[Real, " probe"]


class Shape(eqx.Module):
    """A solid, by the exact signed distance of its surface, in the frame of the body that carries it.

    The gradient of `signed_distance` is `normal`. Where the closest point is not unique (the centre of a sphere, the
    middle of a box) one of them is taken, with finite derivatives.
    """

    @abstractmethod
    def signed_distance(self, p: Vector3) -> Scalar:
        """Distance of `p` (m) from the surface, negative inside, m."""

    @abstractmethod
    def normal(self, p: Vector3) -> Vector3:
        """Outward unit normal at the point of the surface closest to `p`; outside an edge, from there to `p`."""

    def closest_point(self, p: Vector3) -> Vector3:
        """Point of the surface closest to `p`, m."""
        return p - self.signed_distance(p) * self.normal(p)

    @abstractmethod
    def mass_properties(self) -> MassProperties:
        """Volume, centre and inertia. **Errors**: `ValueError` for a solid without end."""

    @abstractmethod
    def probes(self, direction: Vector3) -> Probes:
        """Where a surface with the outward normal `-direction`, far out in this direction, would be met first.

        Corners and centres are the same for every direction; of round edges, the points farthest along it. Always the
        same number. **Errors**: `ValueError` for a solid without end.
        """


class Placed(Shape):
    """A shape somewhere else than at the origin of its body.

    **Fields**: `shape`; `pose` of the shape's frame in that of the body.
    """

    shape: Shape
    pose: Pose

    def signed_distance(self, p: Vector3) -> Scalar:
        """Distance of `p` (m) from the surface, negative inside, m."""
        return self.shape.signed_distance(self.pose.inverse().apply(p))

    def normal(self, p: Vector3) -> Vector3:
        """Outward unit normal at the point of the surface closest to `p`."""
        return self.pose.rotation @ self.shape.normal(self.pose.inverse().apply(p))

    def mass_properties(self) -> MassProperties:
        """Volume, centre and inertia of the shape where it is placed."""
        volume, com, inertia = self.shape.mass_properties()
        R = self.pose.rotation
        return MassProperties(volume, self.pose.apply(com), R @ inertia @ R.T)

    def probes(self, direction: Vector3) -> Probes:
        """Probes of the shape where it is placed."""
        centre, radius = self.shape.probes(self.pose.rotation.T @ direction)
        return Probes(centre @ self.pose.rotation.T + self.pose.position[None], radius)


def corner(q: Float[Real, " k"]) -> tuple[Scalar, Float[Real, " k"]]:
    """Exact signed distance of ``{q <= 0}`` where the q are signed distances in orthogonal directions.

    Outside ``|max(q, 0)|``, inside the largest q.

    **Returns**: the distance, and its gradient with respect to q, a unit vector.
    """
    beyond = jnp.maximum(q, 0.0)
    square = jnp.sum(beyond**2)
    outside = square > _hair(q)
    nearest = one_of(jnp.argmax(q), q.shape[0])
    length = jnp.sqrt(jnp.where(outside, square, 1.0))
    distance = jnp.where(outside, length, jnp.sum(jnp.where(nearest, q, 0.0)))
    return distance, jnp.where(outside, beyond / length, nearest)


def one_of(index: Int[Real, ""], count: int) -> Real:
    """True at the index, `[count]`."""
    return jnp.arange(count) == index


def length_and_direction(v: Float[Real, " k"]) -> tuple[Scalar, Float[Real, " k"]]:
    """Norm and unit vector; of zero, the first axis, with finite derivatives."""
    square = jnp.sum(v**2)
    zero = ~(square > _hair(v))
    safe = jnp.where(zero, one_of(jnp.asarray(0), v.shape[0]).astype(v.dtype), v)
    norm = jnp.sqrt(jnp.sum(safe**2))
    return jnp.where(zero, 0.0, norm), safe / norm


def _hair(x: Real) -> float:
    """Square of a length so short that its inverse square would overflow."""
    return float(jnp.finfo(x.dtype).tiny) ** 0.5
