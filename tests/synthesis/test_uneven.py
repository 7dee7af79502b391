"""Cans on boxes, things on uneven ground, and meshes: they rest as statics says; pads on a mesh; starts inside."""

import numpy as np
import pytest
import trimesh
from hands import constant_targets, sprung_tip
from scipy.spatial.transform import Rotation
from test_objects import GRAVITY, at, in_chunks, table

from icjax.geometry import Box, Cylinder, Heightfield, Placed, Sphere, triangle_mesh
from icjax.spatial import Pose
from icjax.synthesis import Object, Scene, Surface, rollout

RADIUS = 0.03


def carried(info):
    return np.asarray(info.contact_force)[-1].sum(axis=0)


@pytest.mark.slow
def test_a_can_stands_on_a_box_and_lies_on_it():
    """Both cans and the box are of one kind, so that they share a compilation; overhanging too far, it falls."""
    top = Surface("top", Box(np.array([0.1, 0.1, 0.05])), 0.5)
    lying = Rotation.from_euler("y", 90, degrees=True)
    for position, turn, stays in (
        ((0.0, 0.0, 0.05 + 0.03), None, True),
        ((0.085, 0.0, 0.05 + 0.03), None, True),
        ((0.115, 0.0, 0.05 + 0.03), None, False),
        ((0.0, 0.02, 0.05 + 0.02), lying, True),
    ):
        can = Object("can", Cylinder(0.02, 0.03), 0.5, mass=0.3, pose=at(position, turn))
        _, info = in_chunks(Scene("can", (top,), facets=2, objects=(can,)), 200)
        assert np.all(np.asarray(info.status) == 0)
        moved = np.asarray(info.object_position)[-1, 0] - position
        if stays:
            assert np.max(np.abs(moved)) < 2e-5
            np.testing.assert_allclose(carried(info), [0, 0, 0.3 * GRAVITY], atol=1e-3)
        else:
            assert moved[2] < -1e-3


@pytest.mark.slow
def test_a_box_on_uneven_ground_comes_to_rest():
    """On a slope of less than the friction it stays; dropped on bumps it settles on three points or more."""
    half = np.array([0.03, 0.02, 0.01])
    x = 0.01 * (np.arange(21) - 10)
    slope = Heightfield(np.repeat(0.3 * x[:, None], 21, axis=1), 0.01)
    tilt = Rotation.from_euler("y", -np.arctan(0.3))
    bumps = Heightfield(0.004 * np.random.default_rng(2).uniform(size=(21, 21)), 0.01)
    for ground, pose in ((slope, at(tilt.apply([0, 0, 0.01]), tilt)), (bumps, at([0, 0, 0.016]))):
        box = Object("box", Box(half), 0.6, mass=0.2, pose=pose)
        _, info = in_chunks(Scene("rough", (Surface("ground", ground, 0.6),), facets=2, objects=(box,)), 300)
        assert np.all(np.asarray(info.status) == 0)
        assert np.max(np.abs(info.object_velocity[-50:])) < 0.02
        mean = np.asarray(info.contact_force)[-50:].sum(axis=1).mean(axis=0)
        np.testing.assert_allclose(mean, [0, 0, 0.2 * GRAVITY], atol=0.05)
        if ground is slope:
            np.testing.assert_allclose(info.object_position[-1, 0], pose.position, atol=1e-5)


@pytest.fixture(scope="module")
def grids(tmp_path_factory):
    return tmp_path_factory.mktemp("grids")


@pytest.mark.slow
def test_a_mesh_lies_on_a_plane(grids):
    solid = trimesh.creation.box((0.06, 0.04, 0.05))
    shape = triangle_mesh(solid.vertices, solid.faces, spacing=0.003, cache=grids)
    thing = Object("mesh", shape, 0.5, density=1000.0, pose=at([0.01, 0.0, 0.025]))
    _, info = in_chunks(Scene("mesh", (table(),), facets=2, objects=(thing,)), 200)
    assert np.all(np.asarray(info.status) == 0)
    np.testing.assert_allclose(info.object_position[-1, 0], [0.01, 0.0, 0.025], atol=1e-6)
    np.testing.assert_allclose(carried(info), [0, 0, 0.12 * GRAVITY], atol=1e-6)


def test_a_pad_feels_a_mesh_as_the_ball_that_it_is(grids):
    """Force and normal agree to the error of the grid and the facets."""
    model, steps = sprung_tip(), 20
    ball = trimesh.creation.icosphere(4, RADIUS)
    shapes = Sphere(RADIUS), triangle_mesh(ball.vertices, ball.faces, spacing=RADIUS / 12, cache=grids)
    reference = np.tile([0.0, 0.0, 0.0], (steps, 1))
    found = []
    for shape in shapes:
        surface = Surface("ball", Placed(shape, Pose(np.eye(3), np.array([0.002, 0.0, -RADIUS]))), 0.5)
        _, info = rollout(model, Scene("ball", (surface,)), constant_targets(model, reference))
        found.append((np.asarray(info.contact_force)[-1, 0], np.asarray(info.contact_normal)[-1, 0]))
    (force, normal), (other, along) = found
    assert np.linalg.norm(force) > 0.1
    np.testing.assert_allclose(other, force, atol=0.02 * np.linalg.norm(force))
    assert np.arccos(min(1.0, normal @ along)) < 0.01


def test_an_object_that_begins_inside_the_hand_is_named():
    model = sprung_tip()
    targets = constant_targets(model, np.zeros((3, 3)))
    thing = Object("thing", Box(np.full(3, 0.05)), 0.5, mass=0.1)
    with pytest.raises(ValueError, match="object 'thing' begins 57.5 mm inside the hand, around pad .pad. of"):
        rollout(model, Scene("inside", (), objects=(thing,)), targets)
