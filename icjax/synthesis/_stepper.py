"""Time stepping of Section 7: one contact problem a step."""

import equinox as eqx
import jax
import jax.numpy as jnp

from icjax import contact
from icjax.lcp import Exact, Smoothed
from icjax.model import Model, difference, integrate
from icjax.results import RESULTS
from icjax.synthesis._bodies import QuasiStaticHand, Target
from icjax.synthesis._contacts import Contacts, find_contacts, slots
from icjax.synthesis._coupled import coupled, limit_clearance
from icjax.synthesis._object import Motion, advanced, at_start, object_admittance
from icjax.synthesis._scene import Scene
from icjax.typing import Float, Int, Real

STATUSES = (
    RESULTS.solved,
    RESULTS.secondary_ray,
    RESULTS.breakdown,
    RESULTS.max_pivots,
    RESULTS.not_converged,
    RESULTS.invalid_input,
    RESULTS.crowded,
)
"""Meaning of `StepInfo.status`, by its number."""


class State(eqx.Module):
    """Hand and objects at step k.

    **Fields**

    - `q`: theta(k).
    - `motions`: phi(k) and q(k) of the objects.
    - `pad_force`: f(k) of every slot, on the finger, in the frame of the body that carries the pad, N. The tangential
      deformation of the pad that goes with it is where the next step starts from.
    - `contacts`: geometry at `q`.
    """

    q: Float[Real, " nq"]
    pad_force: Float[Real, "slot 3"]
    contacts: Contacts
    motions: tuple[Motion, ...] = ()


class StepInfo(eqx.Module):
    """What a step found; the fields of a `Rollout`, one row.

    `q`, `contact_point`, `gap`, `torque` = J^T f, `equilibrium_error` (Eq. 7, with `limit_torque`, that of the joint
    limits) and the places of the objects are those at the end of the step, their velocities means over it;
    `contact_force` lies in the friction cone about `contact_normal`, that of the start of the step, in which the
    problem was posed; `compliance` is the one of the step, its diagonal. Where `status` is not 0 the force is the best
    point that the solver met, not a solution.
    """

    q: Float[Real, "*time nq"]
    reference: Float[Real, "*time nq"]
    torque: Float[Real, "*time nv"]
    contact_force: Float[Real, "*time slot 3"]
    contact_point: Float[Real, "*time slot 3"]
    contact_normal: Float[Real, "*time slot 3"]
    gap: Float[Real, "*time slot"]
    slip_state: Int[Real, "*time slot"]
    limit_torque: Float[Real, "*time nv"]
    compliance: Float[Real, "*time nv"]
    equilibrium_error: Float[Real, "*time nv"]
    residual: Float[Real, "*time"]
    status: Int[Real, "*time"]
    margin: Float[Real, "*time"]
    object_position: Float[Real, "*time object 3"]
    object_quaternion: Float[Real, "*time object 4"]
    object_velocity: Float[Real, "*time object 3"]
    object_angular_velocity: Float[Real, "*time object 3"]


def init(model: Model, scene: Scene, q: Float[Real, " nq"]) -> State:
    """State at configuration `q`, objects at start; pads unloaded: the first step pushes out their penetration.

    **Errors**: `ValueError` for a `q` of another size.
    """
    if jnp.shape(q) != (model.nq,):
        raise ValueError(f"q must be {model.nq} numbers, the coordinates of model {model.name!r}; got {jnp.shape(q)}")
    motions = tuple(at_start(item) for item in scene.objects)
    contacts = find_contacts(model, scene, q, motions=motions)
    return State(q=jnp.asarray(q), pad_force=jnp.zeros_like(contacts.point), contacts=contacts, motions=motions)


def step(
    model: Model, scene: Scene, state: State, target: Target, adjoint: Exact | Smoothed | None = None
) -> tuple[State, StepInfo]:
    r"""Advance hand and objects by one time step to a new reference and compliance.

    Every body answers the forces with $\Delta q = \Delta q_{free} + A J^T f$ (`QuasiStaticHand`,
    `object_admittance`). With soft pads of compliance $C_p$ the contacts move by

    $$\Delta u = W f + J \Delta q_{free} - P_t C_p f(k), \qquad W = J A J^T + C_p$$

    and $f = f(k+1)$ solves the complementarity problem of Section 7.1.3, one for all bodies, joint limits included. The
    pad's term counts the tangential force from the one already there, so that a stuck finger does not creep.

    **Arguments**: `state` from `init` or the step before; `target` theta_r(k+1) and C(k+1); `adjoint` the derivative
    that the forces carry (see [`icjax.contact.solve`]); it changes no result.

    **Returns**: the next state and what happened; a failed solve is reported in `status`, not repaired.

    **Source**: Kry and Pai (2006), Section 7.1, Eq. 7 to 10.
    """
    here, table = state.contacts, slots(model, scene)
    count, nv = here.gap.shape[0], model.nv
    hand = QuasiStaticHand(model).admittance(state.q, target)
    wrenches = _wrenches(scene, target, here.gap.dtype)
    paths = _paths(scene, target)
    bodies = [
        object_admittance(item, motion, scene.gravity, wrench, path, scene.step)
        for item, motion, wrench, path in zip(scene.objects, state.motions, wrenches, paths, strict=True)
    ]
    free = jnp.concatenate([hand.free, *(body.free for body in bodies)])
    admittance = jax.scipy.linalg.block_diag(hand.matrix, *(body.matrix for body in bodies))
    posed = coupled(model, scene, table, here, state.q, state.pad_force, free, admittance)
    solution = contact.solve(posed.problem, facets=scene.facets, adjoint=adjoint)

    pushed = posed.pushed(solution.value)
    moved = free + admittance @ pushed
    q = integrate(model, state.q, moved[:nv])
    motions = tuple(
        advanced(item, motion, moved[at : at + 6], wrench + pushed[at : at + 6], scene.step)
        for at, item, motion, wrench in zip(
            range(nv, nv + 6 * len(bodies), 6), scene.objects, state.motions, wrenches, strict=True
        )
    )
    force = posed.spread(solution.value.force, count)
    # The pad's deformation belongs to the finger and turns with it; with J taken at the deformed point this is
    # consistent to first order: r(k+1) - r(k) = J dq + R C_p (f(k+1) - f(k)) in the finger's frame.
    pad_force = jnp.einsum("iba,ib->ia", here.rotation, force)
    there = find_contacts(model, scene, q, pad_force, motions)
    crowded = posed.crowded | posed.missed(there, limit_clearance(model, q, jnp.diagonal(hand.matrix)))
    valid = jnp.all(jnp.isfinite(moved)) & jnp.all(jnp.isfinite(admittance))  # what is lost touches nothing
    result = RESULTS.where(crowded, RESULTS.crowded, solution.result)
    result = RESULTS.where(valid, result, RESULTS.invalid_input)
    torque = jnp.einsum("iad,ia->d", there.jacobian[:, :, :nv], force)
    limit_torque = posed.limit_jacobian[:, :nv].T @ solution.value.limit_force
    info = StepInfo(
        q=q,
        reference=jnp.asarray(target.reference),
        torque=torque,
        contact_force=force,
        contact_point=there.point,
        contact_normal=here.normal,
        gap=there.gap,
        slip_state=posed.spread(solution.value.slip_state, count),
        limit_torque=limit_torque,
        compliance=jnp.diagonal(hand.matrix),
        equilibrium_error=hand.matrix @ (torque + limit_torque) - difference(model, jnp.asarray(target.reference), q),
        residual=solution.stats["residual"],
        status=_status(result),
        margin=solution.value.margin,
        object_position=_rows([motion.position for motion in motions], 3, q.dtype),
        object_quaternion=_rows([motion.quaternion for motion in motions], 4, q.dtype),
        object_velocity=_rows([motion.velocity for motion in motions], 3, q.dtype),
        object_angular_velocity=moved[nv:].reshape(-1, 6)[:, :3] / scene.step,
    )
    return State(q=q, pad_force=pad_force, contacts=there, motions=motions), info


def _wrenches(scene: Scene, target: Target, dtype) -> list[Real]:
    if target.wrench is None:
        return [jnp.zeros(6, dtype) for _ in scene.objects]
    return list(jnp.asarray(target.wrench))


def _paths(scene: Scene, target: Target) -> list[Real | None]:
    """Where each object is driven to, None for a free one and for one that stays."""
    poses = iter(() if target.path is None else target.path)
    return [next(poses, None) if item.driven else None for item in scene.objects]


def _rows(rows: list[Real], size: int, dtype) -> Real:
    return jnp.stack(rows) if rows else jnp.zeros((0, size), dtype)


def _status(result: RESULTS) -> Int[Real, ""]:
    return sum(
        (jnp.asarray(result == status, jnp.int32) * number for number, status in enumerate(STATUSES)),
        jnp.zeros((), jnp.int32),
    )
