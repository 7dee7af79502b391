"""Onset, reaction, secant stiffness: closed forms first, then the simulated perturbation sessions with truth."""

import json
from pathlib import Path

import numpy as np
import pytest

from icjax.capture import capture, read_session
from icjax.cli import main
from icjax.estimation import in_series, perturbation, perturbation_onset, reaction_time, secant_stiffness
from icjax.interaction import CompliancePerEvent, Interaction, JointCompliance
from icjax.recording import Session

SESSIONS = Path(__file__).resolve().parents[2] / "experiments" / "sessions"
REACTION = 0.095
"""s, what the simulated subject does."""


def ringing(t, reaction, random):
    """A force of 1 N that jumps, rings down, and is withdrawn."""
    passive = 1.3 + 0.8 * np.exp(-32 * t) * np.cos(58 * t - 0.4)
    force = np.where(t < 0, 1.0, passive) - 600 * np.maximum(t - reaction, 0) ** 2
    return np.maximum(force, 0.0) + 0.01 * random.standard_normal(len(t))


def test_onset_and_reaction_of_a_ringing_force():
    """The onset to a sample, the reaction to 4 ms (its interval) although the ringing never stops."""
    random = np.random.default_rng(3)
    time = np.arange(0.0, 1.2, 0.001)
    for reaction in (0.08, 0.095, 0.12):
        force = ringing(time - 0.7003, reaction, random)
        force[time < 0.2] = 0.01 * random.standard_normal(200)  # the first touch, a larger jump than the perturbation
        onset = perturbation_onset(time, force, time >= 0.2)
        assert onset == pytest.approx(0.7003, abs=0.001)
        found = reaction_time(time, force, onset)
        assert found.time == pytest.approx(reaction, abs=0.004)
        assert found.lower <= found.time <= found.upper


def test_no_perturbation_no_reaction():
    random = np.random.default_rng(1)
    time = np.arange(0.0, 1.0, 0.001)
    force = 1.0 + 0.01 * random.standard_normal(1000)
    with pytest.raises(ValueError, match="no contact lasts"):
        perturbation_onset(time, force, time > 0.95)
    with pytest.raises(ValueError, match="never leaves rest"):
        perturbation_onset(time, 1.0 + 0.01 * np.sin(2 * np.pi * time), time > -1)
    assert np.isnan(reaction_time(time, force, 0.5).time)


def test_secant_of_a_spring_in_two_directions():
    """u = G f: the stiffness along the force is 1 / (e^T G e) exactly, the vertical one is not k_G = 1 / G_zz."""
    time = np.arange(-0.1, 0.15, 0.002)
    G = np.array([[0.004, 0.0, 0.003], [0.0, 0.001, 0.0], [0.003, 0.0, 0.005]])
    df = np.array([-0.9, 0.0, 1.5])
    force = np.outer(time >= 0, df) + np.array([-0.5, 0.0, 1.0])
    found = secant_stiffness(time, force @ G, force, 0.0)
    e = df / np.linalg.norm(df)
    assert found.along == pytest.approx(1 / (e @ G @ e), rel=1e-12)
    assert found.stiffness == pytest.approx(1.5 / (G @ df)[2], rel=1e-12)
    assert found.stiffness > 1.3 / G[2, 2]
    upright = secant_stiffness(time, (force * [0, 0, 1]) @ G, force * [0, 0, 1], 0.0)
    assert upright.stiffness == pytest.approx(1 / G[2, 2], rel=1e-12) == upright.along


def test_secant_intervals_hold_the_mean_of_a_ringing_response():
    """White noise gives narrow intervals, ringing within the window wide ones."""
    random = np.random.default_rng(0)
    time = np.arange(-0.1, 0.15, 0.002)
    up = np.array([0.0, 0.0, 1.0])
    position = np.outer(0.005 * (time >= 0), up)
    steady = np.outer(1 + 0.4 * (time >= 0) + 0.01 * random.standard_normal(len(time)), up)
    ringing = steady + np.outer((time > 0) * 0.3 * np.cos(2 * np.pi * 10 * (time - 0.05)), up)
    calm, wide = (secant_stiffness(time, position, force, 0.0) for force in (steady, ringing))
    assert calm.lower < 80 < calm.upper
    assert calm.upper - calm.lower < 0.05 * 80
    assert wide.upper - wide.lower > 5 * (calm.upper - calm.lower)
    with pytest.raises(ValueError, match="holds 0 usable"):
        secant_stiffness(time, position, steady, 0.0, (0.3, 0.4))


@pytest.fixture(scope="module", params=["explore", "scratch"])
def session(request, shared_data):
    """The captured trials of a session with their truth."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ICJAX_SHARED_DATA", str(shared_data))
        recordings = capture(
            read_session(SESSIONS / f"virtual_perturb_{request.param}.toml"), trials=("trial00",)
        ).trials()
    folder = shared_data / "virtual_sessions" / f"perturb_{request.param}"
    return request.param, recordings, [dict(np.load(folder / f"{item.name}_truth.npz")) for item in recordings]


@pytest.mark.slow
def test_simulated_sessions(session):
    """Onset within a sample, reaction within 5 ms; what the short fit and the secant are, against the truth."""
    name, recordings, truths = session
    for recording, truth in zip(recordings, truths, strict=True):
        result = perturbation(recording, with_compliance(recording, truth["C"]), secant_window=(0.07, 0.09))
        assert result.onset == pytest.approx(float(truth["release_time"]), abs=0.001)
        assert result.reaction.time == pytest.approx(REACTION, abs=0.005)
        J, C = truth["J"], np.diag(truth["C"])
        G = J @ C @ J.T
        e = result.secant.direction[[0, 2]]
        along = 1 / (e @ G @ e)
        k_G = 1 / G[1, 1]
        # R2 says nothing: the fit of 25 ms is nearly perfect and its k is off by more than the whole of k_G.
        assert result.fit.r_squared > 0.99
        assert abs(result.fit.value[2] / k_G - 1) > 1
        assert result.fit.lower[2] < result.fit.upper[2]
        if name == "scratch":
            assert result.secant.along == pytest.approx(along, rel=0.15)
            assert result.secant.stiffness > 1.4 * k_G  # a finger that is held sideways
        assert in_series(result.secant.stiffness, 1 / 750) < result.secant.stiffness
        # With the true C only the posture differs: offsets of up to half a degree a joint.
        assert result.stiffness is not None
        assert result.stiffness.stiffness == pytest.approx(k_G, rel=0.05)
        assert result.stiffness.lower < k_G < result.stiffness.upper
        assert result.stiffness.share[-4] + result.stiffness.share[-3] > 0.9
        with pytest.raises(ValueError, match="'floor'"):
            perturbation(recording, contact="floor")


@pytest.mark.slow
def test_verb(session, tmp_path, capsys):
    """Prints the table with the literature beside it, writes numbers, refuses an unknown trial in one line."""
    name, recordings, _ = session
    path = tmp_path / "recording.nc"
    Session(name=name, subject="", recordings=recordings).save(path)
    assert main(["perturbation", str(path), "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    for word in ("trial00", "KPN03", "257.04", "reaction (ms)", "with pad"):
        assert word in printed
    content = json.loads((tmp_path / "perturbation.json").read_text(), parse_constant=pytest.fail)
    assert content["trials"]["trial00"]["reaction ms"] == pytest.approx(95, abs=5)
    assert main(["perturbation", str(path), "--trial", "trial09"]) == 2
    assert "trial09" in capsys.readouterr().err


def with_compliance(recording, C):
    """An interaction that knows the compliance of wrist, MP, PIP and DIP to 10 %."""
    names, C = ("wrist", "MP", "PIP", "DIP"), np.asarray(C, dtype=float)
    one, none = np.ones((1, 4)), np.zeros(4, dtype=np.int64)
    nv, nq = recording.model.nv, recording.model.nq
    return Interaction(
        name="known",
        model=recording.model,
        time=np.zeros(1),
        compliance=np.zeros((1, nv)),
        compliance_sd=np.zeros((1, nv)),
        reference=np.zeros((1, nq)),
        reference_sd=np.zeros((1, nv)),
        q=np.zeros((1, nq)),
        torque=np.zeros((1, nv)),
        contact_names=("plate",),
        contact_force=np.zeros((1, 1, 3)),
        contact_point=np.zeros((1, 1, 3)),
        per_event=CompliancePerEvent(
            recording=("known",),
            joint_names=names,
            onset=np.zeros(1),
            compliance=one,
            standard_error=one,
            status=np.zeros((1, 4), dtype=np.int64),
            r_squared=np.zeros((1, 4, 3)),
            torque_change=one,
            angle_before=np.zeros((1, 4, 2)),
            angle_after=np.zeros((1, 4, 2)),
            torque_after=np.zeros((1, 4, 2)),
            window=np.zeros(2),
        ),
        summary=JointCompliance(
            joint_names=names, compliance=C, lower=0.8 * C, upper=1.2 * C, accepted=none, negative=none, events=none
        ),
        friction=None,
        provenance="",
    )
