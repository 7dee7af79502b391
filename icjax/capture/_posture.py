"""What is known of a posture before any marker is seen: for fingers that carry fewer markers than they have joints."""

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from icjax.model import Model
from icjax.typing import Float, Real


class PosturePrior(NamedTuple):
    """Independent normal beliefs about linear combinations of hinge and slide coordinates, and soft limits.

    In units of a marker's error, so that they can stand among the residuals of the markers:

        r = noise (matrix q - target) / sd,   r_j = noise (q_j beyond its limit) / limit_sd.

    - `over_q` [row, nq], `over_v` [row, nv]: noise matrix / sd over coordinates and over displacements.
    - `target` [row]: noise target / sd.
    - `limit` [nq]: noise / limit_sd, zero for coordinates without limits.
    - `noise`: m, per axis; how far a marker is from its place on the true pose (skin, model), before any is seen.
    """

    over_q: Float[Real, "row nq"]
    over_v: Float[Real, "row nv"]
    target: Float[Real, " row"]
    limit: Float[Real, " nq"]
    noise: Float[Real, ""] | float


NO_NOISE = 1.0
"""m; stands for the noise of a prior that says nothing."""


def no_prior(model: Model) -> PosturePrior:
    """The prior that says nothing."""
    return PosturePrior(np.zeros((0, model.nq)), np.zeros((0, model.nv)), np.zeros(0), np.zeros(model.nq), NO_NOISE)


def posture_prior(
    model: Model,
    noise: float,
    sd: float | None = None,
    limit_sd: float | None = None,
    angles: Mapping[str, tuple[float, float]] | None = None,
    couplings: Mapping[str, tuple[str, float, float]] | None = None,
) -> PosturePrior:
    """A prior in words.

    **Arguments**

    - `noise`: m, per axis, of a marker against the true pose.
    - `sd`: rad (m for a slide), of every hinge and slide about the model's rest; None for no such belief.
    - `limit_sd`: rad (m), how far a coordinate goes beyond the model's limits; None lets it.
    - `angles`: mean and standard deviation of single joints by name, in place of `sd`.
    - `couplings`: q_joint = ratio q_other, by the joint's name: (other, ratio, sd), in place of `sd`. The end joint of
      a finger bends by about two thirds of the joint before it (Rijpkema and Girard 1991).

    **Errors**: `ValueError` for an unknown joint, or one that is neither hinge nor slide.
    """
    angles, couplings = dict(angles or {}), dict(couplings or {})
    column = {
        name: (part.start, dof.start)
        for name, kind, part, dof in zip(
            model.joint_names, model.joint_types, model.coordinate_slices, model.dof_slices, strict=True
        )
        if kind in ("hinge", "slide")
    }
    for name in (*angles, *couplings, *(other for other, _, _ in couplings.values())):
        if name not in column:
            model.joint(name)
            raise ValueError(f"joint {name!r} is neither a hinge nor a slide")
    rest = np.asarray(model.rest)
    rows: list[tuple[dict[str, float], float, float]] = []
    for name, (place, _) in column.items():
        if name in couplings:
            other, ratio, spread = couplings[name]
            rows.append(({name: 1.0, other: -ratio}, 0.0, spread))
        if name in angles:
            rows.append(({name: 1.0}, *angles[name]))
        elif name not in couplings and sd is not None:
            rows.append(({name: 1.0}, float(rest[place]), sd))
    over_q, over_v = np.zeros((len(rows), model.nq)), np.zeros((len(rows), model.nv))
    target, limit = np.zeros(len(rows)), np.zeros(model.nq)
    for index, (terms, mean, spread) in enumerate(rows):
        target[index] = noise * mean / spread
        for name, factor in terms.items():
            place, dof = column[name]
            over_q[index, place] = over_v[index, dof] = noise * factor / spread
    if limit_sd is not None:
        for place, _ in column.values():
            bounded = np.isfinite(model.lower[place]) or np.isfinite(model.upper[place])
            limit[place] = noise / limit_sd if bounded else 0.0
    return PosturePrior(over_q, over_v, target, limit, noise)


def prior_rows(
    model: Model, prior: PosturePrior, q: Float[Real, " nq"]
) -> tuple[Float[Real, " m"], Float[Real, "m nv"]]:
    """Residuals of the prior at `q`, m, and their derivative with respect to a displacement."""
    r, slope, dofs = _beyond_limits(model, prior, q)
    limits = jnp.zeros((len(dofs), model.nv), q.dtype).at[np.arange(len(dofs)), dofs].set(slope)
    r = jnp.concatenate([jnp.asarray(prior.over_q) @ q - jnp.asarray(prior.target), r])
    return r, jnp.concatenate([jnp.asarray(prior.over_v), limits])


def prior_normal_equations(
    model: Model, prior: PosturePrior, q: Float[Real, " nq"]
) -> tuple[Float[Real, ""], Float[Real, "nv nv"], Float[Real, " nv"]]:
    """r^T r, J^T J and J^T r of `prior_rows`, whose J is constant but for one entry in a row of a limit."""
    over_v = jnp.asarray(prior.over_v)
    r = jnp.asarray(prior.over_q) @ q - jnp.asarray(prior.target)
    beyond, slope, dofs = _beyond_limits(model, prior, q)
    spread = jnp.zeros((2, model.nv), q.dtype).at[:, dofs].set(jnp.stack([slope**2, slope * beyond]))
    return r @ r + beyond @ beyond, over_v.T @ over_v + jnp.diag(spread[0]), over_v.T @ r + spread[1]


def _beyond_limits(model: Model, prior: PosturePrior, q: Real) -> tuple[Real, Real, np.ndarray]:
    """Residuals of the soft limits, their slopes, and the degrees of freedom that they belong to."""
    scalar = [
        (part.start, dof.start)
        for kind, part, dof in zip(model.joint_types, model.coordinate_slices, model.dof_slices, strict=True)
        if kind in ("hinge", "slide")
    ]
    places = np.array([place for place, _ in scalar], int)
    dofs = np.array([dof for _, dof in scalar], int)
    here, weight = q[places], jnp.asarray(prior.limit)[places]
    above = here - jnp.asarray(model.upper)[places]
    below = jnp.asarray(model.lower)[places] - here
    beyond = jnp.maximum(above, 0.0) - jnp.maximum(below, 0.0)
    outside = ((above > 0) | (below > 0)).astype(q.dtype)
    return weight * beyond, weight * outside, dofs
