"""Contact forces of one step: dimensionless problem in contact frames, a solver, forces, slip state and margin."""

import jax.numpy as jnp
import numpy as np
from jax import lax

from icjax import lcp
from icjax.contact._active_set import forces_of, states
from icjax.contact._assemble import assembled, check, masked, sound
from icjax.contact._circle_states import on_circle
from icjax.contact._cone import tangents
from icjax.contact._interior import InteriorPoint, interior, path_forces
from icjax.contact._judge import Judged
from icjax.contact._local import LocalProblem, localised, turned
from icjax.contact._problem import ContactForces, ContactProblem
from icjax.contact._projected import Projected, projected
from icjax.contact._scale import dimensionless
from icjax.lcp import Exact, Lemke, Smoothed
from icjax.results import RESULTS, Solution
from icjax.typing import Scalar

_HIDDEN = 20.0
"""Residual over tolerance up to which an answer of Lemke's method, exact as an LCP, counts as solved."""


def solve(
    problem: ContactProblem,
    *,
    facets: int | None = 4,
    solver: Lemke | InteriorPoint | Projected = Lemke(),
    adjoint: Exact | Smoothed | None = None,
    throw: bool = False,
) -> Solution[ContactForces]:
    """Solves the frictional contact problem of one step, ``f = D beta`` with (beta, lambda) from the LCP.

    The problem is made dimensionless first ([`dimensionless`][icjax.contact.dimensionless]), and the residual that is
    returned is recomputed from the forces, whichever solver they come from.

    Forces and displacements are differentiable in every number of the problem, in forward and reverse mode, of any
    order; the derivative of the forces of a failed solve is zero. By default it is the derivative of what the solver
    computes: on the final basis for `Lemke`, on the final states for `Projected` and a polished `InteriorPoint`, along
    the central path for `InteriorPoint` as it is. Where f is not unique (W singular), so is not its derivative, and
    ``W f`` is what to compare. Lambda, never unique at an open contact, is not returned.

    The margin says how far the problem is from a change of contact state, where the exact derivative is one-sided. It
    is the minimum over active contacts of ``max(f_n, u_n)``; over closed frictional ones also of
    ``max(sigma_f, lambda)``, ``sigma_f = mu f_n - gauge(f_t)``, lambda the slip; over sliding ones also of
    ``min_j (beta_j + nu_j)``; over limits of ``max(force, clearance)``; all dimensionless. A sticking contact whose
    tangential force is zero or along one facet is no such change: there the derivative is that of the smooth function,
    as wherever the margin is positive.

    **Arguments**

    - `problem`: see [`ContactProblem`]; SI units.
    - `facets`: number m of opposite tangent pairs, at least 2; the cone has 2m facets. None for the circular cone,
      which `InteriorPoint` (without polish or fallback) and `Projected` can solve.
    - `solver`: [`Lemke`][icjax.lcp.Lemke], [`InteriorPoint`], [`Projected`].
    - `adjoint`: None (for the circular cone nothing else), or [`Exact`][icjax.lcp.Exact], or
      [`Smoothed`][icjax.lcp.Smoothed] for the derivative of the central path beside the exact forces of another solver.
    - `throw`: raise an error instead of returning a failed status; within `jit` use `equinox.filter_jit`.

    **Returns**: a `Solution` of [`ContactForces`]; statistics `residual` (dimensionless), `pivots` (Lemke's pivots,
    Newton steps, or changes of the bounds) and `attempts` (of Lemke's method, 0 where it was not used). `solved` means
    an exact solution, but for an `InteriorPoint` without polish: there, a point of the path. A traced negative friction
    coefficient gives `invalid_input`, as NaN does. After a failure the value is the best that was met, not an answer.

    **Errors**: `TypeError` for what is no array or a mask that is not bool; `ValueError` for shapes that do not agree,
    fewer than two facets, a combination of arguments that has no meaning, and, where they are not traced, for negative
    friction or frames that are not orthonormal.

    **Source**: Kry and Pai (2006), Sections 7.1.1 and 7.1.3, Eq. 8 to 10.
    """
    check(problem)
    _check_combination(facets, solver, adjoint)
    problem, valid = sound(masked(problem))
    scaled, length, compliance = dimensionless(problem, facets)
    local, unit = localised(scaled), length**2 / compliance
    forces, result, stats = _answered(local, facets, solver, unit)
    tolerance = lcp.tolerance(getattr(solver, "tolerance", None), forces.dtype)
    judged = Judged(local, facets, lax.stop_gradient(forces))
    residual = judged.residual()
    answer = _in_the_world(problem, local, forces, length / compliance)
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in answer]))
    result = RESULTS.where((result == RESULTS.solved) & ~finite, RESULTS.breakdown, result)
    result = RESULTS.where(valid, result, RESULTS.invalid_input)
    if isinstance(adjoint, Smoothed) and facets is not None:
        smooth, found, _ = path_forces(local, facets, _dimensionless(adjoint, unit), adjoint.kappa, 40)
        smooth = _in_the_world(problem, local, jnp.where(found, smooth, forces), length / compliance)
        answer = tuple(lcp.carried(x, y) for x, y in zip(answer, smooth, strict=True))
    force, limit_force, displacement, limit_displacement = answer
    if throw:
        force = result.error_if(force, result != RESULTS.solved)
    value = ContactForces(
        force=force,
        displacement=displacement,
        slip_state=judged.state(tolerance),
        margin=judged.margin(tolerance),
        limit_force=limit_force,
        limit_displacement=limit_displacement,
    )
    return Solution(value=value, result=result, stats={"residual": jnp.where(valid, residual, jnp.nan), **stats})


def _in_the_world(problem: ContactProblem, local: LocalProblem, forces, unit: Scalar):
    """Forces in the world of contacts and limits, and the displacements that they leave."""
    f, limit_force = local.split(forces)
    force = turned(jnp.swapaxes(problem.frames, 1, 2), f.reshape(-1, 1))[:, 0] * unit
    limit_force = limit_force * unit
    moved = lcp.times(problem.coupling, jnp.concatenate([force, limit_force])) + problem.free_displacement
    return force.reshape(-1, 3), limit_force, moved[: force.size].reshape(-1, 3), moved[force.size :]


def _answered(local: LocalProblem, facets: int | None, solver, unit: Scalar):
    """Differentiable dimensionless forces, the result, and the statistics of the solver."""
    none = jnp.array(0, jnp.int32)
    if isinstance(solver, Lemke):
        assert facets is not None
        return _by_lemke(local, facets, solver)
    if isinstance(solver, Projected):
        forces, good, count = projected(local, facets, solver)
        if facets is not None:
            exact = forces_of(local, facets, states(lax.stop_gradient(local), facets, forces), forces)
            forces = lcp.carried(forces, jnp.where(good, exact, forces))
        elif forces.size:
            forces = on_circle(local, forces)
    else:
        forces, good, count = interior(local, facets, solver, _dimensionless(solver, unit))
    result = RESULTS.where(good, RESULTS.solved, RESULTS.not_converged)
    forces = jnp.where(good, forces, lax.stop_gradient(forces))
    stats = {"pivots": count, "attempts": none}
    if isinstance(solver, InteriorPoint) and solver.fallback is not None and facets is not None:
        second = solver.fallback
        found = lax.cond(good, lambda: (forces, result, stats), lambda: _by_lemke(_unless(good, local), facets, second))
        forces, result, used = found
        stats = {**used, "pivots": jnp.where(good, count, count + used["pivots"])}
    return forces, result, stats


def _unless(done, local: LocalProblem) -> LocalProblem:
    """The problem, or one without contact where nothing is left to do (under `vmap` both branches are computed)."""
    return LocalProblem(local.coupling, local.offset, local.friction, local.active & ~done, local.limit_active & ~done)


def _by_lemke(local: LocalProblem, facets: int, solver: Lemke):
    count = local.contacts
    size = 2 * facets + 1
    M, q = assembled(local, facets)
    solution = lcp.solve(M, q, solver, perturbation=_perturbation(local, facets))
    z = solution.value
    beta = z[: count * size].reshape(count, size)
    # Exact where the LCP is exact to rounding: sum(beta_*) <= mu beta_0.
    frictional = (local.friction * beta[:, 0] > 0)[:, None]
    tangential = lcp.times(jnp.where(frictional, beta[:, 1:], 0.0), jnp.asarray(tangents(facets), z.dtype))
    forces = jnp.concatenate([beta[:, :1], tangential], axis=1)
    forces = jnp.concatenate([forces.reshape(-1), z[count * (size + 1) :]])
    live = jnp.concatenate([jnp.repeat(local.active, 3), local.limit_active])
    forces = jnp.where(live, forces, 0.0)
    # Judged as an LCP so far, where W of very different entries can hide more than rounding.
    residual = Judged(local, facets, lax.stop_gradient(forces)).residual()
    off = (solution.result == RESULTS.solved) & ~(residual <= _HIDDEN * lcp.tolerance(solver.tolerance, forces.dtype))
    result = RESULTS.where(off, RESULTS.breakdown, solution.result)
    return forces, result, {name: solution.stats[name] for name in ("pivots", "attempts")}


def _perturbation(local: LocalProblem, facets: int):
    """Perturbation of q that a small random free displacement makes: it leaves physical contact states only.

    A sticking contact whose tangential force is zero, or along one facet, is degenerate as an LCP though its force is a
    smooth function. A perturbation by ``D^T xi`` puts both tangential directions into the basis, as perturbations
    independent for opposite tangents would not. A much smaller one of sigma keeps frictionless contacts from cycling.
    """
    count, limits = local.contacts, local.limit_active.shape[0]
    random = np.random.default_rng(2006)
    xi = random.uniform(0.5, 1.0, (count, 3)) * random.choice([-1.0, 1.0], (count, 3))
    sigma = random.uniform(1e-6, 2e-6, count)
    nu = np.concatenate([xi[:, :1], xi[:, 1:] @ tangents(facets).T], axis=1)
    dtype = local.offset.dtype
    nu = jnp.where(local.active[:, None], jnp.asarray(nu, dtype), 1.0)
    room = jnp.asarray(random.uniform(0.5, 1.0, limits), dtype)
    return jnp.concatenate([nu.reshape(-1), jnp.asarray(sigma, dtype), room])


def _dimensionless(given: InteriorPoint | Smoothed, unit: Scalar) -> Scalar:
    """kappa in the units of the scaled problem."""
    return jnp.asarray(given.kappa if given.unit is None else given.kappa * given.unit / unit)


def _check_combination(facets, solver, adjoint) -> None:
    if facets is None:
        if isinstance(solver, Lemke):
            raise ValueError("facets must be a number for Lemke's method; the circular cone is no LCP")
        if isinstance(solver, InteriorPoint) and (solver.polish or solver.fallback is not None):
            raise ValueError("facets must be a number for InteriorPoint with polish or fallback")
        if adjoint is not None:
            raise ValueError("adjoint must be None for the circular cone")
    elif facets < 2:
        raise ValueError(f"facets must be at least 2 (pairs of tangents); got {facets}")
    if isinstance(adjoint, Exact) and isinstance(solver, InteriorPoint) and not solver.polish:
        raise ValueError("adjoint Exact needs an InteriorPoint with polish=True: a point of the path is not exact")
