"""`icjax export`: what other programs get is what the record holds, in their units and axes."""

import dataclasses
import os

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.capture import capture, read_session
from icjax.cli import main
from icjax.cli._opensim import Y_UP, coordinate_table, sensor_table
from icjax.estimation import joint_torque
from icjax.files import read_c3d, read_sto, read_trc, write_c3d
from icjax.interaction import CompliancePerEvent, Interaction, JointCompliance
from icjax.model import index_finger, integrate, load_model, neutral, site_positions
from icjax.recording import Session

MODEL = index_finger(0.19, "free")
PRINTED = 1e-9
"""m, and relative to numbers of the order of one: what TRC and MOT print."""

SINGLE = 2.0**-22
"""Relative; C3D stores 32-bit floats."""

TEXT = """
name = "small"
[model]
builtin = "index_finger"
[markers]
MARKERS
[[source]]
name = "the plate"
kind = "six_axis"
channels = ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]
position = [0, 0, -0.026]
rotation = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
sign = "on_environment"
surface = { point = [0, 0, 0], normal = [0, 0, 1] }
tare = [1.0, 1.1]
[[trial]]
name = "one"
file = "one.c3d"
touches = { "the plate" = "fingertip" }
""".replace("MARKERS", "\n".join(f'{name} = "{name}"' for name in MODEL.site_names))


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """A press of 2 N between 1.2 and 1.4 s, recorded from frame 200 on; one marker has a gap."""
    folder = tmp_path_factory.mktemp("session")
    time = np.arange(100) / 200.0
    dq = np.zeros((100, MODEL.nv))
    dq[:, :3] = [0.1, 0.2, 0.3]
    dq[:, 3:6] = [0.3, 0.2, 0.1]
    dq[:, 6:] = 0.2 + 0.1 * np.sin(2 * np.pi * time)[:, None]
    q = jax.vmap(lambda d: integrate(MODEL, neutral(MODEL), d))(jnp.asarray(dq))
    markers = np.array(jax.vmap(lambda item: site_positions(MODEL, item))(q))
    markers[10:13, 2] = np.nan
    force_time = 1.0 + np.arange(500) / 1000.0
    analog = 0.005 * np.random.default_rng(0).normal(size=(500, 6))
    analog[:, 3:] *= 0.01
    analog[:, 2] += np.clip(100 * np.minimum(force_time - 1.2, 1.4 - force_time), 0, 2)
    write_c3d(
        folder / "one.c3d",
        marker_names=MODEL.site_names,
        markers=markers,
        marker_rate=200.0,
        analog_names=("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"),
        analog_units=("N",) * 3 + ("Nm",) * 3,
        analog=analog,
        analog_rate=1000.0,
        first_frame=200,
    )
    (folder / "session.toml").write_text(TEXT)
    found = capture(read_session(folder / "session.toml"))
    found.save(folder / "recording.nc")
    return folder / "recording.nc"


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
        torque=np.asarray(joint_torque(recording)),
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
    assert forces.analog[:, 2].max() > 1.0  # on the subject: the plate pushes up


def test_the_c3d_is_another_recording_of_the_same_trial(session, tmp_path):
    """Captured again from the exported C3D, whose channels are the calibrated wrench, forces and events agree."""
    assert main(["export", str(session), "--out", str(tmp_path)]) == 0
    before = Session.load(session).recordings[0]
    read = read_c3d(tmp_path / "one.c3d")
    assert (read.marker_rate, read.analog_rate) == (200.0, 1000.0)
    np.testing.assert_allclose(read.markers, before.markers, rtol=0, atol=SINGLE)
    np.testing.assert_allclose(read.analog[:, :3], before.channels.wrench[:, 0, 3:], rtol=0, atol=4 * SINGLE)
    assert [event.label for event in read.events] == ["the plate onset", "the plate release"]
    names = ", ".join(f'"{name}"' for name in read.analog_names)
    text = TEXT.replace('["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]', f"[{names}]")
    text = text.replace("[0, 0, -0.026]", "[0, 0, 0]").replace('"on_environment"', '"on_subject"')
    text = "\n".join(line for line in text.splitlines() if not line.startswith("rotation"))
    (tmp_path / "session.toml").write_text(text)
    after = capture(read_session(tmp_path / "session.toml")).recordings[0]
    np.testing.assert_allclose(after.events.onset, before.events.onset, atol=1e-5)  # s; 32-bit forces
    np.testing.assert_allclose(after.contact_force, before.contact_force, rtol=0, atol=1e-5)  # N


def test_y_up_turns_everything_alike(session, tmp_path):
    """Markers, forces, points and the free body turned together are the same scene: sites still lie on markers."""
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
    forearm = np.asarray(MODEL.site_position)[:3]  # FA1 to FA3 ride on the free body
    placed = np.einsum("tij,mj->tmi", R, forearm) + angles[:, None, 3:6]
    expected = np.asarray(jax.vmap(lambda q: site_positions(MODEL, q))(jnp.asarray(recording.q)))[:, :3] @ Y_UP.T
    assert [MODEL.site_names[index] for index in range(3)] == ["FA1", "FA2", "FA3"]
    np.testing.assert_allclose(placed, expected, atol=10 * PRINTED)


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
    time = 1.0 + np.arange(int(0.5 * rate)) / rate
    wrench = np.sin(2 * np.pi * rate / 20 * time)[:, None, None] * np.arange(1.0, 7.0)
    channels = dataclasses.replace(recording.channels, time=time, wrench=wrench)
    table, found, done = sensor_table(dataclasses.replace(recording, channels=channels), np.eye(3))
    assert found == pytest.approx(expected)
    assert (done == "") == (rate == 1000.0)
    clock = 1.0 + np.arange(len(table.values)) / expected
    assert len(clock) == round(expected / 200.0) * 100
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
    MODEL_FILE = tmp_path / "model.nc"
    from icjax.files import save_record

    save_record(MODEL_FILE, MODEL)
    complains(capsys, ["export", MODEL_FILE, "--out", out], "holds a Model", "export takes")
    assert not out.exists()
    recording = Session.load(session).recordings[0]
    twins = tuple(dataclasses.replace(recording, name=name) for name in ("a b", "a/b"))
    Session(name="s", subject="", recordings=twins).save(tmp_path / "twins.nc")
    complains(capsys, ["export", tmp_path / "twins.nc", "--out", out], "two trials would be written as 'a_b'")
    assert main(["export", str(tmp_path / "twins.nc"), "--out", str(out), "--trial", "a/b"]) == 0
    assert (out / "a_b_angles.mot").exists()
    assert "twins" not in os.listdir(tmp_path / "out")
