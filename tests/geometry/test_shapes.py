"""Plane and ellipsoid: brute force, the eikonal equation, derivatives, and the points where formulas divide by zero."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from icjax.geometry import Ellipsoid, Plane

RADII = {
    "bump": (0.012, 0.035, 0.003),
    "triaxial": (0.5, 0.3, 0.2),
    "sphere": (0.1, 0.1, 0.1),
    "oblate": (0.3, 0.3, 0.1),
    "prolate": (0.1, 0.1, 0.3),
}


def random_ellipsoid(radii, seed):
    generator = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=seed).as_matrix()
    return Ellipsoid(jnp.asarray(generator.normal(size=3)), jnp.asarray(rotation), jnp.asarray(radii))


def points_around(shape, n, seed, scale=3.0):
    """Points inside and outside, away from the focal set by their random position."""
    generator = np.random.default_rng(seed)
    local = generator.uniform(-scale, scale, size=(n, 3)) * np.asarray(shape.radii)
    return jnp.asarray(np.asarray(shape.centre) + local @ np.asarray(shape.rotation).T)


def brute_force_distance(shape, p):
    """Minimise over the angles of the surface from many starts."""
    y = np.asarray(shape.rotation).T @ (np.asarray(p) - np.asarray(shape.centre))
    radii = np.asarray(shape.radii)

    def surface(angles):
        return radii * np.array(
            [np.cos(angles[0]) * np.cos(angles[1]), np.sin(angles[0]) * np.cos(angles[1]), np.sin(angles[1])]
        )

    grid = [(a, b) for a in np.linspace(-np.pi, np.pi, 17) for b in np.linspace(-1.5, 1.5, 9)]
    start = sorted(grid, key=lambda angles: np.sum((surface(angles) - y) ** 2))[:4]
    scale = np.max(radii) ** 2
    found = [
        minimize(lambda a: np.sum((surface(a) - y) ** 2) / scale, s, tol=1e-15, options={"gtol": 1e-12}) for s in start
    ]
    distance = np.sqrt(min(item.fun for item in found) * scale)
    return distance if np.sum((y / radii) ** 2) > 1 else -distance


@pytest.mark.parametrize("radii", RADII.values(), ids=RADII.keys())
def test_ellipsoid_against_brute_force(radii):
    shape = random_ellipsoid(radii, 1)
    points = points_around(shape, 8, 2, scale=1.2)
    for p, distance in zip(points, facts(shape, points)[0], strict=True):
        # 1e-7 of the size: a squared distance minimised to 1e-15 relative is known to about sqrt(1e-15)
        np.testing.assert_allclose(distance, brute_force_distance(shape, p), atol=1e-7 * max(radii), rtol=0)


@pytest.mark.parametrize("radii", RADII.values(), ids=RADII.keys())
def test_ellipsoid_facts(radii):
    """The closest point lies on the surface, p = closest + distance * normal, |grad| = 1, grad = normal."""
    shape = random_ellipsoid(radii, 3)
    for scale in (0.5, 1.5, 50.0):
        p = points_around(shape, 40, 4, scale)
        distance, normal, closest, gradient = facts(shape, p)
        local = (closest - shape.centre[None]) @ shape.rotation
        rounding = 1e-11  # float64 rounding, enlarged by the aspect ratio of the ellipsoid
        np.testing.assert_allclose(np.sum((local / shape.radii[None]) ** 2, axis=1), 1.0, atol=rounding)
        np.testing.assert_allclose(closest + distance[:, None] * normal, p, atol=rounding * scale)
        np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=rounding)
        np.testing.assert_allclose(gradient, normal, atol=1e-9)  # Newton residual times curvature radius ratio
        inside = np.sum((((p - shape.centre[None]) @ shape.rotation) / shape.radii[None]) ** 2, axis=1) < 1
        assert np.all((distance < 0) == inside)


@jax.jit
def facts(shape, p):
    functions = (shape.signed_distance, shape.normal, shape.closest_point, jax.grad(shape.signed_distance))
    return tuple(jax.vmap(function)(p) for function in functions)


def test_sphere_closed_form():
    shape = random_ellipsoid((0.2, 0.2, 0.2), 5)
    p = points_around(shape, 30, 6)
    offset = p - shape.centre[None]
    np.testing.assert_allclose(facts(shape, p)[0], np.linalg.norm(offset, axis=1) - 0.2, atol=1e-14, rtol=1e-13)
    hessian = jax.jit(jax.vmap(jax.hessian(shape.signed_distance)))(p)
    length = np.linalg.norm(offset, axis=1)[:, None, None]
    exact = (np.eye(3)[None] - offset[:, :, None] * offset[:, None, :] / length**2) / length
    np.testing.assert_allclose(hessian, exact, rtol=1e-9, atol=1e-9)


@jax.jit
def first_and_second(rotation, x):
    """First derivatives forward, reverse and by differences, second ones by both; x is point, centre and radii."""

    def everything(x):
        body = Ellipsoid(x[3:6], rotation, x[6:9])
        return jnp.concatenate([body.signed_distance(x[:3])[None], body.normal(x[:3]), body.closest_point(x[:3])])

    forward, reverse, step = jax.jacfwd(everything), jax.jacrev(everything), 1e-6
    moved = x[:, None, None, :] + step * jnp.stack([jnp.eye(9), -jnp.eye(9)])[None]
    plus, minus = (jax.vmap(jax.vmap(everything))(moved[:, side]) for side in (0, 1))
    second_plus, second_minus = (jax.vmap(jax.vmap(forward))(moved[:, side]) for side in (0, 1))
    return (
        jax.vmap(forward)(x),
        jax.vmap(reverse)(x),
        jnp.moveaxis((plus - minus) / (2 * step), 1, 2),
        jax.vmap(jax.jacfwd(reverse))(x),
        jnp.moveaxis((second_plus - second_minus) / (2 * step), 1, 3),
    )


@pytest.mark.parametrize("radii", RADII.values(), ids=RADII.keys())
def test_derivatives_to_second_order(radii):
    """Forward = reverse = central difference, of distance, normal and closest point, in the point and in the shape."""
    shape = random_ellipsoid(radii, 7)
    unit = max(radii)
    points = points_around(shape, 6, 8, scale=2.0)

    x = jax.vmap(lambda p: jnp.concatenate([(p - shape.centre) / unit, jnp.zeros(3), shape.radii / unit]))(points)

    first, again, difference, second, second_difference = first_and_second(shape.rotation, x)
    size, second_size = np.max(np.abs(first)), np.max(np.abs(second))
    np.testing.assert_allclose(first, again, atol=1e-12 * size)  # rounding
    # differences: rounding over the step, and the curvature of a thin ellipsoid (aspect 12) times its square
    np.testing.assert_allclose(first, difference, atol=2e-6 * size)
    np.testing.assert_allclose(second, second_difference, atol=2e-5 * second_size)


def special_points():
    shape = Ellipsoid(jnp.zeros(3), jnp.eye(3), jnp.array([0.5, 0.3, 0.2]))
    sphere = Ellipsoid(jnp.zeros(3), jnp.eye(3), jnp.full(3, 0.2))
    for name, body in (("ellipsoid", shape), ("sphere", sphere)):
        yield f"{name} centre", body, (0.0, 0.0, 0.0), -0.2
        for axis in range(3):
            radius = float(body.radii[axis])
            outside = [0.0, 0.0, 0.0]
            outside[axis] = 2.0 * radius
            yield f"{name} outside on axis {axis}", body, tuple(outside), radius
            on = [0.0, 0.0, 0.0]
            on[axis] = -radius
            yield f"{name} on the surface on axis {axis}", body, tuple(on), 0.0
    # inside on the long axis: beyond the focal point the tip is closest, before it a ring of the flank
    yield "near the tip", shape, (0.48, 0.0, 0.0), -0.02
    yield "flank", shape, (0.1, 0.0, 0.0), -0.2 * np.sqrt(1 - 0.1**2 / (0.5**2 - 0.2**2))
    yield "just below the surface on the short axis", shape, (0.0, 0.0, 0.19), -0.01


@jax.jit
def derivatives(shape, p):
    return (
        jax.grad(shape.signed_distance)(p),
        jax.jacfwd(shape.signed_distance)(p),
        jax.jacfwd(shape.normal)(p),
        jax.jacrev(shape.normal)(p),
        jax.hessian(shape.signed_distance)(p),
    )


CASES = list(special_points())


@pytest.mark.parametrize(("shape", "p", "expected"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_special_points_are_exact_and_finite(shape, p, expected):
    p = jnp.asarray(p)
    hair = 1e-8  # on the focal set the point is moved by sqrt(eps) of the smallest radius
    np.testing.assert_allclose(shape.signed_distance(p), expected, atol=hair)
    normal = shape.normal(p)
    np.testing.assert_allclose(np.linalg.norm(normal), 1.0, atol=1e-12)
    np.testing.assert_allclose(shape.closest_point(p) + expected * normal, p, atol=hair)

    for derivative in derivatives(shape, p):
        assert np.all(np.isfinite(derivative))


def test_curvature_is_right_in_the_planes_of_symmetry():
    """A component of zero is no reason to lose its derivative."""
    shape = Ellipsoid(jnp.zeros(3), jnp.eye(3), jnp.array([0.5, 0.3, 0.2]))
    p = jnp.array([0.5, 0.0, 0.0])
    # on the surface dn/dp = diag(0, a/b^2, a/c^2), the principal curvatures at the tip
    np.testing.assert_allclose(jax.jacfwd(shape.normal)(p), np.diag([0.0, 0.5 / 0.09, 0.5 / 0.04]), atol=1e-9)


def test_plane():
    plane = Plane(jnp.array([0.1, 0.2, 0.3]), jnp.array([0.0, 3.0, 4.0]))
    p = jnp.array([1.0, -1.0, 2.0])
    np.testing.assert_allclose(plane.normal(p), [0.0, 0.6, 0.8], atol=1e-15)
    np.testing.assert_allclose(plane.signed_distance(p), 0.6 * -1.2 + 0.8 * 1.7, atol=1e-15)
    np.testing.assert_allclose(plane.signed_distance(plane.closest_point(p)), 0.0, atol=1e-15)
    np.testing.assert_allclose(plane.closest_point(p) + plane.signed_distance(p) * plane.normal(p), p, atol=1e-15)

    @jax.jit
    def everything(x):
        shape = Plane(x[:3], x[3:6])
        return jnp.concatenate([shape.signed_distance(x[6:])[None], shape.normal(x[6:]), shape.closest_point(x[6:])])

    x = jnp.concatenate([plane.point, plane.normal_direction, p])
    step = 1e-5
    difference = np.stack([(everything(x + e) - everything(x - e)) / (2 * step) for e in step * jnp.eye(9)], axis=1)
    first, again = jax.jit(jax.jacfwd(everything))(x), jax.jit(jax.jacrev(everything))(x)
    np.testing.assert_allclose(first, again, atol=1e-14)
    np.testing.assert_allclose(first, difference, atol=1e-9)  # rounding over the step
    assert np.all(np.isfinite(jax.jit(jax.jacfwd(jax.jacrev(everything)))(x)))


def test_float32():
    shape = Ellipsoid(jnp.zeros(3, jnp.float32), jnp.eye(3, dtype=jnp.float32), jnp.array([0.5, 0.3, 0.2], jnp.float32))
    p = jnp.array([0.4, 0.35, 0.3], jnp.float32)
    assert shape.signed_distance(p).dtype == jnp.float32
    exact = Ellipsoid(jnp.zeros(3), jnp.eye(3), jnp.array([0.5, 0.3, 0.2])).signed_distance(p.astype(jnp.float64))
    np.testing.assert_allclose(shape.signed_distance(p), exact, rtol=1e-5)
