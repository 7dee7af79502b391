"""Models with sites or pads added, joints locked, a part cut out, or mirrored move as the whole model does."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.model import (
    forward_kinematics,
    load_model,
    lock_joints,
    mirrored,
    pad_positions,
    part_of,
    site_positions,
    with_pads,
    with_sites,
)

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


def test_added_pads_ride_on_their_bodies():
    more = with_pads(MODEL, {"side": ("finger", (0.05, 0.0, 0.0), 0.007), "heel": ("palm", (0.0, 0.0, -0.02), 0.02)})
    assert more.pad_names == ("pad0", "side", "heel")
    np.testing.assert_array_equal(more.pad_radius, [0.008, 0.007, 0.02])
    np.testing.assert_array_equal(more.pad_compliance, np.full(3, 1 / 750))
    places = np.asarray(pad_positions(more, jnp.asarray(Q)))
    tip = np.asarray(site_positions(MODEL, jnp.asarray(Q)))[MODEL.site("tip")]
    np.testing.assert_allclose(places[more.pad("side")], tip, atol=ROUNDING)
    assert with_pads(MODEL, {"hard": ("palm", (0.0, 0.0, 0.0), 0.01)}, compliance=0.0).pad_compliance[1] == 0.0


def test_a_hand_from_a_file_is_given_pads(shared_data):
    """MyoHand has neither pads nor sphere geoms at its fingertips, but sites there."""
    with pytest.warns(UserWarning, match="absent include"):
        hand = load_model(shared_data / "myohand_model" / "hand" / "myohand.xml", strip=True)
    tips = {"thumb": "THtip", "index": "IFtip", "middle": "MFtip", "ring": "RFtip", "little": "LFtip"}
    pads = {}
    for name, site in tips.items():
        index = hand.site(site)
        pads[name] = hand.body_names[hand.site_bodies[index]], tuple(hand.site_position[index].tolist()), 0.0075
    more = with_pads(hand, pads)
    assert more.pad_names == tuple(tips)
    q = jnp.asarray(0.5 * (np.asarray(hand.lower) + np.asarray(hand.upper)))
    places, sites = jax.jit(lambda q: (pad_positions(more, q), site_positions(more, q)))(q)
    expected = np.asarray(sites)[[hand.site(site) for site in tips.values()]]
    np.testing.assert_allclose(places, expected, atol=ROUNDING)
    cut = part_of(more, "proxph2", free_root=True)
    assert cut.pad_names == ("index",)


def test_the_mirror_image_moves_as_a_mirror_shows():
    tree = load_model(
        """
<mujoco><compiler angle="radian"/><option gravity="0 2 -9"/><worldbody>
  <body name="trunk" pos="0.1 0.2 1" euler="0.1 0.2 0.3"><freejoint name="root"/><geom size="0.1" pos="0 0.05 0"/>
    <body name="arm" pos="0.3 0.1 0" euler="0.2 0.1 0.4"><joint name="shoulder" type="ball" pos="0.01 0.02 0"/>
      <geom type="box" size="0.1 0.02 0.03" euler="0.3 0.2 0.1"/>
      <body name="hand" pos="0.05 -0.1 0"><joint name="slider" type="slide" axis="0.6 0.8 0"/>
        <joint name="wrist" axis="0 0.6 0.8" pos="0.01 0.02 0.03" ref="0.2" springref="0.3" stiffness="2"/>
        <geom name="pad0" size="0.01" pos="0.1 0.02 0.03"/><site name="tip" pos="0.05 0.01 0.02"/>
      </body></body></body>
</worldbody></mujoco>"""
    )
    image = mirrored(tree)
    flip = np.array([1.0, -1.0, 1.0])
    signs = np.array([*flip, 1, -1, 1, -1, 1, -1, 1, -1, 1, 1])
    q = np.random.default_rng(3).normal(size=tree.nq)
    for part in tree.coordinate_slices[:2]:
        q[part.stop - 4 : part.stop] /= np.linalg.norm(q[part.stop - 4 : part.stop])

    @jax.jit
    def seen(model, q):
        poses = forward_kinematics(model, q)
        R = poses.rotation
        inertia = R @ jnp.asarray(model.body_inertia) @ jnp.swapaxes(R, 1, 2)
        return site_positions(model, q), pad_positions(model, q), poses.position, inertia

    *points, inertia = seen(tree, jnp.asarray(q))
    *images, image_inertia = seen(image, jnp.asarray(signs * q))
    for place, other in zip(points, images, strict=True):
        np.testing.assert_allclose(other, np.asarray(place) * flip, atol=ROUNDING)
    np.testing.assert_allclose(image_inertia, np.asarray(inertia) * np.outer(flip, flip), atol=ROUNDING)
    np.testing.assert_array_equal(image.gravity, [0.0, -2.0, -9.0])
    np.testing.assert_array_equal(image.rest, signs * np.asarray(tree.rest))
    back = mirrored(image)
    for name in ("body_position", "body_rotation", "joint_axis", "zero", "site_position"):
        np.testing.assert_array_equal(getattr(back, name), getattr(tree, name))


def test_names_that_do_not_exist_or_exist_twice():
    with pytest.raises(ValueError, match="unknown joint 'elbow'"):
        lock_joints(MODEL, ("elbow",))
    with pytest.raises(ValueError, match="unknown body 'thumb'"):
        part_of(MODEL, "thumb")
    with pytest.raises(ValueError, match="unknown body 'thumb'"):
        with_sites(MODEL, {"nail": ("thumb", (0.0, 0.0, 0.0))})
    with pytest.raises(ValueError, match="site 'tip' exists already"):
        with_sites(MODEL, {"tip": ("finger", (0.0, 0.0, 0.0))})
    with pytest.raises(ValueError, match="unknown body 'thumb'"):
        with_pads(MODEL, {"nail": ("thumb", (0.0, 0.0, 0.0), 0.01)})
    with pytest.raises(ValueError, match="pad 'pad0' exists already"):
        with_pads(MODEL, {"pad0": ("finger", (0.0, 0.0, 0.0), 0.01)})
    with pytest.raises(ValueError, match="radius of pad 'nail' is -0.01 m"):
        with_pads(MODEL, {"nail": ("finger", (0.0, 0.0, 0.0), -0.01)})
    with pytest.raises(ValueError, match="compliance is nan m/N"):
        with_pads(MODEL, {"nail": ("finger", (0.0, 0.0, 0.0), 0.01)}, compliance=float("nan"))
