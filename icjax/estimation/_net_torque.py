"""Inverse dynamics: the torque that muscles and passive tissue supply, with gravity and inertia."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.estimation._smooth_motion import smooth_motion
from icjax.estimation._torque import joint_torque
from icjax.model import inverse_dynamics, neutral
from icjax.recording import Recording
from icjax.running import on_full_blocks
from icjax.typing import Float

GAIT_CUTOFF = 6.0
"""Hz; the usual low-pass for joint angles of walking (Winter 2009; the set-up files of OpenSim's examples)."""


def net_joint_torque(recording: Recording, cutoff: float = GAIT_CUTOFF) -> Float[np.ndarray, "time dof"]:
    """Generalised forces of everything but gravity, inertia and the measured contacts, by inverse dynamics.

        tau_net = M(q) a + h(q, v) + g(q) - sum_i J_i^T f_i

    `q`, `v`, `a` are those of `smooth_motion` at `cutoff`; masses, inertias and gravity are the model's; the contact
    term is `joint_torque` at the smoothed pose. It is what muscles, ligaments and joint friction supply together, and
    its sign is that of the coordinate: positive where it would increase it. Where the person is at rest and touches
    nothing it equals the torque that holds the body up; `joint_torque` alone, the torque of the contact, has the
    opposite sign.

    With the forces of every contact known, the torque at a joint depends only on the segments beyond it; those on the
    root's side of it, and their masses, play no part. The columns of a root made of slides and hinges (or of a free
    joint) are what the measured movement and forces leave unexplained: zero for a whole body without errors.

    **Arguments**

    - `recording`: with a model whose masses are those of the person.
    - `cutoff`: Hz, of the coordinates. The acceleration amplifies what is above it.

    **Returns** `[time, dof]`, Nm (N for a slide); NaN where the pose, or a contact that touches, is unknown.

    **Errors**: `ValueError` for a cut-off that the frame rate is too low for.

    Source: Kry and Pai 2006, section 4.3 (inertia as a correction of Eq. 2); Featherstone 2008, section 5.3.
    """
    motion = smooth_motion(recording.model, recording.time, recording.q, cutoff, recording.valid)
    known = np.isfinite(motion.a).all(axis=1)
    smoothed = eqx.tree_at(lambda item: (item.q, item.valid), recording, (motion.q, known))
    body = on_full_blocks(partial(_all_frames, recording.model), motion.q, motion.v, motion.a, known)
    return np.asarray(body) - np.asarray(joint_torque(smoothed))


@eqx.filter_jit
def _all_frames(model, q, v, a, known):
    def frame(q, v, a, known):
        q, v, a = (jnp.where(known, value, safe) for value, safe in ((q, neutral(model)), (v, 0.0), (a, 0.0)))
        return jnp.where(known, inverse_dynamics(model, q, v, a), jnp.nan)

    return jax.vmap(frame)(q, v, a, known)
