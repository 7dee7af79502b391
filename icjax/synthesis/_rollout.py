"""Many steps: one scan, with or without a policy."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.lcp import Exact, Smoothed
from icjax.model import Model
from icjax.running import run
from icjax.synthesis._bodies import Target
from icjax.synthesis._check_targets import check_start, check_targets
from icjax.synthesis._contacts import slots
from icjax.synthesis._object import Object
from icjax.synthesis._policies import Policy
from icjax.synthesis._scene import PairFriction, Scene
from icjax.synthesis._stepper import State, StepInfo, init, step
from icjax.synthesis._surface import Surface, known


class _Step(eqx.Module):
    """`step` as a callable record: numbers are traced, so another scene of the same form compiles nothing new."""

    model: Model
    scene: Scene
    policy: Policy | None
    adjoint: Exact | Smoothed | None = None

    def __call__(self, carry: tuple[State, Any], target: Target) -> tuple[tuple[State, Any], StepInfo]:
        return jax.checkpoint(_Step._stepped)(self, carry, target)

    def _stepped(self, carry: tuple[State, Any], target: Target) -> tuple[tuple[State, Any], StepInfo]:
        state, memory = carry
        if self.policy is not None:
            target = self.policy.apply(memory, target)
        state, info = step(self.model, self.scene, state, target, self.adjoint)
        if self.policy is not None:
            memory = self.policy.observe(memory, self.model, self.scene, info)
        return (state, memory), info


def rollout(
    model: Model,
    scene: Scene,
    targets: Target,
    state: State | None = None,
    policy: Policy | None = None,
    adjoint: Exact | Smoothed | None = None,
    **running,
) -> tuple[State, StepInfo]:
    """Step through targets `[time]`, one scan, differentiable in forward and reverse mode in every number.

    **Arguments**: `targets` a row for each time step of length `scene.step`; `state` to start from, by default the
    first reference with unloaded pads, so that the first row of the result is the solution at the first target;
    `policy` what the hand changes on the way (Section 8.1), default nothing; `adjoint` the derivative that contact
    forces carry, by default that of what is computed, [`Smoothed`][icjax.lcp.Smoothed] one that sees contacts before
    they touch; `running` options of [`icjax.running.run`] (progress, cancellation, checkpoint).

    Reverse mode keeps the state of every step and computes the step again, which takes less time here than keeping
    what it found, and little memory.

    **Returns**: the last state and the stacked [`StepInfo`].

    **Errors**: `ValueError` for a model without pads in a scene without objects, targets of another model or scene, an
    object that begins farther inside a pad than that is thick, or a scene whose contacts would be missed (see
    [`Scene`]).
    """
    if not (model.pad_names or scene.objects):
        raise ValueError(f"model {model.name!r} has no contact pads, and the scene no objects")
    check_targets(model, scene, targets, begins=state is None)
    slots(model, scene)  # errors with the names that people gave
    named = scene
    scene = dataclasses.replace(scene, limits=min(scene.limits, _limited(model)))
    if policy is not None and not isinstance(policy, Policy):
        raise TypeError(f"policy must be a Policy or None; got {policy!r}")
    if policy is None:
        scene = _unnamed(scene)
    model, targets = jax.tree.map(jnp.asarray, (model, targets))
    if state is None:
        state = _init(model, scene, targets.reference[0])
        check_start(model, named, state.contacts.gap)
    memory = () if policy is None else policy.init(model, scene)
    result = run(_Step(model, scene, policy, adjoint), (state, memory), targets, **running)
    return result.carry[0], result.outputs


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
        contacts=scene.contacts,
        limits=scene.limits,
    )


def _limited(model: Model) -> int:
    """How many limits the model has, where its numbers are known; as many as there could be, where they are traced."""
    ends = known(model.lower), known(model.upper)
    return sum(2 * model.nq if end is None else int(np.isfinite(end).sum()) for end in ends)


def _renamed(item: Object, name: str) -> Object:
    if item.driven:
        return Object(name, item.shape, item.friction, com=item.com, pose=item.pose, driven=True)
    return dataclasses.replace(item, name=name)
