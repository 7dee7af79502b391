"""Derivatives of many contacts: forward = reverse = central difference, degenerate families included."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.contact import FAMILIES, ContactProblem, random_grasp, solve

SLOTS = 4
STEP = 1e-9  # m, against displacements of 1e-3 m; W f is piecewise linear in them, so there is no truncation error
DIFFERENCES = 2e-7  # the displacement's rounding, 1e-16 m or so, over STEP
MODES = 1e-10  # the same linear system and its transpose, condition number up to 1e5
SAFE = 1e-4  # margin that STEP cannot use up


def with_free(problem: ContactProblem, free) -> ContactProblem:
    return eqx.tree_at(lambda p: p.free_displacement, problem, free)


def displacement(problem, free):
    """What is unique where the force is not."""
    return solve(with_free(problem, free), facets=4).value.displacement


@jax.jit
def differences(problem, free):
    def along(e):
        return (displacement(problem, free + STEP * e) - displacement(problem, free - STEP * e)) / (2 * STEP)

    return jnp.moveaxis(jax.lax.map(along, jnp.eye(free.shape[0])), 0, -1)


forward = jax.jit(jax.jacfwd(displacement, 1))
reverse = jax.jit(jax.jacrev(displacement, 1))
margin = jax.jit(lambda problem: solve(problem, facets=4).value.margin)


@pytest.mark.parametrize("kind", FAMILIES)
def test_forward_reverse_and_differences_agree(kind):
    """`planar` and `normal` are degenerate as LCPs though smooth; `face` and `duplicated` have singular W."""
    tested = 0
    for seed in range(16):
        problem = random_grasp(seed, SLOTS, kind)
        if margin(problem) < SAFE:
            continue
        tested += 1
        free = jnp.asarray(problem.free_displacement)
        jacobian = forward(problem, free)
        np.testing.assert_allclose(jacobian, differences(problem, free), atol=DIFFERENCES)
        np.testing.assert_allclose(jacobian, reverse(problem, free), atol=MODES)
    assert tested >= 6


def test_every_input_in_both_modes():
    """Random directions in all numbers of the problem at once, force included (W regular)."""
    problem = random_grasp(1, SLOTS)
    numbers, mask = eqx.partition(jax.tree.map(jnp.asarray, problem), eqx.is_inexact_array)
    rng = np.random.default_rng(0)

    def force(numbers):
        return solve(eqx.combine(numbers, mask), facets=4).value.force

    compiled = jax.jit(force)
    size = float(jnp.max(jnp.abs(compiled(numbers))))
    relative = 1e-6
    # Symmetric directions are not needed: the assembled problem is a function of every entry of W.
    direction = jax.tree.map(
        lambda x: jnp.asarray(relative * float(jnp.max(jnp.abs(x), initial=0.0)) * rng.normal(size=x.shape)), numbers
    )
    _, tangent = jax.jit(lambda x, d: jax.jvp(force, (x,), (d,)))(numbers, direction)
    plus, minus = (compiled(jax.tree.map(lambda x, d, s=s: x + s * d, numbers, direction)) for s in (1, -1))
    # Truncation relative^3 and rounding 1e-16, both times a condition number of up to 1e4.
    np.testing.assert_allclose(tangent, (plus - minus) / 2, atol=1e-11 * size)
    weight = jnp.asarray(rng.normal(size=(SLOTS, 3)))
    cotangent = jax.jit(jax.grad(lambda x: jnp.vdot(weight, force(x))))(numbers)
    dot = sum(jnp.vdot(a, b) for a, b in zip(jax.tree.leaves(cotangent), jax.tree.leaves(direction), strict=True))
    np.testing.assert_allclose(dot, jnp.vdot(weight, tangent), rtol=MODES)


def test_differentiation_does_not_change_the_result():
    problem = random_grasp(2, SLOTS)
    free = jnp.asarray(problem.free_displacement)

    def force(free):
        return solve(with_free(problem, free), facets=4).value.force

    plain = jax.jit(force)(free)
    np.testing.assert_array_equal(jax.jit(lambda x: jax.jvp(force, (x,), (x,)))(free)[0], plain)
    value, _ = jax.jit(jax.value_and_grad(lambda x: (jnp.sum(force(x)), force(x)), has_aux=True))(free)
    np.testing.assert_array_equal(value[1], plain)


def test_masked_slots_have_zero_derivative():
    """Their numbers may be NaN; cotangents that reach them are exactly zero."""
    problem = random_grasp(3, SLOTS, "random", 2)
    masked = ~problem.active
    garbage = eqx.tree_at(
        lambda p: (p.free_displacement, p.gap, p.frames, p.friction),
        problem,
        (
            np.where(np.repeat(masked, 3), np.nan, problem.free_displacement),
            np.where(masked, np.nan, problem.gap),
            np.where(masked[:, None, None], np.nan, problem.frames),
            np.where(masked, np.nan, problem.friction),
        ),
    )
    numbers, mask = eqx.partition(jax.tree.map(jnp.asarray, garbage), eqx.is_inexact_array)

    def total(numbers):
        value = solve(eqx.combine(numbers, mask), facets=4).value
        return jnp.sum(value.force) + jnp.sum(value.displacement)

    gradient = jax.jit(jax.grad(total))(numbers)
    for leaf in jax.tree.leaves(gradient):
        assert np.all(np.isfinite(leaf))
    np.testing.assert_array_equal(gradient.gap[masked], 0.0)
    np.testing.assert_array_equal(gradient.frames[masked], 0.0)
    np.testing.assert_array_equal(gradient.friction[masked], 0.0)
    np.testing.assert_array_equal(gradient.coupling[np.repeat(masked, 3)], 0.0)


def test_failed_solve_has_zero_derivative_of_force():
    problem = random_grasp(2, SLOTS)
    bad = jnp.full(3 * SLOTS, jnp.nan)
    jacobian = jax.jit(jax.jacrev(lambda free: solve(with_free(problem, free), facets=4).value.force))(bad)
    np.testing.assert_array_equal(jacobian, jnp.zeros_like(jacobian))


def test_hessian_is_finite_and_symmetric():
    problem = random_grasp(1, SLOTS)

    @jax.jit
    @jax.hessian
    def hessian(x):
        stretched = eqx.tree_at(lambda p: p.coupling, problem, problem.coupling * x[0])
        value = solve(with_free(stretched, problem.free_displacement * x[1]), facets=4).value
        return jnp.sum(value.force**2)

    second = hessian(jnp.ones(2))
    assert np.all(np.isfinite(second))
    np.testing.assert_allclose(second, second.T, rtol=1e-8)
    assert np.max(np.abs(second)) > 0


def test_derivative_between_two_rigid_faces_is_finite():
    """Forces that squeeze are open there, and rounding decides how some walks end: the derivatives are numbers."""
    problems = [random_grasp(9000 + seed, 8, "pairs") for seed in (11, 23, 30, 32)]
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *problems)

    def slope(problem):
        def displacement(free):
            return solve(eqx.tree_at(lambda p: p.free_displacement, problem, free)).value.displacement

        return jax.jvp(displacement, (problem.free_displacement,), (jnp.ones_like(problem.free_displacement),))[1]

    assert np.all(np.isfinite(jax.jit(jax.vmap(slope))(batch)))
