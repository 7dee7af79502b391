"""What no choice of solver, units, axes or numbering may change in the contact problem."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from contact_scenes import reordered
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
        found, moved = solver(turned(problem, rotation)), solver(reordered(problem, order))
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
    """A rollout whose steps push one contact on: forward, reverse and second derivatives, through checkpoints."""
    problem = jax.tree.map(jnp.asarray, random_grasp(11, 2))

    def rollout(push):
        @jax.checkpoint
        def step(offset, _):
            moved = eqx.tree_at(lambda p: p.free_displacement, problem, problem.free_displacement * push + offset)
            found = solve(moved, adjoint=adjoint, facets=2)
            return 0.3 * found.value.displacement.reshape(-1), jnp.sum(found.value.force**2)

        _, work = jax.lax.scan(step, jnp.zeros(6), None, length=4)
        return jnp.sum(work)

    def along(function):
        return jax.jit(lambda push: jax.jvp(function, (push,), (jnp.ones(()),)))

    forward, push, step = along(rollout), jnp.array(1.1), 1e-4
    assert float(jnp.abs(forward(push)[1])) > 0
    if isinstance(adjoint, Smoothed):  # the slope of its slope, beside exact forces, is no second derivative
        np.testing.assert_allclose(jax.jit(jax.grad(rollout))(push), forward(push)[1], rtol=1e-9)
    else:
        second = along(jax.grad(rollout))
        np.testing.assert_allclose(second(push)[0], forward(push)[1], rtol=1e-9)
        difference = (second(push + step)[0] - second(push - step)[0]) / (2 * step)
        np.testing.assert_allclose(second(push)[1], difference, rtol=1e-5)


def test_coupling_need_not_be_symmetric():
    """No solver takes W for its transpose; Lemke's answer is one for the contacts and the limit themselves."""
    problem = random_grasp(5, 2)
    skew = np.random.default_rng(1).normal(size=(7, 7)) * 0.3 * np.max(problem.coupling)
    coupling = np.eye(7) * np.max(problem.coupling) + skew
    coupling[:6, :6] += problem.coupling
    given = ContactProblem(
        coupling,
        np.append(problem.free_displacement, -1e-3),
        problem.gap,
        problem.frames,
        problem.friction,
        problem.active,
        np.zeros(1),
    )
    for solver in (Lemke(), InteriorPoint(1e-7, polish=True)):
        found = jax.jit(partial(solve, solver=solver))(given)
        assert found.result == RESULTS.solved
        assert float(found.stats["residual"]) < 1e-9


@pytest.mark.parametrize("facets", [2, None])
def test_tresca_derivatives(facets):
    """The fixed point carries the derivative of its states, on the polygon and on the circle; so it may be fitted."""
    problem = jax.tree.map(jnp.asarray, random_grasp(1, 2))
    solver = Projected(tolerance=1e-10, max_steps=20_000)

    @jax.jit
    def force(numbers):
        moved = eqx.tree_at(lambda p: (p.gap, p.friction, p.coupling), problem, numbers)
        return solve(moved, facets=facets, solver=solver).value.force

    at = (problem.gap - 1e-3, jnp.array([0.5, 0.3]), problem.coupling)
    along = (jnp.array([1e-3, 0.5e-3]), jnp.array([0.2, 0.1]), 0.1 * problem.coupling)
    _, slope = jax.jit(lambda x: jax.jvp(force, (x,), (along,)))(at)
    step = 1e-4
    ends = [force(jax.tree.map(lambda x, d, s=s: x + s * d, at, along)) for s in (step, -step)]
    assert float(jnp.max(jnp.abs(slope))) > 0.01
    near(slope, (ends[0] - ends[1]) / (2 * step))


def test_smoothed_derivatives_are_those_of_the_path():
    """In coupling and frames too, which turn forces into displacements and back."""

    def problem(angle, scale):
        c, s = jnp.cos(angle), jnp.sin(angle)
        frame = jnp.stack([jnp.stack([c, -s, 0.0]), jnp.stack([s, c, 0.0]), jnp.array([0.0, 0.0, 1.0])])
        return ContactProblem(
            scale * jnp.eye(3), jnp.zeros(3), jnp.array([0.1]), frame[None], jnp.array([0.5]), jnp.ones(1, bool)
        )

    def both(x, **choice):
        value = solve(problem(*x), facets=2, **choice).value
        return value.force, value.displacement

    smooth = jax.jit(jax.jacfwd(partial(both, adjoint=Smoothed(1e-2, unit=1.0))))
    path = jax.jit(jax.jacfwd(partial(both, solver=InteriorPoint(1e-2, unit=1.0))))
    x = jnp.array([0.3, 1.0])
    for one, two in zip(smooth(x), path(x), strict=True):
        assert float(jnp.max(jnp.abs(two))) > 1e-2
        np.testing.assert_allclose(one, two, atol=1e-9)


def test_invalid_numbers_reach_no_derivative():
    """A batch shares its frames with a problem that holds NaN: its gradient is that of the others."""
    problem = jax.tree.map(jnp.asarray, random_grasp(1, 2, "penetrating"))
    couplings = jnp.stack([problem.coupling, problem.coupling.at[0, 0].set(jnp.nan)])

    def total(frames, coupling):
        moved = eqx.tree_at(lambda p: (p.frames, p.coupling), problem, (frames, coupling))
        return jnp.sum(solve(moved, facets=2).value.force ** 2)

    slope = jax.jit(jax.vmap(jax.grad(total), in_axes=(None, 0)))(problem.frames, couplings)
    assert np.any(np.asarray(slope[0]))
    np.testing.assert_array_equal(slope[1], np.zeros_like(slope[1]))


def test_forces_beyond_the_largest_number_are_no_solution():
    small = ContactProblem(
        np.eye(3, dtype=np.float32) * np.float32(1e-25),
        np.array([0.0, 0.0, -1e18], np.float32),
        np.zeros(1, np.float32),
        np.eye(3, dtype=np.float32)[None][:, :, [2, 0, 1]],
        np.ones(1, np.float32),
        np.ones(1, bool),
    )
    assert run["Lemke"](small).result == RESULTS.breakdown


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("coupling", [[1.0]], "coupling must be an array; got list"),
        ("active", np.ones(2), "active must be bool; got float64"),
        ("frames", np.ones((2, 3, 3)), r"frames must be orthonormal .* frames\[0\] is not"),
        ("coupling", np.eye(7), r"shape \(6, 6\) for 2 contacts \(gap\) and 0 limits \(limit_gap\); got \(7, 7\)"),
        ("friction", -np.ones(2), "friction must not be negative; got -1"),
    ],
)
def test_wrong_fields_are_named(field, value, message):
    problem = random_grasp(2, 2)
    object.__setattr__(problem, field, value)
    with pytest.raises((TypeError, ValueError), match=message):
        solve(problem)


@pytest.mark.parametrize("depth", [-1e-4, -1e-9, 0.0, 1e-9, 1e-4])
def test_smoothed_derivative_of_a_pressed_fingertip(depth):
    """``f (W f - d) = kappa``: ``df/dd = (1 + d / sqrt(d^2 + 4 kappa W)) / 2W``, also where d is next to nothing."""
    np.testing.assert_allclose(_pressed_slope(depth), 500.0 * (1 + depth / np.hypot(depth, 2e-5)), rtol=2e-3)


@jax.jit
@jax.grad
def _pressed_slope(depth):
    free = -depth * jnp.array([0.0, 0.0, 1.0])
    frames = jnp.eye(3)[None][:, :, [2, 0, 1]]
    problem = ContactProblem(1e-3 * jnp.eye(3), free, jnp.zeros(1), frames, jnp.full(1, 0.5), jnp.ones(1, bool))
    return solve(problem, adjoint=Smoothed(1e-7, unit=1.0)).value.force[0, 2]
