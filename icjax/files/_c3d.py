"""C3D files (Vicon, Qualisys, Motion Analysis, BTS ...) through ezc3d."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from icjax.files._c3d_check import check_c3d
from icjax.files._errors import FileError
from icjax.files._motion import ForcePlate, MotionEvent, MotionFile, unique_labels
from icjax.files._units import analog_factor, length_factor

OUTPUT_GROUPS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")
"""Parameters of the group POINT that list points which are no positions."""

PLATE_CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6}
"""Channels of the force plate types that are used; others are read with the channels they list."""

LENGTHS = {1: (3, 4, 5), 2: (3, 4, 5)}
"""Channels that hold a length: centre of pressure (mm) and moments (Nmm); in POINT:UNITS where they state no unit."""

CALIBRATED = (4, 5, 6, 7)
"""Force plate types that need a calibration matrix."""


def read_c3d(path: str | os.PathLike) -> MotionFile:
    """Read a C3D file: markers in m (gaps NaN), analog channels in N, Nm and V, force plates and events.

    Times are (first frame + i) / rate with the first frame counted from zero, see `MotionFile`. Points that the
    recording software computed (listed in POINT:ANGLES, FORCES, MOMENTS, POWERS) are `outputs`, not markers.

    **Errors**: `FileError` naming the file, and the channel, plate or parameter, when the file is missing,
    truncated, damaged or no C3D, holds no frames, gives lengths in an unknown unit, or describes a plate without
    the corners, channels or calibration that its type needs. `ImportError` without ezc3d.

    **Source**: The C3D File Format User Guide, Motion Lab Systems.
    """
    path = Path(path)
    expected = check_c3d(path)
    c3d = _open(path)
    parameters = c3d["parameters"]
    points = c3d["data"]["points"]
    header = c3d["header"]["points"]
    rate = float(header["frame_rate"])
    frames = points.shape[2]
    if frames != expected:
        raise FileError(path, f"is damaged: {frames} of {expected} frames could be read")
    if not (np.isfinite(rate) and rate > 0):
        raise FileError(path, f"parameter POINT:RATE is {rate}, not a frame rate")
    notes: list[str] = []
    start = int(header["first_frame"]) / rate

    labels = _texts(parameters, "POINT", "LABELS")[: points.shape[1]]
    labels += [""] * (points.shape[1] - len(labels))
    names, found = unique_labels(labels, "marker")
    notes += found
    unit, factor = _length(path, parameters, notes)
    kinds = _output_kinds(parameters)
    positions = [index for index, name in enumerate(names) if name not in kinds]
    values = np.moveaxis(points[:3], (0, 1, 2), (2, 1, 0))
    missing = c3d["data"]["meta_points"]["residuals"][0].T < 0
    values = np.where(missing[:, :, None], np.nan, values)

    analog_names, units, analog_rate, analog, found = _analog(path, c3d)
    notes += found
    plates = _plates(path, parameters, units, factor)
    notes += _unstated_lengths(plates, units, analog, unit, factor)
    return MotionFile(
        path=os.fspath(path),
        marker_names=tuple(names[index] for index in positions),
        marker_rate=rate,
        marker_time=start + np.arange(frames) / rate,
        markers=np.ascontiguousarray(values[:, positions] * factor),
        marker_unit=unit,
        analog_names=analog_names,
        analog_units=units,
        analog_rate=analog_rate,
        analog_time=start + np.arange(len(analog)) / analog_rate if len(analog) else np.zeros(0),
        analog=analog,
        plates=plates,
        events=_events(path, parameters),
        outputs={name: values[:, index] for index, name in enumerate(names) if name in kinds},
        output_units={
            name: " ".join(_texts(parameters, "POINT", f"{kinds[name]}_UNITS")[:1]) for name in names if name in kinds
        },
        metadata=_metadata(parameters),
        notes=tuple(notes),
    )


def _open(path: Path) -> Any:
    try:
        import ezc3d
    except ImportError as error:
        raise ImportError('reading C3D files needs ezc3d: pip install "icjax[capture]"') from error
    try:
        return ezc3d.c3d(os.fspath(path))
    except Exception as error:  # ezc3d maps every C++ exception to its own Python type
        detail = str(error).strip().splitlines() or [type(error).__name__]
        raise FileError(path, f"cannot be read as C3D: {detail[0]}") from error


def _value(parameters: Any, group: str, name: str) -> Any:
    entry = parameters.get(group, {}).get(name)
    return None if entry is None else entry["value"]


def _texts(parameters: Any, group: str, name: str) -> list[str]:
    """A text parameter, with its continuations NAME2, NAME3 ... (C3D lists end at 255 entries)."""
    texts: list[str] = []
    suffix = 1
    while True:
        value = _value(parameters, group, name if suffix == 1 else f"{name}{suffix}")
        if value is None:
            return texts
        texts += [str(item).strip() for item in value]
        suffix += 1


def _numbers(parameters: Any, group: str, name: str) -> np.ndarray:
    value = _value(parameters, group, name)
    if value is None or (len(value) and isinstance(value, list)):
        return np.zeros(0)
    return np.asarray(value, dtype=float)


def _length(path: Path, parameters: Any, notes: list[str]) -> tuple[str, float]:
    found = _texts(parameters, "POINT", "UNITS")
    unit = found[0] if found else ""
    if not unit:
        notes.append("parameter POINT:UNITS is missing; lengths are taken as mm")
        return "mm", 1e-3
    factor = length_factor(unit)
    if factor is None:
        raise FileError(path, f"parameter POINT:UNITS is '{unit}', not a known unit of length")
    return unit, factor


def _output_kinds(parameters: Any) -> dict[str, str]:
    return {
        name: group.removesuffix("S") for group in OUTPUT_GROUPS for name in _texts(parameters, "POINT", group) if name
    }


def _analog(path: Path, c3d: Any) -> tuple[tuple[str, ...], tuple[str, ...], float, np.ndarray, list[str]]:
    analog = np.ascontiguousarray(c3d["data"]["analogs"][0].T).astype(float)
    rate = float(c3d["header"]["analogs"]["frame_rate"])
    count = analog.shape[1]
    if count == 0 or len(analog) == 0:
        return (), (), float("nan"), np.zeros((0, 0)), []
    if not (np.isfinite(rate) and rate > 0):
        raise FileError(path, f"parameter ANALOG:RATE gives {rate}, not a rate")
    parameters = c3d["parameters"]
    labels = (_texts(parameters, "ANALOG", "LABELS") + [""] * count)[:count]
    units = (_texts(parameters, "ANALOG", "UNITS") + [""] * count)[:count]
    names, found = unique_labels(labels, "analog")
    notes = list(found)
    for index, unit in enumerate(units):
        factor = analog_factor(unit)
        if factor is None:
            told = f"the unit '{unit}'" if unit else "no unit"
            notes.append(f"analog channel '{names[index]}' has {told}; its values are as found")
        else:
            analog[:, index] *= factor
    return names, tuple(units), rate, analog, notes


def _plates(path: Path, parameters: Any, units: tuple[str, ...], factor: float) -> tuple[ForcePlate, ...]:
    used = _numbers(parameters, "FORCE_PLATFORM", "USED")
    count = int(used[0]) if used.size else 0
    return tuple(_plate(path, parameters, index, count, units, factor) for index in range(count))


def _plate(path: Path, parameters: Any, index: int, count: int, units: tuple[str, ...], factor: float) -> ForcePlate:
    def entry(name: str, rows: tuple[int, ...]) -> np.ndarray:
        value = _numbers(parameters, "FORCE_PLATFORM", name)
        size = int(np.prod(rows))
        if value.size < size * count:
            raise FileError(path, f"force plate {index + 1} has no {name} (parameter FORCE_PLATFORM:{name})")
        return value.reshape(-1, order="F")[size * index : size * (index + 1)].reshape(rows, order="F")

    kind = int(entry("TYPE", (1,))[0])
    corners = entry("CORNERS", (3, 4)).T * factor
    if not np.all(np.isfinite(corners)) or np.allclose(corners, corners[0]):
        raise FileError(path, f"force plate {index + 1} has no extent: its four corners coincide")
    if not np.linalg.norm(np.cross(corners[0] - corners[1], corners[0] - corners[3])) > 0:
        raise FileError(path, f"force plate {index + 1} has no extent: its corners lie on one line")
    stored = _numbers(parameters, "FORCE_PLATFORM", "CHANNEL")
    per_plate = stored.shape[0] if stored.ndim == 2 else stored.size // count
    needed = PLATE_CHANNELS.get(kind, per_plate)
    if per_plate < needed:
        raise FileError(path, f"force plate {index + 1} of type {kind} needs {needed} channels, has {per_plate}")
    numbers = entry("CHANNEL", (per_plate,)).astype(int)[:needed]
    for number in numbers:
        if not 1 <= number <= len(units):
            raise FileError(path, f"force plate {index + 1} refers to analog channel {number} of {len(units)}")
    calibration = None
    if kind in CALIBRATED:
        calibration = _calibration(path, parameters, index, count)
        if kind == 4:
            channel_factors = np.array([analog_factor(units[number - 1]) or 1.0 for number in numbers])
            calibration = calibration * np.array([1.0] * 3 + [factor] * 3)[:, None] / channel_factors[None, :]
    return ForcePlate(
        type=kind,
        corners=corners,
        origin=entry("ORIGIN", (3,)) * factor,
        channels=tuple(int(number) - 1 for number in numbers),
        calibration=calibration,
    )


def _unstated_lengths(
    plates: tuple[ForcePlate, ...], units: tuple[str, ...], analog: np.ndarray, unit: str, factor: float
) -> list[str]:
    """Convert, in place, plate channels that hold a length but state no unit: the manual has them in POINT:UNITS."""
    notes = []
    for number, plate in enumerate(plates, 1):
        unstated = [plate.channels[i] for i in LENGTHS.get(plate.type, ()) if not units[plate.channels[i]]]
        if unstated:
            analog[:, unstated] *= factor
            told = f"force plate {number} of type {plate.type}: lengths in its channels state no unit"
            notes.append(f"{told} and are taken as {unit}")
    return notes


def _calibration(path: Path, parameters: Any, index: int, count: int) -> np.ndarray:
    matrix = _numbers(parameters, "FORCE_PLATFORM", "CAL_MATRIX")
    rows, columns = matrix.shape[:2] if matrix.ndim >= 2 else (0, 0)
    kind_number = int(_numbers(parameters, "FORCE_PLATFORM", "TYPE")[index])
    kind = f"force plate {index + 1} of type {kind_number}"
    if rows < 6 or columns < 6 or matrix.size < rows * columns * count:
        raise FileError(path, f"{kind} has no calibration (parameter FORCE_PLATFORM:CAL_MATRIX)")
    found = matrix.reshape(rows, columns, -1, order="F")[:, :, index]
    if not np.all(np.isfinite(found)) or not np.any(found):
        raise FileError(path, f"{kind} has a calibration matrix of zeros (parameter FORCE_PLATFORM:CAL_MATRIX)")
    return found[:6, :6] if kind_number == 4 else found


def _events(path: Path, parameters: Any) -> tuple[MotionEvent, ...]:
    used = _numbers(parameters, "EVENT", "USED")
    count = int(used[0]) if used.size else 0
    times = _numbers(parameters, "EVENT", "TIMES").reshape(-1, order="F")
    if times.size < 2 * count:
        raise FileError(path, f"states {count} events but stores {times.size // 2} times (parameter EVENT:TIMES)")
    labels = _texts(parameters, "EVENT", "LABELS") + [""] * count
    contexts = _texts(parameters, "EVENT", "CONTEXTS") + [""] * count
    events = [
        MotionEvent(labels[index], contexts[index], float(60.0 * times[2 * index] + times[2 * index + 1]))
        for index in range(count)
    ]
    return tuple(sorted(events, key=lambda event: event.time))


def _metadata(parameters: Any) -> dict[str, Any]:
    metadata = {}
    for group, entries in parameters.items():
        for name, entry in entries.items():
            if not name.startswith("_") and name not in ("LABELS", "DESCRIPTIONS"):
                value = entry["value"]
                value = value.tolist() if isinstance(value, np.ndarray) else list(value)
                metadata[f"{group}:{name}"] = value[0] if len(value) == 1 else value
    return metadata
