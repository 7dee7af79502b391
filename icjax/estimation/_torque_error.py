"""How well the joint torque of the contact forces is known: angles, forces and contact points propagated through it."""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.estimation._torque import body_index, contact_torque
from icjax.model import integrate
from icjax.recording import Recording
from icjax.running import on_full_blocks
from icjax.typing import Float

BATCH = 256
"""Frames differentiated at once: all of a long trial would take gigabytes."""


class TorqueDeviation(NamedTuple):
    """Standard deviations of the joint torque, Nm, `[time, dof]`.

    - `noise`: what changes from frame to frame: angles, forces, contact points.
    - `offset`: what is the same in all frames: the constant offset of the joint angles.
    """

    noise: Float[np.ndarray, "time dof"]
    offset: Float[np.ndarray, "time dof"]

    @property
    def total(self) -> Float[np.ndarray, "time dof"]:
        """Both together."""
        return np.hypot(self.noise, self.offset)


def torque_deviation(recording: Recording) -> TorqueDeviation:
    """Standard deviation of `joint_torque`, first order.

    With tau = J(q)^T f at a force f that acts at a point p of the world,

        Sigma_tau = D Sigma_q D^T + sum_i (sd_f^2 G_i G_i^T + sd_p^2 P_i P_i^T),
        D = d tau / dq (f and p held),  G_i = d tau / d f_i = J_i^T,  P_i = d tau / d p_i,

    derivatives exact. Sigma_q is `q_covariance` for the noise and `q_offset_covariance` (or the squares of
    `q_offset_sd`) for the offset. Force and point count as far as the recording states their deviations
    (`contact_force_sd`, `contact_point_sd`); what is not stated, or NaN, counts as exact. The sensor's gain, inertia of
    the hand and skin are no part of it.

    **Returns** zero where nothing touches, NaN where the torque is NaN.

    **Errors**: `ValueError` for a contact that names neither a body nor a pad of the model.
    """
    bodies = tuple(body_index(recording.model, name) for name in recording.contact_bodies)
    frames, contacts = np.shape(recording.touching)
    offset = recording.q_offset_covariance
    if offset is None:
        offset = np.diag(np.asarray(recording.q_offset_sd) ** 2)
    force_sd = np.zeros(contacts) if recording.contact_force_sd is None else np.asarray(recording.contact_force_sd)
    point_sd = np.zeros((frames, contacts))
    if recording.contact_point_sd is not None:
        point_sd = np.nan_to_num(np.asarray(recording.contact_point_sd))
    noise, constant = on_full_blocks(
        partial(_all_frames, recording.model, bodies, np.asarray(offset), np.nan_to_num(force_sd)),
        recording.q,
        recording.q_covariance,
        recording.contact_force,
        recording.contact_point,
        recording.contact_moment,
        recording.touching,
        recording.valid,
        point_sd,
    )
    return TorqueDeviation(np.asarray(noise), np.asarray(constant))


@eqx.filter_jit
def _all_frames(model, bodies, offset, force_sd, q, covariance, force, point, moment, touching, valid, point_sd):
    nothing = jnp.zeros(model.nv, q.dtype), jnp.zeros_like(force[0]), jnp.zeros_like(point[0])

    def frame(q, covariance, force, point, moment, touching, valid, point_sd):
        on = touching[:, None]
        force, point, moment = (jnp.where(on, value, 0.0) for value in (force, point, moment))

        def torque(dq, df, dp):
            moved = integrate(model, q, dq)
            return contact_torque(model, bodies, moved, force + df, point + dp, moment, touching)

        D, G, P = jax.jacfwd(torque, argnums=(0, 1, 2))(*nothing)
        known = jnp.all(jnp.isfinite(covariance))
        spread = jnp.where(known, covariance, 0.0)
        variance = jnp.einsum("dv,vw,dw->d", D, spread, D)
        variance += jnp.einsum("dca,c->d", G**2, jnp.where(touching, force_sd**2, 0.0))
        variance += jnp.einsum("dca,c->d", P**2, jnp.where(touching, point_sd**2, 0.0))
        constant = jnp.einsum("dv,vw,dw->d", D, offset, D)
        lost = jnp.any(touching) & ~(valid & known & jnp.all(jnp.isfinite(q)))
        # Rounding may leave a variance below zero where it is zero.
        return tuple(jnp.where(lost, jnp.nan, jnp.sqrt(jnp.maximum(item, 0.0))) for item in (variance, constant))

    rows = (q, covariance, force, point, moment, touching, valid, point_sd)
    return jax.lax.map(lambda row: frame(*row), rows, batch_size=BATCH)
