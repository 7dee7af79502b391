"""How the top of a force sensor moves, and the weight and inertia that it puts into the reading."""

import dataclasses

import numpy as np
from jaxtyping import Float

from icjax.capture._filters import HIGHEST_CUTOFF, lowpass
from icjax.capture._registration import rigid_registrations
from icjax.capture._spec import TopSpec
from icjax.files import FileError, MotionFile

SEEN_SD = 5.0
"""A top moves or turns when it does so by more than five standard deviations of what its markers do at rest."""

GRAVITY = np.array([0.0, 0.0, -9.81])
"""m/s2, world; z points up."""


@dataclasses.dataclass(frozen=True)
class PlateMotion:
    """Pose of a top against its place at rest: x = R (x_0 - c_0) + c.

    - `time` s, marker clock; `rotation` [F, 3, 3]; `centre` [F, 3] m (c); `rest` [3] m (c_0).
    - `acceleration` [F, 3] m/s2 of the centre of mass; zero where the top rests.
    """

    time: Float[np.ndarray, " frame"]
    rotation: Float[np.ndarray, "frame 3 3"]
    centre: Float[np.ndarray, "frame 3"]
    rest: Float[np.ndarray, "3"]
    com: Float[np.ndarray, "3"]
    acceleration: Float[np.ndarray, "frame 3"]

    def at(self, time: Float[np.ndarray, " sample"]) -> "PlateMotion":
        """At other times, cubic between the frames; the first and last frame beyond them."""
        from scipy.interpolate import CubicSpline

        if np.array_equal(time, self.time):
            return self
        inside = np.clip(time, self.time[0], self.time[-1])
        flat = np.concatenate([self.rotation.reshape(-1, 9), self.centre, self.acceleration], axis=1)
        values = CubicSpline(self.time, flat)(inside)
        u, _, v = np.linalg.svd(values[:, :9].reshape(-1, 3, 3))
        turned = u @ v
        return dataclasses.replace(
            self, time=time, rotation=turned, centre=values[:, 9:12], acceleration=values[:, 12:15]
        )

    def carried(self, point: Float[np.ndarray, "*frame 3"]) -> Float[np.ndarray, "now 3"]:
        """Where a point of the top (one, or one a frame, in its place at rest) is now, m."""
        beside = np.broadcast_to(point - self.rest, self.centre.shape)
        return np.einsum("fij,fj->fi", self.rotation, beside) + self.centre

    def at_rest(self, point: Float[np.ndarray, "frame 3"]) -> Float[np.ndarray, "frame 3"]:
        """Where a point would be if the top had stayed at rest and taken it along, m."""
        return np.einsum("fji,fj->fi", self.rotation, point - self.centre) + self.rest

    def added(self, mass: float) -> Float[np.ndarray, "frame 6"]:
        """What to add to the tared wrench on the subject (moment about the world origin, force), Nm and N.

        The sensing element reads F + m g - m a of a force F on the top, and a tare that holds R_0^T m g in its own
        axes. The force on the subject is -F, so m (g - R g) - m a is added, at the centre of mass. The top's
        own moment of inertia is neglected.
        """
        force = mass * (GRAVITY - self.rotation @ GRAVITY - self.acceleration)
        return np.concatenate([np.cross(self.carried(self.com), force), force], axis=1)


def plate_motion(motion: MotionFile, top: TopSpec, tare: tuple[tuple[float, float], ...]) -> PlateMotion:
    """Motion of a top from its markers.

    Mean place at rest over the tare windows, gaps bridged, low-pass (`top.cutoff`), rotation by rigid
    registration where there are three, acceleration by second differences. Differences amplify marker noise
    (0.1 mm at 60 Hz: 5 m/s2), so the acceleration counts only where the speed exceeds five standard deviations
    of that at rest, with a smooth transition of one period of the cut-off; likewise displacement and rotation
    count only in a trial that shows them.

    **Errors**: `FileError` for a missing marker, or no frame at rest.
    """
    time = motion.marker_time
    inside = np.zeros(len(time), bool)
    for start, stop in tare:
        inside |= (time >= start) & (time <= stop)
    if inside.sum() < 10:
        raise FileError(motion.path, "needs tare windows in which the top of a sensor with the key 'top' rests")
    still = np.tile(np.eye(3), (len(time), 1, 1))
    places = np.stack([motion.marker(name) for name in top.markers], axis=1)
    for index, name in enumerate(top.markers):
        if np.isfinite(places[inside, index]).all(axis=1).sum() < 10:
            raise FileError(motion.path, f"marker '{name}' of the sensor's top is not seen at rest")
    cutoff = min(top.cutoff, HIGHEST_CUTOFF * motion.marker_rate)
    smooth = lowpass(bridged(places, time), motion.marker_rate, cutoff)
    rest = smooth[inside].mean(axis=0)
    centre = smooth.mean(axis=1)
    rotation = still
    if len(top.markers) > 2:
        turned, _ = rigid_registrations(rest, smooth)
        angle = np.linalg.norm(turned - still, axis=(1, 2))
        if angle.max() > SEEN_SD * float(np.sqrt(np.mean(angle[inside] ** 2))):
            rotation = turned
    com = rest.mean(axis=0) if top.com is None else np.array(top.com)
    shift = np.linalg.norm(centre - rest.mean(axis=0), axis=1)
    if shift.max() <= SEEN_SD * float(np.sqrt(np.mean(shift[inside] ** 2))):
        centre = np.tile(rest.mean(axis=0), (len(time), 1))
    place = rotation @ (com - rest.mean(axis=0)) + centre
    velocity = np.gradient(place, time, axis=0)
    speed = np.linalg.norm(velocity, axis=1)
    moving = speed > SEEN_SD * float(np.sqrt(np.mean(speed[inside] ** 2)))
    share = _widened(moving, int(np.ceil(motion.marker_rate / cutoff)))
    return PlateMotion(
        time=time,
        rotation=rotation,
        centre=centre,
        rest=rest.mean(axis=0),
        com=com,
        acceleration=np.gradient(velocity, time, axis=0) * share[:, None],
    )


def accelerated(motion: MotionFile, top: TopSpec, R: np.ndarray, unloaded: np.ndarray, com: np.ndarray) -> np.ndarray:
    """What to add to the tared wrench on the subject where an accelerometer rides on the top, `[sample, 6]`.

    The reading at rest (gravity and its own offset) is subtracted; a top that tilts is not seen.
    """
    channels = motion.channels(top.accelerometer)
    acceleration = (channels - channels[unloaded].mean(axis=0)) @ R.T
    force = -top.mass * acceleration
    return np.concatenate([np.cross(com[None, :], force), force], axis=1)


def bridged(places: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Markers with straight lines over their gaps."""
    result = places.copy()
    for marker in range(places.shape[1]):
        seen = np.isfinite(places[:, marker]).all(axis=1)
        for axis in range(3):
            result[~seen, marker, axis] = np.interp(time[~seen], time[seen], places[seen, marker, axis])
    return result


def _widened(mask: np.ndarray, width: int) -> np.ndarray:
    """One inside a mask and `width` samples around it, falling smoothly to zero over as many."""
    wide = np.convolve(mask.astype(float), np.ones(2 * width + 1), mode="same") > 0
    wider = np.convolve(wide.astype(float), np.ones(width + 1), mode="same") > 0
    window = np.hanning(width + 2)[1:-1]
    return np.convolve(wider.astype(float), window / window.sum(), mode="same") if width > 1 else wide.astype(float)
