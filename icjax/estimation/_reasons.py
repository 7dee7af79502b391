"""Why an estimate was accepted or not, in words and numbers, one sentence an event and joint."""

import numpy as np

from icjax.estimation._contact_compliance import ACCEPTED, NEGATIVE, NOT_EXCITED, TOO_FEW
from icjax.estimation._excitation import Excitation
from icjax.estimation._options import EstimationOptions
from icjax.estimation._sensitivity import Sensitivity
from icjax.interaction import STATUS, CompliancePerEvent

LEVERAGE = 0.1
"""Below it the force counts as pointing through the joint: one degree of its direction is 17 % of the torque."""
ISOTROPY = 0.05
"""Below it the finger counts as straight: two segments of equal length bent 14 degrees against each other."""


def explain(
    per_event: CompliancePerEvent,
    excitation: Excitation,
    sensitivity: Sensitivity | None = None,
    options: EstimationOptions | None = None,
) -> tuple[tuple[str, ...], ...]:
    """What decided on each estimate, and what speaks against it although it was accepted.

    First the status with its numbers, then, where they apply: the force points through the joint (`leverage`
    below 0.1), the finger is straight (`isotropy` below 0.05), the joint yields by less than the noise of its
    angle (`resolution` above the estimate), and the verdict of `sensitivity`.

    **Arguments**

    - `per_event`, `excitation`, `sensitivity`: of the same recordings and joints; the first two with the windows of
      `options`.
    - `options`: those of the estimate.

    **Returns** `[event][joint]` text.

    **Errors**: `ValueError` where the records differ in events or joints.

    Source: Kry and Pai 2006, section 4.3.
    """
    for name, other in (("excitation", excitation), ("sensitivity", sensitivity)):
        if other is not None and (
            other.joint_names != per_event.joint_names
            or other.recording != per_event.recording
            or not np.array_equal(np.asarray(other.onset), np.asarray(per_event.onset))
        ):
            raise ValueError(f"{name}: its events or joints are not those of the estimates")
    return tuple(
        tuple(
            "; ".join(_points(per_event, excitation, sensitivity, options or EstimationOptions(), event, joint))
            for joint in range(len(per_event.joint_names))
        )
        for event in range(len(per_event.onset))
    )


def _points(
    per_event: CompliancePerEvent,
    excitation: Excitation,
    sensitivity: Sensitivity | None,
    options: EstimationOptions,
    event: int,
    joint: int,
) -> list[str]:
    at = event, joint
    status = int(per_event.status[at])
    value, error = float(per_event.compliance[at]), float(per_event.standard_error[at])
    word = STATUS[status]
    if status == TOO_FEW:
        counts = zip(
            np.asarray(excitation.samples)[at], np.asarray(excitation.wanted), ("before", "after"), strict=True
        )
        told = " and ".join(f"{min(found, wanted)} of {wanted} frames {side}" for found, wanted, side in counts)
        return [f"{word}: {told} the contact are usable"]
    leverage, noise = float(excitation.leverage[at]), float(excitation.torque_noise[at])
    if status == NOT_EXCITED and np.isnan(noise) and np.isnan(leverage):
        return [f"{word}: the contact is not beyond this joint"]
    if status == NOT_EXCITED:
        change = 1e3 * abs(float(per_event.torque_change[at]))
        least = f"{1e3 * options.least_torque:g} mNm and {options.excitation:g} times its noise"
        points = [
            f"{word}: the torque has changed by {change:.2g} mNm at the window's end, with {1e3 * noise:.2g} mNm "
            f"of noise; needed are {least}, and likewise its slope"
        ]
    else:
        points = [f"{word}: {value:.3g} ± {error:.2g} rad/Nm"]
    if status == NEGATIVE:
        points[0] += ", the joint moved against the torque"
    if leverage < LEVERAGE:
        share = np.radians(1.0) * np.sqrt(1.0 - leverage**2) / max(leverage, 1e-9)
        points.append(
            f"the force points nearly through the joint (leverage {leverage:.2g}: one degree of its direction is "
            f"{min(100 * share, 999):.0f} % of the torque)"
        )
    if float(excitation.isotropy[event]) < ISOTROPY:
        points.append(f"the finger is nearly straight (isotropy {float(excitation.isotropy[event]):.2g})")
    resolution = float(excitation.resolution[at])
    if status in (ACCEPTED, NEGATIVE) and resolution > abs(value):
        points.append(f"the joint yields by less than the noise of its angle ({resolution:.2g} rad/Nm would equal it)")
    if sensitivity is not None and status != NOT_EXCITED:
        verdict = sensitivity.reason[event][joint]
        points.append(verdict if bool(sensitivity.stable[at]) else f"unstable, {verdict}")
    return points
