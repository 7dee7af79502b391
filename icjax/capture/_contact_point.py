"""Where a measured force acts: centre of pressure, or the place of the pad."""

import numpy as np
from jaxtyping import Bool, Float

from icjax.capture._spec import SurfaceSpec


def centre_of_pressure(
    moment: Float[np.ndarray, "frame 3"], force: Float[np.ndarray, "frame 3"], surface: SurfaceSpec
) -> tuple[Float[np.ndarray, "frame 3"], Float[np.ndarray, "frame 3"]]:
    """Point of the surface about which a wrench has no moment but along the normal, and that free moment.

    With the wrench (m, f) about the world origin, a point p_0 of the plane and its unit normal n:
    m_0 = m - p_0 x f, p = p_0 + (n x m_0) / (n . f), free moment n (n . (m - p x f)).

    **Arguments**: `moment` about the world origin, Nm; `force` N. **Returns** points (m; NaN where n . f = 0) and
    moments (Nm).
    """
    n, p0 = np.array(surface.normal), np.array(surface.point)
    pressing = force @ n
    safe = np.where(pressing == 0.0, np.nan, pressing)
    about = moment - np.cross(p0[None, :], force)
    point = p0 + np.cross(n[None, :], about) / safe[:, None]
    free = ((moment - np.cross(point, force)) @ n)[:, None] * n
    return point, np.nan_to_num(free)


def foot_of_pad(centre: Float[np.ndarray, "frame 3"], surface: SurfaceSpec) -> Float[np.ndarray, "frame 3"]:
    """Point of the surface closest to the centre of a pad."""
    n, p0 = np.array(surface.normal), np.array(surface.point)
    return centre - ((centre - p0) @ n)[:, None] * n


def contact_points(
    wrench: Float[np.ndarray, "frame 6"],
    touching: Bool[np.ndarray, " frame"],
    surface: SurfaceSpec | None,
    centre: Float[np.ndarray, "frame 3"] | None,
    radius: float,
    least: float,
) -> tuple[Float[np.ndarray, "frame 3"], Float[np.ndarray, "frame 3"]]:
    """Contact point and free moment of every frame, the point NaN and the moment zero where nothing touches.

    - With a surface and a pressing force of at least `least`: the centre of pressure, and the moment about the
      normal.
    - With less force: the foot of the pad's centre on the surface, without moment. Without a pad, the centre of
      pressure as long as it is defined.
    - Without a surface: the point of the pad's sphere that the force pushes on, centre - radius f / |f|.

    **Arguments**: `wrench` (moment about the world origin, force) on the subject; `centre` of the pad, None without
    one; `radius` m; `least` N.

    **Errors**: `ValueError` with neither a surface nor a pad.
    """
    moment, force = wrench[:, :3], wrench[:, 3:]
    if surface is not None:
        point, free = centre_of_pressure(moment, force, surface)
        if centre is not None:
            weak = (force @ np.array(surface.normal) < least) | ~np.isfinite(point).all(axis=1)
            point = np.where(weak[:, None], foot_of_pad(centre, surface), point)
            free = np.where(weak[:, None], 0.0, free)
    elif centre is not None:
        size = np.linalg.norm(force, axis=1, keepdims=True)
        point = centre - radius * force / np.where(size > 0, size, 1.0)
        free = np.zeros_like(force)
    else:
        raise ValueError("a contact point needs a surface of the source or a pad of the model")
    return np.where(touching[:, None], point, np.nan), np.where(touching[:, None], free, 0.0)
