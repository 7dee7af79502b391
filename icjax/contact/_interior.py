"""The interior-point solver: a point of the structured central path, polished to the exact states when asked."""

import equinox as eqx
import jax.numpy as jnp

from icjax.contact._active_set import forces_of, polished
from icjax.contact._cones import Circle, Polygon
from icjax.contact._judge import Judged
from icjax.contact._local import LocalProblem
from icjax.lcp import Lemke, central_path
from icjax.lcp import tolerance as usual_tolerance
from icjax.typing import Bool, Float, Int, Real, Scalar


class InteriorPoint(eqx.Module):
    """Follows the central path ``beta nu = kappa, lambda sigma = kappa`` to a given kappa, 3 N + R equations a step.

    The cost does not depend on the number of facets, and the forces are a smooth function of the problem that sees
    contacts before they touch: another function than the exact one, nearer for smaller kappa. At 1e-4 forces are off by
    about a percent of the largest, and what should stick creeps: made for derivatives. Where values matter, take 1e-8
    or `polish`.

    **Fields**

    - `kappa`: product of complementary forces and displacements, in units of `unit`.
    - `unit`: J, or None for ``L^2 / w`` of each problem (see [`dimensionless`][icjax.contact.dimensionless]), which
      jumps by powers of two. Give it where forces shall be smooth from one problem to the next.
    - `softness`: compliance that is added to the diagonal of W, relative to its mean, because the path needs W
      definite; None for `kappa`.
    - `polish`: find the exact states from the point on the path, and return their forces; `solved` then means exact to
      `tolerance`, as with Lemke's method. Not for the circular cone.
    - `fallback`: a Lemke solver for problems whose path is not found or, with `polish`, whose states are not exact;
      None reports `not_converged`. Without `polish` it puts exact answers beside points of the path. Not for the
      circular cone.
    - `max_steps`: most Newton steps of each of the attempts.
    - `tolerance`: residual of a polished answer that counts as solved, None as for [`Lemke`][icjax.lcp.Lemke].
    """

    kappa: float | Scalar = 1e-4
    unit: float | Scalar | None = None
    softness: float | Scalar | None = None
    polish: bool = eqx.field(default=False, static=True)
    fallback: Lemke | None = eqx.field(default=None, static=True)
    max_steps: int = eqx.field(default=40, static=True)
    tolerance: float | None = eqx.field(default=None, static=True)

    def __check_init__(self) -> None:
        if isinstance(self.kappa, float | int) and not self.kappa > 0:
            raise ValueError(f"kappa must be positive; got {self.kappa}")
        if self.max_steps < 1:
            raise ValueError(f"max_steps must be at least 1; got {self.max_steps}")


def path_forces(
    local: LocalProblem, facets: int | None, kappa: Scalar, softness: float | Scalar, max_steps: int
) -> tuple[Float[Real, " component"], Bool[Real, ""], Int[Real, ""]]:
    """Forces of the point with products kappa, whether it was found, and the number of steps."""
    if local.offset.size == 0:
        return local.offset, jnp.array(True), jnp.array(0, jnp.int32)
    kappa, softness = jnp.asarray(kappa, local.offset.dtype), jnp.asarray(softness, local.offset.dtype)
    usable = (kappa > 0) & (softness >= 0)
    kappa, softness = jnp.where(usable, kappa, 1.0), jnp.where(usable, softness, 0.0)
    live = 3 * jnp.sum(local.active) + jnp.sum(local.limit_active)
    added = softness * jnp.trace(local.coupling) / jnp.maximum(live, 1)
    definite = local.coupling + added * jnp.eye(local.offset.shape[0], dtype=local.offset.dtype)
    softened = eqx.tree_at(lambda problem: problem.coupling, local, definite)
    system = Circle(softened) if facets is None else Polygon(softened, facets)
    path = central_path(system, kappa, jnp.asarray(max_steps, jnp.int32))
    return system.forces(path.point), path.converged & usable, path.steps


def interior(local: LocalProblem, facets: int | None, solver: InteriorPoint, kappa: Scalar):
    """Forces, whether they are what the solver promises, and the number of Newton steps."""
    softness = solver.kappa if solver.softness is None else solver.softness
    forces, good, steps = path_forces(local, facets, kappa, softness, solver.max_steps)
    if solver.polish and facets is not None:
        tolerance = usual_tolerance(solver.tolerance, local.offset.dtype)
        exact, residual, at = polished(local, facets, forces, tolerance, rounds=10)
        good = residual <= tolerance
        forces = jnp.where(good, forces_of(local, facets, at, exact), forces)
        # The last solution, made for its derivative, is judged like every other.
        good = good & (Judged(local, facets, forces).residual() <= tolerance)
    return forces, good, steps
