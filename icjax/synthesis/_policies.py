r"""What a hand changes on the way: grip tightening on slip, and adjustment before it (Section 8.1)."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.model import Model
from icjax.spatial import safe_norm
from icjax.synthesis._bodies import Target
from icjax.synthesis._contacts import slots
from icjax.synthesis._scene import Scene
from icjax.synthesis._stepper import StepInfo
from icjax.synthesis._surface import known
from icjax.typing import Bool, Float, Real, Scalar

SLIDING = 2
"""Of `StepInfo.slip_state`."""


class Policy(eqx.Module):
    """What changes the targets of a rollout by what has happened so far. Write your own as a subclass.

    Memory is any tree of arrays of fixed shapes; it travels through the scan beside the state.
    """

    @abstractmethod
    def init(self, model: Model, scene: Scene) -> Any:
        """Memory before the first step."""

    @abstractmethod
    def apply(self, memory: Any, target: Target) -> Target:
        """The target that the next step is made with, in place of the given one."""

    @abstractmethod
    def observe(self, memory: Any, model: Model, scene: Scene, info: StepInfo) -> Any:
        """Memory after a step."""


class GripTightening(Policy):
    r"""Stiffen some time after an object has begun to slip: the response to an unanticipated change.

    While a fingertip slid on an object `delay` ago, every compliance shrinks, $C \to C e^{-rate\,h}$ in each step.
    Only contacts with more than `least_force` count.

    **Arguments**: `delay` s, 0.1 as people need; `rate` 1/s; `least_force` N; `floor` least share of the compliance
    that is kept.

    **Errors**: `ValueError` for a negative number or a floor above one.

    **Source**: Kry and Pai (2006), Section 8.1, Figure 13 (d).
    """

    delay: float = eqx.field(static=True, default=0.1)
    rate: Scalar | float = 10.0
    least_force: Scalar | float = 0.2
    floor: Scalar | float = 0.0

    def __check_init__(self):
        if not (np.isfinite(self.delay) and self.delay >= 0):
            raise ValueError(f"delay must be zero or more s; got {self.delay}")
        _check(self)

    def init(self, model: Model, scene: Scene) -> tuple[Scalar, Bool[Real, " delay"]]:
        """Share of the compliance, and in which of the last steps something slid."""
        return jnp.ones(()), jnp.zeros(max(1, round(self.delay / scene.step)), bool)

    def apply(self, memory: tuple[Scalar, Bool[Real, " delay"]], target: Target) -> Target:
        """All compliances by the share."""
        return _scaled(target, memory[0])

    def observe(self, memory, model: Model, scene: Scene, info: StepInfo):
        """One step later."""
        share, past = memory
        force, held = _on_objects(model, scene, info)
        slid = jnp.any(held & (info.slip_state == SLIDING) & (_lengths(force) > self.least_force))
        share = _shrunk(share, past[0], self.rate, self.floor, scene.step)
        return share, jnp.concatenate([past[1:], slid[None]])


class ImminentSlip(Policy):
    r"""Stiffen before an object slips: the adjustment to an anticipated change.

    While $\|f_t\| > threshold\,\mu f_n$ at a fingertip that holds an object with more than `least_force`, every
    compliance shrinks, $C \to C e^{-rate\,h}$ in each step. On a polyhedral cone slip begins between
    $\mu \cos(\pi/2m)$ and $\mu$: take more facets for a threshold near one.

    **Arguments**: `threshold` share of mu; `rate` 1/s; `least_force` N; `floor` least share of the compliance that is
    kept.

    **Errors**: `ValueError` for a negative number, or a threshold or floor above one.

    **Source**: Kry and Pai (2006), Section 8.1, Figures 13 (e) and 14.
    """

    threshold: Scalar | float = 0.9
    rate: Scalar | float = 10.0
    least_force: Scalar | float = 0.2
    floor: Scalar | float = 0.0

    def __check_init__(self):
        _check(self)

    def init(self, model: Model, scene: Scene) -> Scalar:
        """Share of the compliance."""
        return jnp.ones(())

    def apply(self, memory: Scalar, target: Target) -> Target:
        """All compliances by the share."""
        return _scaled(target, memory)

    def observe(self, memory: Scalar, model: Model, scene: Scene, info: StepInfo) -> Scalar:
        """One step later."""
        force, held = _on_objects(model, scene, info)
        normal = jnp.sum(force * info.contact_normal, axis=1)
        tangential = _lengths(force - normal[:, None] * info.contact_normal)
        friction = slots(model, scene).friction
        near = tangential > self.threshold * friction * normal
        slips = jnp.any(held & near & (_lengths(force) > self.least_force))
        return _shrunk(memory, slips, self.rate, self.floor, scene.step)


def _on_objects(model: Model, scene: Scene, info: StepInfo) -> tuple[Float[Real, "slot 3"], np.ndarray]:
    """Forces, and which slots are those of fingertips on objects."""
    table = slots(model, scene)
    return info.contact_force, (table.pad >= 0) & (table.second >= 0)


def _lengths(vectors: Float[Real, "slot 3"]) -> Float[Real, " slot"]:
    return jax.vmap(safe_norm)(vectors)


def _shrunk(share: Scalar, when: Bool[Real, ""], rate: Any, floor: Any, h: float) -> Scalar:
    return jnp.where(when, jnp.maximum(share * jnp.exp(-rate * h), floor), share)


def _scaled(target: Target, share: Scalar) -> Target:
    return Target(target.reference, share * target.compliance, target.wrench, target.path)


def _check(policy: GripTightening | ImminentSlip) -> None:
    for name in ("threshold", "rate", "least_force", "floor"):
        value = known(getattr(policy, name, 0.0))
        most = 1.0 if name in ("threshold", "floor") else np.inf
        if value is not None and not (0.0 <= value <= most and np.isfinite(value)):
            raise ValueError(f"{name} must be {'0 to 1' if most == 1 else 'zero or more'}; got {value}")
