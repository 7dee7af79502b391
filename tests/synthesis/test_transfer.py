"""From an interaction to a rollout."""

import dataclasses
import json

import jax.numpy as jnp
import numpy as np
import pytest
from hands import ENDPOINT, PAD, RADIUS, floor, sprung_tip
from scipy.spatial.transform import Rotation, Slerp

from icjax.files import layout_problems
from icjax.geometry import Box, Plane
from icjax.interaction import CompliancePerEvent, Interaction, JointCompliance
from icjax.model import index_finger
from icjax.rollout import Rollout
from icjax.spatial import Pose
from icjax.synthesis import Object, PairFriction, Scene, Surface, Target, check_rollout, resample, transfer


def tapping() -> Interaction:
    """A pad on springs whose reference sinks into the plate and comes back, sampled at 100 Hz."""
    model, time = sprung_tip(), 5.0 + 0.01 * np.arange(21)
    joints = model.joint_names
    reference = np.zeros((21, 3))
    reference[:, 2] = RADIUS + 0.01 * np.cos(np.linspace(0.0, 2 * np.pi, 21))
    none = np.zeros((0, 3))
    polynomial = np.zeros((0, 3, 2))
    return Interaction(
        name="tap",
        model=model,
        time=time,
        compliance=np.full((21, 3), ENDPOINT),
        compliance_sd=np.zeros((21, 3)),
        reference=reference,
        reference_sd=np.zeros((21, 3)),
        q=reference,
        torque=np.zeros((21, 3)),
        contact_names=(),
        contact_force=np.zeros((21, 0, 3)),
        contact_point=np.zeros((21, 0, 3)),
        per_event=CompliancePerEvent(
            recording=(),
            joint_names=joints,
            onset=np.zeros(0),
            compliance=none,
            standard_error=none,
            status=none.astype(int),
            r_squared=np.zeros((0, 3, 3)),
            torque_change=none,
            angle_before=polynomial,
            angle_after=polynomial,
            torque_after=polynomial,
            window=np.zeros(2),
        ),
        summary=JointCompliance(
            joint_names=joints,
            compliance=np.full(3, ENDPOINT),
            lower=np.zeros(3),
            upper=np.ones(3),
            accepted=np.ones(3, int),
            negative=np.zeros(3, int),
            events=np.ones(3, int),
        ),
        friction=0.5,
        provenance="{}",
    )


def test_transfer_to_a_plate_and_back_from_its_file(tmp_path):
    interaction, seen = tapping(), []
    rollout = transfer(interaction, floor(0.5), progress=seen.append)
    assert seen[-1] == 1.0
    assert rollout.slot_names == ("pad/plate",)
    np.testing.assert_allclose(rollout.time, 5.0 + 0.002 * np.arange(101), atol=1e-12)
    height = np.interp(rollout.time, interaction.time, interaction.reference[:, 2])
    expected = np.maximum(RADIUS - height, 0.0) / (ENDPOINT + PAD)
    np.testing.assert_allclose(rollout.contact_force[:, 0, 2], expected, atol=1e-10)  # interpolation of times near 5 s
    assert json.loads(rollout.scene)["name"] == "flat"
    rollout.save(tmp_path / "rollout.nc")
    again = Rollout.load(tmp_path / "rollout.nc")
    np.testing.assert_array_equal(again.contact_force, rollout.contact_force)
    assert again.slot_names == rollout.slot_names
    assert again.object_names == ()
    assert again.object_position is None


def test_coupled_joints_yield_together(tmp_path):
    """theta = theta_r + C tau with a C that moves the tip sideways when it is pressed."""
    full = np.tile(ENDPOINT * np.array([[1.0, 0.0, 0.4], [0.0, 1.0, -0.2], [0.4, -0.2, 1.0]]), (21, 1, 1))
    path = tmp_path / "coupled.nc"
    dataclasses.replace(tapping(), full_compliance=full).save(path)
    rollout = transfer(Interaction.load(path), floor(0.0))
    yielded = np.asarray(rollout.q - rollout.reference)
    assert np.abs(yielded[:, 0]).max() > 1e-4
    np.testing.assert_allclose(yielded, np.asarray(rollout.torque) @ full[0], rtol=0, atol=1e-12)


def test_a_stated_movement_is_transferred_as_an_estimated_one(tmp_path):
    given = tapping()
    stated = Interaction.of(given.model, given.time, given.reference, given.compliance[0])
    stated.save(tmp_path / "stated.nc")
    found = transfer(Interaction.load(tmp_path / "stated.nc"), floor(0.5))
    np.testing.assert_array_equal(found.contact_force, transfer(given, floor(0.5)).contact_force)
    full = np.diag(given.compliance[0])
    np.testing.assert_array_equal(
        Interaction.of(given.model, given.time, given.reference, full).compliance, given.compliance
    )
    with pytest.raises(ValueError, match=r"reference must be \[21, 3\]; got \[20, 3\]"):
        Interaction.of(given.model, given.time, given.reference[:20], full)


@pytest.mark.parametrize(
    ("field", "change", "message"),
    [
        ("reference", lambda i: i.reference[:5], r"reference must be \[21, 3\]; got \[5, 3\]"),
        ("compliance", lambda i: i.compliance[:5], r"compliance must be \[21, 3\]; got \[5, 3\]"),
        ("full_compliance", lambda i: np.zeros((3, 3)), r"full_compliance must be \[21, 3, 3\]; got \[3, 3\]"),
        ("full_compliance", lambda i: np.tile(np.eye(3), (21, 1, 1)), "full_compliance of .* is 1 in row 0, but compl"),
    ],
)
def test_arrays_that_do_not_fit_each_other(field, change, message):
    given = tapping()
    object.__setattr__(given, field, change(given))  # past the checks of types that only the tests have
    with pytest.raises(ValueError, match=message):
        transfer(given, floor(0.5))


def test_transfer_to_an_object_and_back_from_its_file(tmp_path):
    """A box on a table gives the finger what the plate gave; the table carries the finger's force and the weight."""
    interaction = tapping()
    table = Surface("table", Plane(np.array([0.0, 0.0, -0.02]), np.array([0.0, 0.0, 1.0])), 0.5)
    pose = Pose(np.eye(3), np.array([0.005, 0.0, -0.01]))
    box = Object("box", Box(np.array([0.03, 0.03, 0.01])), 0.5, mass=0.1, pose=pose)
    rollout = transfer(interaction, Scene("on a box", (table,), objects=(box,), frictions=(FELT,)))
    assert rollout.slot_names == ("pad/table", "pad/box", *(f"box.{corner}/table" for corner in range(1, 9)))
    height = np.interp(rollout.time, interaction.time, interaction.reference[:, 2])
    pressed = np.maximum(RADIUS - height, 0.0) / (ENDPOINT + PAD)
    np.testing.assert_allclose(rollout.contact_force[:, 1, 2], pressed, atol=1e-9)
    np.testing.assert_allclose(rollout.contact_force[:, 2:, 2].sum(axis=1), pressed + 0.1 * 9.81, atol=1e-9)
    np.testing.assert_allclose(rollout.object_position[:, 0], np.tile(pose.position, (101, 1)), atol=1e-9)
    rollout.save(tmp_path / "rollout.nc")
    again = Rollout.load(tmp_path / "rollout.nc")
    assert again.object_names == ("box",)
    for name in ("object_position", "object_quaternion", "object_velocity", "object_angular_velocity"):
        np.testing.assert_array_equal(getattr(again, name), getattr(rollout, name))
    assert not layout_problems(tmp_path / "rollout.nc", Rollout)
    assert again.slot_bodies() == (("pad", "table"), ("pad", "box"), *[("box", "table")] * 8)
    assert again.on_hand() == (True, True, *[False] * 8)
    lines = check_rollout(again)
    assert len(lines) == 1
    assert "contacts pad/table, pad/box, box/table; " in lines[0]
    inside, lost = np.array(again.gap), np.array(again.object_position)
    inside[0, 4:6] = -0.002, -0.003
    lost[-1, 0, 2] -= 3.0
    told = check_rollout(dataclasses.replace(again, gap=inside, object_position=lost))
    assert [line.rpartition("': ")[2] for line in told[1:]] == [
        "box begins 3 mm inside table: see its position", "box has fallen 3 m: is there a surface under it?"
    ]  # fmt: skip
    sideways = np.array(again.contact_force)
    sideways[50, 2:, 0] += 0.3 * sideways[50, 2:, 2]
    told = check_rollout(dataclasses.replace(again, contact_force=sideways))
    assert any("leaves the friction cone of 0.2" in line for line in told)


FELT = PairFriction(("table", "box"), 0.2)


def test_resample_turns_quaternions_along_the_shortest_way():
    model = index_finger(root="free")
    turns = Rotation.from_rotvec([[0.1, 0.2, -0.3], [0.5, -0.4, 0.9]])
    q = np.zeros((2, model.nq))
    q[:, 3:7] = turns.as_quat(scalar_first=True)
    q[:, 7:] = [[0.0, 0.1, 0.2, 0.3], [0.4, 0.3, 0.2, 0.1]]
    at = np.array([-1.0, 0.0, 0.25, 0.7, 1.0, 2.0])
    compliance = np.stack([np.zeros(model.nv), np.ones(model.nv)])
    found = resample(model, np.array([0.0, 1.0]), Target(jnp.asarray(q), jnp.asarray(compliance)), at)
    inside = np.clip(at, 0.0, 1.0)
    slerp = Slerp([0.0, 1.0], turns)(inside).as_matrix()
    rotation = Rotation.from_quat(np.asarray(found.reference[:, 3:7]), scalar_first=True).as_matrix()
    np.testing.assert_allclose(rotation, slerp, atol=1e-12)
    np.testing.assert_allclose(
        found.reference[:, 7:], q[:1, 7:] + inside[:, None] * (q[1:, 7:] - q[:1, 7:]), atol=1e-12
    )
    np.testing.assert_allclose(found.compliance, np.tile(inside[:, None], (1, model.nv)), atol=1e-15)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("compliance", -0.1, "compliance of z is -0.1 at 5.030 s"),
        ("compliance", np.nan, "compliance of z is nan at 5.030 s"),
        ("compliance", np.inf, "compliance of z is inf at 5.030 s"),
        ("reference", np.nan, "reference coordinate 2 is nan at 5.030 s"),
    ],
)
def test_numbers_that_cannot_be_simulated(field, value, message):
    interaction = tapping()
    array = np.array(getattr(interaction, field))
    array[3, 2] = value
    with pytest.raises(ValueError, match=message):
        transfer(dataclasses.replace(interaction, **{field: array}), floor(0.5))
