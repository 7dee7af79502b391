"""A session to the interaction trajectories of its trials."""

import dataclasses
import json
from collections.abc import Callable, Collection, Iterator

import numpy as np

from icjax import __version__
from icjax.estimation._contact_compliance import compliance_at_contact
from icjax.estimation._joints import compliant_dofs, dofs_of
from icjax.estimation._options import EstimationOptions
from icjax.estimation._reference import compliance_path, reference_deviation, reference_trajectory
from icjax.estimation._summary import summarise
from icjax.estimation._torque import joint_torque
from icjax.estimation._torque_error import TorqueDeviation, torque_deviation
from icjax.interaction import STATUS, CompliancePerEvent, Interaction, JointCompliance
from icjax.recording import Recording, Session


def estimate(
    session: Session,
    options: EstimationOptions | None = None,
    progress: Callable[[float], object] | None = None,
) -> tuple[Interaction, ...]:
    """Joint compliance and reference trajectory of every trial of a session, by the method of the paper.

    Joint torques (Eq. 2) at every frame, compliance at every contact event (section 3.3), one pooled value a
    joint over the session, and the reference trajectory (Eq. 1, section 3.4). Catch trials and other recordings
    in which nothing is touched are not used by this method. Where something touches while the pose is unknown
    (`valid` is false), torque and reference are NaN; where nothing touches the reference is the recorded `q`, valid
    or not. `per_event` and `summary` are those of the session
    and the same in every result; `per_event.recording` says which trial an event is from.

    **Arguments**

    - `session`: at least one recording with the role "trial".
    - `options`: windows, polynomial degree, known compliances; the defaults of `EstimationOptions`.
    - `progress`: called with the fraction done, 0 to 1.

    **Returns** one `Interaction` a trial, in the session's order.

    **Errors**: `ValueError` for a session without trials, a trial without contact forces, trials of different
    models, an unknown joint, or no contact event in any trial (unless every compliant joint is given).

    Source: Kry and Pai 2006, sections 3.3, 3.4, 4.3.
    """
    return tuple(estimates(session, options, progress))


def estimates(
    session: Session,
    options: EstimationOptions | None = None,
    progress: Callable[[float], object] | None = None,
    wanted: Collection[str] | None = None,
) -> Iterator[Interaction]:
    """The interactions of `estimate` one after the other, so that a long session's need not be held together.

    **Arguments**: as for `estimate`; `wanted` names the trials whose interaction is made, default all (compliance is
    pooled over all of them in any case).
    """
    options = options or EstimationOptions()
    report = progress or (lambda fraction: None)
    trials = session.trials()
    _check(session, trials, options)
    torques, deviations = [], []
    for done, recording in enumerate(trials):
        torques.append(np.asarray(joint_torque(recording)))
        deviations.append(torque_deviation(recording))
        report(0.4 * (done + 1) / len(trials))
    per_event = compliance_at_contact(trials, options, tuple(torques), tuple(deviations))
    summary = summarise(per_event, options.pool_negative)
    report(0.6)
    for done, (recording, torque, deviation) in enumerate(zip(trials, torques, deviations, strict=True)):
        if wanted is None or recording.name in wanted:
            yield _interaction(session, recording, torque, deviation, per_event, summary, options)
        report(0.6 + 0.4 * (done + 1) / len(trials))


def _check(session: Session, trials: tuple[Recording, ...], options: EstimationOptions) -> None:
    if not trials:
        roles = ", ".join(item.role for item in session.recordings) or "none"
        raise ValueError(f"session {session.name!r}: no recording with the role 'trial' (roles: {roles})")
    model = trials[0].model
    known = {dof for name in options.given for dof in dofs_of(model, name)}
    for recording in trials:
        if not recording.contact_names:
            raise ValueError(f"trial {recording.name!r}: no contact forces, so no joint torque to estimate from")
        if recording.model.dof_names != model.dof_names:
            raise ValueError(f"trial {recording.name!r}: its model differs from that of {trials[0].name!r}")
    if not known >= set(compliant_dofs(model)) and not any(len(item.events.onset) for item in trials):
        names = ", ".join(item.name for item in trials)
        raise ValueError(f"session {session.name!r}: no contact event in its trials ({names})")


def _interaction(
    session: Session,
    recording: Recording,
    torque: np.ndarray,
    deviation: TorqueDeviation,
    per_event: CompliancePerEvent,
    summary: JointCompliance,
    options: EstimationOptions,
) -> Interaction:
    path = compliance_path(recording, per_event, summary, options)
    q = np.asarray(recording.q)
    return Interaction(
        name=recording.name,
        model=recording.model,
        time=np.asarray(recording.time),
        compliance=path.compliance,
        compliance_sd=path.compliance_sd,
        reference=np.asarray(reference_trajectory(recording.model, q, torque, path.compliance)),
        reference_sd=reference_deviation(recording, torque, path.compliance, path.compliance_sd, deviation.total),
        q=q,
        torque=torque,
        contact_names=recording.contact_names,
        contact_force=np.asarray(recording.contact_force),
        contact_point=np.asarray(recording.contact_point),
        per_event=per_event,
        summary=summary,
        friction=recording.friction,
        provenance=_provenance(session, recording, per_event, path.sources, options),
        torque_sd=deviation.total,
    )


def _provenance(
    session: Session,
    recording: Recording,
    per_event: CompliancePerEvent,
    sources: dict[str, tuple[str, ...]],
    options: EstimationOptions,
) -> str:
    status = np.asarray(per_event.status)
    change = np.abs(np.asarray(per_event.torque_change))
    joints = {
        name: {
            "status": {text: int(np.sum(status[:, j] == code)) for code, text in enumerate(STATUS)},
            "median_torque_change_Nm": _median(change[:, j]),
            "source": list(sources.get(name, ())),
        }
        for j, name in enumerate(per_event.joint_names)
    }
    return json.dumps(
        {
            "estimator": "compliance at contact (Kry and Pai 2006, section 3.3)",
            "caution": "intervals cover noise and scatter of events, not the bias that inertia, damping and "
            "planned deceleration after contact cause",
            "normal_only": sorted({name for item in session.trials() for name in item.normal_only}),
            "session": session.name,
            "subject": session.subject,
            "trials": [item.name for item in session.trials()],
            "options": dataclasses.asdict(options),
            "joints": joints,
            "sources": {name: list(used) for name, used in sources.items()},
            "icjax": __version__,
            "recording": json.loads(recording.provenance) if recording.provenance else None,
        }
    )


def _median(values: np.ndarray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else None
