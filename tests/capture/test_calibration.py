"""Calibration of a model made wrong on purpose: it comes back as well as the stated standard deviations say."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.capture import CalibrationOptions, calibrate_model
from icjax.capture._bundle import Bundle, Data, normal_equations, schur
from icjax.capture._calibration_parameters import calibration_parameters, changed_model
from icjax.capture._posture import no_prior
from icjax.model import index_finger, integrate, neutral, site_positions

MODEL = index_finger(0.19, "free")
SITES = tuple(range(len(MODEL.site_names)))
PLACEMENT, NOISE = 0.001, 0.0002
OPTIONS = CalibrationOptions(("rom",), lengths=0.05, axes=0.03, frames=60)
PARAMETERS = calibration_parameters(MODEL, SITES, PLACEMENT, OPTIONS)


def movement(frames=400):
    """Strokes of all joints through most of their range, on a forearm that turns."""
    time = np.linspace(0.0, 6.0, frames)
    dq = np.zeros((frames, MODEL.nv))
    dq[:, :3] = 0.1 * np.sin(time)[:, None]
    phases = 2 * time[:, None] * np.array([1, 1.3, 1.7, 2.1]) + np.arange(4)
    dq[:, 6:] = np.array([0, 0.3, 0.6, 0.4]) + np.array([0.6, 0.5, 0.5, 0.4]) * np.sin(phases)
    return np.asarray(jax.jit(jax.vmap(lambda d: integrate(MODEL, neutral(MODEL), d)))(jnp.asarray(dq)))


def recorded(model, q, seed):
    clean = np.asarray(jax.jit(jax.vmap(lambda item: site_positions(model, item)))(jnp.asarray(q)))
    return clean + NOISE * np.random.default_rng(seed).normal(size=clean.shape)


@pytest.fixture(scope="module")
def drawn():
    """A subject drawn from the priors, and its calibration."""
    z = np.random.default_rng(5).normal(size=len(PARAMETERS.names))
    subject = jax.tree.map(np.asarray, changed_model(MODEL, SITES, PARAMETERS, jnp.asarray(z)))
    q = movement()
    return z * PARAMETERS.prior_sd, calibrate_model(MODEL, SITES, (recorded(subject, q, 6),), PLACEMENT, OPTIONS)


def test_errors_are_as_large_as_stated(drawn):
    truth, found = drawn
    assert found.converged
    error = found.value - truth
    # 61 parameters: chi-square over their number has a standard deviation of sqrt(2 / 61) = 0.18.
    assert 0.5 < error @ np.linalg.solve(found.covariance, error) / len(error) < 1.6
    # The noise of 60 x 48 measurements is known to 2 %.
    np.testing.assert_allclose(found.marker_sd, NOISE, rtol=0.06)
    assert found.residual_after < 0.3 * found.residual_before


def test_lengths_along_the_finger_and_flexion_axes_are_found(drawn):
    truth, found = drawn
    for name, least in (("length hand", 0.005), ("length proximal", 0.01), ("length middle", 0.02)):
        index = found.names.index(name)
        assert found.determined[index], name
        assert found.sd[index] < least
        assert abs(found.value[index] - truth[index]) < 3 * found.sd[index]
    assert found.determined[found.names.index("axis PIP 1")]


def test_a_turn_of_the_distal_cluster_stays_unknown_and_is_the_offset(drawn):
    _, found = drawn
    assert not found.determined[found.names.index("length distal")]
    offset = np.degrees(np.sqrt(np.diag(found.offset_covariance)))[6:]
    # DP1 and DP3 are 1 mm (prior) beside their places and 11 mm apart: 1 mm sqrt(3) / 14 mm is some 3 degrees at the
    # most. Between the joints distances tell the rest: far below a degree.
    assert 1.0 < offset[3] < 4.0
    assert offset[1] < 0.3


def test_what_the_recordings_do_not_say_stays_at_the_model(drawn):
    """A joint that stays at zero says nothing of the direction of its axis; one that stays bent would, a little."""
    _, found = drawn
    q = movement().copy()
    q[:, 9] = 0.0
    held = calibrate_model(MODEL, SITES, (recorded(MODEL, q, 1),), PLACEMENT, OPTIONS)
    rows = [held.names.index(f"axis PIP {number}") for number in (1, 2)]
    assert not held.determined[rows].any()
    assert np.all(np.abs(held.value[rows]) < held.prior_sd[rows])
    assert np.all(held.sd[rows] > 0.8 * held.prior_sd[rows])
    assert np.all(found.sd[rows] < 0.5 * held.prior_sd[rows])


def test_the_reduced_system_solves_the_whole_one():
    """Schur complement against a dense solve of all blocks; equal but for rounding."""
    q = movement()[:360:6]
    x = recorded(MODEL, q, 2)
    data = Data(jnp.asarray(x), jnp.ones(x.shape[:2]), no_prior(MODEL), jnp.asarray(0.001))
    z = 0.3 * np.random.default_rng(3).normal(size=len(PARAMETERS.names))
    blocks = normal_equations(MODEL, SITES, PARAMETERS, Bundle(jnp.asarray(q), jnp.asarray(z)), data)
    dq, dz, _ = schur(blocks, jnp.asarray(0.0))
    n, p, frames = MODEL.nv, len(z), len(q)
    dense = np.zeros((frames * n + p, frames * n + p))
    for f in range(frames):
        dense[f * n : (f + 1) * n, f * n : (f + 1) * n] = blocks.A[f]
        dense[f * n : (f + 1) * n, frames * n :] = blocks.B[f]
        dense[frames * n :, f * n : (f + 1) * n] = np.asarray(blocks.B[f]).T
    dense[frames * n :, frames * n :] = blocks.C
    right = np.concatenate([np.asarray(blocks.a).ravel(), np.asarray(blocks.c)])
    expected = -np.linalg.solve(dense, right)
    np.testing.assert_allclose(np.concatenate([np.asarray(dq).ravel(), dz]), expected, rtol=1e-6, atol=1e-9)


def test_the_gradient_is_that_of_the_cost():
    """Analytic normal equations against central differences of the cost along random directions."""
    q = movement()[:360:6]
    x = recorded(MODEL, q, 2)
    data = Data(jnp.asarray(x), jnp.ones(x.shape[:2]), no_prior(MODEL), jnp.asarray(0.001))
    random = np.random.default_rng(4)
    z = 0.3 * random.normal(size=len(PARAMETERS.names))
    blocks = normal_equations(MODEL, SITES, PARAMETERS, Bundle(jnp.asarray(q), jnp.asarray(z)), data)
    moved = jax.jit(jax.vmap(lambda a, b: integrate(MODEL, a, b)))
    step = 1e-5
    for _ in range(3):
        dq, dz = random.normal(size=(len(q), MODEL.nv)), random.normal(size=len(z))
        costs = [
            float(
                normal_equations(
                    MODEL, SITES, PARAMETERS, Bundle(moved(q, s * step * dq), jnp.asarray(z + s * step * dz)), data
                ).cost
            )
            for s in (1, -1)
        ]
        slope = 2 * (float(np.sum(np.asarray(blocks.a) * dq)) + float(np.asarray(blocks.c) @ dz))
        # Second differences leave step^2 times the third derivative: 1e-10 of the slope, rounding 1e-8.
        np.testing.assert_allclose((costs[0] - costs[1]) / (2 * step), slope, rtol=1e-5)
