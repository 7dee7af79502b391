"""Levenberg-Marquardt over a batch: closed forms, other people's code, and what it does when data are missing."""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix

from icjax.inference import covariance, least_squares
from icjax.results import RESULTS
from icjax.spatial import rotation_exp

EXACT = 1e-9
"""Linear problems: a few damped steps at rounding, scaled by condition numbers below 1e3."""

AGREE = 1e-7
"""Two iterations that stop at steps of 1e-8 from either side of the same minimum."""


def solved(solution):
    return np.asarray(jax.vmap(lambda item: item == RESULTS.solved)(solution.result))


def decay(x, d):
    time, value = d
    return x[0] * jnp.exp(-x[1] * time) + x[2] - value


def decays(count=20):
    rng = np.random.default_rng(1)
    x = rng.uniform([1, 0.5, -1], [3, 2, 1], (count, 3))
    time = np.tile(np.linspace(0, 4, 30), (count, 1))
    value = x[:, :1] * np.exp(-x[:, 1:2] * time) + x[:, 2:] + 0.01 * rng.normal(size=time.shape)
    return jnp.asarray(x), (jnp.asarray(time), jnp.asarray(value))


def test_a_linear_problem_has_the_solution_of_the_normal_equations():
    rng = np.random.default_rng(0)
    A, b = rng.normal(size=(7, 12, 4)), rng.normal(size=(7, 12))
    found = least_squares(lambda x, d: d[0] @ x - d[1], np.zeros((7, 4)), (jnp.asarray(A), jnp.asarray(b)), nv=4)
    for i in range(7):
        np.testing.assert_allclose(found.value.value[i], np.linalg.lstsq(A[i], b[i], rcond=None)[0], atol=EXACT)
        np.testing.assert_allclose(found.value.information[i], A[i].T @ A[i], atol=EXACT)
    assert solved(found).all()


def test_curved_problems_agree_with_optimistix():
    x, data = decays()
    ours = least_squares(decay, jnp.ones_like(x), data, nv=3)
    solver = optimistix.LevenbergMarquardt(rtol=1e-10, atol=1e-10)
    for i in range(len(x)):
        theirs = optimistix.least_squares(decay, solver, jnp.ones(3), (data[0][i], data[1][i]), max_steps=500)
        np.testing.assert_allclose(ours.value.value[i], theirs.value, atol=AGREE)
    assert float(jnp.max(ours.stats["residual"])) < 1e-7


def test_a_batch_is_its_problems_one_by_one():
    x, data = decays(6)
    together = least_squares(decay, jnp.ones_like(x), data, nv=3).value.value
    single = jax.jit(lambda data: least_squares(decay, jnp.ones((1, 3)), data, nv=3).value.value[0])
    for i in range(len(x)):
        np.testing.assert_allclose(together[i], single((data[0][i : i + 1], data[1][i : i + 1])), atol=AGREE)


def test_rotations_are_found_on_their_manifold():
    """Registration of points has a closed form, the polar factor of their covariance."""
    rng = np.random.default_rng(2)
    points = rng.normal(size=(9, 5, 3))
    turned = np.stack([np.asarray(rotation_exp(jnp.asarray(w))) for w in rng.normal(size=(9, 3))])
    images = np.einsum("bij,bkj->bki", turned, points) + 0.05 * rng.normal(size=points.shape)

    def residual(R, d):
        return (d[0] @ R.reshape(3, 3).T - d[1]).reshape(-1)

    def retract(R, w):
        return (R.reshape(3, 3) @ rotation_exp(w)).reshape(-1)

    start = np.tile(np.eye(3).reshape(-1), (9, 1))
    found = least_squares(residual, start, (jnp.asarray(points), jnp.asarray(images)), nv=3, retract=retract)
    for i in range(9):
        U, _, Vt = np.linalg.svd(images[i].T @ points[i])
        expected = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
        np.testing.assert_allclose(found.value.value[i].reshape(3, 3), expected, atol=AGREE)


def test_stated_normal_equations_change_nothing():
    x, data = decays(5)

    def normal_equations(x, d):
        e = jnp.exp(-x[1] * d[0])
        r, J = decay(x, d), jnp.stack([e, -x[0] * d[0] * e, jnp.ones_like(e)], axis=1)
        return r @ r, J.T @ J, J.T @ r

    by_forward_mode = least_squares(decay, jnp.ones_like(x), data, nv=3)
    stated = least_squares(None, jnp.ones_like(x), data, nv=3, normal_equations=normal_equations)
    np.testing.assert_allclose(stated.value.value, by_forward_mode.value.value, atol=EXACT)


def test_masked_data_are_absent_data_and_what_they_leave_open_stays():
    rng = np.random.default_rng(3)
    A, b = rng.normal(size=(1, 12, 3)), rng.normal(size=(1, 12))
    w = np.ones((1, 12))
    w[0, 4:] = 0
    data = tuple(jnp.asarray(item) for item in (A, b, w))
    found = least_squares(lambda x, d: d[2] * (d[0] @ x - d[1]), np.zeros((1, 3)), data, nv=3)
    np.testing.assert_allclose(found.value.value[0], np.linalg.lstsq(A[0, :4], b[0, :4], rcond=None)[0], atol=EXACT)
    A[:, :, 1] = 0.0
    data = tuple(jnp.asarray(item) for item in (A, b, w))
    start = np.array([[0.0, 0.7, 0.0]])
    found = least_squares(lambda x, d: d[2] * (d[0] @ x - d[1]), start, data, nv=3)
    assert float(found.value.value[0, 1]) == 0.7
    assert solved(found).all()


def test_failure_is_a_status_of_the_one_problem_that_fails():
    x, data = decays(3)
    value = data[1].at[1, 0].set(jnp.nan)
    found = least_squares(decay, jnp.ones_like(x), (data[0], value), nv=3)
    np.testing.assert_array_equal(solved(found), [True, False, True])
    invalid = jax.vmap(lambda item: item == RESULTS.invalid_input)(found.result)
    np.testing.assert_array_equal(invalid, [False, True, False])
    early = least_squares(decay, jnp.ones_like(x), data, nv=3, max_steps=1)
    assert not solved(early).any()


def test_single_precision_converges():
    x, data = decays(5)
    single = tuple(item.astype(jnp.float32) for item in data)
    found = least_squares(decay, jnp.ones((5, 3), jnp.float32), single, nv=3)
    exact = least_squares(decay, jnp.ones((5, 3)), data, nv=3)
    assert found.value.value.dtype == jnp.float32
    assert solved(found).all()
    # Condition number of these J^T J (a few hundred) times the rounding of float32.
    np.testing.assert_allclose(found.value.value, exact.value.value, atol=1e-4)


def test_covariance_is_that_of_repeated_experiments():
    rng = np.random.default_rng(4)
    A = np.tile(rng.normal(size=(1, 10, 3)), (4000, 1, 1))
    b = 0.1 * rng.normal(size=(4000, 10))
    fit = least_squares(lambda x, d: d[0] @ x - d[1], np.zeros((4000, 3)), (jnp.asarray(A), jnp.asarray(b)), nv=3)
    stated, determined = covariance(fit.value.information[:1], 0.01, 100.0)
    observed = np.cov(np.asarray(fit.value.value).T)
    # 4 000 repetitions give variances to sqrt(2 / 4000) = 2.2 %; four of these.
    np.testing.assert_allclose(observed, stated[0], atol=0.09 * float(jnp.max(stated)))
    assert bool(determined[0])


def test_covariance_of_what_the_data_do_not_see_is_the_weak_prior():
    information = jnp.asarray(np.diag([100.0, 0.0])[None])
    stated, determined = covariance(information, 1.0, 5.0)
    np.testing.assert_allclose(np.diagonal(stated[0]), [1 / (100 + 1 / 25), 25.0], rtol=1e-12)
    assert not bool(determined[0])
