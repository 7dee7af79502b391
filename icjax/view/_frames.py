"""What a picture in three dimensions shows, frame by frame, and from where it is looked at."""

from typing import Any, NamedTuple

import numpy as np

from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import SLIP_STATES, Rollout
from icjax.view._objects import Moving, moving
from icjax.view._pairs import Pairs, largest_force, pair_forces
from icjax.view._skeleton import body_poses, bones
from icjax.view._style import MEASURED, SLIDING, STICKING, rgb

SEGMENTS = 3
"""Segments, counted from the pads, at which a picture with objects looks: the fingers."""

REACH, LONGEST = 0.5, 0.55
"""Length of the arrow of the largest force on the hand, and where larger ones on objects are cut, in scene sizes."""

SEEN = 0.025
"""Shortest arrow that is drawn, in scene sizes."""

PALETTE = np.array([rgb(MEASURED), rgb(STICKING), rgb(SLIDING)])
"""Colours of forces by the number of their slip state."""

assert SLIP_STATES.index("sticking") == 1, "the palette follows SLIP_STATES"


class Frames(NamedTuple):
    """What is shown at some times (NumPy, world): body poses, those of the reference, forces, markers, objects.

    `largest` is the force of the longest arrow, N; `ghost_*` and `markers` are None where there are none.
    """

    time: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    ghost_rotation: np.ndarray | None
    ghost_position: np.ndarray | None
    pairs: Pairs
    largest: float
    markers: np.ndarray | None
    objects: tuple[Moving, ...]

    @property
    def colour(self) -> np.ndarray:
        """Colour of every force `[time, pair, 3]`, by its slip state."""
        return PALETTE[self.pairs.state]


def pick_frames(record: Recording | Interaction | Rollout, frames: int, rate: float, markers: bool = False) -> Frames:
    """Frames of a record that have a pose, at most so many and at most so many a second; picked, not averaged.

    **Errors**: `ValueError` where no frame has a pose.
    """
    q = np.asarray(record.q, dtype=float)
    good = np.flatnonzero(np.isfinite(q).all(axis=1))
    if not len(good):
        raise ValueError(f"{record.name}: no frame has a pose, there is nothing to show")
    time = np.asarray(record.time, dtype=float)[good]
    count = int(np.clip((time[-1] - time[0]) * rate, 2, frames)) if len(good) > 1 else 1
    return frames_at(record, good[np.unique(np.searchsorted(time, np.linspace(time[0], time[-1], count)))], markers)


def frames_at(record: Recording | Interaction | Rollout, rows: np.ndarray, markers: bool = False) -> Frames:
    """The frames in the given rows of a record."""
    rotation, position = body_poses(record.model, np.asarray(record.q, dtype=float)[rows])
    ghost: tuple[np.ndarray | None, np.ndarray | None] = (None, None)
    if not isinstance(record, Recording):
        ghost = body_poses(record.model, np.asarray(record.reference, dtype=float)[rows])
    pairs = pair_forces(record, rows)
    seen = None
    if markers and isinstance(record, Recording):
        seen = np.asarray(record.markers, dtype=float)[rows]
    return Frames(
        time=np.asarray(record.time, dtype=float)[rows],
        rotation=rotation,
        position=position,
        ghost_rotation=ghost[0],
        ghost_position=ghost[1],
        pairs=pairs,
        largest=largest_force(pairs),
        markers=seen,
        objects=moving(record, rows),
    )


def framing(record: Any, shown: Frames, close: bool | None = None) -> tuple[np.ndarray, float]:
    """Point to look at and half the diagonal of the box that holds every body at all times.

    From close by, which is the default with objects, only the bodies near the pads, and the objects while they are
    near these.
    """
    parts = bones(record.model)
    if not parts:
        return np.zeros(3), 0.1
    close = bool(shown.objects) if close is None else close
    fingers = _fingers(record.model) if close else set()
    points = _ends(shown, [part for part in parts if part.body in fingers] or parts)
    middle, size = _box(points)
    for body in shown.objects:
        near = np.flatnonzero(np.linalg.norm(body.position - middle, axis=1) < 1.5 * size)
        points = np.concatenate([points, *(body.at(k, body.solid.vertices) for k in near.tolist())])
    return _box(points)


def view_axis(shown: Frames, up: np.ndarray) -> np.ndarray:
    """Horizontal direction from the first to the last body, seen from the side; x where they coincide."""
    reach = shown.position[0, -1] - shown.position[0, min(1, shown.position.shape[1] - 1)]
    reach = reach - up * (reach @ up)
    if np.linalg.norm(reach) < 1e-6:
        reach = np.eye(3)[int(np.argmin(np.abs(up)))]
        reach = reach - up * (reach @ up)
    return reach / np.linalg.norm(reach)


def _ends(shown: Frames, parts: Any) -> np.ndarray:
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
