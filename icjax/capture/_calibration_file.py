"""The tables of a session file about the model itself: its sites, its part, its calibration, its posture."""

from collections.abc import Callable
from typing import Any

from icjax.capture._calibration_parameters import CalibrationOptions
from icjax.capture._posture import PosturePrior, posture_prior
from icjax.files import FileError, Table
from icjax.model import Model, lock_joints, part_of, with_sites


def changed_by(table: Table, sites: Table | None, model: Model) -> Model:
    """The model after the keys `part` and `locked` of [model] and the table [sites]."""
    part = table.text("part", None)
    locked = table.texts("locked", ())
    root = table.choice("root", ["free", "fixed"], None)

    def attempt(change: Callable[[], Model], where: Table) -> Model:
        try:
            return change()
        except ValueError as error:
            raise where.error(str(error)) from error

    model = attempt(lambda: lock_joints(model, locked), table) if locked else model
    model = attempt(lambda: part_of(model, part, root == "free"), table) if part is not None else model
    if sites is None:
        return model
    places = {}
    for name, row in _rows(sites):
        places[name] = (row.text("body"), row.vector("position"))
        row.close()
    return attempt(lambda: with_sites(model, places), sites)


def read_calibration(table: Table | None, trials: list[str]) -> CalibrationOptions | None:
    """The table [calibration]; without it nothing is calibrated."""
    if table is None:
        return None
    named = table.texts("trials")
    for name in named:
        if name not in trials:
            raise table.error(f"key 'trials' names '{name}', which is no trial of the session")
    if not named:
        raise table.error("key 'trials' names no trial")
    options = CalibrationOptions(
        trials=named,
        size=_spread(table, "size", None),
        lengths=_spread(table, "lengths", CalibrationOptions.lengths),
        axes=_spread(table, "axes", CalibrationOptions.axes),
        placement=table.flag("placement", CalibrationOptions.placement),
        frames=table.whole("frames", CalibrationOptions.frames, least=10),
    )
    table.close()
    if (options.size, options.lengths, options.axes) == (None, None, None) and not options.placement:
        raise table.error("calibrates nothing: no size, lengths, axes or placement")
    return options


def read_posture(table: Table | None, model: Model) -> PosturePrior | None:
    """The table [posture] with its tables [posture.angles] and [posture.couplings]."""
    if table is None:
        return None
    angles, couplings = table.table("angles", None), table.table("couplings", None)
    means: dict[str, tuple[float, float]] = {}
    linked: dict[str, tuple[str, float, float]] = {}
    for name, row in _rows(angles):
        means[name] = (row.number("mean"), row.number("sd", above=0.0))
        row.close()
    for name, row in _rows(couplings):
        linked[name] = (row.text("of"), row.number("ratio"), row.number("sd", above=0.0))
        row.close()
    noise = table.number("noise", above=0.0)
    sd = table.number("sd", None, above=0.0)
    limits = table.number("limits", None, above=0.0)
    table.close()
    try:
        return posture_prior(model, noise, sd, limits, means, linked)
    except FileError:
        raise
    except ValueError as error:
        raise table.error(str(error)) from error


def _rows(table: Table | None) -> list[tuple[str, Table]]:
    """The tables in a table, by name."""
    return [] if table is None else [(name, table.table(name)) for name in table.content]


def _spread(table: Table, key: str, default: float | None) -> float | None:
    """A standard deviation, or false to keep what the model has."""

    def check(value: Any) -> float | None:
        if value is False:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1:
            raise ValueError
        return float(value)

    return table.take(key, check, "a standard deviation between 0 and 1, or false", default)
