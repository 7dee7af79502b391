"""Surfaces for pictures: read from a rollout's scene, or guessed from where the contacts were."""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.view._skeleton import up_direction
from icjax.view._solids import Solid, ground_height, outlines, parts_of, solid
from icjax.view._style import RIM, SURFACE


class Patch(NamedTuple):
    """A plane, drawn near the contacts."""

    name: str
    point: np.ndarray
    normal: np.ndarray
    friction: float | None


class Bump(NamedTuple):
    """An ellipsoid, axes in the columns of `rotation`."""

    name: str
    centre: np.ndarray
    rotation: np.ndarray
    radii: np.ndarray
    friction: float | None


Shape = Patch | Bump | Solid


def scene_content(scene: str) -> Mapping[str, Any]:
    """What the JSON text of `Rollout.scene` says; nothing where it is none."""
    try:
        content = json.loads(scene) if scene else {}
    except json.JSONDecodeError:
        return {}
    return content if isinstance(content, Mapping) else {}


def scene_name(rollout: Rollout) -> str:
    """What a rollout is called in pictures: the name of its scene, or its own where the scene has none."""
    name = scene_content(rollout.scene).get("name")
    return str(name) if name else rollout.name


def scene_surfaces(scene: str) -> tuple[Shape, ...]:
    """Surfaces in the JSON text of `Rollout.scene`.

    An entry with `radii` and `centre` is an ellipsoid, one with `point` and `normal` a plane, one whose `shape` names a
    solid that solid; other entries are not drawn. **Returns**: shapes in their order, empty where the text names none.
    """
    content = scene_content(scene)
    entries = content.get("surfaces", ())
    if isinstance(entries, Mapping):
        entries = [{"name": name, **entry} for name, entry in entries.items()]
    shapes: list[Shape] = []
    for index, entry in enumerate(entries):
        own = {key: entry[key] for key in ("name", "friction") if key in entry}
        for part in parts_of(entry):
            shape = _shape({**part, **own}, f"surface {index}", content.get("friction"))
            if shape is not None:
                shapes.append(shape)
    return tuple(shapes)


def _shape(entry: Mapping[str, Any], fallback: str, friction: Any) -> Shape | None:
    name = str(entry.get("name", fallback))
    own = entry.get("friction", friction)
    own = float(own) if isinstance(own, int | float) else None
    inner = next((entry[key] for key in ("shape", "surface", "geometry") if isinstance(entry.get(key), Mapping)), {})
    values = {**entry, **inner}
    if "radii" in values and ("centre" in values or "center" in values):
        centre = np.asarray(values.get("centre", values.get("center")), dtype=float)
        rotation = np.asarray(values.get("rotation", np.eye(3)), dtype=float).reshape(3, 3)
        return Bump(name, centre, rotation, np.asarray(values["radii"], dtype=float), own)
    if "point" in values and "normal" in values:
        normal = np.asarray(values["normal"], dtype=float)
        return Patch(name, np.asarray(values["point"], dtype=float), normal / np.linalg.norm(normal), own)
    return solid(values, name, own)


def touched_plane(record: Recording | Interaction) -> tuple[Shape, ...]:
    """A level patch through the measured contact points, or nothing where nothing was touched.

    Measured records do not say what the surface was; the patch is a guess for the picture and named so.
    """
    points = np.asarray(record.contact_point, dtype=float).reshape(-1, 3)
    forces = np.linalg.norm(np.nan_to_num(np.asarray(record.contact_force, dtype=float)), axis=-1).reshape(-1)
    used = np.isfinite(points).all(axis=1) & (forces > 0.1 * forces.max(initial=0.0)) & (forces > 0)
    if not used.any():
        return ()
    return (
        Patch("plane through the contact points", np.median(points[used], axis=0), up_direction(record.model), None),
    )


def surfaces_of(record: Recording | Interaction | Rollout) -> tuple[Shape, ...]:
    """The surfaces to draw with a record."""
    return scene_surfaces(record.scene) if isinstance(record, Rollout) else touched_plane(record)


def patch_mesh(
    patch: Patch, centre: np.ndarray, half_size: tuple[float, float], along: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rectangle of a plane: vertices `[4, 3]`, faces `[2, 3]`, around the point of the plane nearest `centre`."""
    first = along - patch.normal * (along @ patch.normal)
    first = first / np.linalg.norm(first)
    second = np.cross(patch.normal, first)
    middle = centre - patch.normal * ((centre - patch.point) @ patch.normal)
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    vertices = np.array([middle + a * half_size[0] * first + b * half_size[1] * second for a, b in corners])
    return vertices, np.array([[0, 1, 2], [0, 2, 3]])


def bump_mesh(bump: Bump, rings: int = 24, sectors: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of an ellipsoid: vertices `[n, 3]`, faces `[m, 3]`."""
    polar = np.linspace(0.0, np.pi, rings + 1)[:, None]
    turn = np.linspace(0.0, 2.0 * np.pi, sectors, endpoint=False)[None, :]
    unit = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar) * np.ones_like(turn)], axis=-1
    ).reshape(-1, 3)
    return bump.centre + (unit * bump.radii) @ bump.rotation.T, grid_faces(rings + 1, sectors)


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Faces of a grid of vertices that closes on itself along the columns."""
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij")
    a = row * columns + column
    b = row * columns + (column + 1) % columns
    faces = np.stack([np.stack([a, a + columns, b], -1), np.stack([b, a + columns, b + columns], -1)], 2)
    return faces.reshape(-1, 3)


def profile(
    shapes: tuple[Shape, ...], origin: np.ndarray, along: np.ndarray, up: np.ndarray, distance: np.ndarray
) -> np.ndarray:
    """Height of the highest plane, ellipsoid or ground (m, along `up` from `origin`) along a line; NaN where none.

    The cut is in the plane through `origin` spanned by `along` and `up`.
    """
    height = np.full(distance.shape, -np.inf)
    for shape in shapes:
        if isinstance(shape, Solid):
            if shape.ground:
                height = np.maximum(height, ground_height(shape, origin, along, up, distance))
            continue
        base = origin + distance[:, None] * along
        if isinstance(shape, Patch):
            slope = shape.normal @ up
            if abs(slope) > 1e-9:
                height = np.maximum(height, (shape.point - base) @ shape.normal / slope)
            continue
        scaled = (base - shape.centre) @ shape.rotation / shape.radii
        ray = up @ shape.rotation / shape.radii
        a, b, c = ray @ ray, scaled @ ray, np.sum(scaled * scaled, axis=-1) - 1.0
        inside = b * b - a * c
        top = (-b + np.sqrt(np.maximum(inside, 0.0))) / a
        height = np.maximum(height, np.where(inside >= 0, top, -np.inf))
    return np.where(np.isfinite(height), height, np.nan)


def draw_ground(
    axis: Any,
    shapes: tuple[Shape, ...],
    origin: np.ndarray,
    along: np.ndarray,
    up: np.ndarray,
    reach: np.ndarray,
    floor: float,
    width: float,
) -> None:
    """Fill a side view (mm) with surfaces, cut in its plane: the highest plane or ellipsoid, and the solids.

    **Arguments**: `reach` distances and `floor` height that bound it, m; `width` of its outline.
    """
    height = profile(shapes, origin, along, up, reach)
    cuts = sections(shapes, origin, along, up)
    axis.fill_between(1e3 * reach, 1e3 * floor, 1e3 * height, color=SURFACE, lw=0, zorder=1.0)
    axis.plot(1e3 * reach, 1e3 * height, color=RIM, lw=width, zorder=1.1)
    for cut in cuts:
        axis.fill(*(1e3 * cut.T), facecolor=SURFACE, edgecolor=RIM, lw=width, zorder=1.2)
    if cuts:  # what of them lies below the ground is not seen
        axis.fill_between(1e3 * reach, 1e3 * floor, 1e3 * height, color=SURFACE, lw=0, zorder=1.3)


def sections(shapes: tuple[Shape, ...], origin: np.ndarray, along: np.ndarray, up: np.ndarray) -> list[np.ndarray]:
    """Outlines `[n, 2]` (m, along both directions from `origin`) of the solids that the plane of a side view cuts."""
    solids = [shape for shape in shapes if isinstance(shape, Solid) and not shape.ground]
    cuts = [cut for shape in solids for cut in outlines(shape, origin, along, up)]
    return [np.stack([(cut - origin) @ along, (cut - origin) @ up], axis=1) for cut in cuts]
