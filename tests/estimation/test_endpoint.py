"""Eq. 5 and k_G: closed forms, displacement under load, several contacts, derivatives, intervals."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from derivatives import check_derivatives
from hand_made import COMPLIANCE, LENGTHS, chain

from icjax.estimation import directional_stiffness, endpoint_compliance, in_series, stiffness_interval
from icjax.model import pad_positions

ROUNDING = 1e-12
"""Relative; sums of a dozen products."""

MODEL = chain()
Q = np.array([0.3, 0.5, 0.4])
TIP = len(MODEL.body_names) - 1
PADS = eqx.filter_jit(pad_positions)
POINT = np.asarray(PADS(MODEL, jnp.asarray(Q)))[0]
UP = (0.0, 0.0, 1.0)


def levers(q):
    """Horizontal distance of the tip from each hinge of the planar chain: the only lever of a vertical force."""
    pitch = np.cumsum(q)
    x = np.concatenate([[0.0], np.cumsum(np.asarray(LENGTHS) * np.cos(pitch))])
    return x[-1] - x[:-1]


def test_vertical_stiffness_is_that_of_the_levers():
    c = np.sum(np.asarray(COMPLIANCE) * levers(Q) ** 2)
    k = directional_stiffness(MODEL, Q, TIP, POINT, np.asarray(COMPLIANCE))
    np.testing.assert_allclose(float(k), 1 / c, rtol=ROUNDING)
    found = stiffness_interval(MODEL, Q, TIP, POINT, np.asarray(COMPLIANCE), np.zeros(3))
    np.testing.assert_allclose(found.share, np.asarray(COMPLIANCE) * levers(Q) ** 2 / c, rtol=ROUNDING)
    assert found.lower == pytest.approx(found.stiffness, rel=ROUNDING) == found.upper


def test_the_point_moves_by_g_times_force():
    """Eq. 6 against the kinematics themselves, for a force small enough that J is constant."""
    force = 1e-6 * np.array([0.3, 0.0, 1.0])
    G = np.asarray(endpoint_compliance(MODEL, Q, TIP, POINT, np.asarray(COMPLIANCE)))
    J = np.asarray(jax.jit(jax.jacfwd(lambda q: pad_positions(MODEL, q)[0]))(jnp.asarray(Q)))
    moved = np.asarray(PADS(MODEL, jnp.asarray(Q + np.asarray(COMPLIANCE) * (J.T @ force))))[0] - POINT
    np.testing.assert_allclose(G @ force, moved, rtol=0, atol=1e-6 * np.abs(moved).max())  # the force's own size
    np.testing.assert_allclose(G, G.T, atol=ROUNDING * G.max())
    assert np.linalg.eigvalsh(G).min() > -ROUNDING * G.max()


def test_several_contacts_are_coupled_through_shared_joints():
    """Two points on one finger: the blocks on the diagonal are those of each alone, the others are J_1 C J_2^T."""
    second = POINT - np.array([0.01, 0.0, 0.0])
    full = np.diag(COMPLIANCE) + 0.1 * (np.ones((3, 3)) - np.eye(3))
    G = np.asarray(endpoint_compliance(MODEL, Q, (TIP, TIP - 1), np.stack([POINT, second]), full))
    assert G.shape == (6, 6)
    for rows, body, point in ((slice(0, 3), TIP, POINT), (slice(3, 6), TIP - 1, second)):
        alone = np.asarray(endpoint_compliance(MODEL, Q, body, point, full))
        np.testing.assert_allclose(G[rows, rows], alone, rtol=0, atol=ROUNDING * G.max())
    assert np.abs(G[:3, 3:]).max() > 0.1 * G.max()
    np.testing.assert_allclose(G, G.T, atol=ROUNDING * G.max())
    branched = chain(branches=2)
    tips = np.asarray(PADS(branched, jnp.asarray(np.tile(Q, 2))))
    apart = np.asarray(endpoint_compliance(branched, np.tile(Q, 2), branched.pad_bodies, tips, np.tile(COMPLIANCE, 2)))
    np.testing.assert_array_equal(apart[:3, 3:], 0.0)


def test_numbers_of_bodies_and_points_must_agree():
    with pytest.raises(ValueError, match="1 bodies, point has 2 points"):
        endpoint_compliance(MODEL, Q, TIP, np.stack([POINT, POINT]), np.asarray(COMPLIANCE))


def test_derivatives():
    """With respect to posture and compliance, diagonal and full."""

    def both(x):
        q, C = x[:3], x[3:]
        G = endpoint_compliance(MODEL, q, TIP, POINT, C)
        full = jnp.diag(C) + 0.1 * jnp.outer(C, C)
        k = directional_stiffness(MODEL, q, TIP, POINT, full, (0.6, 0.0, 0.8))
        return jnp.concatenate([100 * G.reshape(-1), k[None] / 100])

    check_derivatives(both, np.concatenate([Q, COMPLIANCE]), tolerance=1e-7)  # curvatures of some tens


def test_first_order_interval_agrees_with_samples():
    """10 % in C and 2 degrees in q. A log-normal of 10 % moves the quantiles of c by 1.5 %, curvature in q by 1 %."""
    sd = 0.1 * np.asarray(COMPLIANCE)
    found = stiffness_interval(
        MODEL, Q, TIP, POINT, np.asarray(COMPLIANCE), sd, np.radians(2) ** 2 * np.eye(3), samples=20000
    )
    assert found.lower < found.stiffness < found.upper
    np.testing.assert_allclose(
        [found.sampled_lower, found.sampled_median, found.sampled_upper],
        [found.lower, found.stiffness, found.upper],
        rtol=0.03,
    )


def test_the_interval_is_not_symmetric_and_may_be_unbounded():
    wide = stiffness_interval(MODEL, Q, TIP, POINT, np.asarray(COMPLIANCE), np.asarray(COMPLIANCE))
    assert wide.upper == np.inf
    assert 0 < wide.lower < wide.stiffness
    unknown = stiffness_interval(MODEL, Q, TIP, POINT, np.asarray(COMPLIANCE), np.array([np.inf, 0, 0]))
    assert (unknown.lower, unknown.upper) == (0.0, np.inf)
    with pytest.raises(ValueError, match="finite"):
        stiffness_interval(MODEL, Q, TIP, POINT, np.asarray(COMPLIANCE), np.array([np.inf, 0, 0]), samples=10)


def test_pad_in_series():
    assert in_series(in_series(100.0, 1 / 750), -1 / 750) == pytest.approx(100.0)
    assert in_series(750.0, 1 / 750) == pytest.approx(375.0)
