"""Any closed surface of triangles, as a grid of its signed distance."""

import jax.numpy as jnp
from jax import lax

from icjax.geometry._shape import MassProperties, Probes, Shape, length_and_direction
from icjax.typing import Float, Matrix3, Real, Scalar, Vector3

_TURNS = 8


class Mesh(Shape):
    """A solid of triangles: [`read_mesh`] from a file, [`triangle_mesh`] from numbers.

    Its signed distance is exact at the nodes of a grid, and a cubic spline through them in between: with a continuous
    normal and curvature, and right on smooth parts to about a hundredth of the spacing. Edges and corners are rounded,
    by up to 0.2 and 0.3 of the spacing. Against splines through the same nodes, straight lines are three times as far
    off, and their normals jump at every node.

    Beyond the grid, which goes a tenth of the longest side beyond the solid, the distance is that from a point of the
    surface that is nearly the closest: never too small, with the direction from there as the normal.

    **Fields**

    - `coefficients` of the spline, m; `origin` its first node, `spacing` of the nodes, m.
    - `volume`, `com`, `inertia`: of the triangles, exactly; see [`MassProperties`].
    - `points`: vertices that may touch something, a thousand at most, with all that are farthest in some direction, m.
    - `triangles`: the surface, coarser where there are many, for pictures, m.
    - `error`: largest distance of the spline's surface from vertices and 2000 random points of the triangles, m.
    """

    coefficients: Float[Real, "i j k"]
    origin: Vector3
    spacing: Scalar
    volume: Scalar
    com: Vector3
    inertia: Matrix3
    points: Float[Real, "point 3"]
    triangles: Float[Real, "triangle 3 3"]
    error: Scalar

    def _spline(self, p: Vector3) -> tuple[Scalar, Vector3]:
        """Value and gradient at a point within the grid."""
        count = jnp.asarray(self.coefficients.shape, p.dtype)
        place = jnp.clip((p - self.origin) / self.spacing, 1.0, count - 2.0)
        first = jnp.minimum(jnp.floor(lax.stop_gradient(place)), count - 3.0)
        part = place - first
        start = [lax.convert_element_type(first[axis] - 1.0, jnp.int32) for axis in range(3)]
        near = lax.dynamic_slice(self.coefficients, start, (4, 4, 4))
        (a, b, c), (da, db, dc) = zip(*(_weights(part[axis]) for axis in range(3)), strict=True)
        value = jnp.einsum("abc,a,b,c->", near, a, b, c)
        slopes = [jnp.einsum("abc,a,b,c->", near, *three) for three in ((da, b, c), (a, db, c), (a, b, dc))]
        return value, jnp.stack(slopes) / self.spacing

    def _found(self, p: Vector3) -> tuple[Scalar, Vector3]:
        count = jnp.asarray(self.coefficients.shape, p.dtype)
        low, high = self.origin + self.spacing, self.origin + self.spacing * (count - 2.0)
        value, gradient = self._spline(p)
        normal = length_and_direction(gradient)[1]
        # Beyond the grid: of the point where the way from the closest point found so far leaves it.
        outside, beyond = lax.stop_gradient((p, jnp.any((p < low) | (p > high))))

        def turn(_, at):
            height, slope = frozen._spline(at[1])
            foot = at[1] - height * length_and_direction(slope)[1]
            way = outside - foot
            room = jnp.where(way > 0.0, high - foot, foot - low) / jnp.where(way == 0.0, 1.0, jnp.abs(way))
            return foot, foot + jnp.minimum(1.0, jnp.min(jnp.where(way == 0.0, jnp.inf, room))) * way

        frozen, low, high = lax.stop_gradient((self, low, high))
        within = jnp.clip(outside, low, high)
        foot, _ = lax.stop_gradient(lax.fori_loop(0, _TURNS, turn, (within, within)))
        away, direction = length_and_direction(p - jnp.where(beyond, foot, lax.stop_gradient(p) - 1.0))
        return jnp.where(beyond, away, value), jnp.where(beyond, direction, normal)

    def signed_distance(self, p: Vector3) -> Scalar:
        """Distance of `p` (m) from the surface, negative inside, m."""
        return self._found(p)[0]

    def normal(self, p: Vector3) -> Vector3:
        """Unit vector along the gradient of the distance."""
        return self._found(p)[1]

    def mass_properties(self) -> MassProperties:
        """Of the triangles, not of the grid."""
        return MassProperties(jnp.asarray(self.volume), jnp.asarray(self.com), jnp.asarray(self.inertia))

    def probes(self, direction: Vector3) -> Probes:
        """The points that may touch something."""
        return Probes(jnp.asarray(self.points), jnp.zeros_like(jnp.asarray(self.points)[:, 0]))


def _weights(t: Scalar) -> tuple[Float[Real, "4"], Float[Real, "4"]]:
    """Of the four nodes about a cell in a cubic B-spline, and their derivatives."""
    s = 1.0 - t
    weights = jnp.stack([s**3, 4.0 - 6.0 * t**2 + 3.0 * t**3, 4.0 - 6.0 * s**2 + 3.0 * s**3, t**3]) / 6.0
    return weights, jnp.stack([-(s**2), t * (3.0 * t - 4.0), s * (4.0 - 3.0 * s), t**2]) / 2.0
