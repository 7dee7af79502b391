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
    from scipy.interpolate import CubicSpline

    marker_rate = (len(marker_time) - 1) / float(marker_time[-1] - marker_time[0])
    cutoff = min(cutoff, HIGHEST_CUTOFF * sensor.rate, HIGHEST_CUTOFF * marker_rate)
    filtered = lowpass(sensor.wrench, sensor.rate, cutoff)
    result = np.full((len(marker_time), 6), np.nan)
    slack = 0.5 / sensor.rate
    for start, stop in finite_runs(filtered.sum(axis=1)):
        time = sensor.time[start:stop]
        inside = (marker_time >= time[0] - slack) & (marker_time <= time[-1] + slack)
        if stop - start > 3:
            result[inside] = CubicSpline(time, filtered[start:stop])(np.clip(marker_time[inside], time[0], time[-1]))
    return result
