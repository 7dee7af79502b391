"""Units as files spell them, and the factor that takes each to SI."""

LENGTH = {
    "m": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "metre": 1.0,
    "metres": 1.0,
    "dm": 0.1,
    "cm": 0.01,
    "mm": 1e-3,
    "um": 1e-6,
    "in": 0.0254,
    "inch": 0.0254,
}
"""Metres in one unit of length."""

ANALOG = {
    "n": 1.0,
    "kn": 1e3,
    "mn": 1e-3,
    "lbf": 4.4482216152605,
    "nm": 1.0,
    "n.m": 1.0,
    "n-m": 1.0,
    "n*m": 1.0,
    "ncm": 1e-2,
    "nmm": 1e-3,
    "n.mm": 1e-3,
    "n-mm": 1e-3,
    "n*mm": 1e-3,
    "mnm": 1e-3,
    "v": 1.0,
    "volt": 1.0,
    "volts": 1.0,
    "mv": 1e-3,
    "uv": 1e-6,
}
"""SI units (N, Nm, V) in one unit of an analog channel, by the unit in lower case without blanks."""


KINDS = {
    "force": ("n", "kn", "mn", "lbf"),
    "voltage": ("v", "volt", "volts", "mv", "uv"),
}
"""Units of `ANALOG` by quantity; the others are moments."""


def unit_kind(unit: str) -> str | None:
    """ "force", "moment", "length" or "voltage"; None if the unit is unknown or empty."""
    spelled = unit.strip().lower().replace(" ", "")
    for kind, members in KINDS.items():
        if spelled in members:
            return kind
    if spelled in ANALOG:
        return "moment"
    return "length" if spelled in LENGTH else None


def length_factor(unit: str) -> float | None:
    """Metres in one `unit`; None if the unit is unknown."""
    return LENGTH.get(unit.strip().lower())


def analog_factor(unit: str) -> float | None:
    """SI units in one `unit` of force, moment, voltage or length; None if the unit is unknown."""
    return ANALOG.get(unit.strip().lower().replace(" ", ""), length_factor(unit))
