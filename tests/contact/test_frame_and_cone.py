"""The contact frame and the polyhedral cone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from icjax.contact import contact_frame, friction_cone, gauge

ROUNDING = 4e-15  # a few products of numbers of order one
AXES = [sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
JUMP = np.array([np.sqrt(0.75), 0.0, -0.5])  # on the circle n_z = -1/2


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_frame_is_right_handed_and_orthonormal(seed):
    normal = np.random.default_rng(seed).normal(size=3)
    normal /= np.linalg.norm(normal)
    frame = np.asarray(contact_frame(normal))
    np.testing.assert_array_equal(frame[:, 0], normal)
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=ROUNDING)
    np.testing.assert_allclose(np.linalg.det(frame), 1.0, atol=ROUNDING)


def test_frame_and_its_derivative_at_every_special_normal():
    """All axes, both poles and the circle where the tangents jump: orthonormal, derivative bounded."""
    for normal in [*AXES, JUMP]:
        frame = np.asarray(contact_frame(normal))
        np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=ROUNDING)
        forward, reverse = jax.jacfwd(contact_frame)(normal), jax.jacrev(contact_frame)(normal)
        np.testing.assert_allclose(forward, reverse, atol=ROUNDING)
        assert np.max(np.abs(forward)) <= 4.0  # 1 / (1/2)^2, from the divisor's lower bound


def test_cone_of_the_paper():
    """Unit columns, opposite pairs, E = (0, -1, ...), F = (mu, -1, ...)."""
    frame = np.asarray(contact_frame(np.array([0.6, 0.0, 0.8])))
    cone = friction_cone(frame[None], np.array([0.7]), 3)
    D = np.asarray(cone.D[0])
    assert D.shape == (3, 7)
    np.testing.assert_allclose(np.linalg.norm(D, axis=0), 1.0, atol=ROUNDING)
    np.testing.assert_allclose(D[:, 1::2], -D[:, 2::2], atol=ROUNDING)
    np.testing.assert_allclose(frame[:, 0] @ D[:, 1:], 0.0, atol=ROUNDING)
    np.testing.assert_array_equal(cone.E[0], [0] + [-1] * 6)
    np.testing.assert_array_equal(cone.F[0], [0.7] + [-1] * 6)


@pytest.mark.parametrize("facets", [2, 3, 4])
def test_gauge(facets):
    """One at the corners and along the edges, and homogeneous."""
    corner = 2 * np.pi * np.arange(2 * facets) / (2 * facets)
    points = np.stack([np.cos(corner), np.sin(corner)], axis=1)
    edges = 0.3 * points + 0.7 * np.roll(points, 1, axis=0)
    for point in (*points, *edges):
        np.testing.assert_allclose(gauge(jnp.asarray(2.5 * point), facets), 2.5, atol=ROUNDING)
    assert float(gauge(jnp.zeros(2), facets)) == 0.0


def test_too_few_facets():
    with pytest.raises(ValueError, match="facets"):
        friction_cone(np.eye(3)[None], np.ones(1), 1)
