"""The grid of a mesh: computed once, then read from a folder."""

import hashlib
import os
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from icjax.geometry._triangle_distance import grid_distances, windings
from icjax.typing import Float, Int, Scalar

MARGIN = 3, 0.1
"""The grid goes so many spacings and so much of the longest side beyond the triangles."""

SAMPLES = 2000
"""Random points of the triangles at which the error of the grid is measured."""

_BEYOND = 8
"""Nodes beyond the grid, in the line of its last two, so that the spline does not feel its end."""

_VERSION = b"2"


class Grid(NamedTuple):
    """**Fields**: `coefficients` of a cubic spline through the signed distances at the nodes, m; `origin` the first
    node, m; `error` the largest distance of its surface from vertices and random points, m, and `usual` its mean.
    """

    coefficients: Float[np.ndarray, "i j k"]
    origin: Float[np.ndarray, "3"]
    error: Scalar
    usual: Scalar


def distance_grid(
    vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "triangle 3"], spacing: float, folder: Path
) -> Grid:
    """Of a closed surface, from the folder if it is there. A folder that cannot be written to is left alone."""
    digest = hashlib.sha256(
        _VERSION + vertices.tobytes() + faces.astype("int64").tobytes() + np.float64(spacing).tobytes()
    )
    path = folder / f"{digest.hexdigest()[:32]}.npz"
    try:
        with np.load(path) as kept:
            return Grid(*(kept[name] for name in Grid._fields))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        pass  # not there, or not whole
    grid = _computed(vertices, faces, spacing)
    unfinished = path.with_suffix(f".{os.getpid()}.npz")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(unfinished, **grid._asdict())
        unfinished.replace(path)
    except OSError:
        pass
    return grid


def _computed(vertices: np.ndarray, faces: np.ndarray, spacing: float) -> Grid:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    margin = MARGIN[0] * spacing + MARGIN[1] * (high - low).max()
    origin = low - margin
    shape = tuple(int(count) for count in np.ceil((high - low + 2 * margin) / spacing).astype(int) + 1)
    triangles = vertices[faces]
    away = grid_distances(origin, spacing, shape, triangles)
    signed = np.where(windings(origin, spacing, shape, triangles) > 0, -away, away)
    wider = np.pad(signed, _BEYOND, mode="reflect", reflect_type="odd")
    kept = (slice(_BEYOND, -_BEYOND),) * 3
    coefficients = ndimage.spline_filter(wider, order=3, mode="mirror")[kept]
    places = np.concatenate([vertices[np.unique(faces)], _random_points(triangles)])
    off = ndimage.map_coordinates(
        coefficients, ((places - origin) / spacing).T, order=3, prefilter=False, mode="mirror"
    )
    off = np.abs(off)
    return Grid(coefficients, origin, np.asarray(off.max()), np.asarray(off[-SAMPLES:].mean()))


def _random_points(triangles: np.ndarray) -> np.ndarray:
    """Evenly over the surface."""
    generator = np.random.default_rng(0)
    a, b, c = np.moveaxis(triangles, 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = generator.choice(len(triangles), SAMPLES, p=area / area.sum())
    u, v = generator.uniform(size=(2, SAMPLES, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen]
