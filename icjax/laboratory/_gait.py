"""What the subject means to do with a thing to be turned: grips one after another about the vertical."""

import dataclasses
import math

import numpy as np
from scipy.interpolate import RectBivariateSpline

from icjax.laboratory._hand import FINGERS, HAND_JOINTS, WRIST_FLEXION, Hand
from icjax.laboratory._hand_model import GRIP_HEIGHT, HAND_DRIVEN, build_hand
from icjax.laboratory._lift import reach
from icjax.laboratory._movement import RATE, minimum_jerk
from icjax.laboratory._mujoco import mujoco

AROUND = {"thumb": 180.0, "index": 74.0, "middle": 14.0, "ring": -18.0, "little": -84.0}
"""Where the fingertips aim at about the vertical through the world's origin, degrees from x towards y: index and
little finger oppose each other, so that they hold while the thumb is away."""


@dataclasses.dataclass(frozen=True)
class Gait:
    """The movement. Lengths in m, angles in rad, times in s.

    After `rest` the pads close from `open` to `grip`, the diameters of the circles about the vertical that their
    surfaces aim at, within `close`; the forearm rises by `height` within `rise` (not at all if zero). Then, `strokes`
    times, all pads turn about the vertical by `angle` within `turn` and, but for the last time, go back: each of
    `groups` in its turn lets go within `release`, goes back by `angle` within `back` and grips again within `close`,
    while the others hold. The end is held for `hold`. The pads stand `above` the grip's height in the middle of a
    stroke and climb by `climb` over it, for what hangs on fingers that regrip sinks a little each time. On a thing
    wider than `grip` compliance makes the force; what turns, turns by friction.
    """

    grip: float = 0.038
    open: float = 0.062
    above: float = 0.004
    height: float = 0.030
    angle: float = math.radians(28.0)
    climb: float = 0.0025
    strokes: int = 5
    groups: tuple[tuple[str, ...], ...] = (("index",), ("little",), ("thumb", "middle", "ring"))
    rest: float = 0.4
    close: float = 0.35
    rise: float = 0.5
    turn: float = 0.5
    release: float = 0.2
    back: float = 0.25
    hold: float = 0.3

    def __post_init__(self):
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name not in ("groups", "strokes") and not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"gait: {field.name} must be finite and not negative, got {value}")
        if not (self.grip < self.open <= 0.12):
            raise ValueError(f"gait: open must be above grip ({self.grip} m) and at most 0.12 m, got {self.open}")
        for name, most in (("height", 0.3), ("climb", 0.02), ("above", 0.05)):
            if getattr(self, name) > most:
                raise ValueError(f"gait: {name} must be at most {most} m, got {getattr(self, name)}")
        if not (0.0 < self.angle <= 1.5):
            raise ValueError(f"gait: angle must be above 0 and at most 1.5 rad, got {self.angle}")
        if not (isinstance(self.strokes, int) and 1 <= self.strokes <= 50):
            raise ValueError(f"gait: strokes must be between 1 and 50, got {self.strokes}")
        if sorted(finger for group in self.groups for finger in group) != sorted(FINGERS):
            raise ValueError(f"gait: groups must hold each of {', '.join(FINGERS)} once, got {self.groups}")
        if self.rest < 0.25:
            raise ValueError(f"gait: rest must be at least 0.25 s, the sensors are tared there; got {self.rest}")
        for name in ("close", "rise", "turn", "release", "back"):
            if getattr(self, name) < 0.1:
                raise ValueError(f"gait: {name} must be at least 0.1 s, got {getattr(self, name)}")

    @property
    def again(self) -> float:
        """Time of a group's regrip, s."""
        return self.release + self.back + self.close

    @property
    def starts(self) -> np.ndarray:
        """Of the strokes, s."""
        first = self.rest + self.close + (self.rise if self.height > 0.0 else 0.0)
        return first + (self.turn + len(self.groups) * self.again) * np.arange(self.strokes)

    @property
    def duration(self) -> float:
        """Of the trial, s."""
        return float(self.starts[-1]) + self.turn + self.hold


def gait_command(hand: Hand, gait: Gait) -> np.ndarray:
    """Coordinates [frame, 24] of the planned movement at `RATE`: forearm x, y, z (m), then the joints (rad).

    Every stage moves by the minimum-jerk time course, the pads along circles and their radii.

    **Errors**: `ValueError` where a fingertip cannot reach its place.
    """
    time = np.arange(round(gait.duration * RATE) + 1) / RATE
    command = np.zeros((len(time), len(HAND_DRIVEN)))
    command[:, 2] = gait.height * minimum_jerk((time - gait.rest - gait.close) / gait.rise)
    command[:, 3] = WRIST_FLEXION
    model = build_hand(hand, None, {}, 0.001)
    data = mujoco.MjData(model)
    parts, closings = np.linspace(-0.5, 0.5, 9), np.linspace(0.0, 1.0, 7)
    for finger in FINGERS:
        radius = hand.pad(finger)[1]
        columns = [3 + index for index, name in enumerate(HAND_JOINTS) if name.startswith(f"{finger}_")]
        postures = np.empty((len(parts), len(closings), len(columns)))
        for row, part in enumerate(parts):
            about = math.radians(AROUND[finger]) + part * gait.angle
            for column, closing in enumerate(closings):
                away = 0.5 * (gait.open + closing * (gait.grip - gait.open)) + radius
                target = np.array([away * math.cos(about), away * math.sin(about), GRIP_HEIGHT + gait.above])
                target[2] += part * gait.climb
                postures[row, column] = reach(model, data, finger, target)
        turned, closed = _course(gait, finger, time)
        for number, column in enumerate(columns):
            command[:, column] = RectBivariateSpline(parts, closings, postures[:, :, number])(
                turned, closed, grid=False
            )
    return command


def _course(gait: Gait, finger: str, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far a finger is turned (minus to plus one half of the stroke) and closed (0 to 1) at every frame."""
    group = next(number for number, members in enumerate(gait.groups) if finger in members)
    turned, closed = np.full(len(time), -0.5), minimum_jerk((time - gait.rest) / gait.close)
    for start in gait.starts:
        turned += minimum_jerk((time - start) / gait.turn)
    for start in gait.starts[:-1]:
        lets_go = start + gait.turn + group * gait.again
        closed -= minimum_jerk((time - lets_go) / gait.release)
        turned -= minimum_jerk((time - lets_go - gait.release) / gait.back)
        closed += minimum_jerk((time - lets_go - gait.release - gait.back) / gait.close)
    return turned, closed
