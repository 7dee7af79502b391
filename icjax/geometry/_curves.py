"""Where a solid can touch first: its edges, rims and axes as curves, and points."""

import dataclasses
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from icjax.compiling import as_primitive
from icjax.geometry._box import Box
from icjax.geometry._ellipsoid import Ellipsoid
from icjax.geometry._heightfield import Heightfield
from icjax.geometry._mesh import Mesh
from icjax.geometry._prism import Prism
from icjax.geometry._round import Capsule, Cylinder
from icjax.geometry._shape import Placed, Shape, length_and_direction
from icjax.geometry._support import touched_from
from icjax.spatial import Pose
from icjax.typing import Float, Real, Scalar

LEVEL = 0.005
"""rad; where a curve runs along the other solid at less than this slope, all of it counts as touching."""

SAMPLES, SPREAD = 12, 9
"""Points of a rim; points of a straight curve beside what is not convex."""

HALVINGS = 40
"""Of the interval in which a place on a curve is sought."""


def replace(solid: Any, **fields) -> Any:
    """The same solid with other fields, whose numbers need no check."""
    changed = object.__new__(type(solid))
    for field in dataclasses.fields(solid):
        object.__setattr__(changed, field.name, fields.get(field.name, getattr(solid, field.name)))
    return changed


class Curves(NamedTuple):
    """Curves ``x(t) = base + t along + cos(t) first + sin(t) second`` of centres of balls that belong to a solid.

    **Fields**: `base`, `along`, `first`, `second`, m; `ball`, the radius, m. Straight ones are meant from t = 0 to 1.
    """

    base: Float[Real, "curve 3"]
    along: Float[Real, "curve 3"]
    first: Float[Real, "curve 3"]
    second: Float[Real, "curve 3"]
    ball: Float[Real, " curve"]

    def moved(self, pose: Pose) -> "Curves":
        """After a motion of the solid."""
        R = pose.rotation.T
        rows = (self.base @ R + pose.position[None], self.along @ R, self.first @ R, self.second @ R)
        return Curves(*rows, self.ball)

    def at(self, t: Float[Real, " curve"]) -> Float[Real, "curve 3"]:
        """Places on the curves."""
        t = t[:, None]
        return self.base + t * self.along + jnp.cos(t) * self.first + jnp.sin(t) * self.second

    def towards(self, t: Float[Real, " curve"]) -> Float[Real, "curve 3"]:
        """Unit tangents; zero of a point."""
        t = t[:, None]
        tangent = self.along - jnp.sin(t) * self.first + jnp.cos(t) * self.second
        square = jnp.sum(tangent**2, axis=1, keepdims=True)
        return tangent / jnp.sqrt(jnp.where(square > 0.0, square, 1.0))


class Places(NamedTuple):
    """Where on curves to look, in NumPy, because it depends on kinds of solids only.

    **Fields**: `curve` number of each place that is sought, `slope` of the distance along it that is wanted there;
    `fixed` numbers of curves and `at` places on them that are taken as they are; `rims`, how many of the curves, the
    last ones, are rims, on which the closest of `SAMPLES` fixed places shows where to seek.
    """

    curve: np.ndarray
    slope: np.ndarray
    fixed: np.ndarray
    at: np.ndarray
    rims: int


def curves_of(solid: Shape, other: Placed) -> Curves:
    """Of a solid at the origin; those that depend on where the other one is are differentiable in that."""
    if isinstance(solid, Box | Prism):
        polytope = solid.polytope()
        start, stop = jnp.moveaxis(polytope.vertices[polytope.topology.edges], 1, 0)
        return _straight(start, stop, jnp.zeros_like(start[:, 0]))
    if isinstance(solid, Capsule):
        ends = _axis(solid.half_length)
        return _straight(ends[:1], ends[1:], solid.radius[None])
    if isinstance(solid, Cylinder):
        return _of_cylinder(solid, other)
    points = touched_from(solid, other) if isinstance(solid, Ellipsoid) else points_of(solid)
    zero = jnp.zeros_like(points)
    return Curves(points, zero, zero, zero, zero[:, 0])


def points_of(solid: Shape) -> Float[Real, "point 3"]:
    """Of a mesh or a heightfield; of any other solid that has none, no point."""
    if isinstance(solid, Heightfield):
        return solid.nodes()
    return jnp.asarray(solid.points) if isinstance(solid, Mesh) else jnp.zeros((0, 3))


def places_on(kind: type[Shape], count: int, convex: bool) -> Places:
    """Where to look on so many curves of a kind of solid, beside a convex one or another."""
    everywhere = np.arange(count)
    if not issubclass(kind, Box | Prism | Capsule | Cylinder):
        none = np.zeros(0)
        return Places(none.astype(int), none, everywhere, np.zeros(count), 0)
    rims = 2 if issubclass(kind, Cylinder) else 0
    straight = everywhere[: count - rims]
    slopes = [-LEVEL, 0.0, LEVEL] if convex else []
    curve = np.concatenate([np.tile(straight, len(slopes)), everywhere[count - rims :]]).astype(int)
    slope = np.concatenate([np.repeat(slopes, len(straight)), np.zeros(rims)])
    spread = np.linspace(0.0, 1.0, 2 if convex else SPREAD)
    turns = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
    fixed = np.concatenate([np.repeat(straight, len(spread)), np.repeat(everywhere[count - rims :], SAMPLES)])
    return Places(curve, slope, fixed, np.concatenate([np.tile(spread, len(straight)), np.tile(turns, rims)]), rims)


def rounded(solid: Shape) -> tuple[Shape, Scalar]:
    """A smaller solid and the radius of balls about its points that fill all but the edges of the solid."""
    if isinstance(solid, Box):
        radius = _ROUND * jnp.min(solid.half_sizes)
        return Box(solid.half_sizes - radius), radius
    if isinstance(solid, Cylinder):
        radius = _ROUND * jnp.minimum(solid.radius, solid.half_length)
        return Cylinder(solid.radius - radius, solid.half_length - radius), radius
    if isinstance(solid, Prism):
        edge = jnp.roll(solid.outline, -1, axis=0) - solid.outline
        size = jnp.sqrt(jnp.sum(edge**2, axis=1))
        radius = _ROUND * jnp.minimum(0.5 * jnp.min(size), solid.half_length)
        outward = jnp.stack([edge[:, 1], -edge[:, 0]], axis=1) / size[:, None]
        before = jnp.roll(outward, 1, axis=0)
        inset = (outward + before) / (1.0 + jnp.sum(outward * before, axis=1, keepdims=True))
        return replace(solid, outline=solid.outline - radius * inset, half_length=solid.half_length - radius), radius
    if isinstance(solid, Heightfield):  # where it is touched, the triangles about a point are enough
        return replace(solid, cells=1), jnp.zeros((), solid.heights.dtype)
    return solid, jnp.zeros((), jnp.result_type(*jax.tree.leaves(solid)))


_ROUND = 0.01
"""Radius of the edges that cross another edge, as a part of the smallest half size."""


def slope(curves: Curves, t: Float[Real, " curve"], other: Placed) -> Float[Real, " curve"]:
    """Of the distance along curves, a number each."""
    return jnp.sum(jax.vmap(other.normal)(curves.at(t)) * curves.towards(t), axis=1)


def sought(curves: Curves, low: Real, high: Real, wanted: Real, other: Placed) -> tuple[Real, Real]:
    """First place in an interval of each curve where the slope is at least the wanted one; else the end of it.

    **Returns**: the places, and whether they lie within.
    """

    def halve(_, ends):
        lower, upper = ends
        middle = 0.5 * (lower + upper)
        reached = slope(curves, middle, other) >= wanted
        return jnp.where(reached, lower, middle), jnp.where(reached, middle, upper)

    _, found = lax.fori_loop(0, HALVINGS, halve, (low, high))
    hair = 4.0 * 0.5**HALVINGS * (high - low)
    first, last = found - low < hair, high - found < hair
    return jnp.where(first, low, jnp.where(last, high, found)), ~(first | last)


@lru_cache
def refined():
    """Of curves, places on them, which of these are free to move, and the other solid: the same places.

    Their derivative is that of the condition that the slope stays what it is.
    """

    def derivative(arguments, changes):
        curves, t, free, other = arguments
        along = jax.jvp(lambda t: slope(curves, t, other), (t,), (jnp.ones_like(t),))[1]
        moved = jax.jvp(lambda *two: slope(two[0], t, two[1]), (curves, other), (changes[0], changes[3]))[1]
        free = free & (along > 0.0)
        return t, jnp.where(free, -moved / jnp.where(free, along, 1.0), 0.0)

    return as_primitive(lambda curves, t, free, other: t, derivative)


def _of_cylinder(solid: Cylinder, other: Placed) -> Curves:
    """The line of its side that faces the other solid, and both rims."""
    radius, ends = solid.radius, _axis(solid.half_length)
    axis = _straight(ends[:1], ends[1:], radius[None])
    zero, none = jnp.zeros((1,), radius.dtype), jnp.zeros((1, 3), radius.dtype)
    t = refined()(axis, *_sought()(axis, zero, zero + 1.0, zero, other), other)
    _, (x, y) = length_and_direction(-other.normal(axis.at(t)[0])[:2])
    side = radius * jnp.stack([x, y, jnp.zeros_like(x)])
    facing = _straight(ends[:1] + side[None], ends[1:] + side[None], zero)
    first, second = (radius * jnp.eye(3, dtype=radius.dtype)[k] for k in (0, 1))
    rims = [Curves(end[None], none, first[None], second[None], zero) for end in ends]
    return jax.tree.map(lambda *rows: jnp.concatenate(rows), facing, *rims)


@lru_cache
def _sought():
    return as_primitive(sought)


def _axis(half_length: Scalar) -> Float[Real, "2 3"]:
    return half_length * jnp.asarray([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]], half_length.dtype)


def _straight(start: Float[Real, "curve 3"], stop: Float[Real, "curve 3"], ball: Float[Real, " curve"]) -> Curves:
    zero = jnp.zeros_like(start)
    return Curves(start, stop - start, zero, zero, ball)
