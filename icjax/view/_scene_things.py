"""Surfaces and objects of the 3-D scene."""

from typing import Any

import numpy as np

from icjax.view._meshes import ruled_lines
from icjax.view._objects import Moving
from icjax.view._solids import Solid
from icjax.view._style import rgb
from icjax.view._surfaces import Bump, Shape, bump_mesh, patch_mesh

PLATE_COLOUR = (186, 176, 158)
BUMP_COLOUR = (166, 150, 122)
DARKER = 0.5
"""Brightness of the lines on a solid, as a part of its own."""
PALER = 0.45
"""Share of white in the colour of an object, whose lit faces would look black without it."""


def add_surfaces(
    server: Any,
    shapes: tuple[Shape, ...],
    focus: np.ndarray,
    size: float,
    along: np.ndarray,
    spread: float = 1.0,
    root: str = "",
) -> None:
    """Solids where they are, planes as ruled patches around the focus, larger by `spread` where things move about."""
    for index, shape in enumerate(shapes):
        if isinstance(shape, Bump):
            vertices, faces = bump_mesh(shape)
            server.scene.add_mesh_simple(f"{root}/surface/{index}", vertices, faces, color=BUMP_COLOUR, side="double")
            continue
        if isinstance(shape, Solid):
            _add_solid(server, f"{root}/surface/{index}", shape, BUMP_COLOUR)
            continue
        vertices, faces = patch_mesh(shape, focus, (1.15 * spread * size, 0.7 * spread * size), along)
        server.scene.add_mesh_simple(f"{root}/surface/{index}", vertices, faces, color=PLATE_COLOUR, side="double")
        lines = ruled_lines(vertices, round_down(0.2 * size)) + 0.002 * size * shape.normal
        server.scene.add_line_segments(
            f"{root}/surface/{index}/ruling", lines, (150, 140, 122), thickness=1.0, thickness_units="screen"
        )


def add_objects(server: Any, objects: tuple[Moving, ...], root: str = "") -> list[Any]:
    """A node an object, in its own frame."""
    nodes = []
    for number, body in enumerate(objects):
        nodes.append(server.scene.add_frame(f"{root}/object/{number}", show_axes=False))
        _add_solid(server, f"{root}/object/{number}/body", body.solid, light(body.colour))
    return nodes


def _add_solid(server: Any, path: str, shape: Solid, colour: tuple[int, int, int]) -> None:
    server.scene.add_mesh_simple(path, shape.vertices, shape.faces, color=colour, flat_shading=shape.flat)
    dark = tuple(int(DARKER * part) for part in colour)
    server.scene.add_line_segments(f"{path}/lines", shape.lines, dark, thickness=1.5, thickness_units="screen")


def light(colour: str) -> tuple[int, int, int]:
    """Colour of the faces of an object."""
    red, green, blue = (int(round((1.0 - PALER) * part + PALER * 255)) for part in rgb(colour))
    return red, green, blue


def round_down(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed `value`."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step for step in (1.0, 2.0, 5.0) if step * power <= value * (1 + 1e-9)) * power)
