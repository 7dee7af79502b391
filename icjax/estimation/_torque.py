"""Joint torque of the measured contact forces (Eq. 2)."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.model import Model, neutral, world_jacobian
from icjax.recording import Recording
from icjax.running import on_full_blocks
from icjax.typing import Bool, Float, Int, Real

BLOCK = 2048
"""Rows of one compiled call are a multiple of this."""

BATCH = 512
"""Frames at once, so that what they need stays in the cache."""


def joint_torque(recording: Recording) -> Float[Real, "time dof"]:
    """Torque of the contact forces at every joint and frame, `tau = sum_i J_i^T f_i` (+ free moments).

    **Arguments**

    - `recording`: forces on the subject (N), free moments (Nm) and contact points (m), world axes. A contact
      counts where `touching`; elsewhere its force, point and moment are ignored, NaN or not.

    **Returns** `[time, dof]`, Nm (N for a slide; the root's columns are the wrench on a free root). Zero where
    nothing touches, NaN where something touches and the pose or the contact is unknown. A pose is unknown where
    `valid` is false, whatever finite coordinates stand there.

    **Errors**: `ValueError` for a contact that names neither a body nor a pad of the model.

    Source: Kry and Pai 2006, Eq. 2 and 4; inertia and gravity are left out, see their section 4.3.
    """
    bodies = tuple(body_index(recording.model, name) for name in recording.contact_bodies)
    return on_full_blocks(
        partial(_all_frames, recording.model, bodies),
        recording.q,
        recording.contact_force,
        recording.contact_point,
        recording.contact_moment,
        recording.touching,
        recording.valid,
        block=BLOCK,
    )


def endpoint_jacobian(
    recording: Recording, frames: Int[np.ndarray, " row"], channels: Int[np.ndarray, " row"]
) -> Float[np.ndarray, "row 3 dof"]:
    """Velocity of the contact point a unit of joint velocity, J_i of Eq. 4, at chosen frames and contact channels.

    Its rows are the torques of forces of 1 N along the world axes, so that the program of `joint_torque` serves.
    """
    count, contacts = 3 * len(frames), len(recording.contact_names)
    frames, channels = np.repeat(frames, 3), np.repeat(channels, 3)
    force = np.zeros((count, contacts, 3))
    force[np.arange(count), channels] = np.tile(np.eye(3), (count // 3, 1))
    touching = np.zeros((count, contacts), dtype=bool)
    touching[np.arange(count), channels] = True
    bodies = tuple(body_index(recording.model, name) for name in recording.contact_bodies)
    torque = on_full_blocks(
        partial(_all_frames, recording.model, bodies),
        np.asarray(recording.q)[frames],
        force,
        np.asarray(recording.contact_point)[frames],
        np.zeros_like(force),
        touching,
        np.asarray(recording.valid)[frames],
        block=len(recording.time) + -len(recording.time) % BLOCK,  # the shape that joint_torque has compiled
    )
    return np.asarray(torque).reshape(-1, 3, recording.model.nv)


def contact_torque(
    model: Model,
    bodies: tuple[int, ...],
    q: Float[Real, " coordinate"],
    force: Float[Real, "contact 3"],
    point: Float[Real, "contact 3"],
    moment: Float[Real, "contact 3"],
    touching: Bool[Real, " contact"],
) -> Float[Real, " dof"]:
    """`tau = sum_i S_i J^T Gamma(r_i)^T f_i + S_i J^T (m_i, 0)` of one frame, as in `joint_torque`.

    **Arguments**

    - `bodies`: index of the body that each contact touches.
    - `q`: coordinates of the model.
    - `force` (N), `point` (m), `moment` (free, Nm): of each contact, world axes.
    - `touching`: which contacts count.

    **Returns** `[dof]`, Nm.
    """
    on = jnp.asarray(touching)[:, None]
    # Sanitised before use, so that NaN where nothing touches reaches neither the value nor a derivative.
    force, point, moment = (jnp.where(on, value, 0.0) for value in (force, point, moment))
    known = jnp.all(jnp.isfinite(q))
    jacobian = world_jacobian(model, jnp.where(known, q, neutral(model)))
    wrench = jnp.concatenate([jnp.cross(point, force) + moment, force], axis=1)
    paths = jnp.asarray(model.path_mask[np.asarray(bodies, dtype=int)], dtype=jacobian.dtype)
    torque = jnp.sum(paths * (wrench @ jacobian), axis=0)
    return jnp.where(known | ~jnp.any(on), torque, jnp.nan)


@eqx.filter_jit
def _all_frames(model, bodies, q, force, point, moment, touching, valid):
    def frame(valid, *columns):
        return jnp.where(valid | ~jnp.any(columns[-1]), contact_torque(model, bodies, *columns), jnp.nan)

    return jax.lax.map(lambda row: frame(*row), (valid, q, force, point, moment, touching), batch_size=BATCH)


def body_index(model: Model, name: str) -> int:
    """Body of that name, or the one that carries the pad of that name."""
    if name in model.body_names:
        return model.body(name)
    if name in model.pad_names:
        return model.pad_bodies[model.pad(name)]
    known = ", ".join((*model.body_names, *model.pad_names))
    raise ValueError(f"contact_bodies: {name!r} is neither a body nor a pad of the model; it has {known}")
