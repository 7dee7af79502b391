"""The capture pipeline: files of a session in, a `Session` out."""

import dataclasses
import importlib.metadata
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from icjax.capture._cells import CellForces, cell_contact, pad_point, touched_body, world_wrench
from icjax.capture._contact_point import contact_points
from icjax.capture._events import contact_events, force_course
from icjax.capture._filters import HIGHEST_CUTOFF, lowpass
from icjax.capture._joint_angles import JointAngles, joint_angles
from icjax.capture._load import load_trial
from icjax.capture._sensors import SensorWrench, sensor_wrench
from icjax.capture._spec import SessionSpec, TrialSpec
from icjax.capture._synchronise import on_marker_clock, resampled
from icjax.files import FileError, MotionFile
from icjax.model import Model
from icjax.recording import NORMAL_ONLY, ContactEvents, Recording, SensorChannels, Session


def capture(
    spec: SessionSpec, progress: Callable[[float], object] | None = None, trials: tuple[str, ...] | None = None
) -> Session:
    """Read, calibrate and synchronise every trial of a session and solve its joint angles, contacts and events.

    Forces: channels -> wrench on the subject, tared (`sensor_wrench`); events at the force's own rate
    (`contact_events`); low-pass, onto the marker clock (`on_marker_clock`); contact points (`contact_points`).
    A force is zero where nothing touches. Markers: `joint_angles`.

    **Arguments**: `spec` from `read_session`; `progress` is told the finished fraction of the session; `trials` names
    those wanted, default all.

    **Errors**: `FileError`, one line, for every file or session entry that cannot be used.
    """
    wanted = tuple(item for item in spec.trials if trials is None or item.name in trials)
    unknown = set(trials or ()) - {item.name for item in wanted}
    if unknown:
        raise ValueError(f"trials names {', '.join(sorted(unknown))}, which {spec.path} does not have")
    recordings = []
    for index, trial in enumerate(wanted):

        def told(fraction: float, index: int = index) -> None:
            if progress is not None:
                progress((index + fraction) / len(wanted))

        recordings.append(capture_trial(spec, trial, told))
    return Session(name=spec.name, subject=spec.subject, recordings=tuple(recordings))


def capture_trial(spec: SessionSpec, trial: TrialSpec, progress: Callable[[float], None] | None = None) -> Recording:
    """One trial of a session, see `capture`."""
    motion = load_trial(spec, trial)
    sensors = tuple(sensor_wrench(motion, trial, spec.source(name), spec.path) for name, _ in trial.touches)
    names, markers = session_markers(spec, motion, trial.markers)
    sites = tuple(spec.model.site(dict(spec.markers)[name]) for name in names)
    angles = joint_angles(
        spec.model, sites, markers, motion.marker_rate, spec.filter.markers, spec.placement_sd, progress
    )
    time = motion.marker_time
    count = len(trial.touches)
    force, point, moment = (np.zeros((len(time), count, 3)) for _ in range(3))
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
        least = max(course.onset, _moment_noise(sensor, spec.filter.forces) / spec.contact.point_sd)
        try:
            if sensor.pressing is not None:
                pressing = resampled(sensor.pressing, sensor.time, sensor.rate, time, spec.filter.forces)
                cells, source = CellForces(wrench, pressing), spec.source(sensor.name)
                contact = cell_contact(spec.model, source, target, angles, cells, touching[:, index])
                force[:, index], point[:, index], moment[:, index] = contact
                touching[:, index] &= np.isfinite(contact.point).all(axis=1)
                continue
            point[:, index], moment[:, index] = _points(sensor, wrench, touching[:, index], centre, radius, least)
        except ValueError as error:
            raise FileError(spec.path, f"[[trial]] '{trial.name}': {error}") from error
        force[:, index] = np.where(touching[:, index, None], wrench[:, 3:], 0.0)
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
        channels=_channels(sensors, spec, trial, angles, time),
        friction=trial.friction,
        provenance=_provenance(spec, trial, motion, angles, thresholds),
        contact_kinds=tuple(spec.source(sensor.name).kind for sensor in sensors),
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


def _points(
    sensor: SensorWrench,
    wrench: np.ndarray,
    touching: np.ndarray,
    centre: np.ndarray | None,
    radius: float,
    least: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Contact points and free moments; on a surface that moves, they are found in its place at rest and carried."""
    carrier = sensor.carrier
    if carrier is None:
        return contact_points(wrench, touching, sensor.surface, centre, radius, least)
    R, origin = carrier.rotation, carrier.carried(np.zeros(3))
    force = np.einsum("fji,fj->fi", R, wrench[:, 3:])
    about = np.einsum("fji,fj->fi", R, wrench[:, :3] - np.cross(origin, wrench[:, 3:]))
    at_rest = None if centre is None else carrier.at_rest(centre)
    wrench = np.concatenate([about, force], axis=1)
    point, free = contact_points(wrench, touching, sensor.surface, at_rest, radius, least)
    return carrier.carried(point), np.einsum("fij,fj->fi", R, free)


def _moment_noise(sensor: SensorWrench, cutoff: float) -> float:
    """Standard deviation of the filtered moment about the surface's point, Nm; zero if nothing was tared."""
    if sensor.surface is None or sensor.unloaded.sum() <= 10:
        return 0.0
    about = sensor.wrench[:, :3] - np.cross(np.array(sensor.surface.point)[None, :], sensor.wrench[:, 3:])
    filtered = lowpass(about, sensor.rate, min(cutoff, HIGHEST_CUTOFF * sensor.rate))[sensor.unloaded]
    return float(np.sqrt(np.nanmean(np.nanvar(filtered, axis=0))))


def _channels(
    sensors: tuple[SensorWrench, ...], spec: SessionSpec, trial: TrialSpec, angles: JointAngles, frames: np.ndarray
) -> SensorChannels:
    if not sensors:
        return SensorChannels(sensor_names=(), time=np.zeros(0), wrench=np.zeros((0, 0, 6)))
    wrenches = []
    for sensor, (name, target) in zip(sensors, trial.touches, strict=True):
        wrench, source = sensor.wrench, spec.source(name)
        if sensor.pressing is not None and source.frame == "body":
            if source.cells[0].position is None:
                place = pad_point(spec.model, target, source)
                wrench = np.concatenate([np.cross(place[None, :], wrench[:, 3:]), wrench[:, 3:]], axis=1)
            body = touched_body(spec.model, target)
            wrench = world_wrench(
                wrench, sensor.time, frames, angles.body_rotations[:, body], angles.body_positions[:, body]
            )
        wrenches.append(wrench)
    return SensorChannels(
        sensor_names=tuple(sensor.name for sensor in sensors),
        time=sensors[0].time,
        wrench=np.stack(wrenches, axis=1),
    )


def _provenance(spec: SessionSpec, trial: TrialSpec, motion: MotionFile, angles: JointAngles, thresholds: dict) -> str:
    clock = motion.metadata.get("clock")
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
            "contact_thresholds_n": thresholds,
            "force_clock": None if clock is None else dataclasses.asdict(clock),
            "normal_only": [name for name, _ in trial.touches if spec.source(name).kind in NORMAL_ONLY],
            "calibrations": {
                source.name: source.calibration.name for source in spec.sources if source.calibration is not None
            },
            "notes": list(motion.notes),
        }
    )
