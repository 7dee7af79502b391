"""The offset of a force clock without a sync pulse: how deep a fingertip is pressed against how hard it presses."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from icjax.capture._clock import Clock, clock_from_line
from icjax.capture._filters import HIGHEST_CUTOFF, lowpass, runs
from icjax.capture._registration import rigid_registrations

CUTOFF = 25.0
"""Hz; band in which depth and force are compared. Markers hold little of a pad's depth above it."""

STEP = 0.001
"""s; grid of both signals."""

HEIGHTS = np.arange(-0.002, 0.00401, 0.00025)
"""m; where the surface may seem to lie against the pad: marker placement and skin."""

LEAST_CORRELATION = 0.4
"""A lower peak says that depth and force have little to do with each other."""

RIVAL = 0.8
"""A second peak of this share of the highest one makes the offset ambiguous."""

SEPARATE = 0.1
"""s; peaks closer than this are one (a contact begins in 50 ms)."""

LOCAL = 0.03
"""s; how far the lag of one contact may lie from that of the trial."""

EDGE = 0.02
"""s; what is taken of the trial before and after a contact."""


class Signal(NamedTuple):
    """A sampled signal: `time` s, `value`."""

    time: Float[np.ndarray, " sample"]
    value: Float[np.ndarray, " sample"]


def pad_heights(
    sites: Float[np.ndarray, "marker 3"],
    pad: Float[np.ndarray, "3"],
    markers: Float[np.ndarray, "frame marker 3"],
    time: Float[np.ndarray, " frame"],
    point: Float[np.ndarray, "3"],
    normal: Float[np.ndarray, "3"],
) -> Signal:
    """Height of a pad's centre over a plane, from the markers of its own body laid onto their sites, m.

    **Arguments**: `sites`, `pad` m, body axes; `markers` m, filtered to 25 Hz here; `point`, `normal` of the plane.

    **Errors**: `ValueError` with fewer than three markers or no frame that shows them all.
    """
    seen = np.isfinite(markers).all(axis=(1, 2))
    if markers.shape[1] < 3 or seen.sum() < 4:
        raise ValueError("the touching body needs three markers that are seen together")
    flat = markers.reshape(len(markers), -1)
    filled = np.stack([np.interp(time, time[seen], column[seen]) for column in flat.T], axis=1)
    rate = (len(time) - 1) / float(time[-1] - time[0])
    smooth = lowpass(filled, rate, min(CUTOFF, HIGHEST_CUTOFF * rate)).reshape(markers.shape)
    R, p = rigid_registrations(sites, smooth)
    return Signal(time, (R @ pad + p - point) @ normal)


def clock_from_contacts(
    height: Signal,
    radius: float,
    force: Signal,
    guess: float,
    within: float,
    drift_sd: float,
    least: float = LEAST_CORRELATION,
) -> Clock:
    """Offset of the force clock, and its drift where contacts late in the trial show one.

    Both signals change when the pad meets the surface: the depth max(0, r - height) begins to grow and so does the
    pressing force, with no delay but that of the pad's own damping. Their *rates* are correlated (the signals
    themselves are slow and give a broad peak) over the lags `guess` +- `within`, over a few heights of the
    surface. The lag of each contact by itself, within 30 ms of the common one, gives the scatter; the standard error
    is that of their mean, and not less than one marker frame or what the width of the peak allows,
    sqrt((1 - rho^2) / (N rho |rho''|)) with N = 2 x 25 Hz x seconds of contact.

    **Arguments**: `height` m over the surface, marker clock; `radius` of the pad, m; `force` N, pressing, its own
    clock; `guess`, `within` s; `drift_sd`: what is stated of a drift that is not seen and taken as zero; `least`: the
    correlation below which the peak counts as low.

    **Errors**: `ValueError` when there is no contact, the peak is low, has a rival or lies at the end of the range.
    """
    rate = (len(force.time) - 1) / float(force.time[-1] - force.time[0])
    smooth = lowpass(force.value, rate, min(CUTOFF, HIGHEST_CUTOFF * rate))
    grid = np.arange(force.time[0], force.time[-1], STEP)
    pressing = np.maximum(np.interp(grid, force.time, smooth), 0.0)
    pushed = np.gradient(pressing, STEP)
    start = float(height.time[0])
    clock = np.arange(start, height.time[-1], STEP)
    over = np.interp(clock, height.time, height.value) - radius
    lags = np.arange(-within, within + STEP / 2, STEP) + guess
    best, rho, depth = -1.0, np.zeros(len(lags)), np.zeros(len(clock))
    for surface in HEIGHTS:
        candidate = np.gradient(np.maximum(surface - over, 0.0), STEP)
        found = _correlation(candidate, pushed, np.round((lags + start - grid[0]) / STEP).astype(int))
        if found.max() > best:
            best, rho, depth = float(found.max()), found, candidate
    peak = _certain_peak(lags, rho, least)
    lag, curvature = _parabola(lags, rho, peak)
    contacts = [item for item in runs(pressing > 0.1 * pressing.max()) if item[1] - item[0] > 2 * EDGE / STEP]
    seconds = STEP * sum(stop - first for first, stop in contacts)
    width = np.sqrt((1 - best**2) / (best * max(curvature, 1e-12) * max(2 * CUTOFF * seconds, 1.0)))
    frame = float(np.median(np.diff(height.time)))
    when, each = _each_contact(clock, depth, grid, pushed, contacts, lag)
    if len(each) < 2:
        covariance = np.diag([max(frame, width) ** 2, drift_sd**2])
        return clock_from_line(lag, 0.0, covariance, float(height.time[-1]), "one contact, correlated")
    told = f"correlation {best:.2f} of pad depth and force, {len(each)} contacts"
    sd = max(frame, width, float(np.std(each, ddof=1)) / np.sqrt(len(each)))
    if len(each) > 3:
        line, covariance = np.polyfit(when, each, 1, cov="unscaled")
        scatter = max(frame**2, float(np.sum((each - np.polyval(line, when)) ** 2)) / (len(each) - 2))
        covariance = covariance[::-1, ::-1] * scatter
        if abs(line[0]) > 3 * np.sqrt(covariance[1, 1]):
            covariance = covariance + np.diag([frame**2, 0.0])
            return clock_from_line(line[1], line[0], covariance, float(height.time[-1]), told + ", with drift")
    return clock_from_line(lag, 0.0, np.diag([sd**2, drift_sd**2]), float(height.time[-1]), told + ", no drift seen")


def _correlation(x: np.ndarray, y: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Correlation of x(t) with y(t + shift) over all of both, which are zero outside contact."""
    from scipy.signal import correlate

    size = float(np.sqrt((x @ x) * (y @ y)))
    if size == 0.0:
        return np.zeros(len(shifts))
    full = correlate(y, x, method="fft") / size
    index = shifts + len(x) - 1
    inside = (index >= 0) & (index < len(full))
    return np.where(inside, full[np.clip(index, 0, len(full) - 1)], 0.0)


def _certain_peak(lags: np.ndarray, rho: np.ndarray, least: float) -> int:
    peak = int(np.argmax(rho))
    if rho[peak] < least:
        raise ValueError(f"pad depth and force correlate by {rho[peak]:.2f} at most (needed: {least:g}); no offset")
    if peak in (0, len(lags) - 1):
        raise ValueError(f"the correlation is largest at the end of the range, {lags[peak]:.3f} s; give 'offset'")
    others = np.abs(lags - lags[peak]) > SEPARATE
    if others.any() and rho[others].max() > RIVAL * rho[peak]:
        rival = lags[others][int(np.argmax(rho[others]))]
        raise ValueError(
            f"the offset is ambiguous: correlation {rho[peak]:.2f} at {lags[peak]:.3f} s and "
            f"{rho[others].max():.2f} at {rival:.3f} s; give 'offset' and a smaller 'within'"
        )
    return peak


def _parabola(lags: np.ndarray, rho: np.ndarray, peak: int) -> tuple[float, float]:
    """Lag of the peak between samples, and -rho'' there (1/s^2), from the points within 5 ms."""
    near = np.abs(lags - lags[peak]) <= 5.5 * STEP
    x = lags[near] - lags[peak]
    c2, c1, _ = np.polyfit(x, rho[near], 2)
    if c2 >= 0:
        return float(lags[peak]), 0.0
    return float(lags[peak] + np.clip(-c1 / (2 * c2), x[0], x[-1])), float(-2 * c2)


def _each_contact(
    clock: np.ndarray,
    depth: np.ndarray,
    grid: np.ndarray,
    pushed: np.ndarray,
    contacts: list[tuple[int, int]],
    lag: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Time (marker clock) and lag of every contact by itself, those with a peak inside the range."""
    lags = np.arange(-LOCAL, LOCAL + STEP / 2, STEP) + lag
    edge = int((EDGE + LOCAL) / STEP)
    when, found = [], []
    for first, stop in contacts:
        own = np.zeros_like(pushed)
        own[max(first - edge, 0) : stop + edge] = pushed[max(first - edge, 0) : stop + edge]
        inside = (clock + lag >= grid[first] - EDGE) & (clock + lag <= grid[min(stop, len(grid) - 1)] + EDGE)
        shifts = np.round((lags + clock[0] - grid[0]) / STEP).astype(int)
        rho = _correlation(np.where(inside, depth, 0.0), own, shifts)
        peak = int(np.argmax(rho))
        if 0 < peak < len(lags) - 1:
            when.append(float(grid[first] - lag))
            found.append(_parabola(lags, rho, peak)[0])
    return np.array(when), np.array(found)
