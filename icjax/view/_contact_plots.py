"""What happened to a joint when the finger touched, and the compliance read from it."""

from typing import TYPE_CHECKING, Any

import numpy as np

from icjax.interaction import STATUS, CompliancePerEvent, Interaction, JointCompliance
from icjax.view._skeleton import hinge_columns
from icjax.view._style import CONTACT, INK, MEASURED, NEGATIVE, QUIET, REFERENCE, TORQUE, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STATUS_MARKS = {"accepted": (MEASURED, "o"), "negative": (NEGATIVE, "X"), "not excited": (QUIET, "o")}
OTHER_MARK = (QUIET, "s")


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
    - `joint`: name of a hinge of `interaction.per_event`.
    - `trial_compliance`: rad/Nm, for the extra line of a negative event.
    - `margin`: s shown beyond the windows of the fits.

    **Errors**: `ValueError` where the event or joint is unknown.
    """
    per_event = interaction.per_event
    if not 0 <= event < len(per_event.onset):
        raise ValueError(f"event is {event}, expected 0 to {len(per_event.onset) - 1}")
    if joint not in per_event.joint_names:
        raise ValueError(f"unknown joint {joint!r}; the estimate has {', '.join(per_event.joint_names)}")
    column = per_event.joint_names.index(joint)
    _, coordinate, dof = next(item for item in hinge_columns(interaction.model) if item[0] == joint)
    before, after = (float(value) for value in np.asarray(per_event.window))
    s = np.asarray(interaction.time) - float(per_event.onset[event])
    shown = (s >= -before - margin) & (s <= after + margin)
    s = s[shown]
    angle = np.asarray(interaction.q)[shown, coordinate]
    torque = np.asarray(interaction.torque)[shown, dof]
    reference = np.asarray(interaction.reference)[shown, coordinate]
    negative = STATUS[int(per_event.status[event, column])] == "negative"

    figure = new_figure(6.4, 4.6)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[1.7, 1.0])
    for axis in (top, bottom):
        axis.axvspan(0.0, 1e3 * (after + margin), color=CONTACT, alpha=0.55, lw=0)
        axis.axvline(0.0, color=INK, lw=0.8)
    top.plot(1e3 * s, np.degrees(angle), ".", color=MEASURED, ms=4, label="measured angle θ")
    top.plot(1e3 * s, np.degrees(reference), color=REFERENCE, ls=(0, (4, 2)), label="reference θr")
    past, future = np.linspace(-before, 0.0, 60), np.linspace(0.0, after, 60)
    fit_before, fit_after = np.asarray(per_event.angle_before), np.asarray(per_event.angle_after)
    top.plot(1e3 * past, np.degrees(_polynomial(fit_before[event, column], past)), color=INK, lw=1.6, label="fits")
    top.plot(1e3 * future, np.degrees(_polynomial(fit_after[event, column], future)), color=INK, lw=1.6)
    extrapolated = np.degrees(_polynomial(fit_before[event, column], future))
    top.plot(1e3 * future, extrapolated, color=INK, lw=1.1, ls=":", label="extrapolated")
    if negative:
        needed = np.degrees(angle - trial_compliance * torque)
        label = f"θ − Cτ for C = {trial_compliance:g} rad/Nm"
        top.plot(1e3 * s, needed, color=NEGATIVE, lw=1.2, label=label)
    bottom.plot(1e3 * s, 1e3 * torque, ".", color=TORQUE, ms=4, label="torque τ")
    fit_torque = _polynomial(np.asarray(per_event.torque_after)[event, column], future)
    bottom.plot(1e3 * future, 1e3 * fit_torque, color=INK, lw=1.6)
    top.set_ylabel(f"{joint} angle (deg)")
    bottom.set_ylabel(f"{joint} torque (mNm)")
    bottom.set_xlabel("time after contact (ms)")
    bottom.set_xlim(1e3 * (-before - margin), 1e3 * (after + margin))
    top.legend(loc="best")
    top.set_title(_event_title(per_event, event, column), color=NEGATIVE if negative else INK)
    return figure


def _polynomial(coefficients: np.ndarray, s: np.ndarray) -> np.ndarray:
    return np.polynomial.polynomial.polyval(s, coefficients)


def _event_title(per_event: CompliancePerEvent, event: int, column: int) -> str:
    status = STATUS[int(per_event.status[event, column])]
    value, error = float(per_event.compliance[event, column]), float(per_event.standard_error[event, column])
    words = f"C = {_signed(value)} ± {error:.2g} rad/Nm" if np.isfinite(value) else "no estimate"
    name, onset = per_event.recording[event], float(per_event.onset[event])
    return f"{per_event.joint_names[column]}, {name}, contact at {onset:.3f} s: {words} ({status})"


def _signed(value: float) -> str:
    return f"{value:.3g}".replace("-", "−")


@styled
def plot_compliance(per_event: CompliancePerEvent, summary: JointCompliance) -> "Figure":
    """Every per-event compliance with its 95 % interval and status, and each joint's summary.

    One panel a joint, one dot an event in order of onset; the band is the summary's 95 % interval. Values outside
    the panel sit at its edge as triangles, so that no event is hidden.

    **Errors**: `ValueError` where the two records name different joints.
    """
    if per_event.joint_names != summary.joint_names:
        raise ValueError(f"joints differ: {per_event.joint_names} in the events, {summary.joint_names} in the summary")
    joints = per_event.joint_names
    figure = new_figure(max(2.3 * len(joints), 4.6), 3.0)
    axes = figure.subplots(1, len(joints), squeeze=False)[0]
    for column, (axis, joint) in enumerate(zip(axes, joints, strict=True)):
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
        _dots(axis, per_event, column, limits)
        axis.set_ylim(*limits)
        axis.set_xlim(-1.0, max(len(per_event.onset), 1))
        axis.set_title(joint)
        axis.set_xlabel("contact event (number)")
        axis.xaxis.get_major_locator().set_params(integer=True)
    axes[0].set_ylabel("compliance (rad/Nm)")
    figure.legend(handles=_legend_handles(), loc="outside upper right", ncols=6, fontsize=8.0)
    return figure


def _limits(per_event: CompliancePerEvent, column: int, summary: tuple[float, float, float]) -> tuple[float, float]:
    values = np.asarray(per_event.compliance)[:, column]
    used = np.isin(np.asarray(per_event.status)[:, column], [STATUS.index("accepted"), STATUS.index("negative")])
    kept = values[used & np.isfinite(values)]
    anchors = [value for value in summary if np.isfinite(value)]
    if len(kept):
        low, middle, high = np.quantile(kept, [0.05, 0.5, 0.95])
        anchors += [max(low, middle - 4 * abs(middle) - 0.1), min(high, middle + 4 * abs(middle) + 0.1)]
    low, high = min([0.0, *anchors]), max([0.1, *anchors])
    room = 0.15 * (high - low)
    return low - room, high + room


def _dots(axis: Any, per_event: CompliancePerEvent, column: int, limits: tuple[float, float]) -> None:
    for event in range(len(per_event.onset)):
        value = float(per_event.compliance[event, column])
        if not np.isfinite(value):
            continue
        status = STATUS[int(per_event.status[event, column])]
        colour, mark = STATUS_MARKS.get(status, OTHER_MARK)
        hollow = status not in ("accepted", "negative")
        error = 1.96 * float(per_event.standard_error[event, column])
        inside = limits[0] < value < limits[1]
        if inside and np.isfinite(error):
            axis.plot([event, event], [value - error, value + error], color=colour, lw=0.8, alpha=0.55)
        room = 0.03 * (limits[1] - limits[0])
        shown = float(np.clip(value, limits[0] + room, limits[1] - room))
        mark = mark if inside else ("^" if value > limits[1] else "v")
        axis.plot(event, shown, mark, color=colour, ms=4.5, mfc="white" if hollow else colour, mew=0.9)


def _legend_handles() -> list[Any]:
    from matplotlib.lines import Line2D as line

    handles = [
        line([], [], color=colour, marker=mark, ls="", ms=5, mfc="white" if status == "not excited" else colour)
        for status, (colour, mark) in STATUS_MARKS.items()
    ]
    labels = list(STATUS_MARKS)
    handles += [
        line([], [], color=QUIET, marker=OTHER_MARK[1], ls="", ms=5, mfc="white"),
        line([], [], color=QUIET, marker="^", ls="", ms=5, mfc="white"),
        line([], [], color=MEASURED, lw=1.3),
    ]
    labels += ["too few samples", "beyond the panel", "summary, 95 % interval (dashed: bound)"]
    for handle, label in zip(handles, labels, strict=True):
        handle.set_label(label)
    return handles
