"""Inertia along a contact: derivatives of the inverse dynamics of every segment that a fitted joint moves."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.estimation import Motion as SmoothMotion
from icjax.fit._windows import Motion
from icjax.model import Model, integrate, inverse_dynamics, neutral
from icjax.running import on_full_blocks
from icjax.typing import Float, Real

INERTIA_EVERY = 0.024
"""s between the frames at which inertia is computed; posture changes little in that time, between them it is linear."""

MOST_SEGMENTS = 6
"""Above this many moving segments one common factor scales all masses."""


def linear_inertia(
    model: Model,
    groups: np.ndarray,
    dofs: tuple[int, ...],
    q: Real,
    v: Real,
    a: Real,
    by: tuple[int, ...] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives of the inverse dynamics by angle, velocity and acceleration, for every group of bodies alone.

    The torque of a movement is linear in the masses, ID = sum_g s_g ID_g, so its derivatives are too. With e the
    deviation from the contact-free movement, ID(q) - ID(q - e) = A2 e'' + A1 e' + A0 e to first order: the mass matrix,
    Coriolis and gravity terms.

    **Arguments**: `groups` [body], -1 for bodies that no fitted joint moves; `q`, `v`, `a` `[time, ...]`; `by` degrees
    of freedom by which is differentiated, default `dofs`.

    **Returns** A0, A1, A2 `[time, group, dof, by]`. Source: Kry and Pai 2006, Eq. 3.
    """
    count = int(groups.max()) + 1
    masks = np.stack([groups == group for group in range(count)]).astype(float)
    by = tuple(dofs) if by is None else tuple(by)
    A0, A1, A2 = _derivatives(model, tuple(dofs), by, jnp.asarray(masks), *(jnp.asarray(x) for x in (q, v, a)))
    return np.asarray(A0), np.asarray(A1), np.asarray(A2)


@eqx.filter_jit
def _derivatives(model: Model, dofs: tuple[int, ...], by: tuple[int, ...], masks, q, v, a):
    rows = np.asarray(dofs)
    into = jnp.zeros((len(by), model.nv)).at[np.arange(len(by)), np.asarray(by)].set(1.0)

    def at(frame):
        q, v, a = frame

        def group(mask):
            part = eqx.tree_at(
                lambda m: (m.body_mass, m.body_inertia, m.armature),
                model,
                (
                    mask * jnp.asarray(model.body_mass),
                    mask[:, None, None] * jnp.asarray(model.body_inertia),
                    jnp.zeros(model.nv),
                ),
            )

            def torque(x):
                dq, dv, da = x @ into
                return inverse_dynamics(part, integrate(part, q, dq), v + dv, a + da)[rows]

            return jnp.moveaxis(jax.jacfwd(torque)(jnp.zeros((3, len(by)))), 1, 0)

        return jnp.moveaxis(jax.vmap(group)(masks), 1, 0)

    return tuple(jnp.moveaxis(jax.lax.map(at, (q, v, a), batch_size=64), 1, 0))


def segment_groups(model: Model, dofs: tuple[int, ...]) -> tuple[np.ndarray, tuple[str, ...]]:
    """For every body the number of the mass factor that scales it, and the factors' names.

    **Errors**: `ValueError` where no joint moves a mass.
    """
    moved: np.ndarray = np.asarray(np.any(model.path_mask[:, list(dofs)], axis=1))
    moved = moved & (np.asarray(model.body_mass) > 0)
    if not moved.any():
        raise ValueError(f"model {model.name!r}: no body that its compliant joints move has a mass")
    groups = np.full(len(model.body_names), -1)
    if moved.sum() > MOST_SEGMENTS:
        groups[moved] = 0
        return groups, ("all segments",)
    groups[moved] = np.arange(moved.sum())
    return groups, tuple(model.body_names[body] for body in np.flatnonzero(moved))


def inertia_along(
    motion: Motion, movement: SmoothMotion, groups: np.ndarray, frames: np.ndarray, by: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A0, A1, A2 of `linear_inertia` at frames of a recording, linear between every `INERTIA_EVERY` s."""
    stride = max(1, round(INERTIA_EVERY * motion.recording.rate))
    coarse = np.unique(np.append(np.arange(0, len(frames), stride), len(frames) - 1))
    q, v, a = (np.asarray(x)[frames[coarse]] for x in movement)
    lost: np.ndarray = np.asarray(np.any(np.isnan(np.concatenate([q, v, a], axis=1)), axis=1))
    q = np.where(lost[:, None], np.asarray(neutral(motion.recording.model))[None], q)
    v, a = (np.where(lost[:, None], 0.0, x) for x in (v, a))
    A0, A1, A2 = on_full_blocks(
        partial(linear_inertia, motion.recording.model, groups, motion.dofs, by=by), q, v, a, block=16
    )
    count = len(frames)
    return _between(coarse, A0, count), _between(coarse, A1, count), _between(coarse, A2, count)


def _between(coarse: np.ndarray, values: np.ndarray, count: int) -> Float[np.ndarray, "time ..."]:
    """Linear interpolation along the first axis."""
    from scipy.interpolate import make_interp_spline

    if len(coarse) < 2:
        return np.repeat(values, count, axis=0)
    return make_interp_spline(coarse, values, k=1)(np.arange(count))
