"""The clock of a separate force acquisition against the marker clock."""

import dataclasses

import numpy as np
from jaxtyping import Float

from icjax.capture._pulses import Edges

FURTHEST = 0.0005
"""No two clocks that both work differ by more than this in rate: ten times the tolerance of an ordinary quartz."""

OUTLIER_SD = 5.0
"""A pulse further from the line than so many robust standard deviations is not one of the train."""


@dataclasses.dataclass(frozen=True)
class Clock:
    """t_daq = (t_marker + offset) (1 + drift).

    - `offset` s, `drift` dimensionless; `offset_sd`, `drift_sd` their standard errors.
    - `time_sd`: s; the largest standard error of a mapped time over the trial (offset and drift together).
    - `method`: how it was found, in words.
    """

    offset: float
    drift: float
    offset_sd: float
    drift_sd: float
    time_sd: float
    method: str

    def on_marker_clock(self, time: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
        """Times of the acquisition's clock on the marker clock, s."""
        return np.asarray(time) / (1.0 + self.drift) - self.offset

    def described(self) -> str:
        """One line for people."""
        return (
            f"offset {1e3 * self.offset:.3f} +- {1e3 * self.offset_sd:.3f} ms, drift {1e6 * self.drift:.1f} +- "
            f"{1e6 * self.drift_sd:.1f} ppm, times known to {1e3 * self.time_sd:.3f} ms ({self.method})"
        )


def clock_from_line(a: float, b: float, covariance: np.ndarray, end: float, method: str) -> Clock:
    """Clock whose t_daq - t_marker = a + b t_marker; `covariance` of (a, b), times from 0 to `end` (s)."""
    times = np.array([0.0, end])
    variance = covariance[0, 0] + 2 * times * covariance[0, 1] + times**2 * covariance[1, 1]
    return Clock(
        offset=a / (1.0 + b),
        drift=b,
        offset_sd=float(np.sqrt(covariance[0, 0])),
        drift_sd=float(np.sqrt(covariance[1, 1])),
        time_sd=float(np.sqrt(variance.max())),
        method=method,
    )


def clock_from_pulses(
    edges: Edges,
    reference: Float[np.ndarray, " pulse"],
    sample: float,
    drift_sd: float,
    offset: float | None = None,
    periodic: bool = True,
) -> Clock:
    """Clock from pulses whose times on the marker clock are known.

    1. Edges and pulses are paired by the shift that pairs most of them; missing and spurious pulses stay alone.
    2. A line through the pairs, t_daq - t_marker = a + b t_marker, first by Theil and Sen (which outliers do not
       move); pairs further from it than five robust standard deviations are left out.
    3. An edge that no sample fell into is only known to lie between two samples. Such errors are bounded but not
       independent (clocks that hardly drift sample every pulse in the same phase), so a and b are the mean, and
       their errors the standard deviations, over all lines that pass between the samples. Otherwise least squares
       with the scatter of the residuals, at least that of the sampling.

    Drift has the prior N(0, `drift_sd`): some seconds of pulses sampled at 1 kHz know it less well than that.

    **Arguments**: `reference` s, increasing, marker clock; `sample` s between samples; `offset` s, approximate, where
    the pairing could be shifted; `periodic`: a shift is settled by letting the first pulse of the train be the first
    edge.

    **Errors**: `ValueError` when fewer than two pulses pair up or the pairing is ambiguous.
    """
    paired, known = _paired(edges, reference, sample, offset, periodic)
    from scipy.stats import theilslopes

    delay = edges.time[paired] - known
    slope, start = theilslopes(delay, known)[:2] if len(paired) > 2 else (0.0, float(np.mean(delay)))
    residual = delay - start - slope * known
    scatter = 1.4826 * float(np.median(np.abs(residual)))
    good = np.abs(residual) <= max(OUTLIER_SD * scatter, 1.5 * sample)
    paired, known, delay = paired[good], known[good], delay[good]
    left_out = len(edges.time) - len(paired)
    line = None
    if not edges.resolved[paired].any():
        line = _between_samples(edges.before[paired] - known, edges.after[paired] - known, known, sample, drift_sd)
    if line is None:
        least = 0.0 if edges.resolved[paired].all() else sample / np.sqrt(12)
        line = _least_squares(known, delay, least, sample, drift_sd)
    told = f"{len(paired)} sync pulses" + (f", {left_out} left out" if left_out else "")
    return clock_from_line(*line, end=float(known[-1]), method=told)


def _paired(
    edges: Edges, reference: np.ndarray, sample: float, offset: float | None, periodic: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the edges of the train, and the pulses that they are."""
    time = edges.time
    reach = max(reference[-1] - reference[0], time[-1] - time[0]) if len(time) and len(reference) else 0.0
    tolerance = 2 * sample + FURTHEST * reach
    spacing = float(np.min(np.diff(reference))) if len(reference) > 1 else np.inf
    if tolerance > spacing / 2:
        raise ValueError(f"the pulses come every {spacing:g} s, too fast to be told apart over {reach:g} s")
    pick = np.linspace(0, len(time) - 1, min(len(time), 20)).astype(int)
    shifts = np.unique(np.round(np.subtract.outer(time[pick], reference).ravel(), 9))
    if offset is not None:
        shifts = shifts[np.abs(shifts - offset) < spacing / 2]
    counts = np.array([len(_matches(time, reference, shift, tolerance)[0]) for shift in shifts])
    if not len(counts) or counts.max() < 2:
        raise ValueError(f"{len(time)} pulses were found, but fewer than two come when the session says")
    best = shifts[counts == counts.max()]
    if periodic:
        best = best[best >= best.max() - 2 * tolerance]
    elif best.max() - best.min() > 2 * tolerance:
        raise ValueError(
            f"the pulses pair up equally well at offsets of {best.min():.3f} and {best.max():.3f} s; "
            "give the approximate one as the key 'offset' of [clock]"
        )
    return _matches(time, reference, float(np.median(best)), tolerance)


def _matches(time: np.ndarray, reference: np.ndarray, shift: float, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    nearest = np.clip(np.searchsorted(reference, time - shift), 1, max(len(reference) - 1, 1)) - 1
    nearest = nearest + (
        np.abs(time - shift - reference[np.minimum(nearest + 1, len(reference) - 1)])
        < np.abs(time - shift - reference[nearest])
    )
    nearest = np.minimum(nearest, len(reference) - 1)
    distance = np.abs(time - shift - reference[nearest])
    order = np.argsort(distance, kind="stable")
    order = order[distance[order] <= tolerance]
    _, first = np.unique(nearest[order], return_index=True)
    chosen = np.sort(order[first])
    return chosen, reference[nearest[chosen]]


def _between_samples(
    lower: np.ndarray, upper: np.ndarray, known: np.ndarray, sample: float, drift_sd: float
) -> tuple[float, float, np.ndarray] | None:
    """Mean and covariance of (a, b) over all lines with lower <= a + b known <= upper; None if there are none.

    Weights: N(0, drift_sd) in b. Where jitter of the pulses leaves no line, the bounds are widened by twice what
    that takes, by half a sample at most.
    """
    from scipy.optimize import linprog

    rows = np.concatenate(
        [np.stack([s * np.ones_like(known), s * known, -np.ones_like(known)], 1) for s in (1.0, -1.0)]
    )
    bounds = np.concatenate([upper, -lower])
    free = [(None, None), (-FURTHEST, FURTHEST), (0.0, None)]
    widest = linprog([0.0, 0.0, 1.0], A_ub=rows, b_ub=bounds, bounds=free)
    if not widest.success or widest.x[2] > 0.25 * sample:
        return None
    bounds = bounds + 2 * widest.x[2]
    ends = [linprog([0.0, s, 0.0], A_ub=rows[:, :3], b_ub=bounds, bounds=[*free[:2], (0.0, 0.0)]) for s in (1.0, -1.0)]
    if not all(item.success for item in ends):
        return None
    b = np.linspace(ends[0].x[1], ends[1].x[1], 801)
    half = len(known)
    high = np.min(bounds[:half][None, :] - b[:, None] * known[None, :], axis=1)
    low = np.max(-bounds[half:][None, :] - b[:, None] * known[None, :], axis=1)
    width = np.maximum(high - low, 0.0)
    weight = width * np.exp(-0.5 * ((b**2 - np.min(b**2)) / drift_sd**2))
    if not weight.sum() > 0:
        return None
    weight = weight / weight.sum()
    middle = (high + low) / 2
    a_mean, b_mean = float(weight @ middle), float(weight @ b)
    a_variance = weight @ (middle - a_mean) ** 2 + weight @ width**2 / 12
    both = weight @ ((middle - a_mean) * (b - b_mean))
    return a_mean, b_mean, np.array([[a_variance, both], [both, weight @ (b - b_mean) ** 2]])


def _least_squares(
    known: np.ndarray, delay: np.ndarray, least: float, sample: float, drift_sd: float
) -> tuple[float, float, np.ndarray]:
    """(a, b) and covariance by least squares, the prior of the drift among the equations."""
    X = np.stack([np.ones_like(known), known], axis=1)
    prior = np.diag([0.0, 1.0 / drift_sd**2])
    sd = max(least, 1e-9 * max(sample, 1.0))
    if len(known) > 2:
        plain = np.linalg.lstsq(X, delay, rcond=None)[0]
        sd = max(sd, float(np.sqrt(np.sum((delay - X @ plain) ** 2) / (len(known) - 2))))
    else:
        sd = max(sd, sample / np.sqrt(12))
    covariance = np.linalg.inv(X.T @ X / sd**2 + prior)
    a, b = covariance @ (X.T @ delay) / sd**2
    return float(a), float(b), covariance
