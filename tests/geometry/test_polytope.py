"""Corners, faces and edges of boxes and prisms fit together, and are those of the solid."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from icjax.geometry import Box, Prism
from icjax.spatial import Pose

SOLIDS = {
    "box": Box(np.array([0.3, 0.5, 0.2])),
    "triangle": Prism(np.array([(0.0, 0.0), (1.0, 0.0), (0.3, 0.2)]), 0.4),
    "pentagon": Prism(np.array([(-0.5, -0.3), (0.6, -0.4), (0.7, 0.2), (0.2, 0.5), (-0.1, 0.5)]), 0.35),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_a_polytope_is_its_solid(name):
    solid = SOLIDS[name]
    pose = Pose(Rotation.from_rotvec([0.4, -1.0, 0.3]).as_matrix(), jnp.array([0.1, 0.2, -0.3]))
    body = jax.jit(lambda solid, pose: solid.polytope().moved(pose))(solid, pose)
    vertices, normals, (faces, edges, sides) = np.asarray(body.vertices), np.asarray(body.normals), body.topology
    assert len(vertices) - len(edges) + len(faces) == 2
    hull = ConvexHull(vertices)
    assert len(hull.vertices) == len(vertices)
    np.testing.assert_allclose(hull.volume, jax.jit(type(solid).mass_properties)(solid).volume, rtol=1e-12)
    for normal, loop in zip(normals, faces, strict=True):
        height = vertices @ normal
        np.testing.assert_allclose(height[loop], np.max(height), atol=1e-12)
        assert len(set(loop)) == np.sum(height > np.max(height) - 1e-9)
        p, q, r = (vertices[loop[k]] for k in range(3))
        assert np.cross(q - p, r - q) @ normal > 0  # counter-clockwise
    for (start, end), (left, right) in zip(edges, sides, strict=True):
        assert {start, end} <= set(faces[left]) & set(faces[right])
        along = vertices[end] - vertices[start]
        np.testing.assert_allclose(
            np.cross(normals[left], normals[right]) @ along,
            np.linalg.norm(np.cross(normals[left], normals[right])) * np.linalg.norm(along),
            rtol=1e-12,
        )
