"""Sessions in which something is wrong: left out and told, or refused in one line."""

import dataclasses
import json

import equinox as eqx
import jax
import numpy as np
import pytest

from icjax.fit import Minimum, _contacts, session_problem
from icjax.fit._copies import copied
from icjax.fit._options import FitOptions
from icjax.fit._problem import intervals
from icjax.fit._repetitions import aligned
from icjax.fit._result import _doubts, _warnings
from icjax.fit._windows import contact_frames, motion_of, without_contact
from icjax.recording import ContactEvents
from icjax.results import RESULTS, Solution

DOFS = (6, 7, 8, 9)
"""Wrist to DIP."""

FRAMES = ("time", "q", "q_covariance", "valid", "touching", "markers", "marker_residual")
FRAMES += ("contact_force", "contact_point", "contact_moment")


@pytest.fixture(scope="module")
def small(session):
    """One trial of three contacts with its two catch trials."""
    trial = session.trials()[0]
    return dataclasses.replace(session, recordings=(trial, *session.catch_trials(trial.name)))


def changed(session, number, **fields):
    recordings = list(session.recordings)
    recordings[number] = dataclasses.replace(recordings[number], **fields)
    return dataclasses.replace(session, recordings=tuple(recordings))


def shortened(recording, frames):
    return eqx.tree_at(
        lambda item: [getattr(item, name) for name in FRAMES],
        recording,
        [np.asarray(getattr(recording, name))[:frames] for name in FRAMES],
    )


def solved(made):
    x = made.problem.parameters.start + 1.0
    return Solution(value=Minimum(x, np.array(0.0), x), result=RESULTS.solved, stats={})


def test_nothing_is_left_out(small):
    made = session_problem(small)
    assert made.left_out == ()
    assert [len(window.repetitions) for window in made.windows] == [2, 2, 2]


def test_catch_trial_that_touches_is_not_used(small):
    """Where it touches; the other one is."""
    trial, catch = small.recordings[0], small.recordings[2]
    touching = np.array(catch.touching)
    touching[round((trial.events.onset[0] - trial.time[0]) * trial.rate) :] = True
    made = session_problem(changed(small, 2, touching=touching))
    assert [len(window.repetitions) for window in made.windows] == [1, 1, 1]
    assert made.left_out == (
        "3 contacts are without one of their catch trials, which ends before, has a gap or touches, begins more "
        "than 4 times shift_sd earlier or later, or moves otherwise before them",
    )
    assert made.left_out[0] in _warnings(made, solved(made))


def test_catch_trial_far_off_in_time_is_not_used(small):
    """A tenth of a second later the shift that is looked for does not reach it; a wider `shift_sd` does."""
    late = changed(small, 2, time=np.asarray(small.recordings[2].time) + 0.1)
    made = session_problem(late)
    assert [len(window.repetitions) for window in made.windows] == [1, 1, 1]
    assert "earlier or later" in made.left_out[0]
    made = session_problem(late, FitOptions(shift_sd=0.06))
    assert [len(window.repetitions) for window in made.windows] == [2, 2, 2]
    np.testing.assert_allclose([w.repetitions[1].shift for w in made.windows], 0.1, atol=0.05)


def test_a_catch_trial_of_two_trials_counts_once(small):
    """Stated as a list or as a copy with another name: the mean errs alike at both trials, so that its variance counts
    twice among contacts that are taken for independent."""
    trial, catch, other = small.recordings[:3]
    again = dataclasses.replace(trial, name="again", q=np.asarray(trial.q) + 1e-3)
    lent = dataclasses.replace(catch, name="lent", catch_of="again")
    shared = dataclasses.replace(catch, catch_of=("trial00", "again"))
    copied = session_problem(dataclasses.replace(small, recordings=(trial, catch, other, again, lent)))
    stated = session_problem(dataclasses.replace(small, recordings=(trial, shared, other, again)))
    for made in (copied, stated):
        assert made.left_out == ()
        assert [[item.trials for item in window.repetitions] for window in made.windows] == 3 * [[2, 1]] + 3 * [[2]]
        np.testing.assert_allclose([_contacts.of_mean(window) for window in made.windows], 3 * [0.75] + 3 * [2.0])
        np.testing.assert_allclose(
            [_contacts.apparent(window) for window in made.windows],
            3 * [(1.5 / 1.75) ** 0.5] + 3 * [(2.0 / 3.0) ** 0.5],
        )
    np.testing.assert_allclose(
        copied.problem.measurements[0].whitening, stated.problem.measurements[0].whitening, rtol=1e-9, atol=1e-12
    )
    apart = session_problem(dataclasses.replace(small, recordings=(trial, catch, other)))
    window, motion = apart.windows[0], apart.motions["trial00"]
    own = _contacts.repeated_covariance(motion, window, stated.expected)
    doubled = _contacts.repeated_covariance(motion, stated.windows[0], stated.expected)
    np.testing.assert_allclose(doubled, own * 1.75 / 1.5, rtol=1e-12)


def test_copies_are_refused(small):
    """A catch trial with a rounded number is no new one, and no trial twice."""
    trial, catch, other = small.recordings[:3]
    again = dataclasses.replace(trial, name="again", q=np.asarray(trial.q) + 1e-3)
    both = dataclasses.replace(small, recordings=(trial, catch, other, again))
    with pytest.raises(ValueError, match="'trial00' and 'again' have one name or hold the same angles"):
        session_problem(
            dataclasses.replace(both, recordings=(*both.recordings[:3], dataclasses.replace(again, q=trial.q)))
        )
    with pytest.raises(ValueError, match="'catch00_2' holds the same angles as catch 'catch00'"):
        session_problem(changed(small, 2, q=np.asarray(catch.q) + 1e-9))


@pytest.mark.parametrize("cut", [0, 7, 60])
def test_copies_are_known_cut_and_rounded(small, cut):
    """As a file exported once more, from a later frame on and in single precision."""
    trial, catch, other = small.recordings[:3]
    q = np.asarray(trial.q, np.float32)[cut:] + 1e-6
    again = eqx.tree_at(lambda item: item.q, trial, q.astype(float))
    assert copied(trial, again)
    assert copied(again, trial)
    assert not copied(trial, catch)
    assert not copied(catch, other)


def test_what_is_suspicious_of_the_recordings_is_told_by_the_fit(small):
    """Once for all recordings of which the same is said but for its numbers."""
    assert _doubts(small) == []
    doubted = small
    for number, peak in enumerate((2.5, 3.1)):
        provenance = json.loads(small.recordings[number].provenance)
        told = {**provenance, "doubts": [f"channel 'Fz' stays at its largest value {peak}; saturated?"]}
        doubted = changed(doubted, number, provenance=json.dumps(told))
    assert _doubts(doubted) == ["trial00, catch00: channel 'Fz' stays at its largest value 2.5; saturated?"]


def test_a_catch_trial_without_a_force_is_told(small):
    """One of six that touched gave the wrist 0.197 [0.158, 0.241] for 0.25, and nothing else told."""
    catch = small.recordings[1]
    none = {name: np.asarray(getattr(catch, name))[:, :0] for name in FRAMES if name.startswith(("contact_", "touch"))}
    none |= {"contact_names": (), "contact_bodies": (), "contact_kinds": ()}
    none |= dict.fromkeys(("contact_force_sd", "contact_point_sd"))
    (line,) = _doubts(changed(small, 1, **none))
    assert line.startswith("catch00: a catch trial without a force")


def test_single_precision_is_refused(small):
    with jax.enable_x64(False), pytest.raises(ValueError, match="a fit needs double precision"):
        session_problem(small)


def test_a_short_window_counts_whole_frames(small):
    """0.03 s are six frames of 200 Hz, which rounding had made five and 5 of 9 contacts too short."""
    made = session_problem(small, FitOptions(after=0.03))
    assert len(made.windows) == 3


def test_catch_trial_of_another_movement_is_none(session, small):
    """It would be taken for what the trial had done without contact."""
    other = session.catch_trials(session.trials()[1].name)[0]
    wrong = dataclasses.replace(other, catch_of=small.recordings[0].name)
    made = session_problem(dataclasses.replace(small, recordings=(*small.recordings[:2], wrong)))
    assert [len(window.repetitions) for window in made.windows] == [1, 1, 1]
    (line,) = made.left_out
    assert line.startswith("3 contacts are without one of their catch trials")
    with pytest.raises(ValueError, match=r"3 have no catch trial .* of it and moves as it does"):
        session_problem(dataclasses.replace(small, recordings=(small.recordings[0], wrong)))


def test_short_clips_without_catch_trials(small):
    """They say nothing of how movement goes on, and that is said; a longer trial beside them does."""
    trial, noise = small.recordings[0], np.diag([1e-7] * 4)
    clip, whole = motion_of(shortened(trial, 100), DOFS), motion_of(trial, DOFS)
    with pytest.raises(
        ValueError, match=r"without a catch trial \('trial00'\): 0 stretches of 0.3\d* s without contact"
    ):
        _contacts._learn_movement([clip], noise, FitOptions())
    both, alone = (_contacts._learn_movement(motions, noise, FitOptions()) for motions in ([clip, whole], [whole]))
    np.testing.assert_allclose(both.reach, alone.reach)


def test_force_that_measures_no_friction_is_told(small):
    """On the plate of the studio, MP came out as 0.385 [0.349, 0.424], and is 0.70."""
    made = session_problem(changed(small, 0, contact_kinds=("normal",)))
    (line,) = _warnings(made, solved(made))
    assert line.startswith("plate: only the normal force was measured")


def test_contacts_left_out_are_told(small):
    trial = small.recordings[0]
    force = np.array(trial.contact_force)
    onset = round((trial.events.onset[1] - trial.time[0]) * trial.rate)
    force[onset + 10 : onset + 20] = np.nan
    with pytest.raises(ValueError, match=r"2 contacts .* needs 3; 1 of 3 contacts are left out: 1 have frames without"):
        session_problem(changed(small, 0, contact_force=force))
    ends = [shortened(item, round(item.rate * 0.5)) for item in small.recordings[1:]]
    with pytest.raises(ValueError, match=r"3 of 3 contacts are left out: 3 have no catch trial that lasts as long"):
        session_problem(dataclasses.replace(small, recordings=(trial, *ends)))
    few = [shortened(item, 3) for item in small.recordings[1:]]
    with pytest.raises(ValueError, match=r"3 have no catch trial that lasts as long"):
        session_problem(dataclasses.replace(small, recordings=(trial, *few)))


def test_a_contact_stated_too_late_is_left_out(small):
    """By 150 ms: its force was taken for none, and the movement under it for free."""
    trial = small.recordings[0]
    late = eqx.tree_at(lambda item: item.events.onset, trial, np.asarray(trial.events.onset) + [0.0, 0.06, 0.0])
    with pytest.raises(ValueError, match="1 of 3 contacts are left out: 1 are pushed before their stated onset"):
        session_problem(dataclasses.replace(small, recordings=(late, *small.recordings[1:])))


def test_frames_must_be_evenly_spaced(small):
    time = np.array(small.recordings[2].time)
    time[700:] += 0.3
    with pytest.raises(ValueError, match=r"catch 'catch00_2': frame 701 comes 0\.30\d* s after the one before"):
        session_problem(changed(small, 2, time=time))


def test_force_unknown_near_a_window(small):
    """The filter carries a gap of the force into the frames beside it."""
    trial = small.recordings[0]
    onset = round((trial.events.onset[1] - trial.time[0]) * trial.rate)
    force = np.array(trial.contact_force)
    force[onset + 58] = np.nan  # 116 ms after onset; 100 are compared
    found = session_problem(changed(small, 0, contact_force=force), FitOptions(after=0.09)).left_out
    assert found == ()
    with pytest.raises(ValueError, match="1 have frames without pose or force"):
        session_problem(changed(small, 0, contact_force=force))


def test_sessions_that_cannot_be_fitted(small):
    trial, catch = small.recordings[:2]
    with pytest.raises(ValueError, match="catch 'catch00' holds the same angles as trial 'trial00'"):
        session_problem(changed(small, 1, q=trial.q))
    with pytest.raises(ValueError, match="catch 'catch00_2' holds the same angles as catch 'catch00'"):
        session_problem(changed(small, 2, q=catch.q))
    with pytest.raises(ValueError, match="catch 'catch00': no frame has a pose"):
        session_problem(changed(small, 1, valid=np.zeros(len(catch.time), bool)))
    with pytest.raises(ValueError, match="catch 'catch00': 1 frames"):
        session_problem(dataclasses.replace(small, recordings=(trial, shortened(catch, 1))))
    with pytest.raises(ValueError, match="trial 'trial00': q_covariance is not finite"):
        session_problem(changed(small, 0, q_covariance=np.full_like(trial.q_covariance, np.nan)))
    with pytest.raises(ValueError, match="trial 'trial00': q_offset_sd .* is not finite"):
        session_problem(
            changed(small, 0, q_offset_sd=np.full_like(trial.q_offset_sd, np.nan), q_offset_covariance=None)
        )
    other = dataclasses.replace(trial, name="other", contact_names=("glass",))
    with pytest.raises(ValueError, match="'other': its contacts are glass, those of 'trial00' plate"):
        session_problem(dataclasses.replace(small, recordings=(trial, other)))
    nothing = dataclasses.replace(trial.model, body_mass=np.zeros_like(trial.model.body_mass))
    with pytest.raises(ValueError, match="no body that its compliant joints move has a mass"):
        session_problem(
            dataclasses.replace(
                small, recordings=tuple(dataclasses.replace(item, model=nothing) for item in small.recordings)
            )
        )


def test_torque_that_never_varies(small, monkeypatch):
    """Though it differs from joint to joint."""
    from icjax.fit import _session as made

    real = made.motion_of

    def constant(recording, dofs):
        motion = real(recording, dofs)
        return motion._replace(torque=np.tile([0.1, 0.05, 0.02, 0.01], (len(motion.torque), 1)))

    monkeypatch.setattr(made, "motion_of", constant)
    with pytest.raises(ValueError, match="the contact torque never varies"):
        session_problem(small)


def test_two_contacts_at_one_time_share_a_window(small):
    """That of the first event; both had been left out."""
    trial = small.recordings[0]
    onset, release = (np.repeat(np.asarray(x)[:1], 2) for x in (trial.events.onset, trial.events.release))
    twice = dataclasses.replace(trial, events=ContactEvents(onset=onset, release=release, contact=np.zeros(2, int)))
    once, both = (motion_of(item, DOFS) for item in (trial, twice))
    assert contact_frames(both, 0, FitOptions()) == contact_frames(once, 0, FitOptions())
    first, onset, _ = contact_frames(both, 1, FitOptions())
    assert first == onset


def test_gap_of_a_repetition_is_not_bridged():
    time = np.arange(0.0, 2.0, 0.002)
    angle = np.sin(time)[:, None]
    kept = (time < 1.0) | (time > 1.1)
    at = np.arange(0.7, 1.3, 0.008)
    found = aligned(time[kept], angle[kept], at, np.sin(at)[:, None], at < 0.95, np.array([1e-3]), 0.015)
    known = np.isfinite(found.angle[:, 0])
    np.testing.assert_array_equal(
        known, (at + found.shift <= time[time < 1.0][-1]) | (at + found.shift >= time[time > 1.1][0])
    )
    kept[(time > 0.5) & (time < 0.515)] = False  # short enough to interpolate
    again = aligned(time[kept], angle[kept], at - 0.25, np.sin(at - 0.25)[:, None], at < 0.95, np.array([1e-3]), 0.015)
    assert np.isfinite(again.angle[at < 1.2]).all()


def test_frames_near_a_touch_do_not_count(small):
    catch = small.recordings[1]
    touching = np.zeros_like(np.asarray(catch.touching))
    touching[500:503] = True
    point = np.nan_to_num(np.asarray(catch.contact_point))
    motion = motion_of(dataclasses.replace(catch, touching=touching, contact_point=point), DOFS)
    valid = without_contact(motion, 0.02, 0.1).valid
    np.testing.assert_array_equal(np.flatnonzero(~valid), np.arange(490, 553))


def test_units_do_not_make_directions_blind():
    """Of a compliance beside a sensor's delay in s, as hundreds of contacts tell it: all joints had been refused."""
    found = intervals(np.diag([0.1, 2e4]), np.diag([1.0, 2e3]))
    np.testing.assert_allclose(found.sd, [1.01**-0.5, (4e8 + 4e6) ** -0.5])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"before": 250.0}, "before = 250.0 s: must be 0.05 to 2 s"),
        ({"before": 0.01}, "before"),
        ({"after": 0.01}, "after"),
        ({"settle": 150.0}, "settle"),
        ({"shift_sd": 15.0}, "shift_sd"),
        ({"spacing": 8.0}, "spacing"),
        ({"spacing": 1e-12}, "spacing"),
        ({"shift_sd": 0.0}, "shift_sd"),
        ({"compliance_sd": 0.1}, "compliance_sd = 0.1 with widest = 4.0: must be at least 0.71"),
        ({"widest": 100.0}, "with widest = 100.0"),
    ],
)
def test_options_that_cannot_be_meant(options, words):
    with pytest.raises(ValueError, match=words):
        FitOptions(**options)


def test_nothing_but_what_is_fitted(small, monkeypatch):
    """A body whose every degree of freedom is fitted carries nothing along, and nothing of that is unknown."""
    made = session_problem(small)
    monkeypatch.setattr(_contacts, "rest_of", lambda motion: ())
    windows = [window._replace(aside=window.aside[:, :0]) for window in made.windows]
    motions = {name: motion._replace(rest_torque=motion.rest_torque[:, :0]) for name, motion in made.motions.items()}
    found = _contacts.measured(windows, motions, made.groups, made.expected, FitOptions())
    assert found.carried_doubt is None
    assert not np.any(found.carried)
    assert "carried" not in found.uses
