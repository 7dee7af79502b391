"""A contact that might be recorded, and the instruments that would record it."""

import dataclasses
import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from icjax.fit._session import LEAST_AFTER
from icjax.model import Model

Numbers: TypeAlias = Sequence[float | int] | np.ndarray

PAD_STIFFNESS = 750.0
"""N/m, of a fingertip's pulp between bone and surface where the model states none."""


MOST = {"speed": 3.0, "depth": 0.3, "hover": 0.5}
"""m/s and m; beyond, millimetres are likely meant."""


MOST_CONTACTS = 100_000
"""Of a probe; a year of tapping."""


@dataclasses.dataclass(frozen=True)
class Probe:
    """A kind of contact that might be recorded, so many times.

    **Arguments**

    - `q`: coordinates at the moment of contact, rad and m (`[nq]`). `contact`: name of a pad of the model, or of a body
      with the `point` (m, in the body's frame) that touches.
    - `normal`: of the surface, out of it and to the finger, world axes; its length does not matter.
    - `speed`: m/s with which the finger meets the surface along the normal. `slide`: m/s, world axes, with which it
      then moves along the surface; what it has along the normal does not count. The intended path is straight.
    - `depth`: m below the surface where the intended movement ends, `hover` m above it where it begins, from rest to
      rest with least jerk through the surface at `speed`. Default: it keeps its speed.
    - `duration`: s of touch. `contacts`: how often. `friction`: Coulomb coefficient; a dry
      fingertip sticks, which takes load off some joints, so zero is no safe choice.
    - `pad_stiffness`: N/m, default the pad's own, 750 where the model states none. A rigid tip: 5000; joints cannot
      tell it from stiffer ones.

    **Errors**: `ValueError` naming the argument and its value.
    """

    q: Numbers
    contact: str
    normal: Numbers = (0.0, 0.0, 1.0)
    speed: float = 0.1
    duration: float = 0.1
    contacts: int = 12
    name: str = "probe"
    friction: float = 0.6
    slide: Numbers = (0.0, 0.0, 0.0)
    depth: float = math.inf
    hover: float = 0.02
    pad_stiffness: float | None = None
    point: Numbers | None = None

    def __post_init__(self):
        for name in ("q", "normal", "slide", "point"):
            value = getattr(self, name)
            if value is None:
                continue
            numbers = tuple(np.asarray(value, float).ravel().tolist())
            if not all(map(math.isfinite, numbers)) or (name != "q" and len(numbers) != 3):
                raise self._error(name, value, "finite numbers" if name == "q" else "three finite numbers")
            object.__setattr__(self, name, numbers)
        length = math.hypot(*self.normal)
        if not length > 1e-9:
            raise self._error("normal", self.normal, "a direction; it has no length")
        object.__setattr__(self, "normal", tuple(item / length for item in self.normal))
        for name in ("speed", "hover", "pad_stiffness"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise self._error(name, value, "above zero and finite")
        for name, most in MOST.items():
            if getattr(self, name) > most and not math.isinf(self.depth if name == "depth" else 0.0):
                raise self._error(name, getattr(self, name), f"at most {most:g}, as fast and far as fingers move")
        if not self.depth > 0:
            raise self._error("depth", self.depth, "above zero (inf: the movement keeps its speed)")
        if not (math.isfinite(self.friction) and self.friction >= 0):
            raise self._error("friction", self.friction, "at least zero and finite")
        if not (math.isfinite(self.duration) and self.duration >= LEAST_AFTER):
            raise self._error("duration", self.duration, f"at least {LEAST_AFTER:g} s; a shorter contact is not fitted")
        if isinstance(self.contacts, bool) or not isinstance(self.contacts, int) or self.contacts < 1:
            raise self._error("contacts", self.contacts, "a whole number of at least 1")
        if self.contacts > MOST_CONTACTS:
            raise self._error("contacts", self.contacts, f"at most {MOST_CONTACTS}")

    def _error(self, argument: str, value: object, wanted: str) -> ValueError:
        return ValueError(f"probe {self.name!r}: {argument} = {value}: must be {wanted}")


@dataclasses.dataclass(frozen=True)
class Instruments:
    """What the cameras and the calibration are good for.

    **Arguments**

    - `rate`: Hz of the markers; `cutoff`: Hz, with which they are filtered.
    - `marker_sd`: m a frame and axis before that filter. `placement_sd`: m, constant error of a marker's place on its
      segment. Both become errors of the joint angles by least squares over the marker sites of the model.
    - `angle_sd`, `offset_sd`: rad, the same of every joint, independent, in place of the markers'. Needed where the
      model has no sites that determine its coordinates.

    **Errors**: `ValueError` naming the argument and its value.
    """

    rate: float = 500.0
    cutoff: float = 20.0
    marker_sd: float = 0.2e-3
    placement_sd: float = 1e-3
    angle_sd: float | None = None
    offset_sd: float | None = None

    def __post_init__(self):
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"instruments: {field.name} = {value}: must be above zero and finite")
        if self.cutoff >= 0.38 * self.rate:
            raise ValueError(f"instruments: cutoff = {self.cutoff} Hz is too high for the rate {self.rate:g} Hz")
        if (self.angle_sd is None) != (self.offset_sd is None):
            raise ValueError("instruments: angle_sd and offset_sd belong together; give both or neither")


def check_probe(model: Model, probe: Probe) -> None:
    """**Errors**: `ValueError` for coordinates that the model does not have or allow, and for an unknown contact."""
    if len(probe.q) != model.nq:
        raise ValueError(f"probe {probe.name!r}: q has {len(probe.q)} numbers, the model {model.nq} coordinates")
    q, lower, upper = np.asarray(probe.q), np.asarray(model.lower), np.asarray(model.upper)
    for name, at in zip(model.joint_names, model.coordinate_slices, strict=True):
        if np.any(q[at] < lower[at] - 1e-6) or np.any(q[at] > upper[at] + 1e-6):
            raise ValueError(
                f"probe {probe.name!r}: {name} = {np.degrees(q[at.start]):.1f} degrees; its range is "
                f"{np.degrees(lower[at.start]):.1f} to {np.degrees(upper[at.start]):.1f}"
            )
    if probe.contact in model.pad_names:
        return
    if probe.contact not in model.body_names[1:]:
        known = ", ".join((*model.pad_names, *model.body_names[1:]))
        raise ValueError(f"probe {probe.name!r}: contact {probe.contact!r} is no pad or body of the model ({known})")
    if probe.point is None:
        raise ValueError(f"probe {probe.name!r}: contact {probe.contact!r} is a body; say which point of it touches")
