"""Models with sites added, joints locked, or a part cut out move as the whole model does."""

import jax.numpy as jnp
import numpy as np
import pytest

from icjax.model import forward_kinematics, load_model, lock_joints, part_of, site_positions, with_sites

ROUNDING = 1e-12
"""A few products of rotations and lengths of order 1 m."""

MODEL = load_model(
    """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="arm" pos="0 0 1"><joint name="shoulder" axis="0 0 1"/><geom size="0.1"/>
    <body name="wrist" pos="0.3 0 0" euler="0.2 0.1 0">
      <joint name="deviation" axis="0 0 1" pos="0.01 0 0"/>
      <joint name="flexion" axis="0 1 0" pos="0 0.02 0" ref="0.1"/>
      <joint name="glide" type="slide" axis="1 0 0"/>
      <geom size="0.05"/><site name="back" pos="0.02 0 0.01"/>
      <body name="palm" pos="0.05 0 0"><geom size="0.03"/><site name="knuckle" pos="0.03 0 0.01"/>
        <body name="finger" pos="0.05 0.01 0"><joint name="MP" axis="0 1 0" stiffness="2"/><geom size="0.01"/>
          <geom name="pad0" type="sphere" pos="0.04 0 0" size="0.008"/><site name="tip" pos="0.05 0 0"/>
        </body></body></body></body>
</worldbody></mujoco>"""
)
Q = np.array([0.3, -0.4, 0.7, 0.01, 0.5])


@pytest.mark.parametrize("locked", [("deviation",), ("flexion",), ("glide", "flexion"), ("deviation", "glide", "MP")])
def test_a_locked_joint_stands_where_it_was(locked):
    free = [index for index, name in enumerate(MODEL.joint_names) if name not in locked]
    fixed = lock_joints(MODEL, locked, Q)
    assert fixed.joint_names == tuple(MODEL.joint_names[index] for index in free)
    for shift in (0.0, 0.3):
        q = Q.copy()
        q[free] += shift
        expected = site_positions(MODEL, jnp.asarray(q))
        np.testing.assert_allclose(site_positions(fixed, jnp.asarray(q[free])), expected, atol=ROUNDING)


def test_joints_are_locked_at_zero_displacement_by_default():
    fixed = lock_joints(MODEL, ("flexion",))
    q = Q.copy()
    q[2] = 0.1  # its `ref`
    expected = site_positions(MODEL, jnp.asarray(q))
    np.testing.assert_allclose(site_positions(fixed, jnp.asarray(np.delete(q, 2))), expected, atol=ROUNDING)


def test_a_part_moves_on_a_free_root_as_it_moves_on_the_whole():
    part = part_of(MODEL, "palm")
    assert part.body_names == ("world", "palm", "finger")
    assert part.joint_names == ("root", "MP")
    assert part.pad_bodies == (2,)
    assert np.all(part.compliance[:6] == 0)
    assert part.compliance[6] == 0.5
    pose = forward_kinematics(MODEL, jnp.asarray(Q))[MODEL.body("palm")]
    R = np.asarray(pose.rotation)
    w = 0.5 * np.sqrt(1 + np.trace(R))
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (4 * w)
    q = np.concatenate([pose.position, [w], axis, Q[4:]])
    expected = site_positions(MODEL, jnp.asarray(Q))[1:]
    np.testing.assert_allclose(site_positions(part, jnp.asarray(q)), expected, atol=ROUNDING)


def test_a_part_without_free_root_keeps_its_joints_and_place_in_its_parent():
    part = part_of(MODEL, "finger", free_root=False)
    assert part.joint_names == ("MP",)
    np.testing.assert_allclose(site_positions(part, jnp.zeros(1))[0], [0.1, 0.01, 0.0], atol=ROUNDING)


def test_added_sites_ride_on_their_bodies():
    more = with_sites(MODEL, {"nail": ("finger", (0.05, 0.0, 0.0)), "top": ("palm", (0.0, 0.0, 0.02))})
    places = np.asarray(site_positions(more, jnp.asarray(Q)))
    np.testing.assert_allclose(places[more.site("nail")], places[more.site("tip")], atol=ROUNDING)
    assert more.site_names[-1] == "top"


def test_names_that_do_not_exist_or_exist_twice():
    with pytest.raises(ValueError, match="unknown joint 'elbow'"):
        lock_joints(MODEL, ("elbow",))
    with pytest.raises(ValueError, match="unknown body 'thumb'"):
        part_of(MODEL, "thumb")
    with pytest.raises(ValueError, match="unknown body 'thumb'"):
        with_sites(MODEL, {"nail": ("thumb", (0.0, 0.0, 0.0))})
    with pytest.raises(ValueError, match="site 'tip' exists already"):
        with_sites(MODEL, {"tip": ("finger", (0.0, 0.0, 0.0))})
