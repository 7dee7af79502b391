"""Heightfields against the triangles that they are made of; derivatives; beyond the rim; bad input."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from derivatives import DIFFERENCE_TOLERANCE, MODES_TOLERANCE, STEP

from icjax.geometry import Heightfield

SPACING = np.array([0.01, 0.013])
HEIGHTS = 0.006 * np.random.default_rng(1).normal(size=(12, 9))
GROUND = Heightfield(HEIGHTS, SPACING)


def triangles():
    """The ground as people would draw it."""
    x, y = (s * (np.arange(n) - (n - 1) / 2) for s, n in zip(SPACING, HEIGHTS.shape, strict=True))
    vertices = np.stack([*np.meshgrid(x, y, indexing="ij"), HEIGHTS], axis=-1).reshape(-1, 3)
    i, j = (part.reshape(-1) for part in np.meshgrid(np.arange(11), np.arange(8), indexing="ij"))
    a = 9 * i + j
    faces = np.concatenate([np.stack([a, a + 9, a + 10], axis=1), np.stack([a, a + 10, a + 1], axis=1)])
    return trimesh.Trimesh(vertices, faces, process=False)


@jax.jit
def facts(shape, p):
    functions = (shape.signed_distance, shape.normal, shape.closest_point, jax.grad(shape.signed_distance))
    return tuple(jax.vmap(function)(p) for function in functions)


def test_distance_is_that_of_the_triangles():
    drawn = triangles()
    p = np.random.default_rng(2).uniform([-0.04, -0.04, -0.06], [0.04, 0.04, 0.06], (400, 3))
    closest, expected, _ = trimesh.proximity.closest_point_naive(drawn, p)
    found, normal, point, gradient = facts(GROUND, jnp.asarray(p))
    exact = expected < float(GROUND.reach)
    assert 200 < exact.sum() < 390
    np.testing.assert_allclose(np.abs(found)[exact], expected[exact], atol=1e-15)
    np.testing.assert_allclose(point[exact], closest[exact], atol=1e-12)
    assert np.all(np.abs(found)[~exact] > expected[~exact] - 1e-15)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(gradient, normal, atol=1e-9)
    below = np.array([hit[2] > q[2] for hit, q in zip(under(drawn, p), p, strict=True)])
    np.testing.assert_array_equal(found < 0, below)
    assert 100 < below.sum() < 300


def area(u, v):
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def under(drawn, p):
    """Where the vertical lines through points meet the triangles, by barycentric coordinates."""
    a, b, c = np.moveaxis(drawn.triangles, 1, 0)
    for q in p:
        weights = [area(v - u, q - u) for u, v in ((b, c), (c, a), (a, b))]
        inside = np.all(np.stack(weights) >= 0, axis=0)
        k = int(np.argmax(inside))
        w = np.array([part[k] for part in weights])
        yield w @ np.stack([a[k], b[k], c[k]]) / w.sum()


def test_nodes_lie_on_the_ground_and_derivatives_are_right():
    np.testing.assert_allclose(GROUND.nodes(), triangles().vertices, atol=1e-15)

    @jax.jit
    def derivatives(p, heights):
        def numbers(x):
            ground = Heightfield(heights.at[5, 4].add(x[3]), SPACING)
            return jnp.concatenate([ground.signed_distance(p + x[:3])[None], ground.normal(p + x[:3])])

        x, steps = jnp.zeros(4), STEP * 1e-2 * jnp.eye(4)
        central = jax.vmap(lambda e: (numbers(e) - numbers(-e)) / (2e-2 * STEP), out_axes=1)(steps)
        return jax.jacfwd(numbers)(x), jax.jacrev(numbers)(x), central

    node = GROUND.nodes()[5 * 9 + 4]
    for off in ((0.0, 0.0, 0.01), (0.002, 0.004, 0.006), (-0.003, 0.002, -0.004), (0.0, 0.0, -0.012)):
        forward, reverse, central = map(np.asarray, derivatives(node + jnp.asarray(off), jnp.asarray(HEIGHTS)))
        size = max(1.0, np.abs(forward).max())
        np.testing.assert_allclose(reverse, forward, atol=MODES_TOLERANCE * size)
        np.testing.assert_allclose(central, forward, atol=1e2 * DIFFERENCE_TOLERANCE * size)
    for p in (node, 0.5 * (node + GROUND.nodes()[5 * 9 + 5]), jnp.array([9.0, -30.0, 0.0]), jnp.zeros(3)):
        for found in derivatives(p, jnp.asarray(HEIGHTS))[:2]:
            assert np.isfinite(found).all()


def test_the_rim_goes_on():
    """A slope is level beyond its rim; on a grid smaller than the reach too."""
    slope = Heightfield(np.outer(np.arange(4) * 0.01, np.ones(2)), 0.01, reach=0.03)
    assert slope.cells == 3
    p = jnp.array([[0.5, 0.3, 0.04], [-0.5, 0.0, 0.01], [0.015 + 1e-9, 0.0, 0.02], [-0.1, 4.0, -0.01]])
    found, normal, *_ = facts(slope, p)
    np.testing.assert_allclose(found, [0.01, 0.01, -0.01 * np.sqrt(0.5), -0.01], atol=1e-9)
    np.testing.assert_allclose(normal[:2], [[0, 0, 1], [0, 0, 1]], atol=1e-12)


def test_bad_heightfields():
    heights = HEIGHTS.copy()
    heights[3, 2] = np.nan
    for arguments, message in [
        ((HEIGHTS[:1], 0.01), r"two nodes in x and in y; got \[1, 9\]"),
        ((heights, 0.01), "row 3, column 2 is not"),
        ((HEIGHTS, 0.0), "spacing of a heightfield must be positive"),
        ((HEIGHTS, 0.01, 0.1), "more than 8 of its spacings of 0.01 m"),
    ]:
        with pytest.raises(ValueError, match=message):
            Heightfield(*arguments)
    for method, message in ((GROUND.mass_properties, "no mass"), (lambda: GROUND.probes(jnp.ones(3)), "no end")):
        with pytest.raises(ValueError, match=message):
            method()
