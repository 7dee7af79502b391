"""Interior point, Tresca fixed point and the circular cone: against Lemke's method, closed forms and each other."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.contact import (
    FAMILIES,
    OPEN,
    SLIDING,
    STICKING,
    ContactProblem,
    InteriorPoint,
    Projected,
    random_grasp,
    solve,
)
from icjax.lcp import Exact, Lemke, Smoothed
from icjax.results import RESULTS

ROUNDING = 1e-9
"""Dimensionless; solutions of one active set from two programs, condition numbers up to 1e5."""

exact = jax.jit(solve)
polished = jax.jit(partial(solve, solver=InteriorPoint(1e-6, polish=True, fallback=Lemke())))
smooth = jax.jit(partial(solve, solver=InteriorPoint(1e-4)))
on_path = jax.jit(lambda problem, kappa: solve(problem, solver=InteriorPoint(kappa, unit=1.0)))
"""kappa in J"""


def one_contact(free, friction=0.5, gap=0.0, coupling=(1.0, 1.0, 1.0)) -> ContactProblem:
    """A contact with normal z; in its frame (normal, tangents) are the world's (z, x, y)."""
    return ContactProblem(
        np.diag(np.asarray(coupling)),
        np.asarray(free, float),
        np.array([gap]),
        np.eye(3)[None][:, :, [2, 0, 1]],
        np.array([friction]),
        np.array([True]),
    )


@pytest.mark.parametrize("family", FAMILIES)
def test_polished_interior_point_is_exact(family):
    """Residual of an exact solution; the displacement is Lemke's, save where friction allows several
    (between two faces with a singular W often)."""
    same = 0
    for seed in range(4):
        problem = random_grasp(seed, 6, family)
        found, reference = polished(problem), exact(problem)
        assert found.result == RESULTS.solved
        assert float(found.stats["residual"]) < ROUNDING
        size = float(np.max(np.abs(problem.free_displacement)))
        same += np.allclose(found.value.displacement, reference.value.displacement, atol=1e-7 * size)
    assert same >= 3 or family == "pairs"


def test_path_approaches_the_solution_with_kappa():
    """Distances of displacements fall with kappa, by at least its square root each decade (degenerate at worst)."""
    problem = random_grasp(2, 6)
    along = jax.jit(lambda problem, kappa: solve(problem, solver=InteriorPoint(kappa)))
    reference = exact(problem).value.displacement
    distances = []
    for kappa in (1e-2, 1e-4, 1e-6):
        found = along(problem, kappa)
        assert found.result == RESULTS.solved
        distances.append(float(jnp.max(jnp.abs(found.value.displacement - reference))))
    assert distances[2] < 0.1 * distances[1] < 0.01 * distances[0]


def test_path_of_one_contact_in_closed_form():
    """Pressed along its normal, W = 1: ``f u = kappa, u = (1 + kappa) f - 1``; the polish gives f = 1."""
    kappa = 1e-3
    problem = one_contact([0.0, 0.0, -1.0])
    found = on_path(problem, kappa)
    f = (1.0 + np.sqrt(1.0 + 4.0 * kappa * (1.0 + kappa))) / (2.0 * (1.0 + kappa))
    np.testing.assert_allclose(found.value.force[0], [0.0, 0.0, f], rtol=1e-6, atol=1e-9)
    polished_force = polished(problem).value.force[0]
    np.testing.assert_allclose(polished_force, [0.0, 0.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("solver", [InteriorPoint(1e-9), Projected(tolerance=1e-8)])
@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 8, 1.0])
def test_circular_cone_slides_against_the_motion(solver, angle):
    """Friction of size mu f_n exactly against the slip, in every direction; polygons do so at their corners only."""
    free = [2 * np.cos(angle), 2 * np.sin(angle), -1.0]
    value = solve(one_contact(free), solver=solver, facets=None).value
    np.testing.assert_allclose(value.force[0], [-0.5 * np.cos(angle), -0.5 * np.sin(angle), 1.0], atol=1e-6)
    assert value.slip_state[0] == SLIDING


@pytest.mark.parametrize("solver", [InteriorPoint(1e-9), InteriorPoint(1e-6, polish=True), Projected(tolerance=1e-8)])
def test_contact_states(solver):
    """Open, sticking and sliding, as Lemke's method finds them."""
    run = jax.jit(partial(solve, solver=solver))
    for free, state in [([0.1, 0, 1.0], OPEN), ([0.1, 0, -1.0], STICKING), ([2.0, 0, -1.0], SLIDING)]:
        assert run(one_contact(free)).value.slip_state[0] == state


def test_projected_agrees_with_lemke():
    """To its tolerance, at moderate friction."""
    fixed_point = jax.jit(partial(solve, solver=Projected()))
    for seed in range(4):
        problem = random_grasp(seed, 4)
        found, reference = fixed_point(problem), exact(problem)
        assert found.result == RESULTS.solved
        size = float(np.max(np.abs(problem.free_displacement)))
        np.testing.assert_allclose(found.value.displacement, reference.value.displacement, atol=1e-3 * size)


def _loss(solver, adjoint=None, facets=4):
    def loss(free, problem):
        problem = ContactProblem(
            problem.coupling, free, problem.gap, problem.frames, problem.friction, problem.active, problem.limit_gap
        )
        found = solve(problem, solver=solver, adjoint=adjoint, facets=facets)
        return jnp.sum(jnp.sin(1e3 * found.value.displacement))

    return loss


@pytest.mark.parametrize("facets", [4, None])
def test_path_derivatives(facets):
    """Forward mode, reverse mode and second derivatives against central differences of the smoothed forces."""
    loss = _loss(InteriorPoint(1e-3), facets=facets)
    problem = jax.tree.map(jnp.asarray, random_grasp(1, 5))
    free = problem.free_displacement
    direction = jnp.asarray(np.random.default_rng(0).normal(size=free.shape))
    step = 1e-5 * float(jnp.max(jnp.abs(free)))

    def along(function):
        return jax.jit(lambda free: jax.jvp(partial(function, problem=problem), (free,), (direction,)))

    forward, second = along(loss), along(jax.grad(loss))
    for function, tolerance in ((forward, 1e-5), (second, 1e-5)):
        _, slope = function(free)
        difference = (function(free + step * direction)[0] - function(free - step * direction)[0]) / (2 * step)
        np.testing.assert_allclose(slope, difference, atol=tolerance * float(jnp.max(jnp.abs(difference))))
    np.testing.assert_allclose(second(free)[0] @ direction, forward(free)[1], rtol=1e-8)


def test_exact_derivatives_agree():
    """Lemke's basis, the polished interior point's states and the Tresca fixed point's: one derivative."""
    problem = jax.tree.map(jnp.asarray, random_grasp(3, 3))
    free = problem.free_displacement
    gradients = [
        jax.jit(jax.grad(_loss(solver)))(free, problem)
        for solver in (Lemke(), InteriorPoint(1e-7, polish=True), Projected(tolerance=1e-9, max_steps=5000))
    ]
    size = float(jnp.max(jnp.abs(gradients[0])))
    np.testing.assert_allclose(gradients[1], gradients[0], atol=1e-7 * size)
    np.testing.assert_allclose(gradients[2], gradients[0], atol=1e-4 * size)


def test_smoothed_adjoint_leaves_the_forces_and_sees_what_is_near():
    """The forward result is bitwise that of the exact adjoint; the derivative is not zero at a distance."""
    problem = jax.tree.map(jnp.asarray, one_contact([0.0, 0.0, -0.5], gap=1.0))

    def force(gap, adjoint):
        near = ContactProblem(
            problem.coupling, problem.free_displacement, gap, problem.frames, problem.friction, problem.active
        )
        return solve(near, adjoint=adjoint).value.force[0, 2]

    for adjoint, seen in ((Exact(), False), (Smoothed(1e-3, unit=1.0), True)):
        value, slope = jax.jit(jax.value_and_grad(partial(force, adjoint=adjoint)))(problem.gap)
        assert value == 0.0
        assert (slope[0] < 0) == seen
    grasp = random_grasp(4, 6)
    other = jax.jit(partial(solve, adjoint=Smoothed()))(grasp)
    np.testing.assert_array_equal(exact(grasp).value.force, other.value.force)


def test_batches_equal_loops():
    """`vmap`, with a fallback that some members need and others do not."""
    problems = [random_grasp(seed, 3) for seed in range(3)]
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *problems)
    run = partial(solve, solver=InteriorPoint(1e-3, polish=True, fallback=Lemke()), facets=2)
    together, alone = jax.jit(jax.vmap(run)), jax.jit(run)
    found = together(batch)
    for i, problem in enumerate(problems):
        np.testing.assert_allclose(found.value.force[i], alone(problem).value.force, atol=1e-9)


def test_masked_slots_and_bad_numbers():
    """Masked slots carry nothing and are not read; NaN gives a status."""
    problem = random_grasp(5, 5, active=3)
    for run in (smooth, polished):
        found = run(problem)
        assert found.result == RESULTS.solved
        assert np.all(np.asarray(found.value.force)[~problem.active] == 0.0)
        unread = ContactProblem(
            problem.coupling,
            np.where(np.repeat(problem.active, 3), problem.free_displacement, np.nan),
            problem.gap,
            problem.frames,
            problem.friction,
            problem.active,
        )
        np.testing.assert_array_equal(run(unread).value.force, found.value.force)
        bad = ContactProblem(
            problem.coupling * np.nan,
            problem.free_displacement,
            problem.gap,
            problem.frames,
            problem.friction,
            problem.active,
        )
        assert run(bad).result == RESULTS.invalid_input
        assert np.all(np.isfinite(run(bad).value.force))


def test_arguments_without_meaning():
    """Errors name the argument."""
    problem = one_contact([0.0, 0.0, -1.0])
    with pytest.raises(ValueError, match="facets"):
        solve(problem, facets=None)
    with pytest.raises(ValueError, match="facets"):
        solve(problem, facets=None, solver=InteriorPoint(polish=True))
    with pytest.raises(ValueError, match="adjoint"):
        solve(problem, solver=InteriorPoint(), adjoint=Exact())
    with pytest.raises(ValueError, match="kappa"):
        InteriorPoint(kappa=0.0)
    with pytest.raises(ValueError, match="kappa"):
        Smoothed(kappa=-1.0)


def limited(gap, free, limit_gap, limit_free, coupling) -> ContactProblem:
    """A frictional contact with normal z beside two limits."""
    return ContactProblem(
        np.asarray(coupling, float),
        np.concatenate([np.asarray(free, float), np.asarray(limit_free, float)]),
        np.array([gap], float),
        np.eye(3)[None][:, :, [2, 0, 1]],
        np.array([0.5]),
        np.array([True]),
        np.asarray(limit_gap, float),
    )


@pytest.mark.parametrize("solver", [Lemke(), InteriorPoint(1e-7, polish=True), Projected(tolerance=1e-9)])
def test_limits_beside_a_contact(solver):
    """A joint pressed into its limit by 0.3 and into a contact by 0.2, both through one compliance: closed form.

    Clearances c = C (tau + J f_n) - 0.3 and u_n = C J (tau + J f_n) - 0.2 + pad f_n; the second limit does not exist.
    """
    C, J, pad = 2.0, 0.5, 0.5
    W = np.zeros((5, 5))
    W[:3, :3] = pad * np.eye(3)
    along = np.array([0.0, 0.0, J, 1.0, 0.0])
    W += C * np.outer(along, along)
    found = solve(limited(0.0, [0, 0, -0.2], [0.0, np.inf], [-0.3, np.nan], W), solver=solver)
    assert found.result == RESULTS.solved
    tau, f_n = np.linalg.solve([[C, C * J], [C * J, C * J * J + pad]], [0.3, 0.2])
    assert tau > 0
    assert f_n > 0
    np.testing.assert_allclose(found.value.limit_force, [tau, 0.0], atol=1e-7)
    np.testing.assert_allclose(found.value.force[0, 2], f_n, atol=1e-7)
    np.testing.assert_allclose(found.value.limit_displacement[0], 0.0, atol=1e-7)


def test_limits_without_contacts_and_their_derivative():
    """A violated limit is pushed out: ``tau = violation / C``; its derivative with respect to the gap is -1 / C."""

    def torque(gap):
        problem = ContactProblem(
            jnp.array([[0.25]]),
            jnp.zeros(1),
            jnp.zeros(0),
            jnp.zeros((0, 3, 3)),
            jnp.zeros(0),
            jnp.zeros(0, bool),
            gap[None],
        )
        return solve(problem).value.limit_force[0]

    np.testing.assert_allclose(torque(jnp.array(-0.1)), 0.4, rtol=1e-12)
    np.testing.assert_allclose(jax.grad(torque)(jnp.array(-0.1)), -4.0, rtol=1e-12)
    assert torque(jnp.array(0.1)) == 0.0


@pytest.mark.parametrize("kappa", [1e-4])
def test_interior_point_in_single_precision(kappa):
    """float32 follows the path as float64 does."""
    single = [
        jax.tree.map(lambda x: x if x.dtype == bool else np.asarray(x, np.float32), random_grasp(seed, 8))
        for seed in range(6)
    ]
    run = jax.jit(partial(solve, solver=InteriorPoint(kappa)))
    for seed, problem in enumerate(single):
        found = run(problem)
        assert found.result == RESULTS.solved
        assert found.value.force.dtype == np.float32
        double = run(random_grasp(seed, 8)).value.force
        np.testing.assert_allclose(found.value.force, double, atol=1e-2 * float(np.max(np.abs(double))))
