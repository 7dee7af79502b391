"""Compliance along the recording and the reference trajectory of Eq. 1 (section 3.4)."""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from icjax.estimation._contact_compliance import ACCEPTED, contacts_that_load, free_interval
from icjax.estimation._joints import compliant_dofs, dofs_of, yielding_root
from icjax.estimation._options import EstimationOptions
from icjax.interaction import CompliancePerEvent, JointCompliance
from icjax.model import Model, integrate
from icjax.recording import Recording
from icjax.running import on_full_blocks
from icjax.typing import Float, Real

STATED_SD = 0.5
"""Relative standard deviation of a compliance that a model merely states: between the two tasks of the paper's
Table 1 the same joint differs by a factor of two."""


class CompliancePath(NamedTuple):
    """Compliance at every frame and degree of freedom, its standard deviation, and where each value is from."""

    compliance: np.ndarray
    compliance_sd: np.ndarray
    sources: dict[str, tuple[str, ...]]


def compliance_path(
    recording: Recording,
    per_event: CompliancePerEvent,
    summary: JointCompliance,
    options: EstimationOptions | None = None,
) -> CompliancePath:
    """C(t), diagonal: held from each contact event that loads the joint, blended in before the event.

    In the `options.blend` seconds before an onset the compliance goes from the value held so far to the event's,
    along `x^2 (3 - 2 x)`. The blend starts no earlier than the last release, so that it happens where no torque
    acts; only where another contact is still there at the onset does it overlap contact, and C stays continuous.
    Before the first event the joint's default holds. Defaults, in this order: the value in `options.given`, the
    session's pooled value, the value that the model states (`STATED_SD` of it as standard deviation), and zero
    with an infinite standard deviation: the joint is then treated as rigid, and `sources` says so. Each event
    uses its own estimate where it was accepted, its standard error is below its value and `options.source` is
    "event", else the default. Driven
    degrees of freedom have none: zero; a free root yields as the model states (`STATED_SD`).

    **Arguments**

    - `recording`: its time, events and contacts.
    - `per_event`, `summary`: of the session; the events of this recording are found by its name.
    - `options`: see `EstimationOptions`.

    **Returns** arrays `[time, dof]` in rad/Nm and, for each compliant degree of freedom, the source of the default
    followed by that of each event that loads it.

    Source: Kry and Pai 2006, section 3.4; the blend is ours.
    """
    options = options or EstimationOptions()
    model = recording.model
    time = np.asarray(recording.time)
    dofs = compliant_dofs(model)
    defaults = {dof: _default(model, dof, summary, options) for dof in dofs}
    compliance = np.zeros((len(time), model.nv))
    deviation = np.zeros((len(time), model.nv))
    sources = {}
    own = [row for row, name in enumerate(per_event.recording) if name == recording.name]
    for dof, loads in zip(dofs, contacts_that_load(recording, dofs), strict=True):
        value, sd, source = defaults[dof]
        courses = np.stack([np.full(len(time), value), np.full(len(time), sd)])
        used = [source]
        for event, row in enumerate(own):
            if not loads[int(np.asarray(recording.events.contact)[event])]:
                continue
            estimate = _own_estimate(model, dof, per_event, row, options)
            target = estimate or (value, sd)
            used.append("event" if estimate else source)
            weight = _blend_weight(time, recording, event, loads, options.blend)
            courses = _mix(courses, np.asarray(target), weight)
        compliance[:, dof], deviation[:, dof] = courses
        sources[model.dof_names[dof]] = tuple(used)
    for dof in yielding_root(model):
        value, sd, source = _stated(model, dof)
        compliance[:, dof], deviation[:, dof] = value, sd
        sources[model.dof_names[dof]] = (source,)
    return CompliancePath(compliance, deviation, sources)


def reference_trajectory(
    model: Model,
    q: Float[Real, "time coordinate"],
    torque: Float[Real, "time dof"],
    compliance: Float[Real, "time dof"],
) -> Float[Real, "time coordinate"]:
    """`theta_r = theta - C tau` (Eq. 1), the posture that the same intent would give without contact.

    On joints whose coordinates form a group (ball) the difference is taken there, `R_r = R exp(-C tau)`, so that
    `difference(theta_r, theta) = C tau` holds exactly. Equal to `q` wherever the torque is zero, and continuous
    wherever torque and compliance are.

    **Arguments**

    - `q`: measured coordinates, rad or m.
    - `torque`: of the contact forces, Nm.
    - `compliance`: diagonal of C, rad/Nm.

    **Returns** coordinates of the same layout as `q`. Differentiable in every argument.

    Source: Kry and Pai 2006, Eq. 1 and section 3.4.
    """
    return on_full_blocks(partial(_displace, model), q, -compliance * torque)


def reference_deviation(
    recording: Recording,
    torque: Float[np.ndarray, "time dof"],
    compliance: Float[np.ndarray, "time dof"],
    compliance_sd: Float[np.ndarray, "time dof"],
    torque_sd: Float[np.ndarray, "time dof"],
) -> Float[np.ndarray, "time dof"]:
    """Standard deviation of the reference, rad: `sqrt(var q + offset_sd^2 + (tau sd_C)^2 + (C sd_tau)^2)`.

    The four are taken as independent, although angle and torque share the errors of the markers (with C of 1 rad/Nm
    a torque error of 1 mNm is 0.06 degrees). Infinite where a joint of unknown compliance is loaded.
    """
    variance = np.diagonal(np.asarray(recording.q_covariance), axis1=1, axis2=2)
    loaded = torque != 0
    spread = np.where(loaded, torque, 1.0) * np.where(loaded, compliance_sd, 0.0)
    through_torque = np.where(loaded, compliance * torque_sd, 0.0)
    return np.sqrt(variance + np.asarray(recording.q_offset_sd)[None, :] ** 2 + spread**2 + through_torque**2)


@eqx.filter_jit
def _displace(model, q, dq):
    return jax.vmap(lambda a, b: integrate(model, a, b))(q, dq)


def _default(model: Model, dof: int, summary: JointCompliance, options: EstimationOptions) -> tuple[float, float, str]:
    for joint, value in options.given.items():
        if dof in dofs_of(model, joint):
            return value, options.given_sd.get(joint, 0.0), "given"
    name = model.dof_names[dof]
    if name in summary.joint_names:
        index = summary.joint_names.index(name)
        value, upper = float(summary.compliance[index]), float(summary.upper[index])
        if np.isfinite(value):
            return value, (upper - value) / 1.96, "session"
    return _stated(model, dof)


def _stated(model: Model, dof: int) -> tuple[float, float, str]:
    stated = float(model.compliance[dof])
    if np.isfinite(stated):
        return stated, STATED_SD * stated, "stated by the model"
    return 0.0, np.inf, "unknown, treated as rigid"


def _own_estimate(
    model: Model, dof: int, per_event: CompliancePerEvent, row: int, options: EstimationOptions
) -> tuple[float, float] | None:
    name = model.dof_names[dof]
    given = any(dof in dofs_of(model, joint) for joint in options.given)
    if options.source == "session" or given or name not in per_event.joint_names:
        return None
    column = per_event.joint_names.index(name)
    if int(per_event.status[row, column]) != ACCEPTED:
        return None
    value, error = float(per_event.compliance[row, column]), float(per_event.standard_error[row, column])
    return (value, error) if error < value else None


def _blend_weight(time: np.ndarray, recording: Recording, event: int, loads: np.ndarray, blend: float) -> np.ndarray:
    """0 before the blend, 1 from the onset on."""
    onset = float(np.asarray(recording.events.onset)[event])
    free_from, _ = free_interval(recording.events, event, loads)
    start = onset - blend if free_from >= onset else max(onset - blend, free_from)
    if start >= onset:
        return (time >= onset).astype(float)
    x = np.clip((time - start) / (onset - start), 0.0, 1.0)
    return x**2 * (3.0 - 2.0 * x)


def _mix(courses: np.ndarray, target: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Blend value and deviation to the target; a deviation that is infinite on one side jumps at the onset."""
    blended = np.where(weight < 1, courses, target[:, None])
    for row, goal in enumerate(target):
        inner = (weight > 0) & (weight < 1) & np.isfinite(courses[row]) & np.isfinite(goal)
        blended[row, inner] = courses[row, inner] + weight[inner] * (goal - courses[row, inner])
    return blended
