"""A fit in memory to the record of it."""

import dataclasses
import json

import equinox as eqx
import numpy as np

from icjax import __version__
from icjax.estimation import estimates
from icjax.fit._contacts import apparent
from icjax.fit._drift import drift
from icjax.fit._periods import Changes
from icjax.fit._problem import Problem, intervals
from icjax.fit._profile import Profile, profile
from icjax.fit._record import FitPeriods, FitRecord, FitWindows
from icjax.fit._reference import contact_free
from icjax.fit._result import SessionFit
from icjax.fit._solve import linearised, solve
from icjax.interaction import JointCompliance
from icjax.recording import Session
from icjax.results import RESULTS
from icjax.typing import Float

NO_PRIOR = 10.0
"""Standard deviation of log C that says next to nothing."""


def fit_record(
    fit: SessionFit, session: Session, paper: JointCompliance | None = None, *, profiles: bool = False
) -> FitRecord:
    """What `fit_session` found in a session, with the reference of `contact_free`, ready to be saved.

    **Arguments**: `fit` of this `session`; `paper` the summary of `icjax.estimation.estimate` on it, made here if not
    given; `profiles` whether intervals by profile likelihood are made too, a few seconds a joint.

    **Errors**: those of `profile`, and `ValueError` for `profiles` of a compliance that changes.
    """
    made = fit.made
    trials = session.trials()
    count, repeated, alone = len(made.dof_names), made.expected.variability, made.expected.movement
    if paper is None:
        paper = next(estimates(session, wanted=(trials[0].name,))).summary
    refused = tuple(joint.refused for joint in fit.joints)
    ends = _profiles(fit) if profiles else np.full((2, count), np.nan)
    return FitRecord(
        name=session.name,
        subject=session.subject,
        trials=tuple(item.name for item in trials),
        catch_trials=len({catch.name for item in trials for catch in session.catch_trials(item.name)}),
        joint_names=made.dof_names,
        joint_kinds=_kinds(fit),
        compliance=np.array([joint.compliance for joint in fit.joints]),
        lower=np.array([joint.lower for joint in fit.joints]),
        upper=np.array([joint.upper for joint in fit.joints]),
        width=np.array([joint.width for joint in fit.joints]),
        learned=np.array([joint.learned for joint in fit.joints]),
        profile=ends,
        refused=refused,
        chi2=float(fit.chi2),
        result=_result(fit),
        warnings=(*fit.warnings, *wide_profiles(made.dof_names, refused, ends, fit.options.widest)),
        periods=_periods(fit),
        parameters=fit.parameters,
        windows=_windows(fit),
        variability=np.full((2, count), np.nan) if repeated is None else np.asarray(repeated.amplitude),
        noise=np.full(count, np.nan) if repeated is None else np.asarray(repeated.noise),
        inflation=1.0 if repeated is None else float(repeated.inflation),
        planned_movement=np.full((4, count), np.nan) if alone is None else np.stack(alone[:4]),
        planned_inflation=1.0 if alone is None else float(alone.inflation),
        paper=paper,
        options=json.dumps(dataclasses.asdict(fit.options)),
        provenance=_provenance(fit, session),
    )


def _periods(fit: SessionFit) -> FitPeriods:
    compliance, lower, upper, refused = (
        np.array([[getattr(joint, field) for joint in row] for row in fit.periods])
        for field in ("compliance", "lower", "upper", "refused")
    )
    one = np.ones((1, len(fit.made.dof_names)))
    changes = fit.changes or Changes(one, one, one, np.array([[joint.learned for joint in fit.joints]]))
    return FitPeriods(fit.made.periods, fit.made.dof_names, compliance, lower, upper, refused != "", *changes)


def _profiles(fit: SessionFit) -> np.ndarray:
    """Ends of the intervals of C [end, joint], as much wider as Laplace's are for what is not known of variability.

    **Errors**: `ValueError` where compliance changes: the mean of several is no number of the fit.
    """
    if len(fit.periods) > 1:
        raise ValueError(
            f"profiles are of one compliance a joint; this fit has {len(fit.periods)} (compliance_by = "
            f"{fit.options.compliance_by!r})"
        )
    problem, x = fit.made.problem, np.asarray(fit.solution.value.x)
    place = problem.parameters.slices["compliance"]
    found = [_alone(problem, x, index) for index in range(place.start, place.stop)]
    _, data, prior = linearised(problem, fit.solution.value.x)
    wider = np.asarray(fit.laplace.sd / intervals(np.asarray(data), np.asarray(prior)).sd)[place]
    ends = np.array([[item.lower for item in found], [item.upper for item in found]])
    return np.exp(x[place] + wider * (ends - x[place]))


def wide_profiles(
    names: tuple[str, ...], refused: tuple[str, ...], ends: Float[np.ndarray, "end joint"], widest: float
) -> tuple[str, ...]:
    """A line for each joint that has a number, though its interval by profile likelihood would refuse it."""
    with np.errstate(divide="ignore"):
        width = ends[1] / ends[0]
    return tuple(
        f"{name}: by profile likelihood the ends of its interval differ by a factor of {factor:.3g}, {widest:g} at "
        "most; take it as refused"
        for name, why, factor in zip(names, refused, width, strict=True)
        if not why and factor > widest
    )


def _alone(problem: Problem, x: np.ndarray, index: int) -> Profile:
    """Profile of one number without its own prior."""
    of = problem.parameters.of
    which = next(at for at, item in enumerate(of) if item.name == "compliance")
    sd = np.full(of[which].size, np.asarray(of[which].prior_sd, float))
    sd[index - problem.parameters.slices["compliance"].start] = NO_PRIOR
    free = eqx.tree_at(lambda p: p.parameters.of[which].prior_sd, problem, sd)
    return profile(free, np.asarray(solve(free, x).value.x), index)


def _kinds(fit: SessionFit) -> tuple[str, ...]:
    motion = next(iter(fit.made.motions.values()))
    model = motion.recording.model
    kinds = {
        dof: str(kind)
        for kind, span in zip(model.joint_types, model.dof_slices, strict=True)
        for dof in range(span.start, span.stop)
    }
    return tuple(kinds[dof] for dof in motion.dofs)


def _result(fit: SessionFit) -> str:
    found = int(np.asarray(fit.solution.result._value))
    return next(name for name, item in RESULTS._name_to_item.items() if int(np.asarray(item._value)) == found)


def _windows(fit: SessionFit) -> FitWindows:
    """Rows of every window, filled up with NaN."""
    made, found = fit.made, contact_free(fit)
    shape = found.deviation.shape
    data = np.asarray(made.problem.data(fit.solution.value.x))[: found.deviation.size].reshape(shape)
    time, angle, repetition, torque, residual = np.full(shape[:2], np.nan), *(np.full(shape, np.nan) for _ in range(4))
    onset = []
    for number, window in enumerate(made.windows):
        motion, count = made.motions[window.trial], len(window.samples)
        time[number, :count] = np.asarray(motion.recording.time)[window.samples]
        angle[number, :count] = motion.angle[window.samples]
        expected = [item.angle for item in window.repetitions] or [np.tile(angle[number, :1], (count, 1))]
        repetition[number, :count] = np.mean(expected, axis=0)
        torque[number, :count] = motion.torque[window.samples]
        residual[number, :count] = data[number, :count]
        onset.append(float(np.asarray(motion.recording.events.onset)[window.event]))
    drifted = drift(fit, residual)
    residual /= np.array([apparent(window) for window in made.windows])[:, None, None]
    return FitWindows(
        trial=tuple(window.trial for window in made.windows),
        joint_names=made.dof_names,
        event=np.array([window.event for window in made.windows]),
        onset=np.array(onset),
        repetitions=np.array([len(window.repetitions) for window in made.windows]),
        time=time,
        angle=angle,
        repetition=repetition,
        deviation=found.deviation,
        drift=drifted.mean,
        drift_sd=drifted.sd,
        reference=found.angle,
        reference_sd=found.sd,
        torque=torque,
        residual=residual,
        correlation=found.correlation,
    )


def _provenance(fit: SessionFit, session: Session) -> str:
    first = session.trials()[0].provenance
    return json.dumps(
        {
            "estimator": "dynamic response after contact against catch trials (without them against movement "
            "foretold from before contact), Levenberg-Marquardt, intervals by the rise of the cost",
            "caution": f"intervals hold if the model holds: compliance constant in every {fit.options.compliance_by}, "
            "linear damping, masses and offsets "
            "within their priors, repetitions that vary as the catch trials do",
            "session": session.name,
            "subject": session.subject,
            "normal_only": sorted({name for item in session.trials() for name in item.normal_only}),
            "stats": {key: float(value) for key, value in fit.solution.stats.items()},
            "icjax": __version__,
            "recording": json.loads(first) if first else None,
        }
    )
