"""TSV files of Qualisys Track Manager: markers with a header of keys."""

import os
import re
from pathlib import Path

import numpy as np

from icjax.files._errors import FileError
from icjax.files._motion import MotionEvent, MotionFile, unique_labels
from icjax.files._table import check_time, number_rows, rate_of, read_lines, spacing_notes

FIRST_KEY = "NO_OF_FRAMES"
LENGTH = 1e-3
"""Qualisys exports mm."""

RATE_TOLERANCE = 0.02
"""FREQUENCY may differ by this fraction from the rate that a Time column shows."""

Cells = dict[str, list[str]]


def is_qualisys(path: str | os.PathLike) -> bool:
    """Whether the first line of a file is that of a Qualisys TSV. False for a file that cannot be opened."""
    try:
        with open(path, "rb") as file:
            return file.read(64).removeprefix(b"\xef\xbb\xbf").split(b"\t")[0] == FIRST_KEY.encode()
    except OSError:
        return False


def read_tsv(path: str | os.PathLike) -> MotionFile:
    """Read a Qualisys TSV: markers in m; a marker with an empty or NaN cell, or at exactly 0 0 0, is a gap (NaN).

    Column names, Frame and Time are optional, as in the export dialogue. Times are those of the Time column, else
    (Frame - 1) / FREQUENCY, else row / FREQUENCY from zero. `metadata` holds the header; TIME_STAMP is the tuple
    (date and time, seconds of the computer's counter) where the file gives both. EVENT lines become events.

    **Errors**: `FileError` naming the file and line when it is missing, truncated or no Qualisys TSV, holds something
    else than 3-D markers, a row has the wrong number of columns or holds no number, or time does not increase.
    """
    path = Path(path)
    lines = read_lines(path)
    if lines[0].split("\t")[0].strip() != FIRST_KEY:
        raise FileError(path, f"is not a Qualisys TSV file (its first line does not begin with '{FIRST_KEY}')")
    header, events, columns, body = _header(path, lines)
    included = header.get("DATA_INCLUDED", ["3D"])[:1]
    if included != ["3D"]:
        raise FileError(path, f"holds '{' '.join(included)}' data; only 3D markers are read (export as 3D)")
    frames, markers = (_count(path, header, key) for key in (FIRST_KEY, "NO_OF_MARKERS"))
    frequency = _frequency(path, header)
    labels = header.get("MARKER_NAMES", [])
    if len(labels) != markers:
        raise FileError(path, f"names {len(labels)} markers (MARKER_NAMES) but states NO_OF_MARKERS {markers}")
    rows = [(number, text) for number, text in enumerate(lines[body:], body + 1) if text.strip()]
    columns = _columns(path, columns, rows, labels)
    table = number_rows(path, rows, "\t", len(columns))
    if len(table) < frames:
        raise FileError(path, f"holds {len(table)} of {frames} frames: truncated")
    names, notes = unique_labels(labels, "marker")
    if len(table) > frames:
        notes += (f"the header states {frames} frames, the file holds {len(table)}",)
    time = _time(columns, table, frequency)
    check_time(path, time)
    rate = rate_of(time)
    if not np.isfinite(rate) or abs(rate - frequency) <= RATE_TOLERANCE * frequency:
        rate = frequency
    else:
        notes += (f"the header states {frequency:g} Hz, the times show {rate:g} Hz; the times are used",)
    values = table[:, len(columns) - 3 * markers :].reshape(len(table), markers, 3)
    gap = ~np.isfinite(values).all(axis=2) | (values == 0.0).all(axis=2)
    return MotionFile(
        path=os.fspath(path),
        marker_names=names,
        marker_rate=rate,
        marker_time=time,
        markers=np.where(gap[:, :, None], np.nan, values * LENGTH),
        marker_unit="mm",
        events=events,
        metadata={key: cells[0] if len(cells) == 1 else tuple(cells) for key, cells in header.items()},
        notes=notes + spacing_notes(time),
    )


def _header(path: Path, lines: list[str]) -> tuple[Cells, tuple[MotionEvent, ...], list[str], int]:
    """Keys with their cells, events, column names (empty if there are none) and the first line of numbers."""
    header: Cells = {}
    events = []
    for index, line in enumerate(lines):
        key, *cells = [cell.strip() for cell in line.split("\t")]
        while cells and not cells[-1]:
            cells.pop()
        if key == "EVENT":
            events.append(_event(path, index + 1, cells))
        elif re.fullmatch(r"[A-Z][A-Z_]{3,}", key):
            header[key] = cells
        elif not line.strip():
            continue
        elif re.match(r"[-+.\d]", key) or key.lower() == "nan" or not key:
            return header, tuple(events), [], index
        else:
            return header, tuple(events), [key, *cells], index + 1
    return header, tuple(events), [], len(lines)


def _event(path: Path, line: int, cells: list[str]) -> MotionEvent:
    try:
        label, _, time = cells
        value = float(time)
    except ValueError:
        raise FileError(path, f"line {line}: an EVENT needs a name, a frame and a time") from None
    if not np.isfinite(value):
        raise FileError(path, f"line {line}: the time of an EVENT is {time}")
    return MotionEvent(label, "", value)


def _count(path: Path, header: Cells, key: str) -> int:
    cells = header.get(key, [])
    if len(cells) != 1 or not re.fullmatch(r"\d{1,9}", cells[0]):
        raise FileError(path, f"states no valid {key}: '{' '.join(cells)}'")
    return int(cells[0])


def _frequency(path: Path, header: Cells) -> float:
    cells = header.get("FREQUENCY", [])
    try:
        (frequency,) = (float(cell) for cell in cells)
    except ValueError:
        frequency = 0.0
    if not (np.isfinite(frequency) and frequency > 0):
        raise FileError(path, f"states no valid FREQUENCY: '{' '.join(cells)}'")
    return frequency


def _columns(path: Path, stated: list[str], rows: list[tuple[int, str]], labels: list[str]) -> list[str]:
    """Names of the columns, checked against the markers; without a line of names Frame and Time come together."""
    wanted = [f"{label} {axis}" for label in labels for axis in "XYZ"]
    lead = [name for name in stated[:2] if name in ("Frame", "Time")]
    if stated and stated[len(lead) :] != wanted:
        found = stated[len(lead) :]
        place = next((i for i in range(min(len(found), len(wanted))) if found[i] != wanted[i]), None)
        if place is None:
            raise FileError(path, f"names {len(found)} coordinate columns for {len(labels)} markers")
        raise FileError(path, f"has the column '{found[place]}' where MARKER_NAMES asks for '{wanted[place]}'")
    if not stated and rows and len(rows[0][1].rstrip("\t").split("\t")) > len(wanted):
        lead = ["Frame", "Time"]
    return lead + wanted


def _time(columns: list[str], table: np.ndarray, frequency: float) -> np.ndarray:
    if "Time" in columns[:2]:
        return table[:, columns.index("Time")]
    if columns[:1] == ["Frame"]:
        return (table[:, 0] - 1.0) / frequency
    return np.arange(len(table)) / frequency
