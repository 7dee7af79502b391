"""What the subject means to do: minimum-jerk movements of the finger along paths found by inverse kinematics."""

import dataclasses

import numpy as np
from scipy.interpolate import CubicSpline

from icjax.laboratory._apparatus import forearm_origin
from icjax.laboratory._subject import JOINTS, LIMITS, POSTURE, Subject
from icjax.laboratory._surface import Surface

RATE = 500.0
"""Rate at which a command is written down, Hz; the simulation interpolates it."""

QUIET = 0.5
"""Rest with the finger off the plate at the start, s: the sensor is tared there."""


@dataclasses.dataclass(frozen=True)
class Touch:
    """One planned contact. Lengths in m, times in s.

    At `start` the finger leaves its hover position, `lead` beyond the place of contact, so that it lands while it
    already pulls back: friction then loads every joint, as in stroking.
    """

    kind: str  # "tap" or "stroke"
    start: float
    x_from: float
    x_to: float
    lead: float
    hover: float
    depth: float
    descent: float
    dwell: float
    slide: float
    ascent: float
    back: float

    @property
    def stages(self) -> tuple[float, ...]:
        """Durations: descent, dwell, slide, dwell, ascent, return to hover over the next place."""
        return (self.descent, self.dwell, self.slide, self.dwell, self.ascent, self.back)


def plan(subject: Subject, surface: Surface, kinds: tuple[str, ...], generator: np.random.Generator) -> list[Touch]:
    """Choose forces, speeds and places of a trial's contacts.

    The reference goes below the plate by force times the vertical compliance of a fingertip that sticks (tap) or
    is pulled over the plate (stroke), so that the force once settled is about the chosen one.

    **Errors**: `ValueError` where the plate or the depth is out of reach.
    """
    compliance = subject.endpoint_compliance(np.asarray(POSTURE))
    resting = 1.0 / np.linalg.inv(compliance)[1, 1]
    sliding = compliance[1, 1] + min(surface.friction, 1.0) * compliance[1, 0]
    size = min(1.0, subject.hand_length / 0.19)
    touches = []
    start = QUIET
    for kind in kinds:
        force = generator.uniform(0.7, 1.3) if kind == "tap" else generator.uniform(0.45, 0.7)
        hover = size * generator.uniform(0.016, 0.022)
        speed = generator.uniform(0.07, 0.12)
        depth = float(force * (resting if kind == "tap" else sliding))
        length = size * generator.uniform(0.024, 0.034) if kind == "stroke" else 0.0
        lead = size * (generator.uniform(0.007, 0.012) if kind == "stroke" else generator.uniform(0.0, 0.008))
        x_from = size * (generator.uniform(-0.001, 0.005) if kind == "stroke" else generator.uniform(-0.006, 0.003))
        touch = Touch(
            kind=kind,
            start=start,
            x_from=x_from,
            x_to=x_from - length,
            lead=lead,
            hover=hover,
            depth=depth,
            descent=_descent(hover, depth, speed),
            dwell=generator.uniform(0.06, 0.12),
            slide=generator.uniform(0.5, 0.7) if kind == "stroke" else 0.0,
            ascent=_descent(hover, depth, generator.uniform(0.08, 0.13)),
            back=generator.uniform(0.40, 0.50),
        )
        touches.append(touch)
        start += sum(touch.stages) + generator.uniform(0.12, 0.25)
    for touch in touches:
        reach(subject, surface, touch.x_from + touch.lead, touch.hover)
        for x in (touch.x_from, touch.x_to):
            reach(subject, surface, x, -touch.depth)
    return touches


def command(
    subject: Subject, surface: Surface, touches: list[Touch], shifts: np.ndarray, duration: float
) -> np.ndarray:
    """Joint angles [frame, 4] of the planned movement at `RATE`, each contact begun `shifts` s later than planned.

    Every stage moves by the minimum-jerk time course s = 10 u^3 - 15 u^4 + 6 u^5 along a straight path of the
    fingertip (Flash and Hogan 1985).
    """
    time = np.arange(round(duration * RATE) + 1) / RATE
    theta = np.empty((len(time), len(JOINTS)))
    theta[:] = reach(subject, surface, touches[0].x_from + touches[0].lead, touches[0].hover)
    for index, (touch, shift) in enumerate(zip(touches, shifts, strict=True)):
        following = touches[index + 1] if index + 1 < len(touches) else touch
        places = [
            (touch.x_from + touch.lead, touch.hover),
            (touch.x_from, -touch.depth),
            (touch.x_from, -touch.depth),
            (touch.x_to, -touch.depth),
            (touch.x_to, -touch.depth),
            (touch.x_to, touch.hover),
            (following.x_from + following.lead, following.hover),
        ]
        begin = touch.start + shift
        for stage, (place, target) in zip(touch.stages, zip(places, places[1:], strict=False), strict=True):
            if stage > 0.0 and place != target:
                path = _path(subject, surface, place, target)
                later = time >= begin
                theta[later] = path(minimum_jerk((time[later] - begin) / stage))
            begin += stage
    return theta


def duration(touches: list[Touch]) -> float:
    """Length of the trial, s: a whole number of frames."""
    last = touches[-1]
    return round((last.start + sum(last.stages) + 0.3) * 50.0) / 50.0


def reach(subject: Subject, surface: Surface, x: float, z: float) -> np.ndarray:
    """Angles near the comfortable posture that bring the fingertip's underside to (x, z over the plate).

    Newton steps from the comfortable posture, each the least one in the sense of sum_i dtheta_i^2 / C_i, so that
    soft joints move most.

    **Errors**: `ValueError` where no posture within the joint ranges reaches the point.
    """
    weight = np.asarray(subject.compliance)
    origin = forearm_origin(subject)
    target = np.array([x - origin[0], surface.height + z + subject.pad_radius - origin[2]])
    theta = np.asarray(POSTURE)
    for _ in range(40):
        jacobian = subject.pad_jacobian(theta)
        loaded = weight[:, None] * jacobian.T
        step = loaded @ np.linalg.solve(jacobian @ loaded + 1e-9 * np.eye(2), target - subject.pad_position(theta))
        theta = theta + step * min(1.0, 0.3 / float(np.abs(step).max() + 1e-12))
        if np.abs(step).max() < 1e-12:
            break
    missed = float(np.linalg.norm(target - subject.pad_position(theta)))
    inside = all(low <= angle <= high for angle, (low, high) in zip(theta, LIMITS, strict=True))
    if not (missed < 1e-8 and inside):
        raise ValueError(
            f"the finger cannot reach x = {x:.3f} m, z = {z:+.3f} m over a plate at height {surface.height:.3f} m: "
            "change the height, the hand length or the compliance"
        )
    return theta


def wander(frames: int, sd: float, low: float, high: float, generator: np.random.Generator) -> np.ndarray:
    """Band-limited Gaussian noise [frames] between `low` and `high` Hz with standard deviation `sd`, at `RATE`."""
    white = generator.standard_normal(frames)
    if sd == 0.0:
        return np.zeros(frames)
    spectrum = np.fft.rfft(white)
    frequency = np.fft.rfftfreq(frames, 1.0 / RATE)
    spectrum[(frequency < low) | (frequency > high)] = 0.0
    noise = np.fft.irfft(spectrum, frames)
    return sd * noise / max(float(noise.std()), 1e-12)


def _descent(hover: float, depth: float, speed: float) -> float:
    """Duration of a minimum-jerk descent of hover + depth that passes the plate's top at `speed`, s."""
    distance = hover + depth
    u = np.linspace(0.0, 1.0, 2001)
    at_top = u[np.searchsorted(minimum_jerk(u), hover / distance)]
    return float(30.0 * at_top**2 * (1.0 - at_top) ** 2 * distance / speed)


def minimum_jerk(u: np.ndarray) -> np.ndarray:
    """Fraction of the way at the fraction u of the time."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def _path(subject: Subject, surface: Surface, start: tuple[float, float], end: tuple[float, float]) -> CubicSpline:
    """Angles along a straight line of the fingertip, as a function of the fraction covered."""
    fraction = np.linspace(0.0, 1.0, 9)
    points = [
        reach(subject, surface, start[0] + s * (end[0] - start[0]), start[1] + s * (end[1] - start[1]))
        for s in fraction
    ]
    return CubicSpline(fraction, np.asarray(points))
