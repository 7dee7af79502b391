"""The capture pipeline: files of a session in, a `Session` out."""

import dataclasses
import importlib.metadata
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from icjax.capture._calibrate import Calibration, calibrate_model
from icjax.capture._calibration_summary import calibration_record
from icjax.capture._contact_noise import force_noise, moment_noise, point_deviation
from icjax.capture._contact_point import contact_points
from icjax.capture._events import contact_events, force_course
from icjax.capture._joint_angles import JointAngles, joint_angles
from icjax.capture._load import load_trial
from icjax.capture._sensors import SensorWrench, sensor_wrench
from icjax.capture._spec import SessionSpec, TrialSpec
from icjax.capture._synchronise import on_marker_clock
from icjax.files import FileError, MotionFile
from icjax.model import Model
from icjax.recording import ContactEvents, Recording, SensorChannels, Session

CALIBRATION_SHARE = 0.2
"""Of the progress of a session that is calibrated first."""


def capture(
    spec: SessionSpec, progress: Callable[[float], object] | None = None, trials: tuple[str, ...] | None = None
) -> Session:
    """Read, calibrate and synchronise every trial of a session and solve its joint angles, contacts and events.

    Forces: channels -> wrench on the subject, tared (`sensor_wrench`); events at the force's own rate
    (`contact_events`); low-pass, onto the marker clock (`on_marker_clock`); contact points (`contact_points`).
    A force is zero where nothing touches. Markers: `joint_angles`. Where the session asks for it, the model is
    calibrated first (`calibrate_model`), and every recording has the calibrated one.

    **Arguments**: `spec` from `read_session`; `progress` is told the finished fraction of the session; `trials` names
    those wanted, default all.

    **Errors**: `FileError`, one line, for every file or session entry that cannot be used.
    """
    wanted = tuple(item for item in spec.trials if trials is None or item.name in trials)
    unknown = set(trials or ()) - {item.name for item in wanted}
    if unknown:
        raise ValueError(f"trials names {', '.join(sorted(unknown))}, which {spec.path} does not have")

    def told_of(fraction: float) -> None:
        if progress is not None:
            progress(fraction)

    calibration = None
    share = 0.0
    if spec.calibration is not None:
        share = CALIBRATION_SHARE
        calibration = calibrate_session(spec, lambda fraction: told_of(share * fraction))
        spec = dataclasses.replace(spec, model=calibration.model)
    recordings = []
    for index, trial in enumerate(wanted):

        def told(fraction: float, index: int = index) -> None:
            told_of(share + (1.0 - share) * (index + fraction) / len(wanted))

        recordings.append(capture_trial(spec, trial, told, calibration))
    return Session(name=spec.name, subject=spec.subject, recordings=tuple(recordings))


def calibrate_session(spec: SessionSpec, progress: Callable[[float], None] | None = None) -> Calibration:
    """The calibration that a session asks for, from the raw markers of the trials that it names.

    **Errors**: `FileError` for a session without [calibration], or markers that cannot be used.
    """
    if spec.calibration is None:
        raise FileError(spec.path, "has no table [calibration]")
    markers = []
    for trial in spec.trials:
        if trial.name in spec.calibration.trials:
            names, found = session_markers(spec, load_trial(spec, trial), trial.markers)
            markers.append(found)
    sites = tuple(spec.model.site(site) for _, site in spec.markers)
    try:
        return calibrate_model(
            spec.model, sites, tuple(markers), spec.placement_sd, spec.calibration, spec.posture, progress
        )
    except FileError:
        raise
    except ValueError as error:
        raise FileError(spec.path, f"[calibration]: {error}") from error


def capture_trial(
    spec: SessionSpec,
    trial: TrialSpec,
    progress: Callable[[float], None] | None = None,
    calibration: Calibration | None = None,
) -> Recording:
    """One trial of a session, see `capture`; `calibration` is the one that the model of `spec` comes from."""
    motion = load_trial(spec, trial)
    sensors = tuple(sensor_wrench(motion, trial, spec.source(name), spec.path) for name, _ in trial.touches)
    names, markers = session_markers(spec, motion, trial.markers)
    sites = tuple(spec.model.site(dict(spec.markers)[name]) for name in names)
    angles = joint_angles(
        spec.model, sites, markers, motion.marker_rate, spec.filter.markers, spec.placement_sd, progress, spec.posture
    )
    if calibration is not None:
        placed = spec.calibration is not None and spec.calibration.placement
        left = calibration.offset_covariance + (0.0 if placed else angles.offset_covariance)
        angles = dataclasses.replace(angles, offset_covariance=left)
    time = motion.marker_time
    count = len(trial.touches)
    force, point, moment = (np.zeros((len(time), count, 3)) for _ in range(3))
    force_sd, point_sd = np.zeros(count), np.zeros((len(time), count))
    touching = np.zeros((len(time), count), bool)
    events: list[tuple[float, float, int]] = []
    bodies, thresholds = [], {}
    for index, (sensor, (_, target)) in enumerate(zip(sensors, trial.touches, strict=True)):
        course = force_course(sensor, spec.filter.events, spec.contact)
        found = contact_events(course, spec.contact)
        thresholds[sensor.name] = {"noise": course.noise, "onset": course.onset, "release": course.release}
        events += [(onset, release, index) for onset, release in found]
        for onset, release in found:
            touching[:, index] |= (time >= onset) & ~(time > release)
        wrench = on_marker_clock(sensor, time, spec.filter.forces)
        touching[:, index] &= np.isfinite(wrench).all(axis=1)
        body, centre, radius = _target(spec.model, target, angles)
        bodies.append(body)
        noise = moment_noise(sensor, spec.filter.forces)
        least = max(course.onset, noise / spec.contact.point_sd)
        try:
            point[:, index], moment[:, index] = contact_points(
                wrench, touching[:, index], sensor.surface, centre, radius, least
            )
        except ValueError as error:
            raise FileError(spec.path, f"[[trial]] '{trial.name}': {error}") from error
        force[:, index] = np.where(touching[:, index, None], wrench[:, 3:], 0.0)
        force_sd[index] = force_noise(sensor, spec.filter.forces)
        point_sd[:, index] = point_deviation(force[:, index], sensor, noise, least, spec.contact.point_sd)
        thresholds[sensor.name]["centre_of_pressure_above"] = least
    events.sort()
    return Recording(
        name=trial.name,
        role=trial.role,
        catch_of=trial.catch_of,
        model=spec.model,
        time=time,
        q=angles.q,
        q_covariance=angles.covariance,
        q_offset_sd=angles.offset_sd,
        valid=angles.valid,
        contact_names=tuple(sensor.name for sensor in sensors),
        contact_bodies=tuple(bodies),
        contact_force=force,
        contact_point=point,
        contact_moment=moment,
        touching=touching,
        events=ContactEvents(
            onset=np.array([item[0] for item in events]),
            release=np.array([item[1] for item in events]),
            contact=np.array([item[2] for item in events], dtype=np.int64),
        ),
        marker_names=names,
        markers=markers,
        marker_residual=angles.residual,
        channels=_channels(sensors),
        friction=trial.friction,
        provenance=_provenance(spec, trial, motion, angles, thresholds, calibration),
        q_offset_covariance=angles.offset_covariance,
        contact_force_sd=force_sd,
        contact_point_sd=point_sd,
    )


def session_markers(spec: SessionSpec, motion: MotionFile, path: Path) -> tuple[tuple[str, ...], np.ndarray]:
    """The markers of the session's map, in its order, `[frame, marker, 3]`.

    **Errors**: `FileError` for a marker that the file lacks or that is missing in every frame.
    """
    names = tuple(label for label, _ in spec.markers)
    columns = []
    for name in names:
        if name not in motion.marker_names:
            known = ", ".join(motion.marker_names[:12])
            raise FileError(path, f"has no marker '{name}', which {spec.path.name} [markers] names; it has {known}")
        columns.append(motion.marker(name))
        if not np.isfinite(columns[-1]).all(axis=1).any():
            raise FileError(path, f"marker '{name}' is missing in every frame")
    return names, np.stack(columns, axis=1)


def _target(model: Model, target: str, angles: JointAngles) -> tuple[str, np.ndarray | None, float]:
    """Body that a source touches; centre and radius of its pad, if it is a pad."""
    if target not in model.pad_names:
        return target, None, 0.0
    pad = model.pad(target)
    body = model.pad_bodies[pad]
    place = np.asarray(model.pad_centre)[pad]
    centre = angles.body_rotations[:, body] @ place + angles.body_positions[:, body]
    return model.body_names[body], centre, float(np.asarray(model.pad_radius)[pad])


def _channels(sensors: tuple[SensorWrench, ...]) -> SensorChannels:
    if not sensors:
        return SensorChannels(sensor_names=(), time=np.zeros(0), wrench=np.zeros((0, 0, 6)))
    return SensorChannels(
        sensor_names=tuple(sensor.name for sensor in sensors),
        time=sensors[0].time,
        wrench=np.stack([sensor.wrench for sensor in sensors], axis=1),
    )


def _provenance(
    spec: SessionSpec,
    trial: TrialSpec,
    motion: MotionFile,
    angles: JointAngles,
    thresholds: dict,
    calibration: Calibration | None,
) -> str:
    return json.dumps(
        {
            "made_by": f"icjax {importlib.metadata.version('icjax')} capture",
            "session": spec.path.name,
            "files": [trial.markers.name] + ([trial.forces.name] if trial.forces else []),
            "model": spec.model_source,
            "marker_rate_hz": motion.marker_rate,
            "analog_rate_hz": motion.analog_rate,
            "marker_unit_found": motion.marker_unit,
            "analog_units_found": dict(zip(motion.analog_names, motion.analog_units, strict=True)),
            "filter_hz": {
                "markers": spec.filter.markers,
                "forces": spec.filter.forces,
                "events": spec.filter.events,
            },
            "marker_sd_m": angles.marker_sd,
            "placement_sd_m": spec.placement_sd,
            "calibration": None if calibration is None else calibration_record(calibration),
            "contact_thresholds_n": thresholds,
            "notes": list(motion.notes),
        }
    )
