"""From a contact problem to the linear complementarity problem of Section 7.1.3."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from icjax.contact._cone import tangents
from icjax.contact._local import LocalProblem, localised
from icjax.contact._problem import ContactProblem
from icjax.typing import Bool, Float, Real


def assemble(problem: ContactProblem, facets: int) -> tuple[Float[Real, "n n"], Float[Real, " n"]]:
    """The matrices of the contact LCP in ``z = (beta, lambda, limit forces)``, of size ``n = N (2m + 2) + R``.

        [ D^T W D  -E^T ] [beta  ]   [ s + D^T du_free ]   [nu   ]
        [ F         0   ] [lambda] + [ 0               ] = [sigma]   perpendicular to [beta; lambda] >= 0

    All beta come first, contact after contact, the normal first in each; then the lambda; then the limits, coupled by W
    to each other and to the beta. The rows and columns of a masked slot are replaced by those of the identity with
    q = 1, whose solution is zero.

    **Arguments**: `problem`; `facets` the number m of opposite tangent pairs.

    **Returns**: M `[n, n]` and q `[n]`.

    **Errors**: `ValueError` for shapes that do not agree, fewer than two facets, or a negative friction coefficient
    (where it is a concrete number).

    **Source**: Kry and Pai (2006), Section 7.1.3, with ``G - U_phi`` written as W.
    """
    check(problem)
    return assembled(localised(masked(problem)), facets)


def assembled(local: LocalProblem, facets: int) -> tuple[Float[Real, "n n"], Float[Real, " n"]]:
    """M and q of a problem in its contact frames, where the directions D are the same for all contacts."""
    count, limits = local.contacts, local.limit_active.shape[0]
    size = 2 * facets + 1
    dtype = local.offset.dtype
    directions = np.zeros((3, size))
    directions[0, 0], directions[1:, 1:] = 1.0, tangents(facets).T

    def spread(rows):
        """D^T of the rows of the contacts, those of the limits as they are."""
        contacts = rows[: 3 * count].reshape(count, 3, rows.shape[1])
        turned = jnp.einsum("aj,iak->ijk", jnp.asarray(directions, dtype), contacts, precision="highest")
        turned = turned.reshape(count * size, rows.shape[1])
        return jnp.concatenate([turned, rows[3 * count :]]) if limits else turned

    DWD = spread(spread(local.coupling).T).T
    s = spread(local.offset[:, None])[:, 0]
    diagonal = jnp.eye(count, dtype=dtype)
    ones = np.concatenate([[0.0], np.ones(2 * facets)])
    E = (diagonal[:, :, None] * jnp.asarray(-ones, dtype)[None, None, :]).reshape(count, count * size)
    first = jnp.asarray(1.0 - ones, dtype)[None, :] * local.friction[:, None]
    F = (diagonal[:, :, None] * (first - jnp.asarray(ones, dtype)[None, :])[:, None, :]).reshape(count, count * size)
    betas = count * size
    M = jnp.block([[DWD[:betas, :betas], -E.T], [F, jnp.zeros_like(diagonal)]])
    if limits:
        beside = jnp.concatenate([DWD[:betas, betas:], jnp.zeros((count, limits), dtype)])
        below = jnp.concatenate([DWD[betas:, :betas], jnp.zeros((limits, count), dtype)], axis=1)
        M = jnp.block([[M, beside], [below, DWD[betas:, betas:]]])
    q = jnp.concatenate([s[:betas], jnp.zeros(count, dtype), s[betas:]])
    live = jnp.concatenate([jnp.repeat(local.active, size), local.active, local.limit_active])
    M = jnp.where(live[:, None] & live[None, :], M, jnp.eye(M.shape[0], dtype=dtype))
    return M, jnp.where(live, q, 1.0)


def masked(problem: ContactProblem) -> ContactProblem:
    """The problem with harmless numbers in its masked slots, before anything is computed with them."""
    active = jnp.asarray(problem.active)
    dtype = jnp.result_type(problem.coupling, problem.free_displacement, problem.gap, problem.frames)
    limit_gap = jnp.asarray(problem.limit_gap, dtype)
    wide = jnp.concatenate([jnp.repeat(active, 3), limit_gap != jnp.inf])
    return ContactProblem(
        coupling=jnp.where(wide[:, None] & wide[None, :], jnp.asarray(problem.coupling, dtype), 0.0),
        free_displacement=jnp.where(wide, jnp.asarray(problem.free_displacement, dtype), 0.0),
        gap=jnp.where(active, jnp.asarray(problem.gap, dtype), 0.0),
        frames=jnp.where(active[:, None, None], jnp.asarray(problem.frames, dtype), jnp.eye(3, dtype=dtype)[None]),
        friction=jnp.where(active, jnp.asarray(problem.friction, dtype), 0.0),
        active=active,
        limit_gap=limit_gap,
    )


def sound(problem: ContactProblem) -> tuple[ContactProblem, Bool[Real, ""]]:
    """A masked problem as it is, or zeros in place of NaN, infinite numbers or negative friction; and which it is."""
    limit_gap = jnp.where(problem.limit_gap == jnp.inf, 0.0, problem.limit_gap)
    numbers = (problem.coupling, problem.free_displacement, problem.gap, problem.frames, problem.friction, limit_gap)
    valid = jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in numbers])) & ~jnp.any(problem.friction < 0)
    safe = jax.tree.map(lambda x: x if x.dtype == bool else jnp.where(valid, x, jnp.zeros_like(x)), problem)
    frames = jnp.where(valid, problem.frames, jnp.eye(3, dtype=problem.frames.dtype)[None])
    return dataclasses.replace(safe, frames=frames), valid


def check(problem: ContactProblem) -> None:
    """Raises `TypeError` for what is no array, `ValueError` for shapes that do not agree and, where the numbers are
    known, for negative friction and frames that are not orthonormal."""
    for field in dataclasses.fields(problem):
        if not hasattr(getattr(problem, field.name), "dtype"):
            raise TypeError(f"{field.name} must be an array; got {type(getattr(problem, field.name)).__name__}")
    if problem.active.dtype != bool:
        raise TypeError(f"active must be bool; got {problem.active.dtype}")
    count, limits = np.size(problem.gap), np.size(problem.limit_gap)
    size = 3 * count + limits
    wanted = {
        "coupling": (size, size),
        "free_displacement": (size,),
        "gap": (count,),
        "frames": (count, 3, 3),
        "friction": (count,),
        "active": (count,),
        "limit_gap": (limits,),
    }
    for name, shape in wanted.items():
        found = np.shape(getattr(problem, name))
        if found != shape:
            of = f"{count} contacts (gap) and {limits} limits (limit_gap)"
            raise ValueError(f"{name} must have shape {shape} for {of}; got {found}")
    if any(isinstance(x, Tracer) for x in (problem.friction, problem.active, problem.frames)):
        return
    active = np.asarray(problem.active)
    friction = np.where(active, np.asarray(problem.friction), 0.0)
    if np.any(friction < 0):
        raise ValueError(f"friction must not be negative; got {float(np.min(friction))}")
    frames = np.where(active[:, None, None], np.asarray(problem.frames, float), np.eye(3)[None])
    off = np.max(np.abs(np.swapaxes(frames, 1, 2) @ frames - np.eye(3)[None]), axis=(1, 2), initial=0.0)
    if np.any(off > 1e-4):
        i = int(np.argmax(off > 1e-4))
        raise ValueError(f"frames must be orthonormal (columns normal, tangent 1, tangent 2); frames[{i}] is not")
