"""Units in which a contact problem has numbers of order one."""

import jax.numpy as jnp
from jax import lax

from icjax.contact._assemble import masked
from icjax.contact._cone import friction_cone
from icjax.contact._problem import ContactProblem
from icjax.typing import Scalar


def dimensionless(problem: ContactProblem, facets: int | None) -> tuple[ContactProblem, Scalar, Scalar]:
    """The problem in its own units, numbers of order one.

    Lengths are divided by L, the largest ``|s + D^T du_free|``; forces by ``L / w`` with w the mean diagonal of
    ``D^T W D``, both over the active slots and rounded up to a power of two, so that nothing is rounded. Limits count
    with their gaps and their diagonal.

    **Arguments**: `problem`, SI; `facets` the number m of opposite tangent pairs, None for the circular cone (scales as
    with m = 2).

    **Returns**: the problem, L (m) and w (m/N). Its forces times ``L / w``, its displacements times L are those of the
    given problem. L and w have no derivative: the solution does not depend on them.
    """
    problem = masked(problem)
    length, compliance = _scales(problem, facets or 2)
    scaled = ContactProblem(
        coupling=problem.coupling / compliance,
        free_displacement=problem.free_displacement / length,
        gap=problem.gap / length,
        frames=problem.frames,
        friction=problem.friction,
        active=problem.active,
        limit_gap=problem.limit_gap / length,
    )
    return scaled, length, compliance


def _scales(problem: ContactProblem, facets: int):
    """Length and compliance scale, powers of two without derivative."""
    cone = friction_cone(problem.frames, problem.friction, facets)
    count, limits = problem.gap.shape[0], problem.limit_gap.shape[0]
    live, limit_live = problem.active[:, None], problem.limit_gap != jnp.inf
    free = problem.free_displacement[: 3 * count].reshape(count, 3)
    s = jnp.einsum("iaj,ia->ij", cone.D, free).at[:, 0].add(problem.gap)
    clearance = jnp.where(limit_live, problem.limit_gap, 0.0) + problem.free_displacement[3 * count :]
    blocks = jnp.einsum("iaib->iab", problem.coupling[: 3 * count, : 3 * count].reshape(count, 3, count, 3))
    diagonal = jnp.einsum("iaj,iab,ibj->ij", cone.D, blocks, cone.D)
    length = jnp.max(jnp.where(live, jnp.abs(s), 0.0), initial=0.0)
    length = jnp.maximum(length, jnp.max(jnp.abs(clearance), initial=0.0))
    total = jnp.sum(jnp.where(live, diagonal, 0.0)) + jnp.sum(jnp.diagonal(problem.coupling)[3 * count :])
    number = jnp.sum(problem.active) * diagonal.shape[1] + (jnp.sum(limit_live) if limits else 0)
    compliance = total / jnp.maximum(number, 1)
    return _power_of_two(lax.stop_gradient(length)), _power_of_two(lax.stop_gradient(compliance))


def _power_of_two(x):
    usable = (x > 0) & jnp.isfinite(x)
    _, exponent = jnp.frexp(jnp.where(usable, x, 1.0))
    return jnp.where(usable, jnp.ldexp(jnp.ones_like(x), exponent), 1.0)
