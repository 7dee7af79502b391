"""The movement of a hand that turned a ball turns a bulb: finger gaiting in the air with nothing dropped."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from icjax.geometry import Cylinder, Placed, Plane, Sphere, Union
from icjax.laboratory import Gait, Hand, PressureBall, Stand
from icjax.laboratory._gait import gait_command
from icjax.laboratory._grasp import simulate_grasp
from icjax.laboratory._hand_model import described_xml
from icjax.model import load_model
from icjax.spatial import Pose
from icjax.synthesis import Object, Scene, Surface, Target, rollout

GAIT = Gait(strokes=2, hold=0.2)


@pytest.mark.slow
def test_a_bulb_is_turned_by_the_gait_of_a_ball(tmp_path):
    """True compliance and reference of an independent simulation; the bulb stands on its cap at first."""
    hand, ball, stand = Hand(), PressureBall(), Stand()
    truth = simulate_grasp(hand, ball.thing("ball"), gait_command(hand, GAIT), {}, 0.0005, stand).truth
    path = tmp_path / "hand.xml"
    path.write_text(described_xml(hand, "hand"))
    model = dataclasses.replace(load_model(path), pad_compliance=np.full(5, 1.0 / hand.pad_stiffness))
    names = ("forearm_x", "forearm_y", "forearm_z", *truth.joints)
    assert model.dof_names == names
    reference = np.concatenate([truth.command[:, :3], truth.theta_free], axis=1)
    compliance = np.tile(np.concatenate([np.zeros(3), truth.C]), (len(truth.t), 1))
    height = stand.height_of(0.5 * ball.diameter)
    cap = Placed(Cylinder(0.0145, 0.022), Pose(np.eye(3), np.array([0.0, 0.0, -0.040])))
    table = Plane(np.array([0.0, 0.0, height - 0.062]), np.array([0.0, 0.0, 1.0]))
    bulb = Object(
        "bulb",
        Union([Sphere(0.5 * ball.diameter), cap]),
        ball.friction,
        mass=0.035,
        com=[0.0, 0.0, -0.018],
        inertia=np.diag([3e-5, 3e-5, 8e-6]),
        pose=Pose(np.eye(3), np.array([0.0, 0.0, height])),
    )
    scene = Scene("bulb", (Surface("table", table, 0.6),), step=0.004, objects=(bulb,), contacts=12)
    _, info = rollout(model, scene, Target(jnp.asarray(reference[::2]), jnp.asarray(compliance[::2])))
    np.testing.assert_array_equal(info.status, 0)
    R = Rotation.from_quat(np.asarray(info.object_quaternion)[:, 0][:, [1, 2, 3, 0]]).as_matrix()
    turn = np.unwrap(np.arctan2(R[:, 1, 0] - R[:, 0, 1], R[:, 0, 0] + R[:, 1, 1]))
    assert turn[-1] > 1.7 * GAIT.angle
    gaiting = truth.t >= GAIT.starts[0]
    rise = np.asarray(info.object_position)[gaiting[::2], 0, 2] - height
    assert rise.min() > 0.015
    true_rise = truth.object_pose[::2][gaiting[::2], 2] - height
    assert np.sqrt(np.mean((rise - true_rise) ** 2)) < 0.003
