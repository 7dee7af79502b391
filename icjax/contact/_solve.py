"""Contact forces of one step: dimensionless problem, Lemke's method, forces, slip state and margin."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from icjax import lcp
from icjax.contact._assemble import assemble, check, masked
from icjax.contact._cone import friction_cone, gauge
from icjax.contact._problem import ContactForces, ContactProblem
from icjax.contact._scale import dimensionless
from icjax.lcp import Lemke
from icjax.results import Solution

OPEN, STICKING, SLIDING = 0, 1, 2


def solve(
    problem: ContactProblem,
    *,
    facets: int = 4,
    solver: Lemke = Lemke(),
    throw: bool = False,
) -> Solution[ContactForces]:
    """Solves the frictional contact problem of one step, ``f = D beta`` with (beta, lambda) from the LCP.

    The problem is made dimensionless first ([`dimensionless`][icjax.contact.dimensionless]).

    Forces and displacements are differentiable in every number of the problem, in forward and reverse mode (the
    derivative of [`icjax.lcp.solve`]; of a failed solve it is zero). Where f is not unique (W singular), so is not its
    derivative, and ``W f`` is what to compare. Lambda, never unique at an open contact, is not returned.

    The margin says how far the problem is from a change of contact state, where the derivative is one-sided. It is
    the minimum over active contacts of ``max(beta_0, nu_0)``; over closed frictional ones also of
    ``max(sigma_f, lambda)``, ``sigma_f = mu f_n - gauge(f_t)``; over sliding ones also of
    ``min_j (beta_j + nu_j)``; all dimensionless. A sticking contact whose tangential force is zero or along one facet
    is no such change: there the derivative is that of the smooth function, as wherever the margin is positive.

    **Arguments**

    - `problem`: see [`ContactProblem`]; SI units.
    - `facets`: number m of opposite tangent pairs, at least 2; the cone has 2m facets.
    - `solver`: see [`icjax.lcp.Lemke`].
    - `throw`: raise an error instead of returning a failed status.

    **Returns**: a `Solution` of [`ContactForces`]; statistics `residual` (of the dimensionless LCP), `pivots`,
    `attempts`. A traced negative friction coefficient gives `invalid_input`, as NaN does.

    **Errors**: `ValueError` for shapes that do not agree, fewer than two facets, or negative friction.

    **Source**: Kry and Pai (2006), Sections 7.1.1 and 7.1.3, Eq. 8 to 10.
    """
    check(problem)
    problem = masked(problem)
    count = problem.gap.shape[0]
    size = 2 * facets + 1
    cone = friction_cone(problem.frames, problem.friction, facets)
    scaled, length, compliance = dimensionless(problem, facets)
    M, q = assemble(scaled, facets)
    q = jnp.where(jnp.any(problem.friction < 0), jnp.nan, q)
    nudge = _perturbation(problem.active, cone)
    solution = lcp.solve(M, q, solver, perturbation=nudge, throw=throw)

    z = solution.value
    beta, slip_multiplier = z[: count * size].reshape(count, size), z[count * size :]
    # Exact where the LCP is exact to rounding: sum(beta_*) <= mu beta_0.
    frictional = (problem.friction * beta[:, 0] > 0)[:, None]
    beta = jnp.concatenate([beta[:, :1], jnp.where(frictional, beta[:, 1:], 0.0)], axis=1)
    unit_force = jnp.einsum("iaj,ij->ia", cone.D, beta, precision=lax.Precision.HIGHEST)
    force = unit_force * (length / compliance)
    moved = jnp.matmul(problem.coupling, force.reshape(-1), precision=lax.Precision.HIGHEST)
    displacement = (moved + problem.free_displacement).reshape(count, 3)
    nu = (jnp.matmul(M, z, precision=lax.Precision.HIGHEST) + q)[: count * size].reshape(count, size)
    state, margin = _state_and_margin(
        problem,
        *(lax.stop_gradient(x) for x in (beta, nu, slip_multiplier, unit_force, displacement / length)),
        facets=facets,
        tolerance=solver.resolved_tolerance(q.dtype),
    )
    value = ContactForces(force=force, displacement=displacement, slip_state=state, margin=margin)
    stats = {
        "residual": solution.stats["residual"],
        "pivots": solution.stats["pivots"],
        "attempts": solution.stats["attempts"],
    }
    return Solution(value=value, result=solution.result, stats=stats)


def _perturbation(active, cone):
    """Perturbation of q that a small random free displacement makes: it leaves physical contact states only.

    A sticking contact whose tangential force is zero, or along one facet, is degenerate as an LCP though its force is a
    smooth function. A perturbation by ``D^T xi`` puts both tangential directions into the basis, as perturbations
    independent for opposite tangents would not. A much smaller one of sigma keeps frictionless contacts from cycling.
    """
    count, _, directions = cone.D.shape
    random = np.random.default_rng(2006)
    xi = random.uniform(0.5, 1.0, (count, 3)) * random.choice([-1.0, 1.0], (count, 3))
    D = lax.stop_gradient(cone.D)
    nu = jnp.einsum("iaj,ia->ij", D, jnp.asarray(xi, D.dtype))
    nu = jnp.where(active[:, None], nu, 1.0)
    sigma = jnp.asarray(random.uniform(1e-6, 2e-6, count), D.dtype)
    return jnp.concatenate([nu.reshape(-1), sigma])


def _state_and_margin(problem, beta, nu, slip_multiplier, force, displacement, *, facets, tolerance):
    """Slip state and margin from dimensionless quantities."""
    tangents = problem.frames[:, :, 1:]
    force_t = jnp.einsum("iab,ia->ib", tangents, force)
    slip_t = jnp.einsum("iab,ia->ib", tangents, displacement)
    weight = jax.vmap(lambda f: gauge(f, facets))(force_t)
    closed = problem.active & (beta[:, 0] > tolerance)
    sliding = closed & (jnp.max(jnp.abs(slip_t), axis=1) > tolerance)
    state = jnp.where(sliding, SLIDING, jnp.where(closed, STICKING, OPEN)).astype(jnp.int32)
    frictional = closed & (problem.friction > 0)
    touching = jnp.where(problem.active, jnp.maximum(beta[:, 0], nu[:, 0]), jnp.inf)
    within = problem.friction * beta[:, 0] - weight
    slipping = jnp.where(frictional, jnp.maximum(within, slip_multiplier), jnp.inf)
    corners = jnp.where(frictional & sliding, jnp.min(beta[:, 1:] + nu[:, 1:], axis=1), jnp.inf)
    margin = jnp.min(jnp.minimum(touching, jnp.minimum(slipping, corners)), initial=jnp.inf)
    return state, jnp.maximum(margin, 0.0)
