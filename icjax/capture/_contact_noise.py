"""How well a measured force and its point are known."""

import numpy as np
from jaxtyping import Float

from icjax.capture._contact_point import centre_of_pressure
from icjax.capture._filters import HIGHEST_CUTOFF, lowpass
from icjax.capture._sensors import SensorWrench


def moment_noise(sensor: SensorWrench, cutoff: float, loaded: Float[np.ndarray, "frame 6"]) -> float:
    """Standard deviation of the filtered moment about the place of contact, Nm; zero if nothing was tared.

    About any other point the noise of the force would enter with its distance. The place is the centre of pressure of
    the mean `loaded` wrench (about the world origin, Nm and N); on a surface that moves, the surface's point.
    """
    if sensor.surface is None or sensor.unloaded.sum() <= 10:
        return 0.0
    place = np.array(sensor.surface.point)
    if len(loaded) and sensor.carrier is None:
        mean = np.nanmean(loaded, axis=0)
        found = centre_of_pressure(mean[None, :3], mean[None, 3:], sensor.surface)[0][0]
        place = found if np.isfinite(found).all() else place
    return _noise(sensor.wrench[:, :3] - np.cross(place[None, :], sensor.wrench[:, 3:]), sensor, cutoff)


def force_noise(sensor: SensorWrench, cutoff: float) -> float:
    """Standard deviation of the filtered force, per axis, N; NaN if nothing was tared."""
    return _noise(sensor.wrench[:, 3:], sensor, cutoff) if sensor.unloaded.sum() > 10 else float("nan")


def point_deviation(
    force: Float[np.ndarray, "frame 3"], sensor: SensorWrench, moment: float, least: float, otherwise: float
) -> Float[np.ndarray, " frame"]:
    """Standard deviation of the contact point, m: sd(m) / f_n for a centre of pressure, NaN where nothing touches.

    **Arguments**: `force` N, zero without contact; `moment` noise, Nm; `least` N from which the centre of pressure is
    used; `otherwise` m, of a point that geometry gives.
    """
    size = np.linalg.norm(force, axis=1)
    touching = size > 0
    if sensor.surface is None:
        return np.where(touching, otherwise, np.nan)
    pressing = np.abs(force @ np.array(sensor.surface.normal))
    measured = touching & (pressing >= max(least, np.finfo(float).tiny))
    return np.where(measured, moment / np.where(measured, pressing, 1.0), np.where(touching, otherwise, np.nan))


def _noise(values: np.ndarray, sensor: SensorWrench, cutoff: float) -> float:
    filtered = lowpass(values, sensor.rate, min(cutoff, HIGHEST_CUTOFF * sensor.rate))[sensor.unloaded]
    return float(np.sqrt(np.nanmean(np.nanvar(filtered, axis=0))))
