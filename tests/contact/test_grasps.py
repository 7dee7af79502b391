"""Random grasps: residual, axioms of frictional contact, invariances, masks, bad input."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from contact_scenes import one_contact, reordered
from hypothesis import given, settings
from hypothesis import strategies as st

from icjax import lcp
from icjax.contact import FAMILIES, ContactProblem, assemble, contact_frame, gauge, random_grasp, solve
from icjax.lcp import residual
from icjax.results import RESULTS

SLOTS = 10
REACHED = 1e-10  # dimensionless residual
LENGTH = 5e-3  # m, about the largest free displacement: what "zero displacement" is measured against
FAINT = 1e-3  # N, about a hundredth of the usual forces: what "zero force" is measured against if all slots are open
SAME = 1e-9  # two orders of the same pivots, relative, condition number up to 1e5


@eqx.filter_jit
def answer(problem):
    return solve(problem, facets=4)


assembled = jax.jit(assemble, static_argnums=1)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), live=st.integers(3, SLOTS), kind=st.sampled_from(FAMILIES))
def test_axioms(seed, live, kind):
    """Solved; force in the cone; no penetration; gap times force zero; friction dissipates all that it can."""
    problem = random_grasp(seed, SLOTS, kind, live)
    solution = answer(problem)
    assert bool(solution.result == RESULTS.solved)
    assert float(solution.stats["residual"]) <= REACHED
    active = problem.active
    force = np.einsum("iab,ia->ib", problem.frames, solution.value.force)
    moved = np.einsum("iab,ia->ib", problem.frames, solution.value.displacement)
    size = max(FAINT, np.max(np.abs(force)))
    reach = np.array([gauge(jnp.asarray(f[1:]), 4) for f in force])
    limit = problem.friction * force[:, 0]
    assert np.all(force[:, 0] >= -REACHED * size)
    assert np.all(reach <= limit + REACHED * size)
    separation = (moved[:, 0] + problem.gap)[active]
    assert np.all(separation >= -REACHED * LENGTH)
    assert np.all(np.minimum(separation / LENGTH, force[active, 0] / size) <= REACHED)
    work = np.sum(force[:, 1:] * moved[:, 1:], axis=1)
    slip = np.array([gauge_dual(u[1:]) for u in moved])
    np.testing.assert_allclose(work[active], (-limit * slip)[active], atol=REACHED * size * LENGTH)
    free = np.where(np.repeat(active, 3), problem.free_displacement, 0.0)
    coupling = np.where(np.outer(np.repeat(active, 3), np.repeat(active, 3)), problem.coupling, 0.0)
    expected = coupling @ np.asarray(solution.value.force).reshape(-1) + free
    np.testing.assert_allclose(np.asarray(solution.value.displacement).reshape(-1), expected, atol=SAME * LENGTH)


def gauge_dual(slip, m=4):
    """The farthest reach of the slip along a facet, max_j d_j . slip: what the best friction force can dissipate."""
    angle = np.arange(2 * m) * np.pi / m
    return np.max(np.stack([np.cos(angle), np.sin(angle)], axis=1) @ slip)


def test_residual_of_the_assembled_problem():
    """The solution, written as (beta, lambda), solves the LCP of Section 7.1.3 in SI units too."""
    problem = random_grasp(5, 4)
    value = answer(problem).value
    M, q = assembled(problem, 4)
    assert M.shape == (40, 40)
    z = lcp.solve(M, q).value
    assert float(residual(M, q, z)) <= REACHED
    beta = np.asarray(z[:36]).reshape(4, 9)
    angle = np.arange(4) * np.pi / 4
    corners = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    tangents = np.stack([corners, -corners], axis=1).reshape(8, 2)
    local = np.concatenate([beta[:, :1], beta[:, 1:] @ tangents], axis=1)
    expected = np.einsum("iab,ib->ia", problem.frames, local)
    np.testing.assert_allclose(value.force, expected, atol=1e-6 * np.max(np.abs(expected)))


def test_assembled_blocks():
    """Signs and places of Section 7.1.3 by a direct product of block-diagonal matrices."""
    problem = random_grasp(8, 2)
    M, q = assembled(problem, 2)
    n, t1, t2 = np.moveaxis(problem.frames, 2, 0)
    D = np.zeros((6, 10))
    for i in range(2):
        D[3 * i : 3 * i + 3, 5 * i : 5 * i + 5] = np.stack([n[i], t1[i], -t1[i], t2[i], -t2[i]], axis=1)
    E, F = np.zeros((2, 10)), np.zeros((2, 10))
    for i in range(2):
        E[i, 5 * i + 1 : 5 * i + 5] = -1.0
        F[i, 5 * i : 5 * i + 5] = [problem.friction[i], -1, -1, -1, -1]
    s = np.zeros(10)
    s[[0, 5]] = problem.gap
    exact = 1e-15  # rounding of products of numbers up to 1e-2
    expected = np.block([[D.T @ problem.coupling @ D, -E.T], [F, np.zeros((2, 2))]])
    np.testing.assert_allclose(M, expected, atol=exact)
    np.testing.assert_allclose(q, np.concatenate([s + D.T @ problem.free_displacement, np.zeros(2)]), atol=exact)


def test_order_of_contacts_does_not_matter():
    for seed in range(3):
        problem = random_grasp(seed, SLOTS, "random", 5)
        order = np.random.default_rng(seed).permutation(SLOTS)
        first, second = answer(problem).value, answer(reordered(problem, order)).value
        size = np.max(np.abs(first.displacement))
        np.testing.assert_allclose(second.displacement, first.displacement[order], atol=SAME * size)
        np.testing.assert_array_equal(second.slip_state, first.slip_state[order])


def test_rotation_of_the_world_rotates_the_answer():
    """All vectors and frames turned together."""
    rotation = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    problem = random_grasp(2, SLOTS, "random", 5)
    wide = np.kron(np.eye(SLOTS), rotation)
    turned = ContactProblem(
        wide @ problem.coupling @ wide.T,
        wide @ problem.free_displacement,
        problem.gap,
        rotation @ problem.frames,
        problem.friction,
        problem.active,
    )
    first, second = answer(problem).value, answer(turned).value
    size = np.max(np.abs(first.displacement))
    np.testing.assert_allclose(second.displacement, first.displacement @ rotation.T, atol=SAME * size)


def test_units_do_not_matter():
    """Lengths in other units, forces in other units: the same numbers in those units."""
    problem = random_grasp(3, SLOTS, "random", 5)
    scaled = ContactProblem(
        problem.coupling * 1e-7,
        problem.free_displacement * 1e-4,
        problem.gap * 1e-4,
        problem.frames,
        problem.friction,
        problem.active,
    )
    first, second = answer(problem).value, answer(scaled).value
    np.testing.assert_allclose(second.force, first.force * 1e3, atol=SAME * 1e3 * np.max(np.abs(first.force)))
    np.testing.assert_allclose(second.margin, first.margin, rtol=2.0)  # its unit is rounded to a power of two


def test_masked_slots_do_not_exist():
    """Zero force and displacement whatever they hold, and the rest as if they were absent."""
    problem = random_grasp(4, SLOTS, "random", 4)
    masked = ~problem.active
    wide = np.repeat(masked, 3)
    garbage = ContactProblem(
        np.where(wide[:, None] | wide[None, :], np.nan, problem.coupling),
        np.where(wide, np.inf, problem.free_displacement),
        np.where(masked, -np.inf, problem.gap),
        np.where(masked[:, None, None], np.nan, problem.frames),
        np.where(masked, -1.0, problem.friction),
        problem.active,
    )
    value = answer(garbage).value
    np.testing.assert_array_equal(value.force[masked], 0.0)
    np.testing.assert_array_equal(value.displacement[masked], 0.0)
    np.testing.assert_array_equal(value.slip_state[masked], 0)
    live = np.flatnonzero(problem.active)
    alone = answer(reordered(problem, live)).value
    np.testing.assert_allclose(value.force[live], alone.force, atol=SAME * np.max(np.abs(alone.force)))
    empty = answer(eqx.tree_at(lambda p: p.active, garbage, np.zeros(SLOTS, bool)))
    np.testing.assert_array_equal(empty.value.force, np.zeros((SLOTS, 3)))
    assert np.isinf(empty.value.margin)


def test_jit_eager_and_vmap_agree():
    problems = [random_grasp(seed, SLOTS, "random", 4) for seed in range(3)]
    stacked = jax.tree.map(lambda *x: np.stack(x), *problems)
    batch = jax.jit(jax.vmap(lambda p: solve(p, facets=4)))(stacked)
    for k, problem in enumerate(problems):
        one = answer(problem).value
        size = max(FAINT, np.max(np.abs(one.force)))
        np.testing.assert_allclose(batch.value.force[k], one.force, atol=SAME * size)
        np.testing.assert_array_equal(batch.value.slip_state[k], one.slip_state)
    eager = solve(problems[2], facets=4).value
    assert np.max(np.abs(eager.force)) > FAINT
    np.testing.assert_allclose(eager.force, answer(problems[2]).value.force, atol=SAME * np.max(np.abs(eager.force)))


def test_no_contacts():
    none = ContactProblem(
        np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros((0, 3, 3)), np.zeros(0), np.zeros(0, bool)
    )
    solution = solve(none, facets=4)
    assert solution.value.force.shape == (0, 3)
    assert bool(solution.result == RESULTS.solved)


def test_bad_input():
    problem = one_contact(np.array([np.nan, 0.0, -1e-3]))
    solution = answer(problem)
    assert bool(solution.result == RESULTS.invalid_input)
    np.testing.assert_array_equal(solution.value.force, np.zeros((1, 3)))
    with pytest.raises(ValueError, match="friction must not be negative; got -0.1"):
        solve(one_contact(np.zeros(3), friction=-0.1), facets=4)
    traced = jax.jit(lambda mu: solve(one_contact(np.array([0.0, 0.0, -1.0]), friction=mu), facets=4).result)
    assert bool(traced(-0.1) == RESULTS.invalid_input)
    with pytest.raises(ValueError, match="facets"):
        solve(one_contact(np.zeros(3)), facets=1)


def test_converging_driven_plates_are_not_called_solved():
    """Two fixed plates close on a free mass (A = 0 for them): no force can keep both gaps open."""
    normal = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    frames = np.asarray(jax.vmap(contact_frame)(jnp.asarray(normal)))
    lever = np.concatenate([np.eye(3), np.eye(3)])
    problem = ContactProblem(
        1e-4 * lever @ lever.T,
        np.array([0.0, 0.0, -1e-3, 0.0, 0.0, 1e-3]),
        np.zeros(2),
        frames,
        np.array([0.5, 0.5]),
        np.ones(2, bool),
    )
    solution = answer(problem)
    assert bool(solution.result == RESULTS.secondary_ray)
    assert float(solution.stats["residual"]) > 1e-3
