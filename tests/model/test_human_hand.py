"""The shipped hand: freedom, mirror image, proportions, mass, ranges, opposition of the thumb."""

import re
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from derivatives import check_derivatives
from scipy.optimize import minimize

from icjax.model import (
    forward_kinematics,
    human_hand,
    integrate,
    mass_matrix,
    pad_positions,
    point_jacobian,
    site_positions,
)

ROUNDING = 1e-12
"""A few products of rotations and lengths of order 1 m."""

FINGERS = ("index", "middle", "ring", "little")
HAND = human_hand()
FIXED = human_hand(root="fixed")
FLIP = np.array([1.0, -1.0, 1.0])
pads = jax.jit(pad_positions)


def test_wrist_five_digits_and_an_arm_that_gives_way():
    assert HAND.nv == 28
    assert HAND.joint_types == ("free",) + 22 * ("hinge",)
    assert HAND.joint_names[1:7] == (
        "wrist_flexion",
        "wrist_deviation",
        "thumb_CM_flexion",
        "thumb_CM_abduction",
        "thumb_MP",
        "thumb_IP",
    )
    assert HAND.joint_names[7:11] == ("index_MP", "index_abduction", "index_PIP", "index_DIP")
    assert HAND.pad_names == ("thumb", *FINGERS)
    assert len(HAND.site_names) == 3 * 16 + 4
    np.testing.assert_allclose(HAND.compliance[:6], [0.05] * 3 + [1 / 400] * 3)
    np.testing.assert_allclose(HAND.damping, 0.04 / np.asarray(HAND.compliance))
    free = human_hand(root="free")
    np.testing.assert_array_equal(free.compliance[:6], np.zeros(6))
    np.testing.assert_array_equal(free.damping[:6], np.zeros(6))
    np.testing.assert_array_equal(free.compliance[6:], HAND.compliance[6:])
    np.testing.assert_array_equal(FIXED.compliance, HAND.compliance[6:])


def test_the_root_gives_the_compliance_at_a_contact_full_rank():
    """Section 6.2: a straight finger gives way nowhere along itself, but for the arm."""

    @jax.jit
    def endpoint_compliance(model, q):
        places = pad_positions(model, q)
        J = [point_jacobian(model, q, body, p) for body, p in zip(HAND.pad_bodies, places, strict=True)]
        return jnp.stack([each @ jnp.diag(jnp.asarray(model.compliance)) @ each.T for each in J])

    straight = jnp.asarray(HAND.zero)
    with_arm = np.linalg.eigvalsh(np.asarray(endpoint_compliance(HAND, straight)))
    without = np.linalg.eigvalsh(np.asarray(endpoint_compliance(human_hand(root="free"), straight)))
    assert np.all(with_arm[:, 0] > 1 / 400)  # the arm's alone has that in all directions, joints only add
    assert np.all(without[1:, 0] < 1e-4)  # the fingers' joints; the pad's centre lies 1.5 mm off their line


def test_a_left_hand_is_the_mirror_image_of_the_right_one():
    left = human_hand(side="left")
    rng = np.random.default_rng(0)
    dq = np.concatenate([rng.normal(size=6), rng.uniform(HAND.lower[7:], HAND.upper[7:])])
    spatial = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])  # a mirrored twist, (angular, linear)
    signs = np.concatenate([spatial, np.ones(22)])

    @jax.jit
    def seen(model, dq):
        q = integrate(model, jnp.asarray(model.zero), dq)
        centres = jax.vmap(lambda X, p: X.apply(p))(forward_kinematics(model, q), jnp.asarray(model.body_com))
        return site_positions(model, q), pad_positions(model, q), centres, mass_matrix(model, q)

    *points, mass = seen(HAND, jnp.asarray(dq))
    *images, image_mass = seen(left, jnp.asarray(signs * dq))
    for place, image in zip(points, images, strict=True):
        np.testing.assert_allclose(image, np.asarray(place) * FLIP, atol=ROUNDING)
    np.testing.assert_allclose(image_mass, np.asarray(mass) * np.outer(signs, signs), atol=ROUNDING)
    for name in ("lower", "upper", "rest", "compliance", "damping", "pad_radius"):
        np.testing.assert_array_equal(getattr(left, name), getattr(HAND, name))


def test_every_length_grows_with_the_hand():
    larger, factor = human_hand(0.19 * 1.2), 1.2
    for name in ("body_position", "body_com", "site_position", "pad_centre", "pad_radius"):
        np.testing.assert_allclose(getattr(larger, name), factor * getattr(HAND, name), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(larger.body_mass, factor**3 * HAND.body_mass)
    np.testing.assert_allclose(larger.body_inertia, factor**5 * HAND.body_inertia, atol=ROUNDING)
    for name in ("body_rotation", "joint_axis", "lower", "upper", "compliance"):
        np.testing.assert_array_equal(getattr(larger, name), getattr(HAND, name))


def test_breadth_widens_the_hand_and_leaves_its_bones_as_long():
    broad = human_hand(breadth=0.1)
    bones = [HAND.body(f"{finger}_{segment}") for finger in FINGERS for segment in ("proximal", "middle", "distal")]
    length = np.linalg.norm(HAND.body_position, axis=1)
    np.testing.assert_allclose(np.linalg.norm(broad.body_position, axis=1)[bones], length[bones], atol=ROUNDING)
    index = HAND.body("index_proximal")
    np.testing.assert_allclose(broad.body_position[index][1], HAND.body_position[index][1] * 0.1 / (0.45 * 0.19))
    assert np.all(np.asarray(broad.pad_radius) > HAND.pad_radius)
    np.testing.assert_allclose(length[index], 0.463 * 0.19, atol=ROUNDING)  # the ray of the shipped index finger
    np.testing.assert_allclose(length[[index + 1, index + 2]], [0.245 * 0.19, 0.143 * 0.19], atol=ROUNDING)


def test_the_middle_finger_ends_at_the_hand_length_and_the_hand_has_a_hands_mass():
    tip = np.asarray(pads(FIXED, np.zeros(22)))[FIXED.pad("middle")]
    # Its knuckle lies on the axis; the pad is 1.5 mm below it, the finger rolled by 3 deg.
    np.testing.assert_allclose(tip[0] + FIXED.pad_radius[FIXED.pad("middle")], 0.19, atol=1e-4)
    # 0.6 % of a body of 65 to 80 kg; a forearm of 1.5 %.
    assert 0.38 < np.sum(HAND.body_mass[2:]) < 0.48
    assert 0.9 < HAND.body_mass[1] < 1.3
    moments = np.linalg.eigvalsh(HAND.body_inertia[1:])
    assert np.all(moments > 0)
    assert np.all(moments[:, 0] + moments[:, 1] >= moments[:, 2] * (1 - ROUNDING))


def test_the_table_in_the_docstring_is_the_model():
    rows = re.findall(r"^ +(\w+)(, \.\.\.)? +(-?\d+) to (-?\d+) +([\d.]+) +(-?\d+)$", human_hand.__doc__, re.M)
    known = {}
    for name, several, *numbers in rows:
        for finger in FINGERS if several else ("index",):
            known[name.replace("index", finger)] = [float(number) for number in numbers]
    assert tuple(known) != ()
    assert set(known) == set(FIXED.joint_names)
    for joint, name in enumerate(FIXED.joint_names):
        lower, upper, compliance, rest = known[name]
        found = np.degrees([FIXED.lower[joint], FIXED.upper[joint], FIXED.rest[joint]])
        np.testing.assert_allclose(found, [lower, upper, rest], atol=1e-9, err_msg=name)
        np.testing.assert_allclose(FIXED.compliance[joint], compliance, atol=5e-5, err_msg=name)  # as many digits
    for q in (FIXED.zero, FIXED.rest):
        assert np.all(FIXED.lower < q)
        assert np.all(q < FIXED.upper)


@pytest.mark.parametrize("side", ["right", "left"])
def test_joints_turn_to_the_named_side(side):
    hand = human_hand(side=side, root="fixed")
    thumbward = 1.0 if side == "right" else -1.0
    start = np.asarray(pads(hand, np.zeros(22)))

    def moved(joint, pad):
        q = np.zeros(22)
        q[hand.joint(joint)] = 0.3
        return (np.asarray(pads(hand, q)) - start)[hand.pad(pad)] * [1.0, thumbward, 1.0]

    for finger in FINGERS:
        for joint in ("wrist_flexion", f"{finger}_MP", f"{finger}_PIP", f"{finger}_DIP"):
            assert moved(joint, finger)[2] < -1e-3, joint
        outward = 1.0 if finger in ("index", "middle") else -1.0
        assert outward * moved(f"{finger}_abduction", finger)[1] > 1e-2
        assert moved("wrist_deviation", finger)[1] > 1e-2
    for joint in ("thumb_CM_flexion", "thumb_MP", "thumb_IP"):
        assert moved(joint, "thumb")[1] < -1e-3, joint  # across the palm
    assert moved("thumb_CM_abduction", "thumb")[2] < -1e-2  # out of its plane


@jax.jit
@partial(jax.value_and_grad, has_aux=True)
def apart(q, pad):
    """What keeps the thumb's pad from another; the gap (m) and the cosines of the angles off their palmar sides."""
    places, poses = pad_positions(FIXED, q), forward_kinematics(FIXED, q)
    between = places[pad] - places[0]
    distance = jnp.linalg.norm(between)
    bodies, radius = jnp.asarray(FIXED.pad_bodies), jnp.asarray(FIXED.pad_radius)
    facing = jnp.stack([-poses[bodies[0]].rotation[:, 2] @ between, poses[bodies[pad]].rotation[:, 2] @ between])
    gap, facing = distance - radius[0] - radius[pad], facing / distance
    strain = jnp.sum((q - jnp.asarray(FIXED.rest)) ** 2)
    return (100 * gap) ** 2 + jnp.sum(jnp.maximum(0.7 - facing, 0.0) ** 2) + 1e-3 * strain, (gap, facing)


def test_the_thumbs_pad_meets_every_fingers_within_the_limits():
    for finger in FINGERS:
        pad = FIXED.pad(finger)
        start = np.array(FIXED.rest)
        start[[FIXED.joint(f"{finger}_{joint}") for joint in ("MP", "PIP", "DIP")]] = np.radians([50, 50, 20])
        start[FIXED.joint("thumb_CM_flexion")] = np.radians(20)

        def cost(q, pad=pad):
            (value, _), slope = apart(jnp.asarray(q), pad)
            return float(value), np.asarray(slope)

        bounds = list(zip(FIXED.lower, FIXED.upper, strict=True))
        q = minimize(cost, start, jac=True, bounds=bounds, method="L-BFGS-B").x
        (_, (gap, facing)), _ = apart(jnp.asarray(q), pad)
        assert abs(float(gap)) < 0.001, finger
        assert np.all(np.asarray(facing) > 0.6), finger  # where the palmar side points, within 53 deg
        assert np.all((q >= FIXED.lower - ROUNDING) & (q <= FIXED.upper + ROUNDING))


def test_derivatives_of_the_fingertips():
    check_derivatives(lambda q: pad_positions(FIXED, q), FIXED.zero, FIXED.rest)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"length": 0.4}, "length is 0.4 m; it must lie between 0.1 and 0.3 m"),
        ({"length": float("nan")}, "length is nan m"),
        ({"breadth": 85.0}, "breadth is 85.0 m; it must lie between 0.3 and 0.6 of the length, 0.19 m"),
        ({"side": "both"}, "side is 'both'; it must be 'right' or 'left'"),
        ({"root": "loose"}, "root is 'loose'; it must be 'compliant', 'free' or 'fixed'"),
    ],
)
def test_nonsense_is_refused(arguments, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        human_hand(**arguments)
