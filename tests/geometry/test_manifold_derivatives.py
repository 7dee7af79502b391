"""Derivatives of contacts in sizes and poses; many pairs at once; single precision."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from derivatives import DIFFERENCE_TOLERANCE, MODES_TOLERANCE, STEP
from jax.flatten_util import ravel_pytree
from touching import BOX, CAPSULE, EXACT, KNIFE, LYING, PRISM, at, contact, random_pairs

from icjax.geometry import Placed, contact_manifold
from icjax.spatial import Pose, skew

STACKED = 0.75  # the prisms' half lengths
REGULAR = {
    "prisms": [
        (KNIFE, at([-0.3, -0.1, STACKED], [0.03, 0.05, 0.3]), PRISM, at([0, 0, 0])),  # a face of the second
        (KNIFE, at([-0.3, -0.1, STACKED], [0.2, 0.1, 0.3]), PRISM, at([0, 0, 0], [0.19, 0.12, 0])),  # of the first
        (KNIFE, at([0.0, 0.3, 0.5], [1.2, 0.1, 0.3]), PRISM, at([0, 0, 0])),  # edges
    ],
    "capsule-box": [
        (CAPSULE, at([0.1, 0.0, 0.72], [0.1, 0.2, 0.3]), BOX, at([0, 0, 0])),  # an end over a face
        (CAPSULE, at([0.05, 0.1, 0.3], [0.0, 1.6, 0.2]), BOX, at([0, 0, 0])),  # lying over both edges
        (CAPSULE, at([0.45, 0.1, 0.3], [0.2, -0.7, 0.2]), BOX, at([0, 0, 0])),  # an edge
        (CAPSULE, at([0.4, 0.6, 0.3], [0.8, 0.6, 0.1]), BOX, at([0, 0, 0])),  # a corner
    ],
    "capsules": [
        (CAPSULE, at([0.2, 0.0, 0.35], [1.4, 0.3, 0.2]), CAPSULE, at([0, 0, 0], [0.2, 0.0, 0.0])),  # crossing
        (CAPSULE, at([0.3, 0.1, 0.6], [0.3, 0.5, 0.3]), CAPSULE, at([0, 0, 0], [0.2, 0.0, 0.0])),  # an end beside
    ],
}
SINGULAR = [at([0, 0, 0]), at([0, 0, 0.5]), at([0.5, 0, 0]), at([0.3, 0.5, 0.2]), at([0, 0, 0.3], LYING)]


def turned(w):
    """Rotation by a vector of length tan(angle / 2)."""
    K = skew(w)
    return jnp.eye(3) + 2.0 / (1.0 + jnp.sum(w**2)) * (K + K @ K)


@pytest.mark.parametrize("name", REGULAR)
def test_derivatives(name):
    """Forward = reverse = difference in sizes, turns and places; finite where what touches is not unique."""

    @jax.jit
    def moved(x, pair):
        """By changes of all numbers of the shapes, then turn and place of each."""
        sizes, form = ravel_pytree([each.shape for each in pair])
        changes = x[sizes.size :].reshape(2, 2, 3)
        shapes = form(sizes + x[: sizes.size])
        poses = [
            Pose(turned(w) @ X.pose.rotation, X.pose.position + p) for (w, p), X in zip(changes, pair, strict=True)
        ]
        return [Placed(*each) for each in zip(shapes, poses, strict=True)]

    def numbers(found, library=jnp):
        return library.concatenate([found.point.reshape(-1), found.normal.reshape(-1), found.gap])

    @jax.jit
    def derivatives(pair):
        x = jnp.zeros(ravel_pytree([each.shape for each in pair])[0].size + 12)
        return [mode(lambda x: numbers(contact_manifold(*moved(x, pair))))(x) for mode in (jax.jacfwd, jax.jacrev)]

    for first, X, second, Y in REGULAR[name]:
        pair = Placed(first, X), Placed(second, Y)
        forward, reverse = map(np.asarray, derivatives(pair))
        steps = STEP * np.eye(forward.shape[1])
        sides = [[numbers(contact(*moved(e, pair)), np) for e in (step, -step)] for step in steps]
        central = np.stack([(plus - minus) / (2 * STEP) for plus, minus in sides], axis=1)
        size = max(1.0, np.max(np.abs(forward)))
        np.testing.assert_allclose(reverse, forward, rtol=0, atol=MODES_TOLERANCE * size, err_msg=f"{X}")
        np.testing.assert_allclose(central, forward, rtol=0, atol=DIFFERENCE_TOLERANCE * size, err_msg=f"{X}")
    for X in SINGULAR:
        for found in derivatives((Placed(first, X), Placed(second, at([0, 0, 0])))):
            assert np.isfinite(found).all(), X


def test_many_at_once():
    pairs = list(random_pairs(CAPSULE, CAPSULE, 5, 9, 1.0))
    many = jax.jit(jax.vmap(contact_manifold))(*jax.tree.map(lambda *each: jnp.stack(each), *pairs))
    for k, pair in enumerate(pairs):
        for found, expected in zip(jax.tree.leaves(many), jax.tree.leaves(contact(*pair)), strict=True):
            np.testing.assert_allclose(found[k], expected, atol=EXACT)


def test_single_precision():
    pair = Placed(KNIFE, at([0.1, 0.2, 0.6], [0.2, 0.1, 0.3])), Placed(PRISM, at([0.0, 0.0, 0.0], [0.1, 0.0, 0.0]))
    single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), pair)
    found, expected = contact(*single), contact(*pair)
    np.testing.assert_array_equal(found.active, expected.active)
    np.testing.assert_allclose(found.gap[found.active], expected.gap[expected.active], atol=2e-6)  # rounding
    rod = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), CAPSULE)
    for each in (found, jax.eval_shape(contact_manifold, rod, rod)):
        assert each.point.dtype == each.normal.dtype == each.gap.dtype == jnp.float32
