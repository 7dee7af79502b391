"""Forward kinematics and Jacobians (Section 6.1): one tree recursion, everything else by path masks."""

import math
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from icjax.model._model import Model
from icjax.model._tree import Tree, tree
from icjax.spatial import Pose, quaternion_to_rotation, rotation_exp
from icjax.typing import Float, Int, Real, Vector3

Index: TypeAlias = int | np.integer | Int[Real, ""]
"""Number of a body, known or traced."""


class Frames(NamedTuple):
    """World poses of all frames of the tree, and the twists of all degrees of freedom in world coordinates."""

    poses: Pose
    twists: Float[Real, "dof 6"]

    def bodies(self, model: Model, chosen: np.ndarray) -> Pose:
        """World poses of some bodies, `[chosen]`."""
        return self.poses[tree(model).body_frame[chosen]]


def forward_kinematics(model: Model, q: Float[Real, " nq"]) -> Pose:
    """World poses of all bodies, `X_WB` batched over bodies (`[body]` takes one; body 0 is the world).

    X_WB = X_WP X_PB(0) X_1(q_1) ... X_n(q_n), the joints of a body acting in their order about anchors and axes
    fixed in it.

    **Arguments**: `q` coordinates (rad, m, unit quaternions; see [`Model`]).
    **Returns**: `Pose` with rotation `[body, 3, 3]` and position `[body, 3]` (m).
    """
    return frame_poses(model, q)[tree(model).body_frame]


def frame_poses(model: Model, q: Float[Real, " nq"]) -> Pose:
    """World poses of all frames of the [`Tree`].

    The recursion X_i <- X_parent(i) X_i runs by pointer doubling: every round composes all frames with what they
    have reached so far and doubles the reach, so that a tree of depth d takes log2(d) batched products and the
    traced program stays small however many bodies there are.
    """
    topology = tree(model)
    poses, ancestor = _local_poses(model, topology, q), topology.parent_frame
    for _ in range(math.ceil(math.log2(max(topology.depth, 1)))):
        poses = jax.vmap(lambda a, b: a @ b)(poses[ancestor], poses)
        ancestor = ancestor[ancestor]
    return poses


def frames(model: Model, q: Float[Real, " nq"]) -> Frames:
    """Frames of the tree and twists of the degrees of freedom, J transposed, in world coordinates."""
    topology = tree(model)
    poses = frame_poses(model, q)
    carrier = poses[topology.dof_frame]
    twists = _local_twists(model, topology)
    w = jnp.einsum("dij,dj->di", carrier.rotation, twists[:, :3])
    v = jnp.einsum("dij,dj->di", carrier.rotation, twists[:, 3:]) + jnp.cross(carrier.position, w)
    return Frames(poses, jnp.concatenate([w, v], axis=1))


def world_jacobian(model: Model, q: Float[Real, " nq"]) -> Float[Real, "6 nv"]:
    """Twists (angular, linear at the world origin) of all degrees of freedom in world coordinates: J of Eq. 4.

    **Returns**: `[6, nv]`, a column a degree of freedom. Source: Kry and Pai 2006, Section 6.1.
    """
    return frames(model, q).twists.T


def body_jacobian(model: Model, q: Float[Real, " nq"], body: int) -> Float[Real, "6 nv"]:
    """Jacobian of a body's spatial velocity in world coordinates: V = J S_i v.

    **Arguments**: `body` index (`model.body(name)`). **Returns**: `[6, nv]`, zero columns where S_i is zero.
    Source: Kry and Pai 2006, Section 6.1.
    """
    J = world_jacobian(model, q)
    mask = tree(model).body_mask[body]
    return jnp.where(np.broadcast_to(mask, J.shape), J, 0.0)


def point_jacobian(model: Model, q: Float[Real, " nq"], body: Index, p_W: Vector3) -> Float[Real, "3 nv"]:
    """Jacobian of the velocity of a point that moves with a body: J_i = Gamma(p) J S_i; torques are J_i^T f.

    **Arguments**: `body` index; `p_W` the point in world coordinates, m. **Returns**: `[3, nv]`, m/s per unit of
    velocity. Source: Kry and Pai 2006, Eq. 4.
    """
    return jacobian_at(model, frames(model, q), body, p_W)


def jacobian_at(model: Model, state: Frames, body: Index, p_W: Vector3) -> Float[Real, "3 nv"]:
    """[`point_jacobian`] where the frames of a configuration are at hand."""
    w, v = state.twists[:, :3], state.twists[:, 3:]
    columns = v + jnp.cross(w, jnp.broadcast_to(p_W, w.shape))
    mask = jnp.asarray(tree(model).body_mask)[body]
    return jnp.where(jnp.broadcast_to(mask, (3, model.nv)), columns.T, 0.0)


def site_positions(model: Model, q: Float[Real, " nq"]) -> Float[Real, "site 3"]:
    """World positions of the marker sites, m."""
    return _carried(model, q, model.site_bodies, model.site_position)


def pad_positions(model: Model, q: Float[Real, " nq"]) -> Float[Real, "pad 3"]:
    """World positions of the centres of the contact pads, m."""
    return _carried(model, q, model.pad_bodies, model.pad_centre)


def _carried(model: Model, q: Real, bodies: tuple[int, ...], points: Real) -> Real:
    poses = forward_kinematics(model, q)[np.asarray(bodies, int)]
    return jax.vmap(lambda X, p: X.apply(p))(poses, jnp.asarray(points))


def _local_poses(model: Model, topology: Tree, q: Real) -> Pose:
    """Pose of every frame in its parent frame, as a function of its own coordinates."""
    q = jnp.asarray(q)
    slices = model.coordinate_slices
    starts = np.asarray([item.start for item in slices], int)
    joints = topology.joints
    anchor, axis = jnp.asarray(model.joint_position), jnp.asarray(model.joint_axis)

    # Bodies before their joints; a free joint replaces the place of its body.
    released = np.zeros(len(model.body_names), bool)
    released[np.asarray(model.joint_bodies, int)[joints["free"]]] = True
    body_rotation, body_position = jnp.asarray(model.body_rotation), jnp.asarray(model.body_position)
    eye = jnp.broadcast_to(jnp.eye(3, dtype=body_rotation.dtype), body_rotation.shape)
    fixed = np.concatenate([[True], released[1:]])
    rotations: list[Real] = [jnp.where(fixed[:, None, None], eye, body_rotation)]
    positions: list[Real] = [jnp.where(fixed[:, None], 0.0, body_position)]

    if len(joints["hinge"]):
        chosen, at = joints["hinge"], starts[joints["hinge"]]
        angle = q[at] - jnp.asarray(model.zero)[at]
        turned = jax.vmap(rotation_exp)(axis[chosen] * angle[:, None])
        rotations.append(turned)
        positions.append(anchor[chosen] - jnp.einsum("jab,jb->ja", turned, anchor[chosen]))
    if len(joints["slide"]):
        chosen, at = joints["slide"], starts[joints["slide"]]
        distance = q[at] - jnp.asarray(model.zero)[at]
        rotations.append(jnp.broadcast_to(jnp.eye(3, dtype=axis.dtype), (len(chosen), 3, 3)))
        positions.append(axis[chosen] * distance[:, None])
    if len(joints["ball"]):
        chosen = joints["ball"]
        turned = jax.vmap(quaternion_to_rotation)(q[starts[chosen][:, None] + np.arange(4)])
        rotations.append(turned)
        positions.append(anchor[chosen] - jnp.einsum("jab,jb->ja", turned, anchor[chosen]))
    if len(joints["free"]):
        at = starts[joints["free"]][:, None]
        rotations.append(jax.vmap(quaternion_to_rotation)(q[at + np.arange(3, 7)]))
        positions.append(q[at + np.arange(3)])
    return Pose(jnp.concatenate(rotations), jnp.concatenate(positions))


def _local_twists(model: Model, topology: Tree) -> Real:
    """Twist of every degree of freedom in the frame that carries it, where it is constant: `[dof, 6]`."""
    anchor, axis = jnp.asarray(model.joint_position), jnp.asarray(model.joint_axis)
    joints = topology.joints
    eye = np.eye(3, dtype=axis.dtype)
    hinge = jnp.concatenate([axis[joints["hinge"]], jnp.cross(anchor[joints["hinge"]], axis[joints["hinge"]])], axis=1)
    slide = jnp.concatenate([jnp.zeros((len(joints["slide"]), 3), axis.dtype), axis[joints["slide"]]], axis=1)
    axes = np.tile(eye, (len(joints["ball"]), 1))
    ball = jnp.concatenate([axes, jnp.cross(jnp.repeat(anchor[joints["ball"]], 3, axis=0), axes)], axis=1)
    free = jnp.tile(jnp.eye(6, dtype=axis.dtype), (len(joints["free"]), 1))
    return jnp.concatenate([hinge, slide, ball, free])[topology.dof_order]
