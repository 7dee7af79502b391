"""From the channels of a force source to the wrench on the subject in world axes, tared."""

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from icjax.capture._cells import cell_forces, cell_values
from icjax.capture._channel_units import EXPECTED, require_units
from icjax.capture._plate_motion import PlateMotion, accelerated, plate_motion
from icjax.capture._plates import plate_frame, plate_wrench
from icjax.capture._spec import SourceSpec, SurfaceSpec, TrialSpec
from icjax.files import FileError, ForcePlate, MotionFile
from icjax.recording import NORMAL_ONLY


@dataclasses.dataclass(frozen=True)
class SensorWrench:
    """One source at its own rate.

    - `time` [S] s, marker clock; `rate` Hz.
    - `wrench` [S, 6]: (moment about the world origin, force) on the subject, Nm and N, tared.
    - `unloaded` [S]: samples of the tare windows.
    - `surface`: the touched plane, None if the session names none.
    - `pressing` [S, 4]: of sources that measure only normal forces, see `CellForces`; their `wrench` is in the source's
      own frame (`SourceSpec.frame`). `carrier`: how the sensor and its surface move, where the session says so.
    """

    name: str
    time: Float[np.ndarray, " sample"]
    rate: float
    wrench: Float[np.ndarray, "sample 6"]
    unloaded: Bool[np.ndarray, " sample"]
    surface: SurfaceSpec | None
    pressing: Float[np.ndarray, "sample 4"] | None = None
    carrier: PlateMotion | None = None


def sensor_wrench(motion: MotionFile, trial: TrialSpec, source: SourceSpec, session: Path) -> SensorWrench:
    """The wrench that a source measured, on the subject, in world axes, about the world origin.

    With the sensor's axes R and reference point p: f = s R F, m = s R M + p x s R F, s = -1 for a source that
    measures the force on the environment. The baseline is the mean of each tare window, and between the middles
    of several windows a straight line; it is subtracted channel by channel.

    The inertia of a plate above the sensor is in the reading. Where the session states its mass and what shows its
    motion (`TopSpec`), it is taken out, and the sensor turns and moves with it. Otherwise it is not modelled: a mount
    that rings at some hundred Hz follows the finger quasi-statically in the band that is kept, and the ringing itself
    is removed by the filters (`FilterSpec`). Sensors of normal force: see `cell_forces`.

    **Errors**: `FileError` for a channel or plate that the file lacks, a sample that is not finite (a force that
    is not known is neither a contact nor the absence of one; only the point of application of "force_at_point" may
    be NaN, as files have it where nothing touches), or a tare window without samples.
    """
    name = trial.forces or trial.markers
    if source.kind == "force_plate":
        plate = _plate(motion, name, source)
        labels = tuple(motion.analog_names[column] for column in plate.channels)
        _all_known(name, source.name, motion.analog_time, labels, motion.analog[:, list(plate.channels)])
        raw = plate_wrench(motion, plate)
        surface = source.surface or plate_surface(plate)
    else:
        channels = motion.channels(source.channels)
        if source.kind in EXPECTED:
            columns = [motion.analog_names.index(channel) for channel in source.channels]
            units = tuple(motion.analog_units[column] for column in columns)
            require_units(name, source.name, EXPECTED[source.kind], source.channels, units)
        pointed = source.kind == "force_at_point"
        used = (0, 1, 2, 6, 7, 8) if pointed else tuple(range(channels.shape[1]))
        labels = tuple(source.channels[column] for column in used)
        _all_known(name, source.name, motion.analog_time, labels, channels[:, list(used)])
        if source.kind in NORMAL_ONLY:
            return _normal_only(motion, trial, source, session, channels)
        R = np.array(source.rotation)
        force = channels[:, :3] @ R.T
        if pointed:
            point = channels[:, 3:6] @ R.T + np.array(source.position)
            moment = channels[:, 6:9] @ R.T + np.cross(np.nan_to_num(point), force)
        else:
            moment = channels[:, 3:6] @ R.T + np.cross(np.array(source.position)[None, :], force)
        raw = np.concatenate([moment, force], axis=1)
        surface = source.surface
    time = motion.analog_time
    baseline, unloaded = _baseline(raw, time, trial.tare or source.tare, name, source.name, session)
    sign = -1.0 if source.sign == "on_environment" else 1.0
    wrench, carrier = sign * (raw - baseline), None
    if source.top is not None:
        wrench, carrier = _without_top(motion, trial, source, wrench, unloaded)
    return SensorWrench(
        name=source.name,
        time=time,
        rate=(len(time) - 1) / float(time[-1] - time[0]),
        wrench=wrench,
        unloaded=unloaded,
        surface=surface,
        carrier=carrier,
    )


def _without_top(
    motion: MotionFile, trial: TrialSpec, source: SourceSpec, wrench: np.ndarray, unloaded: np.ndarray
) -> tuple[np.ndarray, PlateMotion | None]:
    """The wrench turned and moved with the sensor, without weight and inertia of what is mounted above it."""
    top, place = source.top, np.array(source.position)
    assert top is not None
    if top.accelerometer:
        if not unloaded.any():
            raise FileError(motion.path, f"source '{source.name}': an accelerometer needs a tare window")
        com = place if top.com is None else np.array(top.com)
        return wrench + accelerated(motion, top, np.array(source.rotation), unloaded, com), None
    frames = plate_motion(motion, top, trial.tare or source.tare)
    moved = frames.at(motion.analog_time)
    force = np.einsum("sij,sj->si", moved.rotation, wrench[:, 3:])
    about = wrench[:, :3] - np.cross(place[None, :], wrench[:, 3:])
    moment = np.einsum("sij,sj->si", moved.rotation, about) + np.cross(moved.carried(place), force)
    return np.concatenate([moment, force], axis=1) + moved.added(top.mass), frames


def _normal_only(
    motion: MotionFile, trial: TrialSpec, source: SourceSpec, session: Path, channels: np.ndarray
) -> SensorWrench:
    """Calibrated cells, tared one by one."""
    name, time = trial.forces or trial.markers, motion.analog_time
    _all_known(name, source.name, time, source.channels, channels)
    values = cell_values(motion, source)
    baseline, unloaded = _baseline(values, time, trial.tare or source.tare, name, source.name, session)
    forces = cell_forces(values - baseline, source)
    rate = (len(time) - 1) / float(time[-1] - time[0])
    return SensorWrench(source.name, time, rate, forces.wrench, unloaded, source.surface, forces.pressing)


def plate_surface(plate: ForcePlate) -> SurfaceSpec:
    """Top of a force plate; the normal points out of it, against the plate's z axis."""
    R, p = plate_frame(plate)
    return SurfaceSpec(point=tuple(p.tolist()), normal=tuple((-R[:, 2]).tolist()))


def _plate(motion: MotionFile, path: Path, source: SourceSpec) -> ForcePlate:
    assert source.plate is not None
    if not 1 <= source.plate <= len(motion.plates):
        raise FileError(
            path, f"has no force plate {source.plate} (source '{source.name}'); it has {len(motion.plates)}"
        )
    return motion.plates[source.plate - 1]


def _all_known(path: Path, source: str, time: np.ndarray, labels: tuple[str, ...], channels: np.ndarray) -> None:
    bad = ~np.isfinite(channels)
    if bad.any():
        sample, column = np.argwhere(bad)[0]
        raise FileError(
            path,
            f"channel '{labels[column]}' of source '{source}' is not a finite number at {time[sample]:g} s; "
            f"{bad.any(axis=1).sum()} of {len(time)} samples have such a gap",
        )


def _baseline(
    raw: np.ndarray,
    time: np.ndarray,
    windows: tuple[tuple[float, float], ...],
    path: Path,
    source: str,
    session: Path,
) -> tuple[np.ndarray, np.ndarray]:
    """Baseline of every sample and which samples it was taken from."""
    unloaded = np.zeros(len(time), bool)
    centres, means = [], []
    for start, stop in windows:
        inside = (time >= start - 1e-9) & (time <= stop + 1e-9)
        if not inside.any() or start < time[0] - 0.5 or stop > time[-1] + 0.5:
            raise FileError(
                session,
                f"source '{source}': the tare window {start:g} to {stop:g} s is outside the recording "
                f"{Path(path).name}, {time[0]:g} to {time[-1]:g} s",
            )
        unloaded |= inside
        centres.append(float(time[inside].mean()))
        means.append(np.nanmean(raw[inside], axis=0))
    if not windows:
        return np.zeros_like(raw), unloaded
    order = np.argsort(centres)
    table = np.array(means)[order]
    lines = [np.interp(time, np.array(centres)[order], table[:, column]) for column in range(raw.shape[1])]
    return np.stack(lines, axis=1), unloaded
