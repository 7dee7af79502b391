"""Trials whose movement is given by joint angles: columns of a file as coordinates of the model."""

import equinox as eqx
import jax
import numpy as np

from icjax.capture._filters import HIGHEST_CUTOFF, lowpass
from icjax.capture._joint_angles import JointAngles
from icjax.capture._pose import by_blocks
from icjax.capture._spec import SessionSpec, TrialSpec
from icjax.files import FileError, MotionFile, Table
from icjax.model import Model, forward_kinematics
from icjax.typing import Float, Real

ANGLE_SD = 0.0087
"""rad (0.5 degrees); standard deviation of a joint angle where the session does not say. A file of angles holds no
errors of its own; repeated marker placement alone moves the sagittal angles of gait by 0.5 degrees and more."""


def movement_key(table: Table) -> tuple[str, bool | None]:
    """Which key of a trial names its movement ("file", "markers" or "angles"), and whether angles are in degrees."""
    given = [key for key in ("file", "markers", "angles") if table.text(key, None) is not None]
    degrees = table.flag("degrees", None)
    if len(given) != 1:
        raise table.error("needs either the key 'file' or the key 'markers' (with 'forces'), or 'angles'")
    if degrees is not None and given[0] != "angles":
        raise table.error("key 'degrees' belongs to the key 'angles'")
    return given[0], degrees


def angle_columns(table: Table | None, model: Model) -> tuple[tuple[str, str], ...]:
    """The table [angles], joint of the model = column of the file, in the model's order.

    **Errors**: `FileError` naming the joint that the model lacks, that has no column, or that is a ball or free
    joint, which no single column describes.
    """
    if table is None:
        return ()
    columns = dict(table.pairs())
    for name in columns:
        if name not in model.joint_names:
            raise table.error(f"key '{name}' is no joint of the model; it has {', '.join(model.joint_names)}")
    for name, kind in zip(model.joint_names, model.joint_types, strict=True):
        if kind not in ("hinge", "slide"):
            raise table.error(f"joint '{name}' is a {kind} joint; angles from a file need hinges and slides")
        if name not in columns:
            raise table.error(f"names no column for the joint '{name}'")
    return tuple((name, columns[name]) for name in model.joint_names)


def recorded_angles(
    spec: SessionSpec, trial: TrialSpec, angles: MotionFile, time: Float[np.ndarray, " frame"]
) -> JointAngles:
    """Coordinates of a trial from the columns that the session names, low-pass filtered if it says so.

    Kept are the rows of `time`, those that the forces cover.

    Hinges are converted from degrees where the file's header, or the session, says degrees; slides are m. The
    covariance is diagonal: `angle_sd` squared for a hinge, `placement_sd` squared for a slide, both also the
    constant offset, since nothing tells one from the other.

    **Errors**: `FileError` for a column that the file lacks or that is empty, or if neither the file nor the session
    says whether angles are in degrees, or the two disagree.
    """
    model = spec.model
    names = tuple(column for _, column in spec.angles)
    table = angles.channels(names)
    for name, column in zip(names, table.T, strict=True):
        if not np.isfinite(column).any():
            raise FileError(trial.markers, f"column '{name}' is empty")
    hinges = np.array([kind == "hinge" for kind in model.joint_types])
    q = np.where(hinges[None, :] & _in_degrees(trial, angles), np.deg2rad(table), table)
    if spec.filter.angles is not None:
        q = lowpass(q, angles.analog_rate, min(spec.filter.angles, HIGHEST_CUTOFF * angles.analog_rate))
    q = q[np.isin(angles.analog_time, time)]
    valid = np.asarray(np.isfinite(q).all(axis=1))
    sd = np.where(hinges, spec.angle_sd, spec.placement_sd)
    rotations, positions = by_blocks(lambda rows: _poses(model, rows), q)
    return JointAngles(
        q=q,
        covariance=np.broadcast_to(np.diag(sd**2), (len(q), model.nv, model.nv)).copy(),
        offset_covariance=np.diag(sd**2),
        valid=valid,
        residual=np.zeros((len(q), 0)),
        body_rotations=rotations,
        body_positions=positions,
        marker_sd=float("nan"),
    )


def _in_degrees(trial: TrialSpec, angles: MotionFile) -> bool:
    found = angles.metadata.get("inDegrees")
    if found is None and trial.degrees is None:
        raise FileError(
            trial.markers,
            f"does not say whether its angles are in degrees; write degrees = true or false in trial '{trial.name}'",
        )
    if found is not None and trial.degrees is not None and found != trial.degrees:
        said = "degrees" if found else "radians"
        raise FileError(trial.markers, f"says that its angles are in {said}; trial '{trial.name}' says otherwise")
    return bool(trial.degrees if found is None else found)


@eqx.filter_jit
def _poses(
    model: Model, q: Float[Real, "frame nq"]
) -> tuple[Float[Real, "frame body 3 3"], Float[Real, "frame body 3"]]:
    poses = jax.vmap(lambda row: forward_kinematics(model, row))(q)
    return poses.rotation, poses.position
