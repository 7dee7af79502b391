"""Repetitions of a movement as a process: what is learnt of it from how they differ."""

import numpy as np
import pytest

from icjax.capture import lowpass
from icjax.fit._variability import FAST, SLOW, Curve, Variability, covariance, learn, matern

S = np.arange(-31, 13) * 0.008
STATED = np.radians([[0.15, 0.0], [0.0, 0.2]]) ** 2
TRUTH = Variability(np.radians([[0.05, 0.1], [0.3, 0.35]]), np.array([0.7, 0.9]), 1.0)


def filtered_noise() -> np.ndarray:
    """Correlation between samples of white noise behind the filter of a recording."""
    impulse = np.zeros(2048)
    impulse[1024] = 1.0
    response = np.abs(np.fft.rfft(lowpass(impulse, 500.0, 20.0))) ** 2
    power = np.fft.irfft(response)
    at = np.round(np.abs(S[:, None] - S[None, :]) * 500.0).astype(int)
    return power[at] / power[0]


RHO = filtered_noise()


def curves(count, generator):
    factor = np.linalg.cholesky(2.0 * covariance(S, TRUTH, STATED, RHO).reshape(2 * len(S), -1))
    still = (np.zeros((len(S), 2)),) * 2
    return [Curve(S, (factor @ generator.standard_normal(2 * len(S))).reshape(len(S), 2), still) for _ in range(count)]


def test_noise_and_tremor_are_told_apart():
    """A recording that states too much noise: what is left over is not taken from the tremor."""
    found = learn(curves(60, np.random.default_rng(5)), STATED, [RHO] * 60, 0.015)
    np.testing.assert_allclose(found.noise, TRUTH.noise, atol=0.05)
    np.testing.assert_allclose(found.amplitude, TRUTH.amplitude, rtol=0.25)
    assert found.inflation < 1.05


def test_the_gradient_of_the_evidence_is_right():
    """The hyperparameters found are a maximum: none of its neighbours is likelier."""
    drawn = curves(12, np.random.default_rng(6))
    found = learn(drawn, STATED, [RHO] * 12, 0.015)
    lag = S[:, None] - S[None, :]
    kernels = np.stack([matern(lag, FAST), matern(lag, SLOW), STATED[1, 1] * RHO])

    def cost(x):
        K = 2.0 * np.tensordot(np.exp(2.0 * x), kernels, 1) + 1e-12 * np.eye(len(S))
        prior = (x - np.log([*np.radians([0.05, 0.2]), 1.0])) / np.array([np.log(5.0), np.log(5.0), 0.3])
        told = [y.difference[:, 1] @ np.linalg.solve(K, y.difference[:, 1]) for y in drawn]
        return 0.5 * (np.sum(told) + len(drawn) * np.linalg.slogdet(K)[1] + prior @ prior)

    best = np.log([*found.amplitude[:, 1], found.noise[1]])
    slope = [(cost(best + h) - cost(best - h)) / 2e-4 for h in 1e-4 * np.eye(3)]
    assert np.max(np.abs(slope)) < 0.05


def test_nothing_to_learn_from():
    with pytest.raises(ValueError, match="no stretch in which"):
        learn([], STATED, [], 0.015)


def test_doubt_is_how_far_estimates_scatter():
    """Of 60 sets of eight differences: logarithms miss the truth by what the covariances say, the slow process's apart
    (its amplitude is the prior's where so few say little)."""
    generator = np.random.default_rng(8)
    missed, stated = [], []
    for _ in range(60):
        found = learn(curves(8, generator), STATED, [RHO] * 8, 0.015)
        for joint in range(2):
            pairs = (
                (found.amplitude[:, joint], TRUTH.amplitude[:, joint]),
                (found.noise[[joint]], TRUTH.noise[[joint]]),
            )
            missed.append(np.log(np.concatenate([a / b for a, b in pairs])))
            stated.append(np.diagonal(found.doubt[joint]))
    ratio = np.mean(np.square(missed), axis=0) / np.mean(stated, axis=0)
    assert np.all(ratio > 0.5)
    assert np.all(ratio < 1.6)


def test_moved():
    found = TRUTH.moved(1, np.log([2.0, 3.0, 0.5]))
    np.testing.assert_allclose(found.amplitude, TRUTH.amplitude * [[1.0, 2.0], [1.0, 3.0]])
    np.testing.assert_allclose(found.noise, TRUTH.noise * [1.0, 0.5])
