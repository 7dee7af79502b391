"""Inverse dynamics of a recording: MuJoCo's, statics, and what a joint's torque may depend on."""

import equinox as eqx
import hand_made
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from icjax.estimation import joint_torque, net_joint_torque, smooth_motion
from icjax.model import load_model

XML = """<mujoco><option gravity="1 -9 -2"/><worldbody>
  <body name="root" pos="0.1 0.2 0.3"><freejoint name="root"/>
    <geom type="box" size="0.1 0.2 0.05" pos="0.05 0.1 0" mass="2"/>
    <body name="arm" pos="0.2 0 0.1"><joint name="ball" type="ball" pos="0.02 0 0"/>
      <geom type="box" size="0.15 0.03 0.02" pos="0.1 0 0.02" mass="0.8"/>
      <body name="hand" pos="0.3 0 0">
        <joint name="slide" type="slide" axis="1 1 0"/><joint name="hinge" axis="0 1 1" pos="0 0 0.03"/>
        <geom type="box" size="0.05 0.04 0.01" pos="0.05 0 0" mass="0.3"/>
      </body></body></body></worldbody></mujoco>"""
RATE = 200.0
MIDDLE = slice(30, -30)
"""Frames away from the ends, where the spline's second derivative is forced to zero."""
SMOOTHING = 2e-4
"""Relative. A movement of f = 1 Hz loses (f / f_half)^4 = 1.6e-7 at 40 Hz, its acceleration (2 pi f h)^2 / 12 = 8e-5 by
the cubic spline's second derivative."""


def coordinates(t):
    """A movement of every kind of joint, at about 1 Hz: `[time, coordinate]`."""

    def turned(axis, angle):
        return Rotation.from_rotvec(np.asarray(axis)[None] * angle[:, None])

    place = np.array([0.3, -0.2, 0.1]) * np.sin(4 * t[:, None] + np.array([0.0, 1.0, 2.0]))
    root = turned([0.5, -0.3, 0.4], np.sin(5 * t + 0.3)) * turned([0.0, 0.0, 1.0], t)
    ball = turned([0.2, 0.6, -0.5], np.cos(6 * t))
    quaternions = [item.as_quat(scalar_first=True) for item in (root, ball)]
    return np.concatenate([place, *quaternions, 0.05 * np.sin(6 * t)[:, None], 0.7 * np.cos(5 * t)[:, None]], axis=1)


@pytest.fixture(scope="module")
def mujoco_model():
    return mujoco.MjModel.from_xml_string(XML)


@pytest.fixture(scope="module")
def moving():
    """The movement, with a known force on the hand in its second half."""
    time = np.arange(200) / RATE
    rng = np.random.default_rng(1)
    force, point, moment = (rng.normal(size=(200, 1, 3)) for _ in range(3))
    touching = np.arange(200)[:, None] >= 100
    return hand_made.recording(
        load_model(XML), time, coordinates(time), force, point, moment=moment, touching=touching, bodies=("hand",)
    )


def mujoco_velocity(m, t):
    """MuJoCo's velocities at the times t, by its own difference of positions over 0.2 ms."""
    h, found = 1e-4, np.zeros((len(t), m.nv))
    for row, before, after in zip(found, coordinates(t - h), coordinates(t + h), strict=True):
        mujoco.mj_differentiatePos(m, row, 2 * h, before, after)
    return found


def body_twist(qvel, q):
    """icjax's velocity: of the root (angular, linear) in body axes; MuJoCo counts its linear part in the world."""
    linear = Rotation.from_quat(q[:, 3:7], scalar_first=True).inv().apply(qvel[:, :3])
    return np.concatenate([qvel[:, 3:6], linear, qvel[:, 6:]], axis=1)


def test_velocity_and_acceleration_of_every_kind_of_joint(moving, mujoco_model):
    flipped = np.array(moving.q)
    flipped[::3, 3:7] *= -1.0  # the same rotations
    motion = smooth_motion(moving.model, moving.time, flipped, 40.0)
    h = 1e-4
    before, exact, after = (
        body_twist(mujoco_velocity(mujoco_model, moving.time + s), coordinates(moving.time + s)) for s in (-h, 0.0, h)
    )
    for ours, theirs in ((motion.v, exact), (motion.a, (after - before) / (2 * h))):
        error = np.abs(ours - theirs)[MIDDLE].max(axis=0)
        assert np.all(error < SMOOTHING * np.abs(theirs).max()), error
    np.testing.assert_allclose(np.linalg.norm(motion.q[:, 3:7], axis=1), 1.0, atol=1e-12)  # rounding


def test_net_torque_is_that_of_mujoco(moving, mujoco_model):
    m, d, h = mujoco_model, mujoco.MjData(mujoco_model), 1e-4
    velocity = mujoco_velocity(m, moving.time)
    acceleration = (mujoco_velocity(m, moving.time + h) - mujoco_velocity(m, moving.time - h)) / (2 * h)
    theirs = []
    for k, q in enumerate(moving.q):
        d.qpos[:], d.qvel[:], d.qacc[:] = q, velocity[k], acceleration[k]
        mujoco.mj_inverse(m, d)
        contact = np.zeros(m.nv)
        if moving.touching[k, 0]:
            where = (moving.contact_force[k, 0], moving.contact_moment[k, 0], moving.contact_point[k, 0])
            mujoco.mj_applyFT(m, d, *where, m.body("hand").id, contact)
        theirs.append(d.qfrc_inverse - contact)
    theirs = body_twist(np.array(theirs), moving.q)  # generalised forces turn as velocities do: T is orthogonal
    error = np.abs(net_joint_torque(moving, 40.0) - theirs)[MIDDLE].max()
    assert error < SMOOTHING * np.abs(theirs).max()


def test_at_rest_it_is_gravity_less_the_contact(moving, mujoco_model):
    q = np.tile(moving.q[60], (200, 1))
    still = eqx.tree_at(lambda item: item.q, moving, q)
    tau, contact = net_joint_torque(still), np.asarray(joint_torque(still))
    d = mujoco.MjData(mujoco_model)
    d.qpos[:] = q[0]
    mujoco.mj_forward(mujoco_model, d)
    held = body_twist(d.qfrc_bias[None], q[:1])
    np.testing.assert_allclose(tau, held - contact, atol=1e-8)  # rounding of the spline's second derivative
    assert np.all(contact[:100] == 0.0)
    assert np.all(np.abs(contact[100:]).max(axis=1) > 0.1)


def test_a_joint_knows_only_what_it_carries(moving):
    """Other masses on the root's side change the root's columns alone; other masses beyond a joint change the joint."""
    item = moving
    tau = net_joint_torque(item, 40.0)
    for body, changed in (("root", 6), ("arm", 9), ("hand", 11)):
        masses = item.model.body_mass + 0.5 * (np.arange(4) == item.model.body(body))
        heavier = eqx.tree_at(lambda r: r.model.body_mass, item, masses)
        other = net_joint_torque(heavier, 40.0)
        differs = np.abs(other - tau).max(axis=0) > 1e-6
        np.testing.assert_array_equal(differs, np.arange(11) < changed)


def test_the_smoothing_spline_is_the_stated_filter():
    """Gain 1 / (1 + (0.802 f / cutoff)^4) in the middle of a long sine; derivatives are those of what is left."""
    model = hand_made.chain((0.1,), (1.0,))
    time = np.arange(2000) / 500.0
    for frequency in (1.0, 6.0, 15.0):
        q = np.sin(2 * np.pi * frequency * time)[:, None]
        motion = smooth_motion(model, time, q, 6.0)
        gain = 1 / (1 + (frequency / 6.0) ** 4 * (2**0.5 - 1))
        w = 2 * np.pi * frequency
        for ours, size in zip(motion, (1.0, w, w**2), strict=True):
            # 4e-3: the spline's second derivative is low by (w h)^2 / 12, 3e-3 at 15 Hz.
            assert np.abs(ours[500:1500]).max() == pytest.approx(gain * size, rel=4e-3)


def test_unknown_poses_stay_unknown(moving):
    item = moving
    valid = np.ones(200, bool)
    valid[80:83] = valid[84:] = False
    holes = eqx.tree_at(lambda r: r.valid, item, valid)
    tau = net_joint_torque(holes, 40.0)
    assert np.isfinite(tau[:80]).all()
    assert np.isnan(tau[80:]).all()  # frame 83 stands alone


def test_a_cutoff_must_fit_the_rate(moving):
    item = moving
    for cutoff in (0.0, 100.0):
        with pytest.raises(ValueError, match="cutoff"):
            net_joint_torque(item, cutoff)
