"""Capsules as pads, and pads that touch each other: closed forms."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from derivatives import check_derivatives

from icjax.geometry import Box, Placed, Plane
from icjax.model import human_hand, joined, load_model, mirrored, pad_positions, part_of, with_pads
from icjax.spatial import Pose
from icjax.synthesis import PairFriction, Scene, Surface, Target, rollout, slot_names

UP = np.array([0.0, 0.0, 1.0])
SLIDES = "".join(
    f'<joint name="{{0}}_{axis}" type="slide" axis="{vector}"/>'
    for axis, vector in zip("xyz", ("1 0 0", "0 1 0", "0 0 1"), strict=True)
)
ROD = load_model(f"""
    <mujoco model="rod"><worldbody><body name="rod">{SLIDES.format("rod")}
    <joint name="tilt" axis="0 1 0"/>
    <geom name="pad" type="capsule" fromto="-0.02 0 0 0.02 0 0" size="0.006" mass="0.01" user="0.001"/></body>
    </worldbody></mujoco>""")
PAIR = load_model(f"""
    <mujoco model="pair"><worldbody>
    <body name="left">{SLIDES.format("left")}<geom name="pad_left" type="sphere" size="0.01" mass="0.01" user="0.001"/>
    <site name="mark"/></body>
    <body name="right">{SLIDES.format("right")}
    <geom name="pad_right" type="capsule" fromto="0 0 -0.02 0 0 0.02" size="0.005" mass="0.01" user="0.003"/></body>
    </worldbody></mujoco>""")
TABLE = Surface("table", Plane(np.zeros(3), UP), 0.5)


def held(model, scene, reference, compliance, steps=4):
    """A reference that stays."""
    rows = (jnp.tile(jnp.asarray(reference, float), (steps, 1)), jnp.tile(jnp.asarray(compliance, float), (steps, 1)))
    return rollout(model, scene, Target(*rows))[1]


def test_a_capsule_that_lies_on_a_table_presses_with_both_ends():
    """F = (h_r - h) / C in all; what the table takes of the turn is the difference of the ends."""
    spring, torsion, soft = 0.002, 0.5, 0.001
    info = held(ROD, Scene("table", (TABLE,)), [0.0, 0.0, 0.004, 0.01], [spring] * 3 + [torsion])
    force = np.asarray(info.contact_force)[-1, :, 2]
    z, tilt = np.asarray(info.q)[-1, 2:]
    np.testing.assert_allclose(force.sum(), (z - 0.004) / spring, rtol=1e-9)
    np.testing.assert_allclose(force, (0.006 - (z + 0.02 * np.array([1, -1]) * -np.sin(tilt))) / soft, rtol=1e-3)
    assert np.all(np.asarray(info.status) == 0)


@pytest.mark.parametrize(
    ("shape", "points"),
    [(Placed(Box(np.array([0.05, 0.05, 0.01])), Pose(np.eye(3), np.array([0.0, 0.0, -0.01]))), 2)],
)
def test_a_box_is_as_good_as_a_table(shape, points):
    on_box = held(ROD, Scene("box", (Surface("top", shape, 0.5),)), [0.003, 0.0, 0.004, 0.01], [0.002] * 3 + [0.5])
    on_table = held(ROD, Scene("table", (TABLE,)), [0.003, 0.0, 0.004, 0.01], [0.002] * 3 + [0.5])
    assert on_box.contact_force.shape[1] == points
    np.testing.assert_allclose(on_box.q, on_table.q, rtol=0, atol=1e-12)


def test_pads_that_are_named_together_press_on_each_other():
    """Two springs and two pads in a row: F = (d_r - gap) / (C_1 + C_2 + pads)."""
    scene = Scene("pair", (TABLE,), frictions=(PairFriction(("pad_left", "pad_right"), 0.7),))
    assert slot_names(PAIR, scene) == ("pad_left/table", "pad_right.1/table", "pad_right.2/table", "pad_left/pad_right")
    lifted = [0.0, 0.0, 0.1]
    info = held(PAIR, scene, [*lifted[:2], 0.1, 0.012, 0.0, 0.1], [0.002] * 3 + [0.005] * 3)
    force = np.asarray(info.contact_force)[-1]
    np.testing.assert_allclose(force[3], [-0.003 / (0.007 + 0.004), 0.0, 0.0], atol=1e-9)
    np.testing.assert_array_equal(force[:3], 0.0)
    np.testing.assert_allclose(np.asarray(info.torque)[-1, [0, 3]], force[3, 0] * np.array([1, -1]), rtol=1e-12)


def test_pads_that_are_not_named_together_pass_through_each_other():
    names = slot_names(PAIR, Scene("apart", (TABLE,)))
    assert names == ("pad_left/table", "pad_right.1/table", "pad_right.2/table")


def test_pads_of_one_body_cannot_meet():
    more = with_pads(PAIR, {"thumb": ("left", (0.0, 0.0, 0.05), 0.01)})
    with pytest.raises(ValueError, match="on one body, 'left'"):
        slot_names(more, Scene("one", (TABLE,), frictions=(PairFriction(("pad_left", "thumb"), 0.7),)))


def test_names_that_could_be_mixed_up():
    more = with_pads(PAIR, {"pad_right.1": ("left", (0.0, 0.0, 0.05), 0.01)})
    with pytest.raises(ValueError, match="two contacts would be named 'pad_right.1/table'"):
        slot_names(more, Scene("plate", (TABLE,)))
    with pytest.raises(ValueError, match="pad 'a/b' of 'pair': names of pads must be without '/'"):
        slot_names(dataclasses.replace(PAIR, pad_names=("a/b", "c")), Scene("plate", (TABLE,)))
    with pytest.raises(ValueError, match="two body names would be 'a_b_left'; take other keywords"):
        joined(a_b=PAIR, a=dataclasses.replace(PAIR, body_names=("world", "b_left", "b_right")))


@pytest.mark.parametrize(
    ("pad", "message"),
    [
        (("left", (0.0, np.nan, 0.0), 0.01), "centre of pad 'p' must be three finite numbers"),
        (("left", (0.0, 0.0, 0.0), 0.01, (0.0, 0.1)), "axis of pad 'p' must be three finite numbers"),
        (("left", (0.0, 0.0, 0.0), 0.01, (0.0, 0.0, 0.1), 0.5), "pad 'p' must be body, centre, radius and"),
    ],
)
def test_bad_pads_are_named(pad, message):
    with pytest.raises(ValueError, match=message):
        with_pads(PAIR, {"p": pad})


def test_editing_keeps_capsules():
    more = with_pads(PAIR, {"heel": ("left", (0.0, 0.0, 0.05), 0.01, (0.01, 0.02, 0.0))})
    assert more.pad_types == ("ball", "capsule", "capsule")
    np.testing.assert_allclose(more.pad_axis, [[0, 0, 0], [0, 0, -0.02], [0.01, 0.02, 0]], atol=1e-15)
    np.testing.assert_allclose(mirrored(more).pad_axis[2], [0.01, -0.02, 0])
    assert part_of(more, "right").pad_types == ("capsule",)
    np.testing.assert_allclose(part_of(more, "right").pad_axis, [[0, 0, -0.02]], atol=1e-15)
    with pytest.raises(ValueError, match="axis of pad 'flat'"):
        with_pads(PAIR, {"flat": ("left", (0.0, 0.0, 0.0), 0.01, (0.0, 0.0, 0.0))})


def test_derivatives_of_a_capsule_between_table_and_object():
    """With respect to the reference, axis and radius of the pad."""

    def pressed(x):
        model = dataclasses.replace(
            ROD, pad_axis=jnp.asarray(ROD.pad_axis) + x[None, :3], pad_radius=ROD.pad_radius + x[3]
        )
        info = held(
            model, Scene("table", (TABLE,)), jnp.array([0.0, 0.0, 0.004, 0.01]) + x[4:8], [0.002] * 3 + [0.5], 2
        )
        return jnp.concatenate([info.q[-1], info.contact_force[-1].reshape(-1)])

    check_derivatives(pressed, jnp.zeros(8), tolerance=1e-6)


HANDS = joined(left=mirrored(human_hand(pads="fingers")), right=human_hand(pads="fingers"))


def test_two_hands_are_one_model():
    """Each hand moves as it would alone; the left one is the mirror image."""
    one = human_hand(pads="fingers")
    assert len(HANDS.pad_names) == 2 * (5 + 10 + 1)
    q = jnp.asarray(one.rest).at[:3].set(jnp.array([0.1, 0.2, 0.3]))
    found = pad_positions(HANDS, jnp.concatenate([mirror_of(q), q]))
    alone = np.asarray(pad_positions(one, q))
    np.testing.assert_allclose(found, np.concatenate([alone * [1, -1, 1], alone]), atol=1e-14)
    np.testing.assert_allclose(np.asarray(HANDS.compliance), np.tile(one.compliance, 2))


def mirror_of(q):
    return q.at[:7].multiply(jnp.array([1, -1, 1, 1, -1, 1, -1.0]))


def test_a_knuckle_of_one_hand_pushes_the_finger_of_the_other():
    """Nothing else touches, so what one hand feels the other feels too; the middle segments lie crosswise."""
    scene = Scene("meet", (TABLE,), frictions=(PairFriction(("left_index_middle", "right_index_middle"), 0.5),))
    q = jnp.asarray(human_hand().rest)
    at = np.asarray(pad_positions(HANDS, jnp.concatenate([mirror_of(q), q])))
    left, right = (at[HANDS.pad(f"{side}_index_middle")] for side in ("left", "right"))
    thick = 2 * float(HANDS.pad_radius[HANDS.pad("left_index_middle")])
    shift = left - right + np.array([0.0, 0.9 * thick, 1.0])
    both = jnp.concatenate([mirror_of(q).at[2].add(1.0), q.at[:3].add(jnp.asarray(shift))])
    info = held(HANDS, scene, both, HANDS.compliance)
    force = np.asarray(info.contact_force)[-1].sum(axis=0)
    assert np.all(np.asarray(info.status) == 0)
    assert np.linalg.norm(force) > 0.1
    torque = np.asarray(info.torque)[-1]
    moved, other = torque[3:6], torque[HANDS.nv // 2 + 3 : HANDS.nv // 2 + 6]  # in the axes of the forearms
    np.testing.assert_allclose(np.linalg.norm([moved, other], axis=1), np.linalg.norm(force), rtol=1e-12)
    assert moved @ other < -0.99 * (force @ force)
