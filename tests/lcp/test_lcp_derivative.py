"""The derivative on the final basis: closed form, differences, both modes, second order, failure."""

import jax
import jax.numpy as jnp
import numpy as np
from textbook import positive_definite

from icjax.lcp import solve

ROUNDING = 1e-12  # one more linear solve with a matrix of condition number up to about 1e3
STEP = 1e-6  # of central differences
DIFFERENCES = 1e-7  # STEP^2 times third derivatives, and rounding 1e-16 / STEP times the condition number


def value(M, q):
    return solve(M, q).value


forward_mode = jax.jit(jax.jacfwd(value, (0, 1)))
reverse_mode = jax.jit(jax.jacrev(value, (0, 1)))


def problem(seed: int = 1, n: int = 6):
    rng = np.random.default_rng(seed)
    return jnp.asarray(positive_definite(rng, n)), jnp.asarray(rng.normal(size=n))


def test_closed_form():
    """Both z positive: z = -M^-1 q, so dz = -M^-1 (dM z + dq). One only: dz_1 = -(dM_11 z_1 + dq_1) / M_11."""
    M, q = jnp.array([[2.0, 1.0], [1.0, 2.0]]), jnp.array([-5.0, -6.0])
    np.testing.assert_allclose(forward_mode(M, q)[1], -np.linalg.inv(M), atol=ROUNDING)
    z = np.array([4 / 3, 7 / 3])
    expected = -np.einsum("ij,k->ijk", np.linalg.inv(M), z)
    np.testing.assert_allclose(reverse_mode(M, q)[0], expected, atol=ROUNDING)
    single = reverse_mode(M, jnp.array([-5.0, 6.0]))[1]
    np.testing.assert_array_equal(single, [[-0.5, 0.0], [0.0, 0.0]])


def test_forward_reverse_and_differences_agree():
    for seed in range(3):
        M, q = problem(seed)
        for argument, x in enumerate((M, q)):
            forward, reverse = forward_mode(M, q)[argument], reverse_mode(M, q)[argument]
            np.testing.assert_allclose(forward, reverse, atol=ROUNDING)
            direction = jnp.asarray(np.random.default_rng(seed).normal(size=x.shape))
            at = [(M + s * direction, q) if argument == 0 else (M, q + s * direction) for s in (STEP, -STEP)]
            difference = (value(*at[0]) - value(*at[1])) / (2 * STEP)
            np.testing.assert_allclose(jnp.tensordot(forward, direction, x.ndim), difference, atol=DIFFERENCES)


def test_second_derivative():
    """A Hessian against differences of the gradient."""
    M, q = problem(2)

    def scalar(q, t):
        return jnp.sum(value(M + t * jnp.eye(q.shape[0]), q) ** 2)

    hessian = jax.jit(jax.hessian(scalar))(q, 0.0)
    gradient = jax.jit(jax.grad(scalar))
    shift = STEP * jnp.ones_like(q)
    difference = (gradient(q + shift, 0.0) - gradient(q - shift, 0.0)) / (2 * STEP)
    np.testing.assert_allclose(hessian @ jnp.ones_like(q), difference, atol=DIFFERENCES)
    mixed = jax.jit(jax.jacrev(jax.grad(scalar, 1)))(q, 0.0)
    assert np.all(np.isfinite(mixed))


def test_transformations_compose():
    """vmap of grad, grad of a scan, jit of jacfwd: all the same numbers."""
    M, q = problem(3)
    scales = jnp.linspace(0.5, 2.0, 4)

    def loss(scale):
        return jnp.sum(value(M, scale * q))

    slope = jax.jit(jax.grad(loss))
    one_by_one = jnp.stack([slope(s) for s in scales])
    np.testing.assert_allclose(jax.jit(jax.vmap(slope))(scales), one_by_one, rtol=ROUNDING)

    def scanned(scales):
        return jax.lax.scan(lambda carry, s: (carry + loss(s), None), 0.0, scales)[0]

    np.testing.assert_allclose(jax.jit(jax.grad(scanned))(scales), one_by_one, rtol=ROUNDING)
    np.testing.assert_allclose(jax.jit(jax.jacfwd(scanned))(scales), one_by_one, rtol=ROUNDING)


def test_differentiation_does_not_change_the_result():
    M, q = problem(4)
    plain = solve(M, q).value
    forward, _ = jax.jvp(value, (M, q), (M, q))
    reverse, _ = jax.vjp(value, M, q)
    np.testing.assert_array_equal(plain, forward)
    np.testing.assert_array_equal(plain, reverse)


def test_degenerate_problem_is_finite():
    """z = Mz + q = 0: the derivative is one-sided, and finite."""
    M, q = jnp.eye(2), jnp.array([0.0, -1.0])
    jacobian = reverse_mode(M, q)[1]
    assert np.all(np.isfinite(jacobian))
    assert float(jacobian[1, 1]) == -1.0


def test_failed_solve_has_zero_derivative():
    infeasible = (-jnp.eye(2), -jnp.ones(2))
    invalid = (jnp.eye(2), jnp.array([jnp.nan, -1.0]))
    for M, q in (infeasible, invalid):
        for jacobian in (*reverse_mode(M, q), *forward_mode(M, q)):
            np.testing.assert_array_equal(jacobian, jnp.zeros_like(jacobian))


def test_empty_problem():
    M, q = jnp.zeros((0, 0)), jnp.zeros(0)
    assert jax.jacrev(value, 1)(M, q).shape == (0, 0)
    assert jax.jacfwd(value, 0)(M, q).shape == (0, 0, 0)
