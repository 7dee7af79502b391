"""Strict reading of TOML tables: every error is one line that names the file, the table and the key."""

import difflib
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from icjax.files._errors import FileError

REQUIRED: Any = object()
"""Marks a key without default."""

LARGEST = 1e9
"""No length, time, rate or mass of a laboratory is larger, in SI units; beyond it a typing error is likely."""


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file. **Errors**: `FileError` when it is missing or not TOML, with the line."""
    if not path.is_file():
        raise FileError(path, "does not exist")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except RecursionError:
        raise FileError(path, "is not valid TOML: it is nested too deeply") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, ValueError) as error:
        raise FileError(path, f"is not valid TOML: {error}") from error


class Table:
    """One table of a TOML file, from which each key is taken once; `close` objects to the keys that are left."""

    def __init__(self, path: Path, name: str, content: Any):
        self.path = path
        self.name = name
        if not isinstance(content, dict):
            raise FileError(path, f"{name} must be a table of keys, not {content!r}")
        self.content = content
        self.known: list[str] = []

    def error(self, message: str) -> FileError:
        """The error with the name of this table in front."""
        return FileError(self.path, f"{self.name} {message}" if self.name else message)

    def take(self, key: str, check: Callable[[Any], Any], expected: str, default: Any = REQUIRED) -> Any:
        """The value of a key as `check` returns it; a ValueError of `check` becomes the error of the key."""
        self.known.append(key)
        if key not in self.content:
            if default is REQUIRED:
                raise self.error(f"needs the key '{key}' ({expected}){self._near(key)}")
            return default
        try:
            return check(self.content[key])
        except ValueError as error:
            raise self.error(f"key '{key}' must be {expected}, not {self.content[key]!r}") from error

    def text(self, key: str, default: Any = REQUIRED) -> Any:
        """A text that is not empty."""
        return self.take(key, _text, "a text", default)

    def label(self, key: str, default: Any = REQUIRED) -> Any:
        """A text that can be part of a file's name: no separators, not beginning with a dot."""

        def check(value: Any) -> str:
            if any(sign in _text(value) for sign in '/\\:*?"<>|') or value.startswith("."):
                raise ValueError
            return value

        return self.take(key, check, 'a name without / \\ : * ? " < > | and not beginning with a dot', default)

    def choice(self, key: str, options: Iterable[str], default: Any = REQUIRED) -> Any:
        """One of several words."""
        options = tuple(options)

        def check(value: Any) -> str:
            if value not in options:
                raise ValueError
            return value

        return self.take(key, check, "one of " + ", ".join(f"'{item}'" for item in options), default)

    def number(self, key: str, default: Any = REQUIRED, *, above: float = -np.inf, least: float = -np.inf) -> Any:
        """A finite number `above` one bound or at `least` another."""

        def check(value: Any) -> float:
            number = as_numbers([value], 1)[0]
            if not (number > above and number >= least):
                raise ValueError
            return number

        bounds = (f" above {above:g}" if np.isfinite(above) else "") + (
            f" of at least {least:g}" if np.isfinite(least) else ""
        )
        return self.take(key, check, "a number" + bounds, default)

    def whole(self, key: str, default: Any = REQUIRED, *, least: int = 0) -> Any:
        """A whole number of at least `least`."""

        def check(value: Any) -> int:
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise ValueError
            return value

        return self.take(key, check, f"a whole number of at least {least}", default)

    def flag(self, key: str, default: Any = REQUIRED) -> Any:
        """True or false."""

        def check(value: Any) -> bool:
            if not isinstance(value, bool):
                raise ValueError
            return value

        return self.take(key, check, "true or false", default)

    def vector(self, key: str, default: Any = REQUIRED) -> Any:
        """Three numbers."""
        return self.take(key, lambda value: as_numbers(value, 3), "three numbers", default)

    def texts(self, key: str, default: Any = REQUIRED) -> Any:
        """A list of texts."""
        return self.take(key, _texts, "a list of texts", default)

    def table(self, key: str, default: Any = REQUIRED) -> Any:
        """A table inside this one, as a `Table`."""
        self.known.append(key)
        if key not in self.content:
            if default is REQUIRED:
                raise self.error(f"needs the table [{key}]{self._near(key)}")
            return default
        return Table(self.path, f"{self.name} {key}" if self.name else f"[{key}]", self.content[key])

    def tables(self, key: str) -> list["Table"]:
        """An array of tables, each named by its number and, where it has one, by its name."""
        self.known.append(key)
        found = self.content.get(key, [])
        if not isinstance(found, list):
            raise FileError(self.path, f"{key} must be an array of tables, written [[{key}]]")
        tables = []
        for index, content in enumerate(found):
            label = f" {content['name']!r}" if isinstance(content, dict) and "name" in content else ""
            tables.append(Table(self.path, f"[[{key}]] {index + 1}{label}:", content))
        return tables

    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Every key with its value, which must be a text."""
        self.known += list(self.content)
        for key, value in self.content.items():
            if not isinstance(value, str) or not value:
                raise self.error(f"key '{key}' must be a text, not {value!r}")
        return tuple(self.content.items())

    def close(self) -> None:
        """Object to keys that nobody asked for."""
        for key in self.content:
            if key not in self.known:
                near = difflib.get_close_matches(key, self.known, n=1)
                hint = f"did you mean '{near[0]}'?" if near else f"known: {', '.join(self.known)}"
                raise self.error(f"has the unknown key '{key}'; {hint}")

    def _near(self, key: str) -> str:
        near = difflib.get_close_matches(key, [item for item in self.content if item not in self.known], n=1)
        return f"; is '{near[0]}' meant to be it?" if near else ""


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value or not value.isprintable():
        raise ValueError
    return value


def _texts(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise ValueError
    return tuple(_text(item) for item in value)


def as_numbers(value: Any, count: int) -> tuple[float, ...]:
    """A list of so many numbers, finite and below 10^100 in size. **Errors**: `ValueError`."""
    if not isinstance(value, list) or len(value) != count:
        raise ValueError
    for item in value:
        if isinstance(item, bool) or not isinstance(item, int | float) or not abs(item) <= LARGEST:
            raise ValueError
    return tuple(float(item) for item in value)


def as_rotation(value: Any) -> tuple[tuple[float, ...], ...]:
    """Three rows of a proper rotation matrix. **Errors**: `ValueError`."""
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError
    rows = tuple(as_numbers(row, 3) for row in value)
    matrix = np.array(rows)
    if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6) or np.linalg.det(matrix) < 0:
        raise ValueError
    return rows
