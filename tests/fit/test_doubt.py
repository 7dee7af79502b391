"""Hyperparameters of the variability integrated out, against fits whose whole problem is made anew."""

import jax.numpy as jnp
import numpy as np
import pytest

from icjax.fit import FitOptions
from icjax.fit._contacts import measured
from icjax.fit._doubt import with_doubt
from icjax.fit._inertia import inertia_along
from icjax.fit._problem import Problem, intervals
from icjax.fit._solve import linearised


@pytest.mark.slow
def test_total_covariance(mixed, monkeypatch):
    """Mean of covariances and spread of minima, every problem built from its contacts with other variability and other
    planned movement."""
    made, x = mixed.made, jnp.asarray(mixed.solution.value.x)
    known = {}

    def inertia_once(motion, movement, groups, frames, by):
        key = motion.recording.name, int(frames[0])
        if key not in known:
            known[key] = inertia_along(motion, movement, groups, frames, by)
        return known[key]

    monkeypatch.setattr("icjax.fit._contacts.inertia_along", inertia_once)

    def minimum(**other):
        expected = made.expected._replace(**other)
        again = measured(list(made.windows), made.motions, made.groups, expected, FitOptions())
        r, data, prior = (np.asarray(a) for a in linearised(Problem(made.problem.parameters, (again,)), x))
        J = np.concatenate([data, prior])
        return -np.linalg.lstsq(J, r, rcond=None)[0], np.linalg.inv(J.T @ J)

    still, S = minimum()
    assert np.max(np.abs(still) / np.sqrt(np.diagonal(S))) < 1e-3
    total, wider = S.copy(), []
    for name in ("variability", "movement"):
        process, before = getattr(made.expected, name), total.copy()
        for joint, H in enumerate(process.doubt):
            values, axes = np.linalg.eigh(H)
            for value, axis in zip(values, axes.T, strict=True):
                step = np.sqrt(value) * axis
                (a, Sa), (b, Sb) = (minimum(**{name: process.moved(joint, s * step)}) for s in (1.0, -1.0))
                total += 0.5 * (Sa + Sb - 2.0 * S) + 0.25 * np.outer(a - b, a - b)
        wider.append(np.diagonal(total - before)[:4] / np.diagonal(S)[:4])
    np.testing.assert_allclose(mixed.laplace.sd, np.sqrt(np.diagonal(total)), rtol=1e-4)
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
