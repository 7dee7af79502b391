"""Grip tightening on slip and before it: two fingers hold a box too heavy for their grip; a policy of one's own."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from derivatives import check_derivatives
from test_objects import FINGER, GRAVITY, HALF, PAD, PINCH, UP

from icjax.geometry import Box, Plane
from icjax.synthesis import GripTightening, ImminentSlip, Object, Policy, Scene, Surface, Target, rollout

MASS, FRICTION, DEPTH, STEP = 0.11, 0.6, 0.01, 0.002
NEEDED = MASS * GRAVITY / (2 * FRICTION)
"""N, of each finger; without a policy they press with DEPTH / (C + C_pad) = 0.76 N, too little by a sixth."""


def held(policy, steps=400, more=np.zeros(3)):
    """The box's weight comes upon the fingers within 0.5 s. Forces of both fingers on the box, and what was found.

    `more` compliance (share) and mass (0.1 kg) are its second and third number.
    """
    model = dataclasses.replace(PINCH, pad_compliance=np.full(2, PAD))
    box = Object("box", Box(HALF), FRICTION, mass=MASS + 0.1 * more[2])
    far = Surface("table", Plane(np.array([0.0, 0.0, -10.0]), UP), 0.5)
    reach = HALF[0] + 0.0075 - DEPTH
    reference = jnp.tile(jnp.array([-reach, 0.0, 0.0, reach, 0.0, 0.0]), (steps, 1))
    wrench = np.zeros((steps, 1, 6))
    wrench[:, 0, 5] = MASS * GRAVITY * np.clip(1 - STEP * np.arange(steps) / 0.5, 0, 1)
    scene = Scene("pinch", (far,), facets=2, step=STEP, objects=(box,), contacts=2)
    _, info = rollout(
        model, scene, Target(reference, jnp.full((steps, 6), FINGER * (1.0 + more[1])), wrench), policy=policy
    )
    if isinstance(more, np.ndarray):
        assert np.all(np.asarray(info.status) == 0)
        return np.asarray(info.contact_force)[:, [1, 3]], info
    return info.contact_force[:, jnp.array([1, 3])], info


def share(info):
    return np.asarray(info.compliance)[:, 0] / FINGER


@pytest.mark.slow
def test_tightening_begins_the_delay_after_the_first_slip_and_holds():
    force, info = held(GripTightening(delay=0.1, rate=20.0))
    sliding = np.any(np.asarray(info.slip_state) == 2, axis=1)
    first = int(np.argmax(sliding))
    assert sliding.any()
    late = first + round(0.1 / STEP)
    np.testing.assert_array_equal(share(info)[: late + 1], 1.0)
    np.testing.assert_allclose(share(info)[late + 1], np.exp(-20.0 * STEP), rtol=1e-12)
    assert np.abs(force[-1, :, 0]).min() > NEEDED
    assert not sliding[-80:].any()
    assert np.asarray(info.object_position)[:, 0, 2].min() > -0.02  # it swings on the springs that caught it
    still_sliding = share(info)[np.flatnonzero(sliding)[-1]]
    assert share(info)[-1] < still_sliding  # what it felt a delay ago still counts


@pytest.mark.slow
def test_adjustment_before_slip_keeps_the_ratio_below_friction():
    force, info = held(ImminentSlip(threshold=0.9, rate=20.0))
    assert not np.any(np.asarray(info.slip_state) == 2)
    ratio = np.linalg.norm(force[:, :, 1:], axis=2) / np.abs(force[:, :, 0])
    assert 0.9 * FRICTION < ratio.max() < FRICTION
    tight = np.flatnonzero(np.diff(share(info)) < 0)
    # the step after a ratio beyond the threshold, and no other, is made with less compliance
    np.testing.assert_array_equal(tight, np.flatnonzero(np.any(ratio > 0.9 * FRICTION, axis=1))[: len(tight)])
    assert np.abs(force[-1, :, 0]).min() > NEEDED


class Relax(Policy):
    """Lets go after some steps."""

    after: int

    def init(self, model, scene):
        return jnp.zeros((), int)

    def apply(self, memory, target):
        return dataclasses.replace(target, compliance=jnp.where(memory < self.after, 1.0, 3.0) * target.compliance)

    def observe(self, memory, model, scene, info):
        return memory + 1


@pytest.mark.slow
def test_a_policy_of_ones_own_and_what_falls_without_one():
    force, info = held(Relax(10), steps=400)
    np.testing.assert_allclose(share(info)[[0, 9, 10, -1]], [1, 1, 3, 3])
    np.testing.assert_allclose(np.abs(force[5, :, 0]), DEPTH / (FINGER + PAD), rtol=1e-9)
    assert info.object_velocity[-1, 0, 2] < -0.3


@pytest.mark.slow
def test_derivatives_go_through_a_policy_and_its_numbers():
    """Of forces and place of the box by the rate of tightening, the compliance and the mass; the steps in which the
    hand tightens stay the same."""

    def result(x):
        _, info = held(GripTightening(delay=0.02, rate=20.0 + x[0]), steps=240, more=x)
        return jnp.concatenate([info.contact_force[-1].reshape(-1), info.object_position[-1, 0]])

    check_derivatives(result, jnp.zeros(3), tolerance=1e-5)


def test_bad_policies_are_named():
    with pytest.raises(ValueError, match="delay must be zero or more s; got -1"):
        GripTightening(delay=-1.0)
    with pytest.raises(ValueError, match="rate must be zero or more; got -2"):
        GripTightening(rate=-2.0)
    with pytest.raises(ValueError, match=r"threshold must be 0 to 1; got 1\.5"):
        ImminentSlip(threshold=1.5)
