"""Friction on a free ball that its weight asks for."""

import numpy as np
import pytest

from icjax.capture import balanced_friction
from icjax.capture._ball_friction import BALANCE_SD, lifted

WEIGHT = np.array([0.0, 0.0, -0.5])
RADIUS = 0.03


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def moment(lever, force):
    return np.sum(np.cross(lever, force), axis=-2)


def test_a_pinch_carries_half_the_weight_on_each_side():
    """By symmetry; the tolerance of the balance takes 4 parts in 10 000."""
    normal = np.array([[[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    force, touching = 2.0 * normal * [[[1.0], [1.0], [0.0]]], np.array([[True, True, False]])
    lever = np.where(touching[:, :, None], RADIUS * normal, np.nan)
    found = balanced_friction(force, lever, touching, WEIGHT)
    np.testing.assert_allclose(found[0, :2, 2], -0.25, rtol=1e-3)
    np.testing.assert_allclose(found[0, :2, 0], [-2.0, 2.0], atol=1e-12)
    np.testing.assert_array_equal(found[0, 2], 0.0)
    nothing = balanced_friction(0.0 * force, lever, np.zeros((1, 3), bool), WEIGHT)
    np.testing.assert_array_equal(nothing, 0.0)


def grasps(count):
    """Three to five fingers about a ball, pressing with 1 to 4 N: true forces in balance, within the cone or not."""
    generator = np.random.default_rng(0)
    normal = unit(np.array([[-1, 0.1, 0.1], [0.8, 0.5, 0.0], [0.7, -0.7, 0.2], [0.9, 0.0, -0.3], [0.1, 1.0, 0.1]]))
    normal = unit(normal + 0.1 * generator.standard_normal((count, 5, 3)))
    size = generator.uniform(1.0, 4.0, (count, 5))
    touching = np.ones((count, 5), bool)
    touching[::2, 3] = touching[::3, 4] = False
    return np.where(touching[:, :, None], size[:, :, None] * normal, 0.0), RADIUS * normal, touching


def test_what_comes_out_balances_and_is_kept():
    force, lever, touching = grasps(60)
    found = balanced_friction(force, lever, touching, WEIGHT)
    # How far the answer leaves the balance is its tolerance, squared, over what friction can take up (1 N and more).
    tolerance = 10.0 * BALANCE_SD**2 * np.linalg.norm(found.sum(axis=1) - force.sum(axis=1), axis=1).max()
    np.testing.assert_allclose(found.sum(axis=1), np.tile(WEIGHT, (60, 1)), atol=tolerance)
    np.testing.assert_allclose(moment(lever, found) / RADIUS, 0.0, atol=tolerance)
    np.testing.assert_array_equal(found[~touching], 0.0)
    pressed, measured = (np.sum(forces * lever, axis=2) / RADIUS for forces in (found, force))
    assert np.abs(pressed - measured).max() < 0.3  # the normal part is measured: it hardly changes


def test_it_is_the_least_friction():
    """Against a general minimiser of what the docstring states, for one grasp."""
    scipy = pytest.importorskip("scipy.optimize")
    force, lever, touching = (item[1] for item in grasps(2))
    force[1:] *= 0.7
    size = np.linalg.norm(force, axis=1)
    normal = unit(force)
    held = size > 0

    def cost(change):
        change = change.reshape(5, 3)
        along = np.sum(change * normal, axis=1)
        across = change - along[:, None] * normal
        total = force + change
        off = np.concatenate([total.sum(axis=0) - WEIGHT, np.cross(lever, total).sum(axis=0) / RADIUS])
        sd = 0.05 * size + 0.02
        terms = np.sum(across**2, axis=1) / size**2 + along**2 / sd**2
        return 1e-2 * (terms.sum() + np.sum(off**2) / BALANCE_SD**2)

    assert held.all()
    best = scipy.minimize(cost, np.zeros(15), method="BFGS", options={"gtol": 1e-7, "maxiter": 2000})
    found = balanced_friction(force[None], lever[None], touching[None], WEIGHT)[0]
    np.testing.assert_allclose(found - force, best.x.reshape(5, 3), atol=1e-3)


def test_lifted_from_where_it_lay():
    height = 0.03 + np.array([0.0, 1e-4, -1e-4, 0.001, 0.002, 0.003, 0.02])
    lying = np.arange(7) < 3
    np.testing.assert_allclose(lifted(height, lying), [0, 0, 0, 0, 0.5, 1, 1], atol=1e-12)
    np.testing.assert_array_equal(lifted(height, np.zeros(7, bool)), 0.0)
