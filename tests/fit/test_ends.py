"""Ends of intervals by the rise of the cost, against the profile in which all others are fitted anew."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.fit import Parameter, Parameters, Problem, profile, solve
from icjax.fit._ends import likelihood_ends
from icjax.inference import QUANTILE, Log, laplace


class Deflection(eqx.Module):
    """A deflection of 1.0 C seen to 0.05, and another quantity that goes along with it."""

    seen: float
    name: str = eqx.field(static=True, default="deflection")
    uses: tuple[str, ...] = eqx.field(static=True, default=("C", "b"))

    def residual(self, values):
        return jnp.stack([(self.seen - values["C"]) / 0.05, (1.0 - values["b"] - 0.3 * values["C"]) / 0.2])


def solved(seen, prior_sd=1.5):
    stated = Parameters((Parameter("C", np.array(0.5), "1", Log(), prior_sd), Parameter("b", np.array(0.0))))
    problem = Problem(stated, (Deflection(seen),))
    x = solve(problem, tolerance=1e-12).value.x
    known = laplace(np.asarray(jax.jacfwd(problem.data)(x)), np.asarray(jax.jacfwd(stated.prior)(x)))
    return problem, np.asarray(x), known


@pytest.mark.parametrize("seen", [0.02, 0.15, 3.0])
def test_ends_are_those_of_the_profile(seen):
    """Of the problem without a prior of the number, to a hundredth of a standard deviation; b has none."""
    problem, x, known = solved(seen)
    lower, upper = likelihood_ends(problem, x, known, np.array([[1.0, 0.0], [0.0, 1.0]]))
    free, at, _ = solved(seen, prior_sd=100.0)
    for index, found in enumerate((profile(free, at, 0), profile(problem, x, 1))):
        assert found.lower == lower[index] or abs(found.lower - lower[index]) < 0.02 * known.sd[index]
        assert abs(found.upper - upper[index]) < 0.02 * known.sd[index]


def test_a_small_compliance_is_bounded_above_only():
    """Seen by 0.4 of its deviation: no lower end, whatever was assumed of it, and Laplace's with its prior has one."""
    for prior_sd in (0.8, 1.5):
        problem, x, known = solved(0.02, prior_sd)
        lower, upper = likelihood_ends(problem, x, known, np.array([[1.0, 0.0]]))
        assert np.isinf(lower[0])
        assert known.sd[0] < prior_sd
        np.testing.assert_allclose(np.exp(upper[0]), 0.02 + 0.05 * QUANTILE, rtol=0.02)


def test_a_narrow_prior_moves_no_end():
    """Only the value: of what is well seen the interval is the data's."""
    ends = []
    for prior_sd in (0.4, 1.5):
        problem, x, known = solved(1.0, prior_sd)
        ends.append([end[0] for end in likelihood_ends(problem, x, known, np.array([[1.0, 0.0]]))])
    np.testing.assert_allclose(*ends, atol=2e-3)


def test_linear_problems_have_the_intervals_of_laplace():
    problem, x, known = solved(3.0)
    along = np.array([[0.0, 1.0]])
    lower, upper = likelihood_ends(problem, x, known, along)
    np.testing.assert_allclose([x[1] - lower[0], upper[0] - x[1]], QUANTILE * known.sd[1], rtol=0.01)


def test_what_nothing_determines():
    problem, x, known = solved(0.15)
    blind = laplace(np.zeros((1, 2)), np.array([[1.0, 0.0]]))
    lower, upper = likelihood_ends(problem, x, blind, np.eye(2))
    assert np.isfinite(upper[0])
    assert (lower[1], upper[1]) == (-np.inf, np.inf)
