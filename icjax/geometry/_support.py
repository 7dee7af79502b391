"""Where an ellipsoid comes closest to another solid."""

from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from icjax.compiling import as_primitive
from icjax.geometry._box import Box
from icjax.geometry._ellipsoid import Ellipsoid
from icjax.geometry._prism import Prism
from icjax.geometry._round import Capsule, Cylinder
from icjax.geometry._shape import Placed, length_and_direction
from icjax.typing import Float, Matrix3, Real, Vector3

_PARTS = 0.5, 0.2, 0.05
"""Of the way to the new normal that a turn takes: the rounder the other solid, the less."""

_TURNS = 8

_STEPS = 1.0, 0.5, 0.2, 0.05, 0.01

_NEWTON, _LAST = 30, 4


def touched_from(solid: Ellipsoid, other: Placed) -> Float[Real, "point 3"]:
    """Points of an ellipsoid that may be closest to another solid and are not found from there.

    Over a face they are the farthest ones against its normal. Beside another ellipsoid, and beside what is not convex,
    the point x fulfils ``x = s(-n(x))``, s the farthest one along a direction, n the other's normal; the search for it
    has no derivative, its solution has that of this condition.
    """
    shape: Any = other.shape
    if isinstance(shape, Ellipsoid):
        placed = Ellipsoid(other.pose.apply(shape.centre), other.pose.rotation @ shape.rotation, shape.radii)
        return _settled()(solid, other, _search_of_two()(solid, placed))[None]
    if isinstance(shape, Box | Prism):
        normals = shape.polytope().normals @ other.pose.rotation.T
    elif isinstance(shape, Cylinder):
        axis = other.pose.rotation[:, 2]
        normals = jnp.stack([axis, -axis])
    elif isinstance(shape, Capsule):
        return jnp.zeros((0, 3), solid.radii.dtype)
    else:
        return _settled()(solid, other, _search()(solid, other))[None]
    return jax.vmap(lambda normal: _farthest(solid, -normal))(normals)


def _farthest(solid: Ellipsoid, direction: Vector3) -> Vector3:
    return solid.probes(direction).centre[0]


def _again(solid: Ellipsoid, other: Placed, point: Vector3) -> Vector3:
    return _farthest(solid, -other.normal(point))


@lru_cache
def _settled():
    """The same point with its derivative."""

    def derivative(arguments, changes):
        solid, other, point = arguments
        _, change = jax.jvp(lambda one, two: _again(one, two, point), (solid, other), changes[:2])
        slope = jax.jacfwd(lambda x: _again(solid, other, x))(point)
        return point, _inverse(jnp.eye(3, dtype=point.dtype) - slope) @ change

    return as_primitive(lambda solid, other, point: point, derivative)


@lru_cache
def _search():
    return as_primitive(_closest)


@lru_cache
def _search_of_two():
    return as_primitive(_closest_of_two)


def _closest(solid: Ellipsoid, other: Placed) -> Vector3:
    def turn(number, at):
        normal, best, least = at
        part = sum(part * (number // _TURNS == k) for k, part in enumerate(_PARTS))
        point = _farthest(solid, -normal)
        gap, there = other.signed_distance(point), other.normal(point)
        better = gap < least
        following = length_and_direction((1.0 - part) * normal + part * there)[1]
        following = jnp.where(number == 0, there, following)
        return following, jnp.where(better, point, best), jnp.where(better, gap, least)

    start = other.normal(solid.centre), solid.centre, jnp.full((), jnp.inf, solid.radii.dtype)
    return lax.fori_loop(0, _TURNS * len(_PARTS), turn, start)[1]


def _closest_of_two(first: Ellipsoid, second: Ellipsoid) -> Vector3:
    """Along the normal for which the ellipsoids are farthest apart, or overlap least, by Newton's method."""

    def apart(normal):
        heights = [_height(each, normal) for each in (first, second)]
        return jnp.dot(normal, first.centre - second.centre) - heights[0][0] - heights[1][0], heights

    def newton(normal, least):
        gap, ((_, a, A), (_, b, B)) = apart(normal)
        along = normal[:, None] * normal[None]
        across = jnp.eye(3, dtype=normal.dtype) - along
        uphill = across @ (first.centre - second.centre - a - b)
        return _inverse(across @ (A + B) @ across + jnp.maximum(gap, least) * across + along) @ uphill, uphill

    def turn(_, normal):
        step, _ = newton(normal, 0.0)
        tried = [length_and_direction(normal + part * step)[1] for part in (0.0, *_STEPS)]
        gaps = jnp.stack([apart(each)[0] for each in tried])
        return jnp.stack(tried)[jnp.argmax(gaps)]

    def last(_, normal):
        """At the top rounding hides which one is higher, but not which one is level."""
        step, slope = newton(normal, -jnp.inf)
        moved = length_and_direction(normal + step)[1]
        better = jnp.sum(newton(moved, -jnp.inf)[1] ** 2) < jnp.sum(slope**2)
        return jnp.where(better, moved, normal)

    start = length_and_direction(first.centre - second.centre)[1]
    normal = lax.fori_loop(0, _NEWTON, turn, start)
    return _farthest(first, -lax.fori_loop(0, _LAST, last, normal))


def _height(solid: Ellipsoid, normal: Vector3):
    """Of an ellipsoid above its centre along a direction, with its first and second derivatives."""
    square = (solid.rotation * solid.radii[None] ** 2) @ solid.rotation.T
    height = jnp.sqrt(normal @ square @ normal)
    slope = square @ normal / height
    return height, slope, (square - slope[:, None] * slope[None]) / height


def _inverse(matrix: Matrix3) -> Matrix3:
    """By cross products; of a singular matrix, nothing changed."""
    a, b, c = matrix[:, 0], matrix[:, 1], matrix[:, 2]
    rows = jnp.stack([jnp.cross(b, c), jnp.cross(c, a), jnp.cross(a, b)])
    determinant = jnp.dot(a, jnp.cross(b, c))
    regular = jnp.abs(determinant) > jnp.finfo(matrix.dtype).eps
    return jnp.where(regular, rows / jnp.where(regular, determinant, 1.0), jnp.eye(3, dtype=matrix.dtype))
