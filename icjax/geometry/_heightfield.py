"""Uneven ground: heights on a grid."""

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from icjax.geometry._shape import MassProperties, Probes, Shape, length_and_direction
from icjax.typing import Float, Int, Real, Scalar, Vector3

BEYOND = 10.0
"""m; so far the heights of the rim go on around the grid."""

MOST_CELLS = 8


class Heightfield(Shape):
    """Ground below triangles over a grid of the x-y plane, whose middle is the origin. For surfaces only.

    Every cell is two triangles, parted from its corner of the lowest x and y to that of the highest. The distance from
    them is exact up to `reach` above and below the ground; farther away it is that from the triangles so near in x and
    y, never less than the distance. Around the grid the heights of its rim go on.

    **Arguments**

    - `heights`: z at the nodes, m; along x in rows, along y in columns, at least two of each.
    - `spacing`: of the nodes, m, one for both directions or two.
    - `reach`: m, up to eight spacings; default three of them. The work grows with its square.

    **Errors**: `ValueError` for fewer nodes, numbers that are not finite, a spacing that is not positive.
    """

    heights: Float[Real, "x y"]
    spacing: Float[Real, "2"]
    cells: int = eqx.field(static=True)

    def __init__(self, heights: Float[Real, "x y"], spacing: Any, reach: float | None = None):
        self.heights = jnp.asarray(heights)
        self.spacing = jnp.broadcast_to(jnp.asarray(spacing, self.heights.dtype), (2,))
        if self.heights.ndim != 2 or min(self.heights.shape) < 2:
            raise ValueError(f"a heightfield needs two nodes in x and in y; got {list(self.heights.shape)}")
        if not isinstance(self.heights, Tracer) and not np.isfinite(self.heights).all():
            row, column = np.argwhere(~np.isfinite(np.asarray(self.heights)))[0]
            raise ValueError(f"heights of a heightfield must be finite; row {row}, column {column} is not")
        if reach is not None and not reach > 0:
            raise ValueError(f"reach of a heightfield must be positive; got {reach:g} m")
        self.cells = 3
        if not isinstance(self.spacing, Tracer):
            smallest = float(np.min(np.asarray(self.spacing)))
            if not (np.isfinite(smallest) and smallest > 0):
                raise ValueError(
                    f"spacing of a heightfield must be positive; got {np.asarray(self.spacing).tolist()} m"
                )
            self.cells = self.cells if reach is None else max(1, math.ceil(reach / smallest * (1 - 1e-9)))
            if self.cells > MOST_CELLS:
                raise ValueError(
                    f"reach {reach:g} m of a heightfield is more than {MOST_CELLS} of its spacings of {smallest:g} m"
                )

    @property
    def reach(self) -> Scalar:
        """How far from the ground the distance is exact, m."""
        return self.cells * jnp.min(self.spacing)

    def nodes(self) -> Float[Real, "node 3"]:
        """Corners of the triangles, m."""
        x, y = (self._axis(axis)[1:-1] for axis in (0, 1))
        rows = [jnp.repeat(x, y.shape[0]), jnp.tile(y, x.shape[0]), self.heights.reshape(-1)]
        return jnp.stack(rows, axis=1)

    def _axis(self, axis: int) -> Float[Real, " node"]:
        """Places of the nodes and, far beyond, of those that carry on the rim."""
        count, dtype = self.heights.shape[axis], self.heights.dtype
        inner = self.spacing[axis] * (jnp.arange(count, dtype=dtype) - 0.5 * (count - 1))
        return jnp.concatenate([inner[:1] - BEYOND, inner, inner[-1:] + BEYOND])

    def _cell(self, p: Vector3) -> tuple[Int[Real, ""], Int[Real, ""]]:
        counts = np.array(self.heights.shape)
        place = lax.stop_gradient(p[:2] / self.spacing) + jnp.asarray(0.5 * (counts - 1), p.dtype)
        number = jnp.clip(jnp.floor(place) + 1.0, 0.0, jnp.asarray(counts, p.dtype)).astype(jnp.int32)
        return number[0], number[1]

    def _near(self, p: Vector3, cells: int) -> Float[Real, "triangle 3 3"]:
        """Triangles of so many cells to every side of the one below a point."""
        padded = jnp.pad(self.heights, 1, mode="edge")
        sizes = [min(2 * cells + 1, count - 1) + 1 for count in padded.shape]
        limits = zip(self._cell(p), padded.shape, sizes, strict=True)
        start = [jnp.clip(at - cells, 0, count - size) for at, count, size in limits]
        z = lax.dynamic_slice(padded, start, sizes)
        x, y = (lax.dynamic_slice(self._axis(axis), (start[axis],), (sizes[axis],)) for axis in (0, 1))
        nodes = jnp.stack([jnp.broadcast_to(x[:, None], z.shape), jnp.broadcast_to(y[None], z.shape), z], axis=-1)
        a, b, c, d = nodes[:-1, :-1], nodes[1:, :-1], nodes[1:, 1:], nodes[:-1, 1:]
        return jnp.stack([jnp.stack([a, b, c], axis=2), jnp.stack([a, c, d], axis=2)], axis=2).reshape(-1, 3, 3)

    def _found(self, p: Vector3) -> tuple[Scalar, Vector3]:
        triangles = self._near(p, self.cells)
        away = jnp.sum(_from_triangles(*lax.stop_gradient((p, triangles)))[0] ** 2, axis=1)
        nearest = triangles[jnp.argmin(away)]
        (rest,), (over,) = _from_triangles(p, nearest[None])
        normal = _upward(nearest)
        height = jnp.dot(normal, p - nearest[0])
        below = lax.stop_gradient(self._below(p))
        distance, direction = length_and_direction(rest)
        hair = jnp.finfo(p.dtype).eps ** 0.75 * jnp.min(self.spacing)
        plane = lax.stop_gradient(over | (distance < hair))
        side = jnp.where(below, -1.0, 1.0).astype(p.dtype)
        return jnp.where(plane, height, side * distance), jnp.where(plane, normal, side * direction)

    def _below(self, p: Vector3):
        """Whether a point lies below the ground."""
        pair = self._near(p, 0)
        a, _, c = pair[0]
        beyond = (p[1] - a[1]) * (c[0] - a[0]) > (p[0] - a[0]) * (c[1] - a[1])
        triangle = jnp.where(beyond, pair[1], pair[0])
        return jnp.dot(_upward(triangle), p - triangle[0]) < 0.0

    def signed_distance(self, p: Vector3) -> Scalar:
        """Distance of `p` (m) from the ground, negative below, m."""
        return self._found(p)[0]

    def normal(self, p: Vector3) -> Vector3:
        """Unit normal at the point of the ground closest to `p`; over an edge, from there to `p`."""
        return self._found(p)[1]

    def mass_properties(self) -> MassProperties:
        """**Errors**: `ValueError`, always."""
        raise ValueError("a heightfield has no mass; only surfaces can be heightfields")

    def probes(self, direction: Vector3) -> Probes:
        """**Errors**: `ValueError`, always."""
        raise ValueError("a heightfield has no end; only surfaces can be heightfields")


def _upward(triangle: Float[Real, "3 3"]) -> Vector3:
    normal = jnp.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    return normal / jnp.sqrt(jnp.sum(normal**2))


def _from_triangles(p: Vector3, triangles: Float[Real, "triangle 3 3"]):
    """From the closest point of each triangle to a point, and whether that lies within it."""
    side = jnp.roll(triangles, -1, axis=1) - triangles
    away = p[None, None] - triangles
    normal = jnp.cross(side[:, 0], side[:, 1])
    over = jnp.all(jnp.sum(jnp.cross(normal[:, None], side) * away, axis=2) >= 0.0, axis=1)
    place = jnp.clip(jnp.sum(side * away, axis=2) / jnp.sum(side**2, axis=2), 0.0, 1.0)
    rest = away - place[:, :, None] * side
    nearest = jnp.argmin(jnp.sum(lax.stop_gradient(rest) ** 2, axis=2), axis=1)
    edge = jnp.sum(jnp.where(jnp.arange(3)[None, :, None] == nearest[:, None, None], rest, 0.0), axis=1)
    height = jnp.sum(normal * away[:, 0], axis=1) / jnp.sum(normal**2, axis=1)
    return jnp.where(over[:, None], height[:, None] * normal, edge), over
