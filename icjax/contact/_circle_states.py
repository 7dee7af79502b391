"""Derivative of forces on the circular cone: the implicit function theorem on their states."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from icjax.compiling import as_primitive
from icjax.contact._judge import OPEN, SLIDING, Judged
from icjax.contact._local import LocalProblem
from icjax.typing import Float, Real


def on_circle(local: LocalProblem, forces: Float[Real, " component"]) -> Float[Real, " component"]:
    """The same forces, with the derivative of the states that they are in: open ``f = 0``, closed ``u_n = 0``, sticking
    ``u_t = 0``, sliding ``f_t + mu f_n u_t / |u_t| = 0``.

    Where W leaves f open, a compliance of the size of rounding stands in, as for the polygon.
    """
    return _with_states(local, lax.stop_gradient(forces))


def _changed(arguments, tangents):
    local, given = arguments
    forces = _with_states(local, given)
    real, rest = eqx.partition(local, eqx.is_inexact_array)
    _, change = jax.jvp(lambda real: _equations(eqx.combine(real, rest), forces), (real,), (tangents[0],))
    slope = jax.jacfwd(lambda forces: _equations(local, forces))(forces)
    return forces, -jnp.linalg.solve(slope, change)


_with_states = as_primitive(lambda local, forces: forces, _changed)


def _equations(local: LocalProblem, forces: Float[Real, " component"]) -> Float[Real, " component"]:
    """Zero at the solution; which equations, the forces decide."""
    now = Judged(lax.stop_gradient(local), None, lax.stop_gradient(forces))
    state, limit_closed = now.state(0.0), local.limit_active & (now.limit_force > now.limit_room)
    soft = 1e-3 * float(np.sqrt(jnp.finfo(forces.dtype).eps))
    moved = local.displacement(forces) + soft * (forces - lax.stop_gradient(forces))
    (f, limit_force), (u, room) = local.split(forces), local.split(moved)
    closed, sliding = (state != OPEN)[:, None], (state == SLIDING)[:, None]
    length = jnp.sqrt(jnp.sum(jnp.where(sliding, u[:, 1:], 1.0) ** 2, axis=1))[:, None]
    slides = f[:, 1:] + local.friction[:, None] * f[:, :1] * u[:, 1:] / length
    tangential = jnp.where(closed & (local.friction > 0)[:, None], jnp.where(sliding, slides, u[:, 1:]), f[:, 1:])
    normal = jnp.where(closed, u[:, :1], f[:, :1])
    return jnp.concatenate(
        [jnp.concatenate([normal, tangential], axis=1).reshape(-1), jnp.where(limit_closed, room, limit_force)]
    )
