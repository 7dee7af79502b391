"""Hyperparameters of the variability integrated out, against fits whose whole problem is made anew."""

import jax.numpy as jnp
import numpy as np
import pytest

from icjax.fit import FitOptions, _contacts
from icjax.fit._contacts import measured
from icjax.fit._doubt import with_doubt
from icjax.fit._problem import Problem, intervals
from icjax.fit._solve import linearised


def once(function):
    """A call of the same first frames is answered from memory."""
    known = {}

    def answered(first, *rest):
        key = (first.recording.name, int(rest[2][0])) if hasattr(first, "recording") else len(first)
        if key not in known:
            known[key] = function(first, *rest)
        return known[key]

    return answered


@pytest.mark.slow
def test_total_covariance(mixed, monkeypatch):
    """Mean of covariances and spread of minima, every problem built from its contacts with other variability and other
    planned movement."""
    made, x = mixed.made, jnp.asarray(mixed.solution.value.x)
    for name in ("inertia_along", "pushed"):  # what does not depend on them is computed once
        monkeypatch.setattr(_contacts, name, once(getattr(_contacts, name)))
    process = {"variability": made.expected.variability, "movement": made.expected.movement}
    for joint, name in enumerate(process):  # of one joint each, for time
        doubt = np.zeros_like(process[name].doubt)
        doubt[joint] = process[name].doubt[joint]
        process[name] = process[name]._replace(doubt=doubt)
    made = made._replace(expected=made.expected._replace(**process))

    def minimum(**other):
        expected = made.expected._replace(**other)
        again = measured(list(made.windows), made.motions, made.groups, expected, FitOptions())
        r, data, prior = (np.asarray(a) for a in linearised(Problem(made.problem.parameters, (again,)), x))
        J = np.concatenate([data, prior])
        return -np.linalg.lstsq(J, r, rcond=None)[0], np.linalg.inv(J.T @ J)

    still, S = minimum()
    assert np.max(np.abs(still) / np.sqrt(np.diagonal(S))) < 1e-3
    total, wider = S.copy(), []
    for joint, (name, known) in enumerate(process.items()):
        before = total.copy()
        values, axes = np.linalg.eigh(known.doubt[joint])
        for value, axis in zip(values, axes.T, strict=True):
            step = np.sqrt(value) * axis
            (a, Sa), (b, Sb) = (minimum(**{name: known.moved(joint, s * step)}) for s in (1.0, -1.0))
            total += 0.5 * (Sa + Sb - 2.0 * S) + 0.25 * np.outer(a - b, a - b)
        wider.append(np.diagonal(total - before)[:4] / np.diagonal(S)[:4])
    residual, data, prior = (np.asarray(part) for part in linearised(made.problem, x))
    found = with_doubt(intervals(data, prior), made, data, residual[: len(data)], FitOptions())
    np.testing.assert_allclose(found.sd, np.sqrt(np.diagonal(total)), rtol=1e-4)
    assert np.all(np.max(wider, axis=1) > 1e-3)


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
