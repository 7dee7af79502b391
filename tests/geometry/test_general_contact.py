"""Contacts of round solids, meshes and uneven ground: support functions; overlaps by hand; derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from derivatives import MODES_TOLERANCE
from meshes import RADIUS, mesh
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from touching import BOX, CAPSULE, EXACT, LYING, assert_up, at, contact, touch

from icjax.geometry import (
    Box,
    Cylinder,
    Ellipsoid,
    Heightfield,
    Placed,
    Plane,
    contact_manifold,
    manifold_size,
)
from icjax.geometry._curves import replace
from icjax.spatial import Pose, skew

CAN, ROD = Cylinder(0.3, 0.4), Cylinder(0.2, 0.5)
EGG, LONG = (Ellipsoid(np.zeros(3), np.eye(3), np.array(radii)) for radii in ((0.5, 0.3, 0.2), (0.2, 0.25, 0.6)))
PAIRS = {"can-box": (CAN, BOX), "capsule-can": (CAPSULE, CAN), "egg-can": (EGG, CAN), "eggs": (EGG, LONG)}
CROSSING = 0.0075 * 0.42  # rounded by a hundredth of the smallest half size, where edges cross: (sqrt 2 - 1) of it
SPHERE = np.random.default_rng(0).normal(size=(4000, 3))
SPHERE /= np.linalg.norm(SPHERE, axis=1, keepdims=True)


def reach(shape, directions):
    """How far a solid at the origin reaches."""
    n = np.atleast_2d(directions)
    if isinstance(shape, Box):
        return np.abs(n) @ np.asarray(shape.half_sizes)
    if isinstance(shape, Ellipsoid):
        return np.linalg.norm(n * np.asarray(shape.radii), axis=1)
    across = np.hypot(n[:, 0], n[:, 1]) if isinstance(shape, Cylinder) else np.linalg.norm(n, axis=1)
    return float(shape.half_length) * np.abs(n[:, 2]) + float(shape.radius) * across


def apart(one, two, directions):
    """How far apart along directions, towards the first."""
    n = np.atleast_2d(directions)
    R, S = one.pose.rotation, two.pose.rotation
    return n @ (one.pose.position - two.pose.position) - reach(one.shape, -n @ R) - reach(two.shape, n @ S)


def farthest_apart(one, two):
    """The distance, or the least way to part, negated: the maximum over all directions."""
    special = [sign * axis for X in (one, two) for axis in X.pose.rotation.T for sign in (1, -1)]
    tried = np.concatenate([SPHERE, special])
    found = []
    for start in tried[np.argsort(-apart(one, two, tried))[:3]]:
        across = np.linalg.svd(start[None])[2][1:]

        def loss(x, start=start, across=across):
            n = start + x @ across
            return -apart(one, two, n / np.linalg.norm(n))[0]

        simplex = [[0.0, 0.0], [0.03, 0.0], [0.0, 0.03]]
        options = {"initial_simplex": simplex, "xatol": 1e-9, "fatol": 1e-12}
        found.append(-minimize(loss, np.zeros(2), method="Nelder-Mead", options=options).fun)
    return max(found)


def near_pairs(first, second, count, seed):
    """Turned at random, moved along a random line to a gap that is wanted."""
    generator = np.random.default_rng(seed)
    turns = Rotation.random(2 * count, random_state=seed).as_matrix()
    for k in range(count):
        line, wanted = generator.normal(size=3), (0.02, 0.001, 0.0, -0.001, -0.004)[k % 5]
        one, low, high = Placed(first, Pose(turns[2 * k], np.zeros(3))), 0.0, 2.0
        for _ in range(30):
            middle = 0.5 * (low + high)
            two = Placed(second, Pose(turns[2 * k + 1], middle * line / np.linalg.norm(line)))
            low, high = (low, middle) if apart(one, two, SPHERE).max() > wanted else (middle, high)
        yield one, two


@pytest.mark.parametrize("name", PAIRS)
def test_gaps_of_convex_solids(name):
    edges = 0
    for one, two in near_pairs(*PAIRS[name], 20, 1):
        found, expected = contact(one, two), farthest_apart(one, two)
        off = np.min(found.gap[found.active]) - expected
        assert off > -1e-9  # of the minimisation
        if off > 1e-8:
            edges += 1
            assert name == "can-box"
            assert off < CROSSING
        deepest = np.argmin(found.gap)
        along = apart(one, two, found.normal[deepest])[0]
        np.testing.assert_allclose(along, expected, atol=1e-8 if off < 1e-8 else CROSSING)
    assert edges < 10


def test_a_can_stands_and_lies_on_a_box():
    """With its rim, what of it lies over the box, or the corners of the box; lying, with both ends of its side."""
    for half, position, corners in (
        ((1.0, 1.0, 0.2), (0.1, 0.2), [(0.4, 0.2), (-0.2, 0.2), (0.1, 0.5), (0.1, -0.1)]),  # all of the rim
        ((0.1, 0.15, 0.2), (0.0, 0.0), [(0.1, 0.15), (-0.1, 0.15), (-0.1, -0.15), (0.1, -0.15)]),  # a narrow box
        ((1.0, 1.0, 0.2), (0.9, 0.0), [(0.6, 0.0), (1.0, np.sqrt(0.08)), (1.0, -np.sqrt(0.08))]),  # over an edge
    ):
        below = Placed(Box(np.array(half)), at([0, 0, 0]))
        points, normals, gaps = touch(Placed(CAN, at([*position, 0.601])), below)
        np.testing.assert_allclose(normals @ [0, 0, 1], 1.0, atol=3e-5)  # leans by 0.005 where the box ends
        np.testing.assert_allclose(gaps, 0.001, atol=1e-6)
        assert 4 <= len(gaps) <= 7
        for corner in corners:  # of twelve points of the rim six are chosen; the box's edges are rounded
            assert np.min(np.linalg.norm(points[:, :2] - corner, axis=1)) < 0.16
        middle = np.mean(np.array(corners), axis=0)
        for direction in np.eye(2):
            assert np.ptp((points[:, :2] - middle) @ direction) > 0.8 * np.ptp(np.array(corners) @ direction)
    points, normals, gaps = touch(
        Placed(CAN, at([0.1, 0.0, 0.501], LYING)), Placed(Box(np.array([0.35, 1.0, 0.2])), at([0, 0, 0]))
    )
    np.testing.assert_allclose(normals @ [0, 0, 1], 1.0, atol=3e-5)
    np.testing.assert_allclose(gaps, 0.001, atol=1e-5)
    np.testing.assert_allclose(points[:, 1], 0.0, atol=0.0016)
    np.testing.assert_allclose([points[:, 0].min(), points[:, 0].max()], [-0.3, 0.35], atol=0.0021)  # rounded edge


def turned(w):
    K = skew(w)
    return jnp.eye(3) + 2.0 / (1.0 + jnp.sum(w**2)) * (K + K @ K)


PLACES = {
    "can-box": [  # rim over a face, side over a corner's edge, lying
        at([0.1, 0.05, 0.69], [0.6, 0.2, 0.1]),
        at([0.72, 0.1, 0.2], [0.1, 0.4, 0.3]),
        at([0.02, 0.3, 0.49], [1.57, 0.01, 0.2]),
    ],
    "eggs": [at([0.1, 0.2, 0.8], [0.4, 0.2, 0.3]), at([0.6, 0.1, 0.2], [1.0, 0.2, 0.3])],
}


@pytest.mark.parametrize("name", PLACES)
def test_derivatives_of_the_deepest_point(name):
    """In place, turn and the sizes of the first; finite where what touches is not unique."""
    first, second = PAIRS[name]
    kind = type(first)
    sizes = first.radii if kind is Ellipsoid else jnp.stack([first.radius, first.half_length])

    @jax.jit
    def moved(x, X):
        changed = replace(first, radii=x[6:]) if kind is Ellipsoid else Cylinder(x[6], x[7])
        return Placed(changed, Pose(turned(x[:3]) @ X.rotation, X.position + x[3:6])), Placed(second, at([0, 0, 0]))

    def numbers(found, library=jnp):
        return library.concatenate([found.point[0], found.normal[0], found.gap[:1]])

    @jax.jit
    def derivatives(x, X):
        return [mode(lambda x: numbers(contact_manifold(*moved(x, X))))(x) for mode in (jax.jacfwd, jax.jacrev)]

    x, step = np.concatenate([np.zeros(6), sizes]), 1e-5
    for X in PLACES[name]:
        forward, reverse = map(np.asarray, derivatives(x, X))
        ends = [[numbers(contact(*moved(x + e, X)), np) for e in (row, -row)] for row in step * np.eye(x.size)]
        central = np.stack([(plus - minus) / (2 * step) for plus, minus in ends], axis=1)
        size = np.abs(forward).max()
        np.testing.assert_allclose(reverse, forward, rtol=0, atol=MODES_TOLERANCE * size)
        np.testing.assert_allclose(central, forward, rtol=0, atol=1e-6 * size)  # places on curves are right to 1e-12
    for X in (at([0, 0, 0]), at([0, 0, 0.6]), at([0, 0, 0.5], LYING)):
        for found in derivatives(x, X):
            assert np.isfinite(found).all()


FLOOR = Plane(np.zeros(3), np.array([0.0, 0.0, 1.0]))
GROUND = Heightfield(np.zeros((5, 6)), 0.02)


def test_meshes_on_planes_and_boxes(grids):
    """A mesh of a box lies on another box with its corners; a ball of triangles is as high as a ball."""
    box, ball = mesh("box", grids), mesh("sphere", grids)
    table = Placed(Box(np.array([0.2, 0.2, 0.01])), at([0, 0, -0.01]))
    points, _, gaps = touch(Placed(box, at([0.1, 0.0, 0.026])), table)
    lowest = points[gaps < 0.001 + 1e-9]
    np.testing.assert_allclose(np.abs(lowest - [0.1, 0, 0]), np.tile([0.03, 0.02, 0.001], (4, 1)), atol=EXACT)
    _, normals, gaps = touch(Placed(ball, at([0.0, 0.0, RADIUS + 0.001], [0.3, 0.4, 0.5])), FLOOR)
    np.testing.assert_allclose(gaps.min(), 0.001, atol=4e-3 * RADIUS)  # the triangles' vertices are 1.5 mm apart
    np.testing.assert_allclose(normals, np.tile([0.0, 0.0, 1.0], (len(gaps), 1)), atol=EXACT)


def test_an_egg_on_a_slope():
    """As high above uneven ground that is a plane as its support says; with its lowest point."""
    R = Rotation.from_rotvec([0.4, 0.5, 0.3]).as_matrix()
    radii = np.array([0.02, 0.012, 0.008])
    slope = Heightfield(0.02 * 0.3 * np.arange(-2.0, 3.0)[:, None] * np.ones(6), 0.02)
    up = np.array([-0.3, 0.0, 1.0]) / np.hypot(0.3, 1.0)
    for wanted in (0.001, -0.0005):
        far = np.linalg.norm(radii * (R.T @ up)) + wanted
        egg = Placed(Ellipsoid(np.zeros(3), np.eye(3), radii), Pose(R, far * up))
        found = contact(egg, Placed(slope, at([0, 0, 0])))
        deepest = np.argmin(found.gap)
        lowest = far * up - R @ (radii**2 * (R.T @ up)) / np.linalg.norm(radii * (R.T @ up))
        np.testing.assert_allclose(found.gap[deepest], wanted, atol=EXACT)
        np.testing.assert_allclose(found.normal[deepest], up, atol=EXACT)
        np.testing.assert_allclose(found.point[deepest], lowest, atol=1e-9)


def test_boxes_on_uneven_ground():
    """On level ground with all corners; on a single peak under its middle with that."""
    brick = Box(np.array([0.03, 0.02, 0.01]))
    points, normals, gaps = touch(Placed(brick, at([0.001, 0.002, 0.011])), GROUND)
    assert_up(normals, gaps, 0.001, len(gaps))
    assert np.ptp(points[:, 0]) == pytest.approx(0.06)
    assert np.ptp(points[:, 1]) == pytest.approx(0.04)
    peak = Heightfield(GROUND.heights.at[2, 3].set(0.004), 0.02)
    points, normals, gaps = touch(Placed(brick, at([0.0, 0.01, 0.0135])), peak)
    np.testing.assert_allclose(gaps.min(), -5e-4, atol=EXACT)
    np.testing.assert_allclose(points[np.argmin(gaps)], [0.0, 0.01, 0.0035], atol=EXACT)
    np.testing.assert_allclose(normals[np.argmin(gaps)], [0, 0, 1], atol=EXACT)


def test_sizes():
    assert manifold_size(EGG, LONG) == 1
    assert manifold_size(CAN, BOX) == manifold_size(BOX, CAN) == manifold_size(GROUND, BOX) == 7
    assert manifold_size(FLOOR, GROUND) == manifold_size(GROUND, GROUND) == 0
