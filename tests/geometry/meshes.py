"""Meshes for tests, each put on its grid once."""

from functools import cache

import numpy as np
import trimesh

from icjax.geometry import triangle_mesh

RADIUS = 0.03


def lumps(subdivisions=3):
    """A ball with dents and lumps, as star-shaped as a potato."""
    ball = trimesh.creation.icosphere(subdivisions)
    x, y, z = ball.vertices.T
    radius = RADIUS * (1.0 + 0.15 * np.sin(3 * x + 1) * np.cos(4 * y) + 0.1 * np.sin(5 * z))
    return trimesh.Trimesh(ball.vertices * radius[:, None], ball.faces, process=False)


SOURCES = {
    "sphere": lambda: trimesh.creation.icosphere(4, RADIUS),
    "box": lambda: trimesh.creation.box((0.06, 0.04, 0.05)),
    "lumps": lumps,
    "ring": lambda: trimesh.creation.torus(0.03, 0.01, 48, 24),
}


@cache
def source(name):
    return SOURCES[name]()


@cache
def mesh(name, folder):
    """With a coarse grid, kept in the folder of the tests."""
    found = source(name)
    spacing = float(np.ptp(found.vertices, axis=0).max()) / 32
    return triangle_mesh(found.vertices, found.faces, spacing=spacing, cache=folder)
