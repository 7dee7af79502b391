"""Repetitions of a movement without contact (catch trials), laid over the trial by the movement before contact."""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from icjax.typing import Float

LONGEST_SHIFT = 4.0
"""Standard deviations of the shift within which a repetition is looked for."""

LONGEST_GAP = 0.02
"""s; in a longer gap between frames of a repetition its angles are not known. Markers are filtered at about 20 Hz."""

UNLIKE = np.radians(1.0), 0.5
"""rad, and of the trial's movement before contact: root mean square by which a repetition differs from it, means of
each joint left out; where it is more than both, it is none."""


class Repetition(NamedTuple):
    """A repetition on the trial's samples.

    - `angle`, `rate` [sample, dof]: its angles there and their derivative by the shift, rad/s; NaN beyond its ends and
      in gaps.
    - `shift`: s, by which it was read later.
    - `trials`: how many trials it is a repetition of.
    """

    angle: Float[np.ndarray, "sample dof"]
    rate: Float[np.ndarray, "sample dof"]
    shift: float
    trials: int = 1


def aligned(
    time: Float[np.ndarray, " frame"],
    repetition: Float[np.ndarray, "frame dof"],
    at: Float[np.ndarray, " sample"],
    angle: Float[np.ndarray, "sample dof"],
    before: np.ndarray,
    noise: Float[np.ndarray, " dof"],
    shift_sd: float,
) -> Repetition:
    """The repetition shifted in time to agree best with the trial before contact.

    The shift d minimises sum ((x(t + d) - q(t)) / sd)^2 + (d / shift_sd)^2 over the samples before contact, mean
    differences of each joint left out (what varies slowly is no matter of timing). A search on a grid of 2 ms is
    followed by Gauss-Newton steps.

    **Arguments**: `time` s and `repetition` rad of the whole repetition (four frames at least); `at` s and `angle` of
    the trial's samples; `before` [sample] which of them are free of contact; `noise` rad a joint; `shift_sd` s.
    """
    spline = make_interp_spline(time, repetition, k=3)
    slope = spline.derivative()
    when, wanted = at[before], angle[before]

    def cost(shift: float) -> float:
        difference = spline(when + shift) - wanted
        difference = (difference - difference.mean(axis=0)) / noise
        return float(np.sum(difference**2)) / len(when) + (shift / shift_sd) ** 2 / len(when)

    reach = LONGEST_SHIFT * shift_sd
    low = max(-reach, float(time[0] - when[0])) if len(when) else 0.0
    grid = np.arange(max(low, -reach), reach + 1e-9, 0.002)
    shift = 0.0
    if len(when) > 3 and len(grid):
        shift = float(grid[np.argmin([cost(item) for item in grid])])
        for _ in range(5):
            difference, rate = spline(when + shift) - wanted, slope(when + shift)
            difference, rate = ((x - x.mean(axis=0)) / noise for x in (difference, rate))
            gradient = np.sum(difference * rate) + shift / shift_sd**2
            shift -= float(np.clip(gradient / (np.sum(rate**2) + shift_sd**-2), -0.002, 0.002))
    read = np.clip(at + shift, time[0], time[-1])
    right = np.clip(np.searchsorted(time, read), 1, len(time) - 1)
    apart = time[right] - time[right - 1]
    inside = (read == at + shift) & (apart <= max(LONGEST_GAP, 1.5 * float(np.diff(time).min())))
    return Repetition(
        np.where(inside[:, None], spline(read), np.nan), np.where(inside[:, None], slope(read), np.nan), shift
    )


def alike(
    trial: Float[np.ndarray, "sample dof"], repetition: Float[np.ndarray, "sample dof"], before: np.ndarray
) -> bool:
    """Whether a repetition laid over a trial holds its movement as far as both are free of contact (`UNLIKE`)."""
    moved, apart = (x - x.mean(axis=0) for x in (trial[before], (repetition - trial)[before]))
    return bool(np.std(apart) < max(UNLIKE[0], UNLIKE[1] * np.std(moved)))
