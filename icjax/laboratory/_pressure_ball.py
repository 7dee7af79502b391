"""A ball that measures the pressure on its surface, and what it makes of fingertips that press on it."""

import dataclasses
import math

import numpy as np

from icjax.laboratory._free_object import FreeObject
from icjax.laboratory._grasp import GraspTruth
from icjax.laboratory._hand import FINGERS, Hand
from icjax.laboratory._instruments import Markers
from icjax.laboratory._movement import RATE

FINE = 24000
"""Points of the surface that pressure is summed over: 0.6 mm apart on a ball of 54 mm."""

LEAST_PATCH = 0.0015
"""Radius of the area of contact of a fingertip that hardly presses, m."""

BALL_MARKERS = ((0.15, 0.98, 0.15), (-0.20, -0.97, 0.10), (0.10, 0.30, 0.95), (-0.15, -0.40, 0.90), (0.05, 0.75, 0.66))
"""Directions of the markers BALL1, BALL2, ... on a ball at rest: beside and above the grip."""

TURNED_MARKERS = ((0.10, 0.30, 0.95), (-0.15, -0.40, 0.90), (0.05, 0.70, 0.72), (0.68, -0.25, 0.70), (-0.66, 0.1, 0.75))
"""The same on a ball that is turned about the vertical: above the grip all the way round."""

MARKER_HEIGHT = 0.003
"""Of a marker's centre over the ball, m."""


@dataclasses.dataclass(frozen=True)
class PressureBall:
    """A ball of which `cells` cells cover the surface evenly and are read `rate` times a second.

    `diameter` m, `mass` kg, `friction` against the fingertips. Each cell has an error of gain of `gain` (standard
    deviation, constant), white noise of `noise` Pa, steps of `step` Pa from zero up, and saturates at `largest` Pa.
    """

    diameter: float = 0.054
    mass: float = 0.050
    friction: float = 0.8
    cells: int = 400
    rate: float = 50.0
    gain: float = 0.08
    noise: float = 250.0
    step: float = 200.0
    largest: float = 1.0e5

    def __post_init__(self):
        self.thing("ball")  # checks size, mass and friction
        if not (20 <= self.cells <= 2000):
            raise ValueError(f"ball: cells must be between 20 and 2000, got {self.cells}")
        if not (self.rate > 0.0 and abs(RATE / self.rate - round(RATE / self.rate)) < 1e-9):
            raise ValueError(f"ball: rate must be {RATE:g} Hz over a whole number, got {self.rate}")
        if not (0.0 <= self.gain <= 0.3):
            raise ValueError(f"ball: gain must be between 0 and 0.3, got {self.gain}")
        for name in ("noise", "step"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"ball: {name} must be finite and not negative, got {value}")
        if not (self.largest > 0.0):
            raise ValueError(f"ball: largest must be above 0 Pa, got {self.largest}")

    def thing(self, name: str) -> FreeObject:
        """The ball as what is grasped."""
        return FreeObject(name, shape="sphere", size=(self.diameter,), mass=self.mass, friction=self.friction)

    @property
    def directions(self) -> np.ndarray:
        """Of the middles of the cells from the middle of the ball [cell, 3]."""
        return fibonacci(self.cells)

    @property
    def area(self) -> float:
        """Of a cell, m2."""
        return math.pi * self.diameter**2 / self.cells

    def markers(self, turned: bool = False) -> Markers:
        """Nominal places of the markers in the ball's frame, m; other ones on a ball that is `turned`."""
        directions = np.asarray(TURNED_MARKERS if turned else BALL_MARKERS)
        directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        return {
            f"BALL{number}": ("object", (0.5 * self.diameter + MARKER_HEIGHT) * direction)
            for number, direction in enumerate(directions, start=1)
        }


def fibonacci(count: int) -> np.ndarray:
    """Directions [count, 3] that cover the sphere evenly, along a spiral of the golden angle."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    angle = math.pi * (1.0 + math.sqrt(5.0)) * index
    across = np.sqrt(1.0 - z**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), z])


def pressure_map(ball: PressureBall, hand: Hand, truth: GraspTruth) -> tuple[np.ndarray, np.ndarray]:
    """Time [sample] (s) and true mean pressure of every cell [sample, cell] (Pa).

    A fingertip of radius r that gives way by d = f / k flattens over a radius of a = sqrt(d r R / (r + R)) on a ball of
    radius R, with the pressure of Hertz, p proportional to sqrt(1 - (distance / a)^2), whose sum is the normal force f.
    """
    every = round(RATE / ball.rate)
    radius = 0.5 * ball.diameter
    points = fibonacci(FINE)
    owner = _nearest(points, ball.directions)
    frames = np.arange(0, len(truth.t), every)
    pressure = np.zeros((len(frames), ball.cells))
    for sample, frame in enumerate(frames):
        rotation = _matrix(truth.object_pose[frame, 3:])
        for number, finger in enumerate(FINGERS):
            force = truth.f_normal[frame, number]
            if force <= 0.0:
                continue
            tip = hand.pad(finger)[1]
            place = rotation.T @ (truth.point[frame, number] - truth.object_pose[frame, :3])
            patch = max(LEAST_PATCH, math.sqrt(force / hand.pad_stiffness * tip * radius / (tip + radius)))
            distance = radius * np.linalg.norm(points - place / np.linalg.norm(place), axis=1)
            weight = np.sqrt(np.maximum(1.0 - (distance / patch) ** 2, 0.0))
            pressure[sample] += np.bincount(owner, weight, ball.cells) * (force / weight.sum() / ball.area)
    return truth.t[frames], pressure


def measured(ball: PressureBall, pressure: np.ndarray, gain: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """What the cells show [sample, cell], Pa."""
    values = pressure * gain + ball.noise * generator.standard_normal(pressure.shape)
    if ball.step > 0.0:
        values = np.round(values / ball.step) * ball.step
    return np.clip(values, 0.0, ball.largest)


def _nearest(points: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Index of the nearest direction of every point."""
    return np.argmax(points @ directions.T, axis=1)


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
