"""From a recording in which film sensors are pressed against a reference to their curves."""

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from icjax.capture._fsr import Curve, curves_text, fit_curve
from icjax.capture._load import read_motion
from icjax.capture._source_file import windows
from icjax.files import FileError, MotionFile, Table, read_toml


class Reference(NamedTuple):
    """Channels of the reference force (one, or three whose size counts) and its unloaded intervals, s."""

    channels: tuple[str, ...]
    tare: tuple[tuple[float, float], ...]


def calibrate(path: str | os.PathLike) -> tuple[Curve, ...]:
    """Curves of the sensors that a calibration file lists, see `fit_curve`.

    Keys: `file`; [reference] with `channels` (one, signed, or three whose size is the force) and `tare`; one [[sensor]]
    a sensor with `channel`, perhaps `interval` and its own `reference`; [columns] as in a session file.

    **Errors**: `FileError`, one line that names the file, the table and the key, or the channel that cannot be used.
    """
    path = Path(path)
    top = Table(path, "", read_toml(path))
    data = path.parent / top.text("file")
    columns = top.table("columns", None)
    common = top.table("reference", None)
    shared = None if common is None else _reference(common)
    if not data.is_file():
        raise FileError(path, f"key 'file' names {data}, which does not exist")
    motion = read_motion(data, {} if columns is None else columns.content)
    curves = [_curve(table, motion, shared) for table in top.tables("sensor")]
    top.close()
    if not curves:
        raise FileError(path, "needs at least one sensor, written [[sensor]]")
    names = [curve.channel for curve in curves]
    if len(set(names)) < len(names):
        raise FileError(path, "names a sensor twice")
    return tuple(curves)


def write_curves(path: str | os.PathLike, curves: tuple[Curve, ...], source: str) -> None:
    """Write a calibration file, complete or not at all. **Errors**: `FileError` when it cannot be written."""
    path = Path(path)
    temporary = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_text(curves_text(curves, f"written by icjax calibrate from {source}"), encoding="utf-8")
        temporary.replace(path)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def _reference(table: Table) -> Reference:
    reference = Reference(
        channels=table.texts("channels"),
        tare=table.take("tare", windows, "an interval [from, to] in s, or a list of them"),
    )
    if len(reference.channels) not in (1, 3):
        raise table.error(f"key 'channels' lists {len(reference.channels)} channels; it needs one or three")
    table.close()
    return reference


def _curve(table: Table, motion: MotionFile, shared: Reference | None) -> Curve:
    channel = table.text("channel")
    interval = table.take("interval", windows, "an interval [from, to] in s, or a list of them", None)
    own = table.table("reference", None)
    reference = shared if own is None else _reference(own)
    table.close()
    if reference is None:
        raise table.error("needs a reference: the table [reference], or a key 'reference' of its own")
    time = motion.analog_time
    values, voltage = motion.channels(reference.channels), motion.channels([channel])[:, 0]
    unloaded = _inside(time, reference.tare)
    if unloaded.sum() < 20:
        raise table.error(f"the tare of its reference holds {unloaded.sum()} samples; it needs 20")
    missing = unloaded & ~np.isfinite(values).all(axis=1)
    if missing.any():
        raise table.error(f"the tare of its reference holds no number at {time[missing][0]:g} s")
    values = values - values[unloaded].mean(axis=0)
    force = values[:, 0] if values.shape[1] == 1 else np.linalg.norm(values, axis=1)
    used = np.isfinite(voltage) & np.isfinite(force)
    if interval is not None:
        used &= _inside(time, interval) | unloaded
    noise = float(np.std(force[unloaded]))
    try:
        return fit_curve(channel, time[used], voltage[used], force[used], noise)
    except ValueError as error:
        raise table.error(str(error)) from error


def _inside(time: np.ndarray, intervals: tuple[tuple[float, float], ...]) -> np.ndarray:
    inside = np.zeros(len(time), bool)
    for start, stop in intervals:
        inside |= (time >= start) & (time <= stop)
    return inside
