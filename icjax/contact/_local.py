"""The contact problem in contact frames: what the solvers see."""

import equinox as eqx
import jax.numpy as jnp

from icjax.contact._problem import ContactProblem
from icjax.lcp import times
from icjax.typing import Bool, Float, Real


class LocalProblem(eqx.Module):
    """``u = W f + b``: three components a contact in its frame (normal first), then one a limit; gaps are part of b.

    **Fields**

    - `coupling`: W. `offset`: b, free displacement plus gap.
    - `friction`, `active`: of the contacts. `limit_active`: of the limits. Masked rows of W and b are zero.
    """

    coupling: Float[Real, "component component"]
    offset: Float[Real, " component"]
    friction: Float[Real, " contact"]
    active: Bool[Real, " contact"]
    limit_active: Bool[Real, " limit"]

    @property
    def contacts(self) -> int:
        """N."""
        return self.friction.shape[0]

    def displacement(self, forces: Float[Real, " component"]) -> Float[Real, " component"]:
        """u, clearances in the rows of normals and limits."""
        return times(self.coupling, forces) + self.offset

    def split(self, components: Float[Real, " component"]) -> tuple[Float[Real, "contact 3"], Float[Real, " limit"]]:
        """Of the contacts and of the limits."""
        count = 3 * self.contacts
        return components[:count].reshape(-1, 3), components[count:]


def localised(problem: ContactProblem) -> LocalProblem:
    """The problem in its contact frames; its masked slots must hold harmless numbers."""
    count = problem.gap.shape[0]
    size = 3 * count
    rows = turned(problem.frames, problem.coupling[:size])
    columns = turned(problem.frames, jnp.concatenate([rows, problem.coupling[size:]])[:, :size].T).T
    limits = jnp.concatenate([rows[:, size:], problem.coupling[size:, size:]])
    free = turned(problem.frames, problem.free_displacement[:size, None]).reshape(count, 3)
    limit_active = problem.limit_gap != jnp.inf
    clearance = problem.free_displacement[size:] + jnp.where(limit_active, problem.limit_gap, 0.0)
    return LocalProblem(
        coupling=jnp.concatenate([columns, limits], axis=1),
        offset=jnp.concatenate([jnp.asarray(free).at[:, 0].add(problem.gap).reshape(-1), clearance]),
        friction=jnp.asarray(problem.friction, free.dtype),
        active=jnp.asarray(problem.active),
        limit_active=limit_active,
    )


def turned(
    frames: Float[Real, "contact 3 3"], rows: Float[Real, "component column"]
) -> Float[Real, "component column"]:
    """World components as components in the contact frames."""
    count = frames.shape[0]
    return jnp.einsum("iab,iak->ibk", frames, rows.reshape(count, 3, rows.shape[1]), precision="highest").reshape(
        rows.shape
    )
