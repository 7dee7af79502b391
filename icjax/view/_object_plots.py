"""What the objects of a rollout did, and the forces on them, over time."""

from typing import TYPE_CHECKING, Any

import numpy as np

from icjax.rollout import Rollout
from icjax.view._object_course import ObjectCourse, object_course
from icjax.view._objects import object_colour
from icjax.view._style import CONTACT, INK, MEASURED, REFERENCE, new_figure, styled, thinned

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WEIGHT = REFERENCE
OBJECT_PANELS = 3
"""Most objects side by side."""
SMOOTHED = 0.02
"""s; contacts of rigid things close and open from step to step, and what counts is their mean."""


@styled
def plot_objects(rollout: Rollout, objects: tuple[str, ...] | None = None) -> "Figure":
    """Place, rotation, speed and contact forces of the objects of a rollout over time, a column an object.

    Shaded: touched by the hand. Forces are means over 20 ms; the sum of all contact forces, upward, is the weight
    (dotted) while an object rests or slides on something level.

    **Arguments**: `objects` by name, by default the first three.

    **Errors**: `ValueError` for a rollout without objects, or a name that is none.
    """
    names = rollout.object_names[:OBJECT_PANELS] if objects is None else objects
    if not names:
        raise ValueError(f"rollout {rollout.name!r} has no objects to draw")
    unknown = [name for name in names if name not in rollout.object_names]
    if unknown:
        raise ValueError(f"unknown object {unknown[0]!r}; the rollout has {', '.join(rollout.object_names)}")
    figure = new_figure(max(3.0 * len(names), 7.6), 6.4)
    grid = figure.subplots(5, len(names), sharex=True, squeeze=False, height_ratios=[1.0, 0.8, 0.8, 0.8, 1.2])
    for column, name in enumerate(names):
        colour = object_colour(rollout.object_names.index(name))
        _draw(grid[:, column], object_course(rollout, name), colour)
    for axis, label in zip(grid[:, 0], ("moved (mm)", "lifted (mm)", "", "speed (mm/s)", "force (N)"), strict=True):
        axis.set_ylabel(label or axis.get_ylabel())
    figure.align_ylabels(list(grid[:, 0]))
    figure.legend(handles=_handles(), loc="outside lower right", ncols=4, fontsize=8.0)
    return figure


def _draw(axes: Any, course: ObjectCourse, colour: str) -> None:
    kept = thinned(len(course.time))
    time = course.time[kept]
    for axis in axes:
        axis.margins(x=0.0)
        for start, stop in _spans(course.time, course.pushed > 0):
            axis.axvspan(start, stop, color=CONTACT, alpha=0.8, lw=0)
    axes[0].set_title(course.name, color=colour)
    angle = course.turned if course.ball else course.tilt
    axes[2].set_ylabel("turned (deg)" if course.ball else "tilt (deg)")
    rows = ((1e3 * course.moved, 1.0), (1e3 * course.lifted, 1.0), (np.degrees(angle), 1.0), (1e3 * course.speed, 5.0))
    for axis, (values, least) in zip(axes, rows, strict=False):
        axis.plot(time, values[kept], color=colour)
        low, high = axis.get_ylim()
        if high - low < least:  # rounding is no movement
            axis.set_ylim(-0.1 * least, least)
    force = axes[-1]
    force.plot(time, _smooth(course.time, course.carried)[kept], color=INK, lw=1.1)
    force.plot(time, _smooth(course.time, course.pushed)[kept], color=MEASURED, lw=1.1)
    if course.weight is not None:
        force.axhline(course.weight, color=WEIGHT, lw=1.4, ls=(0, (4, 2)))
    force.set_xlabel("time (s)")


def _handles() -> list[Any]:
    from matplotlib.lines import Line2D as line
    from matplotlib.patches import Patch

    return [
        line([], [], color=INK, lw=1.1, label="all contacts, upward"),
        line([], [], color=MEASURED, lw=1.1, label="by the hand"),
        line([], [], color=WEIGHT, lw=1.4, ls=(0, (4, 2)), label="weight"),
        Patch(color=CONTACT, label="touched by the hand"),
    ]


def _smooth(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Mean over the last 20 ms."""
    count = max(1, round(SMOOTHED / max(float(np.median(np.diff(time))), 1e-9))) if len(time) > 1 else 1
    total = np.concatenate([np.zeros(1), np.cumsum(values)])
    last = np.arange(1, len(values) + 1)
    first = np.maximum(last - count, 0)
    return (total[last] - total[first]) / (last - first)


def _spans(time: np.ndarray, touched: np.ndarray) -> list[tuple[float, float]]:
    """Start and end of every stretch in which something holds; gaps below 50 ms are closed."""
    rows = np.flatnonzero(touched)
    if not len(rows):
        return []
    breaks = np.flatnonzero(np.diff(time[rows]) > 0.05)
    starts, stops = rows[np.concatenate([[0], breaks + 1])], rows[np.concatenate([breaks, [len(rows) - 1]])]
    return [(float(time[a]), float(time[b])) for a, b in zip(starts, stops, strict=True)]
