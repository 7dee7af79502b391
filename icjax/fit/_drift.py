"""Where the trial would have drifted from what was expected, judged by the movement before contact."""

from typing import NamedTuple

import numpy as np

from icjax.fit._contacts import unexplained
from icjax.fit._result import SessionFit
from icjax.typing import Float


class Drift(NamedTuple):
    """Of every window at its compared samples, rad; NaN past a window's end.

    - `mean` [window, sample, joint]: trial less what was expected less predicted deviation, expected from what it was
      before the contact (there it is what it was). `sd`: of what that leaves open, zero before.
    """

    mean: Float[np.ndarray, "window sample joint"]
    sd: Float[np.ndarray, "window sample joint"]


def drift(fit: SessionFit, residual: Float[np.ndarray, "window sample joint"]) -> Drift:
    """What `DynamicEquilibrium` expects, given the samples that no contact has touched.

    With K = L L^T the covariance of y = difference - e in the order of time and r = L^-1 y its `residual`, the rows
    after contact have the mean L21 r1 and the covariance L22 L22^T given those before. What contacts without
    repetitions have in common (`Common`) is part of the mean.
    """
    measurement = fit.made.problem.measurements[0]
    shape = residual.shape
    common = np.zeros(shape)
    if measurement.common is not None:
        rows = measurement.common.plain(np.nan_to_num(residual).ravel())
        common = measurement.common.expected(rows).reshape(shape)
        residual = rows.reshape(shape) - common
    mean, sd = np.full(shape, np.nan), np.full(shape, np.nan)
    for number, window in enumerate(fit.made.windows):
        rate = fit.made.motions[window.trial].recording.rate
        count = len(window.samples)
        by_before, left = unexplained(np.asarray(measurement.whitening)[number], window, rate, shape[2])
        known = by_before.shape[1]
        own, shared = residual[number, :count].ravel(), common[number, :count].ravel()
        mean[number, :count] = (by_before @ (own + shared)[:known] + left @ shared).reshape(count, -1)
        sd[number, :count] = np.linalg.norm(left, axis=1).reshape(count, -1)
    return Drift(mean, sd)
