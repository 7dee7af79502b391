"""How hard the fingertips hold, and how close to slipping, as in Figure 14."""

from typing import TYPE_CHECKING, Any

import numpy as np

from icjax.rollout import Rollout
from icjax.view._pairs import Pairs, pair_forces
from icjax.view._style import INK, QUIET, SIMULATED, SLIDING, legend_above, new_figure, styled, thinned
from icjax.view._surfaces import scene_content

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WEAK = 0.05
"""Share of the largest force below which no ratio is drawn."""

VARIED = 0.005
"""Share by which a compliance must change to be drawn."""


@styled
def plot_grip(rollout: Rollout) -> "Figure":
    r"""Normal force, friction and $\|f_t\| / (\mu f_n)$ of every fingertip that touches (Kry and Pai 2006, Figure 14).

    A contact slides at one; on a polyhedral cone of m pairs of tangents it may from $\cos(\pi/2m)$ on (between both
    dotted lines). Forces below a twentieth of the largest have no ratio. Where a policy or the interaction changes the
    compliance, its mean over the joints is drawn as a share of what it was at first.

    **Errors**: `ValueError` where nothing touches the hand.
    """
    pairs = pair_forces(rollout)
    found = _fingertips(pairs)
    if not found:
        raise ValueError(f"nothing touches the hand in rollout {rollout.name!r}")
    share = _compliance(rollout)
    heights = [1.0, 0.8, 1.0] if share is None else [1.0, 0.8, 1.0, 0.6]
    figure = new_figure(7.6, 1.5 * sum(heights))
    axes = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    kept = thinned(len(rollout.time))
    time = np.asarray(rollout.time, float)[kept]
    for number, (name, curves) in enumerate(found.items()):
        colour = SIMULATED[number % len(SIMULATED)]
        for axis, values in zip(axes, curves, strict=False):
            axis.plot(time, values[kept], color=colour, lw=1.2, label=name)
    low = _least_slip(rollout)
    for level in {1.0, low}:
        axes[2].axhline(level, color=SLIDING, lw=0.9, ls=":")
    axes[2].set_ylim(0.0, 1.15)
    for axis, label in zip(axes, ("normal force (N)", "friction (N)", "friction /\n(μ × normal)"), strict=False):
        axis.set_ylabel(label)
    if share is not None:
        axes[3].plot(time, share[kept], color=INK, lw=1.2)
        axes[3].axhline(1.0, color=QUIET, lw=0.7)
        axes[3].set_ylabel("compliance\n(of the first)")
        axes[3].set_ylim(0.0, 1.05 * max(1.0, float(share.max())))
    for axis in axes:
        axis.margins(x=0.0)
    axes[-1].set_xlabel("time (s)")
    legend_above(axes[0], columns=6)
    figure.align_ylabels(list(axes))
    return figure


def _fingertips(pairs: Pairs) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Normal force, friction and ratio over mu of every body of the hand that touches something, `[time]` each."""
    pressing = np.sum(pairs.force * pairs.normal, axis=-1)
    sliding = np.linalg.norm(pairs.force - pressing[..., None] * pairs.normal, axis=-1)
    ratio = pairs.ratio() / pairs.friction
    strong = pressing > WEAK * float(pressing[:, pairs.on_hand].max(initial=0.0))
    ratio = np.where(strong & np.isfinite(ratio), ratio, -np.inf)
    made: dict[str, Any] = {}
    for name in dict.fromkeys(first for first, _ in pairs.bodies):
        own = [k for k, (first, _) in enumerate(pairs.bodies) if first == name and pairs.on_hand[k]]
        if own and pressing[:, own].any():
            largest = ratio[:, own].max(axis=1)
            made[name] = pressing[:, own].sum(axis=1), sliding[:, own].sum(axis=1), np.where(
                np.isfinite(largest), largest, np.nan
            )  # fmt: skip
    return made


def _least_slip(rollout: Rollout) -> float:
    """Where slip begins between two tangents of the cone that the scene states, one for a circular one."""
    facets = scene_content(rollout.scene).get("facets")
    return float(np.cos(np.pi / (2 * facets))) if facets else 1.0


def _compliance(rollout: Rollout) -> np.ndarray | None:
    """Mean share of the compliance of the joints at first, None where it stays."""
    if rollout.compliance is None:
        return None
    compliance = np.asarray(rollout.compliance, float)
    given = compliance[0] > 0
    if not given.any():
        return None
    share = (compliance[:, given] / compliance[0, given]).mean(axis=1)
    return share if np.ptp(share) > VARIED else None
