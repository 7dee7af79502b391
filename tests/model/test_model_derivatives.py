"""Derivatives with respect to coordinates and to the model's own numbers; compiled = eager; batched = loop."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from derivatives import check_derivatives
from random_trees import random_tree

from icjax.model import (
    difference,
    forward_kinematics,
    gravity_torque,
    index_finger,
    integrate,
    inverse_dynamics,
    load_model,
    mass_matrix,
    neutral,
    pad_positions,
    point_jacobian,
    site_positions,
    world_jacobian,
)

ROUNDING = 1e-13
"""A hundred roundings of numbers of order one."""

MODEL = load_model(random_tree(7))  # free, ball, slide and hinge joints, branches
RNG = np.random.default_rng(5)
Q = np.asarray(integrate(MODEL, neutral(MODEL), RNG.normal(size=MODEL.nv)))
V, A = RNG.normal(size=(2, MODEL.nv))
TIP = len(MODEL.body_names) - 1


def everything(model, q, v, a):
    """All functions of the room in one vector, weighted equally."""
    poses = forward_kinematics(model, q)
    point = poses[TIP].apply(jnp.asarray([0.1, 0.2, 0.3]))
    parts = (
        poses.rotation,
        poses.position,
        site_positions(model, q),
        point_jacobian(model, q, TIP, point),
        mass_matrix(model, q),
        inverse_dynamics(model, q, v, a),
        gravity_torque(model, q),
    )
    return jnp.concatenate([part.ravel() for part in parts])


NUMBERS = ("body_position", "body_mass", "body_com", "joint_position", "joint_axis", "armature", "site_position")


@pytest.mark.slow
def test_coordinates_velocities_and_numbers_of_the_model():
    """At the neutral pose all rotation vectors are zero, the singular point of the exponential map. Lengths, anchors,
    masses, inertias and armature are differentiable leaves."""
    n = MODEL.nv
    leaves = [np.asarray(getattr(MODEL, name)) for name in NUMBERS]
    splits = np.cumsum([leaf.size for leaf in leaves])[:-1]
    x = np.concatenate([np.zeros(n), V, A, *(leaf.ravel() for leaf in leaves)])

    def function(x, q):
        pieces = zip(NUMBERS, jnp.split(x[3 * n :], splits), leaves, strict=True)
        model = dataclasses.replace(MODEL, **{name: piece.reshape(leaf.shape) for name, piece, leaf in pieces})
        return everything(model, integrate(model, q, x[:n]), x[n : 2 * n], x[2 * n : 3 * n])

    check_derivatives(function, (x, Q), (x, np.asarray(neutral(MODEL))), tolerance=1e-7)  # sums of many large terms


def test_the_jacobian_is_the_derivative_of_the_point():
    """Eq. 4 against the derivative along integrate, where q is neutral and where it is not."""

    def point(dq, q):
        return forward_kinematics(MODEL, integrate(MODEL, q, dq))[TIP].apply(jnp.asarray([0.1, 0.2, 0.3]))

    @jax.jit
    def both(q):
        rest = jnp.zeros(MODEL.nv)
        return point_jacobian(MODEL, q, TIP, point(rest, q)), jax.jacfwd(point)(rest, q)

    for q in (Q, np.asarray(neutral(MODEL))):
        J, derivative = both(q)
        np.testing.assert_allclose(J, derivative, rtol=0, atol=ROUNDING)


def test_difference_inverts_integrate_and_both_have_derivatives_at_zero():
    dq = 0.5 * RNG.normal(size=MODEL.nv)
    np.testing.assert_allclose(difference(MODEL, Q, integrate(MODEL, Q, dq)), dq, rtol=0, atol=ROUNDING)
    points = np.zeros(MODEL.nv), dq
    check_derivatives(lambda x: integrate(MODEL, Q, x), *points)
    check_derivatives(lambda x: difference(MODEL, Q, integrate(MODEL, Q, x)), *points)


def test_mass_matrix_and_inverse_dynamics_agree():
    """M is the derivative of the inverse dynamics with respect to acceleration, and symmetric positive definite."""
    M = jax.jit(lambda: mass_matrix(MODEL, Q))()
    slope = jax.jit(jax.jacfwd(lambda a: inverse_dynamics(MODEL, Q, V, a)))(A)
    np.testing.assert_allclose(slope, M, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(M, M.T)
    assert np.linalg.eigvalsh(M).min() > 0
    rest = np.zeros(MODEL.nv)
    np.testing.assert_allclose(inverse_dynamics(MODEL, Q, rest, rest), gravity_torque(MODEL, Q), rtol=0, atol=1e-12)


def test_compiled_is_eager_and_batched_is_a_loop():
    batch = np.stack([np.asarray(integrate(MODEL, Q, 0.1 * k * V)) for k in range(3)])
    loop = np.stack([everything(MODEL, q, V, A) for q in batch])
    batched = jax.jit(jax.vmap(lambda q: everything(MODEL, q, V, A)))(batch)
    np.testing.assert_allclose(batched, loop, rtol=0, atol=1e-12)  # forces up to a hundred


def test_single_precision_stays_single():
    model = jax.tree.map(lambda leaf: np.asarray(leaf, np.float32), index_finger())
    q = np.asarray(neutral(model))
    everything = jax.jit(
        lambda: (
            world_jacobian(model, q),
            pad_positions(model, q),
            mass_matrix(model, q),
            gravity_torque(model, q),
            difference(model, q, q),
            point_jacobian(model, q, 2, np.zeros(3, np.float32)),
        )
    )
    assert all(value.dtype == np.float32 for value in everything())


def test_a_model_without_joints_stands_still():
    model = load_model('<mujoco><worldbody><body pos="1 2 3"><geom size="1"/></body></worldbody></mujoco>')
    np.testing.assert_array_equal(forward_kinematics(model, neutral(model)).position[1], [1, 2, 3])
    assert world_jacobian(model, neutral(model)).shape == (6, 0)
    assert mass_matrix(model, neutral(model)).shape == (0, 0)
