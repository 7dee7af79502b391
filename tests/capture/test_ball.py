"""A pressure sensitive ball: from a map to the force, centre and normal of every finger; its pose; its recording."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from icjax.capture import BallSpec, ball_contacts, ball_pose, ball_recording, read_ball
from icjax.capture._spec import CellSpec
from icjax.files import FileError, MotionFile
from icjax.model import load_model
from icjax.recording import ContactEvents, Recording, SensorChannels

RADIUS = 0.030
CELLS = 600
PITCH = math.sqrt(4.0 * math.pi * RADIUS**2 / CELLS)
"""4.3 mm."""

PAD = 0.008
MARKERS = (
    ("B1", (0.0, 0.033, 0.0)),
    ("B2", (0.0, -0.033, 0.0)),
    ("B3", (0.01, 0.0, 0.0314)),
    ("B4", (-0.02, 0.0, 0.026)),
)


def directions() -> np.ndarray:
    """On rings of equal height, turned against one another: even to a tenth."""
    z = 1.0 - (2.0 * np.arange(CELLS) + 1.0) / CELLS
    angle = 2.399963 * np.arange(CELLS)
    across = np.sqrt(1.0 - z**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), z])


def ball(path: Path = Path("ball.toml")) -> BallSpec:
    cells = tuple(
        CellSpec(f"P{i}", tuple((RADIUS * d).tolist()), tuple(d.tolist()), 1.0) for i, d in enumerate(directions())
    )
    return BallSpec(path, RADIUS, cells, MARKERS, ((0.0, 0.2),))


BALL = ball()


def patch(force: float, direction: np.ndarray, width: float = 0.008) -> np.ndarray:
    """A smooth patch of pressure about a direction, whose cells sum to `force`."""
    direction = direction / np.linalg.norm(direction)
    distance = RADIUS * np.arccos(np.clip(directions() @ direction, -1.0, 1.0))
    weight = np.maximum(1.0 - (distance / width) ** 2, 0.0)
    return force * weight / weight.sum()


def found(values: np.ndarray, pads: np.ndarray, threshold: float = 1e-9, **rest):
    return ball_contacts(BALL, values[None], pads[None], np.full(len(pads), PAD), np.full(CELLS, threshold), **rest)


THUMB, INDEX = np.array([-1.0, 0.1, 0.05]), np.array([0.9, 0.4, 0.2])
THUMB, INDEX = THUMB / np.linalg.norm(THUMB), INDEX / np.linalg.norm(INDEX)
PADS = (RADIUS + PAD) * np.stack([THUMB, INDEX])


def test_two_patches_are_the_forces_of_two_fingers():
    """Force exactly; the centre within a quarter of the pitch of the cells, the normal accordingly."""
    contacts = found(patch(2.0, THUMB) + patch(0.7, INDEX), PADS)
    np.testing.assert_allclose(contacts.pressed, [[2.0, 0.7]], rtol=1e-12)
    np.testing.assert_allclose(contacts.point[0], RADIUS * np.stack([THUMB, INDEX]), atol=0.25 * PITCH)
    np.testing.assert_allclose(np.linalg.norm(contacts.point[0], axis=1), RADIUS, rtol=1e-12)
    np.testing.assert_allclose(contacts.normal[0] * RADIUS, contacts.point[0], rtol=1e-12)
    np.testing.assert_allclose(contacts.force[0], contacts.pressed[0][:, None] * contacts.normal[0], rtol=1e-12)
    assert contacts.touching.all()
    assert contacts.elsewhere[0] == 0.0


def test_what_no_finger_is_near_is_said():
    contacts = found(patch(2.0, THUMB) + patch(0.5, np.array([0.0, 0.0, -1.0])), PADS)
    np.testing.assert_allclose(contacts.pressed, [[2.0, 0.0]], rtol=1e-12)
    assert contacts.elsewhere[0] == pytest.approx(0.5, rel=1e-12)
    assert np.isnan(contacts.point[0, 1]).all()
    assert np.isnan(contacts.normal[0, 1]).all()
    np.testing.assert_array_equal(contacts.force[0, 1], 0.0)
    np.testing.assert_array_equal(contacts.touching, [[True, False]])


def test_cells_below_the_threshold_do_not_make_a_contact_but_count_in_one():
    values = patch(2.0, THUMB)
    assert not found(values, PADS, threshold=1.01 * values.max()).touching.any()
    sure = found(values, PADS, threshold=0.5 * values.max())
    assert sure.pressed[0, 0] == pytest.approx(2.0, rel=1e-12)  # the rim of the patch is not lost
    np.testing.assert_allclose(sure.point[0, 0], RADIUS * THUMB, atol=0.5 * PITCH)


def test_reach_limits_what_belongs_to_a_finger():
    aside = (RADIUS + PAD + 0.004) * THUMB  # the pad hovers 4 mm over the ball
    assert found(patch(1.0, THUMB), np.stack([aside, PADS[1]]), reach=0.001).elsewhere[0] > 0.99
    assert found(patch(1.0, THUMB), np.stack([aside, PADS[1]]), reach=0.009).pressed[0, 0] == pytest.approx(1.0)


def test_neighbouring_fingers_share_by_nearness():
    """Two patches that do not overlap, 25 mm apart, whose reaches do."""
    other = Rotation.from_euler("z", 25.0 / 30.0).apply(THUMB)
    pads = (RADIUS + PAD) * np.stack([THUMB, other])
    contacts = found(patch(1.0, THUMB) + patch(3.0, other), pads, reach=0.02)
    np.testing.assert_allclose(contacts.pressed, [[1.0, 3.0]], rtol=1e-12)


def test_bad_arguments_name_themselves():
    with pytest.raises(ValueError, match="values has 3 cells"):
        ball_contacts(BALL, np.zeros((1, 3)), PADS[None], np.full(2, PAD), np.zeros(3))
    with pytest.raises(ValueError, match="reach"):
        found(patch(1.0, THUMB), PADS, reach=-1.0)


def motion_of(turn: Rotation, place: np.ndarray, time: np.ndarray) -> MotionFile:
    local = np.array([position for _, position in MARKERS])
    markers = np.einsum("fij,mj->fmi", turn.as_matrix(), local) + place[:, None]
    return MotionFile(
        path="ball.c3d",
        marker_names=tuple(name for name, _ in MARKERS),
        marker_rate=1.0 / (time[1] - time[0]),
        marker_time=time,
        markers=markers,
        marker_unit="mm",
    )


TIME = np.arange(400) / 200.0
TURN = Rotation.from_rotvec(np.column_stack([0.2 * TIME, 0.5 * np.sin(TIME), 0.1 * TIME]))
PLACE = np.column_stack([0.02 * TIME, 0.01 * np.sin(2.0 * TIME), 0.1 + 0.0 * TIME])


def test_pose_from_markers_with_gaps():
    """A slow movement passes the filter: 0.02 mm, 0.1 degrees."""
    motion = motion_of(TURN, PLACE, TIME)
    motion.markers[100:160, 0] = np.nan  # long, but three are left
    motion.markers[150:155] = np.nan  # all at once, short: straight lines
    R, p = ball_pose(BALL, motion, 20.0)
    np.testing.assert_allclose(p, PLACE, atol=2e-5)
    off = Rotation.from_matrix(R) * TURN.inv()
    assert np.degrees(off.magnitude()).max() < 0.1


def test_pose_needs_its_markers():
    motion = motion_of(TURN, PLACE, TIME)
    with pytest.raises(FileError, match="no marker 'B2'"):
        ball_pose(BALL, dataclasses.replace(motion, marker_names=("B1", "B9", "B3", "B4")), 20.0)
    motion.markers[:, 1:3] = np.nan
    with pytest.raises(FileError, match="in no frame at once"):
        ball_pose(BALL, motion, 20.0)


HAND = load_model(
    f"""<mujoco><default><default class="pad"/></default><worldbody>
<body name="a"><joint name="ax" type="slide" axis="1 0 0"/><geom size=".01" mass=".1"/>
<geom name="thumb" class="pad" type="sphere" size="{PAD}" mass="0"/></body>
<body name="b"><joint name="bx" type="slide" axis="1 0 0"/><geom size=".01" mass=".1"/>
<geom name="index" class="pad" type="sphere" size="{PAD}" mass="0"/></body></worldbody></mujoco>"""
)


def hand_recording() -> Recording:
    """Two fingertips that close on the ball along x and then hold it still at the origin."""
    frames = len(TIME)
    gap = 0.02 * np.clip(1.0 - TIME, 0.0, 1.0)
    q = np.column_stack([-(RADIUS + PAD + gap), RADIUS + PAD + gap])
    return Recording(
        name="roll",
        role="trial",
        catch_of=None,
        model=HAND,
        time=TIME,
        q=q,
        q_covariance=np.zeros((frames, 2, 2)),
        q_offset_sd=np.zeros(2),
        valid=np.ones(frames, bool),
        contact_names=(),
        contact_bodies=(),
        contact_force=np.zeros((frames, 0, 3)),
        contact_point=np.zeros((frames, 0, 3)),
        contact_moment=np.zeros((frames, 0, 3)),
        touching=np.zeros((frames, 0), bool),
        events=ContactEvents(onset=np.zeros(0), release=np.zeros(0), contact=np.zeros(0, np.int64)),
        marker_names=(),
        markers=np.zeros((frames, 0, 3)),
        marker_residual=np.zeros((frames, 0)),
        channels=SensorChannels(sensor_names=(), time=np.zeros(0), wrench=np.zeros((0, 0, 6))),
        friction=0.8,
        provenance=json.dumps({"made_by": "test"}),
    )


def pressure_file(turn: float, rate: float = 25.0, noise: float = 0.003) -> MotionFile:
    """Force rises linearly from 1.0 s to 1.4 s on both sides; the ball stands turned by `turn` about z."""
    time = np.arange(round(1.99 * rate) + 1) / rate
    level = 2.0 * np.clip((time - 1.0) / 0.4, 0.0, 1.0)
    back = Rotation.from_euler("z", -turn)
    one = patch(1.0, back.apply([-1.0, 0, 0])) + patch(1.0, back.apply([1.0, 0, 0]))
    values = level[:, None] * one + noise * np.random.default_rng(0).standard_normal((len(time), CELLS)) + 0.02
    return MotionFile(
        path="map.csv",
        marker_names=(),
        marker_rate=float("nan"),
        marker_time=np.zeros(0),
        markers=np.zeros((0, 0, 3)),
        marker_unit="",
        analog_names=tuple(cell.channel for cell in BALL.cells),
        analog_units=("",) * CELLS,
        analog_rate=rate,
        analog_time=time,
        analog=values,
    )


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_recording_with_the_contacts_of_the_ball(turn):
    """In world axes whatever way the ball is turned. Noise of 3 mN in each of about 60 cells: 25 mN a finger."""
    place = np.zeros((len(TIME), 3))
    motion = motion_of(Rotation.from_rotvec(np.tile([0.0, 0.0, turn], (len(TIME), 1))), place, TIME)
    result = ball_recording(hand_recording(), motion, BALL, pressure_file(turn))
    assert result.contact_names == ("thumb", "index")
    assert result.contact_bodies == ("a", "b")
    assert result.normal_only == ("thumb", "index")
    level = 2.0 * np.clip((TIME - 1.0) / 0.4, 0.0, 1.0)
    later = TIME > 1.15
    assert result.touching[later].all()
    assert not result.touching[TIME < 0.98].any()
    for finger, side in enumerate((-1.0, 1.0)):
        np.testing.assert_allclose(result.contact_force[later, finger, 0], side * level[later], atol=0.1)
        np.testing.assert_allclose(
            result.contact_point[later, finger], np.tile([side * RADIUS, 0, 0], (later.sum(), 1)), atol=0.002
        )
    assert np.isnan(result.contact_point[0]).all()
    np.testing.assert_array_equal(result.contact_force[TIME < 0.98], 0.0)
    np.testing.assert_allclose(result.events.onset, 1.04, atol=0.061)  # half-way to the first sample that shows it
    assert np.isnan(result.events.release).all()
    assert sorted(result.events.contact.tolist()) == [0, 1]
    assert json.loads(result.provenance)["pressure_ball"]["cells"] == CELLS


def test_a_recording_says_what_is_wrong():
    motion = motion_of(Rotation.identity(len(TIME)), np.zeros((len(TIME), 3)), TIME)
    pressure = pressure_file(0.0)
    short = dataclasses.replace(pressure, analog_time=pressure.analog_time[:30], analog=pressure.analog[:30])
    with pytest.raises(FileError, match="covers 0 to 1.16 s"):
        ball_recording(hand_recording(), motion, BALL, short)
    broken = dataclasses.replace(pressure, analog=np.where(np.arange(CELLS) == 5, np.nan, pressure.analog))
    with pytest.raises(FileError, match="'P5' is not a finite number"):
        ball_recording(hand_recording(), motion, BALL, broken)
    with pytest.raises(FileError, match="tare"):
        ball_recording(hand_recording(), motion, dataclasses.replace(BALL, tare=((0.0, 0.05),)), pressure)
    bare = load_model("<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>")
    recording = hand_recording()
    with pytest.raises(ValueError, match="no pads"):
        ball_recording(dataclasses.replace(recording, model=bare, q=recording.q[:, :1]), motion, BALL, pressure)


GOOD = """radius = 0.03
cells = "cells.csv"
tare = [0.0, 0.2]
[markers]
B1 = [0.0, 0.03, 0.0]
B2 = [0.03, 0.0, 0.0]
B3 = [0.0, 0.0, 0.03]
"""


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("", "", None),
        ("radius = 0.03\n", "", "radius"),
        ("radius = 0.03", "radius = 0.05", "cell 'P1' is 0.03 m"),
        ("B3 = [0.0, 0.0, 0.03]\n", "", "needs three"),
        ("tare = [0.0, 0.2]", "tare = [0.2, 0.0]", "tare"),
        ("radius", "weight = 1\nradius", "weight"),
    ],
)
def test_reading_a_ball(tmp_path, old, new, word):
    (tmp_path / "cells.csv").write_text("channel,x,y,z,nx,ny,nz,area\nP1,0.03,0,0,1,0,0,2e-5\nP2,0,0.03,0,0,1,0,2e-5\n")
    path = tmp_path / "ball.toml"
    path.write_text(GOOD.replace(old, new) if old else GOOD)
    if word is None:
        spec = read_ball(path)
        assert spec.radius == 0.03
        assert [name for name, _ in spec.markers] == ["B1", "B2", "B3"]
        np.testing.assert_array_equal(spec.directions, [[1, 0, 0], [0, 1, 0]])
        assert [cell.scale for cell in spec.cells] == [2e-5, 2e-5]
        return
    with pytest.raises(FileError, match=word) as caught:
        read_ball(path)
    assert "ball.toml" in str(caught.value)


def test_a_lifted_ball_whose_mass_is_known_gets_the_friction_that_carries_it():
    """Both sides carry half of 0.49 N once it is 3 mm up; nothing is added while it may still lie."""
    rise = 0.005 * np.clip((TIME - 1.5) / 0.1, 0.0, 1.0)
    place = np.column_stack([0.0 * TIME, 0.0 * TIME, rise])
    motion = motion_of(Rotation.identity(len(TIME)), place, TIME)
    known = dataclasses.replace(BALL, mass=0.05)
    result = ball_recording(hand_recording(), motion, known, pressure_file(0.0))
    np.testing.assert_array_equal(np.abs(result.contact_force[TIME < 1.45, :, 2]) < 0.05, True)
    up = result.contact_force[TIME > 1.65]
    np.testing.assert_allclose(up.sum(axis=1)[:, 2], -0.05 * 9.81, atol=0.01)
    np.testing.assert_allclose(up[:, :, 2], -0.245, atol=0.04)
    assert "balance" in json.loads(result.provenance)["pressure_ball"]["friction"]
