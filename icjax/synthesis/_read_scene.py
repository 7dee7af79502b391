"""Scenes from TOML files."""

import os
from pathlib import Path
from typing import Any

from icjax.files import FileError, Table, as_numbers, read_toml
from icjax.synthesis._object import Object
from icjax.synthesis._read_shape import read_object_shape, read_pose, read_surface_shape
from icjax.synthesis._scene import PairFriction, Scene
from icjax.synthesis._surface import Surface


def read_scene(path: str | os.PathLike) -> Scene:
    """Read a scene file.

        name = "bump"                # default: the name of the file
        step = 0.002                 # time step, s (default)
        facets = 4                   # tangent pairs of the friction cone (default)
        friction = 0.9               # of surfaces and objects that state none
        gravity = [0, 0, -9.81]      # on objects, m/s2 (default)
        contacts = 10                # room for so many at once; default: all that are possible
        limits = 4                   # room for so many joint limits (default)
        [[surface]]                  # fixed in the world
        name = "plate"
        shape = "plane"
        point = [0.0, 0.0, 0.0]      # m
        normal = [0.0, 0.0, 1.0]     # outward
        [[surface]]
        name = "bump"
        shape = "ellipsoid"
        position = [0.0, 0.0, 0.0]   # m
        radii = [0.012, 0.035, 0.003]
        rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]   # columns: axes in world (default); or quaternion = [w, x, y, z]
        friction = 0.5
        [[object]]                   # free to move
        name = "cup"
        shape = "cylinder"
        radius = 0.03                # m
        half_length = 0.05
        mass = 0.2                   # kg; or density, kg/m3
        position = [0.1, 0.0, 0.05]
        [[pair]]                     # friction of two things, by their names
        names = ["fingertip", "cup"]
        friction = 1.1

    All shapes, their sizes and every key of an object: the guide *The scene file*. That pads exist, and that contact of
    every pair of shapes can be found, is known only with a model: [`slot_names`] tells.

    **Errors**: `FileError`, one line naming the file, the table and the key.
    """
    path = Path(path)
    top = Table(path, "", read_toml(path))
    name = top.label("name", path.stem)
    step = top.number("step", 0.002, above=0.0)
    facets = top.whole("facets", 4, least=2)
    friction = top.number("friction", None, least=0.0)
    contacts, limits = top.whole("contacts", None, least=1), top.whole("limits", 4)
    gravity = top.vector("gravity", (0.0, 0.0, -9.81))
    names: list[str] = []
    surfaces = tuple(_surface(table, friction, names) for table in top.tables("surface"))
    objects = tuple(_object(table, friction, names) for table in top.tables("object"))
    if not names:
        raise FileError(path, "needs at least one [[surface]] or [[object]] table")
    pairs: list[PairFriction] = []
    for table in top.tables("pair"):
        pairs.append(_pair(table, pairs))
    top.close()
    try:
        return Scene(name, surfaces, facets, step, objects, gravity, tuple(pairs), contacts, limits)
    except ValueError as error:
        raise FileError(path, str(error)) from error


def _surface(table: Table, friction: float | None, names: list[str]) -> Surface:
    kind, shape = read_surface_shape(table)
    name = _name(table, kind, names)
    friction = _friction(table, friction)
    table.close()
    try:
        return Surface(name, shape, friction)
    except ValueError as error:
        raise FileError(table.path, str(error)) from error


def _object(table: Table, friction: float | None, names: list[str]) -> Object:
    kind, shape = read_object_shape(table)
    name = _name(table, kind, names)
    friction = _friction(table, friction)
    given = {key: table.number(key, None, above=0.0) for key in ("mass", "density")}
    if all(value is not None for value in given.values()):
        raise table.error("has both 'mass' and 'density'; give one")
    if all(value is None for value in given.values()):
        raise table.error("needs the key 'mass' (kg) or 'density' (kg/m3)")
    inertia = table.take("inertia", _as_rows, "three rows of three numbers, kg m2", None)
    com, pose = table.vector("com", None), read_pose(table)
    still = (0.0, 0.0, 0.0)
    velocity, turning = table.vector("velocity", still), table.vector("angular_velocity", still)
    table.close()
    try:
        return Object(
            name,
            shape,
            friction,
            com=com,
            inertia=inertia,
            pose=pose,
            velocity=velocity,
            angular_velocity=turning,
            **given,
        )
    except ValueError as error:
        raise FileError(table.path, str(error)) from error


def _name(table: Table, kind: str, names: list[str]) -> str:
    """The name of a thing, added to those that are taken."""
    name = table.label("name", kind)
    if name in names:
        raise table.error(f"the name '{name}' is taken by an earlier surface or object")
    names.append(name)
    return name


def _friction(table: Table, friction: float | None) -> float:
    friction = table.number("friction", friction, least=0.0)
    if friction is None:
        raise table.error("needs the key 'friction' (here or for the whole scene)")
    return friction


def _pair(table: Table, earlier: list[PairFriction]) -> PairFriction:
    """Friction of two things; any may be a pad: the file does not know the model."""
    names, friction = table.texts("names"), table.number("friction", least=0.0)
    table.close()
    if len(names) != 2:
        raise table.error(f"key 'names' must be two names, not {list(names)}")
    if any(set(names) == set(pair.names) for pair in earlier):
        raise table.error(f"the friction of '{names[0]}' and '{names[1]}' is stated by an earlier pair")
    try:
        return PairFriction(names, friction)
    except ValueError as error:
        raise table.error(str(error)) from error


def _as_rows(value: Any) -> tuple[tuple[float, ...], ...]:
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError
    return tuple(as_numbers(row, 3) for row in value)
