"""Shapes from the tables of a scene file, and where they are."""

import math
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from icjax.files import Table, as_numbers, as_rotation
from icjax.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Heightfield,
    Placed,
    Plane,
    Prism,
    Shape,
    Sphere,
    Union,
    read_mesh,
    wedge,
)
from icjax.spatial import Pose, quaternion_to_rotation

UNIT = 0.01
"""How far the length of a quaternion may be from one: as far as three decimals take it."""


def read_surface_shape(table: Table) -> tuple[str, Shape]:
    """Kind and shape of a surface, in the world. **Errors**: `FileError` naming the key."""
    kind = table.choice("shape", ("plane", *_SOLIDS, "heightfield"))
    if kind == "plane":
        normal = np.array(table.vector("normal"))
        if not np.linalg.norm(normal) > 0:
            raise table.error("key 'normal' must not be zero")
        return kind, Plane(np.array(table.vector("point")), normal)
    solid = _heightfield(table) if kind == "heightfield" else _SOLIDS[kind](table)
    if isinstance(solid, Ellipsoid):  # which may stand anywhere by itself
        pose = read_pose(table, "position" if "position" in table.content else "centre")
        return kind, Ellipsoid(pose.position, pose.rotation, solid.radii)
    return kind, Placed(solid, read_pose(table))


def read_object_shape(table: Table) -> tuple[str, Shape]:
    """Kind and shape of an object, in its own frame. **Errors**: `FileError` naming the key."""
    kind = table.choice("shape", _SOLIDS)
    return kind, _SOLIDS[kind](table)


def read_pose(table: Table, position: str = "position") -> Pose:
    """Of a shape's frame in the world. **Errors**: `FileError` naming the key."""
    place = np.array(table.vector(position))
    if "quaternion" in table.content and "rotation" in table.content:
        raise table.error("has both 'rotation' and 'quaternion'; give one")
    quaternion = table.take("quaternion", _as_quaternion, "four numbers w, x, y, z of length 1", None)
    rows = table.take("rotation", as_rotation, "three rows of a rotation matrix", np.eye(3))
    rotation = np.array(rows) if quaternion is None else quaternion_to_rotation(jnp.asarray(quaternion))
    return Pose(rotation, place)


def _as_quaternion(value: Any) -> np.ndarray:
    quaternion = np.array(as_numbers(value, 4))
    if abs(np.linalg.norm(quaternion) - 1.0) > UNIT:
        raise ValueError
    return quaternion


def _box(table: Table) -> Shape:
    return Box(_sizes(table, "half_sizes"))


def _sphere(table: Table) -> Shape:
    return Sphere(table.number("radius", above=0.0))


def _capsule(table: Table) -> Shape:
    return Capsule(table.number("radius", above=0.0), table.number("half_length", above=0.0))


def _cylinder(table: Table) -> Shape:
    return Cylinder(table.number("radius", above=0.0), table.number("half_length", above=0.0))


def _ellipsoid(table: Table) -> Shape:
    return Ellipsoid(np.zeros(3), np.eye(3), _sizes(table, "radii"))


def _wedge(table: Table) -> Shape:
    width, height, depth = (table.number(key, above=0.0) for key in ("width", "height", "depth"))
    degrees = table.number("tilt_degrees")
    try:
        return wedge(width, height, depth, math.radians(degrees))
    except ValueError as error:
        raise table.error(
            f"key 'tilt_degrees' is {degrees:g}: the sides would meet, for width {width:g} and height {height:g} m"
        ) from error


def _prism(table: Table) -> Shape:
    outline = table.take("outline", _as_points, "a list of points [x, y]")
    try:
        return Prism(np.array(outline), table.number("half_length", above=0.0))
    except ValueError as error:
        raise table.error(f"key 'outline' is none of a prism: {error}") from error


def _union(table: Table) -> Shape:
    parts = []
    for part in table.tables("part"):
        _, shape = read_object_shape(part)
        parts.append(Placed(shape, read_pose(part)))
        part.close()
    if not parts:
        raise table.error("needs at least one [[part]] table")
    return Union(parts)


def _mesh(table: Table) -> Shape:
    file = table.path.parent / table.text("file")
    scale, spacing = table.number("scale", 1.0, above=0.0), table.number("spacing", None, above=0.0)
    repair = table.flag("repair", False)
    try:
        return read_mesh(file, scale=scale, spacing=spacing, repair=repair)
    except ValueError as error:
        raise table.error(f"key 'file': {error}") from error


def _heightfield(table: Table) -> Shape:
    if ("heights" in table.content) == ("file" in table.content):
        raise table.error("needs the key 'heights' (rows of numbers, m) or 'file' (.csv or .npy), one of them")
    rows = table.take("heights", _as_rows, "rows of as many numbers each, m", None)
    scale = table.number("scale", 1.0, above=0.0)
    heights = scale * (np.array(rows) if rows is not None else _heights_in(table, table.text("file")))
    both = table.take("spacing", _as_spacing, "a number above 0, m, or two")
    reach = table.number("reach", None, above=0.0)
    try:
        return Heightfield(heights, np.array(both), reach)
    except ValueError as error:
        raise table.error(str(error)) from error


def _heights_in(table: Table, name: str) -> np.ndarray:
    path = table.path.parent / name
    try:
        loaded = np.load(path) if path.suffix == ".npy" else np.loadtxt(path, delimiter=",", ndmin=2)
        heights = np.asarray(loaded, float)
    except (OSError, ValueError, EOFError) as error:
        wrong = "does not exist" if not path.is_file() else f"holds no table of numbers: {str(error).splitlines()[0]}"
        raise table.error(f"key 'file': {path} {wrong}") from error
    if heights.ndim != 2:
        raise table.error(f"key 'file': {path} holds an array of {heights.ndim} dimensions, not 2")
    return heights


def _as_rows(value: Any) -> list[tuple[float, ...]]:
    if not isinstance(value, list) or not value or not isinstance(value[0], list):
        raise ValueError
    return [as_numbers(row, len(value[0])) for row in value]


def _as_spacing(value: Any) -> tuple[float, ...]:
    both = as_numbers(value if isinstance(value, list) else [value, value], 2)
    if min(both) <= 0:
        raise ValueError
    return both


def _as_points(value: Any) -> list[tuple[float, ...]]:
    if not isinstance(value, list) or not value:
        raise ValueError
    return [as_numbers(point, 2) for point in value]


def _sizes(table: Table, key: str) -> np.ndarray:
    sizes = np.array(table.vector(key))
    if np.any(sizes <= 0):
        raise table.error(f"key '{key}' must be more than 0 m, not {sizes.tolist()}")
    return sizes


_SOLIDS: dict[str, Callable[[Table], Shape]] = {
    "box": _box,
    "sphere": _sphere,
    "capsule": _capsule,
    "cylinder": _cylinder,
    "ellipsoid": _ellipsoid,
    "wedge": _wedge,
    "prism": _prism,
    "union": _union,
    "mesh": _mesh,
}
