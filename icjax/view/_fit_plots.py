"""What a fit of a session found and what it left: intervals, response to contact, reference, residuals."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from icjax.fit import FitRecord
from icjax.view._style import (
    CONTACT,
    INK,
    MEASURED,
    QUIET,
    REFERENCE,
    STICKING,
    TORQUE,
    compliance_label,
    joint_title,
    legend_above,
    new_figure,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WINDOWS = 3
"""Contacts drawn of a joint: the strongest, the middle and the weakest by torque."""

BAND = 1.96
"""Standard deviations of a 95 % band."""

DECADES = 1e3
"""Least end of an interval that is drawn, as a share of the largest value or bound."""


@styled
def plot_fit_compliance(fit: FitRecord, truth: Mapping[str, float] | None = None) -> "Figure":
    """Fitted compliance of every joint with its 95 % interval, the paper's estimate below it.

    A refused joint has a bar without a mark; an interval that has no end ends in an arrowhead at the panel's border.

    **Arguments**: `truth` rad/Nm by joint, drawn as a line where it is known (a virtual subject).
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    joints, paper = fit.joint_names, fit.paper
    figure = new_figure(7.6, 0.9 + 0.5 * len(joints))
    axis = figure.subplots()
    axis.set_xscale("log")
    places = -np.arange(len(joints), dtype=float)
    shown = np.concatenate([fit.lower, fit.upper, paper.compliance, np.where(paper.lower > 0, paper.lower, np.nan)])
    shown = shown[np.isfinite(shown) & (shown > 0)]
    most = max([float(shown.max()), *np.asarray(paper.upper)[np.isfinite(paper.upper)].tolist()])
    border = float(max(shown.min(), shown.max() / DECADES)) / 1.5, 1.2 * most
    for row, joint in zip(places, joints, strict=True):
        at = joints.index(joint)
        colour = QUIET if fit.refused[at] else MEASURED
        _bar(axis, float(fit.lower[at]), float(fit.upper[at]), row + 0.14, border, color=colour, lw=3.0)
        if not fit.refused[at]:
            axis.plot(fit.compliance[at], row + 0.14, "o", color=colour, ms=6)
        known = (truth or {}).get(joint)
        if known is not None:
            axis.plot([known] * 2, [row - 0.32, row + 0.32], color=INK, lw=1.2)
    for row, joint in zip(places, joints, strict=True):
        if joint in paper.joint_names:
            _paper(axis, paper, paper.joint_names.index(joint), row - 0.14, border)
    axis.set_xlim(border)
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_yticks(places, [joint_title(name, fit.units) for name in joints])
    axis.set_ylim(places[-1] - 0.5, 0.5)
    axis.grid(visible=False, axis="y")
    axis.set_xlabel(compliance_label(joints, fit.units))
    marks: list[tuple[str, dict[str, Any]]] = [
        ("fit", {"color": MEASURED, "marker": "o"}),
        ("fit, refused", {"color": QUIET, "lw": 3.0}),
        ("the paper's estimate", {"color": REFERENCE, "marker": "s"}),
        ("truth (virtual subject)", {"color": INK, "lw": 1.2}),
    ]
    wanted = [True, any(fit.refused), True, bool(truth)]
    for (label, look), want in zip(marks, wanted, strict=True):
        if want:
            axis.plot([], [], label=label, **look)
    legend_above(axis)
    return figure


def _bar(axis: Any, low: float, high: float, place: float, border: tuple[float, float], **look: Any) -> None:
    """An interval; what goes beyond a border ends there in an arrowhead."""
    axis.plot([max(low, border[0]), min(high, border[1])], [place] * 2, **look)
    for out, at, marker in ((low < border[0], border[0], 4), (high > border[1], border[1], 5)):
        if out:
            axis.plot(at, place, marker=marker, color=look["color"], ms=7, clip_on=False)


def _paper(axis: Any, paper: Any, row: int, place: float, border: tuple[float, float]) -> None:
    if np.isfinite(paper.upper[row]):
        _bar(axis, float(paper.lower[row]), float(paper.upper[row]), place, border, color=REFERENCE, lw=2.0)
    if np.isfinite(paper.compliance[row]) and paper.compliance[row] > border[0]:
        axis.plot(float(paper.compliance[row]), place, "s", color=REFERENCE, ms=5)


class _Course(NamedTuple):
    """One window and joint over ms after the onset, in the units of the picture."""

    title: str
    time: np.ndarray
    used: tuple[int, np.ndarray, int]
    scale: float


@styled
def plot_fit_response(fit: FitRecord, joints: Sequence[str] | None = None) -> "Figure":
    """Deviation from the contact-free movement as measured and as the fit predicts it, a row a joint.

    Measured is the trial less the mean of its repetitions and less the drift between them that the movement before
    contact foretells (without repetitions: less the movement that it foretells); the band is what 95 % of movements
    would leave open. In each row the contacts with the strongest, the middle and the weakest torque.

    **Errors**: `ValueError` for an unknown joint.
    """
    windows = fit.windows
    figure, panels = _grid(fit, joints, "deviation")
    for axis, course in panels:
        measured = windows.angle - windows.repetition - windows.drift
        predicted, spread = (
            course.scale * item[course.used] for item in (windows.deviation, BAND * np.asarray(windows.drift_sd))
        )
        axis.fill_between(course.time, predicted - spread, predicted + spread, color=STICKING, alpha=0.18, lw=0,
                          label="95 % of movements")  # fmt: skip
        axis.plot(course.time, predicted, color=STICKING, label="predicted by the fit")
        axis.plot(course.time, course.scale * measured[course.used], ".", color=MEASURED, ms=4, label="measured")
    _finish(figure, panels)
    return figure


@styled
def plot_fit_reference(fit: FitRecord, joints: Sequence[str] | None = None) -> "Figure":
    """Angle as measured, the contact-free reference with its 95 % band, and the mean of the repetitions.

    The contacts are those of `plot_fit_response`. A band that is not finite is left out.

    **Errors**: `ValueError` for an unknown joint.
    """
    windows = fit.windows
    figure, panels = _grid(fit, joints, "angle")
    for axis, course in panels:
        measured, reference, repetition, spread = (
            course.scale * np.asarray(item)[course.used]
            for item in (windows.angle, windows.reference, windows.repetition, BAND * np.asarray(windows.reference_sd))
        )
        spread = np.where(np.isfinite(spread), spread, np.nan)
        axis.fill_between(course.time, reference - spread, reference + spread, color=REFERENCE, alpha=0.25, lw=0)
        if windows.repetitions[course.used[0]]:
            axis.plot(course.time, repetition, color=QUIET, lw=1.0, label="mean of the catch trials")
        axis.plot(course.time, reference, color=REFERENCE, ls=(0, (4, 2)), label="reference")
        axis.plot(course.time, measured, color=MEASURED, label="measured")
    _finish(figure, panels)
    return figure


@styled
def plot_fit_spectrum(fit: FitRecord) -> "Figure":
    """Power of the whitened residuals over frequency, a line a joint, mean of all windows; white noise is flat at one.

    The band holds 95 % of such means of white noise. Power above it at some frequency is something that the model does
    not know: an oscillation, or a filter.
    """
    from scipy.stats import chi2

    windows = fit.windows
    residual, time = np.asarray(windows.residual), np.asarray(windows.time)
    step = float(np.nanmedian(np.diff(time, axis=1)))
    longest = int(np.isfinite(time).sum(axis=1).max())
    frequency = np.fft.rfftfreq(longest, step)[1:]
    power = np.zeros((len(frequency), len(fit.joint_names)))
    for rows, when in zip(residual, time, strict=True):
        used = np.isfinite(when)
        wave = np.exp(-2j * np.pi * frequency[:, None] * (when[used] - when[used][0])[None, :])
        power += np.abs(wave @ rows[used]) ** 2 / used.sum() / len(time)
    figure = new_figure(7.6, 2.7)
    axis = figure.subplots()
    count = 2 * len(time)
    low, high = chi2.ppf([0.025, 0.975], count) / count
    axis.axhspan(low, high, color=CONTACT, alpha=0.9, lw=0, label="95 % of white noise")
    axis.axhline(1.0, color=INK, lw=0.8)
    colours = (MEASURED, REFERENCE, STICKING, TORQUE)
    for column, joint in enumerate(fit.joint_names):
        axis.plot(frequency, power[:, column], color=colours[column % 4], lw=1.2, label=joint,
                  ls="-" if column < 4 else (0, (3, 1 + column // 4)))  # fmt: skip
    axis.set_xlabel("frequency (Hz)")
    axis.set_ylabel("power, 1 = as assumed")
    axis.set_ylim(bottom=0.0)
    axis.margins(x=0.0)
    if len(fit.joint_names) <= 6:
        legend_above(axis, columns=7)
    return figure


def _grid(fit: FitRecord, joints: Sequence[str] | None, what: str) -> "tuple[Figure, list[tuple[Any, _Course]]]":
    names = list(fit.joint_names if joints is None else joints)
    unknown = [name for name in names if name not in fit.joint_names]
    if unknown:
        raise ValueError(f"unknown joint {unknown[0]!r}; the fit has {', '.join(fit.joint_names)}")
    count = min(WINDOWS, len(fit.windows.trial))
    figure = new_figure(7.6, 0.5 + 1.65 * len(names))
    axes = figure.subplots(len(names), count, sharex=True, squeeze=False)
    panels = []
    for row, name in zip(axes, names, strict=True):
        column = fit.joint_names.index(name)
        slide = fit.joint_kinds[column] == "slide"
        for axis, window in zip(row, _chosen(fit, column, count), strict=True):
            panels.append((axis, _course(fit, window, column, 1e3 if slide else 180.0 / np.pi)))
        row[0].set_ylabel(f"{name}\n{'position' if slide and what == 'angle' else what} ({'mm' if slide else '°'})")
    return figure, panels


def _chosen(fit: FitRecord, column: int, count: int) -> list[int]:
    """Windows by their largest torque: strongest, middle, weakest."""
    torque = np.nanmax(np.abs(np.asarray(fit.windows.torque)[:, :, column]), axis=1)
    order = np.argsort(-torque, kind="stable")
    return [int(order[place]) for place in np.linspace(0, len(order) - 1, count).round().astype(int)]


def _course(fit: FitRecord, window: int, column: int, scale: float) -> _Course:
    windows = fit.windows
    time, onset = np.asarray(windows.time)[window], float(windows.onset[window])
    kept: np.ndarray = np.flatnonzero(np.isfinite(time) & (time > onset - 0.12))
    torque = np.nanmax(np.abs(np.asarray(windows.torque)[window, :, column]))
    slide = fit.joint_kinds[column] == "slide"
    force = f"{torque:.2g} N" if slide else f"{1e3 * torque:.3g} mNm"
    title = f"{windows.trial[window]}, {onset:.2f} s, {force}"
    return _Course(title, 1e3 * (time[kept] - onset), (window, kept, column), scale)


def _finish(figure: Any, panels: list[tuple[Any, _Course]]) -> None:
    for axis, course in panels:
        axis.axvspan(0.0, course.time[-1], color=CONTACT, alpha=0.55, lw=0, zorder=0)
        axis.set_title(course.title, fontsize=8.0, fontweight="normal")
        axis.margins(x=0.0)
    for axis in figure.axes[-min(WINDOWS, len(panels)) :]:
        axis.set_xlabel("time after contact (ms)")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=4)
    figure.align_ylabels(figure.axes)
