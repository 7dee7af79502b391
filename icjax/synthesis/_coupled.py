"""One contact problem for all bodies of a step: which contacts and joint limits take part, and how they are coupled."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from icjax.contact import ContactForces, ContactProblem, contact_frame
from icjax.model import Model
from icjax.synthesis._contacts import Contacts, Slots
from icjax.synthesis._scene import Scene
from icjax.typing import Bool, Float, Int, Real

PARTING = 0.1
"""m/s; how fast rigid things that overlap are pushed apart (all at once, a millimetre would become 0.5 m/s)."""

TOUCHING = 1e-9
"""m or rad; an overlap below it is rounding."""

MISSED = 1e-5
"""m or rad; by more than this nothing is overlapped at the end of a step that took no part in it."""


class Coupled(eqx.Module):
    """The contact problem of a step, and the way from its rows to slots and coordinates.

    **Fields**

    - `problem`: of the contacts and joint limits that take part.
    - `jacobian`: its rows over the coordinates of hand and objects.
    - `slots`: the slot of each contact.
    - `limits`: which limits take part, lower ones first.
    - `limit_jacobian`: the last rows of `jacobian`, those of the limits.
    - `crowded`: something that touches already has found no place in the problem.
    - `left`: contacts for which there was no place (not those that did not exist: of two solids that turn, new corners
      come to touch, as they do where there is room for all).
    """

    problem: ContactProblem
    jacobian: Float[Real, "row coordinate"]
    slots: Int[Real, " contact"]
    limits: Int[Real, " limit"]
    limit_jacobian: Float[Real, "limit coordinate"]
    crowded: Bool[Real, ""]
    left: Bool[Real, " slot"]

    def missed(self, there: Contacts, clearance: Float[Real, " end"]) -> Bool[Real, ""]:
        """Whether the step has led into something that took no part in it.

        **Arguments**: `there` geometry of all slots after the step, `clearance` of all limits (`limit_clearance`).
        """
        limits = jnp.ones(clearance.shape[0], bool).at[self.limits].set(False)
        overlapped = jnp.any(self.left & there.active & (there.gap < -MISSED))
        return overlapped | jnp.any(limits & (clearance < -MISSED))

    def pushed(self, value: ContactForces) -> Float[Real, " coordinate"]:
        """J^T f of contacts and limits."""
        return self.jacobian.T @ jnp.concatenate([value.force.reshape(-1), value.limit_force])

    def spread(self, values: Float[Real, "contact ..."] | Int[Real, " contact"], count: int) -> Real:
        """Values of the contacts in their slots, zero in those that take no part."""
        return jnp.zeros((count, *values.shape[1:]), values.dtype).at[self.slots].set(values)


def coupled(
    model: Model,
    scene: Scene,
    table: Slots,
    here: Contacts,
    q: Float[Real, " nq"],
    pad_force: Float[Real, "slot 3"],
    free: Float[Real, " coordinate"],
    admittance: Float[Real, "coordinate coordinate"],
) -> Coupled:
    r"""Pose the contact problem of one step (Section 7.1.3), joint limits beside the contacts (Section 8.3).

    $$\Delta u = W f + J \Delta q_{free} - P_t C_p f(k), \qquad W = J A J^T + C_p$$

    The pad's term counts the tangential force from the one already there, so that a stuck finger does not creep;
    normally the gap is that of the undeformed pad and nothing is subtracted. $P_t$ projects on the tangent plane. Where
    the scene has room for fewer contacts than there are slots, loaded ones keep their place, and of the others those
    take part that are nearest, now or after the step without forces; likewise of the limits.

    **Arguments**: `here` geometry of all slots at `q`; `pad_force` f(k) on the fingers, in the frames of the bodies
    that carry the pads; `free` and `admittance` of all bodies.
    """
    closing = jnp.minimum(here.gap, here.gap + jnp.einsum("ia,iad,d->i", here.normal, here.jacobian, free))
    loaded = jnp.sum(pad_force**2, axis=1) > 0
    slots, crowded = _places(jnp.where(loaded, -jnp.inf, jnp.where(here.active, closing, jnp.inf)), scene.contacts)
    friction, compliance = table.friction[slots], table.compliance[slots]
    left = jnp.asarray(here.active).at[slots].set(False)
    padded = jnp.asarray(table.pad >= 0)[slots]
    here, pad_force = jax.tree.map(lambda values: values[slots], (here, pad_force))
    limit = _limits(model, scene, q, free, jnp.diag(admittance))

    count, rows = here.gap.shape[0], limit.jacobian.shape[0]
    J = jnp.concatenate([here.jacobian.reshape(3 * count, -1), limit.jacobian])
    soft = jnp.concatenate([jnp.repeat(compliance, 3), jnp.zeros(rows, compliance.dtype)])
    force = jnp.einsum("iab,ib->ia", here.rotation, pad_force)
    tangential = force - here.normal * jnp.sum(here.normal * force, axis=1, keepdims=True)
    held = jnp.concatenate([(compliance[:, None] * tangential).reshape(-1), jnp.zeros(rows, force.dtype)])
    problem = ContactProblem(
        coupling=J @ admittance @ J.T + jnp.diag(soft),
        free_displacement=J @ free - held,
        # Pads are pressed as deep as they are; rigid things part at a speed that is no blow.
        gap=jnp.where(padded, here.gap, jnp.maximum(here.gap, -PARTING * scene.step)),
        frames=jax.vmap(contact_frame)(here.normal),
        friction=friction,
        active=here.active,
        limit_gap=limit.gap,
    )
    return Coupled(problem, J, slots, limit.chosen, limit.jacobian, crowded | limit.crowded, left)


def limit_clearance(model: Model, q: Float[Real, " nq"], yielding: Float[Real, " nv"]) -> Float[Real, " end"]:
    """Clearance of the lower limits of all hinges and slides, then of the upper ones; infinite of driven ones.

    **Arguments**: `yielding` the diagonal of the compliance.
    """
    at, dof, sign = _ends(model)
    ends = jnp.where(jnp.asarray(sign > 0), jnp.asarray(model.lower)[at], jnp.asarray(model.upper)[at])
    gap = jnp.where(yielding[dof] > 0, jnp.asarray(sign, q.dtype) * (q[at] - ends), jnp.inf)
    return jnp.where(jnp.isfinite(gap), gap, jnp.inf)  # so that no derivative meets an infinity


def _places(order: Float[Real, " candidate"], room: int | None) -> tuple[Int[Real, " place"], Bool[Real, ""]]:
    """The candidates with the smallest numbers, in their own order, and whether one below zero is left over."""
    total = order.shape[0]
    if room is None or room >= total:
        return jnp.arange(total), jnp.zeros((), bool)
    order = lax.stop_gradient(order)
    chosen = jnp.sort(lax.top_k(-order, room)[1])
    left = jnp.ones(total, bool).at[chosen].set(False)
    return chosen, jnp.any(left & (order < -TOUCHING))


class _Limits(NamedTuple):
    gap: Float[Real, " limit"]
    jacobian: Float[Real, "limit coordinate"]
    chosen: Int[Real, " limit"]
    crowded: Bool[Real, ""]


def _limits(model: Model, scene: Scene, q: Real, free: Real, yielding: Real) -> _Limits:
    """Those that are nearest; a driven joint follows its reference beyond its limits."""
    _, dof, sign = _ends(model)
    gap = limit_clearance(model, q, yielding[: model.nv])
    moved = jnp.asarray(sign, q.dtype) * free[dof]
    finite = jnp.isfinite(gap)
    closing = jnp.where(finite, jnp.where(finite, gap, 0.0) + jnp.minimum(moved, 0.0), jnp.inf)
    chosen, crowded = _places(closing, scene.limits)
    direction = jnp.asarray(sign, q.dtype)[:, None] * jax.nn.one_hot(dof, free.shape[0], dtype=q.dtype)
    return _Limits(gap[chosen], direction[chosen], chosen, crowded)


def _ends(model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinate, degree of freedom and sign of every limit that a hinge or slide may have."""
    joints = [
        (coordinate.start, dof.start)
        for kind, coordinate, dof in zip(model.joint_types, model.coordinate_slices, model.dof_slices, strict=True)
        if kind in ("hinge", "slide")
    ]
    at, dof = (np.array([joint[i] for joint in joints] * 2, int) for i in (0, 1))
    return at, dof, np.repeat([1.0, -1.0], len(joints))
