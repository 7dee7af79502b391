"""Opening the files of one trial."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from icjax.capture._align import trial_clock
from icjax.capture._filters import HIGHEST_CUTOFF
from icjax.capture._spec import SessionSpec, TrialSpec
from icjax.files import FileError, MotionFile, read_c3d, read_csv, read_sto, read_trc

READERS = {".c3d": read_c3d, ".trc": read_trc, ".sto": read_sto, ".mot": read_sto}


def load_trial(spec: SessionSpec, trial: TrialSpec) -> MotionFile:
    """Markers and forces of a trial on one time axis: from one file, or from one file each.

    Forces of a separate acquisition are put on the marker clock where the session says how ([clock]); the `Clock` is
    then `metadata["clock"]`.

    **Errors**: `FileError` of the reader, or when the format is unknown, no marker or no force is found where the
    session needs it, times do not increase, the two files do not overlap in time, or a cut-off that the session
    states is too high for the rate that it is applied at.
    """
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
        _increasing(trial.forces, motion.analog_time, "analog")
        clock = trial_clock(spec, trial, alone, motion)
        if clock is not None:
            motion = dataclasses.replace(
                motion,
                analog_time=clock.on_marker_clock(motion.analog_time),
                analog_rate=motion.analog_rate * (1.0 + clock.drift),
                metadata={**motion.metadata, "clock": clock},
            )
    if not len(motion.marker_time):
        raise FileError(trial.markers, "holds no markers")
    force_file = trial.forces or trial.markers
    for path, time, what in (
        (trial.markers, motion.marker_time, "marker"),
        (force_file, motion.analog_time, "analog"),
    ):
        _increasing(path, time, what)
    if trial.touches and not motion.analog.size:
        raise FileError(force_file, f"holds no forces, but trial '{trial.name}' touches '{trial.touches[0][0]}'")
    if trial.touches and (
        motion.analog_time[0] > motion.marker_time[-1] or motion.analog_time[-1] < motion.marker_time[0]
    ):
        raise FileError(force_file, "forces and markers do not overlap in time")
    for key in spec.filter.stated:
        rate = motion.marker_rate if key == "markers" else motion.analog_rate
        cutoff = getattr(spec.filter, key)
        if (key == "markers" or trial.touches) and cutoff > HIGHEST_CUTOFF * rate:
            raise FileError(
                spec.path,
                f"[filter] key '{key}': {cutoff:g} Hz is too high for the {rate:g} Hz of trial '{trial.name}'; "
                f"at most {HIGHEST_CUTOFF * rate:g} Hz",
            )
    return motion


def _increasing(path: Path, time: np.ndarray, what: str) -> None:
    wrong = np.flatnonzero(~(np.diff(time) > 0))
    if len(wrong):
        raise FileError(path, f"{what} time does not increase after sample {wrong[0] + 1} ({time[wrong[0]]:g} s)")


def read_motion(path: Path, columns: Mapping[str, Any], part: str | None = None) -> MotionFile:
    """A file by its format; of a CSV file only the "markers" or the "channels", or both (None).

    **Errors**: `FileError` of the reader, or for an unknown format.
    """
    kind = path.suffix.lower()
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
    raise FileError(path, f"has the unknown format '{kind}' (known: .c3d, .trc, .mot, .sto, .csv)")
