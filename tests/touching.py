"""Solids of order one and their contacts, compiled once a pair of kinds, in NumPy."""

import jax
import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from trimesh import Trimesh
from trimesh.proximity import closest_point_naive

from icjax.geometry import Box, Capsule, Placed, Prism, contact_manifold
from icjax.spatial import Pose

EXACT = 1e-12  # rounding, of sizes of order one
BOX, BAR = Box(np.array([0.3, 0.5, 0.2])), Box(np.array([1.5, 0.05, 0.06]))
PRISM = Prism(np.array([(-0.5, -0.3), (0.6, -0.4), (0.7, 0.2), (0.2, 0.5), (-0.1, 0.5)]), 0.35)
KNIFE = Prism(np.array([(0.0, 0.0), (1.0, 0.0), (0.3, 0.2)]), 0.4)
CAPSULE = Capsule(0.1, 0.4)
LYING = (0.0, np.pi / 2, 0.0)

compiled = jax.jit(contact_manifold)
polytope = jax.jit(lambda solid: solid.polytope())
distance = jax.jit(lambda solid, p: jax.vmap(solid.signed_distance)(p))


def contact(first, second):
    return jax.tree.map(np.asarray, compiled(first, second))


def at(position, turned=(0.0, 0.0, 0.0)):
    return Pose(Rotation.from_rotvec(turned).as_matrix(), np.asarray(position, float))


def touch(first, second):
    """Active points, their normals and gaps, by place."""
    found = contact(first, second)
    points, normals, gaps = (part[found.active] for part in (found.point, found.normal, found.gap))
    order = np.lexsort(np.round(points, 9).T)
    return points[order], normals[order], gaps[order]


def random_pairs(first, second, count, seed, far):
    generator = np.random.default_rng(seed)
    turns = Rotation.random(2 * count, random_state=seed).as_matrix()
    for k in range(count):
        near, off = generator.normal(size=(2, 3)) * [[0.1], [generator.uniform(0.0, far)]]
        yield Placed(first, Pose(turns[2 * k], near)), Placed(second, Pose(turns[2 * k + 1], off))


def corners(placed):
    return np.asarray(polytope(placed.shape).vertices) @ placed.pose.rotation.T + placed.pose.position


def minkowski(vertices, others):
    """Of the differences: outward normals and offsets of the hull's faces, and its distance from the origin."""
    differences = (vertices[:, None] - others[None]).reshape(-1, 3)
    hull = ConvexHull(differences)
    away = closest_point_naive(Trimesh(differences, hull.simplices, process=False), np.zeros((1, 3)))[1][0]
    return hull.equations[:, :3], hull.equations[:, 3], away


def assert_up(normals, gaps, gap, count):
    assert len(gaps) == count
    np.testing.assert_allclose(normals, np.tile([0.0, 0.0, 1.0], (count, 1)), atol=EXACT)
    np.testing.assert_allclose(gaps, gap, atol=EXACT)
