"""Profile likelihood against intervals known in closed form."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.fit import Parameter, Parameters, Problem, profile, solve
from icjax.inference import QUANTILE, Identity, Log, laplace
from icjax.typing import Float, Real


class Line(eqx.Module):
    """y = slope t + offset, unit noise of `sd`."""

    name: str = eqx.field(static=True)
    t: Float[Real, " row"]
    y: Float[Real, " row"]
    sd: float
    uses: tuple[str, ...] = eqx.field(static=True, default=("slope", "offset"))

    def residual(self, values):
        return (jnp.asarray(self.y) - values["slope"] * jnp.asarray(self.t) - values["offset"]) / self.sd


def line(transform, slope, sd):
    """A problem whose slope is 1 and offset 0.3 in the data."""
    t = np.linspace(0.0, 2.0, 9)
    parameters = Parameters(
        (Parameter("slope", np.array(slope), transform=transform), Parameter("offset", np.array(0.0)))
    )
    return Problem(parameters, (Line("line", t, t + 0.3, sd),)), t


def found(problem):
    return np.asarray(solve(problem).value.x)


def test_of_a_linear_problem_is_laplace():
    problem, t = line(Identity(), 0.5, 0.2)
    x = found(problem)
    known = laplace(np.stack([-t / 0.2, np.full_like(t, -5.0)], axis=1), np.zeros((0, 2)))
    for index in range(2):
        told = profile(problem, x, index)
        np.testing.assert_allclose(
            [told.lower, told.upper], x[index] + QUANTILE * known.sd[index] * np.array([-1, 1]), rtol=6e-3
        )
        np.testing.assert_allclose(told.rise, ((told.x - x[index]) / known.sd[index]) ** 2, atol=1e-8)


def test_does_not_depend_on_the_transform():
    """In the logarithm it is asymmetric, and its ends are those of the slope itself."""
    straight, t = line(Identity(), 0.5, 0.4)
    logarithmic, _ = line(Log(), 0.5, 0.4)
    one, other = profile(straight, found(straight), 0), profile(logarithmic, found(logarithmic), 0)
    np.testing.assert_allclose(np.exp([other.lower, other.upper]), [one.lower, one.upper], rtol=0.01)
    assert -other.lower > 1.3 * other.upper


def test_a_slope_that_may_be_zero_has_no_lower_end():
    """Zero is within the interval of the slope, so nothing bounds its logarithm from below."""
    problem, t = line(Log(), 0.5, 2.0)
    told = profile(problem, found(problem), 0)
    assert told.lower == -np.inf
    deviation = 2.0 / np.sqrt(np.sum((t - t.mean()) ** 2))
    assert np.exp(told.upper) == pytest.approx(1.0 + QUANTILE * deviation, rel=0.01)
    assert told.rise[told.x < 0.0].max() < QUANTILE**2


def test_bad_input():
    problem, _ = line(Identity(), 0.5, 0.2)
    with pytest.raises(ValueError, match="index 2: the problem has the numbers 0 to 1"):
        profile(problem, np.zeros(2), 2)
    with pytest.raises(ValueError, match=r"x has the shape \[3\]"):
        profile(problem, np.zeros(3), 0)
    with pytest.raises(ValueError, match="lower than where the profile began"):
        profile(problem, np.array([0.2, 0.0]), 0)
