"""Course of an object over time, from a rollout."""

from typing import NamedTuple

import numpy as np

from icjax.rollout import Rollout
from icjax.view._objects import object_entry, object_rotation, upward
from icjax.view._pairs import pair_forces
from icjax.view._surfaces import scene_content


class ObjectCourse(NamedTuple):
    """What one object did, `[time]` where nothing else is said.

    **Fields**

    - `name`; `ball` whether it is one, which has no tilt; `time` s.
    - `moved` horizontally from its start and `lifted` above it, of the origin of its frame, m.
    - `tilt` of what was vertical; `turned` all the way, rad.
    - `speed` of the centre of mass, m/s.
    - `carried` upward sum of the contact forces on it, `pushed` force of the hand on it, N.
    - `weight` N, one number, None where the scene does not state it.
    - `overlap` deepest with anything rigid, m, one number.
    """

    name: str
    ball: bool
    time: np.ndarray
    moved: np.ndarray
    lifted: np.ndarray
    tilt: np.ndarray
    turned: np.ndarray
    speed: np.ndarray
    carried: np.ndarray
    pushed: np.ndarray
    weight: float | None
    overlap: float


def object_course(rollout: Rollout, name: str) -> ObjectCourse:
    """Course of an object, by its name."""
    number, up, time = rollout.object_names.index(name), upward(rollout), np.asarray(rollout.time, float)
    place = np.asarray(rollout.object_position, float)[:, number]
    place = place - place[:1]
    lifted = place @ up
    rotation = object_rotation(rollout, number)
    spin = np.linalg.norm(np.asarray(rollout.object_angular_velocity, float)[:, number], axis=1)
    pairs = pair_forces(rollout)
    sign = np.array([float(first == name) - float(second == name) for first, second in pairs.bodies])
    by_hand = pairs.on_hand & (sign < 0)
    stated, gravity = object_entry(rollout, name), scene_content(rollout.scene).get("gravity", ())
    known = len(gravity) == 3 and "mass" in stated
    rigid = np.array([name in bodies for bodies in rollout.slot_bodies()]) & ~np.array(rollout.on_hand())
    return ObjectCourse(
        name=name,
        ball=stated.get("shape") == "sphere",
        time=time,
        moved=np.linalg.norm(place - lifted[:, None] * up, axis=1),
        lifted=lifted,
        tilt=np.arccos(np.clip((rotation @ (rotation[0].T @ up)) @ up, -1.0, 1.0)),
        turned=np.concatenate([np.zeros(1), np.cumsum(spin[1:] * np.diff(time))]),
        speed=np.linalg.norm(np.asarray(rollout.object_velocity, float)[:, number], axis=1),
        carried=np.einsum("p,tpi,i->t", sign, pairs.force, up),
        pushed=np.linalg.norm(pairs.force[:, by_hand].sum(axis=1), axis=1),
        weight=float(stated["mass"]) * float(np.linalg.norm(gravity)) if known else None,
        overlap=max(0.0, -float(np.min(np.asarray(rollout.gap, float)[:, rigid], initial=0.0))),
    )
