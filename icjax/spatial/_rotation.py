"""Rotations: matrices, rotation vectors and unit quaternions (w, x, y, z), with derivatives at the singular points."""

import jax.numpy as jnp

from icjax.spatial._series import SWITCH, TERMS, cotangent_defect, sinc, versine
from icjax.typing import Float, Matrix3, Quaternion, Real, Scalar, Vector3


def skew(p: Vector3) -> Matrix3:
    """Matrix of the cross product: `skew(p) @ x = p x x` (the [p] of Kry and Pai 2006, Section 6.1)."""
    x, y, z = p[0], p[1], p[2]
    o = jnp.zeros_like(x)
    return jnp.stack([o, -z, y, z, o, -x, -y, x, o]).reshape(3, 3)


def safe_norm(x: Float[Real, " n"]) -> Scalar:
    """Euclidean norm whose derivative at zero is zero, the subgradient of least length, instead of NaN."""
    square = jnp.sum(x * x)
    zero = square == 0.0
    return jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, square)))


def rotation_exp(w: Vector3) -> Matrix3:
    """Rotation by the vector `w` (rad): R = exp([w]) = I + sinc(a) [w] + (1 - cos a)/a^2 [w]^2, a = norm(w).

    **Arguments**: `w` axis times angle, rad. **Returns**: rotation matrix. Derivatives of every order exist at zero.
    """
    x = jnp.dot(w, w)
    W = skew(w)
    return jnp.eye(3, dtype=W.dtype) + sinc(x) * W + versine(x) * (W @ W)


def left_jacobian_inverse(w: Vector3) -> Matrix3:
    """V(w)^-1 = I - [w]/2 + (1 - (a/2) cot(a/2))/a^2 [w]^2, a = norm(w): how `w` changes when exp([w]) is turned on.

    exp([w + V^-1 d]) = exp([d]) exp([w]) to first order in d. **Arguments**: `w` rad, of length below 2 pi.
    """
    W = skew(w)
    return jnp.eye(3, dtype=W.dtype) - 0.5 * W + cotangent_defect(jnp.dot(w, w)) * (W @ W)


def rotation_log(R: Matrix3) -> Vector3:
    """Rotation vector of `R` (rad), of length at most pi: the inverse of [`rotation_exp`].

    Accurate everywhere, also near angle pi, as it goes by way of the quaternion. At angle pi exactly both w and -w
    are logarithms; one of them is returned with that branch's derivative.
    """
    return quaternion_log(rotation_to_quaternion(R))


def quaternion_to_rotation(q: Quaternion) -> Matrix3:
    """Rotation matrix of a quaternion (w, x, y, z); `q` is normalised first, and zero means no rotation.

    R = I + 2/(q.q) (w [v] + [v]^2).
    """
    square = jnp.dot(q, q)
    zero = square == 0.0
    scale = jnp.where(zero, 0.0, 2.0 / jnp.where(zero, 1.0, square))
    V = skew(q[1:])
    return jnp.eye(3, dtype=V.dtype) + scale * (q[0] * V + V @ V)


def rotation_to_quaternion(R: Matrix3) -> Quaternion:
    """Unit quaternion (w, x, y, z), w >= 0, of a rotation matrix.

    Shepperd's method: of the four expressions the one with the largest divisor is taken, which is at least 1, so
    values and derivatives are accurate at every rotation.
    """
    xx, yy, zz = R[0, 0], R[1, 1], R[2, 2]
    wx, wy, wz = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    xy, xz, yz = R[1, 0] + R[0, 1], R[0, 2] + R[2, 0], R[2, 1] + R[1, 2]
    # Row k is 4 q_k q; its diagonal entry 4 q_k^2 is largest in the chosen row.
    rows = jnp.stack(
        [
            jnp.stack([1.0 + xx + yy + zz, wx, wy, wz]),
            jnp.stack([wx, 1.0 + xx - yy - zz, xy, xz]),
            jnp.stack([wy, xy, 1.0 - xx + yy - zz, yz]),
            jnp.stack([wz, xz, yz, 1.0 - xx - yy + zz]),
        ]
    )
    k = jnp.argmax(jnp.diagonal(rows))
    q = 0.5 * rows[k] / jnp.sqrt(rows[k, k])
    return jnp.where(q[0] < 0.0, -q, q)


def quaternion_multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product; `quaternion_to_rotation(a b) = R_a R_b`."""
    w = a[0] * b[0] - jnp.dot(a[1:], b[1:])
    v = a[0] * b[1:] + b[0] * a[1:] + jnp.cross(a[1:], b[1:])
    return jnp.concatenate([w[None], v])


def quaternion_exp(w: Vector3) -> Quaternion:
    """Unit quaternion of the rotation vector `w` (rad): (cos a/2, sin(a/2)/a w), a = norm(w)."""
    x = 0.25 * jnp.dot(w, w)
    # cos(a/2) = 1 - 2 sin^2(a/4) = 1 - (a/2)^2 (1 - cos(a/2))/(a/2)^2, smooth at zero.
    return jnp.concatenate([(1.0 - x * versine(x))[None], 0.5 * sinc(x) * w])


def quaternion_log(q: Quaternion) -> Vector3:
    """Rotation vector (rad) of the quaternion `q`, by the shorter way round: length at most pi.

    w = 2 atan2(n, q_w) v / n with n = norm(v); `q` need not be normalised but must not be zero.
    """
    q = jnp.where(q[0] < 0.0, -q, q)
    scalar, vector = q[0], q[1:]
    square = jnp.dot(vector, vector)
    small = square < SWITCH * scalar * scalar / 4.0
    n = jnp.sqrt(jnp.where(small, 1.0, square))
    closed = 2.0 * jnp.arctan2(n, jnp.where(small, 1.0, scalar)) / n
    divisor = jnp.where(small, scalar, 1.0)
    ratio = jnp.where(small, square, 0.0) / (divisor * divisor)
    series = jnp.zeros_like(ratio)
    for term in reversed(range(TERMS + 2)):  # arctan(t)/t = sum (-t^2)^k / (2k + 1)
        series = (-1.0) ** term / (2 * term + 1) + series * ratio
    return jnp.where(small, 2.0 * series / divisor, closed) * vector
