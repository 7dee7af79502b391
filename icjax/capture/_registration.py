"""A first guess of the pose of a frame: every free body laid onto its markers."""

import numpy as np
from jaxtyping import Float

from icjax.model import Model, neutral


def start_coordinates(
    model: Model,
    sites: tuple[int, ...],
    rotation: Float[np.ndarray, "body 3 3"],
    position: Float[np.ndarray, "body 3"],
    markers: Float[np.ndarray, "frame marker 3"],
    weight: Float[np.ndarray, "frame marker"],
) -> Float[np.ndarray, "frame nq"]:
    """Neutral joints, with every free joint moved so that its body's sites lie on their markers.

    Where such a body carries fewer than three visible markers, those of all bodies behind it are used. Joints other
    than free ones start neutral.

    **Arguments**: `rotation`, `position` (m): world poses of the bodies in the neutral posture; `markers` m.
    """
    from scipy.spatial.transform import Rotation

    q = np.tile(np.asarray(neutral(model)), (len(markers), 1))
    bodies = np.asarray(model.site_bodies)[list(sites)]
    local = np.asarray(model.site_position)[list(sites)]
    world = np.einsum("sij,sj->si", rotation[bodies], local) + position[bodies]
    path = np.asarray(model.path_mask)
    for joint, root in enumerate(model.joint_bodies):
        if model.joint_types[joint] != "free":
            continue
        behind = path[bodies, model.dof_slices[joint].start] > 0
        own = (world - position[root]) @ rotation[root]
        place = model.coordinate_slices[joint].start
        turns = np.tile(rotation[root], (len(markers), 1, 1))
        for frame in range(len(markers)):
            seen = behind & (weight[frame] > 0)
            use = seen & (bodies == root)
            if use.sum() < 3:
                use = seen
            if use.sum() >= 3:
                turns[frame], q[frame, place : place + 3] = rigid_registration(own[use], markers[frame, use])
        q[:, place + 3 : place + 7] = np.roll(Rotation.from_matrix(turns).as_quat(), 1, axis=1)
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


def rigid_registrations(
    points: Float[np.ndarray, "n 3"], images: Float[np.ndarray, "frame n 3"]
) -> tuple[Float[np.ndarray, "frame 3 3"], Float[np.ndarray, "frame 3"]]:
    """`rigid_registration` of the same points onto the images of every frame."""
    centre, image_centre = points.mean(axis=0), images.mean(axis=1)
    U, _, Vt = np.linalg.svd(np.einsum("fni,nj->fij", images - image_centre[:, None], points - centre))
    U[:, :, 2] *= np.linalg.det(U @ Vt)[:, None]
    R = U @ Vt
    return R, image_centre - R @ centre
