"""Records as the tables that OpenSim and C3D viewers read: columns with names, degrees, y up where asked."""

import re
import warnings
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from icjax.files import MotionEvent
from icjax.model import Model
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.view import pair_forces

Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""World axes of a world with z up to axes with y up: (x, y, z) becomes (x, z, -y)."""

ALIGNED = 0.01
"""Samples; sensor samples this close to the frames' own times need no resampling."""


class Table(NamedTuple):
    """Columns over time; `values` [row, column] in the units of the exported file."""

    names: tuple[str, ...]
    values: np.ndarray


def safe(name: str) -> str:
    """A name as a column or a file can have it: blanks and separators become "_"."""
    return re.sub(r"[^\w.+-]", "_", name)


def coordinate_table(
    model: Model,
    q: Float[np.ndarray, "time coordinate"],
    valid: Bool[np.ndarray, " time"],
    turn: Float[np.ndarray, "3 3"],
) -> Table:
    """Coordinates in degrees and m, one column a degree of freedom; NaN in frames that are not valid.

    Hinges and slides keep their name. Quaternions become the three body-fixed angles X, Y, Z of OpenSim's BallJoint
    and FreeJoint, R = R_x R_y R_z, unwrapped over time: `joint_x`, `_y`, `_z` for a ball, `joint_rx`, `_ry`, `_rz`
    and the position `joint_x`, `_y`, `_z` for a free body, whose world is turned by `turn`.
    """
    columns = []
    for kind, part in zip(model.joint_types, model.coordinate_slices, strict=True):
        values = q[:, part]
        if kind == "hinge":
            columns.append(np.degrees(values))
        elif kind == "slide":
            columns.append(values)
        elif kind == "ball":
            columns.append(_body_fixed(values, valid, np.eye(3)))
        else:
            columns += [_body_fixed(values[:, 3:], valid, turn), values[:, :3] @ turn.T]
    table = np.concatenate(columns, axis=1) if columns else np.zeros((len(q), 0))
    return Table(tuple(safe(name) for name in model.dof_names), np.where(valid[:, None], table, np.nan))


def _body_fixed(quaternions: np.ndarray, valid: np.ndarray, turn: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    angles = np.full((len(quaternions), 3), np.nan)
    if valid.any():
        rotation = Rotation.from_quat(quaternions[valid][:, [1, 2, 3, 0]])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # at 90 degrees the third angle is set to zero: still R
            found = (Rotation.from_matrix(turn) * rotation).as_euler("XYZ")
        angles[valid] = np.degrees(np.unwrap(found, axis=0))
    return angles


def force_table(recording: Recording, turn: Float[np.ndarray, "3 3"]) -> Table:
    """Per contact: force (N), its point (m) and the free moment about it (Nm), all on the subject, world axes.

    Names are those of OpenSim's ground reaction files: NAME_vx, NAME_px, NAME_torque_x. Zero where nothing touches,
    the point included.
    """
    names: list[str] = []
    columns = []
    for index, contact in enumerate(recording.contact_names):
        parts = (recording.contact_force, recording.contact_point, recording.contact_moment)
        for letter, part in zip(("v", "p", "torque_"), parts, strict=True):
            names += [f"{safe(contact)}_{letter}{axis}" for axis in "xyz"]
            columns.append(np.nan_to_num(np.asarray(part)[:, index]) @ turn.T)
    return Table(tuple(names), np.concatenate(columns, axis=1) if columns else np.zeros((len(recording.time), 0)))


def sensor_table(recording: Recording, turn: Float[np.ndarray, "3 3"]) -> tuple[Table, float, str]:
    """Wrench of every sensor on the subject, about the world origin: NAME_Fx .. N, NAME_Mx .. Nm.

    Returns the table, its rate (a whole multiple of the frame rate, at least the sensors' own) and what was done:
    "" if the samples are the recorded ones. Samples that do not fall on such a clock are interpolated by cubic
    splines; outside the sensors' time the first and last samples are held.
    """
    channels = recording.channels
    time, wrench = np.asarray(channels.time), np.asarray(channels.wrench)
    frames, rate = np.asarray(recording.time), recording.rate
    names = tuple(f"{safe(name)}_{part}{axis}" for name in channels.sensor_names for part in "FM" for axis in "xyz")
    turned = np.concatenate([wrench[:, :, 3:] @ turn.T, wrench[:, :, :3] @ turn.T], axis=2).reshape(len(time), -1)
    own = (len(time) - 1) / float(time[-1] - time[0])
    ratio = max(1, int(np.ceil(own / rate - ALIGNED)))
    clock = frames[0] + np.arange(ratio * len(frames)) / (ratio * rate)
    if len(time) == len(clock) and np.max(np.abs(time - clock)) * own < ALIGNED:
        return Table(names, turned), ratio * rate, ""
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(time, turned, k=min(3, len(time) - 1))
    held = int(np.sum((clock < time[0] - 0.5 / own) | (clock > time[-1] + 0.5 / own)))
    done = f"sensor channels were interpolated from {own:.6g} Hz to {ratio} samples a frame, {ratio * rate:.6g} Hz"
    if held:
        done += f"; {held} of {len(clock)} samples lie outside the sensors' time and hold their first or last value"
    return Table(names, spline(np.clip(clock, time[0], time[-1]))), ratio * rate, done


def contact_marks(recording: Recording) -> list[MotionEvent]:
    """Onset and release of every contact, as events of a C3D file."""
    events = recording.events
    marks = []
    for label, times in (("onset", events.onset), ("release", events.release)):
        for time, contact in zip(np.asarray(times), np.asarray(events.contact), strict=True):
            if np.isfinite(time):
                marks.append(MotionEvent(f"{recording.contact_names[contact]} {label}", "General", float(time)))
    return sorted(marks, key=lambda event: event.time)


def torque_names(model: Model) -> tuple[str, ...]:
    """Names of the generalised forces as OpenSim's inverse dynamics has them: NAME_moment, NAME_force."""
    turning = {"hinge": (True,), "slide": (False,), "ball": (True,) * 3, "free": (True,) * 3 + (False,) * 3}
    flags = [flag for kind in model.joint_types for flag in turning[kind]]
    return tuple(
        safe(name) + ("_moment" if flag else "_force") for name, flag in zip(model.dof_names, flags, strict=True)
    )


def rollout_coordinates(rollout: Rollout, turn: Float[np.ndarray, "3 3"]) -> Table:
    """Coordinates of the hand as in `coordinate_table`, then those of objects, as of free bodies."""
    q = np.asarray(rollout.q)
    table = coordinate_table(
        rollout.model, q, np.asarray(np.isfinite(q).all(axis=1)), turn
    )  # NaN where a step was lost
    names, columns = list(table.names), [table.values]
    for number, name in enumerate(rollout.object_names):
        names += [safe(name) + end for end in ("_rx", "_ry", "_rz", "_x", "_y", "_z")]
        quaternion = np.asarray(rollout.object_quaternion)[:, number]
        columns.append(_body_fixed(quaternion, np.asarray(np.isfinite(quaternion).all(axis=1)), turn))
        columns.append(np.asarray(rollout.object_position)[:, number] @ turn.T)
    return Table(tuple(names), np.concatenate(columns, axis=1))


def rollout_forces(rollout: Rollout, turn: Float[np.ndarray, "3 3"]) -> Table:
    """Per pair of bodies: force on the first (N), centre of pressure (m) and free moment about it (Nm), world axes.

    Named FIRST_SECOND_vx, _px, _torque_x as in `force_table`; zero where nothing touches, the point included. The
    corners of an object are summed. A pad touches at a point and has no free moment.
    """
    pairs, bodies = pair_forces(rollout), rollout.slot_bodies()
    force, point = (np.nan_to_num(np.asarray(item)) for item in (rollout.contact_force, rollout.contact_point))
    names: list[str] = []
    columns = [np.zeros((len(rollout.time), 0))]
    for number, pair in enumerate(pairs.bodies):
        own = [slot for slot, found in enumerate(bodies) if found == pair]
        touching = (np.linalg.norm(pairs.force[:, number], axis=1) > 0)[:, None]
        centre = np.where(touching, np.nan_to_num(pairs.point[:, number]), 0.0)
        moment = np.cross(point[:, own] - centre[:, None], force[:, own]).sum(axis=1)
        label = safe("_".join(name for name in pair if name))
        for letter, part in (("v", pairs.force[:, number]), ("p", centre), ("torque_", moment)):
            names += [f"{label}_{letter}{axis}" for axis in "xyz"]
            columns.append(part @ turn.T)
    return Table(tuple(names), np.concatenate(columns, axis=1))
