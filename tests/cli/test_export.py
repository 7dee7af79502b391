"""`icjax export`: what other programs get is what the record holds, in their units and axes."""

import dataclasses
import os

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from icjax.capture import read_session
from icjax.capture._load import load_trial
from icjax.capture._sensors import sensor_wrench
from icjax.cli import main
from icjax.export import Y_UP, coordinate_table, sensor_table
from icjax.files import read_c3d, read_sto, read_trc, save_record
from icjax.interaction import CompliancePerEvent, Interaction, JointCompliance
from icjax.model import index_finger, load_model
from icjax.recording import ContactEvents, Recording, SensorChannels, Session

MODEL = index_finger(0.19, "free")
PRINTED = 1e-9
"""m, and relative to numbers of the order of one: what TRC and MOT print."""

SINGLE = 2.0**-22
"""Relative; C3D stores 32-bit floats."""

TEXT = """
name = "again"
[model]
builtin = "index_finger"
[markers]
MARKERS
[[source]]
name = "the plate"
kind = "six_axis"
channels = ["the_plate_Fx", "the_plate_Fy", "the_plate_Fz", "the_plate_Mx", "the_plate_My", "the_plate_Mz"]
position = [0, 0, 0]
sign = "on_subject"
[[trial]]
name = "one"
file = "one.c3d"
touches = { "the plate" = "fingertip" }
""".replace("MARKERS", "\n".join(f'{name} = "{name}"' for name in MODEL.site_names))


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """A made recording of 0.2 s from 1 s on: a moving finger pressed from 1.05 to 1.15 s; one marker has a gap."""
    rng = np.random.default_rng(0)
    time = 1.0 + np.arange(40) / 200.0
    wave = np.sin(2 * np.pi * time)[:, None]
    turns = Rotation.from_rotvec([0.4, -0.6, 0.5] * wave).as_quat(scalar_first=True)
    q = np.concatenate([[0.3, 0.2, 0.1] * wave, turns, [0.2, 0.3, 0.4, 0.1] * wave], axis=1)
    markers = rng.normal(size=(40, len(MODEL.site_names), 3))
    markers[10:13, 2] = np.nan
    touching = (time >= 1.05) & (time <= 1.15)
    there = touching[:, None, None]
    sample = 1.0 + np.arange(200) / 1000.0
    recording = Recording(
        name="one",
        role="trial",
        catch_of=None,
        model=MODEL,
        time=time,
        q=q,
        q_covariance=np.zeros((40, MODEL.nv, MODEL.nv)),
        q_offset_sd=np.zeros(MODEL.nv),
        valid=np.ones(40, bool),
        contact_names=("the plate",),
        contact_bodies=("distal",),
        contact_force=np.where(there, rng.normal(size=(40, 1, 3)), 0.0),
        contact_point=np.where(there, rng.normal(size=(40, 1, 3)), np.nan),
        contact_moment=np.where(there, rng.normal(size=(40, 1, 3)), 0.0),
        touching=touching[:, None],
        events=ContactEvents(onset=np.array([1.05]), release=np.array([1.15]), contact=np.array([0])),
        marker_names=MODEL.site_names,
        markers=markers,
        marker_residual=np.zeros(markers.shape[:2]),
        channels=SensorChannels(sensor_names=("the plate",), time=sample, wrench=rng.normal(size=(200, 1, 6))),
        friction=None,
        provenance="{}",
    )
    path = tmp_path_factory.mktemp("session") / "recording.nc"
    Session(name="made", subject="", recordings=(recording,)).save(path)
    return path


def interaction(recording) -> Interaction:
    """An interaction whose numbers are all different."""
    rng = np.random.default_rng(0)
    frames, nv = len(recording.time), MODEL.nv
    per_event = CompliancePerEvent(
        recording=(),
        joint_names=MODEL.joint_names[1:],
        onset=np.zeros(0),
        compliance=np.zeros((0, 4)),
        standard_error=np.zeros((0, 4)),
        status=np.zeros((0, 4), int),
        r_squared=np.zeros((0, 4, 3)),
        torque_change=np.zeros((0, 4)),
        angle_before=np.zeros((0, 4, 3)),
        angle_after=np.zeros((0, 4, 3)),
        torque_after=np.zeros((0, 4, 3)),
        window=np.array([0.1, 0.1]),
    )
    summary = JointCompliance(
        joint_names=MODEL.joint_names[1:],
        compliance=np.ones(4),
        lower=np.ones(4),
        upper=np.ones(4),
        accepted=np.ones(4, int),
        negative=np.ones(4, int),
        events=np.ones(4, int),
    )
    return Interaction(
        name=recording.name,
        model=recording.model,
        time=np.asarray(recording.time),
        compliance=rng.uniform(size=(frames, nv)),
        compliance_sd=np.zeros((frames, nv)),
        reference=np.asarray(recording.q),
        reference_sd=np.zeros((frames, nv)),
        q=np.asarray(recording.q),
        torque=rng.normal(size=(frames, nv)),
        contact_names=recording.contact_names,
        contact_force=np.asarray(recording.contact_force),
        contact_point=np.asarray(recording.contact_point),
        per_event=per_event,
        summary=summary,
        friction=None,
        provenance="{}",
    )


def test_a_recording_is_exported(session, tmp_path, capsys):
    assert main(["export", str(session), "--out", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "one.c3d",
        "one_angles.mot",
        "one_forces.mot",
        "one_markers.trc",
    ]
    assert all(name in told for name in os.listdir(tmp_path))
    recording = Session.load(session).recordings[0]
    markers = read_trc(tmp_path / "one_markers.trc")
    assert (markers.marker_names, markers.marker_unit) == (recording.marker_names, "mm")
    np.testing.assert_allclose(markers.markers, recording.markers, rtol=0, atol=PRINTED)
    np.testing.assert_allclose(markers.marker_time, recording.time, atol=PRINTED)
    angles = read_sto(tmp_path / "one_angles.mot")
    assert angles.metadata["inDegrees"] is True
    assert angles.analog_names == MODEL.dof_names
    np.testing.assert_allclose(angles.analog[:, 6:], np.degrees(recording.q[:, 7:]), atol=PRINTED)
    np.testing.assert_allclose(angles.analog[:, 3:6], recording.q[:, :3], atol=PRINTED)
    forces = read_sto(tmp_path / "one_forces.mot")
    assert forces.metadata["inDegrees"] is False
    assert forces.analog_names[:4] == ("the_plate_vx", "the_plate_vy", "the_plate_vz", "the_plate_px")
    assert forces.analog_units == ("N",) * 3 + ("m",) * 3 + ("Nm",) * 3
    np.testing.assert_allclose(forces.analog[:, :3], recording.contact_force[:, 0], atol=PRINTED)
    np.testing.assert_allclose(forces.analog[:, 3:6], np.nan_to_num(recording.contact_point[:, 0]), atol=PRINTED)
    np.testing.assert_allclose(forces.analog[:, 6:], recording.contact_moment[:, 0], atol=PRINTED)


def test_the_c3d_is_another_recording_of_the_same_trial(session, tmp_path):
    """Read by a session file that names its channels, the wrench on the subject is the recorded one."""
    assert main(["export", str(session), "--out", str(tmp_path)]) == 0
    before = Session.load(session).recordings[0]
    read = read_c3d(tmp_path / "one.c3d")
    assert (read.marker_names, read.marker_rate, read.analog_rate) == (before.marker_names, 200.0, 1000.0)
    np.testing.assert_allclose(read.marker_time, before.time, rtol=0, atol=PRINTED)
    np.testing.assert_allclose(read.markers, before.markers, rtol=0, atol=SINGLE)
    assert [event.label for event in read.events] == ["the plate onset", "the plate release"]
    np.testing.assert_allclose([event.time for event in read.events], [1.05, 1.15], rtol=SINGLE)
    (tmp_path / "session.toml").write_text(TEXT)
    spec = read_session(tmp_path / "session.toml")
    again = sensor_wrench(load_trial(spec, spec.trials[0]), spec.trials[0], spec.source("the plate"), spec.path)
    np.testing.assert_allclose(again.time, before.channels.time, rtol=0, atol=PRINTED)
    np.testing.assert_allclose(again.wrench, before.channels.wrench[:, 0], rtol=0, atol=4 * SINGLE)


def test_a_world_with_y_up_is_not_turned_again(session, tmp_path, capsys):
    stored = Session.load(session)
    first = stored.recordings[0]
    model = dataclasses.replace(first.model, gravity=np.array([0.0, -9.81, 0.0]))
    recordings = (dataclasses.replace(first, model=model), *stored.recordings[1:])
    dataclasses.replace(stored, recordings=recordings).save(tmp_path / "upright.nc")
    assert main(["export", str(tmp_path / "upright.nc"), "--out", str(tmp_path / "out"), "--y-up"]) == 2
    assert "gravity of 'one' is (0, -9.81, 0) m/s2, so leave it out" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_y_up_turns_everything_alike(session, tmp_path):
    """Markers, forces, points and the free body turn together: a point of the body goes where the scene goes."""
    for flags in ([], ["--y-up"]):
        assert main(["export", str(session), "--out", str(tmp_path / f"{len(flags)}"), *flags]) == 0
    z_up, y_up = ({name: tmp_path / side / f"one_{name}" for name in FILES} for side in "01")
    first, second = (read_trc(folder["markers.trc"]).markers for folder in (z_up, y_up))
    np.testing.assert_allclose(second[..., 1], first[..., 2], atol=2 * PRINTED)
    np.testing.assert_allclose(second[..., 2], -first[..., 1], atol=2 * PRINTED)
    first, second = (read_sto(folder["forces.mot"]).analog.reshape(-1, 3, 3) for folder in (z_up, y_up))
    np.testing.assert_allclose(second, first @ Y_UP.T, atol=2 * PRINTED)
    recording = Session.load(session).recordings[0]
    angles = read_sto(y_up["angles.mot"]).analog
    rx, ry, rz = np.radians(angles[:, :3]).T
    one, zero = np.ones_like(rx), np.zeros_like(rx)
    Rx = np.array([[one, zero, zero], [zero, np.cos(rx), -np.sin(rx)], [zero, np.sin(rx), np.cos(rx)]])
    Ry = np.array([[np.cos(ry), zero, np.sin(ry)], [zero, one, zero], [-np.sin(ry), zero, np.cos(ry)]])
    Rz = np.array([[np.cos(rz), -np.sin(rz), zero], [np.sin(rz), np.cos(rz), zero], [zero, zero, one]])
    R = np.einsum("ijt,jkt,klt->til", Rx, Ry, Rz)  # body-fixed X, Y, Z
    q = np.asarray(recording.q)
    point = np.array([0.01, 0.02, 0.03])  # of the free body
    expected = (Rotation.from_quat(q[:, 3:7], scalar_first=True).apply(point) + q[:, :3]) @ Y_UP.T
    np.testing.assert_allclose(R @ point + angles[:, 3:6], expected, atol=10 * PRINTED)


FILES = ("markers.trc", "angles.mot", "forces.mot")


def test_an_interaction_is_exported(session, tmp_path):
    recording = Session.load(session).recordings[0]
    made = interaction(recording)
    made.save(tmp_path / "interaction.nc")
    assert main(["export", str(tmp_path / "interaction.nc"), "--out", str(tmp_path / "out"), "--trial", "one"]) == 0
    torques = read_sto(tmp_path / "out" / "one_torques.sto")
    assert torques.analog_names[2:7] == (
        "root_rz_moment",
        "root_x_force",
        "root_y_force",
        "root_z_force",
        "wrist_moment",
    )
    np.testing.assert_allclose(torques.analog, made.torque, rtol=1e-11, atol=1e-15)
    compliance = read_sto(tmp_path / "out" / "one_compliance.sto")
    assert compliance.analog_names == MODEL.dof_names
    np.testing.assert_allclose(compliance.analog, made.compliance, rtol=1e-11)
    reference = read_sto(tmp_path / "out" / "one_reference.mot")
    assert main(["export", str(session), "--out", str(tmp_path / "out")]) == 0
    np.testing.assert_array_equal(reference.analog, read_sto(tmp_path / "out" / "one_angles.mot").analog)


def test_balls_slides_and_frames_without_pose():
    model = load_model(
        "<mujoco><worldbody><body><joint name='lift' type='slide'/><geom size='1'/><body>"
        "<joint name='hip' type='ball'/><geom size='1'/></body></body></worldbody></mujoco>"
    )
    angle = np.radians(np.arange(0.0, 400.0, 10.0))  # past a full turn: unwrapped, no jump
    zero = np.zeros_like(angle)
    q = np.stack([angle, np.cos(angle / 2), zero, zero, np.sin(angle / 2)], axis=1)
    valid = np.ones(len(angle), bool)
    valid[3] = False
    table = coordinate_table(model, q, valid, np.eye(3))
    assert table.names == ("lift", "hip_x", "hip_y", "hip_z")
    assert np.isnan(table.values[3]).all()
    expected = np.stack([angle, zero, zero, np.degrees(angle)], axis=1)
    np.testing.assert_allclose(table.values[valid], expected[valid], atol=1e-10)


@pytest.mark.parametrize(("rate", "expected"), [(1000.0, 1000.0), (900.0, 1000.0), (90.0, 200.0)])
def test_sensor_rates_become_whole_multiples(session, rate, expected):
    """A sine survives: cubic interpolation of 10 samples a period errs by less than a percent of it."""
    recording = Session.load(session).recordings[0]
    time = 1.0 + np.arange(int(0.2 * rate)) / rate
    wrench = np.sin(2 * np.pi * rate / 20 * time)[:, None, None] * np.arange(1.0, 7.0)
    channels = dataclasses.replace(recording.channels, time=time, wrench=wrench)
    table, found, done = sensor_table(dataclasses.replace(recording, channels=channels), np.eye(3))
    assert found == pytest.approx(expected)
    assert (done == "") == (rate == 1000.0)
    clock = 1.0 + np.arange(len(table.values)) / expected
    assert len(clock) == round(expected / 200.0) * 40
    inside = clock <= time[-1]
    wave = np.sin(2 * np.pi * rate / 20 * clock)[inside, None] * np.array([4.0, 5, 6, 1, 2, 3])
    np.testing.assert_allclose(table.values[inside], wave, rtol=0, atol=0.06)  # a hundredth of the largest
    assert ("held" in done or "hold" in done) == bool((clock > time[-1] + 0.5 / rate).any())


def complains(capsys, arguments, *words):
    assert main([str(item) for item in arguments]) == 2
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert line.startswith("icjax: ")
    for word in words:
        assert word in line


def test_what_cannot_be_exported_is_refused(session, tmp_path, capsys):
    out = tmp_path / "out"
    complains(capsys, ["export", tmp_path / "none.nc", "--out", out], "none.nc", "does not exist")
    complains(capsys, ["export", session, "--out", out, "--trial", "two"], "--trial two", "has the trials one")
    model = tmp_path / "model.nc"
    save_record(model, MODEL)
    complains(capsys, ["export", model, "--out", out], "holds a Model", "export takes")
    assert not out.exists()
    recording = Session.load(session).recordings[0]
    twins = tuple(dataclasses.replace(recording, name=name) for name in ("a b", "a/b"))
    Session(name="s", subject="", recordings=twins).save(tmp_path / "twins.nc")
    complains(capsys, ["export", tmp_path / "twins.nc", "--out", out], "two trials would be written as 'a_b'")
    assert main(["export", str(tmp_path / "twins.nc"), "--out", str(out), "--trial", "a/b"]) == 0
    assert (out / "a_b_angles.mot").exists()
    assert "twins" not in os.listdir(tmp_path / "out")
