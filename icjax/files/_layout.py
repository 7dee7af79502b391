"""What a record file holds, entry by entry, and whether a given file holds it."""

import dataclasses
import json
import os
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from icjax.files._errors import FileError
from icjax.files._records import DAMAGED, FORMAT, KINDS, VERSION, nested_record


class LayoutEntry(NamedTuple):
    """One variable, attribute or group of a record file.

    - `path`: with a slash for each group; `*` stands for the number of a repeated group.
    - `sort`: "variable", "optional" (a variable that may be missing), "names" (a text coordinate), "attribute" (JSON
      text) or "groups" (numbered from 0).
    - `dims`: names of the dimensions; `unit`: SI unit, "1" for none, "" where it does not apply; `doc`: meaning.
    """

    path: str
    sort: str
    dims: tuple[str, ...]
    unit: str
    doc: str


def layout(record: type) -> tuple[LayoutEntry, ...]:
    """Every entry of the file of a record class, in the order of its declaration."""
    return tuple(_entries(record, ""))


def layout_problems(path: str | os.PathLike, record: type) -> list[str]:
    """What keeps a file from being a record of the class: one line an entry that is missing or of another form.

    Reads dimensions and attributes, not the arrays. An entry that the class does not know is named as well, so that
    a misspelled variable is not lost in silence.

    **Errors**: `FileError` when the file is missing or is no netCDF4 (HDF5) file.
    """
    import h5netcdf

    path = Path(path)
    if not path.is_file():
        raise FileError(path, "does not exist")
    try:
        with h5netcdf.File(path, "r") as file:
            problems = _attributes(file, record)
            _compare(file, record, "", problems)
    except DAMAGED as error:
        raise FileError(path, f"is no readable netCDF4 file: {error}") from error
    return problems


def _entries(record: type, prefix: str) -> Iterator[LayoutEntry]:
    hints = typing.get_type_hints(record)
    for field in dataclasses.fields(record):
        metadata, path = field.metadata, prefix + field.name
        if "dims" in metadata:
            sort = "optional" if "optional" in metadata else "variable"
            yield LayoutEntry(path, sort, metadata["dims"], metadata["unit"], metadata["doc"])
        elif "names" in metadata:
            yield LayoutEntry(path, "names", (metadata["names"],), "", "")
        elif "json" in metadata:
            yield LayoutEntry(path, "attribute", (), "", "")
        else:
            nested, repeated = nested_record(hints[field.name])
            if repeated:
                yield LayoutEntry(path, "groups", (), "", "attribute `length` and one group for each")
            yield from _entries(nested, f"{path}/*/" if repeated else f"{path}/")


def _attributes(file: Any, record: type) -> list[str]:
    problems = []
    for name, expected in (("format", FORMAT), ("version", VERSION), ("record", record.__name__)):
        if name not in file.attrs:
            problems.append(f"the file attribute '{name}' is missing; it must be '{expected}'")
        elif file.attrs[name] != expected:
            problems.append(f"the file attribute '{name}' is '{file.attrs[name]}'; it must be '{expected}'")
    return problems


def _compare(group: Any, record: type, prefix: str, problems: list[str]) -> None:
    hints = typing.get_type_hints(record)
    known = set()
    for field in dataclasses.fields(record):
        metadata, path = field.metadata, prefix + field.name
        known.add(field.name)
        if "optional" in metadata and field.name not in group.variables:
            continue
        if "dims" in metadata:
            _compare_variable(group, field.name, metadata, path, problems)
        elif "names" in metadata:
            dim = metadata["names"]
            if dim not in group.dimensions and field.default is not dataclasses.MISSING:
                continue
            if dim not in group.dimensions:
                problems.append(f"dimension '{prefix}{dim}' is missing")
            elif group.dimensions[dim].size and field.name not in group.variables:
                problems.append(f"the names '{path}' along '{dim}' are missing")
        elif "json" in metadata:
            _compare_attribute(group, field.name, path, problems)
        elif field.name not in group.groups:
            problems.append(f"group '{path}' is missing")
        else:
            nested, repeated = nested_record(hints[field.name])
            _compare_groups(group[field.name], nested, path, repeated, problems)
    for name in (*group.variables, *group.groups):
        if name not in known and name not in group.dimensions:
            problems.append(f"'{prefix}{name}' is no part of the record {record.__name__}")


def _compare_groups(group: Any, record: type, path: str, repeated: bool, problems: list[str]) -> None:
    if not repeated:
        return _compare(group, record, f"{path}/", problems)
    length = group.attrs.get("length")
    if length is None:
        problems.append(f"group '{path}' has no attribute 'length'")
        return None
    for index in range(int(length)):
        if str(index) not in group.groups:
            problems.append(f"group '{path}/{index}' is missing")
        else:
            _compare(group[str(index)], record, f"{path}/{index}/", problems)
    return None


def _compare_variable(group: Any, name: str, metadata: Any, path: str, problems: list[str]) -> None:
    if name not in group.variables:
        problems.append(f"variable '{path}' ({', '.join(metadata['dims'])}; {metadata['unit']}) is missing")
        return
    variable = group.variables[name]
    if tuple(variable.dimensions) != tuple(metadata["dims"]):
        found, expected = ", ".join(variable.dimensions), ", ".join(metadata["dims"])
        problems.append(f"variable '{path}' has the dimensions ({found}); they must be ({expected})")
    unit = variable.attrs.get("units")
    if unit != metadata["unit"]:
        problems.append(f"variable '{path}' has the unit {unit!r}; it must be {metadata['unit']!r}")
    kind = variable.attrs.get("kind")
    if kind not in KINDS:
        problems.append(f"variable '{path}' has the attribute kind = {kind!r}, none of {', '.join(KINDS)}")


def _compare_attribute(group: Any, name: str, path: str, problems: list[str]) -> None:
    if name not in group.attrs:
        problems.append(f"attribute '{path}' is missing")
        return
    try:
        json.loads(group.attrs[name])
    except (TypeError, ValueError):
        problems.append(f"attribute '{path}' is {group.attrs[name]!r}, not JSON text")
