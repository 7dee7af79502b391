"""Cameras and a force sensor: what they make of a motion."""

import dataclasses
import math

import numpy as np

from icjax.laboratory._dynamics import ANALOG_RATE
from icjax.laboratory._movement import wander
from icjax.laboratory._surface import PLATE_MARKERS


@dataclasses.dataclass(frozen=True)
class Noise:
    """Errors of the instruments and restlessness of the subject, all as standard deviations unless said.

    Lengths in m, forces in N, torques in Nm, angles in rad, times in s. `dropout` is the share of marker samples
    that the cameras miss. `force` to `drift` are of a plate's sensor; `film` (N) is the white noise of a film sensor on
    a fingertip and `film_gain` its error of gain, constant in a session. `Noise.none()` is a perfect studio with a
    perfectly steady subject.
    """

    marker: float = 0.20e-3
    marker_slow: float = 0.05e-3
    placement: float = 0.30e-3
    dropout: float = 0.006
    force: float = 0.010
    torque: float = 0.2e-3
    bias: float = 0.10
    drift: float = 0.010
    film: float = 0.015
    film_gain: float = 0.03
    tremor: float = math.radians(0.04)
    sway: float = 0.10e-3
    variation: float = math.radians(0.15)
    timing: float = 0.012

    def __post_init__(self):
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"noise: {field.name} must be finite and not negative, got {value}")
        if self.film_gain > 0.3:
            raise ValueError(f"noise: film_gain must be at most 0.3, got {self.film_gain}")
        if self.dropout > 0.2:
            raise ValueError(f"noise: dropout must be at most 0.2, got {self.dropout}")
        if self.timing > 0.03:
            raise ValueError(f"noise: timing must be at most 0.03 s, got {self.timing}")

    @staticmethod
    def none() -> "Noise":
        """No errors at all."""
        return Noise(**{field.name: 0.0 for field in dataclasses.fields(Noise)})


MARKER_STEP = 0.01e-3
"""Cameras round coordinates to this, m."""

FORCE_STEP = 1.0 / 4096.0
TORQUE_STEP = 1.0 / 65536.0
"""The converter of the force sensor rounds to these, N and Nm."""

Markers = dict[str, tuple[str, np.ndarray]]


def place(markers: Markers, noise: Noise, generator: np.random.Generator) -> Markers:
    """Where the markers truly sit: the nominal places with a constant error on each axis."""
    return {
        label: (body, position + noise.placement * generator.standard_normal(3))
        for label, (body, position) in markers.items()
    }


def cameras(names: tuple[str, ...], positions: np.ndarray, noise: Noise, generator: np.random.Generator) -> np.ndarray:
    """Measured markers [frame, marker, 3], m: white and slow noise, rounding, NaN where a marker is lost."""
    markers = positions + noise.marker * generator.standard_normal(positions.shape)
    frames, count, _ = markers.shape
    for index in range(count):
        for axis in range(3):
            markers[:, index, axis] += wander(frames, noise.marker_slow, 0.05, 2.0, generator)
    markers = np.round(markers / MARKER_STEP) * MARKER_STEP
    for index, label in enumerate(names):
        if label in PLATE_MARKERS:
            continue
        missing = generator.poisson(noise.dropout * frames / 8.5)
        for begin in generator.integers(1, frames - 16, size=missing):
            markers[begin : begin + generator.integers(2, 16), index] = np.nan
    return markers


def sensor(wrench: np.ndarray, noise: Noise, generator: np.random.Generator) -> np.ndarray:
    """Measured channels [sample, 7] of a true wrench [sample, 6] (N, Nm): with bias, drift and noise; then SYNC (V)."""
    samples = len(wrench)
    scale = np.array([1.0] * 3 + [0.02] * 3)
    white = np.array([noise.force] * 3 + [noise.torque] * 3)
    bias = noise.bias * scale * generator.standard_normal(6)
    knots = np.linspace(0.0, samples - 1.0, 5)
    drift = np.cumsum(generator.standard_normal((5, 6)), axis=0) * noise.drift * scale / 2.0
    slow = np.stack([np.interp(np.arange(samples), knots, drift[:, axis]) for axis in range(6)], axis=1)
    wrench = wrench + bias + slow + white * generator.standard_normal((samples, 6))
    step = np.array([FORCE_STEP] * 3 + [TORQUE_STEP] * 3)
    wrench = np.round(wrench / step) * step
    second = (np.arange(samples) / ANALOG_RATE) % 1.0
    return np.column_stack([wrench, 5.0 * (second < 0.05)])


def restless(command: np.ndarray, noise: Noise, generator: np.random.Generator) -> np.ndarray:
    """The joint command [frame, 4] as the subject manages it: slow variation and tremor; forearm sway in front.

    Returns [frame, 7]: forearm x, z (m) and pitch (rad), then the joints.
    """
    frames = len(command)
    result = np.zeros((frames, 7))
    result[:, 3:] = command
    for axis in (0, 1):
        result[:, axis] = wander(frames, noise.sway, 0.1, 1.5, generator)
    for joint in range(4):
        result[:, 3 + joint] += unsteady(frames, noise, generator)
    return result


def restless_hand(command: np.ndarray, noise: Noise, generator: np.random.Generator) -> np.ndarray:
    """The command [frame, 24] of forearm (x, y, z; m) and joints (rad) as the subject manages it."""
    result = command.copy()
    for axis in range(3):
        result[:, axis] += wander(len(command), noise.sway, 0.1, 1.5, generator)
    for joint in range(3, command.shape[1]):
        result[:, joint] += unsteady(len(command), noise, generator)
    return result


def unsteady(frames: int, noise: Noise, generator: np.random.Generator) -> np.ndarray:
    """Slow variation and tremor of one joint [frame], rad."""
    slow = wander(frames, noise.variation, 0.1, 1.0, generator)
    return slow + wander(frames, noise.tremor, 3.0, 12.0, generator)


def films(pressed: np.ndarray, gain: np.ndarray, noise: Noise, generator: np.random.Generator) -> np.ndarray:
    """Measured normal forces [sample, finger], N: gain, white noise, rounding; a film shows no negative force."""
    measured = pressed * gain + noise.film * generator.standard_normal(pressed.shape)
    return np.maximum(np.round(measured / FORCE_STEP) * FORCE_STEP, 0.0)
