"""Lemke's method on textbook problems, random problems, and everything that must not be called solved."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from textbook import positive_definite, read_siconos

from icjax.lcp import Lemke, residual, solve
from icjax.results import RESULTS

ROUNDING = 1e-13  # small integers through a dozen pivots
REACHED = 1e-11  # dimensionless residual of a random problem of condition number up to about 1e4

KNOWN = {
    "lcp_exp_murty": [1, 0, 0, 0, 0, 0],
    "lcp_exp_murty2": [126, 0, 0, 0, 0, 0],
    "lcp_deudeu": [4 / 3, 7 / 3],
    "lcp_ortiz": [2 / 3, 0, 1 / 3, 0],
    "lcp_CPS_2": [6, 1.5, 0],
    "lcp_trivial": [1 / k for k in range(1, 10)],
}


def status(solution) -> str:
    names = ("solved", "secondary_ray", "breakdown", "max_pivots", "not_converged", "invalid_input")
    return next(name for name in names if bool(solution.result == getattr(RESULTS, name)))


@pytest.mark.parametrize("name", KNOWN)
def test_textbook_solution(shared_data, name):
    M, q = read_siconos(shared_data / "siconos_fc_lcp" / "lcp" / f"{name}.dat")
    solution = solve(M, q)
    assert status(solution) == "solved"
    np.testing.assert_allclose(solution.value, KNOWN[name], rtol=ROUNDING, atol=ROUNDING)


def test_textbook_problems_with_many_solutions(shared_data):
    """CPS_1: every z >= 0 with z1 + z2 = 1. CPS_5: the one basic solution (0, 1)."""
    folder = shared_data / "siconos_fc_lcp" / "lcp"
    assert float(jnp.sum(solve(*read_siconos(folder / "lcp_CPS_1.dat")).value)) == 1.0
    np.testing.assert_array_equal(solve(*read_siconos(folder / "lcp_CPS_5.dat")).value, [0.0, 1.0])


def test_isolated_solution(shared_data):
    """Pang's problem has the isolated solution (1, 0, 0); the file holds M by columns.

    Read by rows it asks for -z1 - 1 >= 0 and has no solution: both are known, so both are tested.
    """
    M, q = read_siconos(shared_data / "siconos_fc_lcp" / "lcp" / "lcp_Pang_isolated_sol.dat")
    assert float(residual(M.T, q, np.array([1.0, 0.0, 0.0]))) == 0.0
    solution = solve(M.T, q)
    if status(solution) == "solved":
        np.testing.assert_allclose(solution.value, [1.0, 0.0, 0.0], atol=ROUNDING)
    assert status(solve(M, q)) == "secondary_ray"


@pytest.mark.parametrize("name", ["lcp_CPS_4", "lcp_CPS_4bis"])
def test_infeasible_problem_ends_on_a_ray(shared_data, name):
    """The fourth row asks for z1 + z2 + z3 <= -6."""
    solution = solve(*read_siconos(shared_data / "siconos_fc_lcp" / "lcp" / f"{name}.dat"))
    assert status(solution) == "secondary_ray"
    assert float(solution.stats["residual"]) > 1.0
    assert np.all(np.isfinite(solution.value))


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.sampled_from([1, 6]))
def test_positive_definite_problem_is_solved(seed, n):
    rng = np.random.default_rng(seed)
    M, q = positive_definite(rng, n), rng.normal(size=n) * 10.0 ** rng.integers(-8, 9)
    solution = solve(M, q)
    assert status(solution) == "solved"
    assert float(solution.stats["residual"]) <= REACHED * np.max(np.abs(q)) * max(1.0, np.max(np.abs(M)))
    assert np.all(np.asarray(solution.value) >= 0)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_success_is_never_false(seed):
    """Random small integers: degenerate, singular, often infeasible. Solved must mean solved."""
    rng = np.random.default_rng(seed)
    M = rng.integers(-2, 3, (6, 6)).astype(float)
    q = rng.integers(-2, 3, 6).astype(float)
    solution = solve(M, q)
    z = np.asarray(solution.value)
    recomputed = np.max(np.abs(np.minimum(z, M @ z + q)))
    assert np.all(np.isfinite(z))
    np.testing.assert_allclose(float(solution.stats["residual"]), recomputed, atol=ROUNDING)
    assert (status(solution) == "solved") == (recomputed <= 1e-9)


def test_failures_are_told_apart(shared_data):
    M, q = read_siconos(shared_data / "siconos_fc_lcp" / "lcp" / "lcp_exp_murty.dat")
    assert status(solve(M, q, Lemke(max_pivots=2, attempts=1))) == "max_pivots"
    rng = np.random.default_rng(0)
    dense, target = positive_definite(rng, 6), rng.normal(size=6)
    assert status(solve(dense, target, Lemke(tolerance=1e-30))) == "breakdown"
    for bad in (np.nan, np.inf):
        for M_bad, q_bad in ((M * np.where(np.eye(6) > 0, bad, 1.0), q), (M, np.where(q < 0, bad, q))):
            solution = solve(M_bad, q_bad)
            assert status(solution) == "invalid_input"
            np.testing.assert_array_equal(solution.value, np.zeros(6))


def test_throw_raises_on_failure():
    with pytest.raises(eqx.EquinoxRuntimeError, match="NaN, infinite"):
        solve(np.full((1, 1), np.nan), np.ones(1), throw=True)


def test_shapes_are_checked():
    with pytest.raises(Exception, match="q"):
        solve(np.ones((2, 2)), np.ones(3))


def test_empty_and_trivial_problems():
    empty = solve(np.zeros((0, 0)), np.zeros(0))
    assert status(empty) == "solved"
    assert empty.value.shape == (0,)
    trivial = solve(np.eye(3), np.array([0.0, 1.0, 2.0]))
    assert status(trivial) == "solved"
    assert int(trivial.stats["pivots"]) == 0
    np.testing.assert_array_equal(trivial.value, np.zeros(3))


def test_highly_degenerate_problem_does_not_cycle():
    """Every ratio of the first test ties, and the rank is one."""
    solution = solve(np.ones((20, 20)), -np.ones(20))
    assert status(solution) == "solved"
    np.testing.assert_allclose(np.sum(solution.value), 1.0, atol=ROUNDING)


def test_jit_vmap_and_scan_equal_a_loop():
    rng = np.random.default_rng(3)
    M = np.stack([positive_definite(rng, 6) for _ in range(6)])
    q = rng.normal(size=(6, 6))
    q[2] = np.abs(q[2])  # no pivots
    q[4, 0] = np.nan  # invalid
    loop = [solve(a, b) for a, b in zip(M, q, strict=True)]
    batch = jax.vmap(solve)(M, q)
    compiled = [jax.jit(solve)(a, b) for a, b in zip(M, q, strict=True)]
    _, scanned = jax.lax.scan(lambda carry, x: (carry, solve(*x).value), 0, (jnp.asarray(M), jnp.asarray(q)))
    for k in range(6):
        np.testing.assert_allclose(batch.value[k], loop[k].value, rtol=ROUNDING, atol=ROUNDING)
        np.testing.assert_allclose(compiled[k].value, loop[k].value, rtol=ROUNDING, atol=ROUNDING)
        np.testing.assert_allclose(scanned[k], loop[k].value, rtol=ROUNDING, atol=ROUNDING)
        assert status(jax.tree.map(lambda x, k=k: x[k], batch)) == status(loop[k])


def test_float32():
    """Single precision is judged at 1e-4 of the dimensionless problem and reaches about 1e-6."""
    rng = np.random.default_rng(5)
    M = positive_definite(rng, 30).astype(np.float32)
    q = rng.normal(size=30).astype(np.float32)
    solution = solve(M, q)
    assert solution.value.dtype == np.float32
    assert status(solution) == "solved"
    assert float(solution.stats["relative_residual"]) < 1e-5
