# pyright: reportGeneralTypeIssues=false
# (the checker does not see that `labelled`, `names` and `static` declare fields without a default)
"""Hinge 2: how the subject moved. Joint compliance C and reference trajectory theta_r, with their uncertainty."""

import os

import equinox as eqx

from icjax.files import labelled, load_record, names, optional, save_record, static
from icjax.model import Model
from icjax.typing import Float, Int, Real

STATUS = ("accepted", "negative", "not excited", "too few samples")
"""Meaning of `CompliancePerEvent.status`, by its number."""


class CompliancePerEvent(eqx.Module):
    """The estimate of section 3.3 at every contact event and joint, kept whether or not it is usable.

    The polynomials are in s = t - onset, lowest degree first, so that a figure can draw what was fitted:
    angle before and after contact, torque after contact.
    """

    recording: tuple[str, ...] = names("event")
    joint_names: tuple[str, ...] = names("joint")
    onset: Float[Real, " event"] = labelled("event", unit="s")
    compliance: Float[Real, "event joint"] = labelled("event", "joint", unit="rad/Nm")
    standard_error: Float[Real, "event joint"] = labelled("event", "joint", unit="rad/Nm")
    status: Int[Real, "event joint"] = labelled("event", "joint", unit="1", doc="index into STATUS")
    r_squared: Float[Real, "event joint 3"] = labelled(
        "event", "joint", "fit", unit="1", doc="angle before, angle after, torque after"
    )
    torque_change: Float[Real, "event joint"] = labelled("event", "joint", unit="Nm", doc="excitation in the window")
    angle_before: Float[Real, "event joint degree"] = labelled("event", "joint", "degree", unit="rad/s^k")
    angle_after: Float[Real, "event joint degree"] = labelled("event", "joint", "degree", unit="rad/s^k")
    torque_after: Float[Real, "event joint degree"] = labelled("event", "joint", "degree", unit="Nm/s^k")
    window: Float[Real, " side"] = labelled("side", unit="s", doc="length before and after the onset")


class JointCompliance(eqx.Module):
    """One number a joint with its 95 % interval, and how many events it rests on."""

    joint_names: tuple[str, ...] = names("joint")
    compliance: Float[Real, " joint"] = labelled("joint", unit="rad/Nm")
    lower: Float[Real, " joint"] = labelled("joint", unit="rad/Nm")
    upper: Float[Real, " joint"] = labelled("joint", unit="rad/Nm")
    accepted: Int[Real, " joint"] = labelled("joint", unit="1")
    negative: Int[Real, " joint"] = labelled("joint", unit="1")
    events: Int[Real, " joint"] = labelled("joint", unit="1")


class Interaction(eqx.Module):
    """Interaction trajectory of one recording: theta = theta_r + C tau (Eq. 1).

    `compliance` is zero on driven degrees of freedom (a moving root). `reference` equals the measured `q`
    without contact. `full_compliance`, where joints are coupled, is what a transfer uses instead of the diagonal.
    """

    name: str = static()
    model: Model
    time: Float[Real, " time"] = labelled("time", unit="s")
    compliance: Float[Real, "time dof"] = labelled("time", "dof", unit="rad/Nm")
    compliance_sd: Float[Real, "time dof"] = labelled("time", "dof", unit="rad/Nm")
    reference: Float[Real, "time coordinate"] = labelled("time", "coordinate", unit="rad or m")
    reference_sd: Float[Real, "time dof"] = labelled("time", "dof", unit="rad or m")
    q: Float[Real, "time coordinate"] = labelled("time", "coordinate", unit="rad or m", doc="as measured")
    torque: Float[Real, "time dof"] = labelled("time", "dof", unit="Nm", doc="of the contact force, Eq. 2")
    contact_names: tuple[str, ...] = names("contact")
    contact_force: Float[Real, "time contact 3"] = labelled("time", "contact", "axis", unit="N", doc="as measured")
    contact_point: Float[Real, "time contact 3"] = labelled("time", "contact", "axis", unit="m", doc="as measured")
    per_event: CompliancePerEvent
    summary: JointCompliance
    friction: float | None = static()
    provenance: str = static()  # JSON text
    torque_sd: Float[Real, "time dof"] | None = optional(
        "time", "dof", unit="Nm", doc="standard deviation of the torque, from joint angles, forces and contact points"
    )

    full_compliance: Float[Real, "time dof dof2"] | None = optional(
        "time", "dof", "dof2", unit="rad/Nm", doc="symmetric C of coupled joints; `compliance` is its diagonal"
    )

    def save(self, path: str | os.PathLike) -> None:
        """Write one labelled netCDF file, complete or not at all."""
        save_record(path, self)

    @staticmethod
    def load(path: str | os.PathLike) -> "Interaction":
        """Read an interaction back, equal to what was saved. **Errors**: `FileError` naming the file."""
        return load_record(path, Interaction)
