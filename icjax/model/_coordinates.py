"""Coordinates, displacements and the velocity conventions of other programs."""

import jax.numpy as jnp

from icjax.model._model import Model
from icjax.spatial import (
    Pose,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_to_rotation,
    twist_exp,
    twist_log,
)
from icjax.typing import Float, Real


def neutral(model: Model) -> Float[Real, " nq"]:
    """Coordinates at which every joint displacement is zero: hinges and slides at `model.zero`, no rotation."""
    return jnp.asarray(model.zero)


def integrate(model: Model, q: Float[Real, " nq"], dq: Float[Real, " nv"]) -> Float[Real, " nq"]:
    """Coordinates after the displacement `dq`: the constant velocity `dq` for unit time.

    Hinge and slide q + dq; ball R exp([dq]); free X exp(dq), with dq = (angular, linear) the constant twist in body
    coordinates, so that the origin moves by R V(dq_w) dq_v (see [`icjax.spatial.twist_exp`]), along a screw.
    MuJoCo's `mj_integratePos` moves it by R dq_v, along a line; the two agree to first order.

    **Arguments**: `q` `[nq]`; `dq` `[nv]` (rad, m). **Returns**: `[nq]`.
    """
    parts = []
    for kind, coordinates, dofs in _joints(model):
        here, step = q[coordinates], dq[dofs]
        if kind == "ball":
            parts.append(quaternion_multiply(here, quaternion_exp(step)))
        elif kind == "free":
            moved = Pose(quaternion_to_rotation(here[3:]), here[:3]) @ twist_exp(step)
            parts += [moved.position, quaternion_multiply(here[3:], quaternion_exp(step[:3]))]
        else:
            parts.append(here + step)
    return _join(parts, q)


def difference(model: Model, q_from: Float[Real, " nq"], q_to: Float[Real, " nq"]) -> Float[Real, " nv"]:
    """Displacement from `q_from` to `q_to`: the dq with `integrate(model, q_from, dq) = q_to`.

    Hinge and slide q_to - q_from; ball log(R_from^T R_to); free log(X_from^-1 X_to), (angular, linear), in the body
    coordinates of `q_from`. Rotations by the shorter way round.
    """
    parts = []
    for kind, coordinates, _ in _joints(model):
        a, b = q_from[coordinates], q_to[coordinates]
        if kind == "ball":
            parts.append(quaternion_log(quaternion_multiply(_conjugate(a), b)))
        elif kind == "free":
            A = Pose(quaternion_to_rotation(a[3:]), a[:3])
            B = Pose(quaternion_to_rotation(b[3:]), b[:3])
            parts.append(twist_log(A.inverse() @ B))
        else:
            parts.append(b - a)
    return _join(parts, q_from)


def velocity_map(model: Model, q: Float[Real, " nq"]) -> Float[Real, "nv nv"]:
    """Matrix T of MuJoCo's velocities: v_mujoco = T v.

    The two agree but for free joints, where MuJoCo counts (world linear velocity of the origin, body angular
    velocity) and icjax the body twist (angular, linear): T = [[0, R], [I, 0]]. T is orthogonal, therefore also
    tau_mujoco = T tau for generalised forces, M_mujoco = T M T^T for mass matrices, J_mujoco = J T^T for Jacobians.
    """
    T = jnp.eye(model.nv, dtype=jnp.result_type(q))
    for kind, coordinates, dofs in _joints(model):
        if kind == "free":
            rotation = quaternion_to_rotation(q[coordinates][3:])
            zero = jnp.zeros_like(rotation)
            T = T.at[dofs, dofs].set(jnp.block([[zero, rotation], [jnp.eye(3, dtype=T.dtype), zero]]))
    return T


def velocity_to_mujoco(model: Model, q: Float[Real, " nq"], v: Float[Real, " nv"]) -> Float[Real, " nv"]:
    """MuJoCo's `qvel` of the velocity `v`: T v with the T of [`velocity_map`]."""
    return velocity_map(model, q) @ v


def velocity_from_mujoco(model: Model, q: Float[Real, " nq"], qvel: Float[Real, " nv"]) -> Float[Real, " nv"]:
    """Velocity of MuJoCo's `qvel`: T^T qvel with the T of [`velocity_map`]."""
    return velocity_map(model, q).T @ qvel


def acceleration_to_mujoco(
    model: Model, q: Float[Real, " nq"], v: Float[Real, " nv"], a: Float[Real, " nv"]
) -> Float[Real, " nv"]:
    """MuJoCo's `qacc` of the acceleration `a` = dv/dt: T a + dT/dt v.

    They differ as the axes of a free body turn: its linear part becomes R (a_v + omega x v), the acceleration of
    the origin in the world.
    """
    qacc = jnp.matmul(velocity_map(model, q), a)
    for kind, coordinates, dofs in _joints(model):
        if kind == "free":
            turn = quaternion_to_rotation(q[coordinates][3:]) @ jnp.cross(v[dofs][:3], v[dofs][3:])
            qacc = qacc.at[dofs.start : dofs.start + 3].add(turn)
    return qacc


def _joints(model: Model) -> list[tuple[str, slice, slice]]:
    """Kind, coordinates and degrees of freedom; neighbouring hinges and slides are taken together."""
    runs: list[tuple[str, slice, slice]] = []
    for kind, q, v in zip(model.joint_types, model.coordinate_slices, model.dof_slices, strict=True):
        kind = "scalar" if kind in ("hinge", "slide") else kind
        if runs and kind == runs[-1][0] == "scalar":
            _, first_q, first_v = runs.pop()
            q, v = slice(first_q.start, q.stop), slice(first_v.start, v.stop)
        runs.append((kind, q, v))
    return runs


def _conjugate(q: Real) -> Real:
    return jnp.concatenate([q[:1], -q[1:]])


def _join(parts: list[Real], like: Real) -> Real:
    return jnp.concatenate(parts) if parts else jnp.zeros(0, jnp.result_type(like))
