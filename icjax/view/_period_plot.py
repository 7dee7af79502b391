"""Compliance of every part of a session in which it may be another."""

from typing import TYPE_CHECKING

import numpy as np

from icjax.fit import FitRecord
from icjax.view._fit_plots import DECADES, _bar
from icjax.view._style import MEASURED, QUIET, REFERENCE, compliance_label, joint_title, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_TICKS = 24
"""Names of periods beside one another that can be read."""


@styled
def plot_fit_periods(fit: FitRecord) -> "Figure":
    """Fitted compliance of every joint over the periods of a session, with 95 % intervals; a panel a joint.

    A refused number has a bar without a mark. The line is the geometric mean of all periods with its interval as a
    band, where it is not refused: periods whose bars lie beside the band differ.
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    periods = fit.periods
    count, joints = len(periods.period_names), periods.joint_names
    figure = new_figure(1.2 + 2.2 * len(joints), 1.1 + min(0.24 * count, 9.0))
    panels = np.atleast_1d(figure.subplots(1, len(joints), sharey=True))
    places = -np.arange(count, dtype=float)
    for at, (axis, joint) in enumerate(zip(panels, joints, strict=True)):
        ends = np.concatenate([np.asarray(x)[:, at] for x in (periods.lower, periods.compliance, periods.upper)])
        ends = ends[np.isfinite(ends) & (ends > 0)]
        border = max(float(ends.min()), float(ends.max()) / DECADES) / 1.2, 1.2 * float(ends.max())
        axis.set_xscale("log")
        if not fit.refused[at]:
            axis.axvspan(max(float(fit.lower[at]), border[0]), min(float(fit.upper[at]), border[1]), color=REFERENCE,
                         alpha=0.18, lw=0)  # fmt: skip
            axis.axvline(float(fit.compliance[at]), color=REFERENCE, lw=1.0)
        for row, place in enumerate(places):
            colour = QUIET if periods.refused[row, at] else MEASURED
            _bar(
                axis, float(periods.lower[row, at]), float(periods.upper[row, at]), place, border, color=colour, lw=2.0
            )
            if not periods.refused[row, at]:
                axis.plot(periods.compliance[row, at], place, "o", color=colour, ms=4)
        axis.set_xlim(border)
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.xaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.set_title(joint_title(joint, fit.units))
        axis.grid(visible=False, axis="y")
        axis.tick_params(axis="x", labelrotation=60)
    shown = slice(None, None, -(-count // MOST_TICKS))
    panels[0].set_yticks(places[shown], periods.period_names[shown])
    panels[0].set_ylim(places[-1] - 0.6, 0.6)
    figure.supxlabel(compliance_label(joints, fit.units), fontsize=9.0)
    return figure
