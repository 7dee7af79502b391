"""Deviation that a torque causes in a dynamic equilibrium, and its derivative as the response to another torque."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from icjax.fit._parameters import Values
from icjax.typing import Float, Real


class _System(NamedTuple):
    """M a + (N + B) v + (G + K) e = push half-way between frames; G, N and M [frame, segment, dof, dof] of each segment
    are to be multiplied by its `mass`."""

    inertia: tuple[Any, Any, Any]
    mass: Any
    armature: Any
    damping: Any
    stiffness: Any
    push: Any


def response(
    inertia: tuple[Any, Any, Any], torque: Float[Real, "frame dof"], values: Values, armature: Any, step: float
) -> Float[Real, "frame dof"]:
    """e of a torque by the implicit midpoint rule, from rest at the first frame.

    The tangent of e along any change of the numbers solves the same equation, with what that change leaves of the
    balance of torques, e held, as its torque: the matrices are factored once for all tangents.

    **Arguments**: `inertia` (G, N, M) of every frame and segment; `values` with "compliance", "damping time" and
    "inertia", mass factors of the segments; `step` s.
    """
    C = values["compliance"]
    K = jnp.diag(1.0 / C) if C.ndim == 1 else jnp.linalg.inv(C)
    B = jnp.diag(values["damping time"] * jnp.diagonal(K))
    middle = tuple(_middle(jnp.asarray(part)) for part in inertia)
    system = _System((middle[0], middle[1], middle[2]), values["inertia"], jnp.asarray(armature), B, K, _middle(torque))
    return _deviation(system, step=step)


@eqx.filter_custom_jvp
def _deviation(system: _System, *, step: float):
    return _march(_factored(system, step), system.push, step)[0]


@_deviation.def_jvp
def _deviation_jvp(primals, tangents, *, step: float):
    (system,), (change,) = primals, tangents
    factored = _factored(system, step)
    e, v, a = _march(factored, system.push, step)
    _, push = eqx.filter_jvp(lambda system: _unbalanced(system, _middle(e), _middle(v), a), (system,), (change,))
    return e, _march(factored, push, step)[0]


def _factored(system: _System, step: float) -> tuple[jax.Array, ...]:
    """LU factors and pivots of A = M + h D / 2 + h^2 S / 4, D = N + B and S = G + K.

    One frame after the other: factorisations of all at once beside another such call can wait for each other for ever
    on the two threads of a small CPU (jaxlib 0.10.2).
    """
    G, N, M = (jnp.einsum("tsij,s->tij", part, system.mass) for part in system.inertia)
    S, D = G + system.stiffness[None], N + system.damping[None]
    A = M + jnp.diag(system.armature)[None] + 0.5 * step * D + 0.25 * step**2 * S
    return (*jax.lax.map(jax.scipy.linalg.lu_factor, A), D, S)


def _march(factored: tuple[jax.Array, ...], push: jax.Array, step: float):
    """Angle and rate at every frame, and acceleration between frames."""

    def advance(carry, now):
        e, v = carry
        *factors, D, S, push = now
        a = jax.scipy.linalg.lu_solve(tuple(factors), push - D @ v - S @ (e + 0.5 * step * v))
        after = v + step * a
        e = e + 0.5 * step * (v + after)
        return (e, after), (e, after, a)

    still = jnp.zeros(push.shape[1], push.dtype)
    _, (e, v, a) = jax.lax.scan(advance, (still, still), (*factored, push))
    return jnp.concatenate([still[None], e]), jnp.concatenate([still[None], v]), a


def _unbalanced(system: _System, e: jax.Array, v: jax.Array, a: jax.Array) -> jax.Array:
    """Torque that is left over half-way between frames."""
    G, N, M = system.inertia
    parts = sum(jnp.einsum("tsij,tj->tsi", part, x) for part, x in ((G, e), (N, v), (M, a)))
    own = a * system.armature[None] + v @ system.damping.T + e @ system.stiffness.T
    return system.push - jnp.einsum("tsi,s->ti", parts, system.mass) - own


def _middle(values: Any) -> jax.Array:
    return 0.5 * (values[1:] + values[:-1])
