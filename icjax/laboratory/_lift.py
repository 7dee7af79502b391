"""What the subject means to do with an object: close thumb and fingers on it, lift it, hold it."""

import dataclasses
import math

import numpy as np
from scipy.interpolate import CubicSpline

from icjax.laboratory._hand import FINGERS, HAND_JOINTS, HINGE_LIMITS, POSTURE, WRIST_FLEXION, Hand
from icjax.laboratory._hand_model import GRIP_HEIGHT, HAND_DRIVEN, build_hand, start_posture
from icjax.laboratory._movement import RATE, minimum_jerk
from icjax.laboratory._mujoco import MjData, MjModel, mujoco

PLACES = {
    "thumb": (0.012, 0.040),
    "index": (0.124, 0.000),
    "middle": (0.034, -0.014),
    "ring": (-0.058, -0.006),
    "little": (-0.138, 0.040),
}
"""Where the fingertips aim at across the hand (y) and above `GRIP_HEIGHT` (z), over hand length."""

MOBILITY = np.array([1.0, 0.5, 1.0, 0.4])
"""Share that each joint of a finger takes in reaching, from the base on."""


@dataclasses.dataclass(frozen=True)
class Lift:
    """The movement. Lengths in m, times in s.

    After `rest` the pads close from `open` to `grip`, the distances between the surfaces of thumb and fingers that the
    subject aims at, within `close`; after `settle` the forearm rises by `height` within `rise`; the end is held for
    `hold`. On an object wider than `grip`, compliance makes the force. Meanwhile the fingers go up and the thumb goes
    down by `roll`, and back: that turns what is held about the line across the hand.
    """

    grip: float = 0.018
    open: float = 0.054
    height: float = 0.080
    roll: float = 0.0
    rest: float = 0.4
    close: float = 0.7
    settle: float = 0.4
    rise: float = 0.8
    hold: float = 0.9

    def __post_init__(self):
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"lift: {field.name} must be finite and not negative, got {value}")
        if not (self.grip < self.open <= 0.12):
            raise ValueError(f"lift: open must be above grip ({self.grip} m) and at most 0.12 m, got {self.open}")
        if not (0.0 <= self.height <= 0.3):
            raise ValueError(f"lift: height must be at most 0.3 m, got {self.height}")
        if not (self.roll <= 0.02):
            raise ValueError(f"lift: roll must be at most 0.02 m, got {self.roll}")
        if self.roll > 0.0 and self.hold < 0.5:
            raise ValueError(f"lift: hold must be at least 0.5 s for a roll, got {self.hold}")
        if self.rest < 0.25:
            raise ValueError(f"lift: rest must be at least 0.25 s, the sensors are tared there; got {self.rest}")
        if self.close < 0.2 or self.rise < 0.2:
            raise ValueError(f"lift: close and rise must be at least 0.2 s, got {self.close} and {self.rise}")

    @property
    def duration(self) -> float:
        """Of the trial, s."""
        return self.rest + self.close + self.settle + self.rise + self.hold


def lift_command(hand: Hand, lift: Lift) -> np.ndarray:
    """Coordinates [frame, 24] of the planned movement at `RATE`: forearm x, y, z (m), then the joints (rad).

    Every stage moves by the minimum-jerk time course; the pads close and roll along straight lines.

    **Errors**: `ValueError` where a fingertip cannot reach its place.
    """
    time = np.arange(round(lift.duration * RATE) + 1) / RATE
    closed = minimum_jerk((time - lift.rest) / lift.close)
    raised = minimum_jerk((time - lift.rest - lift.close - lift.settle) / lift.rise)
    held = (time - (lift.duration - lift.hold)) / max(lift.hold, 1e-9)
    rolled = minimum_jerk(held / 0.45) - minimum_jerk((held - 0.5) / 0.45)
    command = np.zeros((len(time), len(HAND_DRIVEN)))
    command[:, 2] = lift.height * raised
    command[:, 3] = WRIST_FLEXION
    model = build_hand(hand, None, {}, 0.001)
    data = mujoco.MjData(model)
    fraction = np.linspace(0.0, 1.0, 9)
    for finger in FINGERS:
        radius = hand.pad(finger)[1]
        side = -1.0 if finger == "thumb" else 1.0
        across, above = hand.hand_length * np.asarray(PLACES[finger])
        closing, rolling = [], []
        for part in fraction:
            half = 0.5 * (lift.open + part * (lift.grip - lift.open)) + radius
            closing.append(reach(model, data, finger, np.array([side * half, across, GRIP_HEIGHT + above])))
        columns = [3 + index for index, name in enumerate(HAND_JOINTS) if name.startswith(f"{finger}_")]
        command[:, columns] = CubicSpline(fraction, np.asarray(closing))(closed)
        if lift.roll > 0.0:
            for part in fraction:
                target = np.array([side * (0.5 * lift.grip + radius), across, GRIP_HEIGHT + above])
                target[2] += part * side * lift.roll
                rolling.append(reach(model, data, finger, target) - closing[-1])
            command[:, columns] += CubicSpline(fraction, np.asarray(rolling))(rolled)
    return command


def reach(model: MjModel, data: MjData, finger: str, target: np.ndarray) -> np.ndarray:
    """Angles near the comfortable posture that bring the centre of a fingertip to a place in the world.

    Newton steps from the comfortable posture, each the least one in the sense of sum_i dtheta_i^2 / `MOBILITY`_i.

    **Errors**: `ValueError` where no posture within the joint ranges reaches the place.
    """
    names = [name for name in HAND_JOINTS if name.startswith(f"{finger}_")]
    address = [int(model.joint(name).qposadr[0]) for name in names]
    tip = model.site(f"{finger}_tip").id
    jacobian = np.zeros((3, model.nv))
    data.qpos[:] = start_posture(model)
    theta = np.radians(POSTURE[finger])
    missed = math.inf
    for _ in range(60):
        data.qpos[address] = theta
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, jacobian, None, tip)
        error = target - data.site_xpos[tip]
        missed = float(np.linalg.norm(error))
        if missed < 1e-10:
            break
        loaded = MOBILITY[:, None] * jacobian[:, address].T
        step = loaded @ np.linalg.solve(jacobian[:, address] @ loaded + 1e-9 * np.eye(3), error)
        theta = theta + step * min(1.0, 0.3 / float(np.abs(step).max()))
    low, high = np.radians(HINGE_LIMITS[finger]).T
    inside = bool(np.all((low <= theta) & (theta <= high)))
    if not (missed < 1e-8 and inside):
        place = ", ".join(f"{value:+.3f}" for value in target)
        raise ValueError(
            f"the {finger} cannot reach ({place}) m over the table: change hand_length, or open and grip of the lift"
        )
    return theta
