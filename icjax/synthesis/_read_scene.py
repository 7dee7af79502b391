"""Scenes from TOML files."""

import math
import os
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from icjax.files import FileError
from icjax.geometry import Ellipsoid, Plane
from icjax.synthesis._scene import Scene, Surface

_SCENE_KEYS = ("name", "step", "facets", "friction", "surface")
_SHAPE_KEYS = {"plane": ("point", "normal"), "ellipsoid": ("centre", "radii", "rotation")}


def read_scene(path: str | os.PathLike) -> Scene:
    """Read a scene file.

        name = "bump"                # default: the name of the file
        step = 0.002                 # time step, s (default)
        facets = 4                   # tangent pairs of the friction cone (default)
        friction = 0.9               # of surfaces that state none
        [[surface]]
        name = "plate"
        shape = "plane"
        point = [0.0, 0.0, 0.0]      # m
        normal = [0.0, 0.0, 1.0]     # outward
        [[surface]]
        name = "bump"
        shape = "ellipsoid"
        centre = [0.0, 0.0, 0.0]     # m
        radii = [0.012, 0.035, 0.003]
        rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]   # columns: axes in world (default)
        friction = 0.5

    **Errors**: `FileError`, one line naming the file, the table and the key.
    """
    path = Path(path)
    if not path.is_file():
        raise FileError(path, "does not exist")
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise FileError(path, f"is no valid TOML: {error}") from None
    _known(path, "", content, _SCENE_KEYS)
    tables = content.get("surface", [])
    if not isinstance(tables, list) or not tables or not all(isinstance(item, dict) for item in tables):
        raise FileError(path, "needs at least one [[surface]] table")
    friction = _number(path, "", content, "friction", low=0.0) if "friction" in content else None
    surfaces = tuple(_surface(path, f"[surface {index}] ", table, friction) for index, table in enumerate(tables, 1))
    facets = content.get("facets", 4)
    if not isinstance(facets, int) or isinstance(facets, bool) or facets < 2:
        raise FileError(path, f"facets must be a whole number of at least 2; got {facets!r}")
    step = _number(path, "", content, "step", low=0.0) if "step" in content else 0.002
    if step == 0.0:
        raise FileError(path, "step must be more than 0 s; got 0")
    names = [surface.name for surface in surfaces]
    for index, name in enumerate(names):
        if name in names[:index]:
            raise FileError(path, f"[surface {index + 1}] name {name!r} is taken by an earlier surface")
    return Scene(name=_text(path, "", content, "name", path.stem), surfaces=surfaces, facets=facets, step=step)


def _surface(path: Path, where: str, table: dict, friction: float | None) -> Surface:
    shape = table.get("shape")
    if shape not in _SHAPE_KEYS:
        raise FileError(path, f"{where}shape must be one of {', '.join(_SHAPE_KEYS)}; got {shape!r}")
    _known(path, where, table, ("name", "shape", "friction", *_SHAPE_KEYS[shape]))
    if "friction" in table:
        friction = _number(path, where, table, "friction", low=0.0)
    if friction is None:
        raise FileError(path, f"{where}friction is missing (here or for the whole scene)")
    name = _text(path, where, table, "name", shape)
    if shape == "plane":
        normal = _array(path, where, table, "normal", (3,))
        if not np.linalg.norm(normal) > 0:
            raise FileError(path, f"{where}normal must not be zero")
        return Surface(name, Plane(_array(path, where, table, "point", (3,)), normal), friction)
    radii = _array(path, where, table, "radii", (3,))
    if np.any(radii <= 0):
        raise FileError(path, f"{where}radii must be more than 0 m; got {radii.tolist()}")
    rotation = _array(path, where, table, "rotation", (3, 3)) if "rotation" in table else np.eye(3)
    if np.max(np.abs(rotation.T @ rotation - np.eye(3))) > 1e-6 or np.linalg.det(rotation) < 0:
        raise FileError(path, f"{where}rotation is not a rotation matrix")
    return Surface(name, Ellipsoid(_array(path, where, table, "centre", (3,)), rotation, radii), friction)


def _known(path: Path, where: str, table: dict, keys: tuple[str, ...]) -> None:
    for key in table:
        if key not in keys:
            raise FileError(path, f"{where}unknown key {key!r}; known are {', '.join(keys)}")


def _text(path: Path, where: str, table: dict, key: str, default: str) -> str:
    value = table.get(key, default)
    if not isinstance(value, str) or not value:
        raise FileError(path, f"{where}{key} must be a text; got {value!r}")
    return value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _number(path: Path, where: str, table: dict, key: str, low: float) -> float:
    value = table[key]
    if not _is_number(value) or value < low:
        raise FileError(path, f"{where}{key} must be a number of at least {low:g}; got {value!r}")
    return float(value)


def _array(path: Path, where: str, table: dict, key: str, shape: tuple[int, ...]) -> np.ndarray:
    if key not in table:
        raise FileError(path, f"{where}{key} is missing")
    try:
        value = np.asarray(table[key], float)
    except (TypeError, ValueError):
        value = np.full(0, np.nan)
    if value.shape != shape or not np.all(np.isfinite(value)):
        size = " x ".join(map(str, shape))
        raise FileError(path, f"{where}{key} must be {size} finite numbers; got {table[key]!r}")
    return value
