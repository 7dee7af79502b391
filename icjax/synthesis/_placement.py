"""Where the object stands before it is grasped (Section 8.3)."""

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from icjax.model import Model
from icjax.spatial import Pose, quaternion_to_rotation
from icjax.synthesis._bodies import Target
from icjax.synthesis._contacts import slots
from icjax.synthesis._rollout import rollout
from icjax.synthesis._scene import Scene
from icjax.synthesis._stepper import StepInfo


def place_objects(model: Model, scene: Scene, targets: Target, pads: Sequence[str] | None = None) -> Scene:
    """Let the hand push the objects where it will meet them: forward until all fingers touch, then back.

    **Arguments**: `scene` with the objects about where they were at capture; `targets` the grasp, a row each
    `scene.step`; `pads` that must touch an object at the same time, default all of the model.

    **Returns**: the scene with the objects where the hand left them, at rest.

    **Errors**: `ValueError` for a scene without free objects, unknown pads, steps that are not solved, or pads that
    never touch together, with the ones that were missing when most did.

    **Source**: Kry and Pai (2006), Section 8.3.
    """
    if all(item.driven for item in scene.objects):
        raise ValueError("the scene has no free object to place")
    if not model.pad_names:
        raise ValueError(f"model {model.name!r} has no pads that could touch an object")
    wanted = [model.pad(name) for name in (model.pad_names if pads is None else pads)]
    touching = _touching(model, scene, _through(model, scene, targets))[:, wanted]
    together = touching.all(axis=1)
    if not together.any():
        most = int(np.argmax(touching.sum(axis=1)))
        missing = ", ".join(model.pad_names[pad] for pad, here in zip(wanted, touching[most], strict=True) if not here)
        raise ValueError(f"the fingers never touch together; at most all but {missing}, in row {most} of the targets")
    last = int(np.argmax(together)) + 1
    there_and_back = jax.tree.map(lambda row: jnp.concatenate([row[:last], row[:last][::-1]]), targets)
    info = _through(model, scene, there_and_back)
    still = jnp.zeros(3)
    placed = tuple(
        item
        if item.driven
        else dataclasses.replace(
            item, pose=Pose(quaternion_to_rotation(quaternion), position), velocity=still, angular_velocity=still
        )
        for item, position, quaternion in zip(
            scene.objects, info.object_position[-1], info.object_quaternion[-1], strict=True
        )
    )
    return dataclasses.replace(scene, objects=placed)


def _through(model: Model, scene: Scene, targets: Target) -> StepInfo:
    """In chunks of one length, so that both ways share a compiled step."""
    info = rollout(model, scene, targets, progress=lambda done: None)[1]
    failed = np.flatnonzero(np.asarray(info.status))
    if failed.size:
        raise ValueError(
            f"{failed.size} of {len(info.status)} steps of the grasp are not solved, first row {failed[0]}"
        )
    return info


def _touching(model: Model, scene: Scene, info: StepInfo) -> np.ndarray:
    """Whether each pad presses on an object, `[time, pad]`."""
    table = slots(model, scene)
    loaded = np.any(np.asarray(info.contact_force) != 0, axis=2)
    free = np.array([not item.driven for item in scene.objects] + [False])[table.second]  # the last one is a surface
    columns = [loaded[:, (table.pad == pad) & free].any(axis=1) for pad in range(len(model.pad_names))]
    return np.stack(columns, axis=1)
