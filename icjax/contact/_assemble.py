"""From a contact problem to the linear complementarity problem of Section 7.1.3."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from icjax.contact._cone import friction_cone
from icjax.contact._problem import ContactProblem
from icjax.typing import Float, Real


def assemble(problem: ContactProblem, facets: int) -> tuple[Float[Real, "n n"], Float[Real, " n"]]:
    """The matrices of the contact LCP in ``z = (beta, lambda)``, of size ``n = N (2m + 2)``.

        [ D^T W D  -E^T ] [beta  ]   [ s + D^T du_free ]   [nu   ]
        [ F         0   ] [lambda] + [ 0               ] = [sigma]   perpendicular to [beta; lambda] >= 0

    All beta come first, contact after contact, the normal first in each; then the lambda. The rows and columns of a
    masked slot are replaced by those of the identity with q = 1, whose solution is zero.

    **Arguments**: `problem`; `facets` the number m of opposite tangent pairs.

    **Returns**: M `[n, n]` and q `[n]`.

    **Errors**: `ValueError` for shapes that do not agree, fewer than two facets, or a negative friction coefficient
    (where it is a concrete number).

    **Source**: Kry and Pai (2006), Section 7.1.3, with ``G - U_phi`` written as W.
    """
    check(problem)
    problem = masked(problem)
    count = problem.gap.shape[0]
    size = 2 * facets + 1
    cone = friction_cone(problem.frames, problem.friction, facets)
    coupling = problem.coupling.reshape(count, 3, count, 3)
    high = jax.lax.Precision.HIGHEST
    DWD = jnp.einsum("iaj,iakb,kbl->ijkl", cone.D, coupling, cone.D, precision=high)
    s = jnp.einsum("iaj,ia->ij", cone.D, problem.free_displacement.reshape(count, 3), precision=high)
    s = s.at[:, 0].add(problem.gap)
    diagonal = jnp.eye(count, dtype=DWD.dtype)
    E = (diagonal[:, :, None] * cone.E[:, None, :]).reshape(count, count * size)
    F = (diagonal[:, :, None] * cone.F[:, None, :]).reshape(count, count * size)
    M = jnp.block([[DWD.reshape(count * size, count * size), -E.T], [F, jnp.zeros_like(diagonal)]])
    q = jnp.concatenate([s.reshape(-1), jnp.zeros(count, s.dtype)])
    live = jnp.concatenate([jnp.repeat(problem.active, size), problem.active])
    M = jnp.where(live[:, None] & live[None, :], M, jnp.eye(M.shape[0], dtype=M.dtype))
    return M, jnp.where(live, q, 1.0)


def masked(problem: ContactProblem) -> ContactProblem:
    """The problem with harmless numbers in its masked slots, before anything is computed with them."""
    active = jnp.asarray(problem.active)
    dtype = jnp.result_type(problem.coupling, problem.free_displacement, problem.gap, problem.frames)
    wide = jnp.repeat(active, 3)
    return ContactProblem(
        coupling=jnp.where(wide[:, None] & wide[None, :], jnp.asarray(problem.coupling, dtype), 0.0),
        free_displacement=jnp.where(wide, jnp.asarray(problem.free_displacement, dtype), 0.0),
        gap=jnp.where(active, jnp.asarray(problem.gap, dtype), 0.0),
        frames=jnp.where(active[:, None, None], jnp.asarray(problem.frames, dtype), jnp.eye(3, dtype=dtype)[None]),
        friction=jnp.where(active, jnp.asarray(problem.friction, dtype), 0.0),
        active=active,
    )


def check(problem: ContactProblem) -> None:
    """Raises `ValueError` on shapes that do not agree and on a concrete negative friction coefficient."""
    count = np.shape(problem.gap)[0]
    wanted = {
        "coupling": (3 * count, 3 * count),
        "free_displacement": (3 * count,),
        "frames": (count, 3, 3),
        "friction": (count,),
        "active": (count,),
    }
    for name, shape in wanted.items():
        if np.shape(getattr(problem, name)) != shape:
            found = np.shape(getattr(problem, name))
            raise ValueError(f"{name} must have shape {shape} for {count} contacts; got {found}")
    if not isinstance(problem.friction, Tracer) and not isinstance(problem.active, Tracer):
        friction = np.where(np.asarray(problem.active), np.asarray(problem.friction), 0.0)
        if np.any(friction < 0):
            raise ValueError(f"friction must not be negative; got {float(np.min(friction))}")
