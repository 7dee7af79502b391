"""Spatial vectors (angular, linear): adjoint, Gamma, cross product, inertia and the Newton-Euler equation.

All of Section 6.1 of Kry and Pai 2006. A twist is phi = (omega, v), v the velocity of the body's point at the origin;
a wrench is w = (torque about the origin, force). Power is their dot product.
"""

import jax.numpy as jnp

from icjax.spatial._pose import Pose
from icjax.spatial._rotation import skew
from icjax.typing import Float, Matrix3, Matrix6, Real, Scalar, Vector3, Vector6


def adjoint(X: Pose) -> Matrix6:
    """Adjoint of `X_ji`, which takes twists from frame i to frame j: phi_j = Ad phi_i.

    Ad = [[Theta, 0], [[p] Theta, Theta]]. Source: Kry and Pai 2006, Section 6.1.
    """
    zero = jnp.zeros_like(X.rotation)
    return jnp.block([[X.rotation, zero], [skew(X.position) @ X.rotation, X.rotation]])


def wrench_adjoint(X: Pose) -> Matrix6:
    """Matrix of `X_ji` that takes wrenches from frame i to frame j: w_j = Ad^-T w_i.

    Ad^-T = [[Theta, [p] Theta], [0, Theta]]. Section 6.1 prints Ad^T where its prose says inverse transpose; power
    invariance, phi_j . w_j = phi_i . w_i, decides for the prose.
    """
    zero = jnp.zeros_like(X.rotation)
    return jnp.block([[X.rotation, skew(X.position) @ X.rotation], [zero, X.rotation]])


def gamma(r: Vector3) -> Float[Real, "3 6"]:
    """Gamma(r) = ([-r] I): velocity of the point at `r` from a twist; its transpose makes a wrench of a force at `r`.

    **Arguments**: `r` m, in the frame of the twist. Source: Kry and Pai 2006, Section 6.1.
    """
    S = skew(r)
    return jnp.concatenate([-S, jnp.eye(3, dtype=S.dtype)], axis=1)


def spatial_cross(phi: Vector6) -> Matrix6:
    """Spatial cross product [phi] = [[[omega], 0], [[v], [omega]]]: the rate of a twist carried along by `phi`.

    Source: Kry and Pai 2006, Section 6.1.
    """
    W, V = skew(phi[:3]), skew(phi[3:])
    return jnp.block([[W, jnp.zeros_like(W)], [V, W]])


def spatial_inertia(mass: Scalar | float, com: Vector3, inertia_about_com: Matrix3) -> Matrix6:
    """Inertia matrix M of a rigid body about the frame's origin: momentum = M phi.

    M = [[I_c + m [c] [c]^T, m [c]], [m [c]^T, m I]].

    **Arguments**: `mass` kg; `com` c, m; `inertia_about_com` I_c, kg m2, in the axes of the frame.
    """
    C = skew(com)
    return jnp.block([[inertia_about_com + mass * (C @ C.T), mass * C], [mass * C.T, mass * jnp.eye(3, dtype=C.dtype)]])


def newton_euler(M: Matrix6, phi: Vector6, phidot: Vector6) -> Vector6:
    """Wrench that moves a rigid body: w = M phidot - [phi]^T M phi, everything in body coordinates.

    **Arguments**: `M` inertia; `phi` body twist (rad/s, m/s); `phidot` its time derivative, component by component.
    **Returns**: wrench (Nm, N). Source: Kry and Pai 2006, Eq. 3.
    """
    return M @ phidot - spatial_cross(phi).T @ (M @ phi)
