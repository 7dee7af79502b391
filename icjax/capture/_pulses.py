"""Rising edges of a sync channel, between samples."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

LOW, HIGH = 0.3, 0.7
"""A pulse begins when the channel rises through 70 % of its range after it was below 30 % (so noise starts none)."""

FLAT = 0.1
"""A sample closer to either level than this share of the range lies beside the edge and not in it."""

CLEAR = 6.0
"""The two levels are further apart than so many standard deviations of the noise about them."""


class Edges(NamedTuple):
    """Rising edges.

    - `time` s: interpolated crossing of half the range.
    - `before`, `after` s: the samples next to the crossing. `resolved`: whether a sample fell into the edge itself,
      so that the interpolation means something; otherwise the edge is anywhere between the two.
    - `began_high`: the channel begins within a pulse, whose edge is not among these.
    """

    time: Float[np.ndarray, " edge"]
    before: Float[np.ndarray, " edge"]
    after: Float[np.ndarray, " edge"]
    resolved: Bool[np.ndarray, " edge"]
    began_high: bool = False


def rising_edges(channel: Float[np.ndarray, " sample"], time: Float[np.ndarray, " sample"]) -> Edges:
    """The rising edges of a two-level channel. **Errors**: `ValueError` when the channel has no two levels."""
    finite = channel[np.isfinite(channel)]
    if not len(finite) or finite.max() == finite.min():
        raise ValueError("never changes")
    low, high = _levels(finite)
    share = (channel - low) / (high - low)
    upper = finite > (low + high) / 2
    noise = max(float(np.median(np.abs(finite[upper] - high))), float(np.median(np.abs(finite[~upper] - low))))
    if high - low < CLEAR * 1.4826 * noise:
        raise ValueError("has no two levels; it looks like noise")
    rises, armed = [], False
    settled = np.flatnonzero((share < LOW) | (share > HIGH))
    for index in settled.tolist():
        if share[index] < LOW:
            armed = True
        elif armed:
            rises.append(_crossing(share, index))
            armed = False
    before = np.array(rises, dtype=int)
    a, b = share[before], share[before + 1]
    step = time[before + 1] - time[before]
    inside = ((a > FLAT) & (a < 1 - FLAT)) | ((b > FLAT) & (b < 1 - FLAT))
    crossing = time[before] + step * np.where(inside, (0.5 - a) / (b - a), 0.5)
    return Edges(
        time=crossing,
        before=time[before],
        after=time[before + 1],
        resolved=inside,
        began_high=bool(share[settled[0]] > HIGH),
    )


def _crossing(share: np.ndarray, index: int) -> int:
    """Last sample below one half before a rise."""
    while not share[index - 1] < 0.5:
        index -= 1
    return index - 1


def _levels(values: np.ndarray) -> tuple[float, float]:
    """Medians below and above their own middle, iterated (a spike moves neither)."""
    low, high = float(values.min()), float(values.max())
    for _ in range(20):
        above = values > (low + high) / 2
        if not above.any() or above.all():
            break
        low, high = float(np.median(values[~above])), float(np.median(values[above]))
    return low, high
