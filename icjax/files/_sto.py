"""OpenSim storage files: STO and MOT."""

import os
import re
from pathlib import Path

from icjax.files._errors import FileError
from icjax.files._motion import MotionFile, no_markers, unique_labels
from icjax.files._table import check_time, number_rows, rate_of, read_lines, spacing_notes

ROW_KEYS = ("nRows", "datarows")
COLUMN_KEYS = ("nColumns", "datacolumns")


def read_sto(path: str | os.PathLike) -> MotionFile:
    """Read a STO or MOT file: every column but time is an analog channel, its values as in the file.

    Units follow OpenSim's names for ground reaction files (`..._vx` N, `..._px` m, `...torque_x` Nm, also the
    short `f1_1`, `m1_1`, `p1_1` without a unit); other columns have the unit "". `metadata["inDegrees"]` is True
    or False as the header says (or by its sentence "Angles are in degrees"), None where it says nothing; angles
    are **not** converted, because the file does not say which of its columns are angles.

    **Errors**: `FileError` naming the file and line when it is missing, truncated or has no header, a row has
    the wrong number of columns or holds no number, or time does not increase.
    """
    path = Path(path)
    lines = read_lines(path)
    end = next((index for index, line in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if end is None or end + 1 >= len(lines):
        raise FileError(path, "is not a STO or MOT file (it has no line 'endheader' followed by column names)")
    metadata = _header(lines[:end])
    body = end + 1
    while body < len(lines) and not lines[body].strip():
        body += 1
    if body == len(lines):
        raise FileError(path, "has no column names after 'endheader'")
    columns = lines[body].split()
    if columns[0].lower() != "time":
        raise FileError(path, f"line {body + 1}: the first column is '{columns[0]}', expected 'time'")
    stated = _stated(path, metadata, COLUMN_KEYS)
    table = number_rows(path, list(enumerate(lines[body + 1 :], body + 2)), None, len(columns))
    rows = _stated(path, metadata, ROW_KEYS)
    if rows is not None and len(table) < rows:
        raise FileError(path, f"holds {len(table)} of {rows} rows: truncated")
    time = table[:, 0]
    check_time(path, time)
    names, notes = unique_labels(columns[1:], "column")
    if stated is not None and stated != len(columns):
        notes += (f"the header states {stated} columns, the file names and holds {len(columns)}",)
    marker_names, marker_rate, marker_time, markers, marker_unit = no_markers()
    return MotionFile(
        path=os.fspath(path),
        marker_names=marker_names,
        marker_rate=marker_rate,
        marker_time=marker_time,
        markers=markers,
        marker_unit=marker_unit,
        analog_names=names,
        analog_units=tuple(_unit(name) for name in names),
        analog_rate=rate_of(time),
        analog_time=time,
        analog=table[:, 1:],
        metadata=metadata,
        notes=notes + spacing_notes(time),
    )


def _header(lines: list[str]) -> dict[str, object]:
    metadata: dict[str, object] = {"inDegrees": None}
    for line in lines:
        match = re.fullmatch(r"\s*(\w+)\s*=\s*(.*?)\s*", line) or re.fullmatch(
            r"\s*(name|datarows|datacolumns|range)\s+(.*?)\s*", line
        )
        if match:
            metadata[match[1]] = match[2]
        elif "angles are in degrees" in line.lower():
            metadata["inDegrees"] = True
    if isinstance(metadata["inDegrees"], str):
        metadata["inDegrees"] = metadata["inDegrees"].lower() in ("yes", "true", "1")
    return metadata


def _stated(path: Path, metadata: dict[str, object], keys: tuple[str, ...]) -> int | None:
    for key in keys:
        if key in metadata:
            try:
                return int(str(metadata[key]))
            except ValueError:
                raise FileError(path, f"the header states {key} = '{metadata[key]}', not a number") from None
    return None


def _unit(name: str) -> str:
    if re.search(r"(torque|moment)_?\w?$", name):
        return "Nm"
    if re.search(r"_v[xyz]$", name):
        return "N"
    if re.search(r"_p[xyz]$", name):
        return "m"
    return ""
