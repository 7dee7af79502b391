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
    hessian = np.stack([second(shape.rotation, numbers(shape, each))[0, :3, :3] for each in p])
    length = np.linalg.norm(offset, axis=1)[:, None, None]
    exact = (np.eye(3)[None] - offset[:, :, None] * offset[:, None, :] / length**2) / length
    np.testing.assert_allclose(hessian, exact, rtol=1e-9, atol=1e-9)


def numbers(shape, p, unit=1.0):
    """Point, centre and radii of an ellipsoid that is moved to the origin."""
    return np.concatenate([(p - shape.centre) / unit, np.zeros(3), shape.radii / unit])


def everything(rotation, x):
    body = Ellipsoid(x[3:6], rotation, x[6:9])
    return jnp.concatenate([body.signed_distance(x[:3])[None], body.normal(x[:3]), body.closest_point(x[:3])])


@jax.jit
def first(rotation, x):
    """Everything and its first derivatives, forward and reverse."""
    forward, found = jax.jacfwd(lambda x: (everything(rotation, x),) * 2, has_aux=True)(x)
    return found, forward, jax.jacrev(everything, 1)(rotation, x)


second = jax.jit(jax.jacfwd(jax.jacrev(everything, 1), 1))


@pytest.mark.parametrize("radii", RADII.values(), ids=RADII.keys())
def test_derivatives_to_second_order(radii):
    """Forward = reverse = central difference, of distance, normal and closest point, in the point and in the shape."""
    shape = random_ellipsoid(radii, 7)
    unit = max(radii)
    points = points_around(shape, 6, 8, scale=2.0)

    def of_all(x):
        rows = [first(shape.rotation, each) for each in x.reshape(-1, 9)]
        return [np.stack(part).reshape(*x.shape[:-1], *part[0].shape) for part in zip(*rows, strict=True)]

    x, step = np.stack([numbers(shape, p, unit) for p in points]), 1e-6
    _, forward, reverse = of_all(x)
    plus, minus = of_all(x[:, None] + step * np.eye(9)), of_all(x[:, None] - step * np.eye(9))
    difference, second_difference = (np.moveaxis((plus[k] - minus[k]) / (2 * step), 1, -1) for k in (0, 1))
    found = np.stack([second(shape.rotation, each) for each in x])
    size, second_size = np.max(np.abs(forward)), np.max(np.abs(found))
    np.testing.assert_allclose(forward, reverse, atol=1e-12 * size)  # rounding
    # differences: rounding over the step, and the curvature of a thin ellipsoid (aspect 12) times its square
    np.testing.assert_allclose(forward, difference, atol=2e-6 * size)
    np.testing.assert_allclose(found, second_difference, atol=2e-5 * second_size)


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


CASES = list(special_points())


@pytest.mark.parametrize(("shape", "p", "expected"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_special_points_are_exact_and_finite(shape, p, expected):
    x = numbers(shape, np.asarray(p))
    found, forward, reverse = first(shape.rotation, x)
    distance, normal, closest = np.split(found, [1, 4])
    hair = 1e-8  # on the focal set the point is moved by sqrt(eps) of the smallest radius
    np.testing.assert_allclose(distance, [expected], atol=hair)
    np.testing.assert_allclose(np.linalg.norm(normal), 1.0, atol=1e-12)
    np.testing.assert_allclose(closest + expected * normal, p, atol=hair)
    for derivative in (forward, reverse, second(shape.rotation, x)):
        assert np.all(np.isfinite(derivative[:, ..., :3]))


def test_curvature_is_right_in_the_planes_of_symmetry():
    """A component of zero is no reason to lose its derivative."""
    shape = Ellipsoid(jnp.zeros(3), jnp.eye(3), jnp.array([0.5, 0.3, 0.2]))
    _, derivatives, _ = first(shape.rotation, numbers(shape, np.array([0.5, 0.0, 0.0])))
    # on the surface dn/dp = diag(0, a/b^2, a/c^2), the principal curvatures at the tip
    np.testing.assert_allclose(derivatives[1:4, :3], np.diag([0.0, 0.5 / 0.09, 0.5 / 0.04]), atol=1e-9)


def test_plane():
    plane = Plane(jnp.array([0.1, 0.2, 0.3]), jnp.array([0.0, 3.0, 4.0]))
    p = jnp.array([1.0, -1.0, 2.0])

    @jax.jit
    def derivatives(x):
        def everything(x):
            one, p = Plane(x[:3], x[3:6]), x[6:]
            return jnp.concatenate([one.signed_distance(p)[None], one.normal(p), one.closest_point(p)])

        return everything(x), jax.jacfwd(everything)(x), jax.jacrev(everything)(x), jax.hessian(everything)(x)

    x, step = np.concatenate([plane.point, plane.normal_direction, p]), 1e-5
    found, forward, reverse, second = derivatives(x)
    distance, normal, closest = np.split(found, [1, 4])
    np.testing.assert_allclose(normal, [0.0, 0.6, 0.8], atol=1e-15)
    np.testing.assert_allclose(distance, [0.6 * -1.2 + 0.8 * 1.7], atol=1e-15)
    np.testing.assert_allclose(derivatives(np.concatenate([x[:6], closest]))[0][0], 0.0, atol=1e-15)
    np.testing.assert_allclose(closest + distance * normal, p, atol=1e-15)
    sides = [[derivatives(x + side)[0] for side in (e, -e)] for e in step * np.eye(9)]
    difference = np.stack([(np.asarray(plus) - minus) / (2 * step) for plus, minus in sides], axis=1)
    np.testing.assert_allclose(forward, reverse, atol=1e-14)
    np.testing.assert_allclose(forward, difference, atol=1e-9)  # rounding over the step
    assert np.all(np.isfinite(second))


def test_float32():
    shape = Ellipsoid(jnp.zeros(3, jnp.float32), jnp.eye(3, dtype=jnp.float32), jnp.array([0.5, 0.3, 0.2], jnp.float32))
    p = np.array([0.4, 0.35, 0.3], np.float32)
    found = jax.jit(Ellipsoid.signed_distance)(shape, p)
    assert found.dtype == jnp.float32
    double = jax.tree.map(lambda number: np.asarray(number, float), shape)
    np.testing.assert_allclose(found, first(double.rotation, numbers(double, p))[0][0], rtol=1e-5)
