# pyright: reportGeneralTypeIssues=false
# (the checker does not see that `labelled`, `names` and `static` declare fields without a default)
"""Hinge 2: how the subject moved. Joint compliance C and reference trajectory theta_r, with their uncertainty."""

import json
import os
from typing import Any

import equinox as eqx
import numpy as np

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

    @staticmethod
    def of(model: Model, time: Any, reference: Any, compliance: Any, *, name: str = "stated") -> "Interaction":
        """A movement that was thought of and not recorded; all standard errors are zero.

        **Arguments**: `time` s `[time]`; `reference` theta_r `[time, nq]`; `compliance` C, constant `[nv]` or full
        `[nv, nv]`, or of every time.

        **Errors**: `ValueError` for sizes that do not agree.
        """
        time, reference, C = (np.asarray(x, float) for x in (time, reference, compliance))
        count, nv = len(time), model.nv
        if reference.shape != (count, model.nq):
            raise ValueError(f"reference must be [{count}, {model.nq}]; got {list(reference.shape)}")
        if C.shape not in ((nv,), (count, nv), (nv, nv), (count, nv, nv)):
            raise ValueError(f"compliance must be [{nv}] or [{nv}, {nv}], or {count} of these; got {list(C.shape)}")
        square = C.shape[-2:] == (nv, nv) and (C.ndim == 3 or count != nv)
        C = np.broadcast_to(C, (count, *C.shape[-2 if square else -1 :]))
        diagonal, still = np.diagonal(C, axis1=1, axis2=2) if square else C, np.zeros((count, nv))
        none, whole = np.zeros((0, 0)), np.zeros(0, int)
        return Interaction(
            name=name,
            model=model,
            time=time,
            compliance=np.array(diagonal),
            compliance_sd=still,
            reference=reference,
            reference_sd=still,
            q=reference,
            torque=still,
            contact_names=(),
            contact_force=np.zeros((count, 0, 3)),
            contact_point=np.zeros((count, 0, 3)),
            per_event=CompliancePerEvent(
                recording=(), joint_names=(), onset=np.zeros(0), compliance=none, standard_error=none,
                status=none.astype(int), r_squared=np.zeros((0, 0, 3)), torque_change=none,
                angle_before=np.zeros((0, 0, 2)), angle_after=np.zeros((0, 0, 2)), torque_after=np.zeros((0, 0, 2)),
                window=np.zeros(2),
            ),
            summary=JointCompliance(
                joint_names=(), compliance=np.zeros(0), lower=np.zeros(0), upper=np.zeros(0), accepted=whole,
                negative=whole, events=whole,
            ),
            friction=None,
            provenance=json.dumps({"compliance and reference": "stated"}),
            full_compliance=np.array(C) if square else None,
        )  # fmt: skip

    def save(self, path: str | os.PathLike) -> None:
        """Write one labelled netCDF file, complete or not at all."""
        save_record(path, self)

    @staticmethod
    def load(path: str | os.PathLike) -> "Interaction":
        """Read an interaction back, equal to what was saved. **Errors**: `FileError` naming the file."""
        return load_record(path, Interaction)
