"""Labelled records: one declaration of dimensions and units serves the constructor, the file and the reader.

A record is an ``eqx.Module`` whose fields are declared with

- `labelled`: an array with named dimensions and a unit; written as a netCDF variable,
- `names`: a static tuple of strings that names the entries of one dimension; written as its coordinate,
- `static`: anything JSON can hold (text, numbers, tuples); written as an attribute,
- `optional`: an array that may be None, and is where a file does not have it,
- another record: written as a group.

Files are netCDF4 (plain HDF5 underneath), written to a temporary name and renamed when complete, so that a
failure never leaves half a file behind.
"""

import dataclasses
import json
import os
import tempfile
import types
import typing
from pathlib import Path
from typing import Any, TypeVar

import equinox as eqx
import numpy as np

from icjax.files._errors import FileError

Record = TypeVar("Record", bound=eqx.Module)

FORMAT = "icjax-record"
VERSION = 1

DAMAGED = (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError, IndexError, OverflowError)
"""What readers of HDF5 raise at the bytes of a broken file."""

KINDS = ("float64", "float32", "int64", "int32", "int16", "int8", "bool")
"""Types of numbers that a variable's attribute `kind` may name; booleans are stored as int8."""


def labelled(*dims: str, unit: str, doc: str = "") -> Any:
    """Field that holds an array with the named dimensions, in the given SI unit ("1" where there is none)."""
    return eqx.field(metadata={"dims": dims, "unit": unit, "doc": doc})


def optional(*dims: str, unit: str, doc: str = "") -> Any:
    """Field that holds an array like `labelled`, or None (the default): not stated. None is not written."""
    return eqx.field(default=None, metadata={"dims": dims, "unit": unit, "doc": doc, "optional": True})


def names(dim: str, default: Any = dataclasses.MISSING) -> Any:
    """Static field: a tuple of strings that names the entries along `dim`.

    A file without `dim` gives the default, if there is one.
    """
    keywords = {} if default is dataclasses.MISSING else {"default": default}
    return eqx.field(static=True, metadata={"names": dim}, **keywords)


def static(default: Any = dataclasses.MISSING) -> Any:
    """Static field that JSON can hold. Lists come back as tuples."""
    keywords = {} if default is dataclasses.MISSING else {"default": default}
    return eqx.field(static=True, metadata={"json": True}, **keywords)


def save_record(path: str | os.PathLike, record: eqx.Module) -> Path:
    """Write a record to one netCDF file, complete or not at all. Returns the path.

    **Errors**: `FileError` naming the file when it cannot be written.
    """
    import h5netcdf

    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror}") from error
    os.close(handle)
    try:
        with h5netcdf.File(temporary, "w") as file:
            file.attrs["format"] = FORMAT
            file.attrs["version"] = VERSION
            file.attrs["record"] = type(record).__name__
            _write(file, record)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from error
    finally:
        Path(temporary).unlink(missing_ok=True)
    return path


def load_record(path: str | os.PathLike, kind: type[Record]) -> Record:
    """Read a record of the given class back, equal to what was saved.

    **Errors**: `FileError` when the file is missing, no record file, of another kind, or incomplete.
    """
    import h5netcdf

    path = Path(path)
    if not path.is_file():
        raise FileError(path, "does not exist")
    try:
        with h5netcdf.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT:
                raise FileError(path, "is not an icjax record (no attribute format = 'icjax-record')")
            if file.attrs.get("version") != VERSION:
                raise FileError(path, f"has version {file.attrs.get('version')} of the layout; this is {VERSION}")
            found = file.attrs.get("record")
            if found != kind.__name__:
                raise FileError(path, f"holds the record {found}, not {kind.__name__}")
            return _read(file, kind, path)
    except DAMAGED as error:
        if isinstance(error, FileError):
            raise
        raise FileError(path, f"is damaged or incomplete: {error}") from error


def record_kind(path: str | os.PathLike) -> str:
    """Class name of the record that a file holds ("Recording", "Interaction", ...)."""
    import h5netcdf

    path = Path(path)
    if not path.is_file():
        raise FileError(path, "does not exist")
    try:
        with h5netcdf.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT:
                raise FileError(path, "is not an icjax record (no attribute format = 'icjax-record')")
            return str(file.attrs["record"])
    except DAMAGED as error:
        if isinstance(error, FileError):
            raise
        raise FileError(path, f"is no icjax record: {error}") from error


def _write(group: Any, record: eqx.Module) -> None:
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        metadata = field.metadata
        if "optional" in metadata and value is None:
            continue
        if "dims" in metadata:
            _write_array(group, field.name, np.asarray(value), metadata)
        elif "names" in metadata:
            dim = metadata["names"]
            _need_dimension(group, dim, len(value), field.name)
            if len(value):
                variable = group.create_variable(field.name, (dim,), dtype=_text_type())
                variable[...] = np.asarray(value, dtype=object)
        elif "json" in metadata:
            group.attrs[field.name] = json.dumps(value)
        elif isinstance(value, eqx.Module):
            _write(group.create_group(field.name), value)
        elif isinstance(value, tuple):
            parent = group.create_group(field.name)
            parent.attrs["length"] = len(value)
            for index, item in enumerate(value):
                _write(parent.create_group(str(index)), item)
        else:
            raise TypeError(f"{type(record).__name__}.{field.name} is neither labelled, static nor a record")


def _write_array(group: Any, name: str, value: np.ndarray, metadata: Any) -> None:
    dims = metadata["dims"]
    if value.ndim != len(dims):
        raise ValueError(f"{name} has {value.ndim} dimensions, expected {dims}")
    for dim, size in zip(dims, value.shape, strict=True):
        _need_dimension(group, dim, size, name)
    if value.dtype == bool:
        value = value.astype(np.int8)
        kind = "bool"
    else:
        kind = value.dtype.name
    variable = group.create_variable(name, dims, dtype=value.dtype)  # measured data hardly compress
    if value.size:
        variable[...] = value
    variable.attrs["units"] = metadata["unit"]
    variable.attrs["kind"] = kind
    if metadata["doc"]:
        variable.attrs["long_name"] = metadata["doc"]


def _need_dimension(group: Any, dim: str, size: int, name: str) -> None:
    if dim not in group.dimensions:
        group.dimensions[dim] = size
    elif group.dimensions[dim].size != size:
        raise ValueError(f"{name} has {size} entries along {dim}, expected {group.dimensions[dim].size}")


def _text_type() -> Any:
    import h5py

    return h5py.string_dtype()


def _read(group: Any, kind: type, path: Path) -> Any:
    hints = typing.get_type_hints(kind)
    values: dict[str, Any] = {}
    for field in dataclasses.fields(kind):
        metadata = field.metadata
        if "optional" in metadata and field.name not in group.variables:
            values[field.name] = None
        elif "dims" in metadata:
            values[field.name] = _read_array(group, field.name, path)
        elif "names" in metadata:
            if metadata["names"] not in group.dimensions and field.default is not dataclasses.MISSING:
                continue
            dim = group.dimensions[metadata["names"]]
            found = group.variables[field.name][...] if dim.size else ()
            values[field.name] = tuple(item.decode() if isinstance(item, bytes) else str(item) for item in found)
        elif "json" in metadata:
            if field.name in group.attrs or field.default is dataclasses.MISSING:
                values[field.name] = _tuples(json.loads(group.attrs[field.name]))
        else:
            values[field.name] = _read_nested(group[field.name], hints[field.name], path)
    return kind(**values)


def _read_nested(group: Any, hint: Any, path: Path) -> Any:
    record, repeated = nested_record(hint)
    if repeated:
        return tuple(_read(group[str(index)], record, path) for index in range(int(group.attrs["length"])))
    return _read(group, record, path)


def nested_record(hint: Any) -> tuple[type, bool]:
    """Record class behind the type of a field, and whether the field is a tuple of them."""
    origin = typing.get_origin(hint)
    if origin is tuple:
        return typing.get_args(hint)[0], True
    if origin in (typing.Union, types.UnionType):
        return next(option for option in typing.get_args(hint) if option is not type(None)), False
    return hint, False


def _read_array(group: Any, name: str, path: Path) -> np.ndarray:
    if name not in group.variables:
        raise FileError(path, f"variable {name} is missing")
    variable = group.variables[name]
    value = np.asarray(variable[...])
    kind = variable.attrs["kind"]
    if kind not in KINDS:
        raise FileError(path, f"variable {name} has the attribute kind = {kind!r}, none of {', '.join(KINDS)}")
    return value.astype(bool) if kind == "bool" else value.astype(kind, copy=False)


def _tuples(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_tuples(item) for item in value)
    if isinstance(value, dict):
        return {key: _tuples(item) for key, item in value.items()}
    return value
