"""One frame of the 3-D scene as pixels, painted by matplotlib."""

from typing import Any

import numpy as np

from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.view._extras import require
from icjax.view._frames import LONGEST, PALETTE, REACH, SEEN, Frames, framing, view_axis
from icjax.view._meshes import arrow_mesh, bone_mesh, ruled_lines
from icjax.view._objects import upward
from icjax.view._paint import Faces, camera_at, faces_of, paint
from icjax.view._scene_things import BUMP_COLOUR, light, round_down
from icjax.view._skeleton import bones
from icjax.view._solids import Solid
from icjax.view._stage import BODY_COLOUR, SPREAD
from icjax.view._style import INK
from icjax.view._surfaces import Bump, Shape, bump_mesh, patch_mesh

GROUND = (232, 228, 220)

FIELD = 0.5
"""Vertical field of view, rad."""

DISTANCE = 3.9
"""Of the camera, in scene sizes."""

WIDE = 0.3
"""Length of an arrow, in scene sizes, below which it gets no thinner."""

DOTS = 100
"""Dots per inch: a size in pixels over it is one in inches."""


class ScenePicture:
    """Draws the frames of a record, always from the same place: `draw(k)`.

    **Arguments**: `size` in pixels.
    """

    def __init__(
        self,
        record: Recording | Interaction | Rollout,
        shown: Frames,
        shapes: tuple[Shape, ...],
        size: tuple[int, int],
    ):
        self._shown, self._size = shown, size
        self._focus, self._scale = framing(record, shown)
        up, along = upward(record), view_axis(shown, upward(record))
        side = np.cross(up, along)
        away = -2.2 * side + 0.5 * along + 0.7 * up
        eye = self._focus + DISTANCE * self._scale * away / np.linalg.norm(away)
        self._camera = camera_at(eye, self._focus, up, FIELD)
        spread = SPREAD if shown.objects else 1.0
        patches = [
            (shape, patch_mesh(shape, self._focus, (1.15 * spread * self._scale, 0.7 * spread * self._scale), along))
            for shape in shapes
            if not isinstance(shape, Solid | Bump)
        ]
        self._plates = [faces_of(*mesh, GROUND) for _, mesh in patches]
        spacing = round_down(0.2 * self._scale)
        self._rulings = [ruled_lines(mesh[0], spacing) for _, mesh in patches]
        self._fixed = [
            faces_of(*((shape.vertices, shape.faces) if isinstance(shape, Solid) else bump_mesh(shape)), BUMP_COLOUR)
            for shape in shapes
            if isinstance(shape, Solid | Bump)
        ]
        self._bones = [(part.body, *bone_mesh(part, rings=5, sectors=20)) for part in bones(record.model)]
        canvas = require("matplotlib.backends.backend_agg").FigureCanvasAgg
        self._figure = require("matplotlib.figure").Figure(figsize=(size[0] / DOTS, size[1] / DOTS), dpi=DOTS)
        self._canvas: Any = canvas(self._figure)

    def draw(self, k: int, speed: float = 1.0) -> np.ndarray:
        """Pixels `[height, width, 3]` of one frame; `speed` is written beside the time where it is not one."""
        self._figure.clear()
        wide = self._size[0] / self._size[1]
        axis = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axis.set(xlim=(-wide, wide), ylim=(-1.0, 1.0))
        axis.set_axis_off()
        self._ground(axis)
        paint(axis, self._camera, [*self._fixed, *self._solids(k)], 3.0)
        paint(axis, self._camera, self._arrows(k), 4.0)
        words = f"{float(self._shown.time[k]):.2f} s" + (f"   {speed:g} × real time" if speed != 1.0 else "")
        axis.text(0.02, 0.97, words, transform=axis.transAxes, va="top", fontsize=10.0, color=INK, zorder=5.0)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _ground(self, axis: Any) -> None:
        """Planes and their ruling, behind everything that stands on them."""
        paint(axis, self._camera, self._plates, 1.0, flat=True)
        segments = require("matplotlib.collections").LineCollection
        for lines in self._rulings:
            places, _ = self._camera.project(lines)
            axis.add_collection(segments(places, colors="#96907A", linewidths=0.6, zorder=2.0))

    def _solids(self, k: int) -> list[Faces]:
        shown = self._shown
        parts = [
            faces_of(vertices @ shown.rotation[k, body].T + shown.position[k, body], faces, BODY_COLOUR)
            for body, vertices, faces in self._bones
        ]
        return parts + [
            faces_of(body.at(k, body.solid.vertices), body.solid.faces, light(body.colour)) for body in shown.objects
        ]

    def _arrows(self, k: int) -> list[Faces]:
        """Arrows over everything, so that none is hidden in a finger."""
        pairs, made = self._shown.pairs, []
        vertices, faces = arrow_mesh()
        for pair in range(pairs.force.shape[1]):
            force, point = pairs.force[k, pair], pairs.point[k, pair]
            size = float(np.linalg.norm(force))
            length = min(size * REACH * self._scale / self._shown.largest, LONGEST * self._scale)
            if length > SEEN * self._scale and np.isfinite(point).all():
                axis = force / size
                helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
                first = np.cross(helper, axis) / np.linalg.norm(np.cross(helper, axis))
                turn = np.stack([first, np.cross(axis, first), axis], axis=1)
                wide = max(length, WIDE * self._scale)
                thick = np.array([wide, wide, length])
                made.append(faces_of((thick * vertices) @ turn.T + point, faces, _whole(PALETTE[pairs.state[k, pair]])))
        return made


def _whole(colour: np.ndarray) -> tuple[int, int, int]:
    return (int(colour[0]), int(colour[1]), int(colour[2]))
