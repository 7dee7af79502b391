"""Channels must hold what their place in a source says: a force is no voltage."""

from pathlib import Path

from icjax.files import FileError, unit_kind

FORCE, MOMENT, LENGTH = "force", "moment", "length"

EXPECTED = {
    "six_axis": (FORCE,) * 3 + (MOMENT,) * 3,
    "force_at_point": (FORCE,) * 3 + (LENGTH,) * 3 + (MOMENT,) * 3,
}
"""Quantity of each channel of a kind of source, in their order."""


def require_units(
    path: Path, source: str, expected: tuple[str, ...], labels: tuple[str, ...], units: tuple[str, ...]
) -> None:
    """Refuse a channel whose file states the unit of another quantity. A channel without a unit is taken as SI.

    **Errors**: `FileError` naming the file, the channel and its unit.
    """
    for label, unit, quantity in zip(labels, units, expected, strict=True):
        found = unit_kind(unit)
        if unit.strip() and found != quantity:
            what = f"a unit of {found}" if found else "an unknown unit"
            raise FileError(path, f"channel '{label}' of source '{source}' is in '{unit}', {what}, not of {quantity}")
