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
from icjax.synthesis._contacts import Contacts, find_contacts, slot_compliance
from icjax.synthesis._scene import Scene, Surface
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


class State(eqx.Module):
    """The hand at step k.

    **Fields**

    - `q`: theta(k).
    - `pad_force`: f(k) of every slot, on the finger, in the frame of the body that carries the pad, N. The tangential
      deformation of the pad that goes with it is where the next step starts from.
    - `contacts`: geometry at `q`.
    """

    q: Float[Real, " nq"]
    pad_force: Float[Real, "slot 3"]
    contacts: Contacts


class StepInfo(eqx.Module):
    """What a step found; the fields of a `Rollout`, one row.

    `q`, `contact_point`, `gap`, `torque` = J^T f and `equilibrium_error` (Eq. 7) are those at the end of the step;
    `contact_force` lies in the friction cone about `contact_normal`, that of the start of the step, in which the
    problem was posed. Where `status` is not 0 the force is the best point that the solver met, not a solution.
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


def init(model: Model, scene: Scene, q: Float[Real, " nq"]) -> State:
    """State at configuration `q` with unloaded pads (penetration is pushed out by the first step)."""
    contacts = find_contacts(model, scene, q)
    return State(q=jnp.asarray(q), pad_force=jnp.zeros_like(contacts.point), contacts=contacts)


def step(model: Model, scene: Scene, state: State, target: Target) -> tuple[State, StepInfo]:
    r"""Advance the hand by one time step to a new reference and compliance.

    With $\Delta q = \Delta q_{free} + A J^T f$ from the hand (`QuasiStaticHand`) and soft pads of compliance $C_p$,
    the contacts move by

    $$\Delta u = W f + J \Delta q_{free} - P_t C_p f(k), \qquad W = J A J^T + C_p$$

    and $f = f(k+1)$ solves the complementarity problem of Section 7.1.3. The pad's term counts the tangential force
    from the one already there, so that a stuck finger does not creep; normally the gap is that of the undeformed
    pad and nothing is subtracted. $P_t$ projects on the tangent plane.

    **Arguments**: `state` from `init` or the step before; `target` theta_r(k+1) and C(k+1).

    **Returns**: the next state and what happened; a failed solve is reported in `status`, not repaired.

    **Source**: Kry and Pai (2006), Section 7.1, Eq. 7 to 10.
    """
    here = state.contacts
    pad_compliance = slot_compliance(model, scene)
    count = here.gap.shape[0]
    hand = QuasiStaticHand(model).admittance(state.q, target)

    J = here.jacobian.reshape(3 * count, model.nv)
    coupling = J @ hand.matrix @ J.T + jnp.diag(jnp.repeat(pad_compliance, 3))
    force = jnp.einsum("iab,ib->ia", here.rotation, state.pad_force)
    tangential = force - here.normal * jnp.sum(here.normal * force, axis=1, keepdims=True)
    free = J @ hand.free - (pad_compliance[:, None] * tangential).reshape(-1)
    problem = ContactProblem(
        coupling=coupling,
        free_displacement=free,
        gap=here.gap,
        frames=jax.vmap(contact_frame)(here.normal),
        friction=_friction(model, scene, here.gap.dtype),
        active=jnp.ones(count, bool),
    )
    solution = contact.solve(problem, facets=scene.facets)

    force = solution.value.force
    q = integrate(model, state.q, hand.free + hand.matrix @ (J.T @ force.reshape(-1)))
    # The pad's deformation belongs to the finger and turns with it; with J taken at the deformed point this is
    # consistent to first order: r(k+1) - r(k) = J dq + R C_p (f(k+1) - f(k)) in the finger's frame.
    pad_force = jnp.einsum("iba,ib->ia", here.rotation, force)
    there = find_contacts(model, scene, q, pad_force)
    torque = jnp.einsum("iad,ia->d", there.jacobian, force)
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
    )
    return State(q=q, pad_force=pad_force, contacts=there), info


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

    **Errors**: `ValueError` for a model without pads, or targets of another model.
    """
    if not model.pad_names:
        raise ValueError(f"model {model.name!r} has no contact pads")
    shapes = jnp.shape(targets.reference)[1:], jnp.shape(targets.compliance)[1:]
    if shapes != ((model.nq,), (model.nv,)):
        raise ValueError(f"targets must be [time, {model.nq}] and [time, {model.nv}]; got [time, ...] {shapes}")
    model, targets = jax.tree.map(jnp.asarray, (model, targets))
    scene = _unnamed(scene)
    if state is None:
        state = _init(model, scene, targets.reference[0])
    result = run(_Step(model, scene), state, targets, **running)
    return result.carry, result.outputs


_init = eqx.filter_jit(init)


def _unnamed(scene: Scene) -> Scene:
    """The same scene without what only people read, so that scenes of one form share a compiled step."""
    surfaces = tuple(
        Surface(name=str(index), shape=surface.shape, friction=surface.friction)
        for index, surface in enumerate(scene.surfaces)
    )
    return Scene(name="", surfaces=surfaces, facets=scene.facets)


def _friction(model: Model, scene: Scene, dtype) -> Float[Real, " slot"]:
    each = jnp.stack([jnp.asarray(surface.friction, dtype) for surface in scene.surfaces])
    return jnp.tile(each, len(model.pad_names))


def _status(result: RESULTS) -> Int[Real, ""]:
    return sum(
        (jnp.asarray(result == status, jnp.int32) * number for number, status in enumerate(STATUSES)),
        jnp.zeros((), jnp.int32),
    )
