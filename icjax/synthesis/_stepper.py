"""Time stepping of Section 7: one contact problem a step."""

import equinox as eqx
import jax
import jax.numpy as jnp

from icjax import contact
from icjax.contact import ContactProblem, contact_frame
from icjax.model import Model, difference, integrate
from icjax.results import RESULTS
from icjax.running import run
from icjax.synthesis._bodies import QuasiStaticHand, Target
from icjax.synthesis._contacts import Contacts, find_contacts, slots
from icjax.synthesis._object import Motion, Object, advanced, at_start, rigid_admittance
from icjax.synthesis._scene import PairFriction, Scene
from icjax.synthesis._surface import Surface
from icjax.typing import Float, Int, Real

STATUSES = (
    RESULTS.solved,
    RESULTS.secondary_ray,
    RESULTS.breakdown,
    RESULTS.max_pivots,
    RESULTS.not_converged,
    RESULTS.invalid_input,
)
"""Meaning of `StepInfo.status`, by its number."""


PARTING = 0.1
"""m/s; how fast rigid things that overlap are pushed apart (all at once, a millimetre would become 0.5 m/s)."""


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

    `q`, `contact_point`, `gap`, `torque` = J^T f, `equilibrium_error` (Eq. 7) and the places of the objects are those
    at the end of the step, their velocities means over it; `contact_force` lies in the friction cone about
    `contact_normal`, that of the start of the step, in which the problem was posed. Where `status` is not 0 the force
    is the best point that the solver met, not a solution.
    """

    q: Float[Real, "*time nq"]
    reference: Float[Real, "*time nq"]
    torque: Float[Real, "*time nv"]
    contact_force: Float[Real, "*time slot 3"]
    contact_point: Float[Real, "*time slot 3"]
    contact_normal: Float[Real, "*time slot 3"]
    gap: Float[Real, "*time slot"]
    slip_state: Int[Real, "*time slot"]
    equilibrium_error: Float[Real, "*time nv"]
    residual: Float[Real, "*time"]
    status: Int[Real, "*time"]
    margin: Float[Real, "*time"]
    object_position: Float[Real, "*time object 3"]
    object_quaternion: Float[Real, "*time object 4"]
    object_velocity: Float[Real, "*time object 3"]
    object_angular_velocity: Float[Real, "*time object 3"]


def init(model: Model, scene: Scene, q: Float[Real, " nq"]) -> State:
    """State at configuration `q`, objects at start; pads unloaded: the first step pushes out their penetration."""
    motions = tuple(at_start(item) for item in scene.objects)
    contacts = find_contacts(model, scene, q, motions=motions)
    return State(q=jnp.asarray(q), pad_force=jnp.zeros_like(contacts.point), contacts=contacts, motions=motions)


def step(model: Model, scene: Scene, state: State, target: Target) -> tuple[State, StepInfo]:
    r"""Advance hand and objects by one time step to a new reference and compliance.

    Every body answers the contact forces with $\Delta q = \Delta q_{free} + A J^T f$ (`QuasiStaticHand`,
    `rigid_admittance`). With soft pads of compliance $C_p$ the contacts move by

    $$\Delta u = W f + J \Delta q_{free} - P_t C_p f(k), \qquad W = J A J^T + C_p$$

    and $f = f(k+1)$ solves the complementarity problem of Section 7.1.3, one for all bodies. The pad's term counts the
    tangential force from the one already there, so that a stuck finger does not creep; normally the gap is that of the
    undeformed pad and nothing is subtracted. $P_t$ projects on the tangent plane.

    **Arguments**: `state` from `init` or the step before; `target` theta_r(k+1) and C(k+1).

    **Returns**: the next state and what happened; a failed solve is reported in `status`, not repaired.

    **Source**: Kry and Pai (2006), Section 7.1, Eq. 7 to 10.
    """
    here, table = state.contacts, slots(model, scene)
    count, nv = here.gap.shape[0], model.nv
    hand = QuasiStaticHand(model).admittance(state.q, target)
    wrenches = _wrenches(scene, target, here.gap.dtype)
    rigid = [
        rigid_admittance(item, motion, scene.gravity, wrench, scene.step)
        for item, motion, wrench in zip(scene.objects, state.motions, wrenches, strict=True)
    ]
    free = jnp.concatenate([hand.free, *(body.free for body in rigid)])
    admittance = jax.scipy.linalg.block_diag(hand.matrix, *(body.matrix for body in rigid))

    J = here.jacobian.reshape(3 * count, free.shape[0])
    coupling = J @ admittance @ J.T + jnp.diag(jnp.repeat(table.compliance, 3))
    force = jnp.einsum("iab,ib->ia", here.rotation, state.pad_force)
    tangential = force - here.normal * jnp.sum(here.normal * force, axis=1, keepdims=True)
    problem = ContactProblem(
        coupling=coupling,
        free_displacement=J @ free - (table.compliance[:, None] * tangential).reshape(-1),
        # Pads are pressed as deep as they are; rigid things part at a speed that is no blow.
        gap=jnp.where(table.pad >= 0, here.gap, jnp.maximum(here.gap, -PARTING * scene.step)),
        frames=jax.vmap(contact_frame)(here.normal),
        friction=table.friction,
        active=jnp.ones(count, bool),
    )
    solution = contact.solve(problem, facets=scene.facets)

    force = solution.value.force
    pushed = J.T @ force.reshape(-1)
    moved = free + admittance @ pushed
    q = integrate(model, state.q, moved[:nv])
    motions = tuple(
        advanced(item, motion, moved[at : at + 6], wrench + pushed[at : at + 6], scene.step)
        for at, item, motion, wrench in zip(
            range(nv, nv + 6 * len(rigid), 6), scene.objects, state.motions, wrenches, strict=True
        )
    )
    # The pad's deformation belongs to the finger and turns with it; with J taken at the deformed point this is
    # consistent to first order: r(k+1) - r(k) = J dq + R C_p (f(k+1) - f(k)) in the finger's frame.
    pad_force = jnp.einsum("iba,ib->ia", here.rotation, force)
    there = find_contacts(model, scene, q, pad_force, motions)
    torque = jnp.einsum("iad,ia->d", there.jacobian[:, :, :nv], force)
    info = StepInfo(
        q=q,
        reference=jnp.asarray(target.reference),
        torque=torque,
        contact_force=force,
        contact_point=there.point,
        contact_normal=here.normal,
        gap=there.gap,
        slip_state=solution.value.slip_state,
        equilibrium_error=hand.matrix @ torque - difference(model, jnp.asarray(target.reference), q),
        residual=solution.stats["residual"],
        status=_status(solution.result),
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


def _rows(rows: list[Real], size: int, dtype) -> Real:
    return jnp.stack(rows) if rows else jnp.zeros((0, size), dtype)


class _Step(eqx.Module):
    """`step` as a callable record: numbers are traced, so another scene of the same form compiles nothing new."""

    model: Model
    scene: Scene

    def __call__(self, state: State, target: Target) -> tuple[State, StepInfo]:
        return step(self.model, self.scene, state, target)


def rollout(
    model: Model, scene: Scene, targets: Target, state: State | None = None, **running
) -> tuple[State, StepInfo]:
    """Step through targets `[time]`, one scan, differentiable in forward and reverse mode in every number.

    **Arguments**: `targets` a row for each time step of length `scene.step`; `state` to start from, by default the
    first reference with unloaded pads, so that the first row of the result is the solution at the first target;
    `running` options of [`icjax.running.run`] (progress, cancellation, checkpoint).

    **Returns**: the last state and the stacked [`StepInfo`].

    **Errors**: `ValueError` for a model without pads in a scene without objects, targets of another model or scene, or
    a scene with contacts that would be missed (see [`Scene`]).
    """
    if not (model.pad_names or scene.objects):
        raise ValueError(f"model {model.name!r} has no contact pads, and the scene no objects")
    shapes = jnp.shape(targets.reference)[1:], jnp.shape(targets.compliance)[1:]
    if shapes != ((model.nq,), (model.nv,)):
        raise ValueError(f"targets must be [time, {model.nq}] and [time, {model.nv}]; got [time, ...] {shapes}")
    if targets.wrench is not None and jnp.shape(targets.wrench)[1:] != (len(scene.objects), 6):
        found = jnp.shape(targets.wrench)
        raise ValueError(f"wrench must be [time, {len(scene.objects)}, 6], a row an object; got {list(found)}")
    slots(model, scene)  # errors with the names that people gave
    model, targets = jax.tree.map(jnp.asarray, (model, targets))
    scene = _unnamed(scene)
    if state is None:
        state = _init(model, scene, targets.reference[0])
    result = run(_Step(model, scene), state, targets, **running)
    return result.carry, result.outputs


_init = eqx.filter_jit(init)


def _unnamed(scene: Scene) -> Scene:
    """The same scene without what only people read, so that scenes of one form share a compiled step."""
    names = [thing.name for thing in (*scene.surfaces, *scene.objects)]
    number = {name: f"#{index}" for index, name in enumerate(names)}
    return Scene(
        name="",
        surfaces=tuple(Surface(number[item.name], item.shape, item.friction) for item in scene.surfaces),
        facets=scene.facets,
        step=scene.step if scene.objects else 0.002,  # a quasi-static hand knows no time
        objects=tuple(_renamed(item, number[item.name]) for item in scene.objects),
        gravity=scene.gravity,
        frictions=tuple(
            PairFriction((number.get(a, a), number.get(b, b)), pair.friction)
            for pair in scene.frictions
            for a, b in [pair.names]
        ),
    )


def _renamed(item: Object, name: str) -> Object:
    return Object(
        name,
        item.shape,
        item.friction,
        mass=item.mass,
        com=item.com,
        inertia=item.inertia,
        pose=item.pose,
        velocity=item.velocity,
        angular_velocity=item.angular_velocity,
    )


def _status(result: RESULTS) -> Int[Real, ""]:
    return sum(
        (jnp.asarray(result == status, jnp.int32) * number for number, status in enumerate(STATUSES)),
        jnp.zeros((), jnp.int32),
    )
