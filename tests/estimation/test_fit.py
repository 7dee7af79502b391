"""Polynomials about a contact: exact on polynomials, and errors that are as large as they claim."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from icjax.estimation._fit import correlated_noise, fit_rise, fit_slope_change, fit_variance

BEFORE, AFTER = np.arange(-50, 1) / 500.0, np.arange(1, 51) / 500.0


@pytest.mark.parametrize("degree", [1, 2])
def test_polynomials_are_recovered(degree):
    a, b, c = [0.3, 1.5, -4.0][: degree + 1], [0.3, -0.7, 9.0][: degree + 1], [0.0, 0.4, 2.0][: degree + 1]
    poly = np.polynomial.polynomial.polyval
    fit = fit_slope_change(BEFORE, poly(BEFORE, a), AFTER, poly(AFTER, b), degree)
    np.testing.assert_allclose(fit.before, a, atol=1e-11)
    np.testing.assert_allclose(fit.after, b, atol=1e-11)
    assert fit.change == pytest.approx(b[1] - a[1], abs=1e-11)
    assert fit.change_se < 1e-10
    assert min(fit.r_squared) > 1 - 1e-12
    rise = fit_rise(AFTER, poly(AFTER, c), degree)
    np.testing.assert_allclose(rise.coefficients, c, atol=1e-12)
    assert rise.slope_se < 1e-11


def test_slope_error_of_white_noise_in_closed_form():
    """A line through the origin on n points: se = sd / sqrt(sum s^2). The stated variance is a floor."""
    flat = np.zeros_like(AFTER)
    fit = fit_slope_change(BEFORE, np.zeros_like(BEFORE), AFTER, flat, 1, variance=0.01**2)
    s = np.concatenate([BEFORE, AFTER])
    design = np.stack([np.ones_like(s), np.where(s > 0, 0, s), np.where(s > 0, s, 0)], axis=1)
    covariance = np.linalg.inv(design.T @ design) * 0.01**2
    contrast = np.array([0, -1, 1])
    assert fit.change_se == pytest.approx(np.sqrt(contrast @ covariance @ contrast), rel=1e-10)
    alternating = np.where(np.arange(50) % 2 == 0, 1.0, -1.0)
    rise = fit_rise(AFTER, alternating, 1)
    residual = alternating - rise.coefficients[1] * AFTER
    expected = np.sqrt(residual @ residual / 49 / (AFTER @ AFTER))
    assert rise.slope_se == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_standard_errors_cover(degree, rho):
    """95 % intervals of the slope change, white and first-order correlated noise, 600 repetitions.

    Counting error of 600 repetitions: 3 sd = 2.7 %. White noise may over-cover a little, because the serial
    correlation is not allowed below zero.
    """
    random = np.random.default_rng(7)
    hits, repetitions = 0, 600
    for _ in range(repetitions):
        white = random.standard_normal(len(BEFORE) + len(AFTER) + 100)
        noise = np.zeros_like(white)
        for k in range(1, len(white)):
            noise[k] = rho * noise[k - 1] + white[k]
        noise = noise[100:] * 1e-3
        fit = fit_slope_change(
            BEFORE, 0.2 * BEFORE + noise[: len(BEFORE)], AFTER, 0.9 * AFTER + noise[len(BEFORE) :], degree
        )
        hits += abs(fit.change - 0.7) <= 1.96 * fit.change_se
    assert 0.90 <= hits / repetitions <= 0.98


def test_r_squared_of_a_constant():
    constant = np.full_like(AFTER, 0.3)
    fit = fit_slope_change(BEFORE, np.full_like(BEFORE, 0.3), AFTER, constant, 1)
    assert fit.r_squared == (1.0, 1.0)


def test_variance_of_a_fit():
    """No parameters: the mean square, and (1 + rho) / (1 - rho) = 5 of it, bounded by one sample in three."""
    assert fit_variance(2, np.zeros(5)) == (0.0, 0.0)
    assert fit_variance(2, np.zeros(5), least=0.1) == (0.1, 0.1)
    assert fit_variance(0, np.array([1.0, -1.0, 1.0])) == (1.0, 1.0)
    assert fit_variance(0, np.array([1.0, 1.0, 1.0])) == pytest.approx((1.0, 3.0))
    assert fit_variance(0, np.array([1.0, 1.0, 1.0]), least=2.0) == pytest.approx((2.0, 6.0))


def test_noise_is_told_from_a_course_that_the_polynomial_cannot_follow():
    """A rise that saturates: the line misses it by 20 %, yet the noise found is the 1e-3 that was added.

    Second differences of 1000 samples: 5 % is about 1.5 standard deviations of the estimate.
    """
    s = np.arange(1, 1001) / 10000.0
    noisy = np.tanh(s / 0.05) + 1e-3 * np.random.default_rng(2).standard_normal(len(s))
    rise = fit_rise(s, noisy, 1)
    assert rise.noise == pytest.approx(1e-3, rel=0.05)
    assert rise.slope_noise < rise.slope_se / 10


def test_filtered_noise_is_no_excitation():
    """Noise after the 60 Hz force filter looks smooth: its second differences show a sixth of it."""
    rate, sd, window = 500.0, 0.003, 50
    random = np.random.default_rng(5)
    white = random.normal(size=200 * window)
    sos = butter(2, 60.0 / 0.802 / (rate / 2), output="sos")
    noise = sosfiltfilt(sos, white)
    noise *= sd / noise.std()
    s = np.arange(1, window + 1) / rate
    called = {"shown": 0, "stated": 0}
    for piece in noise.reshape(-1, window):
        rise = fit_rise(s, piece, 2)
        change = abs(np.polynomial.polynomial.polyval(s[-1], rise.coefficients))
        for kind, stated in (("shown", 0.0), ("stated", sd)):
            level, slope = correlated_noise(rise, stated)
            called[kind] += change > max(3 * level, 1e-3) and abs(rise.slope) > 3 * slope
    assert called["shown"] > 0.2 * 200  # what the samples alone show is far too little
    assert called["stated"] <= 0.02 * 200
