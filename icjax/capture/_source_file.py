"""The tables of a session file that describe force sources, and the cell maps that they name."""

import csv
from pathlib import Path
from typing import Any

from icjax.capture._spec import CellSpec, SourceSpec, SurfaceSpec, TopSpec
from icjax.files import FileError, Table, as_numbers, as_rotation, read_toml

CHANNELS = {"six_axis": 6, "force_plate": 0, "force_at_point": 9, "normal": 1, "pressure_array": 0}
"""Kinds of source and the number of channels that each one names."""

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

CELL_COLUMNS = ("channel", "x", "y", "z", "nx", "ny", "nz")
"""Columns of a CSV map of cells; a further one, `area`, is optional."""


def read_source(table: Table) -> SourceSpec:
    """One [[source]] of a session file. **Errors**: `FileError` naming table and key."""
    name = table.label("name")
    kind = table.choice("kind", CHANNELS)
    plate = table.whole("plate", least=1) if kind == "force_plate" else None
    cells: tuple[CellSpec, ...] = ()
    channels: tuple[str, ...] = ()
    frame = "world"
    if kind == "pressure_array":
        frame = table.choice("frame", ["body", "world"])
        cells = cell_map(table.path.parent / table.text("cells"))
        channels = tuple(cell.channel for cell in cells)
    elif kind != "force_plate":
        channels = table.texts("channels")
        if len(channels) != CHANNELS[kind]:
            raise table.error(f"key 'channels' lists {len(channels)} channels; kind '{kind}' needs {CHANNELS[kind]}")
        for channel in channels:
            if channels.count(channel) > 1:
                raise table.error(f"key 'channels' lists '{channel}' twice")
    if kind == "normal":
        frame = table.choice("frame", ["body", "world"], "body")
        direction = unit(table, table.vector("normal"))
        area = table.number("area", 1.0, above=0.0)
        point = table.vector("point", None)
        cells = tuple(CellSpec(channel, point, direction, area) for channel in channels)
    surface = None if kind == "normal" else table.table("surface", None)
    rotation = IDENTITY
    position = (0.0, 0.0, 0.0)
    sign = "on_subject"
    if kind == "six_axis":
        position = table.vector("position")
        sign = table.choice("sign", ["on_environment", "on_subject"])
    elif kind in ("force_plate", "force_at_point"):
        sign = table.choice("sign", ["on_environment", "on_subject"], sign)
    if kind in ("six_axis", "force_at_point"):
        rotation = table.take("rotation", as_rotation, "three rows of a rotation matrix", IDENTITY)
    top = table.table("top", None) if kind == "six_axis" else None
    spec = SourceSpec(
        name=name,
        kind=kind,
        channels=channels,
        plate=plate,
        position=position,
        rotation=rotation,
        sign=sign,
        surface=None if surface is None else _surface(surface),
        tare=table.take("tare", windows, "an interval [from, to] in s, or a list of them", ()),
        top=None if top is None else _top(top),
        cells=cells,
        frame=frame,
        calibration=_calibration(table) if cells else None,
    )
    table.close()
    return spec


def _calibration(table: Table) -> Path | None:
    name = table.text("calibration", None)
    if name is None:
        return None
    path = table.path.parent / name
    if not path.is_file():
        raise table.error(f"key 'calibration' names {path}, which does not exist")
    return path


def _surface(table: Table) -> SurfaceSpec:
    point, normal = table.vector("point"), unit(table, table.vector("normal"))
    table.close()
    return SurfaceSpec(point=point, normal=normal)


def unit(table: Table, normal: tuple[float, float, float]) -> tuple[float, float, float]:
    """A direction of length one. **Errors**: `FileError` when it is zero."""
    length = sum(value * value for value in normal) ** 0.5
    if not length > 0:
        raise table.error("key 'normal' must not be zero")
    return normal[0] / length, normal[1] / length, normal[2] / length


def _top(table: Table) -> TopSpec:
    top = TopSpec(
        mass=table.number("mass", above=0.0),
        markers=table.texts("markers", ()),
        accelerometer=table.texts("accelerometer", ()),
        com=table.vector("com", None),
        cutoff=table.number("cutoff", 60.0, above=0.0),
    )
    if top.markers and top.accelerometer:
        raise table.error("needs at most one of the keys 'markers' and 'accelerometer'")
    if not top.markers and len(top.accelerometer) not in (0, 3):
        raise table.error(f"key 'accelerometer' lists {len(top.accelerometer)} channels; it needs 3")
    if not top.markers and not top.accelerometer:
        raise table.error("needs the key 'markers' or the key 'accelerometer': how it moves is not known otherwise")
    table.close()
    return top


def cell_map(path: Path) -> tuple[CellSpec, ...]:
    """Cells of a pressure array from a TOML file ([[cell]] tables) or a CSV file with the columns `CELL_COLUMNS`."""
    if path.suffix.lower() == ".toml":
        top = Table(path, "", read_toml(path))
        tables = top.tables("cell")
        top.close()
    else:
        tables = [Table(path, f"line {line}:", row) for line, row in _csv_rows(path)]
    cells = []
    for table in tables:
        cells.append(
            CellSpec(
                table.text("channel"),
                table.vector("position"),
                unit(table, table.vector("normal")),
                table.number("area", 1.0, above=0.0),
            )
        )
        table.close()
    if not cells:
        raise FileError(path, "names no cell")
    names = [cell.channel for cell in cells]
    for name in names:
        if names.count(name) > 1:
            raise FileError(path, f"channel '{name}' is named twice")
    return tuple(cells)


def _csv_rows(path: Path) -> list[tuple[int, dict[str, Any]]]:
    if not path.is_file():
        raise FileError(path, "does not exist")
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        columns = [item.strip() for item in reader.fieldnames or ()]
        for name in CELL_COLUMNS:
            if name not in columns:
                raise FileError(path, f"has no column '{name}'; a map of cells has {', '.join(CELL_COLUMNS)}")
        rows = []
        for cells in reader:
            row = {(key or "").strip(): (value or "").strip() for key, value in cells.items() if isinstance(value, str)}
            try:
                numbers = {key: float(value) for key, value in row.items() if key != "channel" and value}
                content: dict[str, Any] = {
                    "channel": row["channel"],
                    "position": [numbers[key] for key in "xyz"],
                    "normal": [numbers["n" + key] for key in "xyz"],
                } | ({"area": numbers["area"]} if "area" in numbers else {})
            except (KeyError, ValueError) as error:
                raise FileError(path, f"line {reader.line_num}: {error} is no number or missing") from error
            rows.append((reader.line_num, content))
    return rows


def windows(value: Any) -> tuple[tuple[float, float], ...]:
    """One interval [from, to] or a list of them, s. **Errors**: `ValueError`."""
    if not isinstance(value, list) or not value:
        raise ValueError
    items = value if isinstance(value[0], list) else [value]
    intervals = tuple(as_numbers(item, 2) for item in items)
    if any(end <= start for start, end in intervals):
        raise ValueError
    return tuple((start, end) for start, end in intervals)
