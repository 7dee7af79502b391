"""What a session file says, after it was checked."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from icjax.capture._calibration_parameters import CalibrationOptions
from icjax.capture._posture import PosturePrior
from icjax.model import Model


@dataclasses.dataclass(frozen=True)
class FilterSpec:
    """Effective cut-offs (Hz) of the zero-phase Butterworth filters.

    - `markers`: 20 Hz. Voluntary movement of a hand holds little above 10 Hz, tremor reaches 12 Hz.
    - `forces`: 60 Hz, what reaches the joints; far below the resonance of a plate's mount.
    - `angles`: of joint angles that come from a file; None leaves them as they are, since whoever solved them has
      usually filtered them.
    - `events`: 150 Hz, only for finding onset and release: a step rises in 0.35 / 150 Hz = 2.3 ms, and a mount
      that rings at 350 Hz is damped to a tenth.
    - `stated`: which of them the session file states; a stated cut-off that a recording is too slow for is an error,
      the others give way.
    """

    markers: float = 20.0
    forces: float = 60.0
    events: float = 150.0
    angles: float | None = None
    stated: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class ContactSpec:
    """When a force is a contact and where it acts.

    - `onset`, `release`: N; None takes them from the noise of the tare windows (see `contact_events`).
    - `shortest`: s; a shorter contact is an artefact. `gap`: s; a shorter gap does not end a contact (a fingertip
      that leaves a plate chatters for some milliseconds).
    - `point_sd`: m; the centre of pressure is used where its standard deviation is below this.
    """

    onset: float | None = None
    release: float | None = None
    shortest: float = 0.010
    gap: float = 0.025
    point_sd: float = 0.001


@dataclasses.dataclass(frozen=True)
class SurfaceSpec:
    """The touched plane: a point (m) and the normal that points to the subject's side, world axes."""

    point: tuple[float, float, float]
    normal: tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class ClockSpec:
    """The clock of forces that a separate acquisition recorded, t_daq = (t_marker + offset) (1 + drift).

    - `sync`: channel of the force file with pulses; rising edges at `start` + k `period` (s, marker clock), or at the
      edges of the channel `marker_sync` of the marker file.
    - `correlate`: without pulses, the source whose force is compared with the depth of the pad that touches it, for
      offsets within `within` of `offset` (s).
    - `offset`: s, approximate; None if nothing is known. `drift_sd`: how well the rates of two clocks agree.
    """

    sync: str | None = None
    period: float | None = None
    start: float = 0.0
    marker_sync: str | None = None
    correlate: str | None = None
    within: float = 1.0
    offset: float | None = None
    drift_sd: float = 5e-5


@dataclasses.dataclass(frozen=True)
class TopSpec:
    """What is mounted above the sensing element of a six-axis sensor and moves with it.

    - `mass` kg; `com` m, world, at rest: its centre of mass (None: the mean of the markers, else the reference point).
    - `markers`: on it; three show how it turns, fewer how it moves. `accelerometer`: three channels, m/s2, along the
      sensor's axes. `cutoff` Hz of the markers.
    """

    mass: float
    markers: tuple[str, ...]
    accelerometer: tuple[str, ...]
    com: tuple[float, float, float] | None
    cutoff: float


@dataclasses.dataclass(frozen=True)
class CellSpec:
    """One cell of a pressure array, or a whole normal-only sensor.

    - `channel`: its name in the file; `scale`: N a unit of it (an area in m2 where it holds Pa).
    - `position` m and `normal` (unit vector, the direction of the force on the subject) in the source's frame.
      `position` is None where the cell acts on the sphere of the touched pad.
    """

    channel: str
    position: tuple[float, float, float] | None
    normal: tuple[float, float, float]
    scale: float = 1.0


@dataclasses.dataclass(frozen=True)
class SourceSpec:
    """One force source.

    - `kind`: "six_axis" (Fx Fy Fz Mx My Mz about `position`), "force_plate" (number `plate` of a C3D file, from 1),
      "force_at_point" (nine channels: force, point of application, moment about that point; OpenSim's MOT), "normal"
      (one channel, a normal force on the touched body) or "pressure_array" (a channel a cell). The last two measure
      no tangential force.
    - `channels`: names in the file. `rotation`: sensor axes in world, v_W = R v_S. `position`: reference point of
      the moments, m, world.
    - `sign`: whether the channels hold the force "on_environment" or "on_subject".
    - `surface`: for the centre of pressure; None for a force plate means the plate's own top.
    - `tare`: intervals (s, marker clock) known to be unloaded; several give a baseline that drifts linearly.
    - `top`: what moves above the sensing element. `cells`, in the `frame` of the touched "body" or of the "world";
      `calibration`: curves from volt to N (`icjax calibrate`).
    """

    name: str
    kind: str
    channels: tuple[str, ...]
    plate: int | None
    position: tuple[float, float, float]
    rotation: tuple[tuple[float, ...], ...]
    sign: str
    surface: SurfaceSpec | None
    tare: tuple[tuple[float, float], ...]
    top: TopSpec | None = None
    cells: tuple[CellSpec, ...] = ()
    frame: str = "world"
    calibration: Path | None = None


@dataclasses.dataclass(frozen=True)
class TrialSpec:
    """One trial: files (`file` for both, or `markers` and `forces`), role, and what touches which source.

    - `angles`: the movement file `markers` holds joint angles, not markers.
    - `degrees`: whether its angles are in degrees, None if the session leaves that to the file's header.
    """

    name: str
    role: str
    catch_of: tuple[str, ...]
    markers: Path
    forces: Path | None
    touches: tuple[tuple[str, str], ...]
    friction: float | None
    tare: tuple[tuple[float, float], ...] | None
    angles: bool = False
    degrees: bool | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class SessionSpec:
    """A whole session file, checked: every name it uses exists.

    - `simulated`: whether the recordings come from a simulation; None where the session does not say.
    - `markers`: (label in the files, site of the model).
    - `placement_sd`: m; standard deviation of a marker's place on the body, per axis, against its site.
    - `angles`: (joint of the model, column of the file), for trials whose movement is given by joint angles.
    - `angle_sd`: rad; standard deviation of such an angle.
    - `calibration`: what to calibrate before the trials; None: nothing. `posture`: for models with more joints than
      the markers determine.
    """

    path: Path
    name: str
    subject: str
    simulated: bool | None
    model: Model
    model_source: str
    placement_sd: float
    markers: tuple[tuple[str, str], ...]
    filter: FilterSpec
    contact: ContactSpec
    sources: tuple[SourceSpec, ...]
    trials: tuple[TrialSpec, ...]
    columns: Mapping[str, Any]
    angles: tuple[tuple[str, str], ...] = ()
    angle_sd: float = 0.0
    clock: ClockSpec | None = None
    calibration: CalibrationOptions | None = None
    posture: PosturePrior | None = None

    def source(self, name: str) -> SourceSpec:
        """A source by its name."""
        return next(item for item in self.sources if item.name == name)
