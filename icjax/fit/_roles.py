"""What a measurement takes from the parameters, and what every one of them checks of its arrays."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from icjax.fit._parameters import Values
from icjax.typing import Bool, Real


def role(name: str) -> str:
    """What a parameter is for: "reference" of "reference" and of "reference of the second trial"."""
    return name.split(" of ", 1)[0]


def of_role(uses: Sequence[str], values: Values, wanted: str) -> Any:
    """Value of the one parameter of a role, None where the measurement uses none."""
    names = [name for name in uses if role(name) == wanted]
    return values[names[0]] if names else None


def used(what: str, uses: Sequence[str] | None, **default: bool) -> tuple[str, ...]:
    """Names of the parameters, where none are given those of `default`. **Errors**: `ValueError` for one text."""
    if isinstance(uses, str):
        raise ValueError(f"{what}: uses = {uses!r}: must be several names, ({uses!r},)")
    return tuple(name for name, needed in default.items() if needed) if uses is None else tuple(uses)


def check_uses(what: str, uses: Sequence[str], known: Sequence[str], several: Sequence[str] = ()) -> None:
    """**Errors**: `ValueError` for a parameter of no known role, and for two of one role unless in `several`."""
    for name in uses:
        if role(name) not in known:
            raise ValueError(f"{what}: uses {name!r}; it knows {', '.join(map(repr, known))}")
    for one in known:
        names = [name for name in uses if role(name) == one]
        if len(names) > 1 and one not in several:
            raise ValueError(f"{what}: uses both {names[0]!r} and {names[1]!r} as {one}")


def check_array(what: str, value: Any, shape: tuple[int, ...], names: str, counts: Any = None) -> None:
    """**Errors**: `ValueError` for another shape, and for what is not finite in a row that counts."""
    found = np.shape(value)
    if found != shape:
        raise ValueError(f"{what} must be [{names}] = {list(shape)}; got {list(found)}")
    finite = np.isfinite(np.asarray(value, float)).reshape(shape[0] if shape else 1, -1).all(axis=1)
    wrong = ~finite if counts is None else ~finite & np.asarray(counts)
    if wrong.any():
        raise ValueError(f"{what} is not finite, first in row {int(np.argmax(wrong))}; mask what was not measured")


def check_sd(what: str, sd: Any, shape: tuple[int, ...]) -> None:
    """**Errors**: `ValueError` for what is not positive or does not fit arrays of a shape."""
    known = np.asarray(sd, float)
    if not (np.isfinite(known).all() and np.all(known > 0)):
        raise ValueError(f"{what} must be above zero and finite; got {known.tolist()}")
    if known.ndim and (known.ndim > len(shape) or known.shape != shape[len(shape) - known.ndim :]):
        raise ValueError(f"{what} must be one number or {list(shape)} or its last axes; got {list(known.shape)}")


def check_time(what: str, time: Any) -> np.ndarray:
    """The times. **Errors**: `ValueError` for fewer than one or times that do not increase."""
    known = np.asarray(time, float)
    if known.ndim != 1 or not known.size or not np.isfinite(known).all() or np.any(np.diff(known) <= 0):
        raise ValueError(f"{what} must be finite numbers that increase; got an array {list(known.shape)}")
    return known


def counted(what: str, counts: Any, size: int) -> Bool[Real, " row"]:
    """The mask, default all. **Errors**: `ValueError` for another shape or none that counts."""
    mask = np.ones(size, bool) if counts is None else np.asarray(counts)
    if mask.dtype != bool or mask.shape != (size,):
        raise ValueError(f"{what}: counts must be {size} booleans; got {list(mask.shape)} of {mask.dtype}")
    if not mask.any():
        raise ValueError(f"{what}: no row counts")
    return mask
