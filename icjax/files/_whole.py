"""Files written complete or not at all."""

import os
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from icjax.files._errors import FileError


def write_whole(path: Path, lines: Iterable[str]) -> Path:
    """Write lines under a temporary name and rename. Returns the path. **Errors**: `FileError` naming the file."""
    return _write(path, (f"{line}\n".encode() for line in lines))


def write_bytes(path: str | os.PathLike, content: bytes) -> Path:
    """Write a file under a temporary name and rename. Returns the path. **Errors**: `FileError` naming the file."""
    return _write(Path(path), (content,))


def _write(path: Path, pieces: Iterable[bytes]) -> Path:
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(prefix=f".{path.name}.", dir=path.parent, delete=False) as file:
            temporary = Path(file.name)
            file.writelines(pieces)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
    return path


def check_labels(labels: Sequence[str], argument: str, forbidden: str) -> None:
    """Labels must be distinct, not empty, without line breaks and without the `forbidden` characters.

    **Errors**: `ValueError` naming the argument and the label.
    """
    for index, label in enumerate(labels):
        if not label.strip() or len(label.splitlines()) > 1 or any(character in label for character in forbidden):
            raise ValueError(f"{argument} has the label {label!r}, which the file cannot hold")
        if label in labels[:index]:
            raise ValueError(f"{argument} has the label {label!r} twice")


def check_times(time: np.ndarray, count: int) -> None:
    """Times must be one a row, finite and increasing. **Errors**: `ValueError`."""
    if len(time) != count or count == 0:
        raise ValueError(f"time has {len(time)} entries for {count} rows; both must be equal and at least one")
    if not np.isfinite(time).all() or not (np.diff(time) > 0).all():
        raise ValueError("time must be finite and increase")
