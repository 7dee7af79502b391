"""Contact onset and release from the force of one source."""

import dataclasses

import numpy as np
from jaxtyping import Float

from icjax.capture._filters import HIGHEST_CUTOFF, lowpass, noise_gain, runs
from icjax.capture._sensors import SensorWrench
from icjax.capture._spec import ContactSpec

ONSET_SD, RELEASE_SD = 10.0, 5.0
"""Thresholds in standard deviations of the filtered force. Five is exceeded by noise once in 3.5 million independent
samples (a minute at 150 Hz has 18 000); the other five leave room for the slow drift of the baseline."""

LEAST_ONSET = 1e-3
"""N; no onset threshold is below this. A channel that was set to exactly zero while unloaded shows no noise to judge
by, and an ordinary force sensor does not resolve a milliNewton."""

LEAST_SHARE = 1e-3
"""No onset threshold is below this share of the trial's largest force. The filter rings before a step: the positive
side lobe of its step response is exp(-2 pi) / 2 = 0.09 % of the step, which must not count as a contact."""

LONGEST_EXTRAPOLATION = 0.005
"""s; how far onset may lie before the lower threshold is crossed."""


@dataclasses.dataclass(frozen=True)
class ForceCourse:
    """Force of a source that a contact shows in: along the surface normal where there is one, else its size.

    - `value` [S] N, filtered for event detection; `noise` N, its standard deviation when unloaded.
    - `onset`, `release`: thresholds, N.
    """

    time: Float[np.ndarray, " sample"]
    value: Float[np.ndarray, " sample"]
    noise: float
    onset: float
    release: float


def force_course(sensor: SensorWrench, cutoff: float, contact: ContactSpec) -> ForceCourse:
    """The course of the pressing force and the thresholds that its own noise asks for.

    Noise: standard deviation over the tare windows; without any, 1.4826 times the median absolute difference of
    successive samples over sqrt 2, times the gain of the filter on white noise. Thresholds: 10 and 5 of them,
    unless the session states its own; the upper one at least `LEAST_ONSET` and `LEAST_SHARE` of the largest force,
    the lower one half of it.
    """
    cutoff = min(cutoff, HIGHEST_CUTOFF * sensor.rate)
    filtered = lowpass(sensor.wrench[:, 3:], sensor.rate, cutoff)
    if sensor.pressing is not None:
        raw = sensor.pressing[:, 3]
        value = lowpass(raw, sensor.rate, cutoff)
    elif sensor.surface is not None:
        normal = np.array(sensor.surface.normal)
        value, raw = filtered @ normal, sensor.wrench[:, 3:] @ normal
    else:
        value = np.linalg.norm(filtered, axis=1)
        raw = sensor.wrench[:, 3]
    alone = sensor.surface is None and sensor.pressing is None
    if sensor.unloaded.sum() > 10:
        quiet = filtered[sensor.unloaded] if alone else value[sensor.unloaded][:, None]
        noise = float(np.sqrt(np.nanmean(np.nanvar(quiet, axis=0))))
    else:
        steps = np.abs(np.diff(raw))
        noise = 1.4826 * float(np.nanmedian(steps)) / np.sqrt(2) * noise_gain(sensor.rate, cutoff)
    onset = contact.onset
    if onset is None:
        onset = max(ONSET_SD * noise, LEAST_ONSET, LEAST_SHARE * float(np.max(value, initial=0.0)))
    release = contact.release
    if release is None:
        release = onset * RELEASE_SD / ONSET_SD
    return ForceCourse(time=sensor.time, value=value, noise=noise, onset=onset, release=release)


def contact_events(course: ForceCourse, contact: ContactSpec) -> list[tuple[float, float]]:
    """Intervals of contact (onset, release) in s; release is NaN where the recording ends in contact.

    A contact is a stretch above the lower threshold that reaches the upper one (hysteresis). Stretches separated by
    less than `contact.gap` are one contact; what is then shorter than `contact.shortest` is none. Times lie between
    samples: the straight line through the crossings of the two thresholds is followed back to zero force (the
    filter has no delay and keeps straight lines, so it widens a ramp symmetrically), by 5 ms at most.
    """
    value = course.value
    stretches = [
        (start, stop) for start, stop in runs(value > course.release) if value[start:stop].max() >= course.onset
    ]
    intervals = [_between_samples(course, value, start, stop) for start, stop in stretches]
    merged: list[tuple[float, float]] = []
    for onset, release in intervals:
        if merged and onset - merged[-1][1] < contact.gap:
            merged[-1] = (merged[-1][0], release)
        else:
            merged.append((onset, release))
    return [(a, b) for a, b in merged if np.isnan(b) or b - a >= contact.shortest]


def _between_samples(course: ForceCourse, value: np.ndarray, start: int, stop: int) -> tuple[float, float]:
    time = course.time
    high = start + np.flatnonzero(value[start:stop] >= course.onset)
    onset = time[0]
    if start > 0:
        low_time = _crossing(time, value, start - 1, course.release)
        high_time = _crossing(time, value, int(high[0]) - 1, course.onset) if high[0] > start else low_time
        onset = low_time - _reach(high_time - low_time, course)
    release = float("nan")
    if stop < len(value):
        low_time = _crossing(time, value, stop - 1, course.release)
        high_time = _crossing(time, value, int(high[-1]), course.onset) if high[-1] < stop - 1 else low_time
        release = low_time + _reach(low_time - high_time, course)
    return float(onset), float(release)


def _crossing(time: np.ndarray, value: np.ndarray, before: int, level: float) -> float:
    """Time at which the line between two samples reaches a level."""
    a, b = value[before], value[before + 1]
    share = 0.0 if a == b else float(np.clip((level - a) / (b - a), 0.0, 1.0))
    return float(time[before] + share * (time[before + 1] - time[before]))


def _reach(between: float, course: ForceCourse) -> float:
    """How far beyond the lower threshold zero force lies."""
    return min(max(between, 0.0) * course.release / (course.onset - course.release), LONGEST_EXTRAPOLATION)
