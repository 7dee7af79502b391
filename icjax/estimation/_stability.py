"""The rule by which estimates over several windows and degrees agree or do not."""

from typing import NamedTuple

import numpy as np

from icjax.estimation._contact_compliance import ACCEPTED, NEGATIVE, NOT_EXCITED
from icjax.typing import Float, Int

SPREAD = 0.5
"""Most robust spread over the choices, as a share of the median."""
USABLE = 0.5
"""Least share of the choices that must give an estimate."""


class Verdict(NamedTuple):
    """Whether one event's estimates of one joint agree, and why not."""

    stable: bool
    reason: str


def judge(
    compliance: Float[np.ndarray, "window degree"],
    standard_error: Float[np.ndarray, "window degree"],
    status: Int[np.ndarray, "window degree"],
    torque_change: Float[np.ndarray, "window degree"],
) -> Verdict:
    """Verdict on one event and joint. The first that applies, with n the number of choices:

    1. *too few samples*, *not excited*: fewer than half of the n give an estimate; the commoner cause is named.
    2. *negative*: the median is negative and so are three quarters of the estimates (Figure 8).
    3. *changes sign*: estimates of both signs, neither being fewer than a tenth.
    4. *undetermined*: the median standard error exceeds the median estimate.
    5. *spread*: s = 1.4826 median |C - median C| exceeds half the median estimate. With e the median standard
       error, the sentence says whether the errors of the fits explain that (s <= e: the data are too few or too
       noisy) or not (s > e: the choice decides). The estimates share samples, so noise alone spreads them less.
    6. *stable* otherwise.

    The limits are conventions (a factor of two is the effect of the task that the paper reports, so an estimate
    that moves by half its value with an arbitrary choice cannot show it); none was fitted to a known answer.
    """
    choices = status.size
    used = (status == ACCEPTED) | (status == NEGATIVE)
    count = int(used.sum())
    if count < USABLE * choices:
        idle = int(np.sum(status == NOT_EXCITED))
        if idle >= choices - count - idle:
            known = torque_change[np.isfinite(torque_change)]
            largest = f": the torque changes by {1e3 * known.max():.2g} mNm at most" if known.size else ""
            return Verdict(False, f"not excited for {idle} of {choices} choices{largest}")
        return Verdict(False, f"too few samples for {choices - count - idle} of {choices} choices")
    values, errors = compliance[used], standard_error[used]
    median, error = float(np.median(values)), float(np.median(errors))
    negative = int(np.sum(values < 0))
    if median < 0 and negative >= 0.75 * count:
        return Verdict(False, f"negative for {negative} of {count} choices, median {median:.2g} rad/Nm")
    if min(negative, count - negative) >= 0.1 * count:
        span = f"{values.min():.2g} to {values.max():.2g} rad/Nm"
        return Verdict(False, f"changes sign with the window or degree: {negative} of {count} negative, {span}")
    if error > abs(median):
        return Verdict(False, f"undetermined: median {median:.2g} rad/Nm with a standard error of {error:.2g}")
    spread = 1.4826 * float(np.median(np.abs(values - median)))
    told = f"{median:.2g} rad/Nm, spread {spread:.2g}, standard error {error:.2g}, over {count} choices"
    if spread > SPREAD * abs(median):
        cause = "more than its errors explain" if spread > error else "which its errors explain"
        return Verdict(False, f"spread over windows and degrees, {cause}: {told}")
    return Verdict(True, f"stable: {told}")
