"""Solids against triangle meshes of the same body: distance, mass properties, farthest points; derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from jax.flatten_util import ravel_pytree
from scipy.spatial.transform import Rotation

from icjax.geometry import Box, Capsule, Cylinder, Ellipsoid, Placed, Plane, Prism, Sphere, wedge
from icjax.spatial import Pose

SECTIONS = 192
FACETED = 2e-4  # a polygon of 192 corners in a unit circle misses its edge by 1.3e-4, its area by 1.8e-4
OUTLINE = [(-0.5, -0.3), (0.6, -0.4), (0.7, 0.2), (-0.1, 0.5)]
EXACT = 1e-12  # rounding, of sizes of order one


def extruded(outline, depth):
    """Triangles of a prism whose outline is convex, without a triangulation library."""
    count = len(outline)
    low, high = (np.column_stack([outline, np.full(count, z)]) for z in (-depth / 2, depth / 2))
    fan = [(0, i, i + 1) for i in range(1, count - 1)]
    faces = [(a, c, b) for a, b, c in fan] + [(a + count, b + count, c + count) for a, b, c in fan]
    for i in range(count):
        j = (i + 1) % count
        faces += [(i, j, j + count), (i, j + count, i + count)]
    return trimesh.Trimesh(np.concatenate([low, high]), faces)


def ellipsoid_mesh():
    mesh = trimesh.creation.icosphere(subdivisions=5)
    mesh.apply_scale([0.5, 0.3, 0.2])
    return mesh


PLACE = Pose(Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix(), np.array([0.2, -0.1, 0.4]))


def placed_mesh():
    mesh = trimesh.creation.box((0.6, 1.0, 0.4))
    return mesh.apply_transform(np.asarray(PLACE.matrix()))


WEDGE = wedge(0.8, 0.6, 1.0, 0.2)
SOLIDS = {
    "box": (Box(np.array([0.3, 0.5, 0.2])), trimesh.creation.box((0.6, 1.0, 0.4)), EXACT),
    "prism": (Prism(np.array(OUTLINE), 0.35), extruded(OUTLINE, 0.7), EXACT),
    "wedge": (WEDGE, extruded(np.asarray(WEDGE.outline), 1.0), EXACT),
    "placed": (Placed(Box(np.array([0.3, 0.5, 0.2])), PLACE), placed_mesh(), EXACT),
    "sphere": (Sphere(0.4), trimesh.creation.icosphere(5, radius=0.4), 3e-4),
    "capsule": (Capsule(0.3, 0.4), trimesh.creation.capsule(0.8, 0.3, count=(96, 96)), 5e-4),
    "cylinder": (Cylinder(0.4, 0.3), trimesh.creation.cylinder(0.4, 0.6, sections=SECTIONS), FACETED),
    "ellipsoid": (Ellipsoid(np.zeros(3), np.eye(3), np.array([0.5, 0.3, 0.2])), ellipsoid_mesh(), 5e-4),
}
solids = pytest.mark.parametrize(("shape", "mesh", "tolerance"), SOLIDS.values(), ids=SOLIDS.keys())


def points(count, seed):
    return jnp.asarray(np.random.default_rng(seed).uniform(-1.2, 1.2, size=(count, 3)))


@jax.jit
def facts(shape, p):
    functions = (shape.signed_distance, shape.normal, shape.closest_point, jax.grad(shape.signed_distance))
    return tuple(jax.vmap(function)(p) for function in functions)


mass = jax.jit(lambda shape: shape.mass_properties())


@jax.jit
def probed(shape, direction):
    centre, radius = shape.probes(direction)
    return centre, radius, jax.vmap(shape.signed_distance)(centre)


@solids
def test_distance_of_a_mesh(shape, mesh, tolerance):
    """All of them are convex: inside is behind every triangle."""
    p = jnp.concatenate([points(60, 1), 0.3 * points(60, 2) + jnp.asarray(mesh.center_mass)[None]])
    distance, normal, closest, gradient = facts(shape, p)
    _, expected, _ = trimesh.proximity.closest_point_naive(mesh, np.asarray(p))
    offsets = np.einsum("ptj,tj->pt", np.asarray(p)[:, None] - mesh.triangles_center[None], mesh.face_normals)
    inside = np.all(offsets < 0, axis=1)
    assert inside.sum() > 10
    assert (~inside).sum() > 40
    np.testing.assert_allclose(distance, np.where(inside, -expected, expected), rtol=0, atol=tolerance)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, rtol=0, atol=EXACT)
    np.testing.assert_allclose(gradient, normal, rtol=0, atol=1e-9)  # Newton's residual of the ellipsoid
    np.testing.assert_allclose(facts(shape, closest)[0], 0.0, atol=1e-11)


@solids
def test_mass_properties_of_a_mesh(shape, mesh, tolerance):
    found = mass(shape)
    relative = 20 * tolerance  # a faceted body misses the area twice, its fourth moments four times
    np.testing.assert_allclose(found.volume, mesh.volume, rtol=relative)
    np.testing.assert_allclose(found.com, mesh.center_mass, rtol=0, atol=max(tolerance, 1e-9))
    np.testing.assert_allclose(found.inertia, mesh.moment_inertia, rtol=relative, atol=relative * mesh.volume)


@solids
def test_probes_touch_the_surface_and_reach_as_far_as_it_does(shape, mesh, tolerance):
    for direction in np.random.default_rng(3).normal(size=(10, 3)):
        direction /= np.linalg.norm(direction)
        centre, radius, distance = map(np.asarray, probed(shape, direction))
        np.testing.assert_allclose(distance, -radius, rtol=0, atol=1e-11)
        reach = np.max(centre @ direction + radius)
        np.testing.assert_allclose(reach, np.max(mesh.vertices @ direction), rtol=0, atol=5 * tolerance)


def edges(shape):
    """Corners, points on faces, on edges, on the axis, in the middle, and above a corner."""
    yield from np.asarray(probed(shape, np.array([0.0, 0.0, 1.0]))[0])
    yield from np.asarray(probed(shape, np.array([1.0, 0.0, 0.0]))[0])
    yield from [np.zeros(3), np.array([0.0, 0.0, 0.2]), np.array([0.0, 0.0, 2.0]), np.array([0.3, 0.0, 0.0])]
    yield from [np.array([0.3, 0.5, 1.0]), np.array([0.4, 0.0, 0.0]), np.array([1e-170, 0.0, 0.0])]


@pytest.mark.parametrize("name", ["box", "prism", "placed", "sphere", "capsule", "cylinder"])
def test_derivatives(name):
    """Forward = reverse = difference in the point and in every number of the shape; finite where they jump."""
    shape = SOLIDS[name][0]
    numbers, form = ravel_pytree(shape)

    def everything(x):
        moved = form(x[3:])
        return jnp.concatenate([moved.signed_distance(x[:3])[None], moved.normal(x[:3]), moved.closest_point(x[:3])])

    step = 1e-6

    @jax.jit
    def derivatives(x):
        moves = step * jnp.eye(x.size)
        plus, minus = jax.lax.map(everything, x[None] + jnp.concatenate([moves, -moves])).reshape(2, x.size, 7)
        second, reverse = jax.jacfwd(lambda x: (jax.jacrev(everything)(x),) * 2, has_aux=True)(x)
        return jax.jacfwd(everything)(x), reverse, (plus - minus).T / (2 * step), second

    for p in points(6, 4):
        forward, reverse, central, second = derivatives(jnp.concatenate([p, numbers]))
        size = np.max(np.abs(forward))
        np.testing.assert_allclose(reverse, forward, rtol=0, atol=1e-12 * size)
        np.testing.assert_allclose(central, forward, rtol=0, atol=1e-6 * size)  # second derivatives up to 1e3
        assert np.isfinite(second).all()
    for p in edges(shape):
        forward, reverse, *_ = derivatives(jnp.concatenate([p, numbers]))
        assert np.isfinite(forward).all(), p
        assert np.isfinite(reverse).all(), p


@solids
def test_single_precision(shape, mesh, tolerance):
    single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), shape)
    p = points(120, 5)  # as many as above
    found, normal, *_ = facts(single, p.astype(jnp.float32))
    assert found.dtype == normal.dtype == jnp.float32
    np.testing.assert_allclose(found, facts(shape, p)[0], rtol=0, atol=1e-6)
    others = jax.eval_shape(
        lambda shape, up: (shape.probes(up), shape.mass_properties()), single, p[0].astype(found.dtype)
    )
    assert all(x.dtype == jnp.float32 for x in jax.tree.leaves(others))


def test_a_box_tells_its_face():
    box = Box(np.array([0.3, 0.5, 0.2]))
    for p, distance, normal in [
        ((0.0, 0.0, 0.15), -0.05, (0, 0, 1)),
        ((0.0, 0.0, -0.2), 0.0, (0, 0, -1)),
        ((0.4, 0.1, 0.1), 0.1, (1, 0, 0)),
        ((0.6, 0.9, 0.1), 0.5, (0.6, 0.8, 0)),
    ]:
        found, direction, *_ = facts(box, np.tile(p, (120, 1)))
        np.testing.assert_allclose(found[0], distance, atol=1e-15)
        np.testing.assert_allclose(direction[0], normal, atol=1e-15)


def test_what_is_no_prism():
    with pytest.raises(ValueError, match="counter-clockwise"):
        Prism(np.array(OUTLINE[::-1]), 0.1)
    with pytest.raises(ValueError, match="convex"):
        Prism(np.array([(0, 0), (1, 0), (0.2, 0.2), (0, 1.0)]), 0.1)
    with pytest.raises(ValueError, match="2 corners"):
        Prism(np.zeros((2, 2)), 0.1)
    with pytest.raises(ValueError, match="tilted"):
        wedge(0.02, 0.05, 0.03, 1.0)
    star = np.array([(np.cos(a), np.sin(a)) for a in 4 * np.pi * np.arange(5) / 5])  # turns left, twice round
    with pytest.raises(ValueError, match="convex"):
        Prism(star, 0.1)


def test_a_plane_has_no_mass():
    plane = Plane(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    with pytest.raises(ValueError, match="no mass"):
        plane.mass_properties()
    with pytest.raises(ValueError, match="no corners"):
        plane.probes(jnp.array([0.0, 0.0, -1.0]))


def test_an_outline_may_be_traced():
    @jax.jit
    def distance(outline):
        return Prism(outline, 0.35).signed_distance(jnp.array([1.0, 0.0, 0.0]))

    expected = facts(Prism(np.array(OUTLINE), 0.35), np.tile([1.0, 0.0, 0.0], (120, 1)))[0][0]
    np.testing.assert_allclose(distance(np.array(OUTLINE)), expected, atol=EXACT)
