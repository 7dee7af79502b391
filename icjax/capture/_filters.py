"""Zero-phase low-pass filter."""

import numpy as np
from jaxtyping import Float

TWO_PASS = (2**0.5 - 1) ** 0.25
"""0.802: a second-order Butterworth filter applied forward and backward has its half-power frequency at this share
of its own."""

HIGHEST_CUTOFF = 0.38
"""Share of a rate up to which a cut-off is used: near one half the bilinear transform squeezes the pass band."""

REACH = 4.0
"""Periods of the cut-off after which the filter has forgotten a sample to 1e-9: exp(-2 pi 4 / (0.802 sqrt 2))."""


def lowpass(
    values: Float[np.ndarray, "sample *channel"], rate: float, cutoff: float
) -> Float[np.ndarray, "sample *channel"]:
    """Second-order Butterworth filter applied forward and backward: zero phase, half power at `cutoff` in the end.

    Its gain is real and known, so it is applied to the spectrum:

        G(f) = 1 / (1 + (0.802 tan(pi f / rate) / tan(pi cutoff / rate))^4),

    tan because frequencies are those of the bilinear transform, 0.802 because both passes together have the cut-off.

    Beyond its ends a record is continued by its point reflection about the first and the last sample, as the usual
    padding does. The filter has no delay and keeps straight lines. NaN samples stay NaN and do not spread: every finite
    run of a channel is filtered by itself.

    **Arguments**: `values` `[sample, ...]`; `rate` and `cutoff` in Hz.

    **Errors**: `ValueError` when the cut-off reaches half the sampling rate.

    **Source**: Winter 2009, Biomechanics and Motor Control of Human Movement, section 3.4.4.2.
    """
    if not 0 < cutoff < rate / 2:
        raise ValueError(f"cutoff {cutoff:g} Hz is too high for the rate {rate:g} Hz (it must be below half of it)")
    relative = cutoff / rate
    flat = np.array(values, dtype=float).reshape(len(values), -1)
    whole = np.all(np.isfinite(flat), axis=0)
    for channel in range(flat.shape[1]):
        for start, stop in [(0, len(flat))] if whole[channel] else finite_runs(flat[:, channel]):
            if stop - start > 2:
                flat[start:stop, channel] = _filtered(flat[start:stop, channel], relative)
    return flat.reshape(np.shape(values))


def finite_runs(values: Float[np.ndarray, " sample"]) -> list[tuple[int, int]]:
    """Intervals [start, stop) of finite samples."""
    return runs(np.isfinite(values))


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Intervals [start, stop) in which a mask is true."""
    edges = np.diff(np.concatenate([[0], np.asarray(mask, dtype=np.int8), [0]]))
    return list(zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True))


def noise_gain(rate: float, cutoff: float) -> float:
    """Standard deviation of white noise after `lowpass`, relative to before: sqrt of the mean of G^2 over frequency."""
    return float(np.sqrt(np.mean(_gain(np.linspace(0.0, 0.5, 20001), cutoff / rate) ** 2)))


def _gain(frequency: np.ndarray, cutoff: float) -> np.ndarray:
    """G of `lowpass`, both in units of the rate."""
    return 1.0 / (1.0 + (TWO_PASS * np.tan(np.pi * frequency) / np.tan(np.pi * cutoff)) ** 4)


def _filtered(values: np.ndarray, cutoff: float) -> np.ndarray:
    """`values` taken off the line through its ends, continued to one period, filtered, and put back on the line."""
    line = np.linspace(values[0], values[-1], len(values))
    half = values - line
    beyond = -half[-2:0:-1]
    reach = int(np.ceil(REACH / cutoff))
    if len(beyond) > 2 * reach:
        # Between the two continuations nothing is felt: as many zeros as make a length that transforms fast.
        length = len(half) + 2 * reach
        filling = np.zeros(-length % 2 ** (length.bit_length() - 4))
        beyond = np.concatenate([beyond[:reach], filling, beyond[-reach:]])
    period = np.concatenate([half, beyond])
    spectrum = np.fft.rfft(period) * _gain(np.fft.rfftfreq(len(period)), cutoff)
    return line + np.fft.irfft(spectrum, len(period))[: len(values)]
