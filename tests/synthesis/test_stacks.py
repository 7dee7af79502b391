"""Boxes and capsules on boxes: they lie, hang over and fall as statics says."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_objects import GRAVITY, UP, at, in_chunks, table

from icjax.geometry import Box, Capsule
from icjax.synthesis import Object, Scene, Surface

pytestmark = pytest.mark.slow

POLE = np.array([0.02, 0.02, 0.1])


def turned(degrees, axis="z"):
    return Rotation.from_euler(axis, degrees, degrees=True)


@pytest.mark.parametrize(
    ("half", "x", "angle", "stays"),
    [
        ((0.06, 0.01, 0.01), 0.0, 0.0, True),  # a bar across a pole: all its corners hang over
        ((0.05, 0.03, 0.01), 0.0, 30.0, True),
        ((0.03, 0.03, 0.01), 0.0195, 0.0, True),  # its centre just over the pole
        ((0.03, 0.03, 0.01), 0.0205, 0.0, False),
    ],
)
def test_a_box_on_a_smaller_pole_stays_where_its_centre_is_above_it(half, x, angle, stays):
    """And the pole carries its weight."""
    box = Object("box", Box(np.array(half)), 0.6, mass=0.2, pose=at([x, 0.0, 0.1 + half[2]], turned(angle)))
    scene = Scene("pole", (Surface("pole", Box(POLE), 0.6),), facets=2, objects=(box,))
    _, info = in_chunks(scene, 200)
    assert np.all(np.asarray(info.status) == 0)
    sunk = 0.1 + half[2] - np.asarray(info.object_position)[-1, 0, 2]
    if stays:
        assert abs(sunk) < 1e-6
        carried = np.asarray(info.contact_force)[-1].sum(axis=0)
        np.testing.assert_allclose(carried, [0, 0, 0.2 * GRAVITY], atol=1e-7)
    else:
        assert sunk > 1e-3


def test_a_tower_stands():
    """Three blocks askew; each joint carries what is above it."""
    half = np.array([0.02, 0.03, 0.01])
    blocks = tuple(
        Object(f"block{i}", Box(half), 0.5, mass=0.1, pose=at([0.004 * i, 0, 0.01 + 0.02 * i], turned(25 * i)))
        for i in range(3)
    )
    scene = Scene("tower", (table(),), facets=2, objects=blocks, contacts=28)
    _, info = in_chunks(scene, 200)
    assert np.all(np.asarray(info.status) == 0)
    start = np.array([[0.004 * i, 0.0, 0.01 + 0.02 * i] for i in range(3)])
    np.testing.assert_allclose(info.object_position[-1], start, rtol=0, atol=1e-6)


def test_a_capsule_lies_across_a_box():
    across = turned(90, "y")
    capsule = Object("rod", Capsule(0.01, 0.05), 0.5, mass=0.05, pose=at([0.0, 0.0, 0.1 + 0.01], across))
    pole = Surface("pole", Box(POLE), 0.5)
    _, info = in_chunks(Scene("rod", (pole,), facets=2, objects=(capsule,)), 100)
    assert np.all(np.asarray(info.status) == 0)
    np.testing.assert_allclose(info.object_position[-1, 0], [0, 0, 0.11], rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.asarray(info.contact_force)[-1].sum(axis=0), [0, 0, 0.05 * GRAVITY], atol=1e-7)


def test_a_box_dropped_askew_on_a_box_loses_energy_only():
    lower = Object("lower", Box(np.array([0.05, 0.05, 0.02])), 0.4, driven=True)
    askew = Rotation.from_rotvec([0.5, 0.3, 0.2])
    upper = Object("upper", Box(np.array([0.02, 0.03, 0.015])), 0.4, mass=0.1, pose=at([0.01, 0.0, 0.08], askew))
    _, info = in_chunks(Scene("drop", (), facets=2, objects=(upper, lower)), 300)
    assert np.all(np.asarray(info.status) == 0)
    speed = np.asarray(info.object_velocity)[:, 0]
    energy = 0.5 * np.sum(speed**2, axis=1) + GRAVITY * np.asarray(info.object_position)[:, 0, 2]
    assert np.all(energy < GRAVITY * 0.08 + 1e-3)
    # it lies flat on the lower one
    np.testing.assert_allclose(info.object_position[-1, 0, 2], 0.035, atol=1e-5)
    assert jnp.all(jnp.abs(info.object_position[:, 1]) < 1e-12)
    up = Rotation.from_quat(np.asarray(info.object_quaternion)[-1, 0], scalar_first=True).apply(UP)
    np.testing.assert_allclose(up, UP, atol=1e-4)
