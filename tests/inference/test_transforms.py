"""Transforms are one-to-one, differentiable, and refuse what lies outside their range."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.inference import Cholesky, Identity, Log, Logistic, Softplus, Synergies, Tied, tied

SPD = np.array([[2.0, 0.3, -0.1], [0.3, 1.0, 0.2], [-0.1, 0.2, 0.5]])
CASES = [
    (Identity(), np.array([0.3, -2.0])),
    (Log(), np.array([0.3, 2.0])),
    (Softplus(0.1), np.array([0.01, 3.0])),
    (Logistic(-1.0, 2.0), np.array([-0.9, 1.99])),
    (Tied((0, 1, 0)), np.array([0.3, 2.0, 0.3])),
    (Cholesky(3), SPD),
    (Cholesky(3, (0.5, 1.0, 2.0)), SPD),
]


@pytest.mark.parametrize(("transform", "value"), CASES, ids=lambda x: type(x).__name__)
def test_there_and_back(transform, value):
    x = transform.free(value)
    assert x.shape == (transform.size(value),)
    np.testing.assert_allclose(transform.value(x), value, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(("transform", "value"), CASES, ids=lambda x: type(x).__name__)
def test_derivatives(transform, value):
    x = transform.free(value) + 0.1
    forward, reverse = jax.jacfwd(transform.value)(x), jax.jacrev(transform.value)(x)
    h = 1e-6
    steps = h * jnp.eye(len(x))
    central = jnp.stack([(transform.value(x + d) - transform.value(x - d)) / (2 * h) for d in steps], axis=-1)
    np.testing.assert_allclose(forward, reverse, atol=1e-12)
    np.testing.assert_allclose(forward, central, rtol=1e-7, atol=1e-8)


def test_synergies_are_compliances():
    S = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    transform = Synergies(S)
    x = transform.free(SPD)
    C = np.asarray(transform.value(jnp.asarray(x).at[0].set(0.0)))
    assert np.linalg.eigvalsh(C).min() > 0
    np.testing.assert_allclose(C, C.T)
    assert C[0, 1] == pytest.approx(1.0)


def test_labels_make_groups():
    assert tied(np.array(["thumb", "index", "thumb"])).groups == (0, 1, 0)


@pytest.mark.parametrize(
    ("transform", "value"),
    [
        (Log(), np.array([1.0, 0.0])),
        (Softplus(), np.array([-1.0])),
        (Logistic(0.0, 1.0), np.array([1.0])),
        (Cholesky(2), np.array([[1.0, 2.0], [2.0, 1.0]])),
        (Log(), np.array([np.nan])),
    ],
)
def test_out_of_range(transform, value):
    with pytest.raises(ValueError, match="must be"):
        transform.free(value)


def test_bad_bounds_and_groups():
    with pytest.raises(ValueError, match="bounds"):
        Logistic(1.0, 0.0)
    with pytest.raises(ValueError, match="without a gap"):
        Tied((0, 2))


def test_shapes_and_scales_that_cannot_be_meant():
    with pytest.raises(ValueError, match="scale = 0.0: must be above zero"):
        Softplus(0.0)
    with pytest.raises(ValueError, match=r"shape \(2,\) for 3 groups"):
        Tied((0, 1, 1)).free(np.ones(2))
    with pytest.raises(ValueError, match="for a matrix of order 3"):
        Cholesky(3).free(np.eye(2))
    with pytest.raises(ValueError, match="must be symmetric"):
        Cholesky(2).free(np.array([[1.0, 0.9], [0.0, 1.0]]))
