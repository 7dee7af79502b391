"""CSV files with a column map."""

import csv
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from icjax.files._errors import FileError
from icjax.files._motion import MotionFile, unique_labels
from icjax.files._table import check_time, is_number, number_rows, rate_of, read_lines, spacing_notes
from icjax.files._units import analog_factor, length_factor

KEYS = ("time", "markers", "length_unit", "channels", "units")


def read_csv(path: str | os.PathLike, columns: Mapping[str, Any] | None = None) -> MotionFile:
    """Read markers and channels from a text table with one line of column names.

    **Arguments**

    - `path`: the file; columns are separated by commas, semicolons or tabs.
    - `columns`: what the columns mean, each entry optional:

        - `time`: name of the time column (s); default the first column.
        - `markers`: marker to its three columns, `{"FA1": ["FA1_x", "FA1_y", "FA1_z"]}`; default every
          `NAME_x`, `NAME_y`, `NAME_z` in the file.
        - `length_unit`: of the markers, default "mm".
        - `channels`: channel to its column, `{"Fx": "Force X (N)"}`; default every other column, by its name.
        - `units`: channel to its unit, `{"Tx": "Nmm"}`; a channel without one keeps its values, with a note.

    Markers and channels share the one time column. Empty cells and `nan` are NaN.

    **Errors**: `FileError` naming the file, and the line or column, when it is missing, lacks a column, a row has
    the wrong number of columns or holds no number, or time does not increase; `ValueError` for an unknown entry
    of `columns`.
    """
    path = Path(path)
    columns = dict(columns or {})
    for key in columns:
        if key not in KEYS:
            raise ValueError(f"columns has the unknown entry '{key}' (known: {', '.join(KEYS)})")
    lines = read_lines(path)
    first = next(index for index, line in enumerate(lines) if line.strip())
    separator = max(",;\t", key=lines[first].count)
    header = [cell.strip() for cell in next(csv.reader([lines[first]], delimiter=separator))]
    table = number_rows(path, list(enumerate(lines[first + 1 :], first + 2)), separator, len(header))

    twice = sorted({name for name in header if name and header.count(name) > 1})
    if twice:
        raise FileError(path, f"has the column '{twice[0]}' twice")
    if any(is_number(name) for name in header):
        raise FileError(path, f"line {first + 1} must name the columns, it holds numbers")

    def column(name: str) -> np.ndarray:
        if name not in header:
            raise FileError(path, f"has no column '{name}' (it has {', '.join(header[:12])} ...)")
        return table[:, header.index(name)]

    time_name = columns.get("time", header[0])
    time = column(time_name)
    check_time(path, time)
    marker_columns = columns.get("markers")
    if marker_columns is None:
        marker_columns = _triples(header)
    for name, triple in marker_columns.items():
        if isinstance(triple, str) or len(triple) != 3:
            raise ValueError(f"columns.markers.{name} must list three columns, not {triple!r}")
    unit = columns.get("length_unit", "mm")
    factor = length_factor(unit)
    if factor is None:
        raise ValueError(f"columns.length_unit is the unknown unit '{unit}'")
    used = {time_name, *(name for triple in marker_columns.values() for name in triple)}
    channels = columns.get("channels")
    if channels is None:
        channels = {name: name for name in header if name and name not in used}
    names, notes = unique_labels(list(channels), "channel")
    units = tuple(str(columns.get("units", {}).get(name, "")) for name in channels)
    values = np.stack([column(name) for name in channels.values()], axis=1) if channels else np.zeros((0, 0))
    for index, (name, spelled) in enumerate(zip(names, units, strict=True)):
        scale = analog_factor(spelled)
        if scale is None:
            unit = f"the unit '{spelled}'" if spelled else "no unit"
            notes += (f"channel '{name}' has {unit}; its values are as found",)
        else:
            values[:, index] *= scale
    rate = rate_of(time)
    markers = [np.stack([column(name) for name in triple], axis=1) for triple in marker_columns.values()]
    return MotionFile(
        path=os.fspath(path),
        marker_names=tuple(marker_columns),
        marker_rate=rate if markers else float("nan"),
        marker_time=time if markers else np.zeros(0),
        markers=np.stack(markers, axis=1) * factor if markers else np.zeros((0, 0, 3)),
        marker_unit=unit if markers else "",
        analog_names=names,
        analog_units=units,
        analog_rate=rate if channels else float("nan"),
        analog_time=time if channels else np.zeros(0),
        analog=values,
        metadata={"columns": tuple(header)},
        notes=notes + spacing_notes(time),
    )


def _triples(header: list[str]) -> dict[str, list[str]]:
    found = {}
    for name in header:
        if name.endswith("_x"):
            triple = [name[:-1] + axis for axis in "xyz"]
            if all(item in header for item in triple):
                found[name[:-2]] = triple
    return found
