"""Meshes: distances against trimesh, mass against the triangles, what is refused and what is mended, the kept grid."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from meshes import RADIUS, lumps, mesh, source

from icjax.compiling import cache_folder
from icjax.geometry import Sphere, read_mesh, triangle_mesh
from icjax.geometry._triangle_distance import grid_distances, grid_points, windings

NAMES = ["sphere", "box", "lumps", "ring"]


@jax.jit
def facts(shape, p):
    functions = (shape.signed_distance, shape.normal, jax.grad(shape.signed_distance))
    return tuple(jax.vmap(function)(p) for function in functions)


def near(name, count, seed, depth):
    """Points within a depth of the surface, and their distances from it."""
    found = source(name)
    p, face = trimesh.sample.sample_surface(found, count, seed=seed)
    p = p + np.random.default_rng(seed).uniform(-depth, depth, (count, 1)) * found.face_normals[face]
    return p, trimesh.proximity.closest_point_naive(found, p)[1]


def test_nodes_hold_exact_distances_with_their_signs():
    """Of a ring, whose hole is outside."""
    found = source("ring")
    triangles, origin, shape = np.asarray(found.triangles), np.array([-0.05, -0.05, -0.02]), (8, 9, 5)
    points = grid_points(origin, 0.0117, shape).reshape(-1, 3)
    expected = trimesh.proximity.closest_point_naive(found, points)[1]
    np.testing.assert_allclose(grid_distances(origin, 0.0117, shape, triangles).reshape(-1), expected, atol=1e-15)
    inside = windings(origin, 0.0117, shape, triangles).reshape(-1)
    of_the_ring = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.03, points[:, 2]) - 0.01
    clear = np.abs(of_the_ring) > 1e-3
    np.testing.assert_array_equal(inside[clear], of_the_ring[clear] < 0)
    assert 0 < inside[clear].sum() < clear.sum()


@pytest.mark.parametrize("name", NAMES)
def test_distance_is_that_of_the_triangles(name, grids):
    shape = mesh(name, grids)
    spacing, error = float(shape.spacing), float(shape.error)
    p, expected = near(name, 200, 2, 2.0 * spacing)
    found, normal, gradient = facts(shape, jnp.asarray(p))
    off = np.abs(np.abs(found) - expected)
    assert error < (0.35 if name == "box" else 0.12) * spacing  # a spline rounds edges
    assert off.max() < 1.5 * error
    assert np.sqrt(np.mean(off**2)) < 0.4 * error
    size = np.linalg.norm(gradient, axis=1)
    np.testing.assert_allclose(normal, gradient / size[:, None], atol=1e-12)
    assert np.median(np.abs(size - 1.0)) < 0.02


@pytest.mark.parametrize("name", NAMES)
def test_mass_is_that_of_the_triangles(name, grids):
    volume, com, inertia = mesh(name, grids).mass_properties()
    np.testing.assert_allclose(volume, source(name).volume, rtol=1e-12)
    np.testing.assert_allclose(com, source(name).center_mass, atol=1e-15)
    np.testing.assert_allclose(inertia, source(name).moment_inertia, rtol=1e-9, atol=1e-20)


@pytest.mark.parametrize("name", NAMES)
def test_probes_reach_as_far_as_the_triangles(name, grids):
    shape, found = mesh(name, grids), source(name)
    centre = np.asarray(shape.probes(jnp.array([0.0, 0.0, 1.0])).centre)
    assert len(centre) <= 1536
    directions = np.random.default_rng(3).normal(size=(50, 3))
    reach, expected = (points @ directions.T for points in (centre, found.vertices))
    size = np.linalg.norm(directions, axis=1) * RADIUS
    missed = (expected.max(axis=0) - reach.max(axis=0)) / size
    assert missed.max() < (4e-3 if name == "sphere" else 1e-12)  # 1024 of the ball's 2562 vertices stand for all
    assert np.abs(facts(shape, jnp.asarray(centre))[0]).max() < 1.01 * float(shape.error)


def test_derivatives_are_finite_and_those_of_the_distance(grids):
    """Forward = reverse = difference where the spline is; finite at its cell faces, in the middle, beyond the grid."""
    shape = mesh("lumps", grids)
    step = 1e-6

    @jax.jit
    def all_of(p):
        def numbers(p):
            return jnp.concatenate([shape.signed_distance(p)[None], shape.normal(p)])

        central = jax.vmap(lambda e: (numbers(p + e) - numbers(p - e)) / (2 * step), out_axes=1)(step * jnp.eye(3))
        return jax.jacfwd(numbers)(p), jax.jacrev(numbers)(p), central

    low = np.asarray(shape.origin + shape.spacing)
    for p in 1.2 * near("lumps", 6, 4, 0.002)[0]:
        forward, reverse, central = all_of(jnp.asarray(p))
        np.testing.assert_allclose(reverse, forward, rtol=0, atol=1e-12 * np.abs(forward).max())
        np.testing.assert_allclose(central, forward, rtol=0, atol=1e-5 * np.abs(forward).max())  # curvature, 1/mm
    special = [np.zeros(3), low, low - 1e-12, np.array([0.1, 0.0, 0.0]), np.array([5.0, 5.0, -5.0])]
    special += [np.asarray(shape.origin + shape.spacing * np.array(k)) for k in ((9, 9, 9), (8, 15, 20.5))]
    for p in special:
        for found in all_of(jnp.asarray(p))[:2]:
            assert np.isfinite(found).all(), p


def test_beyond_the_grid_the_distance_goes_on(grids):
    """Continuous at its face; never too small; the direction right to a few degrees."""
    shape, ball = mesh("sphere", grids), Sphere(RADIUS)
    face = float(shape.origin[0] + shape.spacing)
    p = jnp.asarray([[face - 1e-9, y, z] for y in (0.0, 0.01, -0.02) for z in (0.0, 0.015)])
    inner, outer = facts(shape, p + jnp.asarray([[2e-9, 0.0, 0.0]])), facts(shape, p)
    np.testing.assert_allclose(outer[0], inner[0], atol=1e-6)
    np.testing.assert_allclose(outer[1], inner[1], atol=2e-3)
    generator = np.random.default_rng(6)
    for size in (0.05, 0.1, 0.5):
        direction = generator.normal(size=(100, 3))
        p = jnp.asarray(size * direction / np.linalg.norm(direction, axis=1, keepdims=True))
        off = np.asarray(facts(shape, p)[0] - facts(ball, p)[0])
        assert off.min() > -1e-4
        assert off.max() < 0.02 * size
        angle = np.arccos(np.clip(np.sum(facts(shape, p)[1] * facts(ball, p)[1], axis=1), -1, 1))
        assert angle.max() < 0.2


BALL = trimesh.creation.icosphere(2, RADIUS)


def test_bad_meshes_are_named_in_one_line(grids):
    holes, turned = BALL.faces[[*range(3, 100), *range(101, 320)]], BALL.faces.copy()
    turned[:40] = turned[:40, ::-1]
    hollow = BALL.vertices.copy()
    hollow[7, 1] = np.nan
    twice = np.concatenate([BALL.faces, BALL.faces[:1, ::-1]])
    for vertices, faces, scale, message in [
        (BALL.vertices, holes, 1.0, "is open: 12 edges belong to one triangle only; repair=True"),
        (BALL.vertices, turned, 1.0, r"face the wrong way, along \d+ edges; repair=True"),
        (BALL.vertices, BALL.faces[:, ::-1], 1.0, "is inside out: its volume is -0.0001"),
        (BALL.vertices, twice, 1.0, "belong to more than two triangles"),
        (BALL.vertices, BALL.faces + 1, 1.0, "vertex 162; there are 162"),
        (BALL.vertices, np.zeros((0, 3), int), 1.0, "has no triangles"),
        (hollow, BALL.faces, 1.0, "vertex 7 is not finite"),
        (1e3 * BALL.vertices, BALL.faces, 1.0, "is 60 m long; .* is it meant with scale=0.001"),
        (1e-3 * BALL.vertices, BALL.faces, 1.0, "6e-05 m long; .* scale=1000"),
        (BALL.vertices, BALL.faces, -1.0, "scale must be positive"),
    ]:
        with pytest.raises(ValueError, match=message) as caught:
            triangle_mesh(vertices, faces, scale=scale, cache=grids, name="ball.stl")
        assert str(caught.value).startswith("ball.stl")
        assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="spacing must be positive and at most a quarter of 0.06 m"):
        triangle_mesh(BALL.vertices, BALL.faces, spacing=0.1, cache=grids)
    with pytest.raises(ValueError, match="grid of .* nodes"):
        triangle_mesh(BALL.vertices, BALL.faces, spacing=1e-5, cache=grids)
    sheet = trimesh.creation.box((0.06, 0.06, 0.0005))  # between the nodes
    with pytest.raises(ValueError, match="has parts thinner than its grid"):
        triangle_mesh(sheet.vertices, sheet.faces, spacing=0.004, cache=grids)
    lone = BALL.faces[:100]
    with pytest.raises(ValueError, match="more than two triangles, even repaired"):
        triangle_mesh(BALL.vertices, np.concatenate([lone, lone[:1]]), repair=True, cache=grids)


def test_what_can_be_mended_is(grids):
    holes, turned = BALL.faces[[*range(3, 100), *range(101, 320)]], BALL.faces.copy()
    turned[:40] = turned[:40, ::-1]
    for faces in (holes, turned, BALL.faces[:, ::-1]):
        mended = triangle_mesh(BALL.vertices, faces, spacing=0.004, repair=True, cache=grids)
        np.testing.assert_allclose(mended.volume, BALL.volume, rtol=0.01)


def test_files_in_mm_and_the_kept_grid(tmp_path, monkeypatch):
    """Corners that an STL repeats are one vertex; the grid is read the second time, or made again."""
    path = tmp_path / "ball.stl"
    trimesh.Trimesh(1e3 * BALL.vertices, BALL.faces).export(path)
    monkeypatch.setenv("ICJAX_CACHE", str(tmp_path / "cache"))
    assert cache_folder() == tmp_path / "cache"
    first = read_mesh(path, scale=1e-3, spacing=0.005)
    np.testing.assert_allclose(first.volume, BALL.volume, rtol=1e-5)  # an STL has single precision
    (kept,) = (tmp_path / "cache" / "meshes").iterdir()
    written = kept.stat().st_mtime_ns
    again = read_mesh(path, scale=1e-3, spacing=0.005)
    assert kept.stat().st_mtime_ns == written
    np.testing.assert_array_equal(again.coefficients, first.coefficients)
    kept.write_bytes(b"PK and nothing else")
    np.testing.assert_array_equal(read_mesh(path, scale=1e-3, spacing=0.005).coefficients, first.coefficients)
    assert kept.stat().st_size > 1000
    (tmp_path / "noise.stl").write_bytes(b"solid nothing\n")
    for name, message in (("none.stl", "does not exist"), ("noise.stl", "has no triangles|cannot be read")):
        with pytest.raises(ValueError, match=message):
            read_mesh(tmp_path / name)


def test_many_triangles_are_fewer_in_pictures(grids):
    fine = lumps(5)
    found = triangle_mesh(fine.vertices, fine.faces, spacing=0.006, cache=grids)
    assert 500 < len(found.triangles) <= 2000
    a, b, c = np.moveaxis(np.asarray(found.triangles), 1, 0)
    np.testing.assert_allclose(np.sum(a * np.cross(b, c)) / 6.0, fine.volume, rtol=0.02)


def test_single_precision(grids):
    shape = mesh("sphere", grids)
    single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), shape)
    p = jnp.asarray(near("sphere", 20, 5, 0.005)[0])
    found, normal, _ = facts(single, p.astype(jnp.float32))
    assert found.dtype == normal.dtype == jnp.float32
    np.testing.assert_allclose(found, facts(shape, p)[0], atol=1e-7)
