"""Other people's gait files, through the session file, capture and J^T f: Vicon's joint moments and OpenSim's example.

Every number here is a comparison with software that shares no code with icjax (Vicon Plug-in Gait, OpenSim).
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from icjax.capture import capture, plate_frame, plate_wrench, read_session
from icjax.estimation import joint_torque
from icjax.files import MotionFile, read_c3d

SESSIONS = Path(__file__).resolve().parents[2] / "experiments" / "sessions"

# The rule by which a stance is usable, see `reasons_against`.
EVENT_TOLERANCE = 0.05
"""s; between the plate's first or last load and Vicon's Foot Strike or Foot Off of that side."""
HEEL_TOE_MARGIN = 0.015
"""m; heel and toe markers may stand this far beside the plate: a marker's radius and the skin behind the heel."""
MOST_OUTSIDE = 0.02
"""Fraction of the loaded samples whose centre of pressure may lie beside the plate, which rings when it is struck."""
LEAST_COVERED = 0.95
"""Fraction of the stance for which Vicon must have computed the ankle moment."""

# What must be shown.
ANKLE_CORRELATION = 0.99
KNEE_CORRELATION = 0.95
SLOPE = 0.08
"""Of body mass. The quasi-static J^T f leaves out the foot's weight and inertia, and Vicon filters in its own way."""


class Stance(NamedTuple):
    """One foot on one plate, against Vicon."""

    trial: str
    side: str
    mass: float
    against: tuple[str, ...]
    ankle: tuple[float, float]
    knee: tuple[float, float]


def on_plate(motion: MotionFile, plate: int, points: np.ndarray, margin: float) -> np.ndarray:
    """Whether each point lies over the plate, in the plane of the plate."""
    R, p = plate_frame(motion.plates[plate])
    local = (points - p) @ R
    half = np.abs((motion.plates[plate].corners - p) @ R).max(axis=0)
    return np.all(np.abs(local[:, :2]) <= half[None, :2] + margin, axis=1)


def reasons_against(motion: MotionFile, plate: int, side: str, start: float, stop: float) -> tuple[str, ...]:
    """Why a stance cannot be compared; empty if it can. One rule for every file:

    the whole foot stood on this plate and no other (the plate is loaded from Vicon's Foot Strike to Foot Off of that
    side; heel and toe marker over it in mid stance; centre of pressure on it), and Vicon gives a moment.
    """
    reasons = []
    for label, time in (("Foot Strike", start), ("Foot Off", stop)):
        times = [event.time for event in motion.events if event.label == label and event.context[0] == side]
        if not times or min(abs(time - other) for other in times) > EVENT_TOLERANCE:
            reasons.append(f"no {label} event at {time:.2f} s")
    middle = np.argmin(np.abs(motion.marker_time - 0.5 * (start + stop)))
    feet = np.stack([motion.marker(side + name)[middle] for name in ("HEE", "TOE")])
    if not on_plate(motion, plate, feet, HEEL_TOE_MARGIN).all():
        reasons.append("heel or toe beside the plate")
    wrench = plate_wrench(motion, motion.plates[plate])
    loaded = (motion.analog_time >= start) & (motion.analog_time <= stop) & (wrench[:, 5] > 20.0)
    M, f = wrench[loaded, :3], wrench[loaded, 3:]
    pressure = np.stack([-M[:, 1] / f[:, 2], M[:, 0] / f[:, 2], np.zeros(len(f))], axis=1)  # plates lie in z = 0
    outside = 1.0 - on_plate(motion, plate, pressure, 0.0).mean()
    if outside > MOST_OUTSIDE:
        reasons.append(f"centre of pressure beside the plate for {outside:.0%} of it")
    inside = (motion.marker_time >= start) & (motion.marker_time <= stop)
    covered = np.isfinite(motion.outputs[side + "AnkleMoment"][inside, 0]).mean()
    if covered < LEAST_COVERED:
        reasons.append(f"Vicon gives a moment for {covered:.0%} of it")
    return tuple(reasons)


def compared(ours: np.ndarray, theirs: np.ndarray) -> tuple[float, float]:
    """Correlation and slope of ours over theirs."""
    both = np.isfinite(ours) & np.isfinite(theirs)
    return float(np.corrcoef(ours[both], theirs[both])[0, 1]), float(np.polyfit(theirs[both], ours[both], 1)[0])


def stances_of(spec, session) -> list[Stance]:
    """Every contact of every trial against Vicon's moments.

    Signs: the second component of the joint torque is about the axis to the left, in the distal segment, and is the
    torque *of the ground*; Plug-in Gait states the moment that muscles *answer* with, positive for plantar flexion
    at the ankle and for extension at the knee. A ground force ahead of the ankle turns the toes up (negative about
    left), answered by a positive plantar flexor moment: ankle = - tau. A ground force that flexes the knee is
    positive about left, answered by a positive extensor moment: knee = + tau.
    """
    found = []
    for recording, trial in zip(session.recordings, spec.trials, strict=True):
        motion = read_c3d(trial.markers)
        mass = motion.metadata["PROCESSING:Bodymass"]
        torque = np.asarray(joint_torque(recording))
        dofs = recording.model.dof_names
        for onset, release, contact in zip(
            recording.events.onset, recording.events.release, recording.events.contact, strict=True
        ):
            leg = recording.contact_bodies[contact][0]
            side = leg.upper()
            stance = (recording.time >= onset) & (recording.time <= release)
            ankle = -torque[stance, dofs.index(f"{leg}_ankle_y")]
            knee = torque[stance, dofs.index(f"{leg}_knee_ry")]
            vicon = {
                name: motion.outputs[f"{side}{name}Moment"][stance, 0] * 1e-3  # as labelled: Nmm
                for name in ("Ankle", "Knee")
            }
            found.append(
                Stance(
                    recording.name,
                    side,
                    mass,
                    reasons_against(motion, int(contact), side, float(onset), float(release)),
                    compared(ankle, vicon["Ankle"]),
                    compared(knee, vicon["Knee"]),
                )
            )
    return found


@pytest.fixture(scope="module")
def captured(shared_data):
    """Sessions through the verbs a user types, each captured once."""
    patch = pytest.MonkeyPatch()
    patch.setenv("ICJAX_SHARED_DATA", str(shared_data))
    done = {}

    def get(name: str):
        if name not in done:
            spec = read_session(SESSIONS / f"{name}.toml")
            done[name] = spec, capture(spec)
        return done[name]

    yield get
    patch.undo()


@pytest.fixture(scope="module")
def stances(captured):
    return [stance for name in ("btk_pig_47kg", "btk_pig_66kg") for stance in stances_of(*captured(name))]


@pytest.mark.slow
def test_usable_stances_are_chosen_by_one_rule(stances):
    """Six contacts in three walking trials; two of them are no whole foot on one plate."""
    usable = {(stance.trial, stance.side) for stance in stances if not stance.against}
    assert usable == {("full", "L"), ("hole", "L"), ("one", "R"), ("one", "L")}
    against = {(stance.trial, stance.side): stance.against for stance in stances if stance.against}
    assert set(against) == {("full", "R"), ("hole", "R")}
    assert all("heel or toe beside the plate" in reasons for reasons in against.values())


@pytest.mark.slow
def test_ankle_torque_agrees_with_vicon(stances):
    """The slope against Vicon's number is the body mass: the file says Nmm, the values are Nmm per kilogram."""
    for stance in stances:
        if not stance.against:
            correlation, slope = stance.ankle
            assert correlation >= ANKLE_CORRELATION, stance
            assert slope == pytest.approx(stance.mass, rel=SLOPE), stance


@pytest.mark.slow
def test_knee_torque_agrees_with_vicon(stances):
    for stance in stances:
        if not stance.against:
            assert stance.knee[0] >= KNEE_CORRELATION, stance


@pytest.mark.slow
def test_foot_strikes_agree_with_vicon_events(captured):
    """Vicon's events are whole frames of 10 ms that a person or a threshold has chosen: two frames."""
    for name in ("btk_pig_47kg", "btk_pig_66kg"):
        spec, session = captured(name)
        for recording, trial in zip(session.recordings, spec.trials, strict=True):
            motion = read_c3d(trial.markers)
            assert len(recording.events.onset) == 2
            for onset, contact in zip(recording.events.onset, recording.events.contact, strict=True):
                side = recording.contact_bodies[contact][0].upper()
                if (recording.name, side) == ("hole", "R"):
                    continue  # strikes the floor first and the plate later: no usable stance
                strikes = [
                    event.time for event in motion.events if event.label == "Foot Strike" and event.context[0] == side
                ]
                assert min(abs(onset - strike) for strike in strikes) <= 0.02


@pytest.mark.slow
def test_walking2_is_tared_and_both_heel_strikes_are_found(captured):
    """Unloaded plates push 14 and 20 N downwards on nobody; without the tare nothing would be right below that.

    The data's own notes give L 2.251-2.748 s, R 2.675-3.241 s, which is where the force crosses 40 N. The first touch
    is earlier and the last one later: at 4 to 7 N/ms after heel strike about 8 ms, at toe-off (2 N/ms) about 20 ms.
    """
    spec, session = captured("opensim_walking2")
    (recording,) = session.recordings
    motion = read_c3d(spec.trials[0].markers)
    quiet = motion.analog_time < 1.5
    for index, (plate, baseline) in enumerate(zip(motion.plates, (-13.8, -20.2), strict=True)):
        assert plate_wrench(motion, plate)[quiet, 5].mean() == pytest.approx(baseline, abs=0.5)
        tared = recording.channels.wrench[recording.channels.time < 1.5, index]
        np.testing.assert_allclose(tared.mean(axis=0), 0.0, atol=0.01)  # one sample more or less in the window
    assert [recording.contact_bodies[contact] for contact in recording.events.contact] == ["l_foot", "r_foot"]
    early = np.array([2.251, 2.675]) - recording.events.onset
    late = recording.events.release - np.array([2.748, 3.241])
    assert np.all((early > 0.0) & (early < 0.012)), early
    assert np.all((late > 0.0) & (late < 0.030)), late
    for contact in range(2):
        assert np.all(recording.contact_force[~recording.touching[:, contact], contact] == 0.0)


@pytest.mark.slow
def test_walking2_torque_where_the_markers_allow_it(captured):
    """Markers are complete from before each contact to toe-off: torques are known there and walk like a person's."""
    _, session = captured("opensim_walking2")
    (recording,) = session.recordings
    torque = np.asarray(joint_torque(recording))
    weight = recording.contact_force[:, :, 2].sum(axis=1)
    mass = weight[(recording.time > 2.70) & (recording.time < 2.74)].max() / 9.81 / 1.2  # peak is some 1.2 weights
    for leg, start, stop in (("l", 2.251, 2.748), ("r", 2.675, 3.241)):
        stance = (recording.time > start) & (recording.time < stop)
        assert recording.valid[stance].all()
        ankle = -torque[stance, recording.model.dof_names.index(f"{leg}_ankle_y")]
        assert 1.0 < ankle.max() / mass < 2.2  # Nm/kg; 1.4 to 1.8 in the literature of normal gait
        assert np.argmax(ankle) > 0.6 * len(ankle)  # push-off comes late
