"""What a session means, in words, and what looks wrong in its files."""

import numpy as np

from icjax.capture._align import pulse_errors
from icjax.capture._angles import recorded_angles
from icjax.capture._capture import session_markers
from icjax.capture._check_forces import force_findings
from icjax.capture._load import load_trial, read_movement
from icjax.capture._spec import SessionSpec, SourceSpec, TrialSpec
from icjax.files import FileError, MotionFile
from icjax.recording import NORMAL_ONLY

ERROR, SUSPICIOUS = "error: ", "suspicious: "
"""How lines begin that name what capture would refuse, and what it would accept but a person should look at."""

EXTENT = (0.001, 50.0)
"""m; markers of one trial that spread over less or more are probably in another unit."""

MANY_GAPS = 0.2
"""Share of frames without a marker from which on it is worth a line of its own."""

NO_TANGENTIAL = "only the normal force is measured; joint torques are biased and friction is unknown"
"""What every result from such a sensor has to say."""

LATE_PULSE = 1.0
"""Samples; sync pulses of a shared acquisition that come later or earlier than this say that the clocks differ."""


def check(spec: SessionSpec) -> list[str]:
    """Lines of text: what was understood of a session and its files, trial by trial.

    Rates, durations, units as found, channels, plates, gaps, baselines before taring; then lines that begin with
    "suspicious: " (markers in the file that the session does not use are named without it) and "error: " for what
    `capture` would refuse. Nothing is written.
    """
    model = spec.model
    roles = [trial.role for trial in spec.trials]
    counts = ", ".join(f"{roles.count(role)} {role}" for role in dict.fromkeys(roles))
    lines = [
        f"session '{spec.name}' of subject '{spec.subject}' ({spec.path.name}): {counts}",
        f"model {spec.model_source}: bodies {', '.join(model.body_names[1:])}; joints "
        + ", ".join(f"{name} ({kind})" for name, kind in zip(model.joint_names, model.joint_types, strict=True)),
        f"{len(spec.markers)} markers, placed to {1e3 * spec.placement_sd:g} mm"
        + (f"; {len(spec.angles)} joint angles, good to {spec.angle_sd:.3g} rad" if spec.angles else ""),
        f"zero-phase low-pass: markers {spec.filter.markers:g} Hz, forces {spec.filter.forces:g} Hz, "
        f"events {spec.filter.events:g} Hz (cut-off after both passes)",
    ]
    lines += [_source_line(source) for source in spec.sources]
    lines += [SUSPICIOUS + text for text in _session_doubts(spec)]
    for trial in spec.trials:
        try:
            motion = load_trial(spec, trial)
            lines += [f"trial '{trial.name}' ({trial.role}): {text}" for text in _understood(spec, motion)]
            forces = force_findings(spec, trial, motion)
            lines += [f"trial '{trial.name}': {text}" for text in forces.notes]
            pulses, late = _pulses(spec, trial, motion)
            lines += [f"trial '{trial.name}': {text}" for text in pulses]
            doubts = ([] if trial.angles else _marker_doubts(spec, motion)) + forces.doubts + late
            lines += [f"{SUSPICIOUS}trial '{trial.name}': {text}" for text in doubts]
            lines += [f"{ERROR}{spec.path}: [[trial]] '{trial.name}': {text}" for text in forces.errors]
            if trial.angles:
                recorded_angles(spec, trial, read_movement(spec, trial), motion.marker_time)
            else:
                session_markers(spec, motion, trial.markers)
        except FileError as error:
            lines.append(f"{ERROR}{error}")
    return lines


def _source_line(source: SourceSpec) -> str:
    what = f"plate {source.plate} of the file" if source.kind == "force_plate" else ", ".join(source.channels)
    if source.kind in NORMAL_ONLY:
        what += f"; {source.frame} axes"
        what += f"; calibrated by {source.calibration.name}" if source.calibration else "; not calibrated"
    if source.top is not None:
        what += f"; {1e3 * source.top.mass:g} g above it move with "
        what += ", ".join(source.top.markers or source.top.accelerometer)
    tare = ", ".join(f"{a:g} to {b:g} s" for a, b in source.tare) or "none"
    place = "" if source.kind in ("force_plate", *NORMAL_ONLY) else f", moments about {source.position} m"
    return f"source '{source.name}': {source.kind} ({what}), force {source.sign.replace('_', ' ')}{place}; tare {tare}"


def _session_doubts(spec: SessionSpec) -> list[str]:
    model = spec.model
    doubts = []
    for source in spec.sources:
        if not source.tare and not all(trial.tare for trial in spec.trials):
            doubts.append(f"source '{source.name}' has no tare window; its offset stays in the forces")
    blind = [source.name for source in spec.sources if source.kind in NORMAL_ONLY]
    if blind:
        doubts.append(f"{', '.join(blind)}: {NO_TANGENTIAL}")
    if not any(trial.role == "catch" for trial in spec.trials):
        doubts.append("no catch trials: a planned deceleration cannot be told from compliance")
    marked = {model.site_bodies[model.site(site)] for _, site in spec.markers}
    bare = [name for index, name in enumerate(model.body_names) if index and spec.markers and index not in marked]
    if bare:
        doubts.append(f"no marker on {', '.join(bare)}: their joints are known only through other bodies")
    return doubts


def _understood(spec: SessionSpec, motion: MotionFile) -> list[str]:
    time = motion.marker_time
    moved = bool(motion.marker_names)
    lines = [
        f"{len(time)} frames at {motion.marker_rate:g} Hz, {time[0]:g} to {time[-1]:g} s, "
        + (f"{len(motion.marker_names)} markers in {motion.marker_unit or 'an unstated unit'}" if moved else "angles")
    ]
    if motion.analog.size:
        names = ", ".join(
            f"{name} ({unit or '?'})" for name, unit in zip(motion.analog_names, motion.analog_units, strict=True)
        )
        lines.append(f"{len(motion.analog_time)} analog samples at {motion.analog_rate:g} Hz: {names}")
    for number, plate in enumerate(motion.plates, 1):
        corners = plate.corners
        sides = np.linalg.norm(corners[0] - corners[1]), np.linalg.norm(corners[0] - corners[3])
        centre = ", ".join(f"{value:.3f}" for value in corners.mean(axis=0))
        lines.append(
            f"force plate {number}: type {plate.type}, {sides[0]:.3f} by {sides[1]:.3f} m, centre ({centre}) m"
        )
    if "clock" in motion.metadata:
        lines.append(f"forces have a clock of their own: {motion.metadata['clock'].described()}")
    gaps = []
    for label, _ in spec.markers:
        if label in motion.marker_names:
            gone = int((~np.isfinite(motion.marker(label)).all(axis=1)).sum())
            if gone:
                gaps.append(f"{label} {100 * gone / len(time):.1f} %")
    lines.append("gaps: " + (", ".join(gaps) if gaps else "none"))
    used = {label for label, _ in spec.markers}
    unused = [name for name in motion.marker_names if name not in used]
    if unused:
        lines.append(f"markers not used: {', '.join(unused)}")
    lines += [f"note: {note}" for note in motion.notes]
    return lines


def _marker_doubts(spec: SessionSpec, motion: MotionFile) -> list[str]:
    doubts, gone = [], []
    known = [label for label, _ in spec.markers if label in motion.marker_names]
    for label in known:
        share = float(np.mean(~np.isfinite(motion.marker(label)).all(axis=1)))
        if MANY_GAPS < share < 1:
            gone.append(f"'{label}' in {100 * share:.0f} %")
        if share < 1 and len(motion.marker_time) > 1 and float(np.nanmax(np.nanstd(motion.marker(label), axis=0))) == 0:
            doubts.append(f"marker '{label}' never moves, not even by noise")
    if gone:
        doubts.append(f"markers are missing, {', '.join(gone)} of the frames")
    if known:
        places = np.concatenate([motion.marker(label) for label in known])
        places = places[np.isfinite(places).all(axis=1)]
        if len(places):
            extent = float(np.max(places.max(axis=0) - places.min(axis=0)))
            if not EXTENT[0] <= extent <= EXTENT[1]:
                doubts.append(f"markers spread over {extent:g} m; is the unit {motion.marker_unit or '?'} right?")
    return doubts


def _pulses(spec: SessionSpec, trial: TrialSpec, motion: MotionFile) -> tuple[list[str], list[str]]:
    """How far the sync pulses of a shared acquisition are off, and whether that is too far."""
    if spec.clock is None or spec.clock.period is None or trial.forces is not None:
        return [], []
    try:
        errors = pulse_errors(spec.clock, motion)
    except FileError:
        raise
    except ValueError as error:
        return [], [f"channel '{spec.clock.sync}' {error}"]
    if not len(errors):
        return [], [f"channel '{spec.clock.sync}' shows no pulse"]
    largest = float(errors[np.argmax(np.abs(errors))])
    told = f"{len(errors)} sync pulses, at most {1e3 * largest:+.2f} ms off the marker clock"
    late = [told + "; are the clocks shared?"] if abs(largest) > LATE_PULSE / motion.analog_rate else []
    return [told + f" (one sample is {1e3 / motion.analog_rate:g} ms)"], late
