"""The simulated hand: reference, rest, forces and momentum, which objects rise."""

import numpy as np
import pytest

from icjax.laboratory import HAND_JOINTS, FreeObject, Hand, Lift, load_grasp
from icjax.laboratory._free_object import TABLE_FRICTION
from icjax.laboratory._grasp import GraspTruth, simulate_grasp
from icjax.laboratory._hand import FINGERS
from icjax.laboratory._hand_model import GRIP_HEIGHT, HAND_DRIVEN, build_hand
from icjax.laboratory._lift import PLACES, lift_command
from icjax.laboratory._mujoco import mujoco

COARSE = 0.0005
HAND = Hand()
SHORT = Lift(rest=0.3, close=0.4, settle=0.15, rise=0.4, hold=0.25)
REST = 75
"""Frames at the end of `SHORT` in which the steady hand rests, 0.15 s."""

GRAVITY = 9.81


def lifted(thing: FreeObject, timestep: float = COARSE) -> GraspTruth:
    """A lift by a perfectly steady hand."""
    return simulate_grasp(HAND, thing, lift_command(HAND, SHORT), {}, timestep).truth


@pytest.fixture(scope="module")
def box() -> GraspTruth:
    """A box of 100 g."""
    return lifted(FreeObject("box", mass=0.1))


def rise(truth: GraspTruth) -> float:
    return float(truth.object_pose[-1, 2] - truth.object_pose[0, 2])


def test_the_plan_brings_the_pads_where_they_aim():
    command = lift_command(HAND, SHORT)
    model = build_hand(HAND, None, {}, COARSE)
    data = mujoco.MjData(model)
    data.qpos[[int(model.joint(name).qposadr[0]) for name in HAND_DRIVEN]] = command[-1]
    mujoco.mj_kinematics(model, data)
    for finger in FINGERS:
        tip = data.site_xpos[model.site(f"{finger}_tip").id]
        side = -1.0 if finger == "thumb" else 1.0
        across, above = HAND.hand_length * np.asarray(PLACES[finger])
        target = [side * (0.5 * SHORT.grip + HAND.pad(finger)[1]), across, GRIP_HEIGHT + above + SHORT.height]
        np.testing.assert_allclose(tip, target, atol=1e-8)


def test_the_reference_is_the_plan_and_the_motion_before_contact(box):
    """Feed-forward makes the empty hand follow its plan; what remains is the integrator's error."""
    onset = int(np.flatnonzero(box.f_normal.any(axis=1))[0])
    assert 0.3 < box.t[onset] < 0.7
    np.testing.assert_allclose(box.theta[:onset], box.theta_free[:onset], atol=1e-9)
    np.testing.assert_allclose(box.theta_free, box.command[:, 3:], atol=1e-3)
    assert np.abs(box.theta - box.theta_free).max() > np.radians(4.0)


def test_at_rest_springs_balance_the_contact_torque(box):
    """K (theta_free - theta) = -tau but for the change of gravity with posture: a finger of 40 g, 40 mm from its
    joint, turned by 0.2 rad changes it by 3 mNm; springs carry up to 150."""
    spring = (box.theta_free[-1] - box.theta[-1]) / box.C
    np.testing.assert_allclose(spring, -box.tau[-1], atol=4e-3)
    assert np.abs(box.tau[-1]).max() > 0.1


def test_at_rest_pads_are_springs(box):
    """The weight of a pad (1 g) is 10 mN; at rest the damper carries less than 5 mN."""
    np.testing.assert_allclose((box.pad - box.bone)[-REST:] * box.pad_stiffness, box.f_contact[-REST:], atol=0.015)


def test_forces_on_the_object_accelerate_it(box):
    """Once off the table: sum of -f = m (a + g). Acceleration from second differences of the position over 10 ms;
    0.06 N is 6 % of the weight, the change of force within those."""
    off = box.object_pose[:, 2] > box.object_pose[0, 2] + 0.003
    assert off.sum() > 200
    wide = 5
    place = box.object_pose[:, :3]
    acceleration = np.zeros_like(place)
    acceleration[wide:-wide] = (place[2 * wide :] - 2.0 * place[wide:-wide] + place[: -2 * wide]) * (500.0 / wide) ** 2
    expected = 0.1 * (acceleration + [0.0, 0.0, GRAVITY])
    inner = np.flatnonzero(off)[: -wide - 1]
    np.testing.assert_allclose(-box.f_contact.sum(axis=1)[inner], expected[inner], atol=0.06)
    held = -box.f_contact[-REST:].sum(axis=1).mean(axis=0)
    np.testing.assert_allclose(held, [0.0, 0.0, 0.1 * GRAVITY], atol=0.01)


def test_forces_stay_in_the_friction_cone(box):
    """MuJoCo's cone is exact; the contact's frame is that of the true surface, the normal here that of the sphere."""
    along = np.linalg.norm(box.f_contact, axis=2) ** 2 - box.f_normal**2
    tangential = np.sqrt(np.maximum(along, 0.0))
    assert (tangential - box.mu * box.f_normal).max() < 0.01
    assert box.f_normal.min() > -1e-9


def test_tau_is_the_work_of_the_force(box):
    """Virtual work: tau . dtheta is the force times the motion of its point, by moving the joints of the true model.

    Central differences of 1e-5 rad of the pad's centre; the contact lies a radius from it and moves with the bone.
    """
    model = build_hand(HAND, None, {}, COARSE)
    data = mujoco.MjData(model)
    address = [int(model.joint(name).qposadr[0]) for name in HAND_JOINTS]
    bodies = [model.body(f"{finger}_distal").id for finger in FINGERS]
    frame = -1
    theta, force = box.theta[frame], box.f_contact[frame]
    size = np.array([HAND.pad(finger)[1] for finger in FINGERS])
    normal = np.array([[-1.0, 0, 0]] + [[1.0, 0, 0]] * 4)
    tilt = np.zeros(9)
    mujoco.mju_quat2Mat(tilt, box.object_pose[frame, 3:])
    contact = box.pad[frame] - size[:, None] * (normal @ tilt.reshape(3, 3).T)

    def points(angles, local=None):
        data.qpos[:] = 0.0
        data.qpos[address] = angles
        data.qpos[:3] = box.root[frame] - build_root(model)
        mujoco.mj_kinematics(model, data)
        R, p = data.xmat[bodies].reshape(-1, 3, 3), data.xpos[bodies]
        if local is None:
            return np.einsum("fji,fj->fi", R, contact - p)
        return np.einsum("fij,fj->fi", R, local) + p

    local = points(theta)
    for joint in range(len(HAND_JOINTS)):
        step = 1e-5 * np.eye(len(HAND_JOINTS))[joint]
        moved = (points(theta + step, local) - points(theta - step, local)) / 2e-5
        assert np.sum(force * moved) == pytest.approx(box.tau[frame, joint], abs=2e-4), HAND_JOINTS[joint]


def build_root(model) -> np.ndarray:
    return np.array(model.body("forearm").pos)


@pytest.mark.parametrize(
    "thing",
    [
        FreeObject("wedge", shape="wedge", taper=float(np.radians(8.0))),
        FreeObject("sphere", shape="sphere", size=(0.044,)),
        FreeObject("cylinder", shape="cylinder", size=(0.040, 0.060)),
    ],
    ids=lambda thing: thing.name,
)
def test_every_shape_stands_and_rises(thing):
    """Compliance lowers the hand a few millimetres under the 80 of the forearm; before contact the object stands."""
    truth = lifted(thing)
    standing = truth.object_pose[: np.flatnonzero(truth.f_normal.any(axis=1))[0]]
    np.testing.assert_allclose(standing, np.tile([0, 0, 0.5 * thing.height, 1, 0, 0, 0], (len(standing), 1)), atol=2e-4)
    assert 0.070 < rise(truth) < 0.082
    held = -truth.f_contact[-REST:].sum(axis=1).mean(axis=0)
    np.testing.assert_allclose(held, [0.0, 0.0, thing.mass * GRAVITY], atol=0.01)


@pytest.mark.parametrize("change", [{"mass": 0.6}, {"friction": 0.15}])
def test_what_is_too_heavy_or_too_slippery_stays(box, change):
    thing = FreeObject("box", **{"mass": 0.1, **change})
    truth = lifted(thing)
    pressed = truth.f_normal[:, 0].max()
    assert 2.0 * thing.friction * pressed < 1.2 * thing.mass * GRAVITY  # it should not, by the grip that it had
    assert rise(truth) < 0.002
    assert rise(box) > 0.07
    np.testing.assert_array_equal(truth.theta_free, box.theta_free)  # the same command


def test_the_coarse_step_is_fine_enough(box):
    finer = lifted(FreeObject("box", mass=0.1), 0.00025)
    total = finer.f_normal.sum(axis=1)
    difference = box.f_normal.sum(axis=1) - total
    assert np.sqrt(np.mean(difference**2) / np.mean(total**2)) < 0.01
    np.testing.assert_allclose(box.object_pose[-1, :3], finer.object_pose[-1, :3], atol=2e-4)


def test_the_table_has_its_own_friction():
    """The open hand pushes a brick before its thumb: the table's coefficient, not the larger of both."""
    command = np.tile(lift_command(HAND, SHORT)[0], (751, 1))
    command[:, 0] = 0.030 * np.clip((np.arange(751) - 100) / 500.0, 0.0, 1.0)
    thing = FreeObject("brick", size=(0.052, 0.070, 0.045), mass=0.1, friction=1.0)
    truth = simulate_grasp(HAND, thing, command, {}, COARSE).truth
    sliding = slice(400, 600)
    assert not truth.f_normal[sliding, 1:].any()
    assert np.diff(truth.object_pose[sliding, 0]).min() * 500.0 > 0.01  # of 0.03 m/s
    push, down = -truth.f_contact[sliding, 0, 0], -truth.f_contact[sliding, 0, 2]
    ratio = push.mean() / (thing.mass * GRAVITY - down.mean())
    assert ratio == pytest.approx(TABLE_FRICTION, rel=0.03)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"shape": "cone"}, "shape"),
        ({"size": (0.03, 0.07)}, "size of a box"),
        ({"size": (0.03, 0.07, float("nan"))}, "size"),
        ({"mass": 0.0}, "mass"),
        ({"friction": -0.1}, "friction"),
        ({"taper": 0.1}, "taper"),
        ({"shape": "wedge"}, "taper"),
        ({"shape": "wedge", "taper": 0.6}, "taper"),
        ({"name": "a/b"}, "name"),
    ],
)
def test_bad_objects_name_the_argument(arguments, word):
    with pytest.raises(ValueError, match=word):
        FreeObject(**{"name": "thing", **arguments})


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"hand_length": 0.1}, "hand_length"),
        ({"compliance": (0.3,) * 4}, "compliance"),
        ({"compliance": (0.3,) * 20 + (-1.0,)}, "little_dip"),
        ({"damping_time": 0.0}, "damping_time"),
        ({"pad_stiffness": 10.0}, "pad_stiffness"),
        ({"twist": -0.1}, "twist"),
    ],
)
def test_bad_hands_name_the_argument(arguments, word):
    with pytest.raises(ValueError, match=word):
        Hand(**arguments)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"open": 0.01}, "open"),
        ({"height": 0.4}, "height"),
        ({"rest": 0.1}, "rest"),
        ({"close": 0.05}, "close"),
        ({"hold": float("nan")}, "hold"),
    ],
)
def test_bad_lifts_name_the_argument(arguments, word):
    with pytest.raises(ValueError, match=word):
        Lift(**arguments)


def test_a_movement_out_of_reach_is_refused():
    with pytest.raises(ValueError, match="cannot reach"):
        lift_command(HAND, Lift(open=0.12))


def test_the_recorded_truth_is_noisy_but_the_same_grasp(grasped):
    folder, _ = grasped
    truth = load_grasp(folder / "truth" / "box.npz")
    planned = lift_command(HAND, SHORT)
    deviation = (truth.theta_free - planned[:, 3:]).std(axis=0)
    assert np.radians(0.05) < deviation.min()
    assert deviation.max() < np.radians(0.5)
    assert rise(truth) > 0.07
