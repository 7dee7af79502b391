"""Static bookkeeping of a kinematic tree: plain NumPy, done once a topology, never traced.

The tree is seen as a chain of frames: one for each body before its joints move it, and one after each joint. The
frame after a joint carries that joint's twists, which are constant in it; a body moves with the last of its frames.
"""

import dataclasses
import functools

import numpy as np

from icjax.model._model import VELOCITY_SIZE, Model

KINDS = ("hinge", "slide", "ball", "free")


@dataclasses.dataclass(frozen=True, eq=False)
class Tree:
    """Index arrays of one topology.

    Frames are numbered: bodies first (body b is frame b, the world 0), then joints sorted by kind.
    """

    joints: dict[str, np.ndarray]
    """Joint numbers of each kind."""
    parent_frame: np.ndarray
    """`[frame]`; the world is its own parent."""
    depth: int
    """Largest number of steps from a frame to the world."""
    body_frame: np.ndarray
    """`[body]` the frame that the body moves with."""
    dof_frame: np.ndarray
    """`[dof]` the frame that carries the twist of the degree of freedom."""
    dof_order: np.ndarray
    """`[dof]` where each degree of freedom stands when they are sorted by kind of joint."""
    body_mask: np.ndarray
    """`[body, dof]` bool, S_i of Eq. 4: the degree of freedom moves the body."""
    dof_mask: np.ndarray
    """`[dof, dof]` bool: the column's degree of freedom moves the frame that carries the row's twist."""


def tree(model: Model) -> Tree:
    """The index arrays of a model's topology."""
    return _tree(model.body_parents, model.joint_types, model.joint_bodies)


@functools.lru_cache(maxsize=64)
def _tree(parents: tuple[int, ...], kinds: tuple[str, ...], bodies: tuple[int, ...]) -> Tree:
    joints = {kind: np.flatnonzero([k == kind for k in kinds]) for kind in KINDS}
    sorted_joints = np.concatenate(list(joints.values())).astype(int)
    frame_of_joint = np.empty(len(kinds), int)
    frame_of_joint[sorted_joints] = len(parents) + np.arange(len(kinds))

    parent_frame = np.zeros(len(parents) + len(kinds), int)
    body_frame = np.zeros(len(parents), int)
    for body, parent in enumerate(parents):
        last = body
        if body > 0:
            parent_frame[body] = body_frame[parent]
        for joint in np.flatnonzero([b == body for b in bodies]):
            parent_frame[frame_of_joint[joint]] = last
            last = frame_of_joint[joint]
        body_frame[body] = last

    sizes = [VELOCITY_SIZE[kind] for kind in kinds]
    dof_joint = np.repeat(np.arange(len(kinds)), sizes)
    starts = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    by_kind = [np.arange(int(starts[joint]), int(starts[joint + 1])) for joint in sorted_joints]
    dof_order = np.argsort(np.concatenate([np.zeros(0, int), *by_kind]))
    dof_frame = frame_of_joint[dof_joint].astype(int)

    frame_mask = np.zeros((len(parent_frame), len(dof_joint)), bool)
    depth = 0
    for frame in range(len(parent_frame)):
        ancestor, steps = frame, 0
        while ancestor != 0:
            frame_mask[frame] |= dof_frame == ancestor
            ancestor, steps = parent_frame[ancestor], steps + 1
        depth = max(depth, steps)
    return Tree(
        joints, parent_frame, depth, body_frame, dof_frame, dof_order, frame_mask[body_frame], frame_mask[dof_frame]
    )
