"""Compliance that is another in every trial or contact: the prior that holds them together, and a fit of such data."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from fit.test_dynamic import EVENTS, C, T, measurement, values

from icjax.capture import capture, read_session
from icjax.fit import (
    FitOptions,
    Parameter,
    Parameters,
    Problem,
    StaticEquilibrium,
    fit_record,
    fit_session,
    fit_text,
    solve,
)  # fmt: skip
from icjax.fit._changes import change_warnings, changed
from icjax.fit._solve import linearised
from icjax.inference import QUANTILE, Log, laplace
from icjax.laboratory import record

PERIOD = np.array([0, 0, 0, 1, 1, 1])
CHANGED = np.stack([C, C * [1.5, 0.8]])


def test_prior_of_what_all_have_in_common():
    """x = x0 + u + z: own variance on the diagonal, the shared one between rows of the same column only."""
    own, shared = np.array([0.2, 0.3, 0.4, 0.2, 0.3, 0.4]), 0.7
    one = Parameter("C", np.ones((2, 3)), "1", Log(), own, shared)
    P = np.asarray(jax.jacfwd(one.prior)(jnp.zeros(6)))
    expected = np.diag(own**2) + shared**2 * np.kron(np.ones((2, 2)), np.eye(3))
    np.testing.assert_allclose(np.linalg.inv(P.T @ P), expected, rtol=1e-12, atol=1e-14)
    with pytest.raises(ValueError, match="shared_sd needs a value with an axis"):
        Parameter("C", np.array(1.0), "1", Log(), 0.2, shared)
    with pytest.raises(ValueError, match="shared_sd needs a value"):
        Parameter("C", np.ones(2), "1", Log(), None, shared)
    with pytest.raises(ValueError, match="shared_sd -1"):
        Parameter("C", np.ones(2), "1", Log(), 0.2, -1.0)


def test_each_event_has_the_compliance_of_its_period():
    plain = measurement()
    changing = dataclasses.replace(plain, period=PERIOD)
    found = np.asarray(changing.deviation(values(compliance=CHANGED)))
    for row, own in enumerate(CHANGED):
        alone = np.asarray(plain.deviation(values(compliance=own)))
        np.testing.assert_allclose(found[row == PERIOD], alone[row == PERIOD], rtol=1e-14)


def test_hierarchical_fit_recovers_both():
    """From data that the model made, with the weak prior that all have in common and a change of half."""
    model = dataclasses.replace(measurement(), period=PERIOD)
    e = np.asarray(model.deviation(values(compliance=CHANGED)))
    model = dataclasses.replace(model, difference=np.stack([e[i, model.frames[i]] for i in range(EVENTS)]))
    rows = {key: Parameter(key, value, frozen=True) for key, value in values().items()}
    rows["compliance"] = Parameter("compliance", np.full((2, 2), 0.5), "rad/Nm", Log(), 0.5, 2.0)
    rows["damping time"] = Parameter("damping time", T, "s", Log(), 1.0)
    problem = Problem(Parameters(tuple(rows.values())), (model,))
    found = solve(problem)
    C_found = np.asarray(problem.parameters.values(found.value.x)["compliance"])
    x = found.value.x
    known = laplace(np.asarray(jax.jacfwd(problem.data)(x)), np.asarray(jax.jacfwd(problem.parameters.prior)(x)))
    # The prior's pull: a few hundredths of a standard deviation.
    np.testing.assert_array_less(np.abs(np.log(C_found / CHANGED)).ravel(), 0.5 * np.asarray(known.sd)[:4] + 1e-6)


@pytest.mark.slow
def test_a_session_whose_wrist_changes(tmp_path):
    """Two subjects recorded as two trials of one session: the change is seen by trial, and told."""
    soft, stiff = (0.25, 0.70, 0.45, 1.10), (0.11, 0.70, 0.45, 1.10)
    halves = [
        capture(read_session(record(tmp_path / name, seed=21, trials=1, contacts=6, catch=2, compliance=C).session))
        for name, C in (("soft", soft), ("stiff", stiff))
    ]
    recordings = list(halves[0].recordings)
    for item in halves[1].recordings:
        recordings.append(dataclasses.replace(item, name=f"second-{item.name}", catch_of=_second(item)))
    session = dataclasses.replace(halves[0], recordings=tuple(recordings))
    fit = fit_session(session, FitOptions(compliance_by="trial"))
    assert fit.made.periods == ("trial00", "second-trial00")
    wrist = [row[0] for row in fit.periods]
    for joint, truth in zip(wrist, (soft[0], stiff[0]), strict=True):
        assert abs(np.log(joint.compliance / truth)) < 3.0 * np.log(joint.width) / (2.0 * QUANTILE)
    assert wrist[0].compliance / wrist[1].compliance > 1.6
    assert wrist[1].upper < wrist[0].lower
    mean = np.sqrt(wrist[0].compliance * wrist[1].compliance)
    assert fit.joints[0].compliance == pytest.approx(mean, rel=1e-9)
    assert fit.joints[0].width < wrist[0].width * 1.05
    told = fit_record(fit, session)
    row = next(line for line in fit_text(told).splitlines() if line.startswith("trial00"))
    assert row.split()[1:4] == [f"{wrist[0].compliance:.3g}", f"[{wrist[0].lower:.3g},", f"{wrist[0].upper:.3g}]"]
    for parts, joints in zip(fit.periods, fit.made.periods, strict=True):
        assert all("such contacts there" in joint.refused for joint in parts if joint.refused), joints
    one = fit_session(session)
    assert "trials speak for different compliances" in one.warnings[-1]
    assert "wrist" in one.warnings[-1]
    with pytest.raises(ValueError, match="profiles are of one compliance"):
        fit_record(fit, session, told.paper, profiles=True)


def _second(item):
    return f"second-{item.catch_of}" if item.catch_of else item.catch_of


@pytest.mark.slow
def test_trials_of_one_compliance_are_not_called_different(fit):
    """Unless one's wrist yields by half more: then the wrist is named."""
    residual, data, prior = (np.asarray(a) for a in linearised(fit.made.problem, jnp.asarray(fit.solution.value.x)))
    found = changed(fit.made, data, prior, residual)
    assert min(found.values()) > 0.01
    assert not any("trials speak" in line for line in fit.warnings)
    length = fit.made.problem.measurements[0].whitening.shape[1]
    first = np.repeat([w.trial == fit.made.windows[0].trial for w in fit.made.windows], length)
    wrist = fit.made.problem.parameters.slices["compliance"].start
    moved = residual.copy()
    moved[: len(data)] += np.log(1.5) * data[:, wrist] * first
    found = changed(fit.made, data, prior, moved)
    assert found["wrist"] < 1e-4
    assert change_warnings(found)[0].startswith("trials speak for different compliances")
    windows = [w._replace(repetitions=tuple(r._replace(trials=4) for r in w.repetitions)) for w in fit.made.windows]
    shared = fit.made._replace(windows=tuple(windows))  # as if all trials shared two catch trials: rows count less
    size = np.sqrt((1.0 + 1.0 / 2.0) / (1.0 + 4.0 / 2.0))
    again = changed(shared, size * data, prior, np.concatenate([size * moved[: len(data)], moved[len(data) :]]))
    assert again == pytest.approx(found, rel=1e-6)
    assert change_warnings({"wrist": 0.4, "MP": 0.001}) == ()


@pytest.mark.slow
def test_one_trial_says_nothing_of_changes(fit):
    alone = fit.made._replace(windows=fit.made.windows[:3])
    assert changed(alone, np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(2)) == {}


def test_hierarchical_compliance_needs_to_know_its_row():
    """A measurement without periods would take [trial, joint] for a full matrix."""
    rows = Parameter("compliance", np.full((2, 2), 0.5), "rad/Nm", Log(), 0.5, 2.0)
    trial = StaticEquilibrium("first", np.arange(3.0), np.zeros((3, 2)), np.ones((3, 2)), 0.01)
    with pytest.raises(ValueError, match="'first' has no `period`.*'compliance of ...'"):
        Problem(Parameters((rows,)), (trial,))


def test_bad_choice():
    with pytest.raises(ValueError, match="compliance_by = 'day'"):
        FitOptions(compliance_by="day")
    with pytest.raises(ValueError, match="compliance_change = -1"):
        FitOptions(compliance_change=-1.0)
