"""Opening the files of one trial."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from icjax.capture._align import trial_clock
from icjax.capture._filters import HIGHEST_CUTOFF
from icjax.capture._spec import SessionSpec, TrialSpec
from icjax.capture._trial_time import check_even, common_time, even_markers
from icjax.files import FileError, MotionFile, is_qualisys, read_bvh, read_c3d, read_csv, read_sto, read_trc, read_tsv

READERS = {".c3d": read_c3d, ".trc": read_trc, ".sto": read_sto, ".mot": read_sto}

ANGLE_FORMATS = (".mot", ".sto", ".bvh")
"""Files that joint angles are read from."""


def load_trial(spec: SessionSpec, trial: TrialSpec) -> MotionFile:
    """Markers and forces of a trial on one time axis: from one file, or from one file each.

    Forces of a separate acquisition are put on the marker clock where the session says how ([clock]); the `Clock` is
    then `metadata["clock"]`.

    **Errors**: `FileError` of the reader, or when the format is unknown, no marker or no force is found where the
    session needs it, times do not increase, the two files do not overlap in time, or a cut-off that the session
    states is too high for the rate that it is applied at.
    """
    if trial.angles:
        motion = angle_frames(read_movement(spec, trial))
    else:
        motion = read_motion(trial.markers, spec.columns, None if trial.forces is None else "markers")
    alone = motion
    if trial.forces is not None:
        forces = read_motion(trial.forces, spec.columns, "channels")
        motion = dataclasses.replace(
            motion,
            analog_names=forces.analog_names,
            analog_units=forces.analog_units,
            analog_rate=forces.analog_rate,
            analog_time=forces.analog_time,
            analog=forces.analog,
            plates=forces.plates,
            notes=motion.notes + forces.notes,
        )
        check_even(motion.analog_time, trial.forces, "force")
        clock = trial_clock(spec, trial, alone, motion)
        if clock is not None:
            motion = dataclasses.replace(
                motion,
                analog_time=clock.on_marker_clock(motion.analog_time),
                analog_rate=motion.analog_rate * (1.0 + clock.drift),
                metadata={**motion.metadata, "clock": clock},
            )
    if not len(motion.marker_time):
        raise FileError(trial.markers, f"holds no {'angles' if trial.angles else 'markers'}")
    force_file = trial.forces or trial.markers
    if trial.touches and not motion.analog.size:
        raise FileError(force_file, f"holds no forces, but trial '{trial.name}' touches '{trial.touches[0][0]}'")
    if trial.angles:
        check_even(motion.marker_time, trial.markers, "angle")
    else:
        motion = even_markers(motion, trial.markers)
    if trial.touches:
        check_even(motion.analog_time, force_file, "force")
        motion = common_time(motion, force_file)
    movement = "angles" if trial.angles else "markers"
    for key in spec.filter.stated:
        rate = motion.marker_rate if key == movement else motion.analog_rate
        cutoff = getattr(spec.filter, key)
        applied = key == movement or (key in ("forces", "events") and trial.touches)
        if applied and cutoff > HIGHEST_CUTOFF * rate:
            raise FileError(
                spec.path,
                f"[filter] key '{key}': {cutoff:g} Hz is too high for the {rate:g} Hz of trial '{trial.name}'; "
                f"at most {np.floor(HIGHEST_CUTOFF * rate):g} Hz",
            )
    return motion


def read_movement(spec: SessionSpec, trial: TrialSpec) -> MotionFile:
    """The joint angles of a trial as their file holds them, one analog channel a column.

    **Errors**: `FileError` of the reader, or for a format that holds no joint angles.
    """
    kind = trial.markers.suffix.lower()
    if kind not in ANGLE_FORMATS:
        raise FileError(
            trial.markers, f"has the format '{kind}', which holds no angles (known: {', '.join(ANGLE_FORMATS)})"
        )
    if kind == ".bvh":
        motion = read_bvh(trial.markers)
        return dataclasses.replace(motion, metadata={**motion.metadata, "inDegrees": False})  # its reader converts
    return read_motion(trial.markers, spec.columns, "channels")


def angle_frames(angles: MotionFile) -> MotionFile:
    """A file without markers whose frames are the rows of a file of joint angles."""
    return MotionFile(
        path=angles.path,
        marker_names=(),
        marker_rate=angles.analog_rate,
        marker_time=angles.analog_time,
        markers=np.zeros((len(angles.analog_time), 0, 3)),
        marker_unit="",
        metadata=angles.metadata,
        notes=angles.notes,
    )


def read_motion(path: Path, columns: Mapping[str, Any], part: str | None = None) -> MotionFile:
    """A file by its format; of a CSV file only the "markers" or the "channels", or both (None).

    **Errors**: `FileError` of the reader, or for an unknown format.
    """
    kind = path.suffix.lower()
    if kind in (".tsv", ".txt") and is_qualisys(path):
        return read_tsv(path)
    if kind in READERS:
        return READERS[kind](path)
    if kind in (".csv", ".tsv", ".txt"):
        chosen = dict(columns)
        if part == "markers":
            chosen = {key: value for key, value in chosen.items() if key != "units"} | {"channels": {}}
        elif part == "channels":
            chosen = {key: value for key, value in chosen.items() if key != "length_unit"} | {"markers": {}}
        try:
            return read_csv(path, chosen)
        except FileError:
            raise
        except ValueError as error:
            raise FileError(path, f"[columns]: {error}") from error
    raise FileError(path, f"has the unknown format '{kind}' (known: .c3d, .trc, .mot, .sto, .csv, .tsv)")
