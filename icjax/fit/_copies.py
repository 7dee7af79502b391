"""Is one recording a copy of another, cut or rounded otherwise?"""

import numpy as np

from icjax.recording import Recording

COPIED = 1e-5
"""rad; recordings that agree so are copies: markers are known to a tenth of a millimetre at best."""

STRETCH = 50
"""Frames by which one is sought in the other."""


def copied(one: Recording, other: Recording) -> bool:
    """Whether two hold the same angles as far as both go, from whatever frame on: no two measurements agree so."""
    first, second = np.asarray(one.q, float), np.asarray(other.q, float)
    if first.shape[1:] != second.shape[1:]:
        return False
    return _agree(first, second) or any(
        _agree(first[max(lag, 0) :], second[max(-lag, 0) :]) for lag in (_lag(first, second), -_lag(second, first))
    )


def _agree(one: np.ndarray, other: np.ndarray) -> bool:
    count = min(len(one), len(other))
    one, other = one[:count], other[:count]
    if np.any(np.abs(one - other) > COPIED) or count == 0:
        return False
    return bool(np.array_equal(np.isnan(one), np.isnan(other)))


def _lag(one: np.ndarray, other: np.ndarray) -> int:
    """Frames by which `one` must be moved so that the stretch of `other` that moves most is most alike."""
    if len(one) < STRETCH or len(other) < STRETCH:
        return 0
    moved = np.nan_to_num(np.abs(np.diff(other, axis=0)).sum(axis=1))
    total = np.cumsum(np.concatenate([[0.0], moved]))
    begin = int(np.argmax(total[STRETCH - 1 :] - total[: len(total) - STRETCH + 1]))
    apart = np.zeros(len(one) - STRETCH + 1)
    for row in range(0, STRETCH, 10):
        apart += np.abs(one[row : row + len(apart)] - other[begin + row]).sum(axis=1)
    apart[np.isnan(apart)] = np.inf
    return int(np.argmin(apart)) - begin
