# pyright: reportGeneralTypeIssues=false
# (the checker does not see that `labelled`, `names` and `static` declare fields without a default)
"""Hinge 1: what was measured. Nothing downstream knows which files or instruments it came from."""

import os

import equinox as eqx

from icjax.files import labelled, load_record, names, optional, record_kind, save_record, static
from icjax.model import Model
from icjax.typing import Bool, Float, Int, Real

NORMAL_ONLY = ("normal", "pressure_array")
"""Kinds of instrument that measure no tangential force: torques are biased, friction is unknown."""

ROLES = ("trial", "catch", "static", "range_of_motion")


class ContactEvents(eqx.Module):
    """Intervals of contact, in order of onset."""

    onset: Float[Real, " event"] = labelled("event", unit="s", doc="first touch, between samples")
    release: Float[Real, " event"] = labelled("event", unit="s", doc="NaN if still touching at the end")
    contact: Int[Real, " event"] = labelled("event", unit="1", doc="index of the contact channel")


class SensorChannels(eqx.Module):
    """Calibrated and tared wrenches of every force source at its own rate, before it met the marker clock.

    The wrench acts on the subject, world axes, moment about the world origin: (moment, force).
    """

    sensor_names: tuple[str, ...] = names("sensor")
    time: Float[Real, " sample"] = labelled("sample", unit="s", doc="marker clock")
    wrench: Float[Real, "sample sensor 6"] = labelled("sample", "sensor", "component", unit="Nm and N")


class Recording(eqx.Module):
    """One trial: joint angles with covariance, contact forces and points, events, and what they came from.

    Forces act on the subject and are given in world axes. `contact_moment` is the free moment about the contact
    point (zero for a point contact). A contact point is NaN where nothing touches.
    """

    name: str = static()
    role: str = static()  # one of ROLES
    catch_of: str | tuple[str, ...] | None = static()  # trials whose movement this catch trial repeats
    model: Model
    time: Float[Real, " time"] = labelled("time", unit="s", doc="marker clock")
    q: Float[Real, "time coordinate"] = labelled("time", "coordinate", unit="rad or m")
    q_covariance: Float[Real, "time dof dof"] = labelled(
        "time", "dof", "dof2", unit="rad2 or m2", doc="of the frame-to-frame error"
    )
    q_offset_sd: Float[Real, " dof"] = labelled(
        "dof", unit="rad or m", doc="standard deviation of the constant offset that marker placement leaves"
    )
    valid: Bool[Real, " time"] = labelled("time", unit="1", doc="false where markers were too few for the pose")
    contact_names: tuple[str, ...] = names("contact")
    contact_bodies: tuple[str, ...] = static()
    contact_force: Float[Real, "time contact 3"] = labelled("time", "contact", "axis", unit="N")
    contact_point: Float[Real, "time contact 3"] = labelled("time", "contact", "axis", unit="m")
    contact_moment: Float[Real, "time contact 3"] = labelled("time", "contact", "axis", unit="Nm")
    touching: Bool[Real, "time contact"] = labelled("time", "contact", unit="1")
    events: ContactEvents
    marker_names: tuple[str, ...] = names("marker")
    markers: Float[Real, "time marker 3"] = labelled("time", "marker", "axis", unit="m", doc="NaN in gaps")
    marker_residual: Float[Real, "time marker"] = labelled("time", "marker", unit="m", doc="distance to the model")
    channels: SensorChannels
    friction: float | None = static()  # of the touched surface, where the session states it
    provenance: str = static()  # JSON text: files, rates, units found, filters, versions, seed
    contact_kinds: tuple[str, ...] = static(())  # instrument of each contact; empty in older files: all six components
    q_offset_covariance: Float[Real, "dof dof"] | None = optional(
        "dof", "dof2", unit="rad2 or m2", doc="of the constant offset; its diagonal is q_offset_sd squared"
    )
    contact_force_sd: Float[Real, " contact"] | None = optional(
        "contact", unit="N", doc="noise of the force, per axis, after the filter"
    )
    contact_point_sd: Float[Real, "time contact"] | None = optional(
        "time",
        "contact",
        unit="m",
        doc="standard deviation of the contact point along the surface; NaN without contact",
    )

    def __check_init__(self):
        """**Errors**: `ValueError` for a text field that holds none."""
        for field in ("name", "role", "provenance"):
            if not isinstance(getattr(self, field), str):
                raise ValueError(f"recording: {field} is {getattr(self, field)!r}, not text")
        if not all(isinstance(item, str) for item in self.repeats):
            raise ValueError(f"recording {self.name!r}: catch_of is {self.catch_of!r}, not names of trials")

    @property
    def repeats(self) -> tuple[str, ...]:
        """Names of the trials whose movement this one is without the surface; none but of a catch trial."""
        if self.catch_of is None:
            return ()
        return (self.catch_of,) if isinstance(self.catch_of, str) else tuple(self.catch_of)

    @property
    def normal_only(self) -> tuple[str, ...]:
        """Names of the contacts whose instrument measures no tangential force."""
        pairs = zip(self.contact_names, self.contact_kinds, strict=False)
        return tuple(name for name, kind in pairs if kind in NORMAL_ONLY)

    @property
    def rate(self) -> float:
        """Samples a second."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0])

    def save(self, path: str | os.PathLike) -> None:
        """Write one labelled netCDF file, complete or not at all."""
        save_record(path, self)

    @staticmethod
    def load(path: str | os.PathLike) -> "Recording":
        """Read a recording back, equal to what was saved. **Errors**: `FileError` naming the file."""
        return load_record(path, Recording)


class Session(eqx.Module):
    """Several recordings of one subject: trials, their catch trials, static and range-of-motion parts."""

    name: str = static()
    subject: str = static()
    recordings: tuple[Recording, ...]

    def trials(self) -> tuple[Recording, ...]:
        """The recordings in which something was touched on purpose."""
        return tuple(item for item in self.recordings if item.role == "trial")

    def catch_trials(self, of: str) -> tuple[Recording, ...]:
        """The repetitions of a trial's movement with the surface taken away."""
        return tuple(item for item in self.recordings if item.role == "catch" and of in item.repeats)

    def save(self, path: str | os.PathLike) -> None:
        """Write one netCDF file with a group a recording, complete or not at all."""
        save_record(path, self)

    @staticmethod
    def load(path: str | os.PathLike) -> "Session":
        """Read a session, or a single recording as a session of one. **Errors**: `FileError`."""
        if record_kind(path) == "Recording":
            recording = Recording.load(path)
            return Session(name=recording.name, subject="", recordings=(recording,))
        return load_record(path, Session)
