"""Forces of given contact states: linear equations, whose solution is the exact answer if the states are right."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax

from icjax.contact._judge import Judged, directed, ring
from icjax.contact._local import LocalProblem
from icjax.typing import Float, Real


class States(NamedTuple):
    """Which side of each complementarity is zero."""

    closed: Real
    sliding: Real
    tangent: Real  # along which a sliding contact's friction acts, in ring order,
    facet: Real  # or the facet that it lies on, between `tangent` and the next (`forward`) or the one before
    forward: Real
    limit_closed: Real


def states(local: LocalProblem, facets: int, forces: Float[Real, " component"]) -> States:
    """The states that forces and their displacements are nearest to: of each pair the greater one is kept."""
    f, limit_force = local.split(forces)
    u, room = local.split(local.displacement(forces))
    beta, nu, slip = directed(facets, f[:, 1:], u[:, 1:])
    within = local.friction * f[:, 0] - jnp.sum(beta, axis=1)
    tangent = jnp.argmax(beta - nu, axis=1)
    excess = beta - nu
    count = 2 * facets
    pick = jnp.arange(f.shape[0])
    ahead, behind = excess[pick, (tangent + 1) % count], excess[pick, (tangent - 1) % count]
    closed = local.active & (f[:, 0] > u[:, 0])
    return States(
        closed=closed,
        sliding=closed & (slip > within),
        tangent=tangent,
        facet=jnp.maximum(ahead, behind) > 0,
        forward=ahead >= behind,
        limit_closed=local.limit_active & (limit_force > room),
    )


def forces_of(
    local: LocalProblem, facets: int, at: States, near: Float[Real, " component"]
) -> Float[Real, " component"]:
    """Solves f or u for each component: closed ``u_n = 0``, sticking ``u_t = 0``, sliding f_t on its tangent or facet.

    Where W leaves f open, the forces nearest to `near` are taken (a proximal term of the size of rounding). An explicit
    function of W, b and friction, so its derivative is that of the states.
    """
    count = local.contacts
    dtype = local.offset.dtype
    directions = jnp.asarray(ring(facets), dtype)
    other = (at.tangent + jnp.where(at.forward, 1, -1)) % (2 * facets)
    d, e = directions[at.tangent], directions[other]
    middle = (d + e) / (2 * float(np.cos(np.pi / (2 * facets))))
    friction = local.friction
    # Rows of A_f f + A_u u = 0 for each contact.
    ones, zeros = jnp.ones((count, 1), dtype), jnp.zeros((count, 1), dtype)
    normal = jnp.concatenate([ones, zeros, zeros], axis=1)
    tangential = jnp.broadcast_to(jnp.eye(3, dtype=dtype)[None, 1:], (count, 2, 3))
    corner = tangential - jnp.concatenate(
        [(friction[:, None] * d)[:, :, None], jnp.zeros((count, 2, 2), dtype)], axis=2
    )
    reach = friction[:, None] * float(np.cos(np.pi / (2 * facets)))
    on_facet = jnp.stack([jnp.concatenate([-reach, middle], axis=1), jnp.zeros((count, 3), dtype)], axis=1)
    along = jnp.stack([jnp.zeros((count, 3), dtype), jnp.concatenate([zeros, d - e], axis=1)], axis=1)
    free = ~at.closed | (friction <= 0)

    def chosen(condition, one, two):
        return jnp.where(condition[:, None, None], one, two)

    none = jnp.zeros_like(tangential)
    by_force = chosen(free, tangential, chosen(at.sliding, chosen(at.facet, on_facet, corner), none))
    by_motion = chosen(free, none, chosen(at.sliding, chosen(at.facet, along, none), tangential))
    A_f = jnp.concatenate([jnp.where(at.closed[:, None], 0.0, normal)[:, None, :], by_force], axis=1)
    A_u = jnp.concatenate([jnp.where(at.closed[:, None], normal, 0.0)[:, None, :], by_motion], axis=1)

    size = local.offset.shape[0]
    soft = 1e-3 * float(jnp.finfo(dtype).eps) ** 0.5
    coupling = local.coupling + soft * jnp.eye(size, dtype=dtype)
    offset = local.offset - soft * near

    def moved(rows):
        wide = rows[: 3 * count].reshape(count, 3, rows.shape[1])
        contacts = jnp.einsum("iab,ibk->iak", A_u, wide, precision="highest").reshape(3 * count, rows.shape[1])
        return jnp.concatenate([contacts, jnp.where(at.limit_closed[:, None], rows[3 * count :], 0.0)])

    wide = jnp.zeros((count, 3, count, 3), dtype).at[jnp.arange(count), :, jnp.arange(count), :].set(A_f)
    block = jnp.zeros((size, size), dtype).at[: 3 * count, : 3 * count].set(wide.reshape(3 * count, 3 * count))
    block = block + jnp.diag(
        jnp.concatenate([jnp.zeros(3 * count, dtype), jnp.where(at.limit_closed, 0.0, 1.0).astype(dtype)])
    )
    return jnp.linalg.solve(block + moved(coupling), -moved(offset[:, None])[:, 0])


def polished(local: LocalProblem, facets: int, near: Float[Real, " component"], tolerance: float, rounds: int):
    """Forces by exact states found from nearby ones (a primal-dual active set method), their residual, their states.

    At most so many rounds of forces from states and states from forces; the best are returned.
    """
    local, near = lax.stop_gradient((local, near))

    def judged(forces):
        found = Judged(local, facets, forces).residual()
        return jnp.where(jnp.isnan(found), jnp.inf, found)

    def again(carried):
        forces, best, residual, at, count = carried
        now = states(local, facets, forces)
        fresh = forces_of(local, facets, now, forces)
        fresh = forces_of(local, facets, now, fresh)
        found = judged(fresh)
        better = found < residual
        fresh = jnp.where(jnp.isfinite(fresh), fresh, best)
        at = States(*(jnp.where(better, a, b) for a, b in zip(now, at, strict=True)))
        return fresh, jnp.where(better, fresh, best), jnp.minimum(found, residual), at, count + 1

    start = (near, near, jnp.array(jnp.inf, near.dtype), states(local, facets, near), 0)
    _, best, residual, at, _ = lax.while_loop(lambda c: (c[2] > tolerance) & (c[4] < rounds), again, start)
    return best, residual, at
