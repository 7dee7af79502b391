"""How far the compliance depends on the choices that the method leaves open."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from icjax.estimation import Sensitivity
from icjax.view._style import INK, MEASURED, REFERENCE, compliance_label, joint_title, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DEGREES = {1: (MEASURED, "linear"), 2: (REFERENCE, "quadratic")}
PANELS = 4
"""Most panels side by side."""


@styled
def plot_sensitivity(
    sensitivity: Sensitivity, truth: Mapping[str, float] | None = None, units: Mapping[str, str] | None = None
) -> "Figure":
    """Estimate against the length of the windows: a panel a joint, a colour a degree.

    Thin lines are the events, stable ones (`Sensitivity.stable`) darker; the thick line is the pooled value and its
    band the 95 % interval. Where the pooled value is not positive only the upper end of the interval is drawn, as a
    dotted line: "less than". Only choices with equal windows before and after the onset are drawn. The panel covers
    the pooled values and three quarters of the estimates; lines may leave it.

    **Arguments**

    - `sensitivity`: of `icjax.estimation.sensitivity`.
    - `truth`: rad/Nm by joint, drawn as a dashed line where it is known (a virtual subject).
    - `units`: of joints whose compliance is not in rad/Nm (slides), by name.

    **Errors**: `ValueError` where no choice has equal windows.
    """
    window = np.asarray(sensitivity.window)
    equal = np.flatnonzero(window[:, 0] == window[:, 1])
    if not len(equal):
        raise ValueError("no choice has windows of equal length before and after the onset")
    equal = equal[np.argsort(window[equal, 0])]
    joints = sensitivity.joint_names
    columns = max(min(len(joints), PANELS), 1)
    rows = max(-(-len(joints) // columns), 1)
    figure = new_figure(max(2.3 * columns, 7.6), 0.5 + 2.6 * rows)
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.ravel()[len(joints) :]:
        axis.remove()
    for joint, (axis, name) in enumerate(zip(axes.ravel(), joints, strict=False)):
        _panel(axis, sensitivity, joint, equal, (truth or {}).get(name))
        axis.set_title(joint_title(name, units))
        axis.set_xlabel("window (ms)")
    for axis in axes[:, 0]:
        axis.set_ylabel(compliance_label(joints, units))
    figure.legend(handles=_handles(sensitivity, truth), loc="outside upper right", ncols=4, fontsize=8.0)
    return figure


def _panel(axis: Any, sensitivity: Sensitivity, joint: int, equal: np.ndarray, truth: float | None) -> None:
    length = 1e3 * np.asarray(sensitivity.window)[equal, 0]
    values = np.asarray(sensitivity.compliance)[:, joint][:, equal]
    stable = np.asarray(sensitivity.stable)[:, joint]
    pooled, lower, upper = (
        np.asarray(item)[joint, equal] for item in (sensitivity.pooled, sensitivity.lower, sensitivity.upper)
    )
    mark = "o" if len(length) == 1 else None
    axis.axhline(0.0, color=INK, lw=0.7)
    for column, degree in enumerate(np.asarray(sensitivity.degree)):
        colour, _ = DEGREES[int(degree)]
        for event, course in enumerate(values[:, :, column]):
            axis.plot(length, course, color=colour, lw=0.7, alpha=0.75 if stable[event] else 0.22, marker=mark, ms=3)
        known = np.isfinite(pooled[:, column])
        low, high = (np.where(known, end[:, column], np.nan) for end in (lower, upper))
        axis.fill_between(length, low, high, color=colour, alpha=0.16, lw=0)
        axis.plot(length, pooled[:, column], color=colour, lw=2.2, marker=mark or "o", ms=3)
        bound = np.where(~known & np.isfinite(upper[:, column]), upper[:, column], np.nan)
        axis.plot(length, bound, color=colour, lw=1.2, ls=":", marker="v", ms=3)
    if truth is not None:
        axis.axhline(truth, color=INK, lw=1.2, ls=(0, (5, 2)))
    axis.set_ylim(*_limits(values, pooled, truth))
    if len(length) > 1:
        axis.set_xlim(length[0], length[-1])


def _limits(values: np.ndarray, pooled: np.ndarray, truth: float | None) -> tuple[float, float]:
    """Zero, the truth, the pooled values, and the eighths of the estimates."""
    found = [0.0, 0.1, *([] if truth is None else [truth]), *pooled[np.isfinite(pooled)]]
    finite = values[np.isfinite(values)]
    if len(finite):
        found += list(np.quantile(finite, [0.125, 0.875]))
    low, high = float(min(found)), float(max(found))
    return low - 0.08 * (high - low), high + 0.12 * (high - low)


def _handles(sensitivity: Sensitivity, truth: Mapping[str, float] | None) -> list[Any]:
    from matplotlib.lines import Line2D as line

    handles = []
    for degree in np.asarray(sensitivity.degree):
        colour, word = DEGREES[int(degree)]
        handles.append(line([], [], color=colour, lw=2.2, marker="o", ms=3, label=f"pooled, {word}"))
    handles.append(line([], [], color=MEASURED, lw=0.7, alpha=0.75, label="event, stable"))
    handles.append(line([], [], color=MEASURED, lw=0.7, alpha=0.3, label="event, not stable"))
    handles.append(line([], [], color=INK, lw=1.2, ls=":", marker="v", ms=3, label="pooled, less than"))
    if truth:
        handles.append(line([], [], color=INK, lw=1.2, ls=(0, (5, 2)), label="truth"))
    return handles
