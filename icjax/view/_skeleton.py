"""The body as a picture sees it: bones between body origins, and where the bodies are over time."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.model import Model, forward_kinematics
from icjax.spatial import Pose
from icjax.typing import Float, Real

CHUNK = 256
"""Frames a compiled call takes, so that records of any length share one compilation."""


SHORTEST = 1e-4
"""m; a segment shorter than this is not drawn."""


class Bone(NamedTuple):
    """Tapered capsule fixed to a body, body frame, m."""

    body: int
    start: np.ndarray
    end: np.ndarray
    start_radius: float
    end_radius: float


def bones(model: Model) -> tuple[Bone, ...]:
    """Capsules that stand for the segments of a model.

    A body reaches from its origin to the origin of each child body, or to its contact pads, or to twice its
    centre of mass where it has neither; a body whose frame sits at its child's origin (a forearm with its frame at
    the wrist) reaches there from twice its centre of mass. Thickness follows the pad where the model has one, else
    the length; it is a picture, not a collision shape, but for the pads that are capsules.

    **Returns**: a tuple of `Bone`.
    """
    segments = _segments(model)
    if not segments:
        return ()
    lengths = np.array([np.linalg.norm(end - begin) for _, begin, end, _ in segments])
    typical = 0.14 * float(np.median(lengths))
    thin = float(np.min(np.asarray(model.pad_radius))) if len(model.pad_names) else 0.6 * typical
    made = []
    for (body, begin, end, pad), length in zip(segments, lengths, strict=True):
        start = thin * np.clip((length / lengths.min()) ** 0.45, 1.0, 1.9)
        made.append(Bone(body, begin, end, float(start), float(pad or 0.86 * start)))
    return (*made, *_capsules(model))


def _capsules(model: Model) -> list[Bone]:
    """Pads that are capsules, as they are."""
    found = []
    for pad in model.capsule_pads:
        centre, axis = np.asarray(model.pad_centre[pad], dtype=float), np.asarray(model.pad_axis, dtype=float)[pad]
        radius = float(model.pad_radius[pad])
        found.append(Bone(model.pad_bodies[pad], centre - axis, centre + axis, radius, radius))
    return found


def _segments(model: Model) -> list[tuple[int, np.ndarray, np.ndarray, float | None]]:
    """Body, start and end point in its frame and pad radius (if it ends in a pad) of every segment with a length."""
    count = len(model.body_names)
    position = np.asarray(model.body_position, dtype=float)
    found: list[tuple[int, np.ndarray, np.ndarray, float | None]] = []
    for body in range(1, count):
        children = [child for child in range(1, count) if model.body_parents[child] == body]
        ends: list[tuple[np.ndarray, float | None]] = [(position[child], None) for child in children]
        for pad, owner in enumerate(model.pad_bodies):
            if owner == body and pad not in model.capsule_pads:
                ends.append((np.asarray(model.pad_centre[pad], dtype=float), float(model.pad_radius[pad])))
        far, origin = 2.0 * np.asarray(model.body_com[body], dtype=float), np.zeros(3)
        made = [(body, origin, end, pad) for end, pad in ends if np.linalg.norm(end) > SHORTEST]
        if not made and np.linalg.norm(far) > SHORTEST:
            made = [(body, far, origin, None) if ends else (body, origin, far, None)]
        found += made
    return found


def body_poses(model: Model, q: Float[Real, "time coordinate"]) -> tuple[np.ndarray, np.ndarray]:
    """World poses of every body over time.

    **Arguments**: `q`, coordinates as in `Model`; rows with NaN give NaN.

    **Returns**: rotations `[time, body, 3, 3]` and origins `[time, body, 3]` (m), NumPy.
    """
    rows = np.asarray(q)
    padded = np.concatenate([rows, np.repeat(rows[-1:], -len(rows) % CHUNK, axis=0)])
    chunks = [_chunk_poses(model, jnp.asarray(part)) for part in np.split(padded, len(padded) // CHUNK)]
    rotation = np.concatenate([np.asarray(poses.rotation, dtype=float) for poses in chunks])
    position = np.concatenate([np.asarray(poses.position, dtype=float) for poses in chunks])
    return rotation[: len(rows)], position[: len(rows)]


@eqx.filter_jit
def _chunk_poses(model: Model, q: Float[Real, "time coordinate"]) -> Pose:
    return jax.vmap(forward_kinematics, in_axes=(None, 0))(model, q)


def pad_path(model: Model, q: Float[Real, "time coordinate"], pad: int = 0) -> np.ndarray:
    """Path of a pad centre `[time, 3]` (m, world); the last body's bone end where the model has no pads."""
    rotation, position = body_poses(model, q)
    if len(model.pad_names):
        body, point = model.pad_bodies[pad], np.asarray(model.pad_centre[pad], dtype=float)
    else:
        last = bones(model)[-1]
        body, point = last.body, last.end
    return position[:, body] + rotation[:, body] @ point


def up_direction(model: Model) -> np.ndarray:
    """Unit vector against gravity; +z where the model has no gravity."""
    gravity = np.asarray(model.gravity, dtype=float)
    size = float(np.linalg.norm(gravity))
    return -gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])


class ScalarJoint(NamedTuple):
    """A joint with one coordinate, and the units in which pictures show it."""

    name: str
    coordinate: int
    dof: int
    kind: str

    @property
    def scale(self) -> float:
        """Shown units in a rad or a metre."""
        return 1e3 if self.kind == "slide" else float(np.degrees(1.0))

    @property
    def unit(self) -> str:
        """Unit in which the coordinate is shown."""
        return "mm" if self.kind == "slide" else "deg"

    @property
    def compliance_unit(self) -> str:
        """Unit of the joint's compliance."""
        return "m/N" if self.kind == "slide" else "rad/Nm"


def scalar_joints(model: Model) -> tuple[ScalarJoint, ...]:
    """Every hinge and slide, root to tip. Ball and free joints have no single coordinate to draw over time."""
    return tuple(
        ScalarJoint(name, coordinates.start, dofs.start, kind)
        for name, kind, coordinates, dofs in zip(
            model.joint_names, model.joint_types, model.coordinate_slices, model.dof_slices, strict=True
        )
        if kind in ("hinge", "slide")
    )
