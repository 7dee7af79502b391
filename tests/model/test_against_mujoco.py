"""Kinematics and dynamics equal MuJoCo's, on the shipped finger, MyoHand and random trees."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_tree

from icjax.model import (
    acceleration_to_mujoco,
    body_jacobian,
    forward_kinematics,
    gravity_torque,
    human_hand,
    index_finger,
    integrate,
    inverse_dynamics,
    load_model,
    mass_matrix,
    neutral,
    point_jacobian,
    site_positions,
    velocity_from_mujoco,
    velocity_map,
    velocity_to_mujoco,
)
from icjax.model._human_hand import _mjcf as _hand_mjcf
from icjax.model._index_finger import _mjcf
from icjax.model._xml import prepared_xml

AGREEMENT = 1e-10
"""Relative to the largest entry of each quantity: the acceptance of the design."""


def close(ours, theirs):
    ours, theirs = np.asarray(ours), np.asarray(theirs)
    size = np.abs(theirs).max(initial=0.0)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=AGREEMENT * max(size, 1e-300))


def rotations(flat):
    return flat.reshape(-1, 3, 3)


def random_state(model, compiled, rng):
    """Coordinates, velocity and acceleration away from every reference."""
    q = np.array(compiled.qpos0)
    mujoco.mj_integratePos(compiled, q, rng.normal(size=model.nv), 1.0)
    return q, rng.normal(size=model.nv), rng.normal(size=model.nv)


@jax.jit
def ours(model, q, qvel, a):
    v = velocity_from_mujoco(model, q, qvel)
    poses = forward_kinematics(model, q)
    last = len(model.body_names) - 1
    point = poses[last].apply(jnp.asarray([0.1, -0.2, 0.3]))
    return {
        "pose": poses,
        "site": site_positions(model, q),
        "body": body_jacobian(model, q, last),
        "point": point_jacobian(model, q, last, point),
        "at": point,
        "mass": mass_matrix(model, q),
        "force": inverse_dynamics(model, q, v, a),
        "gravity": gravity_torque(model, q),
        "map": velocity_map(model, q),
        "acceleration": acceleration_to_mujoco(model, q, v, a),
        "velocity": velocity_to_mujoco(model, q, v),
    }


def compare(model, compiled, seed):
    rng = np.random.default_rng(seed)
    q, qvel, a = random_state(model, compiled, rng)
    data = mujoco.MjData(compiled)
    found = ours(model, q, qvel, a)
    T = np.asarray(found["map"])
    last = len(model.body_names) - 1

    data.qpos[:], data.qvel[:], data.qacc[:] = q, qvel, found["acceleration"]
    compiled.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    mujoco.mj_kinematics(compiled, data)
    close(found["pose"].position, data.xpos)
    close(found["pose"].rotation, rotations(data.xmat))
    close(found["site"], data.site_xpos)

    mujoco.mj_forward(compiled, data)
    data.qacc[:] = found["acceleration"]
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jac(compiled, data, linear, angular, np.asarray(found["at"]), last)
    close(found["point"] @ T.T, linear)
    close(found["body"][:3] @ T.T, angular)
    mujoco.mj_jac(compiled, data, linear, angular, np.zeros(3), last)
    close(found["body"][3:] @ T.T, linear)

    theirs = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(compiled, data, theirs)
    close(T @ found["mass"] @ T.T, theirs)
    forces = np.zeros(model.nv)
    mujoco.mj_rne(compiled, data, 1, forces)
    # mj_rne leaves armature to its caller.
    close(T @ found["force"], forces + compiled.dof_armature * data.qacc)
    data.qvel[:] = 0.0
    mujoco.mj_forward(compiled, data)
    close(T @ found["gravity"], data.qfrc_bias)
    np.testing.assert_allclose(found["velocity"], qvel, rtol=0, atol=1e-14)  # T is orthogonal to rounding


@pytest.mark.parametrize("root", ["free", "fixed"])
def test_index_finger(root):
    for seed in range(3):
        compare(index_finger(0.17, root), mujoco.MjModel.from_xml_string(_mjcf(0.17, root)), seed)


def test_human_hand():
    compiled = mujoco.MjModel.from_xml_string(_hand_mjcf(0.17, 0.08, True))
    for seed in range(2):
        compare(human_hand(0.17, 0.08, root="free"), compiled, seed)


@pytest.fixture(scope="session")
def myohand(shared_data):
    path = shared_data / "myohand_model" / "hand" / "myohand.xml"
    with pytest.warns(UserWarning, match="absent include"):
        model = load_model(path, strip=True)
    xml, _ = prepared_xml(path, str(path), True)
    return model, mujoco.MjModel.from_xml_string(xml)


def test_myohand(myohand):
    model, compiled = myohand
    assert model.nv == 23
    assert (np.asarray(model.armature) == 1e-4).all()
    for seed in range(3):
        compare(model, compiled, seed)


TOPOLOGIES = (0, 7, 11)
"""Shapes of random trees; few, as each is compiled once. The numbers of a tree are drawn anew for every example."""


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.sampled_from(TOPOLOGIES), st.integers(0, 10**6))
def test_random_trees(topology, seed):
    xml = random_tree(topology, seed)
    compare(load_model(xml), mujoco.MjModel.from_xml_string(xml), seed)


def test_random_trees_hold_every_kind_of_joint():
    """The property test above is worth something only if its trees are varied."""
    models = [load_model(random_tree(seed)) for seed in TOPOLOGIES]
    kinds = {kind for model in models for kind in model.joint_types}
    assert kinds == {"hinge", "slide", "ball", "free"}
    assert any(len(set(model.joint_bodies)) < len(model.joint_bodies) for model in models)
    assert any(len(set(model.body_parents[1:])) < len(model.body_parents) - 1 for model in models)
    assert any(len(model.joint_bodies) + 1 < model.nv for model in models)


def test_integration_agrees_with_mujoco_for_balls_and_to_first_order_for_free_joints():
    xml = random_tree(11)
    compiled, model = mujoco.MjModel.from_xml_string(xml), load_model(xml)
    rng = np.random.default_rng(0)
    q, qvel, _ = random_state(model, compiled, rng)
    step = 1e-5
    theirs = np.array(q)
    mujoco.mj_integratePos(compiled, theirs, qvel, step)
    mine = integrate(model, q, step * np.asarray(velocity_from_mujoco(model, q, qvel)))
    np.testing.assert_allclose(mine, theirs, rtol=0, atol=10 * step**2)


def test_neutral_is_mujocos_reference():
    xml = random_tree(7)
    np.testing.assert_array_equal(neutral(load_model(xml)), mujoco.MjModel.from_xml_string(xml).qpos0)
