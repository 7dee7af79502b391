"""A record on a viser server: nodes made once, placed frame by frame."""

from typing import Any

import numpy as np

from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.view._arrows import Arrows, Cones
from icjax.view._extras import require
from icjax.view._frames import Frames, framing, view_axis
from icjax.view._meshes import bone_mesh
from icjax.view._objects import upward
from icjax.view._scene_things import add_objects, add_surfaces
from icjax.view._skeleton import bones
from icjax.view._style import REFERENCE, rgb
from icjax.view._surfaces import Shape

BODY_COLOUR = (112, 138, 172)
MARKER_COLOUR = (40, 44, 52)
SPREAD = 1.6
"""How much larger planes are drawn under objects, which move farther than the hand."""

APART = 0.005
"""Of the scene size; a reference pose that is nearer is not drawn beside the body."""


class Stage:
    """Body, reference pose, objects, surfaces and forces of a record.

    **Arguments**: `server` of viser, on which nothing else stands; `shown` its frames; `shapes` its surfaces; `cones`
    whether friction cones are made (hidden, `stage.cones.root.visible` shows them); `close` as for `framing`; `root`
    goes before the path of every node: a browser may mistake a node for an earlier one of its name.
    """

    def __init__(
        self,
        server: Any,
        record: Recording | Interaction | Rollout,
        shown: Frames,
        shapes: tuple[Shape, ...],
        cones: bool = False,
        close: bool | None = None,
        root: str = "",
    ):
        self.server, self.shown, self._root = server, shown, root
        self.focus, self.size = framing(record, shown, close)
        self.up = upward(record)
        self.along = view_axis(shown, self.up)
        server.scene.set_up_direction(tuple(self.up))
        server.scene.configure_default_lights(enabled=True, cast_shadow=False)
        spread = SPREAD if close or shown.objects else 1.0
        add_surfaces(server, shapes, self.focus, self.size, self.along, spread, root)
        self._bodies = _add_body(server, record, f"{root}/body", BODY_COLOUR, 0.62)
        self.arrows = Arrows(server, self.size, shown, root)
        self.cones = Cones(server, self.size, shown, root) if cones else None
        self._objects = add_objects(server, shown.objects, root)
        self._quaternions = _quaternions(shown.rotation)
        self._add_reference(record)
        ranges = np.ptp(shown.position, axis=0), np.ptp(self._quaternions, axis=0)
        self._moving = set(np.flatnonzero(~((ranges[0] == 0.0).all(axis=1) & (ranges[1] == 0.0).all(axis=1))).tolist())
        self._placed = False

    def look(self, distance: float = 1.0) -> None:
        """Where the camera of a page that is opened stands: beside the finger, a little above."""
        side, camera = np.cross(self.up, self.along), self.server.initial_camera
        away = distance * self.size
        camera.look_at = self.focus
        camera.position = self.focus + away * (-2.2 * side + 0.5 * self.along + 0.8 * self.up)
        camera.fov = 0.6
        camera.near = 0.02 * self.size

    def place(self, k: int) -> None:
        """Show one frame."""
        shown = self.shown
        for body, node in self._bodies.items():
            if not self._placed or body in self._moving:
                node.wxyz, node.position = self._quaternions[k, body], shown.position[k, body]
        for body, node in self._ghosts.items():
            node.visible = bool(self._apart[k])
            if self._apart[k]:
                node.wxyz, node.position = self._ghost_quaternions[k, body], self._ghost_positions[k, body]
        for item, node in zip(shown.objects, self._objects, strict=True):
            node.wxyz, node.position = _quaternions(item.rotation[k]), item.position[k]
        self.arrows.place(k)
        if self.cones is not None:
            self.cones.place(k)
        if shown.markers is not None:
            found = shown.markers[k][np.isfinite(shown.markers[k]).all(axis=1)]
            cloud = self.server.scene.add_point_cloud
            cloud(f"{self._root}/markers", found, MARKER_COLOUR, point_size=0.025 * self.size, point_shape="circle",
                  precision="float32")  # fmt: skip
        self._placed = True

    def _add_reference(self, record: Recording | Interaction | Rollout) -> None:
        """The bodies whose reference pose differs, as fainter ghosts."""
        shown = self.shown
        self.reference = self.server.scene.add_frame(f"{self._root}/reference", show_axes=False)
        self._ghost_positions = shown.position if shown.ghost_position is None else shown.ghost_position
        turned = shown.rotation if shown.ghost_rotation is None else shown.ghost_rotation
        self._ghost_quaternions = self._quaternions if turned is shown.rotation else _quaternions(turned)
        gaps = np.abs(self._ghost_positions - shown.position).max(axis=2)
        gaps = np.maximum(gaps, self.size * np.abs(turned - shown.rotation).max(axis=(2, 3)))
        self._apart = gaps.max(axis=1) > APART * self.size
        differing = set(np.flatnonzero(gaps.max(axis=0) > APART * self.size).tolist())
        self._ghosts = _add_body(self.server, record, f"{self._root}/reference", rgb(REFERENCE), 0.25, differing)


def _add_body(
    server: Any,
    record: Any,
    under: str,
    colour: tuple[int, int, int],
    opacity: float,
    chosen: set[int] | None = None,
) -> dict[int, Any]:
    """Capsules of the chosen bodies (all by default), one node a body."""
    nodes: dict[int, Any] = {}
    for index, bone in enumerate(bones(record.model)):
        if chosen is not None and bone.body not in chosen:
            continue
        path = f"{under}/{record.model.body_names[bone.body].replace('/', '-')}"
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


def _quaternions(rotation: np.ndarray) -> np.ndarray:
    return require("viser.transforms").SO3.from_matrix(rotation).wxyz
