"""Contacts of boxes and prisms, balls and planes: Minkowski differences; overlaps by hand; symmetry; rounding."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import ConvexHull, HalfspaceIntersection
from scipy.spatial.transform import Rotation
from touching import (
    BAR,
    BOX,
    CAPSULE,
    EXACT,
    KNIFE,
    LYING,
    PRISM,
    assert_up,
    at,
    contact,
    corners,
    distance,
    minkowski,
    polytope,
    random_pairs,
    touch,
)

from icjax.geometry import (
    Box,
    Cylinder,
    Ellipsoid,
    Placed,
    Plane,
    Prism,
    Sphere,
    contact_manifold,
    manifold_size,
    wedge,
)
from icjax.spatial import Pose

FLAT = 0.02  # rad; edges whose normal is so close to a face's count as faces


def assert_sound(first, second, found):
    """Finite; active points on both surfaces."""
    for part in (found.point, found.normal, found.gap):
        assert np.isfinite(part).all()
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1.0, atol=EXACT)
    away = distance(first, found.point), distance(second, found.point - found.gap[:, None] * found.normal)
    np.testing.assert_allclose(np.where(found.active, away, 0.0), 0.0, atol=EXACT)


def along(placed):
    """Normals of the faces."""
    return np.asarray(polytope(placed.shape).normals) @ placed.pose.rotation.T


@pytest.mark.parametrize(("first", "second"), [(BOX, BAR), (KNIFE, PRISM)], ids=["boxes", "prisms"])
def test_polytopes_against_their_minkowski_difference(first, second):
    """Overlap is the distance of the origin from the surface of the difference; apart, from the difference."""
    count = 70
    overlapping = apart = flat = 0
    for one, two in random_pairs(first, second, count, 1, 1.3):
        found = contact(one, two)
        assert_sound(one, two, found)
        normals, offsets, away = minkowski(corners(one), corners(two))
        axis, least = normals[np.argmax(offsets)], np.max(offsets)
        gaps = found.gap[found.active]
        if least > 0.0 and away > least * (1.0 + 1e-9):  # closest at corners, or at a corner and an edge
            assert (gaps > away).all()
            continue
        faces = np.concatenate([along(one), -along(two)])
        angle = np.arccos(min(1.0, np.max(faces @ axis)))
        counts_as_flat = 1e-7 < angle < FLAT
        overlapping, apart, flat = overlapping + (least < 0), apart + (least > 0), flat + counts_as_flat
        # the crossing of the edges is then seen along a normal that is off by the angle
        tolerance = 1.01 * FLAT**2 / 2 * abs(least) if counts_as_flat else EXACT
        np.testing.assert_allclose(np.min(gaps), least, rtol=0, atol=tolerance)
    assert overlapping > 12
    assert apart > 12
    assert flat < count / 10


def test_exchange_and_common_motion():
    """The second solid as the first: points on the other surface, opposite normals, the same gaps."""
    common = at([0.3, -2.0, 1.0], [0.4, 1.0, -0.7])
    for one, two in random_pairs(BOX, BAR, 60, 3, 0.8):
        found, exchanged, moved = touch(one, two), touch(two, one), touch(Placed(one, common), Placed(two, common))
        order, other, again = (np.argsort(each[2]) for each in (found, exchanged, moved))
        point, normal, gap = (part[order] for part in found)
        np.testing.assert_allclose(exchanged[2][other], gap, atol=EXACT)
        np.testing.assert_allclose(exchanged[1][other], -normal, atol=EXACT)
        nearly_parallel = 1e-10  # edges, whose crossing is less certain
        np.testing.assert_allclose(exchanged[0][other], point - gap[:, None] * normal, atol=nearly_parallel)
        np.testing.assert_allclose(moved[2][again], gap, atol=EXACT)
        np.testing.assert_allclose(moved[1][again], normal @ common.rotation.T, atol=EXACT)
        np.testing.assert_allclose(moved[0][again], point @ common.rotation.T + common.position, atol=nearly_parallel)


def area(points):
    return ConvexHull(points[:, :2]).volume


UPPER, LOWER = Box(np.array([0.02, 0.2, 0.01])), Box(np.array([0.2, 0.03, 0.01]))


@pytest.mark.parametrize("gap", [0.0, 1e-4, -1e-4])
def test_boxes_on_boxes_touch_with_the_corners_of_their_overlap(gap):
    for lower, position, x, y in [
        (LOWER, (0.0, 0.0), (-0.02, 0.02), (-0.03, 0.03)),  # crossed bars
        (LOWER, (0.19, 0.1), (0.17, 0.2), (-0.03, 0.03)),  # hanging over an edge
        (Box(np.array([0.005, 0.1, 0.01])), (0.0, 0.0), (-0.005, 0.005), (-0.1, 0.1)),  # on a smaller one
        (Box(np.array([0.3, 0.3, 0.01])), (0.1, 0.1), (0.08, 0.12), (-0.1, 0.3)),  # on a larger one
        (UPPER, (0.0, 0.0), (-0.02, 0.02), (-0.2, 0.2)),  # on one like it, edge on edge
        (UPPER, (0.0, 0.1), (-0.02, 0.02), (-0.1, 0.2)),
    ]:
        above = Placed(UPPER, at([*position, 0.02 + gap]))
        rectangle = np.array([(x[i], y[j], 0.01) for j in (0, 1) for i in (0, 1)])
        points, normals, gaps = touch(above, Placed(lower, at([0, 0, 0])))
        assert_up(normals, gaps, gap, 4)
        np.testing.assert_allclose(points, rectangle + [0.0, 0.0, gap], atol=EXACT)
        points, normals, gaps = touch(Placed(lower, at([0, 0, 0])), above)
        assert_up(-normals, gaps, gap, 4)
        np.testing.assert_allclose(points, rectangle, atol=EXACT)


def test_other_overlaps():
    """Squares turned by 45 degrees make an octagon; a triangle lies on a pentagon with three corners, or overhangs."""
    square = Box(np.array([0.1, 0.1, 0.1]))
    points, normals, gaps = touch(Placed(square, at([0, 0, 0.2], [0, 0, np.pi / 4])), Placed(square, at([0, 0, 0])))
    assert_up(normals, gaps, 0.0, 8)
    np.testing.assert_allclose(area(points), 0.08 * (np.sqrt(2) - 1), rtol=1e-9)
    small = Prism(0.5 * KNIFE.outline, 0.4)
    for position, count in (((-0.1, 0.1), 3), ((-0.45, -0.15), 4), ((-0.22, 0.46), 5)):
        points, normals, gaps = touch(Placed(small, at([*position, 0.75])), Placed(PRISM, at([0, 0, 0])))
        assert_up(normals, gaps, 0.0, count)
        sides = [ConvexHull(outline).equations for outline in (small.outline + jnp.asarray([position]), PRISM.outline)]
        overlap = HalfspaceIntersection(np.concatenate(sides), np.mean(points[:, :2], axis=0)).intersections
        np.testing.assert_allclose(area(points), area(overlap), rtol=1e-9)


def test_no_corner_is_lost_to_rounding():
    """Boxes whose edges lie on each other, but for turns and shifts of any size down to rounding."""
    generator = np.random.default_rng(5)
    turns = Rotation.random(1500, random_state=6).as_matrix()
    for turn in turns:
        above, below = generator.choice([0.1, 0.2, 0.3], size=(2, 3))
        shift = generator.choice([0.0, 0.05, 0.1, -0.1, 0.2], size=2)
        low = np.maximum(-below[:2], shift - above[:2])
        size = np.minimum(below[:2], shift + above[:2]) - low
        if np.min(size) < 1e-3:
            continue
        little = 10.0 ** generator.uniform(-18, -5)
        base, off = Pose(turn, generator.normal(size=3)), little * generator.normal(size=(2, 3))
        upper = base @ at(np.array([*shift, above[2] + below[2]]) + off[0], off[1])
        found = contact(Placed(Box(above), upper), Placed(Box(below), base))
        points = (found.point - base.position) @ base.rotation
        np.testing.assert_allclose(area(points[found.active]), np.prod(size), rtol=1e-3, err_msg=f"{little}")
        assert np.max(np.abs(found.gap[found.active])) < 10 * little + EXACT


def test_crossed_edges_touch_at_one_point():
    """Square bars that stand on edge; and with little tilt it is faces that touch."""
    bar = Box(np.array([0.3, 0.05, 0.05]))
    quarter, half = Rotation.from_rotvec([np.pi / 4, 0, 0]), np.sqrt(2) * 0.05
    across = Rotation.from_rotvec([0, 0, np.pi / 3])
    upper = Placed(bar, Pose((across * quarter).as_matrix(), np.array([0.1, 0.0, 2 * half + 0.01])))
    points, normals, gaps = touch(upper, Placed(bar, Pose(quarter.as_matrix(), np.zeros(3))))
    assert_up(normals, gaps, 0.01, 1)
    np.testing.assert_allclose(points, [[0.1, 0.0, half + 0.01]], atol=EXACT)
    across = Rotation.from_rotvec([0, 0, np.pi / 2])
    for tilt, count in ((0.01, 4), (0.05, 1)):  # about the diagonal: a crossing of edges is lowest
        tilted = Placed(
            bar, Pose((Rotation.from_rotvec([tilt, tilt, 0.0]) * across).as_matrix(), np.array([0, 0, 0.1]))
        )
        assert len(touch(tilted, Placed(bar, at([0, 0, 0])))[2]) == count


def test_bars_that_pass_each_other_do_not_touch():
    assert len(touch(Placed(UPPER, at([0.3, 0.0, 0.1])), Placed(LOWER, at([0, 0, 0])))[2]) == 0


def test_balls_touch_anything():
    ball, can = Placed(Sphere(0.1), at([0.5, 0.2, 0.7])), Cylinder(0.2, 0.3)
    points, normals, gaps = touch(ball, can)
    np.testing.assert_allclose(gaps, [can.signed_distance(ball.pose.position) - 0.1], atol=EXACT)
    np.testing.assert_allclose(normals, [can.normal(ball.pose.position)], atol=EXACT)
    np.testing.assert_allclose(points, ball.pose.position - 0.1 * normals, atol=EXACT)
    exchanged = touch(can, ball)
    np.testing.assert_allclose(exchanged[0], points - gaps[:, None] * normals, atol=EXACT)
    np.testing.assert_allclose(exchanged[1], -normals, atol=EXACT)
    egg = Ellipsoid(np.zeros(3), np.eye(3), np.array([0.3, 0.2, 0.1]))
    for solid in (ball, CAPSULE, BOX, KNIFE, egg, Plane(np.zeros(3), np.ones(3))):
        assert manifold_size(solid, ball) == manifold_size(ball, solid) == 1


def test_anything_touches_planes():
    floor = Plane(np.zeros(3), np.array([0.0, 0.0, 2.0]))
    can = Placed(Placed(Cylinder(0.2, 0.3), at([0.0, 0.0, 1.0])), at([0.0, 0.0, 0.5], LYING))  # at (1, 0, 0.5)
    points, normals, gaps = touch(can, floor)
    np.testing.assert_allclose(np.sort(gaps)[:2], 0.3, atol=EXACT)
    np.testing.assert_allclose(points[:, 2], gaps, atol=EXACT)
    np.testing.assert_allclose(normals, np.tile([0.0, 0.0, 1.0], (6, 1)), atol=EXACT)
    on_floor, down, _ = touch(floor, can)
    np.testing.assert_allclose(on_floor[:, 2], 0.0, atol=EXACT)
    np.testing.assert_allclose(down, -normals, atol=EXACT)
    egg = Ellipsoid(np.zeros(3), np.eye(3), np.array([0.3, 0.2, 0.1]))
    for solid, count in ((can, 6), (CAPSULE, 2), (BOX, 8), (KNIFE, 6), (egg, 1)):
        assert manifold_size(solid, floor) == manifold_size(floor, solid) == count


def test_sizes_and_what_is_not_implemented():
    assert manifold_size(BOX, wedge(0.8, 0.6, 1.0, 0.2)) == 8
    assert manifold_size(KNIFE, PRISM) == 9
    assert manifold_size(Placed(BOX, at([0.0, 0.0, 1.0])), CAPSULE) == 2
    plane = Plane(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    assert manifold_size(plane, plane) == 0
    with pytest.raises(ValueError, match="Plane with a Plane"):
        contact_manifold(plane, Placed(plane, at([0.0, 0.0, 1.0])))
