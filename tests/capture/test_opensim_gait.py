"""OpenSim's gait subject through joint angles from a file: import, events, and inverse dynamics against OpenSim's.

The reference was made by OpenSim from the same angles, forces and masses; no line of code is shared.
"""

from pathlib import Path

import equinox as eqx
import numpy as np
import pytest

from icjax.capture import capture, check, read_session
from icjax.capture._events import contact_events, force_course
from icjax.capture._load import load_trial
from icjax.capture._sensors import sensor_wrench
from icjax.estimation import joint_torque, net_joint_torque
from icjax.files import FileError, read_sto

SESSIONS = Path(__file__).resolve().parents[2] / "experiments" / "sessions"
SPAN = (0.6, 1.4)
"""s; right stance, left swing with the end of its stance."""
CUTOFF = 6.0
"""Hz, of subject01_Setup_InverseDynamics.xml."""
MOST = {"ankle_angle": 0.02, "subtalar_angle": 0.04, "knee_angle": 0.10, "hip_flexion": 0.15}
"""RMS error over RMS reference. OpenSim's filter passes less at the same stated cut-off (6 Hz is its half amplitude, of
third order), which shows in proportion to the mass that a joint swings; its knee is no hinge."""


@pytest.fixture(scope="module")
def session(shared_data):
    patch = pytest.MonkeyPatch()
    patch.setenv("ICJAX_SHARED_DATA", str(shared_data))
    spec = read_session(SESSIONS / "opensim_subject01.toml")
    patch.undo()
    return spec, capture(spec)


@pytest.fixture(scope="module")
def reference(shared_data):
    return read_sto(shared_data / "opensim_core_gait" / "subject01" / "std_subject01_InverseDynamics.sto")


def test_angles_become_coordinates_in_rad_and_m(session, shared_data):
    _, walk = session
    (recording,) = walk.recordings
    file = read_sto(shared_data / "opensim_core_gait" / "subject01" / "subject01_walk1_ik.mot")
    for name, coordinate in zip(recording.model.joint_names, recording.q.T, strict=True):
        column = file.channels((name,))[:, 0]
        exact = column if name.startswith("pelvis_t") and name != "pelvis_tilt" else np.deg2rad(column)
        np.testing.assert_array_equal(coordinate, exact)
    assert recording.valid.all()
    assert recording.marker_names == ()
    sd = np.sqrt(np.diagonal(recording.q_covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(sd[:, 3:], 0.0087, rtol=1e-7)  # single precision
    np.testing.assert_allclose(sd[:, :3], 0.001, rtol=1e-7)


def test_events_of_the_angles_time_only(session):
    """The force file holds 24 foot contacts in 15 s, the angle file 3.5 s of them.

    Times are where the file's vertical force crosses 20 N; it is smooth there, and the first touch lies up to 15 ms
    before.
    """
    _, walk = session
    (recording,) = walk.recordings
    bodies = [recording.contact_bodies[contact] for contact in recording.events.contact]
    assert bodies == ["calcn_l", "calcn_r"] * 3 + ["calcn_l"]
    strikes = np.array([0.6167, 1.245, 1.8517, 2.4583, 3.0767, 3.675])
    early = strikes - recording.events.onset[1:]
    assert np.all((early > 0.0) & (early < 0.015)), early


def test_inverse_dynamics_agrees_with_opensim(session, reference):
    _, walk = session
    (recording,) = walk.recordings
    tau = net_joint_torque(recording, CUTOFF)
    inside = (reference.analog_time >= SPAN[0]) & (reference.analog_time <= SPAN[1])
    for joint, most in MOST.items():
        for side in "rl":
            name = f"{joint}_{side}"
            ours = np.interp(reference.analog_time, recording.time, tau[:, recording.model.dof_names.index(name)])
            theirs = reference.channels((name + "_moment",))[:, 0]
            error = np.sqrt(np.mean((ours - theirs)[inside] ** 2) / np.mean(theirs[inside] ** 2))
            assert error <= most, (name, error)


def test_leg_torques_need_no_upper_body(session):
    """With the ground forces known, a leg's torques depend only on the segments beyond each joint."""
    _, walk = session
    (recording,) = walk.recordings
    model = recording.model
    light = np.array(model.body_mass)
    light[[model.body("torso"), model.body("pelvis")]] = 0.1
    tau = net_joint_torque(recording)
    other = net_joint_torque(eqx.tree_at(lambda r: r.model.body_mass, recording, light))
    legs = [index for index, name in enumerate(model.dof_names) if name.endswith(("_r", "_l"))]
    np.testing.assert_allclose(other[:, legs], tau[:, legs], atol=1e-9)  # rounding of some 100 Nm
    assert np.abs(other - tau)[:, model.dof_names.index("pelvis_ty")].max() > 100.0


def test_in_stance_gravity_and_inertia_are_a_small_part_of_the_ankle_torque(session):
    """tau_net is about minus J^T f: what the foot's weight and inertia add is below 5 % of the peak."""
    _, walk = session
    (recording,) = walk.recordings
    ankle = recording.model.dof_names.index("ankle_angle_r")
    stance = (recording.time > 0.65) & (recording.time < 1.35)
    net, contact = net_joint_torque(recording)[stance, ankle], np.asarray(joint_torque(recording))[stance, ankle]
    assert np.abs(net + contact).max() < 0.05 * np.abs(net).max()


def onsets(spec) -> dict[str, np.ndarray]:
    """Contact onsets of the first trial by source, without solving its markers."""
    trial = spec.trials[0]
    motion = load_trial(spec, trial)
    courses = {
        name: force_course(sensor_wrench(motion, trial, spec.source(name), spec.path), spec.filter.events, spec.contact)
        for name, _ in trial.touches
    }
    return {name: np.array(contact_events(course, spec.contact))[:, 0] for name, course in courses.items()}


def test_walk3d_strikes_where_its_notes_say(shared_data, monkeypatch):
    """The data's notes give the crossings of 20 N: right 0.266 and 1.411 s, left 0.836 s.

    These forces were low-pass filtered and need 20 ms for their first 20 N, so the first touch is up to 20 ms earlier.
    """
    monkeypatch.setenv("ICJAX_SHARED_DATA", str(shared_data))
    found = onsets(read_session(SESSIONS / "opensim_walk3d.toml"))
    for name, noted in (("right", [0.266, 1.411]), ("left", [0.836])):
        early = np.array(noted) - found[name]
        assert np.all((early > 0.0) & (early < 0.020)), early


def test_test_walking_strikes_each_plate_once(shared_data, monkeypatch):
    """Crossings of 20 N above the baseline, read off the file: 1.2335 s and 1.6465 s."""
    monkeypatch.setenv("ICJAX_SHARED_DATA", str(shared_data))
    found = onsets(read_session(SESSIONS / "opensim_test_walking.toml"))
    for name, crossing in (("plate1", 1.2335), ("plate2", 1.6465)):
        assert len(found[name]) == 1
        assert 0.0 < crossing - found[name][0] < 0.015


@pytest.mark.slow
def test_walk3d_ankles_walk_like_a_persons(shared_data, monkeypatch):
    """Contact torque at the ankle, about the axis to the right: it turns the toes up, most of all at push-off."""
    monkeypatch.setenv("ICJAX_SHARED_DATA", str(shared_data))
    (recording,) = capture(read_session(SESSIONS / "opensim_walk3d.toml")).recordings
    assert recording.valid.all()
    torque = np.asarray(joint_torque(recording))
    mass = 77.2  # kg; the mean vertical force over the stride between the two right strikes is 757 N
    for onset, release, contact in zip(
        recording.events.onset, recording.events.release, recording.events.contact, strict=True
    ):
        stance = (recording.time >= onset) & (recording.time <= release)
        side = recording.contact_bodies[contact][0]
        ankle = torque[stance, recording.model.dof_names.index(f"{side}_ankle_z")]
        assert 1.0 < ankle.max() / mass < 2.2  # Nm/kg; 1.4 to 1.8 in the literature of normal gait
        assert np.argmax(ankle) > 0.6 * len(ankle)  # push-off comes late


MODEL = """<mujoco><worldbody><body name="shank"><joint name="height" type="slide" axis="0 0 1"/>
  <joint name="knee" axis="0 1 0"/><geom name="pad_foot" type="sphere" size="0.05" mass="1"/></body></worldbody>
  </mujoco>"""
TEXT = """
name = "small"
[model]
file = "leg.xml"
[angles]
height = "y"
knee = "k"
[[trial]]
name = "one"
angles = "one.sto"
"""


@pytest.fixture
def small(tmp_path):
    (tmp_path / "leg.xml").write_text(MODEL)

    def write(header="", text=TEXT, rows="0 1 90\n0.1 1.1 45\n0.2 1.2 0\n"):
        (tmp_path / "one.sto").write_text(f"one\n{header}endheader\ntime y k\n{rows}")
        (tmp_path / "small.toml").write_text(text)
        return tmp_path / "small.toml"

    return write


@pytest.mark.parametrize(
    ("header", "key", "angle"),
    [
        ("inDegrees=yes\n", "", np.pi / 2),
        ("inDegrees=no\n", "", 90.0),
        ("", "degrees = true", np.pi / 2),
        ("", "degrees = false", 90.0),
    ],
)
def test_degrees_as_the_file_or_the_session_says(small, header, key, angle):
    (recording,) = capture(read_session(small(header, TEXT + key))).recordings
    np.testing.assert_allclose(recording.q[0], [1.0, angle], rtol=1e-15)
    np.testing.assert_array_equal(recording.time, [0.0, 0.1, 0.2])


def test_angles_of_a_bvh_file(small, tmp_path):
    """Channels are named joint.channel; degrees and cm, as the format has them, become rad and m."""
    (tmp_path / "one.bvh").write_text(
        "HIERARCHY\nROOT leg\n{\nOFFSET 0 0 0\nCHANNELS 2 Zposition Yrotation\nEnd Site\n{\nOFFSET 0 0 -40\n}\n}\n"
        "MOTION\nFrames: 2\nFrame Time: 0.01\n100 90\n110 45\n"
    )
    text = TEXT.replace("one.sto", "one.bvh").replace('"y"', '"leg.Zposition"').replace('"k"', '"leg.Yrotation"')
    (recording,) = capture(read_session(small(text=text))).recordings
    np.testing.assert_allclose(recording.q, [[1.0, np.pi / 2], [1.1, np.pi / 4]], rtol=1e-15)


def test_a_gap_in_the_angles_is_a_frame_without_pose(small):
    (recording,) = capture(read_session(small("inDegrees=no\n", rows="0 1 90\n0.1 1 nan\n0.2 1 0\n"))).recordings
    np.testing.assert_array_equal(recording.valid, [True, False, True])


@pytest.mark.parametrize(
    ("header", "change", "message"),
    [
        ("", ("", ""), "does not say whether its angles are in degrees"),
        ("inDegrees=yes\n", ('angles = "one.sto"', 'angles = "one.sto"\ndegrees = false'), "says otherwise"),
        ("inDegrees=no\n", ('knee = "k"', 'knee = "kn"'), "has no analog channel 'kn'"),
        ("inDegrees=no\n", ('knee = "k"', ""), "names no column for the joint 'knee'"),
        ("inDegrees=no\n", ('knee = "k"', 'knie = "k"'), "'knie' is no joint of the model"),
        ("inDegrees=no\n", ('angles = "one.sto"', 'angles = "leg.xml"'), "holds no angles"),
        ("inDegrees=no\n", ('angles = "one.sto"', 'file = "one.sto"'), "needs the table [markers]"),
        ("inDegrees=no\n", ('angles = "one.sto"', 'angles = "one.sto"\nmarkers = "one.sto"'), "either the key 'file'"),
        ("inDegrees=no\n", ('[angles]\nheight = "y"\nknee = "k"\n', ""), "needs the table [markers]"),
    ],
)
def test_bad_angle_sessions_are_named_in_one_line(small, header, change, message):
    path = small(header, TEXT.replace(*change) if change[0] else TEXT)
    with pytest.raises(FileError) as caught:
        capture(read_session(path))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_check_reports_angles_and_their_faults(small):
    assert any("3 frames at 10 Hz, 0 to 0.2 s, angles" in line for line in check(read_session(small("inDegrees=no\n"))))
    assert any(line.startswith("error: ") and "degrees" in line for line in check(read_session(small())))
