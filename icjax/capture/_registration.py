"""A first guess of the pose of a frame: the root body laid onto its markers."""

import numpy as np
from jaxtyping import Float

from icjax.model import Model, forward_kinematics, neutral
from icjax.spatial import rotation_to_quaternion


def start_coordinates(
    model: Model,
    sites: tuple[int, ...],
    markers: Float[np.ndarray, "frame marker 3"],
    weight: Float[np.ndarray, "frame marker"],
) -> Float[np.ndarray, "frame nq"]:
    """Neutral joints, with a free root joint moved so that the root body's sites lie on their markers.

    Where the root body carries fewer than three visible markers, all markers are used. A model without free root
    starts neutral.
    """
    q = np.tile(np.asarray(neutral(model)), (len(markers), 1))
    if not model.joint_types or model.joint_types[0] != "free":
        return q
    poses = forward_kinematics(model, neutral(model))
    bodies = np.asarray(model.site_bodies)[list(sites)]
    root = model.joint_bodies[0]
    rotation, position = np.asarray(poses.rotation), np.asarray(poses.position)
    local = np.asarray(model.site_position)[list(sites)]
    world = np.einsum("sij,sj->si", rotation[bodies], local) + position[bodies]
    own = (world - position[root]) @ rotation[root]
    for frame in range(len(markers)):
        seen = weight[frame] > 0
        use = seen & (bodies == root)
        if use.sum() < 3:
            use = seen
        if use.sum() >= 3:
            R, p = rigid_registration(own[use], markers[frame, use])
            q[frame, :3] = p
            q[frame, 3:7] = np.asarray(rotation_to_quaternion(R))
    return q


def rigid_registration(
    points: Float[np.ndarray, "n 3"], images: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Rotation R and translation p that minimise sum |R x_i + p - y_i|^2.

    **Source**: Kabsch 1976, Acta Cryst. A32, 922; Umeyama 1991 for the sign.
    """
    centre, image_centre = points.mean(axis=0), images.mean(axis=0)
    U, _, Vt = np.linalg.svd((images - image_centre).T @ (points - centre))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return R, image_centre - R @ centre
