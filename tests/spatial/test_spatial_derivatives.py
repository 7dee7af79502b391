"""Derivatives of every function of `spatial`, also exactly at the points where naive formulas give NaN."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from derivatives import check_derivatives

from icjax.spatial import (
    Pose,
    adjoint,
    gamma,
    left_jacobian_inverse,
    newton_euler,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_to_rotation,
    rotation_exp,
    rotation_log,
    rotation_to_quaternion,
    safe_norm,
    skew,
    spatial_cross,
    spatial_inertia,
    twist_exp,
    twist_log,
    wrench_adjoint,
)

ZERO = np.zeros(3)
REGULAR = np.asarray([0.4, -1.1, 0.7])
SWITCH = np.sqrt(0.1) * np.asarray([0.6, 0.0, 0.8])
HALF_TURN = np.pi * np.asarray([0.6, 0.0, 0.8])
V = np.asarray([0.3, -0.2, 0.5])
SPATIAL = np.concatenate([REGULAR, V])
INERTIA = spatial_inertia(1.3, V, np.diag([0.2, 0.3, 0.4]))

POINTS = {"zero": ZERO, "regular": REGULAR, "series": 1e-4 * REGULAR, "switch": SWITCH, "half_turn": HALF_TURN}


def with_position(w):
    return jnp.concatenate([jnp.asarray(w), jnp.asarray(V)])


def test_exponentials():
    points = POINTS.values()
    check_derivatives(lambda w: jnp.concatenate([rotation_exp(w).ravel(), quaternion_exp(w)]), *points)
    check_derivatives(lambda xi: twist_exp(xi).matrix(), *map(with_position, points))


def test_logarithms():
    """At a half turn they jump; see below."""
    points = [w for name, w in POINTS.items() if name != "half_turn"]
    bases = [rotation_exp(w) for w in points]
    turned = [(ZERO, base) for base in bases]
    check_derivatives(lambda d, base: rotation_log(base @ rotation_exp(d)), *turned)
    check_derivatives(lambda d, base: rotation_to_quaternion(base @ rotation_exp(d)), *turned)
    check_derivatives(quaternion_log, *map(quaternion_exp, points))
    moved = [(np.zeros(6), twist_exp(with_position(w))) for w in points]
    check_derivatives(lambda d, pose: twist_log(pose @ twist_exp(d)), *moved)


@pytest.mark.parametrize("axis", np.eye(3))
def test_logarithm_at_a_half_turn_is_that_of_one_branch(axis):
    """The logarithm jumps at pi, so one-sided: its derivative equals the one just short of pi."""

    def at(angle):
        base = rotation_exp(angle * jnp.asarray(axis))
        return jax.jacfwd(lambda d: rotation_log(base @ rotation_exp(d)))(jnp.zeros(3))

    exact, before = at(np.pi), at(np.pi - 1e-6)
    assert np.isfinite(exact).all()
    # The transverse part changes with the angle at a rate of about one, and its sign of rotation with the branch.
    assert min(np.abs(exact - before).max(), np.abs(exact - before.T).max()) < 1e-5


def test_conversion_of_quaternions():
    check_derivatives(quaternion_to_rotation, np.asarray([0.5, -0.3, 0.9, 0.1]))
    check_derivatives(lambda q: quaternion_multiply(q, q), np.asarray([0.5, -0.3, 0.9, 0.1]))


def test_zero_quaternion_and_zero_norm_have_finite_derivatives():
    for function, x in ((quaternion_to_rotation, np.zeros(4)), (safe_norm, np.zeros(5))):
        x = jnp.asarray(x)
        assert np.isfinite(function(x)).all()
        for mode in (jax.jacfwd, jax.jacrev):
            np.testing.assert_array_equal(jax.jit(mode(function))(x), 0.0)
    check_derivatives(safe_norm, REGULAR)


def test_spatial_algebra():
    def everything(xi):
        X, V = twist_exp(xi), xi[3:]
        parts = (
            adjoint(X),
            wrench_adjoint(X),
            X.inverse().apply(xi[:3]),
            gamma(V),
            skew(V),
            left_jacobian_inverse(xi[:3]),
            spatial_cross(xi),
            spatial_inertia(1.3, V, jnp.eye(3)),
            newton_euler(INERTIA, xi, 2.0 * xi),
        )
        return jnp.concatenate([part.ravel() for part in parts])

    check_derivatives(everything, SPATIAL, np.zeros(6))


def test_left_jacobian_inverse_says_how_the_vector_changes():
    """log(exp(d) exp(w)) = w + V^-1 d to first order."""
    for w in (ZERO, REGULAR, SWITCH):
        exact = jax.jit(jax.jacfwd(lambda d, w=w: rotation_log(rotation_exp(d) @ rotation_exp(w))))(ZERO)
        np.testing.assert_allclose(left_jacobian_inverse(w), exact, rtol=0, atol=1e-13)


def test_second_derivative_at_the_identity():
    """R = I + [w] + [w]^2 / 2 + ...: the Hessian of R_00 = 1 - (y^2 + z^2) / 2."""
    hessian = jax.jacfwd(jax.jacrev(lambda w: rotation_exp(w)[0, 0]))(jnp.zeros(3))
    np.testing.assert_allclose(hessian, np.diag([0.0, -1.0, -1.0]), atol=1e-15)


def test_batches_and_compiled_code_give_the_same():
    xi = np.random.default_rng(1).normal(size=(7, 6))
    xi[0] = 0.0
    loop = np.stack([twist_log(twist_exp(x)) for x in xi])
    batched = jax.jit(jax.vmap(lambda x: twist_log(twist_exp(x))))(xi)
    np.testing.assert_allclose(batched, loop, rtol=0, atol=1e-14)  # compiled code may fuse multiply and add


def test_single_precision_stays_single():
    xi = np.linspace(-0.4, 0.6, 6, dtype=np.float32)
    X = twist_exp(xi)
    for value in (X.rotation, twist_log(X), adjoint(X), rotation_to_quaternion(X.rotation), gamma(xi[:3])):
        assert value.dtype == np.float32
    np.testing.assert_allclose(twist_log(X), xi, atol=5e-7)  # a few units in the last place of float32


def test_a_pose_of_the_wrong_shape_is_refused():
    with pytest.raises(TypeError):
        Pose(np.eye(2), np.zeros(3))
