"""One picture of a finger on a surface: poses over time seen from the side, with the contact forces."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.view._force_plots import force_components
from icjax.view._objects import Moving, moving, upward
from icjax.view._pairs import largest_force, pair_forces
from icjax.view._skeleton import Bone, body_poses, bones, pad_path
from icjax.view._solids import silhouette
from icjax.view._style import (
    INK,
    MEASURED,
    QUIET,
    REFERENCE,
    SLIDING,
    STICKING,
    legend_above,
    new_figure,
    save,
    styled,
)
from icjax.view._surfaces import draw_ground, profile, sections, surfaces_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SKIN = "#C9D3E0"
EDGE = "#5F7186"
WIDE = 2.35
"""Width over height of the side view, at least."""
PAUSE = 0.1
"""s; what is touched again sooner has not been left."""
BESIDE = 100.0
"""mm beside the finger within which objects are kept in the side view."""


def snapshot(
    record: Recording | Interaction | Rollout,
    path: str | os.PathLike,
    *,
    times: Sequence[float] | None = None,
    measured: Interaction | None = None,
) -> Path:
    """Write a picture (PNG or SVG by the name's ending) of `draw_snapshot`. Returns the path."""
    return save(draw_snapshot(record, times=times, measured=measured), path)


@styled
def draw_snapshot(
    record: Recording | Interaction | Rollout,
    *,
    times: Sequence[float] | None = None,
    measured: Interaction | None = None,
) -> "Figure":
    """Side view of the finger over its surface at several moments, above the contact force over time.

    The moment drawn darkest has the largest force; an outline shows the reference pose theta_r there. Arrows are
    contact forces, coloured by slip state in a rollout; those on objects are drawn at the darkest moment only, cut
    where they exceed the largest one on the hand. Objects are seen from the side, fixed solids cut in the plane of the
    fingertip.

    **Arguments**

    - `times`: moments to draw, s; by default six, spread over the longest contact.
    - `measured`: its normal force is drawn under the record's own.
    """
    model, up = record.model, upward(record)
    tips = pad_path(model, record.q)
    time = np.asarray(record.time, dtype=float)
    normal, tangential = force_components(record)
    moments = _moments(time, normal) if times is None else [int(np.argmin(np.abs(time - t))) for t in times]
    along = _side_axis(model, np.asarray(record.q, dtype=float)[moments[0]], up)
    strongest = max(moments, key=lambda k: normal[k])
    origin = np.nanmean(tips[moments], axis=0)
    origin = origin - up * (origin @ up)

    figure = new_figure(8.0, 4.6)
    side, plot = figure.subplots(2, 1, height_ratios=[2.7, 1.0])
    parts = bones(model)
    poses = body_poses(model, np.asarray(record.q, dtype=float)[moments])
    bodies = moving(record, np.array(moments))
    order = sorted(range(len(moments)), key=lambda i: (moments[i] == strongest, i))
    for rank, i in enumerate(order):
        last = moments[i] == strongest
        shade = 1.0 if last else 0.16 + 0.3 * rank / max(len(order) - 1, 1)
        for part in parts:
            outline = _outline(part, poses[0][i], poses[1][i], origin, along, up)
            side.fill(*outline.T, facecolor=SKIN, edgecolor=EDGE, lw=0.9, alpha=shade, zorder=3 + rank)
        for body in bodies:
            _draw_object(side, body, i, shade, 2.5 + rank, origin, along, up)
    if not isinstance(record, Recording):
        reference = body_poses(model, np.asarray(record.reference, dtype=float)[[strongest]])
        for part in parts:
            outline = _outline(part, reference[0][0], reference[1][0], origin, along, up)
            side.plot(*np.vstack([outline, outline[:1]]).T, color=REFERENCE, lw=1.1, ls=(0, (4, 2)), zorder=20)
    _draw_arrows(side, record, moments, strongest, origin, along, up)
    _draw_surface(side, record, parts, poses, bodies, origin, along, up)

    if measured is not None:
        plot.plot(
            np.asarray(measured.time), force_components(measured)[0], color=QUIET, lw=1.2, label="measured, normal"
        )
    words = "simulated" if isinstance(record, Rollout) else "measured"
    plot.plot(time, normal, color=MEASURED, label=f"{words}, normal")
    plot.plot(time, tangential, color=SLIDING, lw=1.0, label=f"{words}, tangential")
    for k in moments:
        plot.axvline(time[k], color=INK, lw=0.6, alpha=1.0 if k == strongest else 0.3)
    plot.set_xlabel("time (s)")
    plot.set_ylabel("contact force (N)")
    plot.margins(x=0.0)
    legend_above(plot)
    return figure


def _moments(time: np.ndarray, normal: np.ndarray, count: int = 6) -> list[int]:
    """Frames spread over the stretch of contact with the largest impulse, with a little before and after.

    Contact that is lost for a moment (what is pushed jumps ahead) goes on.
    """
    touching = np.concatenate([[False], normal > 0.05 * max(float(normal.max(initial=0.0)), 1e-9), [False]])
    edges = np.flatnonzero(np.diff(touching.astype(int)))
    if not len(edges):
        return [int(k) for k in np.linspace(0, len(time) - 1, count)]
    lost = np.flatnonzero(time[edges[2::2]] - time[edges[1:-1:2]] > PAUSE)
    spans = list(zip(edges[np.append(0, 2 * lost + 2)], edges[np.append(2 * lost + 1, len(edges) - 1)], strict=True))
    start, stop = max(spans, key=lambda span: float(normal[span[0] : span[1]].sum()))
    room = 0.15 * (stop - start)
    picks = np.linspace(max(start - room, 0), min(stop + room, len(time) - 1), count)
    peak = int(start + np.argmax(normal[start:stop]))
    return sorted({*(int(k) for k in picks), peak})


def _side_axis(model: Any, q: np.ndarray, up: np.ndarray) -> np.ndarray:
    position = body_poses(model, q[None])[1][0]
    reach = position[-1] - position[min(1, len(position) - 1)]
    reach = reach - up * (reach @ up)
    size = np.linalg.norm(reach)
    return reach / size if size > 1e-9 else np.array([1.0, 0.0, 0.0])


def _flat(points: np.ndarray, origin: np.ndarray, along: np.ndarray, up: np.ndarray) -> np.ndarray:
    return 1e3 * np.stack([(points - origin) @ along, (points - origin) @ up], axis=-1)


def _outline(
    part: Bone, rotation: np.ndarray, position: np.ndarray, origin: np.ndarray, along: np.ndarray, up: np.ndarray
) -> np.ndarray:
    """Outline of a tapered capsule seen from the side, mm: arcs of two circles and their common tangents."""
    ends = np.stack([part.start, part.end]) @ rotation[part.body].T + position[part.body]
    start, end = _flat(ends, origin, along, up)
    r0, r1 = 1e3 * part.start_radius, 1e3 * part.end_radius
    axis = end - start
    length = max(float(np.linalg.norm(axis)), 1e-6)
    heading = np.arctan2(axis[1], axis[0])
    tilt = np.arccos(np.clip((r0 - r1) / length, -1.0, 1.0))
    front = heading + np.linspace(-tilt, tilt, 24)
    back = heading + np.linspace(tilt, 2 * np.pi - tilt, 24)
    return np.concatenate(
        [
            end + r1 * np.stack([np.cos(front), np.sin(front)], axis=-1),
            start + r0 * np.stack([np.cos(back), np.sin(back)], axis=-1),
        ]
    )


def _draw_object(
    axis: Any,
    body: Moving,
    moment: int,
    shade: float,
    order: float,
    origin: np.ndarray,
    along: np.ndarray,
    up: np.ndarray,
) -> None:
    outline = silhouette(_flat(body.at(moment, body.solid.vertices), origin, along, up))
    axis.fill(*outline.T, facecolor=body.colour, lw=0, alpha=0.35 * shade, zorder=order)
    axis.plot(*outline.T, color=body.colour, lw=1.0, alpha=shade, zorder=order)
    if not body.solid.flat:  # nothing else shows that it turns
        marks = _flat(body.at(moment, body.solid.lines.reshape(-1, 3)), origin, along, up).reshape(-1, 2, 2)
        ends = np.concatenate([marks, np.full((len(marks), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        axis.plot(*ends.T, color=body.colour, lw=0.6, alpha=shade, zorder=order)


def _draw_arrows(
    axis: Any, record: Any, moments: list[int], strongest: int, origin: np.ndarray, along: np.ndarray, up: np.ndarray
) -> None:
    pairs = pair_forces(record, np.array(moments))
    largest = largest_force(pair_forces(record))
    for i, k in enumerate(moments):
        for column in np.flatnonzero(pairs.on_hand | (k == strongest)):
            force, point = pairs.force[i, column], pairs.point[i, column]
            size = float(np.linalg.norm(force))
            if size < 0.04 * largest or not np.isfinite(point).all():
                continue
            colour = MEASURED
            if isinstance(record, Rollout):
                colour = {1: STICKING, 2: SLIDING}.get(int(pairs.state[i, column]), QUIET)
            tail = _flat(point, origin, along, up)
            tip = tail + 55.0 * np.array([force @ along, force @ up]) / max(largest, size)
            axis.annotate(
                "",
                xy=tip,
                xytext=tail,
                zorder=30,
                arrowprops={
                    "arrowstyle": "-|>,head_width=0.28,head_length=0.55",
                    "color": colour,
                    "lw": 2.2 if k == strongest else 1.3,
                    "alpha": 1.0 if k == strongest else 0.7,
                    "shrinkA": 0,
                    "shrinkB": 0,
                },
            )


def _draw_surface(
    axis: Any,
    record: Any,
    parts: Any,
    poses: Any,
    bodies: tuple[Moving, ...],
    origin: np.ndarray,
    along: np.ndarray,
    up: np.ndarray,
) -> None:
    shown = list(parts[1:]) or list(parts)
    ends = np.concatenate([poses[1][:, part.body] + poses[0][:, part.body] @ part.end for part in shown])
    flat = _flat(ends, origin, along, up)
    left, right = float(flat[:, 0].min()) - 35.0, float(flat[:, 0].max()) + 40.0
    ceiling = float(flat[:, 1].max()) + 22.0
    farthest = left - BESIDE, right + BESIDE, ceiling + BESIDE
    for body in bodies:
        points = np.concatenate([body.at(i, body.solid.vertices) for i in range(len(body.position))])
        low, high = (bound(_flat(points, origin, along, up), axis=0) for bound in (np.min, np.max))
        right = max(right, min(float(high[0]) + 8.0, farthest[1]))
        left = min(left, max(float(low[0]) - 8.0, farthest[0]))
        ceiling = max(ceiling, min(float(high[1]) + 8.0, farthest[2]))
    surfaces, reach = surfaces_of(record), 1e-3 * np.linspace(left - 1e3, right, 3000)
    height = profile(surfaces, origin, along, up, reach)
    if np.isfinite(height).any():
        lowest = 1e3 * float(np.nanmin(height))
    else:
        cuts = sections(surfaces, origin, along, up)
        lowest = 1e3 * min(float(cut[:, 1].min()) for cut in cuts) if cuts else float(flat[:, 1].min())
    floor = lowest - 9.0
    draw_ground(axis, surfaces, origin, along, up, reach, 1e-3 * floor, 1.2)
    axis.set_xlim(min(left, right - WIDE * (ceiling - floor)), right)
    axis.set_ylim(floor, ceiling)
    axis.set_aspect("equal")
    axis.grid(False)
    axis.set_xlabel("distance along the finger (mm)")
    axis.set_ylabel("height (mm)")
