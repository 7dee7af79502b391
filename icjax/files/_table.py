"""Rows of numbers in text files, parsed strictly: an error names the line."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from icjax.files._errors import FileError

UNEVEN = 0.5
"""Intervals of a time column may differ from the usual one by this fraction (printed times are rounded)."""


def read_lines(path: Path) -> list[str]:
    """Lines of a text file. **Errors**: `FileError` when it is missing, empty or not text."""
    if not path.is_file():
        raise FileError(path, "does not exist")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        text = path.read_bytes().decode("latin-1")
    except OSError as error:
        raise FileError(path, f"cannot be read: {error}") from error
    if "\0" in text:
        raise FileError(path, "is not a text file (it contains zero bytes)")
    lines = text.splitlines()
    if not any(line.strip() for line in lines):
        raise FileError(path, "is empty")
    return lines


def number_rows(path: Path, rows: Iterable[tuple[int, str]], separator: str | None, columns: int) -> np.ndarray:
    """Parse (line number, text) rows into [row, column]; blank lines are skipped, empty cells are NaN.

    Separator None splits at any blanks (a cell cannot be empty then); trailing separators are ignored.
    """
    result = []
    for line, text in rows:
        if not text.strip():
            continue
        cells = text.split(separator)
        while len(cells) > columns and not cells[-1].strip():
            cells.pop()
        if len(cells) != columns:
            raise FileError(path, f"line {line} has {len(cells)} columns, expected {columns}")
        try:
            result.append([float(cell) if cell.strip() else np.nan for cell in cells])
        except ValueError:
            bad = next(index for index, cell in enumerate(cells) if cell.strip() and not is_number(cell))
            raise FileError(path, f"line {line}, column {bad + 1}: '{cells[bad].strip()}' is not a number") from None
    return np.array(result, dtype=float).reshape(-1, columns)


def check_time(path: Path, time: np.ndarray) -> None:
    """Time must be finite and increase. **Errors**: `FileError` naming the first bad row, counted from 1."""
    if len(time) == 0:
        raise FileError(path, "holds no rows")
    bad = ~np.isfinite(time)
    if bad.any():
        raise FileError(path, f"data row {int(np.argmax(bad)) + 1} has no valid time")
    steps = np.diff(time)
    if len(steps) and np.any(steps <= 0):
        row = int(np.argmax(steps <= 0)) + 1
        raise FileError(
            path, f"time does not increase at data row {row + 1} ({time[row - 1]:g} s, then {time[row]:g} s)"
        )


def spacing_notes(time: np.ndarray) -> tuple[str, ...]:
    """A note if the intervals differ by more than half of the usual one: filters assume a constant rate."""
    steps = np.diff(time)
    usual = float(np.median(steps)) if len(steps) else 0.0
    if not len(steps) or np.max(np.abs(steps - usual)) <= UNEVEN * usual:
        return ()
    return (f"times are not evenly spaced: intervals from {steps.min():g} to {steps.max():g} s",)


def rate_of(time: np.ndarray) -> float:
    """Samples a second over the whole file; NaN for a single row."""
    return (len(time) - 1) / float(time[-1] - time[0]) if len(time) > 1 else float("nan")


def is_number(cell: str) -> bool:
    """Whether the text is one number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True
