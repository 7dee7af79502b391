"""Force plates: from the channels of a C3D file to a wrench in world axes."""

import numpy as np
from jaxtyping import Float

from icjax.files import FileError, ForcePlate, MotionFile


def plate_frame(plate: ForcePlate) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Axes of a plate and the centre of its surface: (R_WP, p_WP), the columns of R_WP in world coordinates.

    Corner 1 lies in the quadrant (+x, +y), corner 2 in (-x, +y), corner 4 in (+x, -y); z = x cross y points down,
    into the plate, for plates entered as the C3D manual asks.
    """
    x = plate.corners[0] - plate.corners[1]
    z = np.cross(x, plate.corners[0] - plate.corners[3])
    if not np.linalg.norm(z) > 0:
        raise ValueError("the corners of a force plate lie on one line")
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1), plate.corners.mean(axis=0)


def plate_wrench(motion: MotionFile, plate: ForcePlate) -> Float[np.ndarray, "sample 6"]:
    """Wrench (moment about the world origin, force) of a plate in world axes, Nm and N, before taring.

    With the plate's axes R and surface centre p, and (M_S, F) the wrench in plate axes about that centre:
    f_W = R F and m_W = R M_S + p x R F.

    **Sign.** Software that writes C3D (Vicon, Motion Analysis, BTS) stores the *reaction*: z of the plate points
    down, a person who stands on it reads a negative Fz, and the returned force is the force **on the subject**.
    Files of software that stores the action need `sign = "on_environment"` in the session file.

    **Reference point.** Types 2 and 4 give moments about the transducer's origin, `plate.origin` is the way from
    there to the surface centre, in plate axes; it must point up (negative z), but many files hold its negative,
    so that a positive z is turned round: M_S = M - r x F. Type 3 has r = (0, 0, az0) and the sensor distances
    (a, b) in `plate.origin`. Type 1 gives the centre of pressure and the free moment instead.

    **Errors**: `FileError` for a plate type other than 1 to 4.

    **Source**: The C3D File Format User Guide, Motion Lab Systems, "FORCE_PLATFORM"; type 3 from Kistler's
    formulas for plates with eight channels.
    """
    raw = motion.analog[:, list(plate.channels)]
    R, p = plate_frame(plate)
    force, moment = _surface_wrench(motion.path, plate, raw)
    force_W = force @ R.T
    return np.concatenate([moment @ R.T + np.cross(p[None, :], force_W), force_W], axis=1)


def _surface_wrench(path: str, plate: ForcePlate, raw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force and moment about the surface centre, plate axes."""
    if plate.type == 1:
        force, point = raw[:, :3], np.concatenate([raw[:, 3:5], np.zeros((len(raw), 1))], axis=1)
        free = np.concatenate([np.zeros((len(raw), 2)), raw[:, 5:6]], axis=1)
        return force, np.cross(point, force) + free
    if plate.type == 3:
        x12, x34, y14, y23, z1, z2, z3, z4 = raw.T
        a, b = plate.origin[0], plate.origin[1]
        force = np.stack([x12 + x34, y14 + y23, z1 + z2 + z3 + z4], axis=1)
        moment = np.stack([b * (z1 + z2 - z3 - z4), a * (z2 + z3 - z1 - z4), b * (x34 - x12) + a * (y14 - y23)], axis=1)
        r = np.array([0.0, 0.0, -abs(plate.origin[2])])
    elif plate.type in (2, 4):
        if plate.type == 4 and plate.calibration is None:
            raise FileError(path, "a force plate of type 4 has no calibration matrix")
        wrench = raw if plate.calibration is None else raw @ plate.calibration.T
        force, moment = wrench[:, :3], wrench[:, 3:6]
        r = plate.origin * (-1.0 if plate.origin[2] > 0 else 1.0)
    else:
        raise FileError(path, f"force plates of type {plate.type} are not supported (types 1 to 4 are)")
    return force, moment - np.cross(r[None, :], force)
