"""What no choice of solver, units, axes or numbering may change in the contact problem."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from icjax.contact import ContactProblem, InteriorPoint, Projected, random_grasp, solve
from icjax.lcp import Exact, Lemke, Smoothed
from icjax.results import RESULTS

CONTACTS = 5
DEFINITE = ("random", "planar", "normal", "penetrating", "touching", "frictionless")
SOLVERS = {
    "Lemke": Lemke(),
    "path": InteriorPoint(1e-4),
    "polished": InteriorPoint(1e-6, polish=True, fallback=Lemke()),
    "Tresca": Projected(tolerance=1e-8),
}
run = {name: jax.jit(partial(solve, solver=solver)) for name, solver in SOLVERS.items()}
circle = jax.jit(partial(solve, facets=None, solver=InteriorPoint(1e-4)))
drawn = given(seed=st.integers(0, 10_000), family=st.sampled_from(DEFINITE))
few = settings(max_examples=12, deadline=None)


def turned(problem: ContactProblem, rotation: np.ndarray) -> ContactProblem:
    """The same contacts in other world axes."""
    whole = np.kron(np.eye(CONTACTS), rotation)
    return eqx.tree_at(
        lambda p: (p.coupling, p.free_displacement, p.frames),
        problem,
        (whole @ problem.coupling @ whole.T, whole @ problem.free_displacement, rotation @ problem.frames),
    )


def numbered(problem: ContactProblem, order: np.ndarray) -> ContactProblem:
    """The same contacts in other slots."""
    rows = (3 * order[:, None] + np.arange(3)[None]).reshape(-1)
    return ContactProblem(
        problem.coupling[np.ix_(rows, rows)],
        problem.free_displacement[rows],
        problem.gap[order],
        problem.frames[order],
        problem.friction[order],
        problem.active[order],
    )


def near(found, reference, scale=1e-5) -> None:
    """Forces equal to the accuracy that the path is followed to."""
    size = float(np.max(np.abs(reference))) + 1e-300
    np.testing.assert_allclose(found, reference, atol=scale * size, rtol=0)


@few
@pytest.mark.parametrize("name", SOLVERS)
@drawn
def test_units_change_nothing(name, seed, family):
    """Lengths times 8 and forces times 4: not a bit of the mantissas changes."""
    problem = random_grasp(seed, CONTACTS, family)
    other = eqx.tree_at(
        lambda p: (p.coupling, p.free_displacement, p.gap),
        problem,
        (problem.coupling * 2.0, problem.free_displacement * 8.0, problem.gap * 8.0),
    )
    one, two = run[name](problem), run[name](other)
    assert int(one.result._value) == int(two.result._value)
    np.testing.assert_array_equal(4.0 * one.value.force, two.value.force)
    np.testing.assert_array_equal(8.0 * one.value.displacement, two.value.displacement)
    np.testing.assert_array_equal(one.value.slip_state, two.value.slip_state)
    assert float(one.value.margin) == float(two.value.margin)


@few
@drawn
def test_axes_and_numbering_change_nothing(seed, family):
    """The path's point does not depend on world axes or on the order of contacts, with a polygon and with a circle."""
    rng = np.random.default_rng(seed)
    problem = random_grasp(seed, CONTACTS, family)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation *= np.linalg.det(rotation)
    order = rng.permutation(CONTACTS)
    for solver in (run["path"], circle):
        reference = solver(problem)
        found, moved = solver(turned(problem, rotation)), solver(numbered(problem, order))
        if not reference.result == found.result == moved.result == RESULTS.solved:
            continue  # not a monotone problem: after a stall the way may differ by rounding
        near(found.value.force @ rotation, reference.value.force)
        near(moved.value.force, reference.value.force[order])


@few
@drawn
def test_forces_lie_in_the_cone_and_oppose_motion(seed, family):
    """Each solver's answer by itself: cone, no penetration, no contact at a distance, friction does no work."""
    problem = random_grasp(seed, CONTACTS, family)
    length = np.max(np.abs(problem.free_displacement)) + np.max(np.abs(problem.gap))
    for name, solver in run.items():
        found = solver(problem)
        if found.result != RESULTS.solved or name == "path":
            continue
        f = np.einsum("iab,ia->ib", problem.frames, found.value.force)
        u = np.einsum("iab,ia->ib", problem.frames, found.value.displacement)
        clearance = u[:, 0] + problem.gap
        size = np.max(np.abs(f)) + 1e-300
        small, near_zero = 1e-6 * size, 1e-6 * length
        assert np.all(f[:, 0] >= -small), name
        assert np.all(clearance >= -near_zero), name
        assert np.all(np.linalg.norm(f[:, 1:], axis=1) <= problem.friction * f[:, 0] + small), name
        assert np.all((f[:, 0] <= small) | (clearance <= near_zero)), name
        assert np.all(np.sum(f[:, 1:] * u[:, 1:], axis=1) <= small * length), name


@pytest.mark.parametrize("name", SOLVERS)
def test_compiled_equals_eager(name):
    """To rounding: XLA may contract products and sums."""
    problem = random_grasp(7, CONTACTS)
    eager = solve(problem, solver=SOLVERS[name])
    assert eager.result == RESULTS.solved
    near(eager.value.force, run[name](problem).value.force)


@pytest.mark.parametrize("name", SOLVERS)
def test_no_contact_at_all(name):
    """No slots, no active slot, and contacts that free motion leaves open: solved, with forces of zero or kappa."""
    empty = ContactProblem(
        np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros((0, 3, 3)), np.zeros(0), np.zeros(0, bool)
    )
    found = run[name](empty)
    assert found.result == RESULTS.solved
    assert found.value.force.shape == (0, 3)
    assert float(found.stats["residual"]) == 0
    problem = random_grasp(3, CONTACTS)
    masked = eqx.tree_at(lambda p: p.active, problem, np.zeros(CONTACTS, bool))
    found = run[name](masked)
    assert found.result == RESULTS.solved
    assert not np.any(found.value.force)
    assert float(found.stats["residual"]) == 0
    apart = eqx.tree_at(lambda p: p.gap, problem, np.full(CONTACTS, 1.0))
    found = run[name](apart)
    assert found.result == RESULTS.solved
    if name != "path":
        assert not np.any(found.value.force)


@pytest.mark.parametrize("adjoint", [Exact(), Smoothed(1e-4)])
def test_checkpointed_scan_and_hessian(adjoint):
    """A rollout of steps pushes one contact on: reverse mode through checkpoints is forward mode, second order too."""
    problem = jax.tree.map(jnp.asarray, random_grasp(11, 3))

    def rollout(push):
        @jax.checkpoint
        def step(offset, _):
            moved = eqx.tree_at(lambda p: p.free_displacement, problem, problem.free_displacement * push + offset)
            found = solve(moved, adjoint=adjoint)
            return 0.3 * found.value.displacement.reshape(-1), jnp.sum(found.value.force**2)

        _, work = jax.lax.scan(step, jnp.zeros(9), None, length=4)
        return jnp.sum(work)

    push = jnp.array(1.1)
    backward, forward = jax.jit(jax.grad(rollout))(push), jax.jit(jax.jacfwd(rollout))(push)
    assert float(jnp.abs(forward)) > 0
    np.testing.assert_allclose(backward, forward, rtol=1e-9)
    step = 1e-4
    if isinstance(adjoint, Exact):
        slope = jax.jit(jax.grad(rollout))
        second = jax.jit(jax.hessian(rollout))(push)
        np.testing.assert_allclose(second, (slope(push + step) - slope(push - step)) / (2 * step), rtol=1e-5)
