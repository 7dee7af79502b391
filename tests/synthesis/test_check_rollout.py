"""The validator of rollouts: a simulated one passes; pulling, leaving the cone and unsolved steps are told."""

import dataclasses

import numpy as np
import pytest
from hands import constant_targets, floor, sprung_tip

from icjax.rollout import Rollout
from icjax.synthesis import check_rollout, rollout, slot_names

STEPS = 20


@pytest.fixture(scope="module")
def pressed():
    model, scene = sprung_tip(), floor(0.5)
    reference = np.tile([0.0, 0.0, 0.005], (STEPS, 1))
    reference[:, 0] = np.linspace(0.0, 0.01, STEPS)
    _, info = rollout(model, scene, constant_targets(model, reference))
    return Rollout(
        name="pressed",
        model=model,
        scene=scene.describe(),
        time=scene.step * np.arange(STEPS),
        slot_names=slot_names(model, scene),
        **{name: np.asarray(value) for name, value in vars(info).items()},
    )


def test_a_sound_rollout_passes(pressed):
    lines = check_rollout(pressed)
    assert len(lines) == 1
    assert "20 steps, contacts pad/plate; 0 steps not solved" in lines[0]
    assert np.linalg.norm(pressed.contact_force) > 0


def test_faults_are_told(pressed):
    force = np.array(pressed.contact_force)
    assert any("pulls" in line for line in check_rollout(dataclasses.replace(pressed, contact_force=-force)))
    sideways = force.copy()
    sideways[5, 0, 1] += 2.0 * force[5, 0, 2]
    told = check_rollout(dataclasses.replace(pressed, contact_force=sideways))
    assert any("leaves the friction cone of 0.5" in line for line in told)
    status = np.zeros(STEPS, int)
    status[3] = 2
    told = check_rollout(dataclasses.replace(pressed, contact_force=sideways, status=status))
    assert any(line.startswith("suspicious: ") and "1 steps are not solved" in line for line in told)
    assert any("leaves the friction cone" in line for line in told)


def test_what_no_movement_does_is_suspicious(pressed):
    def told(**fields):
        return check_rollout(dataclasses.replace(pressed, **fields))

    error = np.array(pressed.equilibrium_error)
    error[7] += 0.3
    assert any("1 steps are far from equilibrium" in line for line in told(equilibrium_error=error))
    q = np.array(pressed.q)
    q[9:] += 2.0
    assert any("jumps by 2" in line for line in told(q=q))
    low = dataclasses.replace(pressed.model, upper=np.asarray(pressed.q).min(axis=0) - 1.0)
    assert any("beyond its limits" in line and "no room for its limit" in line for line in told(model=low))
    gap = np.array(pressed.gap)
    gap[4] = -0.5
    assert any("is pressed 500 mm into the surface at" in line for line in told(gap=gap))
