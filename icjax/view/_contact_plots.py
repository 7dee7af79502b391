"""What happened to a joint when the finger touched, and the compliance read from it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from icjax.interaction import STATUS, CompliancePerEvent, Interaction, JointCompliance
from icjax.view._extras import require
from icjax.view._skeleton import scalar_joints
from icjax.view._style import (
    CONTACT,
    INK,
    MEASURED,
    NEGATIVE,
    QUIET,
    REFERENCE,
    TORQUE,
    compliance_label,
    joint_title,
    new_figure,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STATUS_MARKS = {"accepted": (MEASURED, "o"), "negative": (NEGATIVE, "X"), "not excited": (QUIET, "o")}
OTHER_MARK = (QUIET, "s")
PANELS = 4
"""Most panels side by side."""
CARETUP, CARETDOWN, HLINE = 6, 7, "_"
"""Ends of an interval: cut at the upper or lower border (matplotlib's numbers for carets), or within the panel."""


@styled
def plot_contact_event(
    interaction: Interaction, event: int, joint: str, *, trial_compliance: float = 1.0, margin: float = 0.06
) -> "Figure":
    """Joint angle and torque around one contact with the fitted lines, as in Figure 3 (Kry and Pai 2006).

    Draws the measured angle, the fits before and after contact, the fit before contact extrapolated past it and
    the reference trajectory; below, the torque of the contact force with its fit. Where the estimate is negative,
    as in Figure 8, the title says so and the reference that a given compliance would need, theta - C tau (Eq. 1),
    is drawn as well.

    **Arguments**

    - `event`: row of `interaction.per_event`; it must belong to this recording.
    - `joint`: name of a hinge or slide of `interaction.per_event`.
    - `trial_compliance`: rad/Nm (m/N for a slide), for the extra line of a negative event.
    - `margin`: s shown beyond the windows of the fits.

    **Errors**: `ValueError` where the event or joint is unknown, or the joint is a part of a ball or free joint.
    """
    per_event = interaction.per_event
    if not 0 <= event < len(per_event.onset):
        raise ValueError(f"event is {event}, expected 0 to {len(per_event.onset) - 1}")
    if joint not in per_event.joint_names:
        raise ValueError(f"unknown joint {joint!r}; the estimate has {', '.join(per_event.joint_names)}")
    column = per_event.joint_names.index(joint)
    drawn = next((item for item in scalar_joints(interaction.model) if item.name == joint), None)
    if drawn is None:
        raise ValueError(f"joint {joint!r} is neither a hinge nor a slide; it has no single coordinate to draw")
    scale, slide = drawn.scale, drawn.kind == "slide"
    before, after = (float(value) for value in np.asarray(per_event.window))
    s = np.asarray(interaction.time) - float(per_event.onset[event])
    shown = (s >= -before - margin) & (s <= after + margin)
    s = s[shown]
    angle = np.asarray(interaction.q)[shown, drawn.coordinate]
    torque = np.asarray(interaction.torque)[shown, drawn.dof]
    reference = np.asarray(interaction.reference)[shown, drawn.coordinate]
    negative = STATUS[int(per_event.status[event, column])] == "negative"

    figure = new_figure(6.4, 4.6)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[1.7, 1.0])
    for axis in (top, bottom):
        axis.axvspan(0.0, 1e3 * (after + margin), color=CONTACT, alpha=0.55, lw=0)
        axis.axvline(0.0, color=INK, lw=0.8)
    top.plot(1e3 * s, scale * angle, ".", color=MEASURED, ms=4, label="measured angle θ")
    top.plot(1e3 * s, scale * reference, color=REFERENCE, ls=(0, (4, 2)), label="reference θr")
    past, future = np.linspace(-before, 0.0, 60), np.linspace(0.0, after, 60)
    fit_before, fit_after = np.asarray(per_event.angle_before), np.asarray(per_event.angle_after)
    top.plot(1e3 * past, scale * _polynomial(fit_before[event, column], past), color=INK, lw=1.6, label="fits")
    top.plot(1e3 * future, scale * _polynomial(fit_after[event, column], future), color=INK, lw=1.6)
    extrapolated = scale * _polynomial(fit_before[event, column], future)
    top.plot(1e3 * future, extrapolated, color=INK, lw=1.1, ls=":", label="extrapolated")
    if negative:
        needed = scale * (angle - trial_compliance * torque)
        label = f"θ − Cτ for C = {trial_compliance:g} {drawn.compliance_unit}"
        top.plot(1e3 * s, needed, color=NEGATIVE, lw=1.2, label=label)
    bottom.plot(1e3 * s, (1.0 if slide else 1e3) * torque, ".", color=TORQUE, ms=4, label="torque τ")
    fit_torque = _polynomial(np.asarray(per_event.torque_after)[event, column], future)
    bottom.plot(1e3 * future, (1.0 if slide else 1e3) * fit_torque, color=INK, lw=1.6)
    top.set_ylabel(f"{joint} {'position' if slide else 'angle'} ({drawn.unit})")
    bottom.set_ylabel(f"{joint} {'force (N)' if slide else 'torque (mNm)'}")
    bottom.set_xlabel("time after contact (ms)")
    bottom.set_xlim(1e3 * (-before - margin), 1e3 * (after + margin))
    top.legend(loc="best")
    top.set_title(_event_title(per_event, event, column, drawn.compliance_unit), color=NEGATIVE if negative else INK)
    return figure


def _polynomial(coefficients: np.ndarray, s: np.ndarray) -> np.ndarray:
    return np.polynomial.polynomial.polyval(s, coefficients)


def _event_title(per_event: CompliancePerEvent, event: int, column: int, unit: str) -> str:
    status = STATUS[int(per_event.status[event, column])]
    value, error = float(per_event.compliance[event, column]), float(per_event.standard_error[event, column])
    words = f"C = {_signed(value)} ± {error:.2g} {unit}" if np.isfinite(value) else "no estimate"
    name, onset = per_event.recording[event], float(per_event.onset[event])
    return f"{per_event.joint_names[column]}, {name}, contact at {onset:.3f} s: {words} ({status})"


def _signed(value: float) -> str:
    return f"{value:.3g}".replace("-", "−")


@styled
def plot_compliance(
    per_event: CompliancePerEvent, summary: JointCompliance, units: Mapping[str, str] | None = None
) -> "Figure":
    """Every per-event compliance with its 95 % interval and status, and each joint's summary.

    One panel a joint, one mark an event, numbered from 1 in order of onset; the band is the summary's 95 %
    interval. The panel covers the estimates; a bar that reaches beyond it ends in an arrowhead at the border, an
    outlying estimate is a triangle there, and events without a usable estimate are open marks at the bottom, so
    that no event is hidden.

    **Arguments**: `units` of joints whose compliance is not in rad/Nm (slides), by name.

    **Errors**: `ValueError` where the two records name different joints.
    """
    if per_event.joint_names != summary.joint_names:
        raise ValueError(f"joints differ: {per_event.joint_names} in the events, {summary.joint_names} in the summary")
    joints = per_event.joint_names
    columns = max(min(len(joints), PANELS), 1)
    rows = max(-(-len(joints) // columns), 1)
    figure = new_figure(max(2.3 * columns, 7.6), 0.4 + 2.6 * rows)
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.ravel()[len(joints) :]:
        axis.remove()
    for column, (axis, joint) in enumerate(zip(axes.ravel(), joints, strict=False)):
        low, high = float(summary.lower[column]), float(summary.upper[column])
        value = float(summary.compliance[column])
        limits = _limits(per_event, column, (low, value, high))
        if np.isfinite([low, high]).all():
            axis.axhspan(max(low, limits[0]), min(high, limits[1]), color=MEASURED, alpha=0.13, lw=0)
        elif np.isfinite(high):
            axis.axhline(high, color=MEASURED, lw=1.1, ls="--")
        if np.isfinite(value):
            axis.axhline(value, color=MEASURED, lw=1.3)
        axis.axhline(0.0, color=INK, lw=0.7)
        _marks(axis, per_event, column, limits)
        axis.set_ylim(*limits)
        axis.set_xlim(0.4, max(len(per_event.onset), 1) + 0.6)
        axis.set_title(joint_title(joint, units))
        axis.set_xlabel("contact event (number)")
        axis.xaxis.set_major_locator(require("matplotlib.ticker").FixedLocator(_event_ticks(len(per_event.onset))))
    for axis in axes[:, 0]:
        axis.set_ylabel(compliance_label(joints, units))
    figure.legend(handles=_legend_handles(), loc="outside upper right", ncols=3, fontsize=8.0)
    return figure


def _event_ticks(count: int) -> list[int]:
    """Event numbers to print: 1, and every so many."""
    step = next(size for size in (1, 2, 5, 10, 20, 50, 100, count + 1) if count <= 8 * size)
    return [1, *range(step, count + 1, step)] if step > 1 else list(range(1, count + 1))


def _limits(per_event: CompliancePerEvent, column: int, summary: tuple[float, float, float]) -> tuple[float, float]:
    """Range that covers the summary and the estimates but for outliers, with room for the marks at the borders.

    An estimate is outlying where it lies more than 3 interquartile ranges outside the quartiles. The summary's
    bounds count only as far as twice the range of the estimates, since a loose bound would flatten them.
    """
    values = np.asarray(per_event.compliance)[:, column]
    used = np.isin(np.asarray(per_event.status)[:, column], [STATUS.index("accepted"), STATUS.index("negative")])
    kept = values[used & np.isfinite(values)]
    low, high = 0.0, 0.1
    bounds = [value for value in summary if np.isfinite(value)]
    if len(kept):
        first, third = np.quantile(kept, [0.25, 0.75])
        usual = kept[(kept >= first - 3 * (third - first)) & (kept <= third + 3 * (third - first))]
        low, high = min(low, float(usual.min())), max(high, float(usual.max()))
        span = high - low
        bounds = [float(np.clip(value, low - span, high + span)) for value in bounds]
    low, high = min([low, *bounds]), max([high, *bounds])
    return low - 0.3 * (high - low), high + 0.2 * (high - low)


def _marks(axis: Any, per_event: CompliancePerEvent, column: int, limits: tuple[float, float]) -> None:
    room = 0.04 * (limits[1] - limits[0])
    low, high = limits[0] + 1.6 * room, limits[1] - room
    for event in range(len(per_event.onset)):
        number, value = event + 1, float(per_event.compliance[event, column])
        status = STATUS[int(per_event.status[event, column])]
        colour, mark = STATUS_MARKS.get(status, OTHER_MARK)
        if status not in ("accepted", "negative") or not np.isfinite(value):
            axis.plot(number, limits[0] + room, mark, color=colour, ms=4.5, mfc="white", mew=0.9)
            continue
        error = 1.96 * float(per_event.standard_error[event, column])
        inside = low < value < high
        if inside and np.isfinite(error):
            for end, border, tip in ((value - error, low, CARETDOWN), (value + error, high, CARETUP)):
                cut = not low <= end <= high
                axis.plot([number, number], [value, border if cut else end], color=colour, lw=0.9, alpha=0.6)
                cap = tip if cut else HLINE
                axis.scatter([number], [border if cut else end], s=22.0, marker=cap, color=colour, lw=0.9, alpha=0.7)
        mark = mark if inside else ("^" if value >= high else "v")
        axis.plot(number, float(np.clip(value, low, high)), mark, color=colour, ms=4.5, mew=0.9)


def _legend_handles() -> list[Any]:
    from matplotlib.lines import Line2D as line

    handles = [
        line([], [], color=colour, marker=mark, ls="", ms=5, mfc="white" if status == "not excited" else colour)
        for status, (colour, mark) in STATUS_MARKS.items()
    ]
    labels = list(STATUS_MARKS)
    labels[2] = "not excited (bottom)"
    handles += [
        line([], [], color=QUIET, marker=OTHER_MARK[1], ls="", ms=5, mfc="white"),
        line([], [], color=QUIET, marker="^", ls="", ms=5, mfc="white"),
        line([], [], color=MEASURED, lw=1.3),
    ]
    labels += ["too few samples (bottom)", "estimate beyond the panel", "summary, 95 % interval (dashed: bound)"]
    for handle, label in zip(handles, labels, strict=True):
        handle.set_label(label)
    return handles
