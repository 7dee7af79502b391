"""What docs/contact_problem.md says of copositivity, existence, rays and uniqueness."""

import jax.numpy as jnp
import numpy as np
import pytest
from contact_scenes import one_contact
from hypothesis import given, settings
from hypothesis import strategies as st

from icjax import lcp
from icjax.contact import FAMILIES, ContactProblem, assemble, dimensionless, random_grasp, solve
from icjax.lcp import residual
from icjax.results import RESULTS

EXACT = 1e-12  # numbers of order one


def squeezed(gap, free, pad=0.0, friction=0.5) -> ContactProblem:
    """A free mass between two plates, both normals pointing to the mass; numbers along the normals."""
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    frames = np.stack([np.stack([n, [1.0, 0.0, 0.0], [0.0, n[2], 0.0]], axis=1) for n in normals])
    lever = np.concatenate([np.eye(3), np.eye(3)])
    return ContactProblem(
        coupling=lever @ lever.T + pad * np.eye(6),
        free_displacement=np.asarray(free, float)[:, None].repeat(3, 1).reshape(-1) * normals.reshape(-1),
        gap=np.asarray(gap, float),
        frames=frames,
        friction=np.full(2, friction),
        active=np.ones(2, bool),
    )


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), family=st.sampled_from(FAMILIES))
def test_copositive(seed, family):
    M, _ = assemble(dimensionless(random_grasp(seed, 3, family), 4)[0], 4)
    rng = np.random.default_rng(seed)
    z = rng.exponential(size=M.shape[0]) * rng.integers(0, 2, M.shape[0])
    assert float(z @ M @ z) >= -EXACT * float(z @ z)


def test_plates_that_converge_on_a_mass_have_no_solution():
    problem = squeezed([0.0, 0.0], [-1.0, -1.0])
    solution = solve(problem)
    assert bool(solution.result == RESULTS.secondary_ray)
    # The certificate: opposite forces move nothing, and q^T z < 0.
    opposite = np.array([0.0, 0.0, 1.0, 0.0, 0.0, -1.0])
    np.testing.assert_allclose(problem.coupling @ opposite, 0.0, atol=EXACT)
    assert problem.free_displacement @ opposite == -2.0
    # One plate that comes is pushed away; with room for both there is nothing to do.
    assert bool(solve(squeezed([0.0, 0.0], [-1.0, 1.0])).result == RESULTS.solved)
    assert bool(solve(squeezed([1.0, 1.5], [-1.0, -1.0])).result == RESULTS.solved)


def test_penetration_from_two_sides_has_no_solution_and_pads_give_one():
    assert bool(solve(squeezed([-1.0, -1.0], [0.0, 0.0])).result == RESULTS.secondary_ray)
    assert bool(solve(squeezed([-1.0, 1.0], [0.0, 0.0])).result == RESULTS.solved)
    padded = solve(squeezed([-1.0, -1.0], [0.0, 0.0], pad=0.1))
    assert bool(padded.result == RESULTS.solved)
    # Two equal springs in series hold what the walls ask for: 1 of compression each, 0.1 a unit of force.
    np.testing.assert_allclose(padded.value.force[:, 2], [10.0, -10.0], rtol=1e-9)


@pytest.mark.parametrize("friction", [0.0, 0.8])
def test_a_ray_proves_that_there_is_no_solution_only_without_friction(friction):
    """Copositive-plus: z^T M z = 0 with z >= 0 implies (M + M^T) z = 0. Lambda alone breaks it with friction."""
    M, _ = assemble(one_contact([0.0, 0.0, 0.0], coupling=1.0, friction=friction), 2)
    z = np.zeros(6)
    z[5] = 1.0
    assert float(z @ M @ z) == 0.0
    np.testing.assert_allclose((M + M.T) @ z, [friction, 0, 0, 0, 0, 0])


def test_two_motions_of_one_contact():
    """A wedge: W = [[1, 2], [2, 5]] in normal and tangent, mu = 1, du_free = (0.1, 1). Apart, or jammed and sliding."""
    frame = np.eye(3)[:, [2, 0, 1]]
    coupling = frame @ np.array([[1.0, 2.0, 0.0], [2.0, 5.0, 0.0], [0.0, 0.0, 5.0]]) @ frame.T
    problem = one_contact([1.0, 0.0, 0.1], coupling=coupling, friction=1.0, frame=frame)
    assert np.linalg.eigvalsh(coupling).min() > 0
    M, q = assemble(problem, 2)
    apart = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    # Normal, then +t1, -t1, +t2, -t2, lambda: f = 0.1 n - 0.1 t1 stops the normal motion and slides by 0.7 along t1.
    jammed = np.array([0.1, 0.0, 0.1, 0.0, 0.0, 0.7])
    for z in (apart, jammed):
        assert float(residual(M, q, jnp.asarray(z))) < EXACT
    assert bool(solve(problem, facets=2).result == RESULTS.solved)


def test_a_ray_may_end_where_a_solution_exists():
    """W = v v^T of rank one, du_free tangential: no force is a solution, and one covering vector leads to a ray."""
    frame = np.eye(3)[:, [2, 0, 1]]
    v = frame @ np.array([-2.0, 1.0, -3.0])
    problem = one_contact(frame @ np.array([0.0, -1.0, 1.0]), coupling=np.outer(v, v), friction=2.0, frame=frame)
    M, q = assemble(problem, 2)
    assert float(residual(M, q, jnp.array([0.0, 0, 0, 0, 0, 1.0]))) == 0.0
    assert bool(lcp.solve(M, q, lcp.Lemke(attempts=1)).result == RESULTS.secondary_ray)
    assert bool(lcp.solve(M, q).result == RESULTS.solved)
