"""Solids for pictures are those of the scene: every vertex lies on the surface, and nothing is missing."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from trimesh import creation

from icjax.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Heightfield,
    Placed,
    Prism,
    Sphere,
    Union,
    triangle_mesh,
    wedge,
)
from icjax.spatial import Pose
from icjax.synthesis import Scene, Surface
from icjax.view._solids import outlines, section, silhouette, solid
from icjax.view._surfaces import Bump, profile, scene_surfaces

TURN = Rotation.from_rotvec([0.4, -0.7, 0.9])
PLACE = np.array([0.1, -0.2, 0.3])
SHAPES = {
    "box": Box(np.array([0.01, 0.02, 0.03])),
    "sphere": Sphere(0.02),
    "capsule": Capsule(0.01, 0.03),
    "cylinder": Cylinder(0.02, 0.03),
    "wedge": wedge(0.03, 0.04, 0.02, 0.2),
    "prism": Prism(np.array([[0.0, 0.0], [0.03, 0.0], [0.02, 0.02], [0.0, 0.01]]), 0.01),
}


def described(shape) -> dict:
    return json.loads(Scene("one", (Surface("thing", shape, 0.5),)).describe())["surfaces"][0]


def distances(shape, points) -> np.ndarray:
    return np.asarray(jax.jit(jax.vmap(shape.signed_distance))(jnp.asarray(points)))


def volume_of(found) -> float:
    corners = found.vertices[found.faces]
    return float(np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0)


@pytest.mark.parametrize("kind", SHAPES)
def test_solids_are_those_of_the_scene(kind):
    placed = Placed(SHAPES[kind], Pose(TURN.as_matrix(), PLACE))
    (found,) = scene_surfaces(Scene("one", (Surface("thing", placed, 0.5),)).describe())
    assert (found.name, found.friction) == ("thing", 0.5)
    np.testing.assert_allclose(distances(placed, found.vertices), 0.0, rtol=0, atol=1e-9)
    # Positive only where faces point outwards; polygons inscribed in round shapes lose up to 3 %.
    volume = float(placed.mass_properties().volume)
    assert (1.0 - 1e-9 if found.flat and kind != "cylinder" else 0.97) * volume < volume_of(found) < volume * (1 + 1e-9)
    # The lines are 0.3 % outside, the middles of edges between vertices of a round one a little inside.
    assert np.all(np.abs(distances(placed, found.lines.mean(axis=1))) < 4e-4)
    assert len(found.lines) >= 9


def test_an_ellipsoid_is_a_solid_where_its_centre_is():
    shape = Ellipsoid(PLACE, TURN.as_matrix(), np.array([0.01, 0.02, 0.03]))
    found = solid(described(shape), "egg")
    scaled = (found.vertices - PLACE) @ TURN.as_matrix() / np.array([0.01, 0.02, 0.03])
    np.testing.assert_allclose(np.linalg.norm(scaled, axis=1), 1.0, rtol=1e-12)
    (surface,) = scene_surfaces(Scene("one", (Surface("egg", shape, 0.5),)).describe())
    assert isinstance(surface, Bump)  # as pages always drew it


def test_what_is_no_solid_is_not_drawn():
    assert solid({"shape": "torus", "radius": 1.0}, "ring") is None
    assert solid({}, "nothing") is None
    assert scene_surfaces('{"surfaces": [{"name": "ring", "shape": "torus"}]}') == ()


def test_a_union_is_drawn_as_its_parts():
    pose, low = Pose(TURN.as_matrix(), PLACE), Pose(np.eye(3), np.array([0.0, 0.0, -0.03]))
    parts = [Placed(SHAPES["sphere"], pose), Placed(SHAPES["cylinder"], pose @ low)]
    union = Placed(Union([SHAPES["sphere"], Placed(SHAPES["cylinder"], low)]), pose)
    found = scene_surfaces(Scene("one", (Surface("bulb", union, 0.5),)).describe())
    assert [(item.name, item.friction) for item in found] == [("bulb", 0.5)] * 2
    for item, part in zip(found, parts, strict=True):
        np.testing.assert_allclose(distances(part, item.vertices), 0.0, rtol=0, atol=1e-9)


def test_a_cut_through_a_ring_is_two_rings(tmp_path):
    """A mesh need not be convex: along the axis a torus shows both sides of its tube, across it both rims."""
    ring = creation.torus(0.03, 0.01, 48, 24)
    shape = triangle_mesh(ring.vertices, ring.faces, spacing=0.005, cache=tmp_path)
    (found,) = scene_surfaces(Scene("one", (Surface("ring", Placed(shape, Pose(np.eye(3), PLACE)), 0.5),)).describe())
    np.testing.assert_allclose(volume_of(found), ring.volume, rtol=0.01)  # fewer triangles are drawn
    for up, areas in ((np.eye(3)[2], [np.pi * 0.01**2] * 2), (np.eye(3)[1], [np.pi * 0.02**2, np.pi * 0.04**2])):
        cuts = outlines(found, PLACE + [0.0, 1e-4, 1e-4], np.eye(3)[0], up)
        flat = [np.stack([cut @ np.eye(3)[0], cut @ up], axis=1) for cut in cuts]
        np.testing.assert_allclose(sorted(area(cut) for cut in flat), areas, rtol=0.03)


def test_ground_is_drawn_as_high_as_it_is():
    heights = np.outer(np.linspace(0.0, 0.03, 4), np.ones(3))
    ground = Placed(Heightfield(heights, 0.01), Pose(np.eye(3), np.array([0.0, 0.0, 0.1])))
    (found,) = scene_surfaces(Scene("one", (Surface("ground", ground, 0.5),)).describe())
    assert found.ground
    np.testing.assert_allclose(distances(ground, found.vertices), 0.0, atol=1e-15)
    reach = np.array([-0.02, -0.01, 0.0, 0.012, 0.016])
    height = profile((found,), np.zeros(3), np.eye(3)[0], np.eye(3)[2], reach)
    np.testing.assert_allclose(height, [np.nan, 0.105, 0.115, 0.127, np.nan], atol=1e-12)


def area(points) -> float:
    return float(ConvexHull(points).volume)


def test_a_cut_through_a_sphere_is_a_circle():
    """Of the area pi (r^2 - d^2), within the 1.5 % that the polyhedron loses; none beyond the sphere."""
    ball = solid(described(Placed(Sphere(0.02), Pose(np.eye(3), PLACE))), "ball")
    along, up = np.eye(3)[0], np.eye(3)[2]
    for off in (0.0, 0.005, -0.015):
        outline = section(ball, PLACE + np.array([0.3, off, 0.1]), along, up)
        np.testing.assert_allclose(outline[:, 1], PLACE[1] + off, rtol=0, atol=1e-15)
        expected = np.pi * (0.02**2 - off**2)
        assert 0.985 * expected < area(outline[:, [0, 2]]) <= expected
    assert section(ball, PLACE + np.array([0.0, 0.021, 0.0]), along, up) is None


def test_a_cut_along_a_face_is_the_face_or_nothing():
    """The plane that touches a box along a face: either is right, a broken outline is not."""
    box = solid(described(Placed(Box(np.array([0.01, 0.02, 0.03])), Pose(np.eye(3), np.zeros(3)))), "box")
    for side in (-1.0, 1.0):
        outline = section(box, np.array([0.0, side * 0.02, 0.0]), np.eye(3)[0], np.eye(3)[2])
        assert outline is None or area(outline[:, [0, 2]]) == pytest.approx(4 * 0.01 * 0.03)


def test_a_silhouette_is_the_shadow():
    """Of a cube along its diagonal: a hexagon of the area sqrt(3) a^2."""
    cube = solid(described(Placed(Box(np.full(3, 0.5)), Pose(np.eye(3), np.zeros(3)))), "cube")
    first = np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    second = np.array([1.0, 1.0, -2.0]) / np.sqrt(6)
    outline = silhouette(np.stack([cube.vertices @ first, cube.vertices @ second], axis=1))
    np.testing.assert_array_equal(outline[0], outline[-1])
    assert len(outline) == 7
    assert area(outline) == pytest.approx(np.sqrt(3))
