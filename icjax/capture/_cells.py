"""Sensors that measure only the force along a normal: single ones on a pad, and arrays of pressure cells."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from icjax.capture._fsr import read_curves
from icjax.capture._joint_angles import JointAngles
from icjax.capture._spec import SourceSpec
from icjax.files import FileError, MotionFile
from icjax.model import Model


class CellForces(NamedTuple):
    """What the cells of a source say together, in its frame.

    - `wrench` [S, 6]: (moment about the frame's origin, force) on the subject, Nm and N.
    - `pressing` [S, 4]: (sum of force times position, sum of force), Nm and N: the centre of pressure is their ratio.
    """

    wrench: Float[np.ndarray, "sample 6"]
    pressing: Float[np.ndarray, "sample 4"]


def cell_values(motion: MotionFile, source: SourceSpec) -> Float[np.ndarray, "sample cell"]:
    """Force of every cell, N: calibrated where the session names curves, else scaled.

    **Errors**: `FileError` for a channel that the file or the calibration lacks.
    """
    values = motion.channels(source.channels)
    if source.calibration is not None:
        curves = read_curves(source.calibration)
        for name in source.channels:
            if name not in curves:
                raise FileError(source.calibration, f"has no curve for channel '{name}' (it has {', '.join(curves)})")
        values = np.stack([curves[name](values[:, i]) for i, name in enumerate(source.channels)], axis=1)
    return values * np.array([cell.scale for cell in source.cells])


def beyond_calibration(motion: MotionFile, source: SourceSpec) -> float:
    """Share of the samples with a channel above its calibrated range."""
    if source.calibration is None:
        return 0.0
    curves = read_curves(source.calibration)
    values = motion.channels(source.channels)
    above = [values[:, i] > curves[name].voltage[-1] for i, name in enumerate(source.channels) if name in curves]
    return float(np.mean(np.any(above, axis=0))) if above else 0.0


def cell_forces(values: Float[np.ndarray, "sample cell"], source: SourceSpec) -> CellForces:
    """Sum over cells: f = sum f_i n_i, m = sum p_i x f_i n_i; a cell without a position counts at the origin."""
    normals = np.array([cell.normal for cell in source.cells])
    places = np.array([cell.position or (0.0, 0.0, 0.0) for cell in source.cells])
    moment = values @ np.cross(places, normals)
    pressing = np.concatenate([values @ places, values.sum(axis=1, keepdims=True)], axis=1)
    return CellForces(np.concatenate([moment, values @ normals], axis=1), pressing)


class CellContact(NamedTuple):
    """A contact in world axes: force N, point m (NaN where nothing touches), free moment Nm."""

    force: Float[np.ndarray, "frame 3"]
    point: Float[np.ndarray, "frame 3"]
    moment: Float[np.ndarray, "frame 3"]


def cell_contact(
    model: Model,
    source: SourceSpec,
    target: str,
    angles: JointAngles,
    forces: CellForces,
    touching: Bool[np.ndarray, " frame"],
) -> CellContact:
    """Force, centre of pressure and free moment of a source's cells at the frames, carried by the body's pose.

    A cell without a position acts on the sphere of the touched pad, against its normal: centre - radius n. The
    force has no tangential part because none was measured.

    **Errors**: `ValueError` when there is neither a position nor a pad.
    """
    force, first = forces.wrench[:, 3:], forces.pressing
    touching = touching & (first[:, 3] > 0)
    if source.cells[0].position is None:
        point, moment = pad_place(model, target, source, angles), np.zeros_like(force)
    else:
        point = first[:, :3] / np.where(touching, first[:, 3], 1.0)[:, None]
        moment = forces.wrench[:, :3] - np.cross(point, force)
    if source.frame == "body":
        body = touched_body(model, target)
        R, p = angles.body_rotations[:, body], angles.body_positions[:, body]
        force, moment = np.einsum("fij,fj->fi", R, force), np.einsum("fij,fj->fi", R, moment)
        point = np.einsum("fij,fj->fi", R, point) + p
    on = touching[:, None]
    return CellContact(np.where(on, force, 0.0), np.where(on, point, np.nan), np.where(on, moment, 0.0))


def touched_body(model: Model, target: str) -> int:
    """Index of the body that a pad sits on, or that has this name."""
    return model.pad_bodies[model.pad(target)] if target in model.pad_names else model.body(target)


def pad_place(model: Model, target: str, source: SourceSpec, angles: JointAngles) -> Float[np.ndarray, "frame 3"]:
    """Where a sensor without a stated position acts, centre - radius n of the pad, m, in the source's frame.

    **Errors**: `ValueError` when the target is not a pad.
    """
    if target not in model.pad_names:
        raise ValueError(f"source '{source.name}' needs the key 'point', because '{target}' is not a pad")
    pad = model.pad(target)
    body = model.pad_bodies[pad]
    inward = float(np.asarray(model.pad_radius)[pad]) * np.array(source.cells[0].normal)
    centre = np.asarray(model.pad_centre)[pad]
    if source.frame == "body":
        return np.tile(centre - inward, (len(angles.q), 1))
    return angles.body_rotations[:, body] @ centre + angles.body_positions[:, body] - inward


def world_wrench(
    wrench: Float[np.ndarray, "sample 6"],
    time: Float[np.ndarray, " sample"],
    frames: Float[np.ndarray, " frame"],
    rotation: Float[np.ndarray, "frame 3 3"],
    position: Float[np.ndarray, "frame 3"],
) -> Float[np.ndarray, "sample 6"]:
    """A wrench about the origin of a body at the sensor's own rate, carried to world by the body's pose."""
    from scipy.spatial.transform import Rotation, Slerp

    inside = np.clip(time, frames[0], frames[-1])
    R = Slerp(frames, Rotation.from_matrix(rotation))(inside).as_matrix()
    p = np.stack([np.interp(inside, frames, column) for column in position.T], axis=1)
    force = np.einsum("fij,fj->fi", R, wrench[:, 3:])
    moment = np.einsum("fij,fj->fi", R, wrench[:, :3]) + np.cross(p, force)
    return np.concatenate([moment, force], axis=1)
