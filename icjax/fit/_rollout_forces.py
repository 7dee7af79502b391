"""Measured contact forces against those of a simulated contact."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.fit._check_forces import check_forces, measured_rows, pads_to_slots
from icjax.fit._parameters import Values
from icjax.fit._roles import of_role, role, used
from icjax.fit._static import deviated
from icjax.lcp import Exact, Smoothed
from icjax.model import Model, difference, integrate
from icjax.synthesis import Scene, StepInfo, Target, rollout
from icjax.typing import Bool, Float, Int, Real


class ContactForces(eqx.Module):
    r"""Forces on the pads (and joint angles) of one trial against a simulation of it on known surfaces.

    $$r = [(f - \hat f) / \sigma_f, (\theta - \hat\theta) / \sigma_\theta], \qquad
    (\hat f, \hat\theta) = rollout(C, \theta_0 + B d, \mu, C_p)$$

    The simulation ([`icjax.synthesis.rollout`]) makes a step for every row of the nominal reference and begins at its
    first row with unloaded pads. Forces are those on each pad, of all that it touches. Film sensors give the normal
    force only: it says nothing of friction and little of what turns with the tangential force.

    Derivatives are exact on the contact state of every step and one-sided where it changes; `adjoint` may be
    [`Smoothed`][icjax.lcp.Smoothed], which sees contacts before they touch (the residual is the same). A step that
    could not be solved keeps the solver's best point, without derivative: `unsolved` counts them.

    **Parameters** of which `uses` names those that the fit may change

    - "compliance": `[joint]` the diagonal or `[joint, joint]` of the compliant degrees of freedom, rad/Nm, m/N.
      Without it: that of the model.
    - "reference", or "reference of ..." of some movement: d `[basis, joint]` of the same degrees of freedom, rad, m;
      trials of one intended movement on different surfaces share it. Without it: zero.
    - "friction": one number for all surfaces and objects or one each in their order; or "friction of NAME" of some.
      Without it: that of the scene.
    - "pad stiffness": one number or `[pad]`, N/m. Without it: that of the model.
    - "sensor gain" and "sensor bias" (N): a sensor shows gain f + bias; one number or one a pad that was measured.
      Without them: one and zero. A gain and stiffnesses that all change alike cannot be told apart by forces alone.
    - "sensor delay": one number, s; a sensor shows what acted so much earlier, linear between rows. Without it: zero.

    **Fields**: see the arguments; `rows` of the simulation that were measured, at its `times`, `gather` `[pad, slot]`
    which slots act on a pad.

    **Arguments**

    - `name`; `model`; `scene`; `time` s of the samples; `force` measured on the pads, `[time, pad, 3]` N, world, or
      `[time, pad]` normal only; `force_sd` N, one number or of the last axes of `force`.
    - `nominal` theta_0 `[row, nq]` and `reference_time` `[row]` s, default `time`; every sample must be one of its
      rows. `basis` B `[row, basis]` ([`spline_basis`]).
    - `angles` `[time, nq]` measured coordinates and `angle_sd` (rad, m; one number or one a compliant degree of
      freedom); default not compared.
    - `joints`: the compliant degrees of freedom by name, default those of finite compliance above zero; the others
      are driven. `pads`: names of those with a sensor, default all. `counts` `[time]` which samples count, default all.
    - `uses`, default "compliance" and with a basis "reference"; `adjoint`.

    To simulate forces that were never measured, give zeros and call `predict`.

    **Errors**: `ValueError` for shapes that do not agree, numbers that are not finite in a sample that counts,
    standard deviations that are not positive, a reference that ends before the trial or lacks its times, with objects
    a reference that is not spaced by the scene's step, and unknown names.
    """

    name: str = eqx.field(static=True)
    uses: tuple[str, ...] = eqx.field(static=True)
    dofs: tuple[int, ...] = eqx.field(static=True)
    model: Model
    scene: Scene
    force: Float[Real, "time pad ..."]
    force_sd: Float[Real, "..."]
    nominal: Float[Real, "row nq"]
    basis: Float[Real, "row basis"] | None
    angles: Float[Real, "time nq"] | None
    angle_sd: Float[Real, "..."] | None
    rows: Int[Real, " time"]
    times: Float[Real, " row"]
    gather: Float[Real, "pad slot"]
    counts: Bool[Real, " time"]
    adjoint: Exact | Smoothed | None

    def __init__(
        self,
        name: str,
        model: Model,
        scene: Scene,
        time: Any,
        force: Any,
        force_sd: Any,
        nominal: Any,
        *,
        uses: Sequence[str] | None = None,
        reference_time: Any = None,
        basis: Any = None,
        angles: Any = None,
        angle_sd: Any = None,
        joints: tuple[str, ...] | None = None,
        pads: tuple[str, ...] | None = None,
        counts: Any = None,
        adjoint: Exact | Smoothed | None = None,
    ):
        what = f"measurement {name!r}"
        self.name, self.model, self.scene, self.adjoint = name, model, scene, adjoint
        self.uses = used(what, uses, compliance=True, reference=basis is not None)
        self.dofs = compliant(what, model, joints)
        self.gather = pads_to_slots(what, model, scene, pads)
        rows, self.counts = measured_rows(what, scene, time, reference_time, counts)
        self.rows = jnp.asarray(rows)
        self.times = jnp.asarray(time if reference_time is None else reference_time, float)
        check_forces(what, self, force, force_sd, nominal, basis, angles, angle_sd, time, reference_time)
        self.force = jnp.where(_wide(self.counts, force), jnp.asarray(force, float), 0.0)
        self.force_sd = jnp.asarray(force_sd, float)
        self.nominal = jnp.asarray(nominal, float)
        self.basis = None if basis is None else jnp.asarray(basis, float)
        at = self.nominal[self.rows]  # stands for angles that were not measured, which count nothing
        self.angles = None if angles is None else jnp.where(_wide(self.counts, angles), jnp.asarray(angles, float), at)
        self.angle_sd = None if angle_sd is None else jnp.asarray(angle_sd, float)

    def simulate(self, values: Values) -> StepInfo:
        """The rollout at the values of the parameters, a row for every row of the reference."""
        model, scene = self._pads(values), self._scene(values)
        reference, deviation = self.nominal, of_role(self.uses, values, "reference")
        if deviation is not None:
            moved = deviated(self.name, self.basis, deviation)
            self._check("reference", np.shape(moved)[1:], len(self.dofs))
            dq = jnp.zeros((moved.shape[0], model.nv), moved.dtype).at[:, np.asarray(self.dofs)].set(moved)
            reference = jax.vmap(lambda q, dq: integrate(model, q, dq))(reference, dq)
        compliance = self._compliance(values)
        targets = Target(reference, jnp.broadcast_to(compliance, (reference.shape[0], *compliance.shape)))
        return rollout(model, scene, targets, adjoint=self.adjoint)[1]

    def predict(self, values: Values) -> tuple[Float[Real, "time pad ..."], Float[Real, "time nq"]]:
        """Forces on the pads as they were measured (N) and coordinates (rad, m), at the samples."""
        return self._sampled(self.simulate(values), values)

    def residual(self, values: Values) -> Float[Real, " row"]:
        """(measured - predicted) / sd of all forces, then of the angles; zero where a sample does not count."""
        force, q = self._sampled(self.simulate(values), values)
        off = (self.force - force) / jnp.broadcast_to(self.force_sd, force.shape)
        parts = [jnp.where(_wide(self.counts, off), off, 0.0).reshape(-1)]
        if self.angles is not None:
            off = jax.vmap(lambda a, b: difference(self.model, a, b))(q, self.angles)[:, np.asarray(self.dofs)]
            off = off / jnp.broadcast_to(jnp.asarray(self.angle_sd), off.shape)
            parts.append(jnp.where(self.counts[:, None], off, 0.0).reshape(-1))
        return jnp.concatenate(parts)

    def unsolved(self, values: Values) -> Int[Real, ""]:
        """How many steps of the simulation were not solved."""
        return jnp.sum(self.simulate(values).status != 0)

    def _sampled(self, info: StepInfo, values: Values):
        if self.force.ndim == 2:
            force = jnp.sum(info.contact_force * info.contact_normal, axis=2) @ jnp.abs(self.gather).T
        else:
            force = jnp.einsum("ps,tsa->tpa", self.gather, info.contact_force)
        delay = of_role(self.uses, values, "sensor delay")
        if delay is None:
            force = force[self.rows]
        else:
            when = self.times[self.rows] - jnp.reshape(delay, ())
            columns = force.reshape(len(force), -1)
            columns = jax.vmap(lambda column: jnp.interp(when, self.times, column), 1, 1)(columns)
            force = columns.reshape(-1, *force.shape[1:])
        gain, bias = self._by_pad("sensor gain", values, 1.0), self._by_pad("sensor bias", values, 0.0)
        return gain * force + bias, info.q[self.rows]

    def _by_pad(self, what: str, values: Values, default: float):
        """A sensor's number, to be broadcast over forces [time, pad, ...]."""
        stated = of_role(self.uses, values, what)
        if stated is None:
            return default
        if np.ndim(stated):
            self._check(what, np.shape(stated), self.gather.shape[0])
        return jnp.reshape(stated, (1, -1, *(1 for _ in self.force.shape[2:])))

    def _compliance(self, values: Values):
        dofs, nv = np.asarray(self.dofs), self.model.nv
        stated = of_role(self.uses, values, "compliance")
        stated = jnp.asarray(self.model.compliance)[dofs] if stated is None else stated
        if stated.ndim == 2:
            self._check("compliance", stated.shape, len(dofs), len(dofs))
            return jnp.zeros((nv, nv), stated.dtype).at[np.ix_(dofs, dofs)].set(stated)
        self._check("compliance", stated.shape, len(dofs))
        return jnp.zeros(nv, stated.dtype).at[dofs].set(stated)

    def _pads(self, values: Values) -> Model:
        stiffness = of_role(self.uses, values, "pad stiffness")
        if stiffness is None:
            return self.model
        if np.ndim(stiffness):
            self._check("pad stiffness", np.shape(stiffness), len(self.model.pad_names))
        compliance = jnp.broadcast_to(1.0 / stiffness, (len(self.model.pad_names),))
        return dataclasses.replace(self.model, pad_compliance=compliance)

    def _scene(self, values: Values) -> Scene:
        things = (*self.scene.surfaces, *self.scene.objects)
        frictions = [thing.friction for thing in things]
        for name in self.uses:
            if role(name) != "friction":
                continue
            stated = jnp.asarray(values[name])
            if name == "friction":
                if stated.ndim:
                    self._check("friction", stated.shape, len(things))
                frictions = list(jnp.broadcast_to(stated, (len(things),)))
            else:
                at = [thing.name for thing in things].index(name.removeprefix("friction of "))
                frictions[at] = stated.reshape(())
        fixed, free = len(self.scene.surfaces), len(self.scene.objects)

        def where(scene):
            return [scene.surfaces[i].friction for i in range(fixed)] + [scene.objects[i].friction for i in range(free)]

        return eqx.tree_at(where, self.scene, frictions)

    def _check(self, what: str, found: tuple[int, ...], *wanted: int) -> None:
        if tuple(found) != wanted:
            raise ValueError(f"measurement {self.name!r}: {what} must be {list(wanted)}; got {list(found)}")


def compliant(what: str, model: Model, joints: tuple[str, ...] | None) -> tuple[int, ...]:
    """Numbers of the compliant degrees of freedom. **Errors**: `ValueError` for unknown names or none at all."""
    stated = np.asarray(model.compliance, float)
    names = model.dof_names
    if joints is None:
        joints = tuple(name for name, value in zip(names, stated, strict=True) if np.isfinite(value) and value > 0)
    unknown = [name for name in joints if name not in names]
    if unknown or not joints:
        raise ValueError(f"{what}: joints {unknown or 'is empty'}; model {model.name!r} has {', '.join(names)}")
    return tuple(names.index(name) for name in joints)


def _wide(counts: Any, like: Any):
    return jnp.asarray(counts).reshape(-1, *(1 for _ in np.shape(like)[1:]))
