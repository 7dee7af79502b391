"""The Tresca fixed point: a convex problem at frozen friction bounds by projected gradients, bounds from its answer."""

import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from icjax.contact._judge import Judged, ring
from icjax.contact._local import LocalProblem
from icjax.typing import Float, Real


class Projected(eqx.Module):
    """Solves ``min f^T W f / 2 + b^T f`` over normal forces >= 0 and friction within frozen bounds, then takes the
    bounds ``mu f_n`` anew from the answer, until nothing changes.

    Each inner problem is convex, solved by accelerated projected gradients of `jaxopt`; the outer iteration has no
    proof of convergence for large friction. Slow, and accurate to `tolerance` at best: for comparison and for
    teaching.

    **Fields**

    - `tolerance`: dimensionless residual that counts as solved.
    - `max_outer`: most changes of the bounds.
    - `max_steps`: most gradient steps of an inner problem.
    """

    tolerance: float = eqx.field(default=1e-6, static=True)
    max_outer: int = eqx.field(default=100, static=True)
    max_steps: int = eqx.field(default=1000, static=True)


def projected(local: LocalProblem, facets: int | None, solver: Projected):
    """Forces without derivative, whether they have converged, and the number of outer iterations."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        import jaxopt

    local = lax.stop_gradient(local)
    size = local.offset.shape[0]
    largest = jnp.linalg.norm(local.coupling, 2) if size else jnp.ones(())
    stepsize = 1.0 / jnp.maximum(largest, 1e-12)

    def energy(forces, _):
        return 0.5 * forces @ (local.displacement(forces) + local.offset)

    def projection(forces, bounds):
        f, limit = local.split(forces)
        tangential = _on_disc(f[:, 1:], bounds) if facets is None else _on_polygon(f[:, 1:], bounds, facets)
        normal = jnp.where(local.active, jnp.maximum(f[:, 0], 0.0), 0.0)
        tangential = jnp.where(local.active[:, None], tangential, 0.0)
        limit = jnp.where(local.limit_active, jnp.maximum(limit, 0.0), 0.0)
        return jnp.concatenate([jnp.concatenate([normal[:, None], tangential], axis=1).reshape(-1), limit])

    inner = jaxopt.ProjectedGradient(
        energy,
        projection,
        stepsize=lambda _: stepsize,
        maxiter=solver.max_steps,
        tol=0.1 * solver.tolerance,
        implicit_diff=False,
        jit=True,
        unroll=False,
    )

    def outer(carried):
        forces, _, count = carried
        bounds = local.friction * local.split(forces)[0][:, 0]
        forces = inner.run(forces, bounds, None).params
        found = Judged(local, facets, forces).residual()
        return forces, jnp.where(jnp.isnan(found), jnp.inf, found), count + 1

    start = (jnp.zeros_like(local.offset), jnp.array(jnp.inf, local.offset.dtype), 0)
    forces, residual, count = lax.while_loop(
        lambda c: (c[1] > solver.tolerance) & (c[2] < solver.max_outer), outer, start
    )
    return forces, residual <= solver.tolerance, jnp.asarray(count, jnp.int32)


def _on_disc(points: Float[Real, "contact 2"], radius: Float[Real, " contact"]):
    size = jnp.linalg.norm(points, axis=1)
    return points * jnp.where(size > radius, radius / jnp.maximum(size, 1e-300), 1.0)[:, None]


def _on_polygon(points: Float[Real, "contact 2"], radius: Float[Real, " contact"], facets: int):
    """The nearest point of the polygon with corners at radius times the unit tangents."""
    corners = ring(facets)
    half = np.pi / (2 * facets)
    outward = jnp.asarray((corners + np.roll(corners, -1, axis=0)) / (2 * np.cos(half)), points.dtype)
    along = jnp.stack([-outward[:, 1], outward[:, 0]], axis=1)
    height, side = points @ outward.T, points @ along.T
    reach, width = radius[:, None] * np.cos(half), radius[:, None] * np.sin(half)
    on_edge = reach[:, :, None] * outward[None] + jnp.clip(side, -width, width)[:, :, None] * along[None]
    nearest = jnp.argmin(jnp.sum((on_edge - points[:, None, :]) ** 2, axis=2), axis=1)
    outside = jnp.max(height - reach, axis=1) > 0
    return jnp.where(outside[:, None], jax.vmap(lambda edges, i: edges[i])(on_edge, nearest), points)
