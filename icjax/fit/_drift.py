"""Where the trial would have drifted from its repetitions, judged by the movement before contact."""

from typing import NamedTuple

import numpy as np

from icjax.fit._result import SessionFit
from icjax.fit._session import SMEAR
from icjax.typing import Float


class Drift(NamedTuple):
    """Of every window at its compared samples, rad; NaN past a window's end.

    - `mean` [window, sample, joint]: trial less repetitions less predicted deviation, expected from what it was before
      the contact (there it is what it was). `sd`: of what that leaves open, zero before.
    """

    mean: Float[np.ndarray, "window sample joint"]
    sd: Float[np.ndarray, "window sample joint"]


def drift(fit: SessionFit, residual: Float[np.ndarray, "window sample joint"]) -> Drift:
    """What `DynamicEquilibrium` expects of repetitions, given the samples that no contact has touched.

    With K = L L^T the covariance of y = difference - e in the order of time and r = L^-1 y its `residual`, the rows
    after contact have the mean L21 r1 and the covariance L22 L22^T given those before.
    """
    measurement = fit.made.problem.measurements[0]
    shape = residual.shape
    mean, sd = np.full(shape, np.nan), np.full(shape, np.nan)
    for number, window in enumerate(fit.made.windows):
        motion, count = fit.made.motions[window.trial], len(window.samples)
        used = count * shape[2]
        factor = np.tril(np.linalg.inv(np.asarray(measurement.whitening)[number, :used, :used]))
        known = int(np.sum(window.samples - window.onset <= -SMEAR * motion.recording.rate)) * shape[2]
        rows = residual[number, :count].ravel()
        open_part = factor.copy()
        open_part[:, :known] = 0.0
        mean[number, :count] = (factor[:, :known] @ rows[:known]).reshape(count, -1)
        sd[number, :count] = np.linalg.norm(open_part, axis=1).reshape(count, -1)
    return Drift(mean, sd)
