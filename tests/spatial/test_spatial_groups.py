"""Rotations, quaternions and poses: group axioms, logarithms, and agreement between the representations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from axioms import holds
from hypothesis import strategies as st

from icjax.spatial import (
    Pose,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_to_rotation,
    rotation_exp,
    rotation_log,
    rotation_to_quaternion,
    skew,
    twist_exp,
    twist_log,
)

ROUNDING = 1e-14
"""A few dozen roundings of numbers of order one."""

LOGARITHM = 1e-13
"""Rounding times the largest condition number of a logarithm away from angle pi, with positions up to 3 m."""

numbers = st.floats(-1.5, 1.5)
vectors = st.tuples(numbers, numbers, numbers).map(np.asarray)
twists = st.tuples(*[numbers] * 6).map(np.asarray)
SINGULAR = [np.zeros(3), np.asarray([1e-9, 0, 0]), np.asarray([0, 1e-5, 1e-5]), np.asarray([0.3162, 0.0, 0.005])]


def close(a, b, tolerance=ROUNDING):
    np.testing.assert_allclose(np.asarray(a), np.asarray(b), rtol=0, atol=tolerance)


@holds(twists, twists, twists)
def test_poses_form_a_group(a, b, c):
    X, Y, Z = twist_exp(a), twist_exp(b), twist_exp(c)
    yield (X @ Y) @ Z, X @ (Y @ Z)
    yield X @ X.inverse(), Pose.identity()
    yield Pose.identity() @ X, X
    yield (X @ Y).apply(c[:3]), X.apply(Y.apply(c[:3]))
    yield (X @ Y).matrix(), X.matrix() @ Y.matrix()


@holds(vectors, vectors)
def test_quaternions_double_cover_rotations(a, b):
    p, q = quaternion_exp(a), quaternion_exp(b)
    yield quaternion_to_rotation(quaternion_multiply(p, q)), rotation_exp(a) @ rotation_exp(b)
    yield quaternion_to_rotation(-p), rotation_exp(a)
    yield quaternion_to_rotation(3.0 * p), rotation_exp(a)
    yield jnp.dot(p, p), 1.0
    yield rotation_exp(a) @ rotation_exp(a).T, np.eye(3)
    yield jnp.linalg.det(rotation_exp(a)), 1.0


@holds(twists)
def test_logarithm_inverts_the_exponential(xi):
    yield twist_log(twist_exp(xi)), xi
    yield rotation_log(rotation_exp(xi[:3])), xi[:3]
    yield quaternion_log(quaternion_exp(xi[:3])), xi[:3]


@pytest.mark.parametrize("w", SINGULAR, ids=str)
def test_logarithm_keeps_small_angles_to_the_last_digit(w):
    np.testing.assert_allclose(quaternion_log(quaternion_exp(w)), w, rtol=1e-15, atol=0)
    close(rotation_log(rotation_exp(w)), w, 2e-16)


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [0, 0, 1.0], [0.6, 0, -0.8], [-0.48, 0.6, 0.64]])
@pytest.mark.parametrize("short_of_pi", [0.0, 1e-12, 1e-8, 1e-4])
def test_logarithm_near_a_half_turn(axis, short_of_pi):
    w = (np.pi - short_of_pi) * np.asarray(axis)
    R = rotation_exp(w)
    found = rotation_log(R)
    close(rotation_exp(found), R)
    close(np.linalg.norm(found), np.pi - short_of_pi)
    # At pi itself (to rounding) the axis may come out with either sign.
    sign = np.sign(np.dot(found, w)) if short_of_pi < 1e-10 else 1.0
    close(sign * found, w, LOGARITHM)


def test_the_longer_way_round_is_replaced_by_the_shorter():
    w = np.asarray([0.0, 4.0, 0.0])
    close(quaternion_log(quaternion_exp(w)), [0.0, 4.0 - 2 * np.pi, 0.0])


def test_matrices_and_quaternions_agree_with_scipy():
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(0)
    for w in rng.normal(size=(20, 3)) * 2.0:
        theirs = Rotation.from_rotvec(w)
        close(rotation_exp(w), theirs.as_matrix())
        x, y, z, scalar = theirs.as_quat(canonical=True)
        close(rotation_to_quaternion(rotation_exp(w)), [scalar, x, y, z])


@holds(twists)
def test_the_exponential_solves_its_differential_equation(xi):
    """X(t) = exp(t xi) moves with the body twist xi: dX/dt = X [xi] as 4 x 4 matrices."""
    X, dX = jax.jvp(lambda t: twist_exp(t * jnp.asarray(xi)).matrix(), (1.0,), (1.0,))
    hat = jnp.zeros((4, 4)).at[:3, :3].set(skew(xi[:3])).at[:3, 3].set(xi[3:])
    yield dX, X @ hat
