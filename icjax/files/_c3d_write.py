"""Write C3D files as a studio would."""

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from icjax.files._errors import FileError
from icjax.files._motion import ForcePlate, MotionEvent
from icjax.files._units import analog_factor, length_factor


def write_c3d(
    path: str | os.PathLike,
    *,
    marker_names: Sequence[str],
    markers: Float[np.ndarray, "frame marker 3"],
    marker_rate: float,
    analog_names: Sequence[str] = (),
    analog_units: Sequence[str] = (),
    analog: Float[np.ndarray, "sample channel"] | None = None,
    analog_rate: float | None = None,
    plates: Sequence[ForcePlate] = (),
    events: Sequence[MotionEvent | tuple[str, str, float]] = (),
    first_frame: int = 0,
    unit: str = "mm",
) -> Path:
    """Write markers, analog channels, force plates and events as C3D, complete or not at all.

    Numbers are stored as 32-bit floats. A marker with a NaN coordinate is written as 0 0 0 with residual -1.

    **Arguments**

    - `markers` [F, M, 3]: m; NaN where missing. `marker_rate`: Hz.
    - `analog` [S, C]: SI; stored in `analog_units`, for example "N", "Nmm", "V". S must be F times a whole number,
      the ratio of `analog_rate` to `marker_rate`.
    - `plates`: with `channels` counted from zero.
    - `events`: (label, context, time in s on the axis of `MotionFile`).
    - `first_frame`: counted from zero.
    - `unit`: of length in the file.

    **Returns** the path. **Errors**: `ValueError` naming the argument; `FileError` if it cannot be written.
    """
    path = Path(path)
    factor = length_factor(unit)
    if factor is None:
        raise ValueError(f"unit must be a unit of length, not '{unit}'")
    if len(marker_names) != markers.shape[1]:
        raise ValueError(f"marker_names has {len(marker_names)} names for {markers.shape[1]} markers")
    c3d = _empty()
    parameters = c3d["parameters"]
    missing = np.asarray(np.any(np.isnan(markers), axis=2))
    points = np.ones((4, markers.shape[1], markers.shape[0]))
    points[:3] = np.moveaxis(np.where(missing[:, :, None], 0.0, markers / factor), (0, 1, 2), (2, 1, 0))
    c3d["data"]["points"] = points
    c3d["data"]["meta_points"]["residuals"] = np.where(missing, -1.0, 0.0).T[None]
    c3d["data"]["meta_points"]["camera_masks"] = np.zeros((7, markers.shape[1], markers.shape[0]), dtype=bool)
    c3d["header"]["points"]["first_frame"] = first_frame
    parameters["POINT"]["RATE"]["value"] = [float(marker_rate)]
    parameters["POINT"]["LABELS"]["value"] = list(marker_names)
    parameters["POINT"]["DESCRIPTIONS"]["value"] = [""] * len(marker_names)
    parameters["POINT"]["UNITS"]["value"] = [unit]
    if analog is not None:
        _set_analog(c3d, analog, analog_names, analog_units, analog_rate, len(markers), marker_rate)
    if plates:
        _set_plates(parameters, plates, factor, analog_units)
    if events:
        _set_events(parameters, events)
    _write(path, c3d)
    return path


def _empty() -> Any:
    try:
        import ezc3d
    except ImportError as error:
        raise ImportError('writing C3D files needs ezc3d: pip install "icjax[capture]"') from error
    return ezc3d.c3d()


def _set_analog(
    c3d: Any,
    analog: np.ndarray,
    names: Sequence[str],
    units: Sequence[str],
    rate: float | None,
    frames: int,
    marker_rate: float,
) -> None:
    if not len(names) == len(units) == analog.shape[1]:
        raise ValueError(
            f"analog_names, analog_units and analog disagree: {len(names)}, {len(units)}, {analog.shape[1]}"
        )
    ratio = round((rate or 0.0) / marker_rate)
    if ratio < 1 or abs(ratio * marker_rate - (rate or 0.0)) > 1e-9 * marker_rate or len(analog) != ratio * frames:
        raise ValueError(
            f"analog_rate {rate} and {len(analog)} samples are no whole multiple of marker_rate {marker_rate} "
            f"and {frames} frames"
        )
    factors = [analog_factor(name) for name in units]
    for name, factor in zip(units, factors, strict=True):
        if factor is None:
            raise ValueError(f"analog_units has the unknown unit '{name}'")
    c3d["data"]["analogs"] = (analog / np.asarray(factors, dtype=float)[None]).T[None]
    group = c3d["parameters"]["ANALOG"]
    group["RATE"]["value"] = [float(rate or 0.0)]
    group["LABELS"]["value"] = list(names)
    group["DESCRIPTIONS"]["value"] = [""] * len(names)
    group["UNITS"]["value"] = list(units)
    group["SCALE"]["value"] = np.ones(len(names))
    group["OFFSET"]["value"] = np.zeros(len(names), dtype=int)
    group["GEN_SCALE"]["value"] = [1.0]


def _integers(values: Any) -> dict[str, Any]:
    """ezc3d stores integers only when told the type (2) in full."""
    return {"type": 2, "description": "", "is_locked": False, "value": np.asarray(values, dtype=int)}


def _floats(values: Any) -> dict[str, Any]:
    return {"type": 4, "description": "", "is_locked": False, "value": np.asarray(values, dtype=float)}


def _text(values: Sequence[str]) -> dict[str, Any]:
    return {"type": -1, "description": "", "is_locked": False, "value": list(values)}


def _set_plates(parameters: Any, plates: Sequence[ForcePlate], factor: float, units: Sequence[str]) -> None:
    group = parameters["FORCE_PLATFORM"]
    group["USED"] = _integers([len(plates)])
    group["TYPE"] = _integers([plate.type for plate in plates])
    group["ZERO"] = _integers([1, 0])
    group["CORNERS"] = _floats(np.stack([plate.corners.T / factor for plate in plates], axis=2))
    group["ORIGIN"] = _floats(np.stack([plate.origin / factor for plate in plates], axis=1))
    channels = np.zeros((max(len(plate.channels) for plate in plates), len(plates)), dtype=int)
    for index, plate in enumerate(plates):
        channels[: len(plate.channels), index] = np.array(plate.channels) + 1
    group["CHANNEL"] = _integers(channels)
    if any(plate.calibration is not None for plate in plates):
        to_file = np.array([1.0] * 3 + [1.0 / factor] * 3)[:, None]
        matrices = []
        for plate in plates:
            matrix = np.zeros((6, 6))
            if plate.calibration is not None:
                channel_factors = [analog_factor(units[channel]) or 1.0 for channel in plate.channels]
                matrix = plate.calibration * to_file * np.array(channel_factors)[None, :]
            matrices.append(matrix)
        group["CAL_MATRIX"] = _floats(np.stack(matrices, axis=2))


def _set_events(parameters: Any, events: Sequence[MotionEvent | tuple[str, str, float]]) -> None:
    times = np.array([[time // 60.0, time % 60.0] for _, _, time in events]).T
    parameters["EVENT"] = {
        "__METADATA__": {"DESCRIPTION": "", "IS_LOCKED": False},
        "USED": _integers([len(events)]),
        "CONTEXTS": _text([context for _, context, _ in events]),
        "LABELS": _text([label for label, _, _ in events]),
        "DESCRIPTIONS": _text([""] * len(events)),
        "SUBJECTS": _text([""] * len(events)),
        "ICON_IDS": _integers([0] * len(events)),
        "GENERIC_FLAGS": _integers([0] * len(events)),
        "TIMES": _floats(times),
    }


def _write(path: Path, c3d: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".c3d", dir=path.parent)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error}") from error
    os.close(handle)
    try:
        c3d.write(temporary)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except (OSError, RuntimeError) as error:
        raise FileError(path, f"cannot be written: {error}") from error
    finally:
        Path(temporary).unlink(missing_ok=True)
