"""Picture of Figure 13 (f, g): poses of hand and thing, turn over time, fingertip forces."""

from typing import Any, NamedTuple

import numpy as np
from hand_drawing import COLOURS, GREY, INK, View, draw_hand, framed, plotting
from scipy.spatial import ConvexHull

from icjax.laboratory import Gait
from icjax.model import Model
from icjax.recording import Recording
from icjax.rollout import Rollout

GLASS, METAL = "#E3ECF3", "#B9BFC7"
VIEW = View(np.radians(-52.0), np.radians(16.0))
"""From beside the fingers, the thumb behind the thing."""

Cylinders = tuple[tuple[float, float, float], ...]


class Course(NamedTuple):
    """A thing over time: pose, turn about the vertical and tilt (rad), normal force of every finger (N)."""

    time: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    turn: np.ndarray
    tilt: np.ndarray
    force: np.ndarray


def drawn(
    recording: Recording,
    ball: Course,
    rollout: Rollout,
    bulb: Course,
    shape: tuple[float, tuple[float, float, float], tuple[float, float, float]],
    gait: Gait,
) -> Any:
    """Two rows of poses, ball and bulb at the same moments; below, turn and forces."""
    pyplot = plotting()
    radius, *cylinders = shape
    moments = poses(gait)
    figure = pyplot.figure(figsize=(11.0, 7.8), layout="constrained")
    upper, lower = figure.subfigures(2, 1, height_ratios=[1.75, 1.0])
    rows = (
        ("f  ball that measures pressure, captured", recording.model, recording.q, ball, ()),
        ("g  light bulb, synthesised", rollout.model, rollout.q, bulb, tuple(cylinders)),
    )
    for strip, (title, model, q, course, more) in zip(upper.subfigures(2, 1), rows, strict=True):
        strip.suptitle(title, x=0.01, ha="left", fontsize=10, fontweight="bold", color=INK)
        for axis, (name, moment) in zip(strip.subplots(1, len(moments)), moments.items(), strict=True):
            row = int(np.argmin(np.abs(course.time - moment)))
            pose(axis, model, np.asarray(q)[row], course, row, radius, more)
            where = f"{moment:.1f} s, {np.degrees(course.turn[row]):.0f}°"
            axis.set_title(f"{name}\n{where}" if course is ball else where, fontsize=8.5, color=INK)
    curves(lower, ball, bulb, list(recording.model.pad_names), gait)
    lower.supxlabel(
        "Simulated data (MuJoCo hand, independently of icjax); no person was measured. Grey: strokes. Thick and dashed "
        "lines on ball and glass mark two opposite meridians; pads are filled where they press.",
        fontsize=7.5,
        color="#5B616B",
    )
    return figure


def poses(gait: Gait) -> dict[str, float]:
    """Moments of the strip, s."""
    first, second = gait.starts[0], gait.starts[1]
    away = gait.release + 0.5 * gait.back
    back = first + gait.turn
    return {
        "lifted": first,
        "turned": back,
        "index goes back": back + away,
        "little goes back": back + gait.again + away,
        "thumb, middle, ring": back + 2.0 * gait.again + away,
        "second stroke": second + gait.turn,
        "end": gait.duration - 0.1,
    }


def pose(axis: Any, model: Model, q: np.ndarray, course: Course, row: int, radius: float, cylinders: Cylinders) -> None:
    """Hand and thing at one moment."""
    R, p = course.rotation[row], course.position[row]
    draw_hand(axis, VIEW, model, q, course.force[row] > 0.05, p)
    middle = VIEW.seen(p[None])[1][0]
    for size, half, height in sorted(cylinders, key=lambda item: item[2]):
        turn = np.linspace(0.0, 2.0 * np.pi, 40)
        ring = np.column_stack([size * np.cos(turn), size * np.sin(turn), np.zeros(40)])
        ends3 = np.concatenate([ring + [0, 0, height - half], ring + [0, 0, height + half]])
        place, _ = VIEW.seen(ends3 @ R.T + p)
        outline = place[ConvexHull(place).vertices]
        axis.fill(*outline.T, facecolor=METAL, edgecolor=GREY, linewidth=0.8, zorder=3)
    place, _ = VIEW.seen(p[None])
    turn = np.linspace(0.0, 2.0 * np.pi, 80)
    axis.fill(*(place + 1e3 * radius * np.column_stack([np.cos(turn), np.sin(turn)])).T, facecolor=GLASS,
              edgecolor=GREY, linewidth=0.8, zorder=3.5)  # fmt: skip
    for number in range(4):
        around = 0.5 * np.pi * number - 0.9
        slope = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 60)
        meridian = np.column_stack([np.cos(slope) * np.cos(around), np.cos(slope) * np.sin(around), np.sin(slope)])
        place, near = VIEW.seen(radius * meridian @ R.T + p)
        place = np.where((near > middle)[:, None], place, np.nan)
        axis.plot(*place.T, color=INK if number % 2 == 0 else GREY, linewidth=(2.2, 0.7, 1.4, 0.7)[number],
                  linestyle="--" if number == 2 else "-", zorder=4)  # fmt: skip
    framed(axis, (-95, -38), (75, 182))


def curves(figure: Any, ball: Course, bulb: Course, fingers: list[str], gait: Gait) -> None:
    """Turn, tilt and the normal forces of ball and bulb over time."""
    axes = figure.subplots(1, 3, width_ratios=[1.0, 1.25, 1.25])
    for axis in axes:
        for start in gait.starts:
            axis.axvspan(start, start + gait.turn, color="#EEF0F3", zorder=0, linewidth=0)
        axis.set_xlim(0.0, ball.time[-1])
        axis.set_xlabel("time, s")
        axis.spines[["top", "right"]].set_visible(False)
    for course, name, colour in ((ball, "ball", GREY), (bulb, "bulb", "#0072B2")):
        axes[0].plot(course.time, np.degrees(course.turn), color=colour, label=f"{name}, turn")
        axes[0].plot(course.time, np.degrees(course.tilt), color=colour, linestyle=":", label=f"{name}, tilt")
    axes[0].axhline(90.0, color=INK, linewidth=0.7, linestyle="--")
    axes[0].set_ylabel("turn about the vertical, tilt, degrees")
    axes[0].legend(frameon=False, fontsize=8)
    for axis, course, name in ((axes[1], ball, "ball, measured"), (axes[2], bulb, "bulb, synthesised")):
        for number, finger in enumerate(fingers):
            axis.plot(course.time, course.force[:, number], color=COLOURS[finger], linewidth=1.0, label=finger)
        axis.set_title(name, loc="left", fontsize=9.5, fontweight="bold")
        axis.set_ylim(0.0, 1.05 * max(ball.force.max(), bulb.force.max()))
    axes[1].set_ylabel("normal force, N")
    axes[1].legend(frameon=False, fontsize=8, ncols=5, loc="upper center", columnspacing=0.8, handlelength=1.0)
