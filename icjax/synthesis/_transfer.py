"""From an interaction to what it does on another surface."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.interaction import Interaction
from icjax.model import Model, difference, integrate
from icjax.rollout import Rollout
from icjax.synthesis._bodies import Target
from icjax.synthesis._contacts import slot_names
from icjax.synthesis._policies import Policy
from icjax.synthesis._rollout import rollout
from icjax.synthesis._scene import Scene
from icjax.typing import Float, Real


@eqx.filter_jit
def resample(
    model: Model,
    time: Float[Real, " sample"],
    targets: Target,
    at: Float[Real, " time"],
) -> Target:
    """Interaction trajectory at other times.

    Coordinates move between samples along q = integrate(q_0, s difference(q_0, q_1)), 0 <= s <= 1, which is linear
    for hinges and slides and keeps quaternions at unit length; compliance is linear. Beyond the ends it stays.

    **Arguments**: `time` of the samples, s, increasing; `targets` `[sample]`; `at` the new times, s.
    """
    time, reference, compliance = (jnp.asarray(x) for x in (time, targets.reference, targets.compliance))
    left = jnp.clip(jnp.searchsorted(time, at, side="right") - 1, 0, time.shape[0] - 2)
    part = jnp.clip((at - time[left]) / (time[left + 1] - time[left]), 0.0, 1.0)

    def between(start, end, s):
        return integrate(model, start, s * difference(model, start, end))

    share = part.reshape(-1, *(1 for _ in compliance.shape[1:]))
    return Target(
        reference=jax.vmap(between)(reference[left], reference[left + 1], part),
        compliance=compliance[left] + share * (compliance[left + 1] - compliance[left]),
    )


def transfer(
    interaction: Interaction,
    scene: Scene,
    progress: Callable[[float], Any] | None = None,
    policy: Policy | None = None,
) -> Rollout:
    """Re-enact an interaction on the surfaces and objects of a scene (Section 7, one hand).

    **Arguments**: `interaction` compliance and reference trajectory with their model; `scene` surfaces, objects,
    friction, facets and time step; `progress` called with the fraction done; `policy` what the hand changes on the way
    (Section 8.1), default nothing.

    **Returns**: a `Rollout` with a row every `scene.step` from the first time of the interaction to its last. Steps
    that were not solved are marked in `Rollout.status`.

    **Errors**: `ValueError` for a model without pads, fewer than two samples, times that do not increase, more than
    ten million steps, or a compliance or reference that is
    not finite, or a negative compliance, naming the degree of freedom and the time.
    """
    _check(interaction, scene)
    model = interaction.model
    start, end = float(interaction.time[0]), float(interaction.time[-1])
    count = int(np.floor((end - start) / scene.step * (1.0 + 1e-12) + 1e-9)) + 1
    time = start + scene.step * np.arange(count)
    full = interaction.full_compliance
    samples = Target(interaction.reference, interaction.compliance if full is None else full)
    targets = resample(*jax.tree.map(jnp.asarray, (model, interaction.time, samples, time)))
    _, info = rollout(model, scene, targets, policy=policy, progress=progress)
    found = {name: np.asarray(value) for name, value in vars(info).items()}
    if not scene.objects:
        found = {name: value for name, value in found.items() if not name.startswith("object_")}
    return Rollout(
        name=interaction.name,
        model=model,
        scene=scene.describe(),
        time=time,
        slot_names=slot_names(model, scene),
        object_names=tuple(item.name for item in scene.objects),
        **found,
    )


DIAGONAL = 1e-6
"""How far the diagonal of the full compliance may be from `compliance`, as a share."""

MOST_FAILED = 0.5
"""Share of the steps; a rollout of which more is unsolved says nothing."""

MOST_STEPS = 10_000_000
"""Five and a half hours at 2 ms; more is a mistake in the times or in the step."""


def _check(interaction: Interaction, scene: Scene) -> None:
    if not interaction.model.pad_names:
        raise ValueError(
            f"model {interaction.model.name!r} has no contact pads, so nothing of it can touch a surface; "
            "a pad is a sphere or capsule geom whose name begins with 'pad'"
        )
    time = np.asarray(interaction.time)
    if len(time) < 2:
        raise ValueError(f"interaction {interaction.name!r} has {len(time)} samples; two are needed")
    wrong = np.flatnonzero(~(np.diff(time) > 0))
    if len(wrong) or not np.isfinite(time).all():
        row = int(wrong[0]) if len(wrong) else 0
        raise ValueError(f"interaction {interaction.name!r}: time does not increase after sample {row + 1}")
    if (time[-1] - time[0]) / scene.step > MOST_STEPS:
        raise ValueError(
            f"step {scene.step:g} s divides {time[-1] - time[0]:g} s into more than {MOST_STEPS} steps; it is too short"
        )
    _check_shapes(interaction)
    compliance, reference = np.asarray(interaction.compliance), np.asarray(interaction.reference)
    bad = ~np.isfinite(compliance) | (compliance < 0)
    if bad.any():
        row, dof = np.argwhere(bad)[0]
        name, value, time = interaction.model.dof_names[dof], compliance[row, dof], float(interaction.time[row])
        raise ValueError(f"compliance of {name} is {value:g} at {time:.3f} s; it must be finite and not negative")
    bad = ~np.isfinite(reference)
    if bad.any():
        row, coordinate = np.argwhere(bad)[0]
        value, time = reference[row, coordinate], float(interaction.time[row])
        raise ValueError(f"reference coordinate {coordinate} is {value:g} at {time:.3f} s; it must be finite")


def _check_shapes(interaction: Interaction) -> None:
    model, count, full = interaction.model, len(interaction.time), interaction.full_compliance
    sizes: dict[str, tuple[int, ...]] = {"reference": (count, model.nq), "compliance": (count, model.nv)}
    if full is not None:
        sizes["full_compliance"] = (count, model.nv, model.nv)
    for name, size in sizes.items():
        found = np.shape(getattr(interaction, name))
        if found != size:
            raise ValueError(f"interaction {interaction.name!r}: {name} must be {list(size)}; got {list(found)}")
    if full is not None:
        diagonal = np.diagonal(np.asarray(full), axis1=1, axis2=2)
        off = np.abs(diagonal - np.asarray(interaction.compliance)) > DIAGONAL * np.abs(diagonal)
        if off.any():
            row, dof = np.argwhere(off)[0]
            raise ValueError(
                f"interaction {interaction.name!r}: full_compliance of {model.dof_names[dof]} is "
                f"{diagonal[row, dof]:g} in row {row}, but compliance {float(interaction.compliance[row][dof]):g}"
            )
