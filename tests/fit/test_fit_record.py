"""The reference of a fit with its band, and the record that outlives it."""

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import equinox as eqx
import jax
import numpy as np
import pytest
from view.example_fit import make_fit

import icjax.fit
from icjax.cli import _fit as verb
from icjax.cli import main
from icjax.files import layout_problems
from icjax.fit import FitOptions, FitRecord, check_fit, contact_free, fit_record, fit_text
from icjax.fit._check_fit import far_from_prior, unusual_chi2
from icjax.fit._make_record import wide_profiles
from icjax.recording import Session

ROUNDING = 1e-12
"""rad; of a few additions of angles in double precision."""


@pytest.fixture(scope="module")
def recorded(fit, session):
    return fit_record(fit, session, profiles=True)


@eqx.filter_jit
def deviation(problem, x):
    return problem.measurements[0].deviation(problem.parameters.values(x))


def same(one, other):
    leaves, form = jax.tree.flatten(one)
    others, other_form = jax.tree.flatten(other)
    assert form == other_form
    for a, b in zip(leaves, others, strict=True):
        np.testing.assert_array_equal(a, b)
        assert np.asarray(a).dtype == np.asarray(b).dtype


@pytest.mark.slow
def test_profile_intervals(recorded):
    """Those of Laplace where the joint is told well; both end where the cost is the same, so neither is far."""
    for index, joint in enumerate(recorded.joint_names[:2]):
        np.testing.assert_allclose(
            recorded.profile[:, index], [recorded.lower[index], recorded.upper[index]], rtol=0.04
        )
        assert f"{joint} [{recorded.profile[0, index]:.3g}" in fit_text(recorded)
    wide = recorded.profile[1] > 4.0 * recorded.profile[0]
    told = {line.split(":")[0] for line in recorded.warnings if "by profile likelihood" in line}
    assert told == {
        name for name, too, no in zip(recorded.joint_names, wide, recorded.refused, strict=True) if too and not no
    }
    assert np.all(recorded.profile[0] < recorded.compliance)
    assert np.all(recorded.profile[1] > recorded.compliance)
    assert "by profile likelihood:" not in fit_text(dataclasses.replace(recorded, profile=np.full((2, 4), np.nan)))


@pytest.mark.slow
def test_reference_and_its_band(fit):
    """Measured less deviation; the variance is that of the fit's numbers, by differences of e, and of the angles."""
    found, x = contact_free(fit), np.asarray(fit.solution.value.x)
    problem, window = fit.made.problem, fit.made.windows[1]
    motion = fit.made.motions[window.trial]
    rows = window.samples - window.first
    e = np.asarray(deviation(problem, x))[1][rows]
    np.testing.assert_allclose(found.angle[1, : len(rows)] + e, motion.angle[window.samples], atol=ROUNDING)
    step = 1e-4
    factor = np.linalg.cholesky(np.asarray(fit.laplace.covariance))
    changes = [
        np.asarray(deviation(problem, x + step * column) - deviation(problem, x - step * column))[1][rows] / (2 * step)
        for column in factor.T
    ]
    variance = np.sum(np.square(changes), axis=0) + np.diagonal(motion.noise)
    # central differences: step^2 times the third derivative, of order one in x
    np.testing.assert_allclose(found.sd[1, : len(rows)], np.sqrt(variance), rtol=1e-6)
    assert np.all(np.abs(found.correlation) <= 1.0)
    mean = np.mean(changes, axis=1)  # [number, joint] in units of the factor
    own = problem.parameters.slices["compliance"]
    expected = -np.sum(factor[own].T * mean, axis=0) / fit.laplace.sd[own] / np.linalg.norm(mean, axis=0)
    np.testing.assert_allclose(found.correlation[1], expected, rtol=1e-5)


@pytest.mark.slow
def test_what_nothing_determines_has_no_band(fit):
    """As if neither data nor prior said anything of the last joint: infinite once it is pushed, finite before."""
    blind, last = fit.laplace, fit.made.problem.parameters.slices["compliance"].stop - 1
    sd, covariance = np.array(blind.sd), np.array(blind.covariance)
    sd[last], covariance[last], covariance[:, last] = np.inf, np.nan, np.nan
    lost = fit._replace(laplace=eqx.tree_at(lambda b: (b.sd, b.covariance), blind, (sd, covariance)))
    found, window = contact_free(lost), fit.made.windows[0]
    after = window.samples > window.onset + 5
    used = len(window.samples)
    assert np.isinf(found.sd[0, :used][after, -1]).all()
    assert np.isfinite(found.sd[0, :used][window.samples < window.onset - 60]).all()
    assert not np.isnan(found.sd[0, :used]).any()
    assert np.isnan(found.correlation[0, -1])


@pytest.mark.slow
def test_record_of_a_fit(fit, session, recorded, tmp_path):
    path = tmp_path / "fit.nc"
    recorded.save(path)
    assert [item.name for item in tmp_path.iterdir()] == ["fit.nc"]
    same(recorded, FitRecord.load(path))
    assert layout_problems(path, FitRecord) == []
    assert not [line for line in check_fit(recorded) if line.startswith("error: ")]
    assert recorded.catch_trials == 8
    assert recorded.joint_names == recorded.paper.joint_names
    assert recorded.parameters.parameter_names == fit.made.problem.parameters.names
    np.testing.assert_allclose(recorded.parameters.value[:4], recorded.compliance)
    windows = recorded.windows
    y = windows.angle - windows.repetition - windows.deviation
    before = windows.drift_sd == 0.0
    np.testing.assert_allclose(windows.drift[before], y[before], atol=1e-9)
    after = windows.drift_sd > 0.0
    assert np.mean(((y - windows.drift)[after] / windows.drift_sd[after]) ** 2) < 3.0


@pytest.mark.slow
def test_verb_is_interrupted_and_goes_on(session, fit, recorded, tmp_path, capsys, monkeypatch):
    session.save(tmp_path / "recording.nc")

    def interrupted(now):
        if now.step == 3:
            raise KeyboardInterrupt
        return ""

    with monkeypatch.context() as patch:
        patch.setattr(verb, "_told", interrupted)
        assert main(["fit", str(tmp_path / "recording.nc")]) == 130
    assert "--resume goes on from there" in capsys.readouterr().err
    (kept,) = tmp_path.glob("*.checkpoint")

    def at_its_end(*arguments, checkpoint, keep_checkpoint):
        assert keep_checkpoint
        assert checkpoint == kept
        return fit

    def too_late(*arguments, **options):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(icjax.fit, "fit_session", at_its_end)
        patch.setattr(icjax.fit, "fit_record", too_late)
        assert main(["fit", str(tmp_path / "recording.nc"), "--resume"]) == 130
    assert "--resume goes on from there" in capsys.readouterr().err
    assert kept.exists()
    assert main(["fit", str(tmp_path / "recording.nc"), "--resume"]) == 0
    told = capsys.readouterr().out
    assert not kept.exists()
    (path,) = tmp_path.glob("fit_*.nc")
    found = FitRecord.load(path)
    np.testing.assert_allclose(found.compliance, recorded.compliance, rtol=1e-3)
    same(found.paper, recorded.paper)
    assert fit_text(found) in told
    assert main(["check", str(path)]) == 0


def test_made_up_record(tmp_path):
    made = make_fit()
    made.save(tmp_path / "fit.nc")
    same(made, FitRecord.load(tmp_path / "fit.nc"))
    assert not [line for line in check_fit(made) if line.startswith("error: ")]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda fit: dataclasses.replace(fit, lower=fit.upper * 2.0), "its own interval"),
        (lambda fit: dataclasses.replace(fit, refused=("",)), "refused has 1 entries for 2 joints"),
        (lambda fit: dataclasses.replace(fit, chi2=1.5), "mean square of the residuals"),
        (lambda fit: eqx.tree_at(lambda f: f.windows.reference, fit, fit.windows.angle), "less the deviation"),
        (lambda fit: eqx.tree_at(lambda f: f.windows.onset, fit, fit.windows.onset + 9.0), "is not within it"),
        (lambda fit: eqx.tree_at(lambda f: f.windows.time, fit, -fit.windows.time), "do not increase"),
        (lambda fit: eqx.tree_at(lambda f: f.parameters.value, fit, fit.parameters.value + 9.0), "'sensor delay'"),
        (lambda fit: dataclasses.replace(fit, options="[1]"), "options is no JSON text of names and values"),
        (lambda fit: dataclasses.replace(fit, options="{}"), "widest is None"),
        (lambda fit: dataclasses.replace(fit, refused=("", "")), "'MP' has a number, yet its interval spans"),
        (lambda fit: dataclasses.replace(fit, catch_trials=0), "yet it has no catch trials"),
        (lambda fit: dataclasses.replace(fit, trials=(*fit.trials, fit.trials[0])), "is there twice"),
    ],
)
def test_records_that_contradict_themselves(change, words):
    assert [line for line in check_fit(change(make_fit())) if line.startswith("error: ") and words in line]


def test_far_from_the_prior_is_told():
    made = make_fit()
    assert far_from_prior(made.parameters) == ()
    far = eqx.tree_at(lambda f: f.parameters.nominal, made, np.array([0.5, 20.0, 0.0]))
    (line,) = far_from_prior(far.parameters)
    assert line == "'compliance MP' is 0.7 rad/Nm, 3.4 standard deviations of its prior from 20"


@pytest.mark.parametrize(("chi2", "words"), [(37.0, "intervals are too narrow"), (0.1, "intervals are too wide")])
def test_unusual_residuals_are_told(chi2, words):
    odd = dataclasses.replace(make_fit(), chi2=chi2)
    assert any(line.startswith("suspicious: ") and words in line for line in check_fit(odd))


def test_few_residuals_may_be_larger_by_chance():
    assert unusual_chi2(1.3, 1056) == unusual_chi2(1.4, 500) == ()
    (line,) = unusual_chi2(1.3, 8000)
    assert "too narrow by a factor of 1.1 at least" in line


def test_nothing_slow_stands_between_fit_and_record(tmp_path, monkeypatch):
    """Ctrl-C while the paper's estimate is made had lost a finished fit."""
    session = Session(name="s", subject="", recordings=())
    monkeypatch.setattr(verb.Fit, "_session", lambda self: (session, tmp_path))
    monkeypatch.setattr(session.__class__, "trials", lambda self: (SimpleNamespace(name="t"),))
    asked = []

    def estimates(*arguments):
        asked.append("paper")
        raise KeyboardInterrupt

    monkeypatch.setattr("icjax.estimation.estimates", estimates)
    monkeypatch.setattr("icjax.fit.fit_session", lambda *arguments, **options: asked.append("fit"))
    with pytest.raises(KeyboardInterrupt):
        verb.Fit(Path("recording.nc")).run()
    assert asked == ["paper"]


def test_table_of_the_verb():
    lines = fit_text(make_fit()).splitlines()
    assert lines[1].split() == ["wrist", "0.25", "[0.227,", "0.276]", "99%", "0.18", "[0.1,", "0.26]"]
    assert "refused" in lines[2]
    assert "not estimated" in lines[2]
    assert lines[2].endswith("< 2")
    assert lines[3].startswith("MP refused: its interval spans a factor of 9.4")
    assert lines[4].startswith("    ")
    assert max(map(len, lines)) <= 110
    assert verb.file_name("a/b c") == "a_b_c"


def test_a_fit_is_told_from_others_of_its_session():
    made = make_fit()
    assert made.title == made.name
    changing = dataclasses.replace(made, options=json.dumps({"compliance_by": "trial"}), catch_trials=0)
    assert changing.title == f"{made.name}, compliance by trial, no catch trials"
    assert check_fit(changing)[0].startswith(f"fit '{changing.title}': ")


def test_a_profile_that_would_refuse_a_joint_is_told():
    ends = np.array([[1.0, 1.0, 0.1], [2.0, 4.5, 9.0]])
    (line,) = wide_profiles(("a", "b", "c"), ("", "", "wide"), ends, 4.0)
    assert line.startswith("b: by profile likelihood the ends of its interval differ by a factor of 4.5, 4 at most")


def test_a_checkpoint_is_not_checked_as_a_session(tmp_path, capsys):
    (tmp_path / "fit.checkpoint").write_bytes(b"x")
    assert main(["check", str(tmp_path / "fit.checkpoint")]) == 2
    assert "is a checkpoint of a fit" in capsys.readouterr().err


def test_options_of_the_verb_are_those_of_the_fit():
    asked = verb.Fit(Path("recording.nc"))
    assert {name: getattr(asked, name) for name in verb.OPTIONS} == {
        name: getattr(FitOptions(), name) for name in verb.OPTIONS
    }
