"""Shapes in the place of others: of another size, or another kind that is as large."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from icjax.geometry import Box, Capsule, Cylinder, Ellipsoid, Placed, Plane, Shape, Sphere, Union, wedge
from icjax.spatial import Pose

AS_GIVEN = "as given"

LENGTHS = ("half_sizes", "radius", "half_length", "radii", "outline")
"""Fields of shapes that grow with their size."""

LEAN = np.radians(8.0)
"""Of each of two faces of a wedge: a box of a side view, narrower at the top."""


def resized(shape: Shape, factor: float, about_middle: bool = False) -> Shape:
    """The shape larger by a factor, about the origin of its frame or about its own middle; a plane as it is.

    **Errors**: `ValueError` for a factor that is not positive, or a shape that has no size (a mesh, a
    heightfield) and a factor other than one.
    """
    if not (np.isfinite(factor) and factor > 0):
        raise ValueError(f"the factor on a size must be positive; got {factor}")
    if isinstance(shape, Plane):
        return shape
    spread = 1.0 if about_middle else factor
    if isinstance(shape, Placed):
        moved = Pose(shape.pose.rotation, spread * shape.pose.position)
        return Placed(resized(shape.shape, factor, about_middle), moved)
    if isinstance(shape, Union):
        return Union([resized(part, factor) for part in shape.parts])
    own = {field.name: getattr(shape, field.name) for field in dataclasses.fields(shape)}
    grown: dict[str, Any] = {name: factor * own[name] for name in LENGTHS if name in own}
    if not grown and factor == 1:
        return shape
    if not grown:
        raise ValueError(f"a {type(shape).__name__.lower()} has no size to change")
    if "centre" in own:
        grown["centre"] = spread * own["centre"]
    return dataclasses.replace(shape, **grown)


def lowest(shape: Shape, up: np.ndarray) -> float:
    """Height of the lowest point of a solid along a unit vector, m, in its own frame."""
    centre, radius = (np.asarray(part) for part in shape.probes(-up))
    return float(np.min(centre @ up - radius))


def extent(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Middle and half lengths of the box along its axes that holds a solid, m."""
    low = np.array([lowest(shape, axis) for axis in np.eye(3)])
    high = np.array([-lowest(shape, -axis) for axis in np.eye(3)])
    return 0.5 * (low + high), 0.5 * (high - low)


def substitute(shape: Shape, kind: str, rotation: Any, up: np.ndarray | None) -> Shape:
    """A shape of another kind that fills the same box, a ball and a capsule about the same room.

    **Arguments**: `kind` one of `SUBSTITUTES`, or `AS_GIVEN`; `rotation` of the shape's frame in the world and `up`
    there, by which a wedge stands upright.

    **Errors**: `ValueError` for an unknown kind.
    """
    if kind == AS_GIVEN:
        return shape
    if kind not in SUBSTITUTES:
        raise ValueError(f"unknown shape {kind!r}; known are {', '.join((AS_GIVEN, *SUBSTITUTES))}")
    middle, half = extent(shape)
    upright = np.array([0.0, 0.0, 1.0]) if up is None else np.asarray(rotation).T @ up
    made, turn = SUBSTITUTES[kind](half, int(np.argmax(np.abs(upright))), np.sign(upright))
    if np.array_equal(turn, np.eye(3)) and not middle.any():
        return made
    return Placed(made, Pose(turn, middle))


def _box(half: np.ndarray, vertical: int, signs: np.ndarray) -> tuple[Shape, np.ndarray]:
    return Box(half), np.eye(3)


def _sphere(half: np.ndarray, vertical: int, signs: np.ndarray) -> tuple[Shape, np.ndarray]:
    return Sphere(float(np.prod(half) ** (1 / 3))), np.eye(3)


def _ellipsoid(half: np.ndarray, vertical: int, signs: np.ndarray) -> tuple[Shape, np.ndarray]:
    return Ellipsoid(np.zeros(3), np.eye(3), half), np.eye(3)


def _cylinder(half: np.ndarray, vertical: int, signs: np.ndarray) -> tuple[Shape, np.ndarray]:
    radius, length, turn = _along_the_longest(half)
    return Cylinder(radius, length), turn


def _capsule(half: np.ndarray, vertical: int, signs: np.ndarray) -> tuple[Shape, np.ndarray]:
    radius, length, turn = _along_the_longest(half)
    return Capsule(radius, max(length - radius, 0.05 * radius)), turn


def _wedge(half: np.ndarray, vertical: int, signs: np.ndarray) -> tuple[Shape, np.ndarray]:
    """Narrower at the top, leaning along the shorter of the two level axes."""
    level = [axis for axis in range(3) if axis != vertical]
    across, along = sorted(level, key=lambda axis: half[axis])
    turn = np.zeros((3, 3))
    turn[across, 0], turn[vertical, 1] = 1.0, signs[vertical]
    turn[:, 2] = np.cross(turn[:, 0], turn[:, 1])
    return wedge(2.0 * half[across], 2.0 * half[vertical], 2.0 * half[along], LEAN), turn


def _along_the_longest(half: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Radius and half length of what is round about the longest axis, and the rotation that takes z there."""
    axis = int(np.argmax(half))
    turn = np.roll(np.eye(3), axis - 2, axis=0)
    return float(np.sqrt(np.prod(np.delete(half, axis)))), float(half[axis]), turn


SUBSTITUTES: dict[str, Callable[[np.ndarray, int, np.ndarray], tuple[Shape, np.ndarray]]] = {
    "box": _box,
    "wedge": _wedge,
    "sphere": _sphere,
    "capsule": _capsule,
    "cylinder": _cylinder,
    "ellipsoid": _ellipsoid,
}
