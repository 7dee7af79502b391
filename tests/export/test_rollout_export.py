"""Rollouts in other programs: what MuJoCo, a glTF reader and a table say is where the rollout is."""

import dataclasses
import json
import struct

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from view.example_objects import BOX_MASS, HALF, make_object_rollout, make_scene
from view.example_records import make_recording, make_rollout

from icjax import view
from icjax.cli import main
from icjax.export import export_mujoco, rollout_coordinates, rollout_forces
from icjax.files import read_sto
from icjax.geometry import Cylinder, Placed, Sphere, Union
from icjax.model import human_hand, load_model
from icjax.spatial import Pose
from icjax.synthesis import Object
from icjax.view._skeleton import body_poses

SINGLE = 1e-6
"""m; glTF has 32-bit floats, and the scene is some decimetres large."""

DOUBLE = 1e-9


@pytest.fixture(scope="module")
def rollout():
    return make_object_rollout()


@pytest.fixture(scope="module")
def stored(rollout, tmp_path_factory):
    path = tmp_path_factory.mktemp("rollout") / "rollout.nc"
    rollout.save(path)
    return path


def test_mujoco_has_every_body_where_the_rollout_has_it(rollout, tmp_path):
    path, table = export_mujoco(rollout, tmp_path / "push.xml")
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    names = table.read_text().splitlines()[0].split(",")
    assert names[:2] + names[-7:-4] == ["time", "root_x", "ball_x", "ball_y", "ball_z"]
    assert rows.shape == (len(rollout.time), 1 + model.nq)
    np.testing.assert_array_equal(rows[:, 0], rollout.time)
    rotation, position = body_poses(rollout.model, rollout.q)
    for k in range(0, len(rows), 47):
        data.qpos[:] = rows[k, 1:]
        mujoco.mj_forward(model, data)
        for body, name in enumerate(rollout.model.body_names[1:], 1):
            found = data.body(name)
            np.testing.assert_allclose(found.xpos, position[k, body], atol=DOUBLE)
            np.testing.assert_allclose(found.xmat.reshape(3, 3), rotation[k, body], atol=DOUBLE)
        for number, name in enumerate(rollout.object_names):
            np.testing.assert_allclose(data.body(name).xpos, rollout.object_position[k, number], atol=DOUBLE)
            turn = Rotation.from_quat(rollout.object_quaternion[k, number], scalar_first=True).as_matrix()
            np.testing.assert_allclose(data.body(name).xmat.reshape(3, 3), turn, atol=DOUBLE)
    np.testing.assert_array_equal(model.key_qpos, rows[[0, -1], 1:])
    np.testing.assert_allclose(model.body("box").mass, BOX_MASS)
    np.testing.assert_array_equal(model.geom("box").size, HALF)
    assert {model.geom(number).name for number in range(model.ngeom)} >= {"plate", "rail", "box", "ball", "fingertip"}
    assert model.geom("plate").friction[0] == 0.5


def test_a_union_is_several_geoms_and_lost_steps_are_left_out(rollout, tmp_path):
    parts = [Sphere(0.02), Placed(Cylinder(0.01, 0.02), Pose(np.eye(3), np.array([0.0, 0.0, -0.03])))]
    scene = make_scene()
    bulb = Object("box", Union(parts), 0.5, mass=BOX_MASS)
    quaternion = np.array(rollout.object_quaternion)
    quaternion[7] = np.nan
    changed = dataclasses.replace(
        rollout,
        scene=dataclasses.replace(scene, objects=(bulb, scene.objects[1])).describe(),
        object_quaternion=quaternion,
    )
    model = mujoco.MjModel.from_xml_path(str(export_mujoco(changed, tmp_path / "bulb.xml")[0]))
    np.testing.assert_allclose(model.geom("box.1").size[0], 0.02)
    np.testing.assert_allclose(model.geom("box.2").pos, [0.0, 0.0, -0.03])
    table = rollout_coordinates(changed, np.eye(3))
    lost = np.isnan(table.values).any(axis=1)
    np.testing.assert_array_equal(np.flatnonzero(lost), [7])


@pytest.mark.parametrize("kind", ["hand", "tree"])
def test_a_model_comes_back_from_mujoco_as_it_was(rollout, tmp_path, kind):
    """Masses, joints, limits, springs, pads and sites; a ball joint, a slide, two joints on a body, a second root."""
    if kind == "hand":
        before = human_hand()
    else:
        before = load_model("""
            <mujoco model="tree"><compiler angle="radian"/><worldbody>
            <body name="a" pos="0.1 0 0" euler="0.1 0.2 0.3"><joint name="lift" type="slide" axis="0 1 1" ref="0.02"/>
            <joint name="turn" axis="1 0 0" pos="0 0.01 0" range="-0.5 1" stiffness="2" springref="0.1" damping="0.3"/>
            <geom size="0.01 0.03" type="capsule" mass="0.2"/>
            <body name="b" pos="0 0 0.1"><joint name="hip" type="ball" armature="0.001"/>
            <geom name="pad" type="sphere" size="0.007" pos="0 0 0.05" mass="0.01" user="0.002"/>
            <geom name="pad_rod" type="capsule" fromto="0 0.01 0 0.01 0 0.04" size="0.005" mass="0.01"/></body>
            <body name="c" pos="0 0.1 0"><geom size="0.01" mass="0.1"/><site name="m" pos="0 0 0.01"/></body></body>
            <body name="d"><freejoint name="fly"/><geom type="box" size="0.1 0.1 1e-4" mass="0.5"/></body>
            </worldbody></mujoco>""")  # a thin plate: the largest moment is the sum of the others
    rng = np.random.default_rng(0)
    q = np.tile(np.asarray(before.zero), (3, 1)) + 0.1 * rng.normal(size=(3, before.nq))
    for part, joint in zip(before.coordinate_slices, before.joint_types, strict=True):
        if joint in ("ball", "free"):
            at = slice(part.stop - 4, part.stop)
            q[:, at] = Rotation.random(3, rng=rng).as_quat(scalar_first=True)
    flat = make_rollout("flat", bump=False)
    still = dataclasses.replace(
        flat, model=before, time=np.arange(3.0), q=q, reference=q, torque=np.zeros((3, before.nv)),
        contact_force=np.zeros((3, 0, 3)), contact_point=np.zeros((3, 0, 3)), contact_normal=np.zeros((3, 0, 3)),
        gap=np.zeros((3, 0)), slip_state=np.zeros((3, 0), int), slot_names=(), residual=np.zeros(3),
        equilibrium_error=np.zeros((3, before.nv)), status=np.zeros(3, int), margin=np.zeros(3),
    )  # fmt: skip
    path, table = export_mujoco(still, tmp_path / "again.xml")
    after = load_model(path)
    assert (after.body_names, after.joint_names, after.joint_types) == (
        before.body_names,
        before.joint_names,
        before.joint_types,
    )
    assert after.pad_types == before.pad_types
    for field in dataclasses.fields(before):
        old, new = getattr(before, field.name), getattr(after, field.name)
        if not isinstance(old, str | tuple | None) and field.name != "gravity":
            same = np.isfinite(np.asarray(old))
            if field.name in ("compliance", "damping"):  # of a free joint MuJoCo has one number, not six
                same &= np.array([not name.startswith(("root_", "fly_")) for name in before.dof_names])
            np.testing.assert_allclose(np.asarray(new)[same], np.asarray(old)[same], rtol=1e-7, atol=1e-12,
                                       err_msg=field.name)  # fmt: skip
    np.testing.assert_array_equal(np.loadtxt(table, delimiter=",", skiprows=1)[:, 1:], q)


def parsed(path) -> tuple[dict, bytes]:
    """JSON and binary part of a GLB file."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<III", data)
    assert (magic, version, length) == (0x46546C67, 2, len(data))
    size, kind = struct.unpack_from("<II", data, 12)
    assert kind == 0x4E4F534A
    rest, kind = struct.unpack_from("<II", data, 20 + size)
    assert kind == 0x004E4942
    assert len(data) == 28 + size + rest
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def tracks(content: dict, blob: bytes) -> dict[tuple[str, str], tuple[np.ndarray, np.ndarray, str]]:
    """Times, values and interpolation by node and path."""

    def numbers(index):
        accessor = content["accessors"][index]
        part = content["bufferViews"][accessor["bufferView"]]
        assert accessor["componentType"] == 5126
        wide = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        found = np.frombuffer(blob, "<f4", accessor["count"] * wide, part["byteOffset"]).reshape(-1, wide)
        if "min" in accessor:
            np.testing.assert_array_equal(found.min(axis=0), np.float32(accessor["min"]))
            np.testing.assert_array_equal(found.max(axis=0), np.float32(accessor["max"]))
        return found.astype(float)

    clip = content["animations"][0]
    made = {}
    for channel in clip["channels"]:
        sampler = clip["samplers"][channel["sampler"]]
        key = content["nodes"][channel["target"]["node"]]["name"], channel["target"]["path"]
        made[key] = numbers(sampler["input"])[:, 0], numbers(sampler["output"]), sampler["interpolation"]
    return made


def test_the_animation_moves_bodies_objects_and_forces(rollout, tmp_path):
    path = view.export_animation(rollout, tmp_path / "push.glb", rate=50.0)
    content, blob = parsed(path)
    moved = tracks(content, blob)
    assert ("distal", "rotation") in moved
    times, place, how = moved["box", "translation"]
    assert how == "LINEAR"
    assert len(times) == 149
    rows = np.searchsorted(rollout.time, times + float(rollout.time[0]) - 1e-6)
    np.testing.assert_allclose(rollout.time[rows], times, atol=1e-6)
    np.testing.assert_allclose(place, rollout.object_position[rows, 0], atol=SINGLE)
    turned = Rotation.from_quat(moved["ball", "rotation"][1])
    truth = Rotation.from_quat(rollout.object_quaternion[rows, 1], scalar_first=True)
    assert (turned * truth.inv()).magnitude().max() < SINGLE
    assert (np.sum(moved["ball", "rotation"][1][1:] * moved["ball", "rotation"][1][:-1], axis=1) > 0).all()
    rotation, position = body_poses(rollout.model, np.asarray(rollout.q)[rows])
    for body, name in enumerate(rollout.model.body_names[1:], 1):
        node = next(item for item in content["nodes"] if item["name"] == name)
        still = {path: np.array(node[path])[None] for path in ("translation", "rotation")}
        found = {path: moved.get((name, path), (None, value))[1] for path, value in still.items()}
        np.testing.assert_allclose(np.broadcast_to(found["translation"], (149, 3)), position[:, body], atol=SINGLE)
        turned = Rotation.from_quat(np.broadcast_to(found["rotation"], (149, 4)))
        np.testing.assert_allclose(turned.as_matrix(), rotation[:, body], atol=10 * SINGLE)
    # The push of 0.3 N from 1 s to 1.5 s, and no arrow before and after it.
    _, scale, how = moved["force fingertip on box sticking", "scale"]
    pushing = (times >= 1.0 - 1e-6) & (times < 1.5 - 1e-6)
    assert how == "STEP"
    per_newton = content["asset"]["extras"]["metres_per_newton"]
    np.testing.assert_allclose(scale[:, 0], np.where(pushing, 0.3 * per_newton, 0.0), atol=SINGLE)
    _, arrow, _ = moved["force fingertip on box sticking", "rotation"]
    along = Rotation.from_quat(arrow[pushing]).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(along, np.tile([1.0, 0.0, 0.0], (len(along), 1)), atol=1e-6)
    assert not any(name.startswith("force") for name, _ in tracks(*parsed(
        view.export_animation(rollout, tmp_path / "bare.glb", rate=50.0, forces=False)
    )))  # fmt: skip


def test_another_reader_finds_the_same_geometry_with_y_up(rollout, tmp_path):
    scene = trimesh.load(view.export_animation(rollout, tmp_path / "push.glb"))
    first = np.asarray(rollout.object_position)[0]
    for number, (name, size) in enumerate((("box", HALF), ("ball", np.full(3, 0.01)))):
        transform, mesh = scene.graph[name]
        np.testing.assert_allclose(transform[:3, 3], first[number][[0, 2, 1]] * [1, 1, -1], atol=SINGLE)
        vertices = scene.geometry[mesh].vertices @ transform[:3, :3].T
        half = size if name == "ball" else size[[0, 2, 1]]
        np.testing.assert_allclose(np.abs(vertices).max(axis=0), half, atol=SINGLE)
    pad, mesh = scene.graph["fingertip"]
    assert scene.geometry[mesh].extents[0] == pytest.approx(2 * float(rollout.model.pad_radius[0]), rel=1e-3)
    assert np.isfinite(pad).all()
    assert "plate" in scene.graph.nodes


def test_a_recording_moves_too(tmp_path):
    content, blob = parsed(view.export_animation(make_recording(), tmp_path / "recording.glb", rate=20.0))
    assert ("distal", "translation") in tracks(content, blob)


def test_tables_have_coordinates_objects_and_forces(rollout, stored, tmp_path, capsys):
    assert main(["export", str(stored), "--out", str(tmp_path / "all.sto")]) == 0
    table = read_sto(tmp_path / "all.sto")
    column = {name: table.analog[:, number] for number, name in enumerate(table.analog_names)}
    assert table.metadata["inDegrees"] is True
    np.testing.assert_allclose(column["MP"], np.degrees(rollout.q[:, 8]), atol=DOUBLE)
    np.testing.assert_allclose(column["ball_x"], rollout.object_position[:, 1, 0], atol=DOUBLE)
    angles = np.stack([column[f"box_r{axis}"] for axis in "xyz"], axis=1)
    turned = Rotation.from_euler("XYZ", angles, degrees=True)
    truth = Rotation.from_quat(rollout.object_quaternion[:, 0], scalar_first=True)
    assert (turned * truth.inv()).magnitude().max() < 1e-8
    np.testing.assert_allclose(column["fingertip_box_vx"].max(), 0.3)
    np.testing.assert_allclose(column["box_plate_vz"], BOX_MASS * 9.81)
    # Force, point and free moment together are the wrench of the corners, about any point.
    forces = rollout_forces(rollout, np.eye(3))
    number = forces.names.index("box_plate_vx")
    force, point, moment = (forces.values[:, number + k : number + k + 3] for k in (0, 3, 6))
    own = [k for k, bodies in enumerate(rollout.slot_bodies()) if bodies == ("box", "plate")]
    about = np.cross(rollout.contact_point[:, own], rollout.contact_force[:, own]).sum(axis=1)
    np.testing.assert_allclose(np.cross(point, force) + moment, about, atol=1e-15)


def test_a_folder_holds_all_of_them_and_files_are_replaced(stored, tmp_path, capsys):
    for _ in range(2):
        assert main(["export", str(stored), "--out", str(tmp_path / "out"), "--y-up"]) == 0
    told = capsys.readouterr().out
    found = sorted(path.name for path in (tmp_path / "out").iterdir())
    ends = ("_angles.mot", "_forces.mot", ".glb", ".xml", "_qpos.csv")
    assert found == sorted(f"objects_objects{end}" for end in ends)
    assert all(name in told for name in found)


def test_what_no_file_can_be_is_refused(stored, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    for arguments, words in (
        (["--out", tmp_path / "a.fbx"], "one of .glb, .gif, .mp4, .xml, .sto, .mot, .nc; not .fbx"),
        (["--out", tmp_path / "a.glb", "--fps", "10"], "frames_per_second is said of clips only"),
        (["--out", tmp_path / "folder", "--speed", "2"], "speed is said of clips only"),
        (["--out", tmp_path / "a.gif", "--speed", "0"], "speed must be positive; got 0"),
        (["--out", tmp_path / "a.gif", "--fps", "200"], "at most 100; got 200"),
        (["--out", tmp_path / "a.gif", "--size", "10", "10"], "64 to 4096 pixels"),
        (["--out", tmp_path / "a.gif", "--times", "5", "6"], "times 5 to 6 s are none"),
        (["--out", tmp_path / "a.gif", "--speed", "0.001"], "frames are more than 2000"),
        (["--out", tmp_path / "file" / "a.glb"], "a.glb: cannot be written"),
    ):
        assert main(["export", str(stored), *map(str, arguments)]) == 2
        assert words in capsys.readouterr().err.strip().splitlines()[-1]
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def looked_at(image) -> None:
    assert image.n_frames == 7  # 0.3 s at half the speed, and its first moment
    assert image.size == (320, 200)
    assert image.info["duration"] == 100
    frames = []
    for number in range(image.n_frames):
        image.seek(number)
        frames.append(np.asarray(image.convert("RGB"), float))
    assert frames[0].std() > 10.0, "the picture is uniform"
    changed = np.abs(frames[-1] - frames[0]).max(axis=2) > 30.0
    assert changed.mean() > 0.01, "the box tips over and nothing moves"


def test_a_clip_plays_in_its_time(rollout, stored, tmp_path, capsys, monkeypatch):
    from PIL import Image

    path = tmp_path / "clip.gif"
    options = ["--speed", "0.5", "--fps", "10", "--size", "320", "200", "--times", "1.9", "2.2"]
    assert main(["export", str(stored), "--out", str(path), *options]) == 0
    with Image.open(path) as image:
        looked_at(image)
    monkeypatch.setenv("PATH", "")
    assert main(["export", str(stored), "--out", str(tmp_path / "clip.mp4")]) == 2
    assert "ffmpeg, which is not installed; a .gif does not" in capsys.readouterr().err
