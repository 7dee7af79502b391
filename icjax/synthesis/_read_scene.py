"""Scenes from TOML files."""

import os
from pathlib import Path

import numpy as np

from icjax.files import FileError, Table, as_rotation, read_toml
from icjax.geometry import Ellipsoid, Plane
from icjax.synthesis._scene import Scene
from icjax.synthesis._surface import Surface

SHAPES = ("plane", "ellipsoid")


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
    top = Table(path, "", read_toml(path))
    name = top.label("name", path.stem)
    step = top.number("step", 0.002, above=0.0)
    facets = top.whole("facets", 4, least=2)
    friction = top.number("friction", None, least=0.0)
    surfaces = tuple(_surface(table, friction) for table in top.tables("surface"))
    if not surfaces:
        raise FileError(path, "needs at least one [[surface]] table")
    names = [surface.name for surface in surfaces]
    for index, taken in enumerate(names):
        if taken in names[:index]:
            raise FileError(path, f"[[surface]] {index + 1}: the name '{taken}' is taken by an earlier surface")
    top.close()
    try:
        return Scene(name=name, surfaces=surfaces, facets=facets, step=step)
    except ValueError as error:
        raise FileError(path, str(error)) from error


def _surface(table: Table, friction: float | None) -> Surface:
    kind = table.choice("shape", SHAPES)
    name = table.label("name", kind)
    friction = table.number("friction", friction, least=0.0)
    if friction is None:
        raise table.error("needs the key 'friction' (here or for the whole scene)")
    if kind == "plane":
        normal = np.array(table.vector("normal"))
        if not np.linalg.norm(normal) > 0:
            raise table.error("key 'normal' must not be zero")
        shape = Plane(np.array(table.vector("point")), normal)
    else:
        centre, radii = np.array(table.vector("centre")), np.array(table.vector("radii"))
        if np.any(radii <= 0):
            raise table.error(f"key 'radii' must be more than 0 m, not {radii.tolist()}")
        rows = table.take("rotation", as_rotation, "three rows of a rotation matrix", np.eye(3))
        shape = Ellipsoid(centre, np.array(rows), radii)
    table.close()
    try:
        return Surface(name, shape, friction)
    except ValueError as error:
        raise FileError(table.path, str(error)) from error
