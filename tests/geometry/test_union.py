"""Solids of several parts: distances, mass, contact; parts that make up another solid are that solid."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from icjax.geometry import Box, Capsule, Cylinder, Placed, Plane, Sphere, Union, contact_manifold, manifold_size
from icjax.spatial import Pose

TURN = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()


def at(position, rotation=None):
    return Pose(np.eye(3) if rotation is None else rotation, np.asarray(position, float))


BRICK = Box(np.array([0.4, 0.2, 0.1]))
HALVES = Union([Placed(Box(np.array([0.2, 0.2, 0.1])), at([side * 0.2, 0.0, 0.0])) for side in (-1, 1)])
BULB = Union([Sphere(0.3), Placed(Cylinder(0.15, 0.1), at([0.0, 0.0, -0.35]))])
FLOOR = Plane(np.array([0.0, 0.0, -0.5]), np.array([0.0, 0.0, 1.0]))


@jax.jit
@jax.vmap
def looked_at(p):
    """Distance, gradient and normal of the bulb; distance and normal of its parts; distances of brick and halves."""
    ball, cap = BULB.parts
    distance, gradient = jax.value_and_grad(BULB.signed_distance)(p)
    parts = jnp.stack([ball.signed_distance(p), cap.signed_distance(p)]), jnp.stack([ball.normal(p), cap.normal(p)])
    return distance, gradient, BULB.normal(p), *parts, BRICK.signed_distance(p), HALVES.signed_distance(p)


def test_distance_and_normal_are_those_of_the_nearest_part():
    """Exact outside also where two parts make up one solid; finite in the middle of a part."""
    points = np.concatenate([np.random.default_rng(0).uniform(-1.0, 1.0, (200, 3)), np.zeros((1, 3))])
    distance, gradient, normal, distances, normals, brick, halves = (np.asarray(x) for x in looked_at(points))
    np.testing.assert_array_equal(distance, distances.min(axis=1))
    np.testing.assert_array_equal(normal, normals[np.arange(201), distances.argmin(axis=1)])
    np.testing.assert_allclose(gradient[:-1], normal[:-1], atol=1e-12)
    assert np.isfinite(gradient).all()
    outside = brick > 0.0
    assert outside.sum() > 100
    np.testing.assert_allclose(halves[outside], brick[outside], atol=1e-15)
    assert np.all(halves[~outside] >= brick[~outside])


@jax.jit
def of_the_whole(pose, bulb, floor, ball, halves, brick):
    """Manifolds of the bulb with a floor, both ways round, and with a ball; masses of halves and brick."""
    placed, below = Placed(bulb, pose), Placed(floor, pose)
    manifolds = contact_manifold(placed, below), contact_manifold(below, placed), contact_manifold(ball, bulb)
    return manifolds, [Placed(shape, pose).mass_properties() for shape in (halves, brick)]


@pytest.fixture(scope="module")
def found():
    ball = Placed(Sphere(0.1), at([0.0, 0.0, 0.5]))
    return of_the_whole(at([0.3, -0.2, 0.4], TURN), BULB, FLOOR, ball, HALVES, BRICK)


def test_a_brick_of_two_halves_has_the_mass_of_a_brick(found):
    for one, other in zip(*found[1], strict=True):
        np.testing.assert_allclose(one, other, atol=1e-15)


def test_contact_is_that_of_every_part(found):
    """On a floor and under a ball, both ways round, in any frame."""
    assert manifold_size(BULB, FLOOR) == 1 + 6
    on_floor, swapped, on_ball = found[0]
    np.testing.assert_allclose(on_floor.gap, [0.2, *([0.05] * 3), *([0.25] * 3)], atol=1e-15)
    local = (np.asarray(on_floor.point) - np.array([0.3, -0.2, 0.4])) @ TURN
    np.testing.assert_allclose(local[0], [0.0, 0.0, -0.3], atol=1e-15)
    np.testing.assert_allclose(np.hypot(local[1:, 0], local[1:, 1]), 0.15, atol=1e-15)
    np.testing.assert_allclose(swapped.gap, on_floor.gap, atol=1e-15)
    np.testing.assert_allclose(swapped.normal, -on_floor.normal, atol=1e-15)
    np.testing.assert_allclose(on_ball.gap, [0.1, 0.5 + 0.25 - 0.1], atol=1e-15)
    assert bool(on_floor.active.all())


def test_what_is_not_implemented_for_a_part_is_not_for_the_whole():
    floor = Plane(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    both = Union([Sphere(0.1), floor])
    assert manifold_size(both, floor) == manifold_size(floor, both) == 0  # neither plane can move
    assert manifold_size(BULB, BRICK) == manifold_size(BRICK, BULB) == 1 + 7
    assert manifold_size(BULB, Sphere(0.1)) == 2
    assert manifold_size(BRICK, Union([Sphere(0.1), Capsule(0.1, 0.2)])) == 1 + 2
    with pytest.raises(ValueError, match="Plane with a Plane"):
        contact_manifold(both, floor)


def test_bad_parts():
    with pytest.raises(ValueError, match="parts is empty"):
        Union([])
    with pytest.raises(Exception, match="parts"):  # by the type checker of the tests, else by the shape itself
        Union([Sphere(0.1), "ball"])  # pyright: ignore[reportArgumentType]
