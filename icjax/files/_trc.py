"""TRC marker files (Motion Analysis, OpenSim)."""

import math
import os
from pathlib import Path

import numpy as np

from icjax.files._errors import FileError
from icjax.files._motion import MotionFile, unique_labels
from icjax.files._table import check_time, number_rows, rate_of, read_lines, spacing_notes
from icjax.files._units import length_factor

RATE_TOLERANCE = 0.02
"""The rate stated in the header may differ by this fraction from the one that the times show."""


def read_trc(path: str | os.PathLike) -> MotionFile:
    """Read a TRC file: markers in m, gaps (empty or NaN cells) NaN, times as in the file.

    **Errors**: `FileError` naming the file and line when it is missing, truncated or no TRC, a row has the wrong
    number of columns or holds no number, or time does not increase.
    """
    path = Path(path)
    lines = read_lines(path)
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise FileError(path, "is not a TRC file (its first line does not begin with 'PathFileType')")
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    stated_rate = _number(path, header, "DataRate")
    if not stated_rate > 0:
        raise FileError(path, f"line 3 states no valid DataRate: {stated_rate:g}")
    stated_frames, stated_markers = (_number(path, header, key) for key in ("NumFrames", "NumMarkers"))
    labels = [label for label in lines[3].split("\t")[2:] if label.strip()]
    if len(labels) != stated_markers:
        raise FileError(path, f"names {len(labels)} markers but states NumMarkers {stated_markers:g}")
    unit = header.get("Units", "")
    factor = length_factor(unit)
    if factor is None:
        raise FileError(path, f"states lengths in the unknown unit '{unit}'")
    table = number_rows(path, list(enumerate(lines[5:], 6)), "\t", 2 + 3 * len(labels))
    if len(table) < stated_frames:
        raise FileError(path, f"holds {len(table)} of {stated_frames:.12g} frames: truncated")
    time = table[:, 1]
    check_time(path, time)
    names, notes = unique_labels(labels, "marker")
    rate = rate_of(time)
    if not np.isfinite(rate):
        rate = stated_rate
    elif abs(rate - stated_rate) > RATE_TOLERANCE * stated_rate:
        notes += (f"the header states {stated_rate:g} Hz, the times show {rate:g} Hz; the times are used",)
    else:
        rate = stated_rate
    return MotionFile(
        path=os.fspath(path),
        marker_names=names,
        marker_rate=rate,
        marker_time=time,
        markers=table[:, 2:].reshape(len(table), len(names), 3) * factor,
        marker_unit=unit,
        metadata=dict(header),
        notes=notes + spacing_notes(time),
    )


def _number(path: Path, header: dict[str, str], key: str) -> float:
    try:
        number = float(header[key])
    except (KeyError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise FileError(path, f"line 3 states no valid {key}")
    return number
