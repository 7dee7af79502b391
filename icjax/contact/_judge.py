"""What forces mean, whichever solver they come from: residual, slip state, margin."""

import jax.numpy as jnp
import numpy as np

from icjax.contact._local import LocalProblem
from icjax.typing import Float, Int, Real, Scalar

OPEN, STICKING, SLIDING = 0, 1, 2


def ring(facets: int) -> np.ndarray:
    """The 2m tangents in the order of their angles, `[2m, 2]`; tangents next to each other span a facet."""
    angles = np.arange(2 * facets) * np.pi / facets
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


class Judged:
    """Complementary quantities of contacts (f_n, u_n), (beta, nu), (lambda, sigma) and of limits, from forces alone.

    Of the many beta of a force, that with the least sum is taken (two neighbours at most); lambda is the greatest slip
    against a tangent, ``max_j -d_j . u_t``. The circle has no beta, and ``lambda = |u_t|``.
    """

    def __init__(self, local: LocalProblem, facets: int | None, forces: Float[Real, " component"]) -> None:
        self.local, self.facets = local, facets
        f, self.limit_force = local.split(forces)
        u, self.limit_room = local.split(local.displacement(forces))
        self.normal, self.clearance = f[:, 0], u[:, 0]
        f_t, u_t = f[:, 1:], u[:, 1:]
        bound = local.friction * self.normal
        if facets is None:
            self.slip, self.within = _length(u_t), bound - _length(f_t)
            kept = f_t - u_t
            size = _length(kept)
            inside = size <= jnp.maximum(bound, 0.0)
            share = jnp.where(inside, 1.0, jnp.maximum(bound, 0.0) / jnp.where(inside, 1.0, size))
            self.beta = self.nu = None
            self.friction_residual = _length(f_t - kept * share[:, None])
        else:
            self.beta, self.nu, self.slip = directed(facets, f_t, u_t)
            self.within = bound - jnp.sum(self.beta, axis=1)
            between = jnp.max(jnp.abs(jnp.minimum(self.beta, self.nu)), axis=1)
            self.friction_residual = jnp.maximum(between, jnp.abs(jnp.minimum(self.slip, self.within)))

    def residual(self) -> Scalar:
        """Largest violation of complementarity, ``max |min(z, w)|`` (friction on the circle: of the projection)."""
        contacts = jnp.maximum(jnp.abs(jnp.minimum(self.normal, self.clearance)), self.friction_residual)
        limits = jnp.abs(jnp.minimum(self.limit_force, self.limit_room))
        worst = jnp.max(jnp.where(self.local.active, contacts, 0.0), initial=0.0)
        return jnp.maximum(worst, jnp.max(jnp.where(self.local.limit_active, limits, 0.0), initial=0.0))

    def state(self, tolerance: float) -> Int[Real, " contact"]:
        """Open, sticking or sliding."""
        closed = self.local.active & (self.normal > jnp.maximum(self.clearance, tolerance))
        sliding = closed & (self.slip > jnp.maximum(self.within, tolerance))
        return jnp.where(sliding, SLIDING, jnp.where(closed, STICKING, OPEN)).astype(jnp.int32)

    def margin(self, tolerance: float) -> Scalar:
        """Distance from a change of contact state, as `solve` defines it."""
        active, state = self.local.active, self.state(tolerance)
        frictional = (state != OPEN) & (self.local.friction > 0)
        touching = jnp.where(active, jnp.maximum(self.normal, self.clearance), jnp.inf)
        slipping = jnp.where(frictional, jnp.maximum(self.within, self.slip), jnp.inf)
        least = jnp.minimum(jnp.min(touching, initial=jnp.inf), jnp.min(slipping, initial=jnp.inf))
        if self.beta is not None and self.nu is not None:
            corners = jnp.min(self.beta + self.nu, axis=1)
            corners = jnp.where(frictional & (state == SLIDING), corners, jnp.inf)
            least = jnp.minimum(least, jnp.min(corners, initial=jnp.inf))
        limits = jnp.where(self.local.limit_active, jnp.maximum(self.limit_force, self.limit_room), jnp.inf)
        return jnp.maximum(jnp.minimum(least, jnp.min(limits, initial=jnp.inf)), 0.0)


def directed(facets: int, f_t: Float[Real, "contact 2"], u_t: Float[Real, "contact 2"]) -> tuple[Real, Real, Real]:
    """beta and nu `[N, 2m]` of the tangents in ring order, lambda `[N]`."""
    directions = jnp.asarray(ring(facets), f_t.dtype)
    after, before = jnp.roll(directions, -1, axis=0), jnp.roll(directions, 1, axis=0)

    def cross(a, b):
        return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]

    f = f_t[:, None, :]
    share = jnp.minimum(cross(f, after[None]), cross(before[None], f)) / float(np.sin(np.pi / facets))
    against = -(u_t[:, None, 0] * directions[None, :, 0] + u_t[:, None, 1] * directions[None, :, 1])
    slip = jnp.maximum(jnp.max(against, axis=1), 0.0)
    return jnp.maximum(share, 0.0), slip[:, None] - against, slip


def _length(vectors):
    """Euclidean length of the rows, with derivative zero at zero."""
    square = jnp.sum(vectors**2, axis=1)
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
