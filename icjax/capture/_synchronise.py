"""The one place where the analog rate and the marker rate meet."""

import numpy as np
from jaxtyping import Float

from icjax.capture._filters import HIGHEST_CUTOFF, finite_runs, lowpass
from icjax.capture._sensors import SensorWrench


def on_marker_clock(
    sensor: SensorWrench, marker_time: Float[np.ndarray, " frame"], cutoff: float
) -> Float[np.ndarray, "frame 6"]:
    """The wrench of a source at the times of the marker frames.

    Forces keep their own rate up to here (`SensorChannels` holds them so). They are low-pass filtered at their own
    rate, which is also what keeps the resampling free of aliases, and then interpolated by cubic splines; frames
    outside the force recording, or in one of its gaps, are NaN. The filter has no phase and therefore adds no
    delay between force and movement; both clocks count from the same instant (`MotionFile`).

    **Arguments**: `sensor`; `marker_time` s; `cutoff` Hz, limited to 0.38 of either rate.
    """
    return resampled(sensor.wrench, sensor.time, sensor.rate, marker_time, cutoff)


def resampled(
    values: Float[np.ndarray, "sample channel"],
    time: Float[np.ndarray, " sample"],
    rate: float,
    marker_time: Float[np.ndarray, " frame"],
    cutoff: float,
) -> Float[np.ndarray, "frame channel"]:
    """Channels filtered at their own rate and interpolated to the frames, see `on_marker_clock`."""
    from scipy.interpolate import CubicSpline

    marker_rate = (len(marker_time) - 1) / float(marker_time[-1] - marker_time[0])
    cutoff = min(cutoff, HIGHEST_CUTOFF * rate, HIGHEST_CUTOFF * marker_rate)
    filtered = lowpass(values, rate, cutoff)
    result = np.full((len(marker_time), values.shape[1]), np.nan)
    slack = 0.5 / rate
    for start, stop in finite_runs(filtered.sum(axis=1)):
        span = time[start:stop]
        inside = (marker_time >= span[0] - slack) & (marker_time <= span[-1] + slack)
        if stop - start > 3:
            result[inside] = CubicSpline(span, filtered[start:stop])(np.clip(marker_time[inside], span[0], span[-1]))
    return result
