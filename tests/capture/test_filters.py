"""The zero-phase filter: its cut-off, its phase, its noise, and gaps."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from icjax.capture._filters import lowpass, noise_gain, runs

RATE = 500.0
TIME = np.arange(4000) / RATE


def gain_and_shift(frequency, cutoff):
    """Amplitude and phase of a filtered sine, from the middle of a long record."""
    filtered = lowpass(np.sin(2 * np.pi * frequency * TIME), RATE, cutoff)
    middle = slice(1000, 3000)
    basis = np.stack([np.sin(2 * np.pi * frequency * TIME), np.cos(2 * np.pi * frequency * TIME)], axis=1)[middle]
    a, b = np.linalg.lstsq(basis, filtered[middle], rcond=None)[0]
    return np.hypot(a, b), np.arctan2(b, a)


@pytest.mark.parametrize("cutoff", [6.0, 20.0, 60.0, 200.0])
def test_the_cutoff_is_the_half_power_frequency_of_both_passes(cutoff):
    gain, shift = gain_and_shift(cutoff, cutoff)
    # Exact but for what the ends of the record still send to its middle, 2 s away.
    assert abs(gain - np.sqrt(0.5)) < 1e-6
    assert abs(shift) < 1e-6


def test_straight_lines_pass_unchanged():
    line = np.stack([0.3 + 2.0 * TIME, -TIME], axis=1)
    # The line is taken off before and put back after; rounding remains.
    np.testing.assert_allclose(lowpass(line, RATE, 20.0), line, atol=1e-9)


def test_gaps_stay_gaps_and_touch_nothing_else():
    rng = np.random.default_rng(0)
    whole = rng.normal(size=(600, 2))
    broken = whole.copy()
    broken[200:210, 1] = np.nan
    filtered = lowpass(broken, RATE, 20.0)
    np.testing.assert_array_equal(np.isnan(filtered), np.isnan(broken))
    np.testing.assert_array_equal(filtered[:, 0], lowpass(whole, RATE, 20.0)[:, 0])
    np.testing.assert_array_equal(filtered[:200, 1], lowpass(whole[:200, 1], RATE, 20.0))
    np.testing.assert_array_equal(filtered[210:, 1], lowpass(whole[210:, 1], RATE, 20.0))


def test_short_pieces_are_filtered_without_complaint():
    values = np.full(12, np.nan)
    values[[1, 4, 5, 8, 9, 10]] = 1.0
    np.testing.assert_allclose(lowpass(values, RATE, 20.0), values, atol=1e-12)


def test_noise_gain_is_that_of_filtered_noise():
    noise = np.random.default_rng(1).normal(size=(20000, 20))
    for cutoff in (20.0, 60.0, 150.0):
        # 400 000 samples with the correlation of a 20 Hz band: better than one percent.
        np.testing.assert_allclose(lowpass(noise, 1000.0, cutoff).std(), noise_gain(1000.0, cutoff), rtol=0.02)


def test_a_cutoff_above_the_rate_is_refused():
    with pytest.raises(ValueError, match="cutoff 250 Hz is too high for the rate 500 Hz"):
        lowpass(TIME, RATE, 250.0)


def test_runs_are_half_open_intervals():
    assert runs(np.array([True, True, False, True])) == [(0, 2), (3, 4)]
    assert runs(np.zeros(3, bool)) == []


def test_the_filter_is_the_recursive_one_forward_and_backward():
    values = np.cumsum(np.random.default_rng(2).normal(size=(3001, 2)), axis=0)
    for cutoff in (6.0, 20.0, 150.0):
        one_pass = 2 / np.pi * np.arctan(np.tan(np.pi * cutoff / RATE) / (2**0.5 - 1) ** 0.25)
        expected = sosfiltfilt(butter(2, one_pass, output="sos"), values, axis=0, padtype="odd", padlen=1000)
        # The ends differ by what each method lets leak round the corner of its padding.
        np.testing.assert_allclose(lowpass(values, RATE, cutoff)[50:-50], expected[50:-50], atol=1e-7)
