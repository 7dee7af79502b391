"""The grasp itself moves an object to where the fingers meet it (Section 8.3)."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from test_objects import FINGER, HALF, PAD, PINCH, UP

from icjax.geometry import Box, Plane
from icjax.spatial import Pose
from icjax.synthesis import Object, Scene, Surface, Target, place_objects

STEPS = 300


def grasp(height):
    """Two fingers close over a box that stands 4 mm aside; the left one opens less far than the box is aside."""
    model = dataclasses.replace(PINCH, pad_compliance=np.full(2, PAD))
    start = Pose(np.eye(3), np.array([0.004, 0.0, HALF[2]]))
    box = Object("box", Box(HALF), 0.5, mass=0.05, pose=start)
    table = Surface("table", Plane(np.zeros(3), UP), 0.2)
    scene = Scene("pinch", (table,), facets=2, objects=(box,), contacts=6)
    reach = HALF[0] + 0.0075 + np.linspace(0.010, -0.004, STEPS)
    still = np.zeros(STEPS)
    up = still + height
    reference = np.stack([-reach, still, up, reach, still, up], axis=1)
    return model, scene, Target(jnp.asarray(reference), jnp.full((STEPS, 6), FINGER))


@pytest.mark.slow
def test_the_object_is_pushed_to_the_middle_and_let_go():
    model, scene, targets = grasp(HALF[2])
    placed = place_objects(model, scene, targets)
    x, y, z = np.asarray(placed.objects[0].pose.position)
    # the right finger, bent by mu m g of the table, has pushed it until the left one touched
    bent = 0.2 * 0.05 * 9.81 * (FINGER + PAD)
    coasting = (0.014 / (STEPS * scene.step)) ** 2 / (2 * 0.2 * 9.81)  # what it slides on when the finger stops
    assert abs(x) < bent + coasting + 1e-4
    np.testing.assert_allclose([y, z], [0.0, HALF[2]], atol=1e-6)
    np.testing.assert_array_equal(placed.objects[0].velocity, 0.0)
    assert placed.objects[0].name == "box"


def test_fingers_that_never_touch_are_named():
    model, scene, targets = grasp(0.2)
    with pytest.raises(ValueError, match="never touch together; at most all but pad_left, pad_right, in row 0"):
        place_objects(model, scene, targets)
    with pytest.raises(ValueError, match="no free object"):
        place_objects(model, dataclasses.replace(scene, objects=()), targets)
