"""Meshes from files and numbers: checked, measured, and put on a grid that is kept for the next time."""

import os
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from icjax.compiling import cache_folder
from icjax.geometry._mesh import Mesh
from icjax.geometry._mesh_grid import distance_grid
from icjax.geometry._mesh_points import coarser, touching_points
from icjax.geometry._mesh_repair import faults, repaired
from icjax.typing import Float, Int, Real

FINENESS = 48
"""Spacings of the grid along the longest side, where none is stated."""

LARGEST, SMALLEST = 10.0, 1e-4
"""m; a longer or shorter mesh was meant in another unit."""

THIN = 0.1
"""Of the spacing; of a solid that the grid resolves, the mean distance of its surface from the triangles is less."""

MOST_NODES = 20_000_000


def read_mesh(
    path: str | os.PathLike,
    *,
    scale: float = 1.0,
    spacing: float | None = None,
    repair: bool = False,
    cache: str | os.PathLike | None = None,
) -> Mesh:
    """Solid of triangles from a file: STL, OBJ, PLY, OFF, GLB, and what else `trimesh` reads.

    **Arguments**: `scale` metres per unit of the file, 0.001 for mm; the others as of [`triangle_mesh`].

    **Errors**: `ValueError`, one line naming the file, for what cannot be read and what bounds no solid.
    """
    import trimesh

    path = Path(path)
    if not path.is_file():
        raise ValueError(f"{path} does not exist")
    try:
        loaded: Any = trimesh.load(path, force="mesh", process=False)
        vertices, faces = np.array(loaded.vertices, float), np.array(loaded.faces, int)
    except Exception as error:  # whatever the reader of one format or another meets in a damaged file
        raise ValueError(f"{path} cannot be read as a mesh: {' '.join(str(error).split())}") from error
    return triangle_mesh(vertices, faces, scale=scale, spacing=spacing, repair=repair, cache=cache, name=str(path))


def triangle_mesh(
    vertices: Float[Real, "vertex 3"],
    faces: Int[Real, "triangle 3"],
    *,
    scale: float = 1.0,
    spacing: float | None = None,
    repair: bool = False,
    cache: str | os.PathLike | None = None,
    name: str = "the mesh",
) -> Mesh:
    """Solid between triangles, whose vertices go counter-clockwise seen from outside.

    **Arguments**

    - `vertices`; `faces` their numbers; equal vertices are taken for one.
    - `scale`: metres per unit of the vertices.
    - `spacing`: of the grid's nodes, m; default a 48th of the longest side.
    - `repair`: fill holes and turn triangles that face the wrong way.
    - `cache`: folder for the grid, which takes seconds; default `meshes` in `$ICJAX_CACHE`, or in `icjax` in the
      cache folder of the user. It is found again by the numbers, not by the name.
    - `name`: what errors call it.

    **Errors**: `ValueError` for no triangles, numbers that are not finite, a surface that is open, inside out or
    otherwise no boundary of a solid, a size beyond 10 m or below 0.1 mm, and parts thinner than the grid.
    """
    vertices, faces = np.asarray(vertices, float), np.asarray(faces, int)
    if not len(faces):
        raise ValueError(f"{name} has no triangles")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(f"{name} has a triangle of vertex {int(faces.max())}; there are {len(vertices)}")
    if not np.isfinite(vertices[faces]).all():
        bad = int(np.argmin(np.isfinite(vertices).all(axis=1)))
        raise ValueError(f"{name}: vertex {bad} is not finite: {vertices[bad].tolist()}")
    if not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"{name}: scale must be positive; got {scale}")
    vertices, faces = _merged(scale * vertices, faces)
    longest = float(np.ptp(vertices, axis=0).max()) if len(faces) else 0.0
    _check_size(name, longest, scale)
    if repair:
        vertices, faces = repaired(vertices, faces)
    wrong = faults(vertices, faces)
    if wrong:
        offer = ", even repaired" if repair else "; repair=True (in a scene file: repair = true) mends what can be"
        raise ValueError(f"{name} {wrong}{offer}")
    spacing = longest / FINENESS if spacing is None else float(spacing)
    if not (np.isfinite(spacing) and 0 < spacing <= longest / 4):
        raise ValueError(f"{name}: spacing must be positive and at most a quarter of {longest:g} m; got {spacing}")
    nodes = np.prod(np.ptp(vertices, axis=0) / spacing + 7 + 0.2 * longest / spacing)
    if nodes > MOST_NODES:
        raise ValueError(
            f"{name}: spacing {spacing:g} m makes a grid of {nodes:.2g} nodes; {MOST_NODES:.0e} are possible"
        )
    folder = cache_folder() / "meshes" if cache is None else Path(cache)
    grid = distance_grid(vertices, faces, spacing, folder)
    if grid.usual > THIN * spacing:
        raise ValueError(f"{name} has parts thinner than its grid: give a spacing below {spacing:g} m")
    return _mesh(vertices, faces, grid, spacing)


def _mesh(vertices, faces, grid, spacing) -> Mesh:
    from trimesh import Trimesh

    solid = Trimesh(vertices, faces, process=False)
    numbers = (
        grid.coefficients, grid.origin, spacing, solid.volume, solid.center_mass, solid.moment_inertia,
        touching_points(vertices, faces), coarser(vertices, faces), grid.error,
    )  # fmt: skip
    return Mesh(*(jnp.asarray(x, float) for x in numbers))


def _merged(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """With equal vertices as one, and without triangles of two corners."""
    size = np.abs(vertices[faces]).max()
    rounded = np.round(vertices / (1e-9 * size if size else 1.0))
    _, first, number = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    faces = number.reshape(-1)[faces]
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return vertices[first], faces[distinct]


def _check_size(name: str, longest: float, scale: float) -> None:
    if SMALLEST <= longest <= LARGEST:
        return
    likely = [power for power in (1e-3, 1e-2, 1e-6, 1e3, 1e2, 1e6) if 0.01 <= power * longest <= 1.0]
    hint = f"; is it meant with scale={scale * likely[0]:g}?" if likely else ""
    raise ValueError(
        f"{name} is {longest:g} m long; {SMALLEST:g} to {LARGEST:g} m are possible (scale is metres per unit){hint}"
    )
