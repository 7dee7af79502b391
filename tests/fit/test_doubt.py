"""Hyperparameters of the variability integrated out, against fits whose whole problem is made anew."""

import jax.numpy as jnp
import numpy as np
import pytest

from icjax.fit import FitOptions
from icjax.fit._contacts import measured
from icjax.fit._doubt import with_doubt
from icjax.fit._problem import Problem
from icjax.fit._result import intervals
from icjax.fit._solve import linearised


@pytest.mark.slow
def test_total_covariance(fit):
    """Mean of covariances and spread of minima, every problem built from its contacts with other variability."""
    made, x = fit.made, jnp.asarray(fit.solution.value.x)

    def minimum(variability):
        expected = made.expected._replace(variability=variability)
        again = measured(list(made.windows), made.motions, made.groups, expected, FitOptions())
        r, data, prior = (np.asarray(a) for a in linearised(Problem(made.problem.parameters, (again,)), x))
        J = np.concatenate([data, prior])
        return -np.linalg.lstsq(J, r, rcond=None)[0], np.linalg.inv(J.T @ J)

    variability = made.expected.variability
    still, S = minimum(variability)
    assert np.max(np.abs(still) / np.sqrt(np.diagonal(S))) < 1e-3
    total = S.copy()
    for joint, H in enumerate(variability.doubt):
        values, axes = np.linalg.eigh(H)
        for value, axis in zip(values, axes.T, strict=True):
            (a, Sa), (b, Sb) = (minimum(variability.moved(joint, s * np.sqrt(value) * axis)) for s in (1.0, -1.0))
            total += 0.5 * (Sa + Sb - 2.0 * S) + 0.25 * np.outer(a - b, a - b)
    np.testing.assert_allclose(fit.laplace.sd, np.sqrt(np.diagonal(total)), rtol=1e-4)
    assert np.all(fit.laplace.sd[:4] > np.sqrt(np.diagonal(S))[:4])


@pytest.mark.slow
def test_what_is_known_adds_nothing(fit):
    residual, data, prior = (np.asarray(a) for a in linearised(fit.made.problem, jnp.asarray(fit.solution.value.x)))
    plain = intervals(data, prior)
    known = fit.made.expected._replace(variability=fit.made.expected.variability._replace(doubt=None))
    made = fit.made._replace(expected=known)
    assert with_doubt(plain, made, data, residual[: len(data)], FitOptions()) is plain
    nothing = np.zeros((4, 3, 3))
    made = fit.made._replace(expected=known._replace(variability=known.variability._replace(doubt=nothing)))
    found = with_doubt(plain, made, data, residual[: len(data)], FitOptions())
    np.testing.assert_allclose(found.sd, plain.sd, rtol=1e-9)
    np.testing.assert_allclose(found.learned, plain.learned, atol=1e-9)
