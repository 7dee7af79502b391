"""How well the joint torque of the contact forces is known: angles, forces and contact points propagated through it."""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.estimation._torque import body_index
from icjax.model import Model, frames, neutral, tree
from icjax.recording import Recording
from icjax.running import on_full_blocks
from icjax.typing import Bool, Float, Real

BATCH = 2048
"""Frames at once: all of a long trial would take gigabytes."""


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
    contacts = len(recording.contact_names)
    on: np.ndarray = np.asarray(np.any(recording.touching, axis=1))
    offset = recording.q_offset_covariance
    if offset is None:
        offset = np.diag(np.asarray(recording.q_offset_sd) ** 2)
    force_sd = np.zeros(contacts) if recording.contact_force_sd is None else np.asarray(recording.contact_force_sd)
    point_sd = np.zeros((len(on), contacts))
    if recording.contact_point_sd is not None:
        point_sd = np.nan_to_num(np.asarray(recording.contact_point_sd))
    found = TorqueDeviation(*(np.zeros((len(on), recording.model.nv)) for _ in range(2)))
    if not on.any():
        return found
    noise, constant = on_full_blocks(
        partial(_all_frames, recording.model, bodies, np.asarray(offset), np.nan_to_num(force_sd)),
        np.asarray(recording.q)[on],
        np.asarray(recording.q_covariance)[on],
        np.asarray(recording.contact_force)[on],
        np.asarray(recording.contact_point)[on],
        np.asarray(recording.contact_moment)[on],
        np.asarray(recording.touching)[on],
        np.asarray(recording.valid)[on],
        point_sd[on],
    )
    found.noise[on], found.offset[on] = noise, constant
    return found


@eqx.filter_jit
def _all_frames(model, bodies, offset, force_sd, *rows):
    def frame(row):
        q, covariance, force, point, moment, touching, valid, point_sd = row
        known = jnp.all(jnp.isfinite(q))
        D, G, P = torque_derivatives(model, bodies, jnp.where(known, q, neutral(model)), force, point, moment, touching)
        known &= jnp.all(jnp.isfinite(covariance))
        spread = jnp.where(known, covariance, 0.0)
        variance = jnp.sum((D @ spread) * D, axis=1)
        variance += jnp.sum(G**2, axis=2) @ jnp.where(touching, force_sd**2, 0.0)
        variance += jnp.sum(P**2, axis=2) @ jnp.where(touching, point_sd**2, 0.0)
        constant = jnp.sum((D @ offset) * D, axis=1)
        lost = jnp.any(touching) & ~(valid & known)
        # Rounding may leave a variance below zero where it is zero.
        return tuple(jnp.where(lost, jnp.nan, jnp.sqrt(jnp.maximum(item, 0.0))) for item in (variance, constant))

    return jax.lax.map(frame, rows, batch_size=BATCH)


def torque_derivatives(
    model: Model,
    bodies: tuple[int, ...],
    q: Float[Real, " coordinate"],
    force: Float[Real, "contact 3"],
    point: Float[Real, "contact 3"],
    moment: Float[Real, "contact 3"],
    touching: Bool[Real, " contact"],
) -> tuple[Float[Real, "dof dof"], Float[Real, "dof contact 3"], Float[Real, "dof contact 3"]]:
    """D, G and P of `torque_deviation`: derivatives of `contact_torque` by the coordinates, forces and points.

    With the twist t_d = (w_d, v_d) of a degree of freedom in world coordinates, W_d = (m, f) the sum of the wrenches
    about the world origin that it carries, tau_d = t_d . W_d. Where e moves the frame that carries t_d, dt_d / de is
    the cross product of the twists t_e and t_d, hence

        D_de = w_e . (w_d x m_d + v_d x f_d) + v_e . (w_d x f_d),   G_d = v_d + w_d x p,   P_d = f x w_d.
    """
    on = jnp.asarray(touching)[:, None]
    force, point, moment = (jnp.where(on, value, 0.0) for value in (force, point, moment))
    twists = frames(model, q).twists
    w, v = twists[:, :3], twists[:, 3:]
    carried = jnp.asarray(model.path_mask[np.asarray(bodies, dtype=int)], dtype=twists.dtype)
    total = carried.T @ jnp.concatenate([jnp.cross(point, force) + moment, force], axis=1)
    turned = jnp.cross(w, total[:, :3]) + jnp.cross(v, total[:, 3:])
    lever = jnp.concatenate([turned, jnp.cross(w, total[:, 3:])], axis=1)
    mask = carried.T[:, :, None]
    return (
        jnp.where(tree(model).dof_mask, lever @ twists.T, 0.0),
        mask * (v[:, None] + jnp.cross(w[:, None], point[None])),
        mask * jnp.cross(force[None], w[:, None]),
    )
