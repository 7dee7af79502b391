"""m, b, k, f0 of a simulated one-degree-of-freedom system on a platform that jumps, at the recorded noise level."""

import numpy as np
import pytest

from icjax.estimation import fit_second_order, pool_fits
from icjax.estimation._path import path_basis

TRUE = np.array([0.017, 2.04, 89.16, 0.677])
"""Table 2 of Kry and Pai 2006, exploring."""
STEP, FORCE_NOISE, ONE_MARKER, CALIBRATED = 0.002, 0.01, 0.2e-3, 2e-6
"""500 Hz, 10 mN, 0.2 mm; a platform whose path is known to 2 um from calibration."""

SPLINE = 0.02
"""Largest relative error of m, b or k without noise, over 60 ms: what the spline cannot follow."""


def platform(s, height):
    """A released spring of 25 Hz, damping ratio 0.9: displacement, velocity, acceleration."""
    w, damping = 2 * np.pi * 25, 0.9
    wd = w * np.sqrt(1 - damping**2)
    on, s = s >= 0, np.maximum(s, 0)
    decay = height * np.exp(-damping * w * s)
    z = on * (height - decay * (np.cos(wd * s) + damping * w / wd * np.sin(wd * s)))
    v = on * decay * w * w / wd * np.sin(wd * s)
    return z, v, on * (w * w * (height - z) - 2 * damping * w * v)


def trial(random, position_noise=0.0, force_noise=0.0):
    """Time, position, force; the release falls anywhere between two samples, the caller knows it to a sample."""
    time = np.arange(-0.2, 0.15, STEP)
    onset = random.uniform(0, STEP)
    z, v, a = platform(time - onset, random.uniform(0.005, 0.007))
    force = TRUE[0] * a + TRUE[1] * v + TRUE[2] * z + TRUE[3]
    z = z + position_noise * random.standard_normal(len(time))
    return time, z, force + force_noise * random.standard_normal(len(time)), round(onset / STEP) * STEP


def fits(count, window, noise, method="path"):
    random = np.random.default_rng(2)
    return tuple(
        fit_second_order(
            *trial(random, noise, FORCE_NOISE), window, method=method, position_noise=noise, force_noise=FORCE_NOISE
        )
        for _ in range(count)
    )


def test_recovered_without_noise():
    found = fit_second_order(*trial(np.random.default_rng(0)), 0.06, position_noise=ONE_MARKER, force_noise=FORCE_NOISE)
    np.testing.assert_allclose(found.value, TRUE, rtol=SPLINE)
    assert found.r_squared > 0.9999


def test_two_percent_in_one_window_where_the_path_of_the_platform_is_known():
    """60 ms; over 200 trials the standard deviations are 0.7 % (second_order_accuracy.json), so 2 % is 2.8 of them."""
    for found in fits(4, 0.06, CALIBRATED):
        np.testing.assert_allclose(found.value, TRUE, rtol=0.02)
        half = (found.upper - found.lower) / 2
        assert (half[:3] < 0.03 * TRUE[:3]).all()


def test_two_percent_with_markers_needs_many_trials_and_the_intervals_say_so():
    """The bound of one trial is above 2 % for m and b; the pooled error is within the pooled interval."""
    found = fits(40, 0.06, ONE_MARKER)
    single = np.mean([np.sqrt(np.diag(fit.covariance)) for fit in found], axis=0) / TRUE
    assert single[0] > 0.05
    assert single[1] > 0.03
    pooled, covariance = pool_fits(found)
    assert (np.abs(pooled - TRUE) < 2.6 * np.sqrt(np.diag(covariance))).all()  # 1 % of samples lie beyond
    assert abs(pooled[2] / TRUE[2] - 1) < 0.02  # k needs 16 trials
    covered = np.mean([(fit.lower <= TRUE) & (fit.upper >= TRUE) for fit in found], axis=0)
    assert (covered > 0.84).all()  # of 40, 95 % less three standard deviations of the count


def test_differentiating_is_biased_whatever_the_noise():
    """The sliding polynomial flattens the sudden acceleration; the path method sees the same data."""
    clean = trial(np.random.default_rng(0))
    derivative = fit_second_order(*clean, 0.06, method="derivative", position_noise=ONE_MARKER, force_noise=0.01)
    assert derivative.value[0] > 1.3 * TRUE[0]
    assert derivative.r_squared < 0.9


def test_differentiating_a_slow_movement_is_right():
    """Where nothing is abrupt both methods agree with the truth (the polynomial's error at 3 Hz is below 1 %)."""
    time = np.arange(-0.1, 0.4, STEP)
    w = 2 * np.pi * 3
    on = time >= 0
    z, v, a = (on * x for x in (1 - np.cos(w * time), w * np.sin(w * time), w * w * np.cos(w * time)))
    m, b, k, f0 = 0.5, 2.0, 90.0, 0.6
    force = 0.01 * (m * a + b * v + k * z) + f0
    found = fit_second_order(
        time, 0.01 * z, force, 0.0, 0.3, method="derivative", position_noise=1e-5, force_noise=1e-3
    )
    np.testing.assert_allclose(found.value, [m, b, k, f0], rtol=0.02)


def test_intervals_widen_with_autocorrelated_residuals():
    random = np.random.default_rng(4)
    time, z, force, onset = trial(random, CALIBRATED, 0.0)
    noise = FORCE_NOISE * random.standard_normal(len(time))
    slow = np.convolve(noise, np.ones(6) / np.sqrt(6), "same")
    settings = {"window": 0.09, "position_noise": CALIBRATED, "force_noise": FORCE_NOISE}
    white = fit_second_order(time, z, force + noise, onset, **settings)
    coloured = fit_second_order(time, z, force + slow, onset, **settings)
    assert coloured.autocorrelation > 0.3 > white.autocorrelation
    assert (coloured.upper - coloured.lower)[2] > 1.3 * (white.upper - white.lower)[2]


def test_gaps_in_the_position():
    time, z, force, onset = trial(np.random.default_rng(0), CALIBRATED)
    z[104:106] = np.nan
    found = fit_second_order(time, z, force, onset, 0.06, position_noise=1e-5, force_noise=FORCE_NOISE)
    np.testing.assert_allclose(found.value, TRUE, rtol=SPLINE)
    with pytest.raises(ValueError, match="gaps"):
        fit_second_order(time, z, force, onset, 0.06, method="derivative")


def test_clear_errors():
    time, z, force, onset = trial(np.random.default_rng(0), ONE_MARKER, FORCE_NOISE)
    with pytest.raises(ValueError, match="window = 0.004"):
        fit_second_order(time, z, force, onset, 0.004)
    with pytest.raises(ValueError, match="nothing to pool"):
        pool_fits(())
    force[100] = np.nan
    with pytest.raises(ValueError, match="force is not finite at"):
        fit_second_order(time, z, force, onset)


def test_the_basis_integrates_itself():
    """v and z are the integrals of a: differences of the splines, to the truncation of a step of 10 us."""
    basis = path_basis(0.06)
    s = np.array([0.003, 0.011, 0.03, 0.055])
    step = 1e-5
    ahead, behind, here = basis.matrices(s + step), basis.matrices(s - step), basis.matrices(s)
    np.testing.assert_allclose((ahead.z - behind.z) / (2 * step), here.v, atol=1e-7)
    np.testing.assert_allclose((ahead.v - behind.v) / (2 * step), here.a, atol=1e-3)
    assert not np.any(basis.matrices(-s).z)
