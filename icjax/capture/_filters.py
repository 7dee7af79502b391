"""Zero-phase low-pass filter."""

import numpy as np
from jaxtyping import Float

TWO_PASS = (2**0.5 - 1) ** 0.25
"""0.802: a second-order Butterworth filter applied forward and backward has its half-power frequency at this share
of its own."""

HIGHEST_CUTOFF = 0.38
"""Share of a rate up to which a cut-off is used: near one half the bilinear transform squeezes the pass band."""


def lowpass(
    values: Float[np.ndarray, "sample *channel"], rate: float, cutoff: float
) -> Float[np.ndarray, "sample *channel"]:
    """Butterworth filter of second order, forward and backward, with the stated cut-off *after* both passes.

    The gain of the two passes together is 1/sqrt 2 at `cutoff`, so each pass is designed for cutoff / 0.802 (the
    division is made in tan(pi f / rate), the frequency of the bilinear transform). The filter has no delay and keeps
    straight lines. NaN samples stay NaN and do not spread: every finite run of a channel is filtered by itself.

    **Arguments**: `values` `[sample, ...]`; `rate` and `cutoff` in Hz.

    **Errors**: `ValueError` when the cut-off reaches half the sampling rate.

    **Source**: Winter 2009, Biomechanics and Motor Control of Human Movement, section 3.4.4.2.
    """
    from scipy.signal import butter

    if not 0 < cutoff < rate / 2:
        raise ValueError(f"cutoff {cutoff:g} Hz is too high for the rate {rate:g} Hz (it must be below half of it)")
    relative = 2 / np.pi * np.arctan(np.tan(np.pi * cutoff / rate) / TWO_PASS)
    sos = np.asarray(butter(2, relative, output="sos"))
    flat = np.array(values, dtype=float).reshape(len(values), -1)
    pad = int(np.ceil(3 * rate / cutoff))
    whole = np.isfinite(flat).all(axis=0)
    if len(flat) > 1 and whole.any():
        flat[:, whole] = _both_ways(sos, flat[:, whole], pad)
    for channel in np.flatnonzero(~whole):
        for start, stop in finite_runs(flat[:, channel]):
            if stop - start > 1:
                flat[start:stop, channel] = _both_ways(sos, flat[start:stop, channel : channel + 1], pad)[:, 0]
    return flat.reshape(np.shape(values))


def finite_runs(values: Float[np.ndarray, " sample"]) -> list[tuple[int, int]]:
    """Intervals [start, stop) of finite samples."""
    return runs(np.isfinite(values))


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Intervals [start, stop) in which a mask is true."""
    edges = np.diff(np.concatenate([[0], np.asarray(mask, dtype=np.int8), [0]]))
    return list(zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True))


def noise_gain(rate: float, cutoff: float) -> float:
    """Standard deviation of white noise after `lowpass`, relative to before: sqrt of the mean of |H|^2 over frequency.

    |H|^2 = 1 / (1 + (f / f_1)^4)^2 for the two passes, f_1 the cut-off of one, f as the bilinear transform measures it.
    """
    f = np.linspace(0.0, rate / 2, 20001)
    w = np.tan(np.pi * f[:-1] / rate) / np.tan(np.pi * cutoff / rate) * TWO_PASS
    return float(np.sqrt(np.mean(1.0 / (1.0 + w**4) ** 2)))


def _both_ways(sos: np.ndarray, values: np.ndarray, pad: int) -> np.ndarray:
    from scipy.signal import sosfiltfilt

    return sosfiltfilt(sos, values, axis=0, padtype="odd", padlen=min(pad, len(values) - 1))
