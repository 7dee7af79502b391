"""The capture pipeline: files of a session in, a `Session` out."""

import dataclasses
import importlib.metadata
import json
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from pathlib import Path

import numpy as np

from icjax.capture._angles import recorded_angles
from icjax.capture._calibrate import Calibration, calibrate_model
from icjax.capture._calibration_summary import calibration_record
from icjax.capture._check_forces import force_findings
from icjax.capture._contacts import sensor_channels, trial_contacts
from icjax.capture._force_delay import force_delays
from icjax.capture._joint_angles import JointAngles, joint_angles
from icjax.capture._load import load_trial, read_movement
from icjax.capture._sensors import sensor_wrench
from icjax.capture._spec import SessionSpec, TrialSpec
from icjax.files import FileError, MotionFile
from icjax.recording import NORMAL_ONLY, ContactEvents, Recording, Session
from icjax.running import share_out

FARTHEST = 1e3
"""m; no laboratory is larger."""

CALIBRATION_SHARE = 0.2
"""Of the progress of a session that is calibrated first."""


def capture(
    spec: SessionSpec,
    progress: Callable[[float], object] | None = None,
    trials: tuple[str, ...] | None = None,
    executor: Executor | None = None,
) -> Session:
    """Read, calibrate and synchronise every trial of a session and solve its joint angles, contacts and events.

    Forces: channels -> wrench on the subject, tared (`sensor_wrench`); events at the force's own rate
    (`contact_events`); low-pass, onto the marker clock (`on_marker_clock`); contact points (`contact_points`).
    A force is zero where nothing touches. Markers: `joint_angles`. Where the session asks for it, the model is
    calibrated first (`calibrate_model`), and every recording has the calibrated one.

    **Arguments**: `spec` from `read_session`; `progress` is told the finished fraction of the session; `trials` names
    those wanted, default all; `executor` of processes that share the trials (their JAX configured as here).

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
    solve = partial(capture_trial, spec, calibration=calibration)
    recordings = share_out(executor, solve, wanted, lambda fraction: told_of(share + (1.0 - share) * fraction))
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
    sources = tuple(spec.source(name) for name in dict.fromkeys(name for name, _ in trial.touches))
    sensors = tuple(sensor_wrench(motion, trial, source, spec.path) for source in sources)
    names, markers, angles = _movement(spec, trial, motion, progress)
    if calibration is not None and not trial.angles:
        placed = spec.calibration is not None and spec.calibration.placement
        left = calibration.offset_covariance + (0.0 if placed else angles.offset_covariance)
        angles = dataclasses.replace(angles, offset_covariance=left)
    time = motion.marker_time
    contacts = trial_contacts(spec, trial, sensors, angles, time)
    events = contacts.events
    delays = force_delays(spec, trial, sensors, contacts, angles, time)
    return Recording(
        name=trial.name,
        role=trial.role,
        catch_of=(trial.catch_of[0] if len(trial.catch_of) == 1 else trial.catch_of) or None,
        model=spec.model,
        time=time,
        q=angles.q,
        q_covariance=angles.covariance.astype(np.float32),
        q_offset_sd=angles.offset_sd,
        valid=angles.valid,
        contact_names=contacts.names,
        contact_bodies=contacts.bodies,
        contact_force=contacts.force,
        contact_point=contacts.point,
        contact_moment=contacts.moment,
        touching=contacts.touching,
        events=ContactEvents(
            onset=np.array([item[0] for item in events]),
            release=np.array([item[1] for item in events]),
            contact=np.array([item[2] for item in events], dtype=np.int64),
        ),
        marker_names=names,
        markers=markers,
        marker_residual=angles.residual,
        channels=sensor_channels(spec, trial, sensors, angles, time),
        friction=trial.friction,
        provenance=_provenance(spec, trial, motion, angles, contacts.thresholds, delays, calibration),
        contact_kinds=tuple(spec.source(name).kind for name, _ in trial.touches),
        q_offset_covariance=angles.offset_covariance,
        contact_force_sd=contacts.force_sd,
        contact_point_sd=contacts.point_sd,
    )


def _movement(
    spec: SessionSpec, trial: TrialSpec, motion: MotionFile, progress: Callable[[float], None] | None
) -> tuple[tuple[str, ...], np.ndarray, JointAngles]:
    """Names and places of the markers (none where the trial gives angles) and the joint angles."""
    if trial.angles:
        return (), motion.markers, recorded_angles(spec, trial, read_movement(spec, trial), motion.marker_time)
    names, markers = session_markers(spec, motion, trial.markers)
    sites = tuple(spec.model.site(dict(spec.markers)[name]) for name in names)
    rate, cutoff = motion.marker_rate, spec.filter.markers
    solved = joint_angles(spec.model, sites, markers, rate, cutoff, spec.placement_sd, progress, spec.posture)
    return names, markers, solved


def session_markers(spec: SessionSpec, motion: MotionFile, path: Path) -> tuple[tuple[str, ...], np.ndarray]:
    """The markers of the session's map, in its order, `[frame, marker, 3]`.

    **Errors**: `FileError` for a marker that the file lacks or that is missing in every frame.
    """
    names = tuple(label for label, _ in spec.markers)
    columns = []
    for name in names:
        if name not in motion.marker_names:
            known = ", ".join(motion.marker_names[:12]) + (", ..." if len(motion.marker_names) > 12 else "")
            raise FileError(path, f"has no marker '{name}', which {spec.path.name} [markers] names; it has {known}")
        columns.append(motion.marker(name))
        if not np.isfinite(columns[-1]).all(axis=1).any():
            raise FileError(path, f"marker '{name}' is missing in every frame")
        far = np.abs(np.nan_to_num(columns[-1])).max(axis=1) > FARTHEST
        if far.any():
            frame = int(np.argmax(far))
            place = ", ".join(f"{value:g}" for value in columns[-1][frame])
            raise FileError(
                path, f"marker '{name}' is at ({place}) m at {motion.marker_time[frame]:g} s; is the unit right?"
            )
    return names, np.stack(columns, axis=1)


def _provenance(
    spec: SessionSpec,
    trial: TrialSpec,
    motion: MotionFile,
    angles: JointAngles,
    thresholds: dict,
    delays: dict,
    calibration: Calibration | None,
) -> str:
    clock = motion.metadata.get("clock")
    return json.dumps(
        {
            "made_by": f"icjax {importlib.metadata.version('icjax')} capture",
            "session": spec.path.name,
            "simulated": spec.simulated,
            "files": [trial.markers.name] + ([trial.forces.name] if trial.forces else []),
            "model": spec.model_source,
            "marker_rate_hz": motion.marker_rate,
            "analog_rate_hz": motion.analog_rate,
            "marker_unit_found": motion.marker_unit,
            "analog_units_found": dict(zip(motion.analog_names, motion.analog_units, strict=True)),
            "filter_hz": {
                "markers": spec.filter.markers,
                "angles": spec.filter.angles,
                "forces": spec.filter.forces,
                "events": spec.filter.events,
            },
            "marker_sd_m": angles.marker_sd,
            "placement_sd_m": spec.placement_sd,
            "angle_sd_rad": spec.angle_sd if trial.angles else None,
            "calibration": None if calibration is None else calibration_record(calibration),
            "contact_thresholds_n": thresholds,
            "force_delays_s": delays,
            "force_clock": None if clock is None else dataclasses.asdict(clock),
            "normal_only": [name for name, _ in trial.touches if spec.source(name).kind in NORMAL_ONLY],
            "calibrations": {
                source.name: source.calibration.name for source in spec.sources if source.calibration is not None
            },
            "notes": list(motion.notes),
            "doubts": force_findings(spec, trial, motion).doubts,
        }
    )
