"""Fingertip elevation and force while the surface suddenly moves."""

from typing import TYPE_CHECKING

import numpy as np

from icjax.estimation import Perturbation
from icjax.view._style import CONTACT, INK, MEASURED, QUIET, REFERENCE, SLIDING, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = (-40.0, 180.0)
"""ms around the onset."""


@styled
def plot_perturbations(found: tuple[Perturbation, ...], titles: tuple[str, ...] = ()) -> "Figure":
    """Elevation of the fingertip and vertical force, one column a trial, as in Figure 7 (Kry and Pai 2006).

    Dark: the second-order fit within its window. The wide band is the window of the secant stiffness, the vertical
    line the first reaction with its 95 % interval.

    **Errors**: `ValueError` where there is no trial.
    """
    if not found:
        raise ValueError("nothing to draw: give at least one perturbation trial")
    figure = new_figure(3.7 * len(found), 4.4)
    grid = figure.subplots(2, len(found), sharex=True, squeeze=False)
    for column, item in enumerate(found):
        top, bottom = grid[:, column]
        shown = (1e3 * item.time >= SHOWN[0]) & (1e3 * item.time <= SHOWN[1])
        time = 1e3 * item.time[shown]
        top.plot(time, 1e3 * item.displacement[shown], ".", color=MEASURED, ms=3, label="measured")
        bottom.plot(time, item.force[shown], ".", color=MEASURED, ms=3)
        fitted = 1e3 * item.fit.time
        top.plot(fitted, 1e3 * item.fit.position, color=INK, lw=1.8, label="second-order fit")
        bottom.plot(fitted, item.fit.force, color=INK, lw=1.8)
        for axis, change in ((top, 1e3 * _up(item.secant.displacement)), (bottom, _up(item.secant.force))):
            start, stop = 1e3 * np.asarray(item.secant.window)
            level = change + (item.rest_force if axis is bottom else 0.0)
            axis.axvspan(start, stop, color=CONTACT, alpha=0.6, lw=0)
            axis.plot([start, stop], [level, level], color=REFERENCE, lw=2.0, label="mean for the secant")
            axis.axvline(0.0, color=QUIET, lw=0.8)
            if np.isfinite(item.reaction.time):
                axis.axvspan(1e3 * item.reaction.lower, 1e3 * item.reaction.upper, color=SLIDING, alpha=0.25, lw=0)
                axis.axvline(1e3 * item.reaction.time, color=SLIDING, lw=1.2, label="first reaction")
        top.set_title(titles[column] if titles else item.name)
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 2.0}
        bottom.text(0.98, 0.97, _words(item), transform=bottom.transAxes, ha="right", va="top", fontsize=7.5, bbox=box)
        bottom.set_xlabel("time after the surface moved (ms)")
        bottom.set_xlim(*SHOWN)
        bottom.set_ylim(top=bottom.get_ylim()[1] * 1.12)
    grid[0, 0].set_ylabel("fingertip elevation (mm)")
    grid[1, 0].set_ylabel("force on the finger (N)")
    grid[0, 0].legend(loc="upper left")
    figure.align_ylabels(list(grid[:, 0]))
    return figure


def _up(vector: np.ndarray) -> float:
    return float(np.asarray(vector)[2])


def _words(item: Perturbation) -> str:
    m, b, k = (float(x) for x in item.fit.value[:3])
    lines = [
        f"fit of {1e3 * item.fit.window:.0f} ms: m {1e3 * m:.3g} g, b {b:.3g} Ns/m",
        f"k {k:.3g} N/m, R² {item.fit.r_squared:.4f}".replace("-", "−"),
        f"secant {item.secant.stiffness:.3g} N/m",
    ]
    if np.isfinite(item.reaction.time):
        lines.append(f"reaction {1e3 * item.reaction.time:.0f} ms")
    return "\n".join(lines)
