"""A record in three dimensions, played over time in the browser: viser's static export, one self-contained page."""

import contextlib
import io
from typing import Any, NamedTuple

import numpy as np

from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import SLIP_STATES, Rollout
from icjax.view._extras import require
from icjax.view._meshes import arrow_meshes, bone_mesh
from icjax.view._objects import Moving, moving, upward
from icjax.view._pairs import largest_force, pair_forces
from icjax.view._scene_things import add_objects, add_surfaces
from icjax.view._skeleton import body_poses, bones
from icjax.view._style import MEASURED, REFERENCE, SLIDING, STICKING, rgb
from icjax.view._surfaces import Shape, surfaces_of

BODY_COLOUR = (112, 138, 172)
MARKER_COLOUR = (40, 44, 52)
REACH, LONGEST = 0.5, 0.55
"""Length of the arrow of the largest force on the hand, and where larger ones on objects are cut, in scene sizes."""
SPREAD = 1.6
"""How much larger planes are drawn under objects, which move farther than the hand."""
SEGMENTS = 3
"""Segments, counted from the pads, at which a picture with objects looks: the fingers."""


class _Frames(NamedTuple):
    """What the scene shows, frame by frame (NumPy, world)."""

    time: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    ghost_rotation: np.ndarray | None
    ghost_position: np.ndarray | None
    force: np.ndarray
    point: np.ndarray
    colour: np.ndarray
    largest: float
    markers: np.ndarray | None
    objects: tuple[Moving, ...]


def export_scene(
    record: Recording | Interaction | Rollout,
    *,
    frames: int = 200,
    rate: float = 30.0,
    markers: bool = False,
    surfaces: tuple[Shape, ...] | None = None,
) -> str:
    """A page with the record in 3-D, a time bar and a play button, that opens from disk with no network.

    The body is drawn as capsules between body origins, translucent so that forces inside it show, the reference
    pose as a fainter ghost of the bodies that differ (a driven root never does), every contact force as an arrow
    from the contact point, coloured by its slip state in a rollout. Surfaces and objects come from a rollout's scene;
    with a measured record they are a level patch through the contact points. A server is opened on this machine only
    (127.0.0.1, a free port) while the page is made, and closed again.

    **Arguments**

    - `frames`: most frames kept; `rate`: most frames a second. Frames are picked, not averaged.
    - `markers`: draw the measured markers (a `Recording` only).
    - `surfaces`: draw these instead.

    **Returns**: the HTML text, about 0.9 MB, most of which is the viewer itself.

    **Errors**: `ValueError` where no frame has a pose; `ImportError` naming the extra where viser is absent.
    """
    viser = require("viser")
    shown = _pick(record, frames, rate, markers)
    shapes = surfaces_of(record) if surfaces is None else surfaces
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            return _record_scene(server, record, shown, shapes)
        finally:
            server.stop()


def _pick(record: Recording | Interaction | Rollout, frames: int, rate: float, markers: bool) -> _Frames:
    q = np.asarray(record.q, dtype=float)
    good = np.flatnonzero(np.isfinite(q).all(axis=1))
    if not len(good):
        raise ValueError(f"{record.name}: no frame has a pose, there is nothing to show")
    time = np.asarray(record.time, dtype=float)[good]
    count = int(np.clip((time[-1] - time[0]) * rate, 2, frames)) if len(good) > 1 else 1
    picks = good[np.unique(np.searchsorted(time, np.linspace(time[0], time[-1], count)))]
    rotation, position = body_poses(record.model, q[picks])
    ghost: tuple[np.ndarray | None, np.ndarray | None] = (None, None)
    if not isinstance(record, Recording):
        ghost = body_poses(record.model, np.asarray(record.reference, dtype=float)[picks])
    pairs = pair_forces(record, picks)
    palette = np.array([rgb(MEASURED), rgb(STICKING), rgb(SLIDING)])
    assert SLIP_STATES.index("sticking") == 1, "the palette follows SLIP_STATES"
    seen = None
    if markers and isinstance(record, Recording):
        seen = np.asarray(record.markers, dtype=float)[picks]
    return _Frames(
        time=np.asarray(record.time, dtype=float)[picks],
        rotation=rotation,
        position=position,
        ghost_rotation=ghost[0],
        ghost_position=ghost[1],
        force=pairs.force,
        point=pairs.point,
        colour=palette[pairs.state],
        largest=largest_force(pairs),
        markers=seen,
        objects=moving(record, picks),
    )


def _record_scene(server: Any, record: Recording | Interaction | Rollout, shown: _Frames, shapes: Any) -> str:
    focus, size = _framing(record, shown)
    up = upward(record)
    along = _view_axis(shown, up)
    server.scene.set_up_direction(tuple(up))
    server.scene.configure_default_lights(enabled=True, cast_shadow=False)
    side = np.cross(up, along)
    server.initial_camera.look_at = focus
    server.initial_camera.position = focus + size * (-2.2 * side + 0.5 * along + 0.8 * up)
    server.initial_camera.fov = 0.6
    server.initial_camera.near = 0.02 * size
    add_surfaces(server, shapes, focus, size, along, SPREAD if shown.objects else 1.0)
    nodes = _add_body(server, record, "body", BODY_COLOUR, 0.62)
    arrows = _Arrows(server, size, REACH * size / shown.largest, shown.colour)
    placed = add_objects(server, shown.objects)
    quaternions = _quaternions(shown.rotation)
    ghost_positions = shown.position if shown.ghost_position is None else shown.ghost_position
    ghost_quaternions = quaternions if shown.ghost_rotation is None else _quaternions(shown.ghost_rotation)

    gaps = np.abs(ghost_positions - shown.position).max(axis=2)
    if shown.ghost_rotation is not None:
        gaps = np.maximum(gaps, size * np.abs(shown.ghost_rotation - shown.rotation).max(axis=(2, 3)))
    apart = gaps.max(axis=1) > 0.005 * size
    differing = set(np.flatnonzero(gaps.max(axis=0) > 0.005 * size).tolist())
    ghosts = _add_body(server, record, "reference", rgb(REFERENCE), 0.25, differing)
    still = (np.ptp(shown.position, axis=0) == 0.0).all(axis=1) & (np.ptp(quaternions, axis=0) == 0.0).all(axis=1)
    moving = set(np.flatnonzero(~still).tolist())

    def place(k: int) -> None:
        for body, node in nodes.items():
            if k == 0 or body in moving:
                node.wxyz, node.position = quaternions[k, body], shown.position[k, body]
        for body, node in ghosts.items():
            node.visible = bool(apart[k])
            if apart[k]:
                node.wxyz, node.position = ghost_quaternions[k, body], ghost_positions[k, body]
        for body, node in zip(shown.objects, placed, strict=True):
            node.wxyz, node.position = _quaternions(body.rotation[k]), body.position[k]
        arrows.show(shown.point[k], shown.force[k], shown.colour[k])
        if shown.markers is not None:
            found = shown.markers[k][np.isfinite(shown.markers[k]).all(axis=1)]
            cloud = server.scene.add_point_cloud
            cloud("/markers", found, MARKER_COLOUR, point_size=0.025 * size, point_shape="circle", precision="float32")

    place(0)
    serializer = server.get_scene_serializer()
    for k in range(1, len(shown.time)):
        serializer.insert_sleep(float(shown.time[k] - shown.time[k - 1]))
        place(k)
    if len(shown.time) > 1:
        serializer.insert_sleep(float(shown.time[-1] - shown.time[-2]))
    return serializer.as_html()


class _Arrows:
    """Contact force arrows, one for each slot and colour, shown or hidden and stretched.

    Meshes that are moved and scaled: viser's own arrows change their arrays in place, which also changes the copy
    that a recording has already taken.
    """

    def __init__(self, server: Any, size: float, metres_per_newton: float, colours: np.ndarray):
        self.size, self.scale = size, metres_per_newton
        self.nodes: dict[tuple[int, tuple[int, int, int]], tuple[Any, Any, Any]] = {}
        shaft, head = arrow_meshes(0.01 * size, 0.024 * size, 0.06 * size)
        for slot in range(colours.shape[1]):
            for colour in sorted({_tuple(value) for value in colours[:, slot]}):
                path = "/force/{}-{:02x}{:02x}{:02x}".format(slot, *colour)
                self.nodes[slot, colour] = (
                    server.scene.add_frame(path, show_axes=False, visible=False),
                    server.scene.add_mesh_simple(f"{path}/shaft", *shaft, color=colour),
                    server.scene.add_mesh_simple(f"{path}/head", *head, color=colour),
                )

    def show(self, point: np.ndarray, force: np.ndarray, colour: np.ndarray) -> None:
        """Show the forces of one frame; a force too small to see is hidden."""
        for (slot, own), (node, shaft, head) in self.nodes.items():
            size = float(np.linalg.norm(force[slot]))
            length = min(size * self.scale, LONGEST * self.size)
            seen = length > 0.025 * self.size and bool(np.isfinite(point[slot]).all()) and _tuple(colour[slot]) == own
            node.visible = seen
            if seen:
                node.position, node.wxyz = point[slot], _from_z(force[slot] / size)
                shaft.scale = (1.0, 1.0, length)
                head.position = (0.0, 0.0, length)


def _from_z(direction: np.ndarray) -> np.ndarray:
    """Shortest rotation from +z to a unit vector, as a quaternion (w, x, y, z)."""
    if direction[2] < -1.0 + 1e-9:
        return np.array([0.0, 1.0, 0.0, 0.0])
    quaternion = np.array([1.0 + direction[2], -direction[1], direction[0], 0.0])
    return quaternion / np.linalg.norm(quaternion)


def _tuple(colour: np.ndarray) -> tuple[int, int, int]:
    return (int(colour[0]), int(colour[1]), int(colour[2]))


def _add_body(
    server: Any,
    record: Any,
    name: str,
    colour: tuple[int, int, int],
    opacity: float,
    chosen: set[int] | None = None,
) -> dict[int, Any]:
    """Capsules of the chosen bodies (all by default), one node a body."""
    nodes: dict[int, Any] = {}
    for index, bone in enumerate(bones(record.model)):
        if chosen is not None and bone.body not in chosen:
            continue
        path = f"/{name}/{record.model.body_names[bone.body].replace('/', '-')}"
        if bone.body not in nodes:
            nodes[bone.body] = server.scene.add_frame(path, show_axes=False)
        vertices, faces = bone_mesh(bone)
        server.scene.add_mesh_simple(
            f"{path}/{index}",
            vertices,
            faces,
            color=colour,
            opacity=None if opacity == 1.0 else opacity,
            cast_shadow=opacity == 1.0,
        )
    return nodes


def _framing(record: Any, shown: _Frames) -> tuple[np.ndarray, float]:
    """Point to look at and half the diagonal of the box that holds every body at all times.

    With objects, only the bodies near the pads, and the objects while they are near these.
    """
    parts = bones(record.model)
    if not parts:
        return np.zeros(3), 0.1
    fingers = _fingers(record.model) if shown.objects else set()
    points = _ends(shown, [part for part in parts if part.body in fingers] or parts)
    middle, size = _box(points)
    for body in shown.objects:
        near = np.flatnonzero(np.linalg.norm(body.position - middle, axis=1) < 1.5 * size)
        points = np.concatenate([points, *(body.at(k, body.solid.vertices) for k in near.tolist())])
    return _box(points)


def _ends(shown: _Frames, parts: Any) -> np.ndarray:
    """Both ends of every segment at all times `[n, 3]`."""
    points = []
    for part in parts:
        origin, turn = shown.position[:, part.body], shown.rotation[:, part.body]
        points += [origin + turn @ part.start, origin + turn @ part.end]
    return np.concatenate(points)


def _fingers(model: Any) -> set[int]:
    """The bodies that carry pads, and those that these hang on, up to the third."""
    found = body = set(model.pad_bodies)
    for _ in range(SEGMENTS - 1):
        body = {int(model.body_parents[number]) for number in body} - {-1, 0}
        found = found | body
    return {int(number) for number in found}


def _box(points: np.ndarray) -> tuple[np.ndarray, float]:
    low, high = points.min(axis=0), points.max(axis=0)
    return 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))


def _view_axis(shown: _Frames, up: np.ndarray) -> np.ndarray:
    """Horizontal direction from the first to the last body, seen from the side; x where they coincide."""
    reach = shown.position[0, -1] - shown.position[0, min(1, shown.position.shape[1] - 1)]
    reach = reach - up * (reach @ up)
    if np.linalg.norm(reach) < 1e-6:
        reach = np.eye(3)[int(np.argmin(np.abs(up)))]
        reach = reach - up * (reach @ up)
    return reach / np.linalg.norm(reach)


def _quaternions(rotation: np.ndarray) -> np.ndarray:
    return require("viser.transforms").SO3.from_matrix(rotation).wxyz
