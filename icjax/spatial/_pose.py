"""Poses: a rotation and a position, the 4 x 4 matrix E of the paper kept as its two parts."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from icjax.spatial._rotation import left_jacobian_inverse, rotation_exp, rotation_log, skew
from icjax.spatial._series import sine_excess, versine
from icjax.typing import Float, Real, Vector3, Vector6


class Pose(eqx.Module):
    """Pose `X_WB` of a frame B in a frame W: `p_W = rotation p_B + position` (Kry and Pai 2006, Section 6.1).

    `X_WB @ X_BC` composes, `X_WB[i]` takes one of a batch; all other methods are for one pose (`vmap` for batches).

    **Fields**: `rotation` from B to W, `position` of the origin of B in W, m.
    """

    rotation: Float[Real, "*batch 3 3"]
    position: Float[Real, "*batch 3"]

    @staticmethod
    def identity() -> "Pose":
        """The pose of a frame in itself."""
        return Pose(jnp.eye(3), jnp.zeros(3))

    def __matmul__(self, other: "Pose") -> "Pose":
        return Pose(self.rotation @ other.rotation, self.rotation @ other.position + self.position)

    def __getitem__(self, index: Any) -> "Pose":
        return Pose(self.rotation[index], self.position[index])

    def inverse(self) -> "Pose":
        """`X_BW` of `X_WB`."""
        return Pose(self.rotation.T, -(self.rotation.T @ self.position))

    def apply(self, p: Vector3) -> Vector3:
        """Coordinates in W of the point that has coordinates `p` in B, m."""
        return self.rotation @ p + self.position

    def matrix(self) -> Float[Real, "4 4"]:
        """Homogeneous matrix E = [[rotation, position], [0, 1]]."""
        top = jnp.concatenate([self.rotation, self.position[:, None]], axis=1)
        return jnp.concatenate([top, jnp.asarray([[0.0, 0.0, 0.0, 1.0]], dtype=top.dtype)])


def twist_exp(xi: Vector6) -> Pose:
    """Pose reached from the identity by moving for unit time with the constant body twist `xi` = (angular, linear).

    rotation = exp([w]), position = V(w) v with V = I + (1 - cos a)/a^2 [w] + (a - sin a)/a^3 [w]^2, a = norm(w).

    **Arguments**: `xi` (rad, m). **Returns**: the pose. Derivatives of every order exist at zero.
    """
    w, v = xi[:3], xi[3:]
    x = jnp.dot(w, w)
    W = skew(w)
    V = jnp.eye(3, dtype=W.dtype) + versine(x) * W + sine_excess(x) * (W @ W)
    return Pose(rotation_exp(w), V @ v)


def twist_log(X: Pose) -> Vector6:
    """Twist (angular, linear) whose exponential is `X`; rotation angle at most pi. Inverse of [`twist_exp`].

    The linear part is V(w)^-1 p, see [`left_jacobian_inverse`].
    """
    w = rotation_log(X.rotation)
    return jnp.concatenate([w, left_jacobian_inverse(w) @ X.position])
