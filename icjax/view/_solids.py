"""Solids for pictures: triangles and lines of the shapes of a scene, from the words and numbers of a rollout."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

SHARP = 0.5
"""rad; where faces meet at a larger angle there is an edge to draw."""

ABOVE = 1.003
"""Lines are drawn on a solid this much larger, so that its faces do not hide them."""


class Solid(NamedTuple):
    """A solid or ground: vertices `[n, 3]` (m), faces `[m, 3]` of vertices, counter-clockwise from outside.

    `lines` `[k, 2, 3]` are its edges; on round solids, circles that show how it turns. `flat`: the faces are not parts
    of a curved surface. `convex`; `ground`: it has an upper side only.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    lines: np.ndarray
    flat: bool
    friction: float | None = None
    convex: bool = True
    ground: bool = False


def parts_of(entry: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """What a description is made of: the parts of a union, everything else itself."""
    if entry.get("shape") != "union":
        return [entry]
    return [found for part in entry.get("parts", ()) for found in parts_of(part)]


def solid(entry: Mapping[str, Any], name: str, friction: float | None = None) -> Solid | None:
    """A solid where `position` and `rotation` of its description place it, None for a shape that is no solid."""
    mesh, circles = _mesh(entry)
    if mesh is None:
        return None
    kind = entry["shape"]
    vertices, faces = np.array(mesh.vertices, float), np.array(mesh.faces)
    edges = vertices[mesh.face_adjacency_edges[mesh.face_adjacency_angles > SHARP]]
    if kind == "heightfield":
        edges = _ruling(vertices.reshape(*np.shape(entry["heights"]), 3))
    middle = vertices.mean(axis=0)
    rings = [_section_lines(vertices, faces, middle, np.eye(3)[axis]) for axis in circles]
    lines = middle + ABOVE * (np.concatenate([edges, *rings]) - middle)
    place = np.asarray(entry.get("centre", entry.get("position", np.zeros(3))), float)
    turn = np.asarray(entry.get("rotation", np.eye(3)), float).reshape(3, 3)
    flat, ground = kind in ("box", "prism", "cylinder", "heightfield"), kind == "heightfield"
    convex = kind not in ("mesh", "heightfield")
    return Solid(name, vertices @ turn.T + place, faces, lines @ turn.T + place, flat, friction, convex, ground)


def _mesh(entry: Mapping[str, Any]) -> tuple[Any, tuple[int, ...]]:
    """Triangles of a shape in its own frame, and the axes across which a circle is drawn on it."""
    from trimesh import Trimesh, creation

    kind = entry.get("shape")
    if kind == "box":
        return creation.box(2.0 * np.asarray(entry["half_sizes"], float)), ()
    if kind == "sphere":
        return creation.icosphere(subdivisions=3, radius=float(entry["radius"])), (0, 1, 2)
    if kind == "ellipsoid":
        ball = creation.icosphere(subdivisions=3)
        return Trimesh(ball.vertices * np.asarray(entry["radii"], float), ball.faces, process=False), (0, 1, 2)
    if kind in ("capsule", "cylinder"):
        radius, height = float(entry["radius"]), 2.0 * float(entry["half_length"])
        if kind == "cylinder":
            return creation.cylinder(radius=radius, height=height, sections=64), (0, 1)
        return creation.capsule(radius=radius, height=height, count=(24, 32)), (0, 1)
    if kind == "prism":
        outline, half = np.asarray(entry["outline"], float), float(entry["half_length"])
        ends = [np.column_stack([outline, np.full(len(outline), z)]) for z in (-half, half)]
        return Trimesh(np.concatenate(ends)).convex_hull, ()
    if kind == "mesh":
        return Trimesh(np.asarray(entry["vertices"], float), np.asarray(entry["faces"], int), process=False), ()
    if kind == "heightfield":
        return Trimesh(*_ground(np.asarray(entry["heights"], float), entry["spacing"]), process=False), ()
    return None, ()


def _ground(heights: np.ndarray, spacing: Any) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a heightfield."""
    x, y = (step * (np.arange(n) - (n - 1) / 2) for step, n in zip(spacing, heights.shape, strict=True))
    vertices = np.stack([*np.meshgrid(x, y, indexing="ij"), heights], axis=-1).reshape(-1, 3)
    rows, columns = heights.shape
    i, j = (part.reshape(-1) for part in np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij"))
    a = columns * i + j
    c = a + columns + 1
    return vertices, np.concatenate([np.stack([a, c - 1, c], axis=1), np.stack([a, c, a + 1], axis=1)])


def _ruling(nodes: np.ndarray) -> np.ndarray:
    """Lines along both directions of a grid of nodes, as pieces `[k, 2, 3]`, some thirty a direction at most."""
    pieces = []
    for rows in (nodes, nodes.swapaxes(0, 1)):
        rows = rows[:: max(1, len(rows) // 30)]
        pieces.append(np.stack([rows[:, :-1], rows[:, 1:]], axis=2).reshape(-1, 2, 3))
    return np.concatenate(pieces)


def _section_points(vertices: np.ndarray, faces: np.ndarray, point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Where the edges of the faces `[m]` cross a plane: `[m, 3 edges, 3]`, NaN where they do not."""
    offset = (vertices - point) @ normal
    offset = np.where(np.abs(offset) < 1e-9 * np.abs(offset).max(), 0.0, offset)
    start, end = faces, np.roll(faces, -1, axis=1)
    a, b = offset[start], offset[end]
    crossed = (a >= 0) != (b >= 0)
    part = np.where(crossed, a / np.where(crossed, a - b, 1.0), np.nan)
    return vertices[start] + part[..., None] * (vertices[end] - vertices[start])


def _section_lines(vertices: np.ndarray, faces: np.ndarray, point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The line in which a plane cuts the surface, as pieces `[k, 2, 3]`."""
    crossings = _section_points(vertices, faces, point, normal)
    cut = np.isfinite(crossings[..., 0]).sum(axis=1) == 2
    return crossings[cut][np.isfinite(crossings[cut][..., 0])].reshape(-1, 2, 3)


def section(body: Solid, point: np.ndarray, along: np.ndarray, up: np.ndarray) -> np.ndarray | None:
    """Outline `[n, 3]` (m) in which the plane through `point` along both directions cuts a solid; None if it misses."""
    crossings = _section_points(body.vertices, body.faces, point, np.cross(along, up)).reshape(-1, 3)
    crossings = crossings[np.isfinite(crossings[:, 0])]
    order = _hull(np.stack([crossings @ along, crossings @ up], axis=1))
    return crossings[order] if len(order) else None


def outlines(body: Solid, point: np.ndarray, along: np.ndarray, up: np.ndarray) -> list[np.ndarray]:
    """Like `section`, of any solid: all rings in which the plane cuts it."""
    if body.convex:
        found = section(body, point, along, up)
        return [] if found is None else [found]
    pieces = _section_lines(body.vertices, body.faces, point, np.cross(along, up))
    size = 1e-9 * float(np.ptp(body.vertices, axis=0).max())
    _, number = np.unique(np.round(pieces.reshape(-1, 3) / size), axis=0, return_inverse=True)
    at: dict[int, list[int]] = {}
    for end, place in enumerate(number.reshape(-1).tolist()):
        at.setdefault(place, []).append(end)
    ends, places, left, rings = pieces.reshape(-1, 3), number.reshape(-1), set(range(len(pieces))), []
    while left:
        end, ring = 2 * left.pop(), []
        while True:
            ring.append(ends[end])
            end = end ^ 1  # along the piece
            following = [other for other in at[int(places[end])] if other // 2 in left]
            if not following:
                break
            end = following[0]
            left.remove(end // 2)
        if len(ring) > 2:
            rings.append(np.array(ring))
    return rings


def ground_height(
    body: Solid, origin: np.ndarray, along: np.ndarray, up: np.ndarray, distance: np.ndarray
) -> np.ndarray:
    """Height of ground (m, along `up` from `origin`) at distances along a line; minus infinity where it has ended."""
    pieces = _section_lines(body.vertices, body.faces, origin, np.cross(along, up)) - origin
    height = np.full(distance.shape, -np.inf)
    for start, end in np.stack([pieces @ along, pieces @ up], axis=2):
        (a, low), (b, high) = sorted([tuple(start), tuple(end)])
        under = (distance >= a) & (distance <= b)
        part = (distance[under] - a) / (b - a) if b > a else np.ones(under.sum())
        height[under] = np.maximum(height[under], low + part * (high - low))
    return height


def silhouette(points: np.ndarray) -> np.ndarray:
    """Outline `[n, 2]` of a solid, or of its hull, from its vertices in the plane of a picture, closed."""
    order = _hull(points)
    return points[np.append(order, order[:1])]


def _hull(points: np.ndarray) -> np.ndarray:
    """Numbers of the points `[n, 2]` on their convex hull, in order; none where they lie on one line."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return ConvexHull(points).vertices
    except (QhullError, ValueError):
        return np.zeros(0, int)
