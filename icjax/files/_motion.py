"""What a motion file holds: markers, analog channels, force plates and events, in SI units on one clock."""

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from icjax.files._errors import FileError


class MotionEvent(NamedTuple):
    """An event that the laboratory's software stored, for example ("Foot Strike", "Left", 3.05)."""

    label: str
    context: str
    time: float


@dataclasses.dataclass(frozen=True)
class ForcePlate:
    """Geometry and channels of one force plate, as the C3D group FORCE_PLATFORM states them.

    **Fields**

    - `type`: C3D plate type. 1: Fx Fy Fz, centre of pressure x y, free moment. 2: Fx Fy Fz Mx My Mz.
      3: eight piezoelectric channels. 4: as 2, through a calibration matrix.
    - `corners` [4, 3]: m, world; in the plate's quadrants (+x, +y), (-x, +y), (-x, -y), (+x, -y).
    - `origin` [3]: m, plate frame (see the plate types in the C3D manual for its sign).
    - `channels`: columns of `MotionFile.analog`.
    - `calibration`: type 4, from the channels in SI units to N and Nm; other types as stored, None if absent.
    """

    type: int
    corners: Float[np.ndarray, "4 3"]
    origin: Float[np.ndarray, "3"]
    channels: tuple[int, ...]
    calibration: Float[np.ndarray, "row column"] | None = None


@dataclasses.dataclass(frozen=True)
class MotionFile:
    """One recorded trial as found in files, in SI units; parts that a file lacks are empty.

    **The time axis.** Markers, analog samples and events share it. Frame numbers count from the start of the
    laboratory's capture, so frame i of a file whose first frame (counted from zero) is f has the time
    (f + i) / marker_rate, and the first analog sample has the time of the first frame. Event times of C3D
    files are on this axis as stored: they include the first-frame offset.

    **Fields**

    - `path`: the file.
    - `marker_names` [M], `marker_rate` (Hz), `marker_time` [F] (s), `markers` [F, M, 3] (m; NaN in gaps).
    - `marker_unit`: unit of length as found.
    - `analog_names` [C], `analog_units` [C] (as found), `analog_rate` (Hz), `analog_time` [S] (s),
      `analog` [S, C]: N, Nm or V where the unit is known, else as found and said in `notes`.
    - `plates`: force plates.
    - `events`: (label, context, time in s).
    - `outputs`: what the recording software computed and stored among the points (angles, forces, moments,
      powers), [F, 3] each, **unscaled**; `output_units`: their units as the file claims them.
    - `metadata`: "GROUP:PARAMETER" to value, as found.
    - `notes`: what a careful reader should know (units assumed, labels repeated).
    """

    path: str
    marker_names: tuple[str, ...]
    marker_rate: float
    marker_time: Float[np.ndarray, " frame"]
    markers: Float[np.ndarray, "frame marker 3"]
    marker_unit: str
    analog_names: tuple[str, ...] = ()
    analog_units: tuple[str, ...] = ()
    analog_rate: float = float("nan")
    analog_time: Float[np.ndarray, " sample"] = dataclasses.field(default_factory=lambda: np.zeros(0))
    analog: Float[np.ndarray, "sample channel"] = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))
    plates: tuple[ForcePlate, ...] = ()
    events: tuple[MotionEvent, ...] = ()
    outputs: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    output_units: Mapping[str, str] = dataclasses.field(default_factory=dict)
    metadata: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def marker(self, name: str) -> Float[np.ndarray, "frame 3"]:
        """Positions of one marker, m. **Errors**: `FileError` naming the file and the marker."""
        if name not in self.marker_names:
            raise FileError(self.path, f"has no marker '{name}' (it has {_some(self.marker_names)})")
        return self.markers[:, self.marker_names.index(name)]

    def channels(self, names: tuple[str, ...] | list[str]) -> Float[np.ndarray, "sample channel"]:
        """Analog channels in the order of `names`, SI. **Errors**: `FileError` naming file and channel."""
        for name in names:
            if name not in self.analog_names:
                raise FileError(self.path, f"has no analog channel '{name}' (it has {_some(self.analog_names)})")
        return self.analog[:, [self.analog_names.index(name) for name in names]]


def no_markers() -> tuple[tuple[str, ...], float, np.ndarray, np.ndarray, str]:
    """The marker fields of a file without markers."""
    return (), float("nan"), np.zeros(0), np.zeros((0, 0, 3)), ""


def unique_labels(labels: list[str], kind: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Labels without blanks at the ends; a repeated or empty one gets a number. Returns labels and notes."""
    seen: dict[str, int] = {}
    result, notes = [], []
    for index, label in enumerate(item.strip() for item in labels):
        name = label or f"*{index + 1}"
        seen[name] = seen.get(name, 0) + 1
        if seen[name] > 1:
            notes.append(f"{kind} label '{name}' is repeated; the repetition is called '{name}#{seen[name]}'")
            name = f"{name}#{seen[name]}"
        result.append(name)
    return tuple(result), tuple(notes)


def _some(names: tuple[str, ...], limit: int = 12) -> str:
    shown = ", ".join(names[:limit])
    return shown + (f", ... {len(names)} in all" if len(names) > limit else "") if names else "none"
