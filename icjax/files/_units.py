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


def length_factor(unit: str) -> float | None:
    """Metres in one `unit`; None if the unit is unknown."""
    return LENGTH.get(unit.strip().lower())


def analog_factor(unit: str) -> float | None:
    """SI units in one `unit` of force, moment, voltage or length; None if the unit is unknown."""
    return ANALOG.get(unit.strip().lower().replace(" ", ""), length_factor(unit))
