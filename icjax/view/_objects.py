"""Objects of a rollout for pictures: what they look like and where they are."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.view._skeleton import up_direction
from icjax.view._solids import Solid, parts_of, solid
from icjax.view._style import OBJECTS
from icjax.view._surfaces import scene_content


class Moving(NamedTuple):
    """A solid in its own frame, its colour, and the pose of that frame over time: `[time, 3, 3]`, `[time, 3]` (m)."""

    solid: Solid
    colour: str
    rotation: np.ndarray
    position: np.ndarray

    def at(self, row: int, points: np.ndarray) -> np.ndarray:
        """Points of its frame in the world at a time."""
        return points @ self.rotation[row].T + self.position[row]


def moving(record: Recording | Interaction | Rollout, rows: np.ndarray | slice = slice(None)) -> tuple[Moving, ...]:
    """The objects of a rollout at some of its times, a union as its parts; none of any other record."""
    if not isinstance(record, Rollout) or record.object_position is None:
        return ()
    found = []
    for number, name in enumerate(record.object_names):
        position, rotation = np.asarray(record.object_position, float)[rows, number], object_rotation(record, number)
        for entry in parts_of(object_entry(record, name)):
            shape = solid(entry, name)
            if shape is not None:
                found.append(Moving(shape, object_colour(number), rotation[rows], position))
    return tuple(found)


def object_colour(number: int) -> str:
    """Colour of an object in every picture, by its number."""
    return OBJECTS[number % len(OBJECTS)]


def object_entry(rollout: Rollout, name: str) -> dict:
    """What the scene of a rollout says of an object; empty where it says nothing."""
    entries = scene_content(rollout.scene).get("objects", ())
    return next((entry for entry in entries if entry.get("name") == name), {})


def object_rotation(rollout: Rollout, number: int) -> np.ndarray:
    """Rotation of an object over time `[time, 3, 3]`, from its frame to world; NaN where a step was lost."""
    quaternion = np.asarray(rollout.object_quaternion, float)[:, number]
    known = np.isfinite(quaternion).all(axis=1)
    rotation = np.full((len(quaternion), 3, 3), np.nan)
    if known.any():
        rotation[known] = Rotation.from_quat(quaternion[known][:, [1, 2, 3, 0]]).as_matrix()
    return rotation


def upward(record: Recording | Interaction | Rollout) -> np.ndarray:
    """Unit vector against the gravity that objects feel, against that of the model where there are none."""
    if isinstance(record, Rollout) and record.object_names:
        gravity = np.asarray(scene_content(record.scene).get("gravity", np.zeros(3)), float)
        size = float(np.linalg.norm(gravity))
        if size > 0:
            return -gravity / size
    return up_direction(record.model)
