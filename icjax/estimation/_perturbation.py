"""Response of the fingertip to a sudden movement of the surface: onset, reaction time, secant stiffness."""

from typing import NamedTuple

import equinox as eqx
import numpy as np

from icjax.estimation._endpoint import NORMAL_95
from icjax.typing import Float

REST = (-0.06, -0.005)
"""s, from the onset: what counts as rest. The last milliseconds are left out, should the onset be found late."""

ONSET_DEVIATION = 8.0
"""Standard deviations of the resting force beyond which it has left rest."""
SETTLED = 0.15
"""s of contact before an onset: the first touch is no perturbation."""
RISE = 0.01
"""s, over which a perturbation is the fastest change of force."""

PASSIVE_FROM, REACTION_FROM, REACTION_UNTIL = 0.05, 0.06, 0.25
"""s from the onset: where the ringing begins to be fitted; where a reaction is looked for (a spinal reflex takes longer
than the first)."""
FALLEN = 0.6
"""Share of the highest force at which the fit ends, well before the finger leaves the surface."""
DECAYS, FREQUENCIES = np.arange(10.0, 90.0, 10.0), np.arange(20.0, 95.0, 10.0)
"""1/s and rad/s of the ringing."""
CHI_SQUARE, UNKNOWNS = 3.841, 7
"""95 % of one parameter; c, a, b, s, w, h, T."""


class Secant(eqx.Module):
    """Stiffness as a change of force over a change of position, from rest to a window after the perturbation.

    **Fields**

    - `stiffness`, `lower`, `upper` N/m: vertical, delta f_z / delta z, 95 %.
    - `along` N/m: along the change of force, `df.df / (df.du)` = 1 / (e^T J C J^T e) at equilibrium, e = `direction`,
      whatever the tangential force did; `along_lower`, `along_upper` 95 %.
    - `force` N, `displacement` m [3]: df and du, with their standard deviations.
    - `window` s.
    """

    stiffness: float
    lower: float
    upper: float
    along: float
    along_lower: float
    along_upper: float
    direction: Float[np.ndarray, "3"]
    force: Float[np.ndarray, "3"]
    force_sd: Float[np.ndarray, "3"]
    displacement: Float[np.ndarray, "3"]
    displacement_sd: Float[np.ndarray, "3"]
    window: Float[np.ndarray, "2"]


class Reaction(NamedTuple):
    """Time from the onset to the reaction, s, and its 95 % interval; NaN where none is seen."""

    time: float
    lower: float
    upper: float


def perturbation_onset(
    time: Float[np.ndarray, " sample"], force: Float[np.ndarray, " sample"], touching: np.ndarray
) -> float:
    """When the surface began to move, from the force on the finger.

    The perturbation is the largest change of force within `RISE` during a contact that has lasted `SETTLED`; its
    onset lies halfway between the last sample at rest and the first that differs from the mean of the 50 ms before
    by `ONSET_DEVIATION` standard deviations.

    **Arguments**: `time` s; `force` N, unfiltered; `touching`, where the finger is in contact.

    **Errors**: `ValueError` where no contact is long enough or nothing in it is sudden.
    """
    step = float(np.median(np.diff(time)))
    rise, settled = max(round(RISE / step), 1), round(SETTLED / step)
    steady = np.convolve(touching.astype(float), np.ones(settled), "full")[: len(time)] >= settled - 0.5
    change = np.zeros(len(time))
    change[:-rise] = np.abs(force[rise:] - force[:-rise])
    change[~steady] = 0.0
    if not change.any():
        raise ValueError(f"no contact lasts {SETTLED:g} s: a perturbation is looked for in a resting contact")
    peak = int(np.argmax(change))
    before = slice(max(peak - round(0.06 / step), 0), max(peak - round(0.01 / step), 1))
    mean, sd = float(np.mean(force[before])), float(np.std(force[before]))
    left = np.flatnonzero(np.abs(force[before.stop : peak + rise + 1] - mean) > ONSET_DEVIATION * sd)
    if not len(left):
        raise ValueError(f"the force never leaves rest suddenly ({ONSET_DEVIATION:g} standard deviations, {sd:.2g} N)")
    return float(time[before.stop + left[0]] - 0.5 * step)


def reaction_time(time: Float[np.ndarray, " sample"], force: Float[np.ndarray, " sample"], onset: float) -> Reaction:
    """First deviation of the force from the passive response, of a finger that withdraws.

    Once the surface rests again a passive finger rings down, f = c + exp(-s t) (a cos w t + b sin w t). A reaction
    adds h max(0, t - T)^2, the start of a movement without jump of force or rate. All are fitted together, s and w
    from a grid, from `PASSIVE_FROM` until the force has fallen to `FALLEN` of its highest value after
    `REACTION_FROM`; T is the one with the least sum of squares. Its interval holds every T whose sum lies within 3.84
    variances of the least (chi-square, one parameter), the variance enlarged by (1 + r) / (1 - r) for the
    autocorrelation r of the residuals.

    **Arguments**: `time` s; `force` N on the finger, unfiltered; `onset` s.

    **Returns** NaN throughout where the force does not fall within `REACTION_UNTIL`.
    """
    t = time - onset
    later = (t >= REACTION_FROM) & (t <= REACTION_UNTIL)
    low = later & (force < FALLEN * np.max(force[later], initial=0.0))
    low &= t > t[later][np.argmax(force[later])] if later.any() else False
    if not low.any():
        return Reaction(*[float("nan")] * 3)
    end = float(t[low][0])
    used = (t >= PASSIVE_FROM) & (t <= end)
    s, f = t[used] - PASSIVE_FROM, force[used]
    candidates = np.arange(REACTION_FROM, end - 0.005, 0.001)
    ramps = np.maximum(s[:, None] + PASSIVE_FROM - candidates, 0.0) ** 2
    costs = np.full(len(candidates), np.inf)
    residuals = np.zeros((len(candidates), len(s)))
    for rate in DECAYS:
        for w in FREQUENCIES:
            decay = np.exp(-rate * s)
            passive, _ = np.linalg.qr(np.stack([np.ones_like(s), decay * np.cos(w * s), decay * np.sin(w * s)], axis=1))
            left = f - passive @ (passive.T @ f)
            ramp = ramps - passive @ (passive.T @ ramps)
            cost = left @ left - (left @ ramp) ** 2 / np.sum(ramp**2, axis=0)
            better = cost < costs
            costs = np.where(better, cost, costs)
            now = left - (ramp * ((left @ ramp) / np.sum(ramp**2, axis=0))).T
            residuals[better] = now[better]
    chosen = int(np.argmin(costs))
    left = residuals[chosen]
    r = min(max(float(left[1:] @ left[:-1] / (left @ left)), 0.0), 0.95)
    allowed = costs[chosen] * (1 + CHI_SQUARE * (1 + r) / (1 - r) / max(len(s) - UNKNOWNS, 1))
    inside = candidates[costs <= allowed]
    return Reaction(float(candidates[chosen]), float(inside[0]), float(inside[-1]))


def secant_stiffness(
    time: Float[np.ndarray, " sample"],
    position: Float[np.ndarray, "sample 3"],
    force: Float[np.ndarray, "sample 3"],
    onset: float,
    window: tuple[float, float] = (0.05, 0.09),
    up: Float[np.ndarray, "3"] | None = None,
) -> Secant:
    """Secant stiffness from the mean over `REST` to the mean over a window in which the finger has nearly settled.

    The standard deviation of each mean is that of the samples over sqrt(n_eff), n_eff = n (1 - r) / (1 + r) with their
    autocorrelation r, at least 1: where the response still rings, the interval is as wide as the ringing.

    With the position of the bone (a point of the model's pad that moves with the distal segment) this is the
    stiffness of the joints; with that of the surface it is the joints' and the pad's in series (`in_series`).
    Vertical force over vertical displacement is k_G only if the tangential force does not change; `along` needs no
    such thing.

    **Arguments**: `time` s; `position` m; `force` N on the finger; `onset` s; `window` s after it; `up` the
    vertical, default z.

    **Errors**: `ValueError` for a window without two finite samples.
    """
    e = np.array([0.0, 0.0, 1.0]) if up is None else np.asarray(up)
    (df, sf), (du, su) = (_change(time - onset, series, window) for series in (force, position))
    stiffness, deviation = _ratio(float(df @ e), _spread(sf, e), float(du @ e), _spread(su, e))
    size = float(np.linalg.norm(df))
    direction = df / size
    moved = float(du @ direction)
    along, along_sd = _ratio(size, _spread(sf, direction), moved, _spread(su, direction))
    return Secant(
        stiffness=stiffness,
        lower=stiffness - NORMAL_95 * deviation,
        upper=stiffness + NORMAL_95 * deviation,
        along=along,
        along_lower=along - NORMAL_95 * along_sd,
        along_upper=along + NORMAL_95 * along_sd,
        direction=direction,
        force=df,
        force_sd=sf,
        displacement=du,
        displacement_sd=su,
        window=np.array(window),
    )


def _spread(sd: np.ndarray, e: np.ndarray) -> float:
    return float(np.sqrt(np.sum((sd * e) ** 2)))


def _ratio(a: float, sa: float, b: float, sb: float) -> tuple[float, float]:
    """a / b and its standard deviation, first order."""
    return float(a / b), float(np.hypot(sa, a / b * sb) / abs(b))


def _change(t: np.ndarray, series: np.ndarray, window: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Change of the mean from rest to the window, and its standard deviation."""
    means, variances = [], []
    for name, (start, stop) in (("rest", REST), ("window", window)):
        part = series[(t >= start) & (t <= stop)]
        part = part[np.isfinite(part).all(axis=1)]
        if len(part) < 2:
            raise ValueError(f"{name} from {start:g} to {stop:g} s after the onset holds {len(part)} usable samples")
        centred = part - part.mean(axis=0)
        power = np.sum(centred**2, axis=0)
        r = np.sum(centred[1:] * centred[:-1], axis=0) / np.where(power > 0, power, 1.0)
        effective = np.clip(len(part) * (1 - r) / (1 + r), 1.0, len(part))
        means.append(part.mean(axis=0))
        variances.append(power / (len(part) - 1) / effective)
    return means[1] - means[0], np.sqrt(variances[0] + variances[1])
