"""Fewer points and triangles that stand for a mesh: where it may touch, and what it looks like."""

import numpy as np
from scipy.spatial import ConvexHull

from icjax.typing import Float, Int

MOST_POINTS = 1024, 512
"""Of the convex hull, and of the rest of the surface."""

MOST_TRIANGLES = 2000


def touching_points(
    vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "triangle 3"]
) -> Float[np.ndarray, "point 3"]:
    """Vertices that are farthest in some direction, all or an even selection, then vertices all over the surface."""
    used = vertices[np.unique(faces)]
    outer = np.unique(ConvexHull(used).vertices)
    if len(outer) > MOST_POINTS[0]:
        outer = np.unique(outer[np.argmax(used[outer] @ _directions(MOST_POINTS[0]).T, axis=0)])
    rest = np.setdiff1d(np.arange(len(used)), outer)
    size = np.ptp(used, axis=0).max() / 64
    while len(rest) > MOST_POINTS[1]:
        _, first = np.unique(np.floor(used[rest] / size), axis=0, return_index=True)
        rest, size = rest[first], 1.2 * size
    return used[np.concatenate([outer, rest])]


def coarser(
    vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "triangle 3"]
) -> Float[np.ndarray, "few 3 3"]:
    """The surface with all vertices of a cell of space as one, in cells as large as it takes."""
    size, placed, kept = np.ptp(vertices, axis=0).max() / 64, vertices, faces
    while len(kept) > MOST_TRIANGLES:
        _, cell = np.unique(np.floor(vertices / size), axis=0, return_inverse=True)
        cell = cell.reshape(-1)
        placed = np.stack([np.bincount(cell, vertices[:, axis]) for axis in range(3)], axis=1)
        placed /= np.bincount(cell)[:, None]
        kept = cell[faces]
        kept = kept[(kept != np.roll(kept, 1, axis=1)).all(axis=1)]
        size *= 1.2
    return placed[kept]


def _directions(count: int) -> np.ndarray:
    """Evenly over the sphere, on a spiral."""
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    width = np.sqrt(1.0 - height**2)
    return np.stack([width * np.cos(turn), width * np.sin(turn), height], axis=1)
