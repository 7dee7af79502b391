"""Contacts of capsules against least squares and Minkowski differences; both ends of what lies."""

import numpy as np
from scipy.optimize import lsq_linear
from touching import (
    BOX,
    CAPSULE,
    EXACT,
    LYING,
    assert_up,
    at,
    contact,
    corners,
    distance,
    minkowski,
    random_pairs,
    touch,
)

from icjax.geometry import Box, Capsule, Placed


def test_capsules_touch_with_both_ends_of_what_lies():
    rod = Capsule(0.01, 0.1)
    for lower, x, z in [
        (Placed(Box(np.array([0.3, 0.03, 0.02])), at([0, 0, 0])), (-0.06, 0.14), 0.02),  # all of it
        (Placed(Box(np.array([0.05, 0.03, 0.02])), at([0, 0, 0])), (-0.05, 0.05), 0.02),  # over both edges
        (Placed(Box(np.array([0.1, 0.03, 0.02])), at([0, 0, 0])), (-0.06, 0.1), 0.02),  # over one
        (Placed(rod, at([0.0, 0.0, 0.0], LYING)), (-0.06, 0.1), 0.01),  # on one like it
    ]:
        above = Placed(rod, at([0.04, 0.0, z + 0.011], LYING))
        points, normals, gaps = touch(above, lower)
        assert_up(normals, gaps, 0.001, 2)
        np.testing.assert_allclose(points, [(x[0], 0.0, z + 0.001), (x[1], 0.0, z + 0.001)], atol=EXACT)
    beside = Placed(rod, at([0.0, 0.06, 0.06], LYING))  # along an edge
    points, normals, gaps = touch(beside, Placed(Box(np.array([0.3, 0.05, 0.05])), at([0, 0, 0])))
    np.testing.assert_allclose(gaps, np.sqrt(2) * 0.01 - 0.01, atol=EXACT)
    np.testing.assert_allclose(np.sort(points[:, 0]), [-0.1, 0.1], atol=EXACT)


def axis(placed):
    return placed.pose.position, placed.pose.rotation[:, 2], float(placed.shape.half_length)


def test_capsules_are_as_far_apart_as_their_axes():
    """By least squares with bounds; the second point is of a ball inside."""
    for one, two in random_pairs(CAPSULE, Capsule(0.2, 0.5), 80, 7, 1.5):
        (p, u, h), (q, v, k) = axis(one), axis(two)
        nearest = lsq_linear(np.stack([u, -v], axis=1), q - p, ([-h, -k], [h, k]), method="bvls", tol=1e-14)
        found = contact(one, two)
        expected = np.linalg.norm(nearest.fun) - 0.3
        np.testing.assert_allclose(np.min(found.gap), expected, atol=1e-9)  # a root of least squares
        other = found.point - found.gap[:, None] * found.normal
        np.testing.assert_allclose(np.where(found.active, distance(two, other), 0.0), 0.0, atol=EXACT)
        assert np.max(distance(one, found.point)) < EXACT


def test_capsules_are_as_far_from_boxes_as_their_axes():
    compared = 0
    for one, two in random_pairs(CAPSULE, BOX, 80, 8, 1.0):
        p, u, h = axis(one)
        _, offsets, away = minkowski(np.stack([p - h * u, p + h * u]), corners(two))
        found = contact(one, two)
        if np.max(offsets) > 0.0:  # the axis is outside
            compared += 1
            np.testing.assert_allclose(np.min(found.gap), away - 0.1, atol=EXACT)
        else:
            assert np.min(found.gap) < -0.1 + EXACT
    assert 20 < compared < 75
