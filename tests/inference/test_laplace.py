"""Intervals: those of linear regression, and none where nothing is known."""

import jax.numpy as jnp
import numpy as np
import pytest

from icjax.inference import interval, jacobian, laplace


def test_linear_regression():
    J = np.random.default_rng(1).normal(size=(20, 3))
    found = laplace(J, np.zeros((0, 3)))
    np.testing.assert_allclose(found.covariance, np.linalg.inv(J.T @ J), rtol=1e-10)
    assert found.determined.all()
    np.testing.assert_allclose(found.learned, 1.0)


def test_a_prior_adds():
    J, P = np.array([[2.0, 0.0]]), np.diag([1.0, 4.0])
    found = laplace(J, P)
    np.testing.assert_allclose(found.sd, [5**-0.5, 0.25])
    np.testing.assert_allclose(found.learned, [0.8, 0.0], atol=1e-12)


def test_blind_directions_have_no_interval():
    """Only the sum of the first two is seen."""
    J = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 2.0], [1.0, 1.0, 1.0]])
    found = laplace(J, np.zeros((0, 3)))
    assert list(found.determined) == [False, False, True]
    assert found.sd[2] == pytest.approx(np.linalg.inv(np.array([[2.0, 1.0], [1.0, 5.0]]))[1, 1] ** 0.5)
    np.testing.assert_allclose(np.abs(found.blind[:, 0]), [0.5**0.5, 0.5**0.5, 0.0], atol=1e-12)
    assert np.isnan(found.correlation[0]).all()
    low, high = interval(np.zeros(3), found.sd)
    assert np.isinf(low[0])
    assert high[2] == pytest.approx(1.959964 * found.sd[2])


def test_fewer_rows_than_numbers():
    found = laplace(np.array([[1.0, 0.0]]), np.zeros((0, 2)))
    assert list(found.determined) == [True, False]


def test_jacobian_in_batches():
    def function(x):
        return jnp.stack([x[0] * x[1], jnp.sin(x[2]), x[1] ** 2, x[0]])

    x = jnp.array([1.0, 2.0, 0.3])
    expected = np.array([[2.0, 1.0, 0.0], [0.0, 0.0, np.cos(0.3)], [0.0, 4.0, 0.0], [1.0, 0.0, 0.0]])
    np.testing.assert_allclose(jacobian(function, x, batch=2), expected, atol=1e-14)
