"""Dynamics of the tree in world coordinates: composite inertias, mass matrix, inverse dynamics, gravity.

All twists, wrenches and inertias are written in world coordinates about the world origin, where they add without
transformation: sums over the bodies that a joint carries are products with the path mask, and no further recursion
is needed. The price is rounding when a model stands many times its own size away from the world origin.
"""

import jax
import jax.numpy as jnp

from icjax.model._kinematics import Frames, frames
from icjax.model._model import Model
from icjax.model._tree import tree
from icjax.spatial import Pose, gamma, newton_euler, spatial_cross, spatial_inertia
from icjax.typing import Float, Real


def mass_matrix(model: Model, q: Float[Real, " nq"]) -> Float[Real, "nv nv"]:
    """Joint-space inertia matrix M(q) by composite rigid bodies, armature on the diagonal.

    M_ij = J_i^T I^c_j J_j for i on the path from j to the root, where I^c_j is the inertia of all bodies that j
    carries; the kinetic energy is v^T M v / 2.

    **Arguments**: `q` coordinates. **Returns**: `[nv, nv]`, symmetric. Source: Walker and Orin 1982; Featherstone
    2008, Section 6.2.
    """
    topology = tree(model)
    state = frames(model, q)
    mask = topology.body_mask.astype(state.twists.dtype)
    composite = jnp.einsum("bd,bij->dij", mask, _world_inertias(model, state))
    momenta = jnp.einsum("dij,dj->di", composite, state.twists)
    on_path = topology.dof_mask  # [j, i]: i is on the path of j
    half = momenta @ state.twists.T
    M = jnp.where(on_path, half, jnp.where(on_path.T, half.T, 0.0))
    return 0.5 * (M + M.T) + jnp.diag(jnp.asarray(model.armature))


def inverse_dynamics(
    model: Model, q: Float[Real, " nq"], v: Float[Real, " nv"], a: Float[Real, " nv"]
) -> Float[Real, " nv"]:
    """Generalised forces that produce the acceleration `a` (recursive Newton-Euler): M(q) a + h(q, v) + g(q).

    Every body's twist V_b = J S_b v and acceleration A_b = J S_b a + dJ/dt S_b v give its wrench by Eq. 3, which the
    twists project on the joints. A column of J is constant in the frame that carries it, hence dJ_j/dt = [V] J_j
    with V the twist of that frame. Armature adds its own inertia, on a free joint as if it moved with the body; joint
    springs and dampers are not included.

    **Arguments**: `q` coordinates; `v` velocity; `a` its time derivative, component by component (for a free joint
    the derivative of the body twist, the phidot of Eq. 3).
    **Returns**: `[nv]`, Nm and N. Source: Kry and Pai 2006, Eq. 3; Featherstone 2008, Section 5.3.
    """
    q, v, a = jnp.asarray(q), jnp.asarray(v), jnp.asarray(a)
    topology = tree(model)
    state = frames(model, q)
    moving = topology.body_mask.astype(state.twists.dtype)
    carried = topology.dof_mask.astype(state.twists.dtype)
    velocity = (carried * v[None, :]) @ state.twists  # of the frame of each degree of freedom
    twist_rate = jax.vmap(lambda V, twist: spatial_cross(V) @ twist)(velocity, state.twists)
    V = (moving * v[None, :]) @ state.twists
    A = (moving * a[None, :]) @ state.twists + (moving * v[None, :]) @ twist_rate
    A = A - jnp.concatenate([jnp.zeros(3), jnp.asarray(model.gravity)])[None, :]
    wrench = jax.vmap(newton_euler)(_world_inertias(model, state), V, A)
    return _project(state, moving, wrench) + _armature_torque(model, v, a)


def gravity_torque(model: Model, q: Float[Real, " nq"]) -> Float[Real, " nv"]:
    """Generalised forces that hold the model still against gravity: g(q) = -sum over bodies of J_c^T m_b gravity.

    **Returns**: `[nv]`, the inverse dynamics at rest: what muscles supply (Nm, N).
    """
    topology = tree(model)
    state = frames(model, q)
    bodies = state.poses[topology.body_frame]
    weight = jnp.asarray(model.body_mass)[:, None] * jnp.asarray(model.gravity)[None, :]
    com = jax.vmap(lambda X, c: X.apply(c))(bodies, jnp.asarray(model.body_com))
    wrench = jax.vmap(lambda c, f: gamma(c).T @ f)(com, -weight)
    return _project(state, topology.body_mask.astype(state.twists.dtype), wrench)


def _world_inertias(model: Model, state: Frames) -> Float[Real, "body 6 6"]:
    """Inertia of every body about the world origin, in world axes."""

    def moved(X: Pose, mass: Real, com: Real, inertia: Real) -> Real:
        R = X.rotation
        return spatial_inertia(mass, X.apply(com), R @ inertia @ R.T)

    bodies = state.poses[tree(model).body_frame]
    parts = (jnp.asarray(model.body_mass), jnp.asarray(model.body_com), jnp.asarray(model.body_inertia))
    return jax.vmap(moved)(bodies, *parts)


def _armature_torque(model: Model, v: Real, a: Real) -> Float[Real, " nv"]:
    """Armature times acceleration; the velocity of a free joint turns with the body, so there it is a_v + w x v."""
    for kind, dofs in zip(model.joint_types, model.dof_slices, strict=True):
        if kind == "free":
            a = jnp.asarray(a).at[dofs.start + 3 : dofs.stop].add(jnp.cross(v[dofs][:3], v[dofs][3:]))
    return jnp.asarray(model.armature) * a


def _project(state: Frames, mask: Real, wrench: Float[Real, "body 6"]) -> Float[Real, " dof"]:
    """Wrenches on the bodies as generalised forces: tau_j = J_j . (sum of the wrenches on the bodies j carries)."""
    return jnp.sum(state.twists * (mask.T @ wrench), axis=1)
