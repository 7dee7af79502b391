"""A session to a problem: its contacts, its repetitions, and what is not known of subject and instruments."""

import dataclasses
import itertools
from collections import Counter
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from icjax.estimation import compliant_dofs
from icjax.fit._carried import moved_aside
from icjax.fit._contacts import Expected, Window, expectation, measured
from icjax.fit._copies import copied
from icjax.fit._inertia import segment_groups
from icjax.fit._options import FitOptions
from icjax.fit._parameters import Parameter, Parameters
from icjax.fit._problem import Problem
from icjax.fit._repetitions import LONGEST_SHIFT, aligned, alike
from icjax.fit._windows import SMEAR, Motion, contact_frames, motion_of, without_contact
from icjax.inference import Identity, Log
from icjax.model import Model
from icjax.recording import Session

LEAST_EVENTS = 3
"""Contacts below which nothing is fitted: four joints and their dampers cannot be told apart by fewer."""

LEAST_AFTER = 0.03
"""s; a contact that is released sooner tells nothing."""

UNEVEN = 0.2
"""Of the time from frame to frame, by which one may differ."""

NO_TORQUE = 1e-6
"""Nm."""

EARLIER = 0.3
"""Of the largest torque of a contact, which none may reach before its onset."""

LEAST_FRAMES = 4
"""Of a catch trial, through which its angles are interpolated."""

GAIN_SD, DELAY_SD = 0.01, 0.0005
"""Of a calibrated force sensor's gain, and of its clock against the cameras', s."""


class SessionProblem(NamedTuple):
    """What `session_problem` made: the problem, the motions and windows behind it, and what was expected of them.

    `periods` names those in which compliance is one: the session, every trial or every contact. `left_out` has a line
    about contacts that are not compared, and one about catch trials that are not used.
    """

    problem: Problem
    motions: dict[str, Motion]
    windows: tuple[Window, ...]
    groups: np.ndarray
    dof_names: tuple[str, ...]
    expected: Expected
    left_out: tuple[str, ...] = ()
    periods: tuple[str, ...] = ("session",)


def session_problem(session: Session, options: FitOptions | None = None) -> SessionProblem:
    """The dynamic equilibrium after every contact of a session as one problem of least squares.

    The mean of a trial's catch trials is its reference, their spread (`learn`) its covariance; a catch trial may be one
    of several trials, whose references then err alike (`of_mean`). Without them a planned
    deceleration after contact cannot be told from compliance, whatever else is measured: the reference of such a trial
    is foretold from the movement before contact by a Gaussian process learnt from free movement (`PlannedMovement`),
    once for each contact, and once more for what all contacts of the session may have in common (`Common`, `alike`): a
    subject who always brakes at the surface, harder where faster. Intervals are as wide as that leaves them.

    Catch trials count where they know the pose and nothing touches. A contact that cannot be compared (too short, no
    free movement before it, gaps, catch trials that end before it) is left out.

    **Errors**: `ValueError` for a session without trials, contact forces, poses or masses, with trials of different
    models, contacts or rates, with a trial or a catch trial that is a copy, with fewer than `LEAST_EVENTS` usable
    contacts, a torque that never varies, or neither catch trials nor free movement to learn from, and in single
    precision.
    """
    options = options or FitOptions()
    if jnp.result_type(float) != jnp.float64:
        raise ValueError("a fit needs double precision: JAX_ENABLE_X64=1, or jax.config.update('jax_enable_x64', True)")
    trials = session.trials()
    _check(session, trials)
    model = trials[0].model
    dofs = tuple(compliant_dofs(model))
    if not dofs:
        raise ValueError(f"session {session.name!r}: its model has no compliant joint")
    motions = {trial.name: motion_of(trial, dofs) for trial in trials}
    repetitions = _repetitions(session, motions, dofs, options)
    found = [
        _window(motion, event, repetitions[name], options)
        for name, motion in motions.items()
        for event in range(len(motion.recording.events.onset))
    ]
    windows = [item for item in found if isinstance(item, Window)]
    left_out = _left_out(found, repetitions)
    if len(windows) < LEAST_EVENTS:
        raise ValueError(
            f"session {session.name!r}: {len(windows)} contacts that can be compared, a fit needs {LEAST_EVENTS}; "
            f"{'; '.join(left_out) or 'there are no others'}"
        )
    varied = max(float(np.ptp(motions[w.trial].torque[w.first : w.last + 1], axis=0).max()) for w in windows)
    if varied < NO_TORQUE:
        raise ValueError(f"session {session.name!r}: the contact torque never varies ({varied:.1e} Nm)")
    groups, segments = segment_groups(model, dofs)
    expected = expectation(windows, motions, options)
    periods, of = _periods(windows, motions, options)
    measurement = dataclasses.replace(measured(windows, motions, groups, expected, options), period=of)
    names = tuple(model.dof_names[dof] for dof in dofs)
    parameters = _parameters(model, dofs, segments, next(iter(motions.values())).offset_names, options, periods)
    if measurement.carried_doubt is not None:
        modes = np.zeros(np.shape(measurement.carried_doubt)[-1])
        parameters = Parameters((*parameters.of, Parameter("carried", modes, "prior sd", Identity(), 1.0)))
    problem = Problem(parameters, (measurement,))
    return SessionProblem(problem, motions, tuple(windows), groups, names, expected, left_out, periods)


def _repetitions(
    session: Session, motions: dict[str, Motion], dofs: tuple[int, ...], options: FitOptions
) -> dict[str, list[tuple[Motion, int]]]:
    """Of every trial its catch trials, free of contact, and of how many trials each of them holds the movement."""
    catches = [item for item in session.recordings if item.role == "catch" and set(item.repeats) & set(motions)]
    free = [without_contact(motion_of(item, dofs), SMEAR, options.settle) for item in catches]
    alike = [[other for other in catches if other is item or copied(item, other)] for item in catches]
    repeated = [len({name for other in items for name in other.repeats if name in motions}) for items in alike]
    return {
        name: [(free[at], repeated[at]) for at, item in enumerate(catches) if name in item.repeats] for name in motions
    }


def _check(session: Session, trials) -> None:
    if not trials:
        roles = ", ".join(item.role for item in session.recordings) or "none"
        raise ValueError(f"session {session.name!r}: no recording with the role 'trial' (roles: {roles})")
    for trial in trials:
        if not trial.contact_names:
            raise ValueError(f"trial {trial.name!r}: no contact forces, so nothing pushes the joints")
    first = trials[0]
    for item in session.recordings:
        if item.role not in ("trial", "catch"):
            continue
        if len(item.time) < 2:
            raise ValueError(f"{item.role} {item.name!r}: {len(item.time)} frames")
        steps = np.diff(np.asarray(item.time, float))
        usual = float(np.median(steps))
        if np.abs(steps - usual).max() > UNEVEN * usual:
            frame = int(np.abs(steps - usual).argmax())
            raise ValueError(
                f"{item.role} {item.name!r}: frame {frame + 2} comes {steps[frame]:.4g} s after the one before; a fit "
                f"needs frames {usual:.4g} s apart throughout"
            )
        if item.model.dof_names != first.model.dof_names:
            raise ValueError(f"{item.role} {item.name!r}: its model differs from that of {first.name!r}")
        if abs(item.rate - first.rate) > 1e-3 * first.rate:
            raise ValueError(
                f"{item.role} {item.name!r}: {item.rate:g} frames a second, {first.name!r} has {first.rate:g}"
            )

    for trial in trials:
        if trial.contact_names != first.contact_names:
            raise ValueError(
                f"trial {trial.name!r}: its contacts are {', '.join(trial.contact_names)}, those of {first.name!r} "
                f"{', '.join(first.contact_names)}"
            )
        for one, other in itertools.combinations((trial, *session.catch_trials(trial.name)), 2):
            if copied(one, other):
                raise ValueError(
                    f"catch {other.name!r} holds the same angles as {one.role} {one.name!r}: a copy is no repetition"
                )
    for one, other in itertools.combinations(trials, 2):
        if one.name == other.name or copied(one, other):
            raise ValueError(f"trials {one.name!r} and {other.name!r} have one name or hold the same angles: a copy")


def _window(motion: Motion, event: int, catches: list[tuple[Motion, int]], options: FitOptions) -> Window | str:
    """The window of a contact, or what is wrong with it."""
    first, onset, last = contact_frames(motion, event, options)
    rate = motion.recording.rate
    least_before = 2 * SMEAR * rate
    if last - onset < LEAST_AFTER * rate - 1.0:  # frames are counted in whole ones
        return f"touch for less than {LEAST_AFTER:g} s"
    if onset - first < least_before:
        return f"begin within {options.settle + 2 * SMEAR:.2g} s of another contact's end, or at the recording's start"
    if not motion.valid[first : last + 1].all():
        return "have frames without pose or force"
    size = np.linalg.norm(motion.torque, axis=1)
    before, after = size[first : onset - int(SMEAR * rate)].max(), size[onset : last + 1]
    if before > EARLIER * after.max() and np.ptp(after) > NO_TORQUE:
        return "are pushed before their stated onset"
    stride = max(1, round(options.spacing * rate))
    samples = np.arange(first, last + 1, stride)
    time = np.asarray(motion.recording.time)
    found, shifted = [], []
    for catch, repeated in catches:
        if catch.valid.sum() < LEAST_FRAMES:
            continue
        repetition = aligned(
            np.asarray(catch.recording.time)[catch.valid],
            catch.angle[catch.valid],
            time[samples],
            motion.angle[samples],
            samples <= onset - SMEAR * rate,
            np.sqrt(np.diagonal(motion.noise)) + np.radians(0.05),
            options.shift_sd,
        )
        timely = abs(repetition.shift) < 0.98 * LONGEST_SHIFT * options.shift_sd  # else the best may lie beyond
        finite = bool(np.isfinite(repetition.angle).all())
        if timely and finite and alike(motion.angle[samples], repetition.angle, samples <= onset - SMEAR * rate):
            found.append(repetition._replace(trials=repeated))
            shifted.append((catch, repetition.shift))
    if catches and not found:
        within = LONGEST_SHIFT * options.shift_sd
        return (
            "have no catch trial that lasts as long, without gap or touch, begins within "
            f"{within:.2g} s of it and moves as it does"
        )
    aside = moved_aside(motion, shifted, np.arange(first, last + 1))
    return Window(motion.recording.name, event, first, onset, last, samples, tuple(found), aside)


def _left_out(found: list[Window | str], repetitions: dict[str, list[tuple[Motion, int]]]) -> tuple[str, ...]:
    """How many contacts are not compared, and why; at how many of the others a catch trial is missing."""
    why = Counter(item for item in found if isinstance(item, str))
    told = "; ".join(f"{count} {reason}" for reason, count in why.items())
    lines = [f"{why.total()} of {len(found)} contacts are left out: {told}"] if told else []
    windows = [item for item in found if isinstance(item, Window)]
    short = sum(len(item.repetitions) < len(repetitions[item.trial]) for item in windows)
    if short:
        lines.append(
            f"{short} contacts are without one of their catch trials, which ends before, has a gap or touches, begins "
            f"more than {LONGEST_SHIFT:g} times shift_sd earlier or later, or moves otherwise before them"
        )
    return tuple(lines)


def _periods(
    windows: list[Window], motions: dict[str, Motion], options: FitOptions
) -> tuple[tuple[str, ...], np.ndarray | None]:
    """Their names, and of every window the number of its own; None where there is one."""
    if options.compliance_by == "session":
        return ("session",), None
    own = [window.trial for window in windows]
    if options.compliance_by == "contact":
        begins = [float(np.asarray(motions[w.trial].recording.events.onset)[w.event]) for w in windows]
        own = [f"{trial}, {begin:.2f} s" for trial, begin in zip(own, begins, strict=True)]
        own = [f"{name}, {w.event}" if own.count(name) > 1 else name for name, w in zip(own, windows, strict=True)]
    names = tuple(dict.fromkeys(own))
    return names, np.array([names.index(name) for name in own])


def _parameters(
    model: Model, dofs, segments, offsets, options: FitOptions, periods: tuple[str, ...] = ("session",)
) -> Parameters:
    names = tuple(model.dof_names[dof] for dof in dofs)
    stated = np.asarray(model.compliance, float)[list(dofs)]
    nominal = np.where(np.isfinite(stated) & (stated > 0), stated, options.typical_compliance)
    count = len(dofs)
    compliance = Parameter("compliance", nominal, "rad/Nm", Log(), options.compliance_sd, labels=names)
    if options.compliance_by != "session":
        compliance = Parameter(
            "compliance",
            np.tile(nominal, (len(periods), 1)),
            "rad/Nm",
            Log(),
            options.compliance_change,
            options.compliance_sd,
            labels=tuple(f"{name}, {period}" for period in periods for name in names),
        )
    items = [
        compliance,
        Parameter(
            "damping time",
            np.full(count, options.damping_time),
            "s",
            Log(),
            options.damping_time_spread,
            options.damping_time_sd,
            labels=names,
        ),
        Parameter("inertia", np.ones(len(segments)), "1", Log(), options.inertia_sd, labels=segments),
        Parameter("offsets", np.zeros(len(offsets)), "prior sd", Identity(), 1.0, labels=offsets),
        Parameter("sensor gain", np.array(1.0), "1", Log(), GAIN_SD),
        Parameter("sensor delay", np.array(0.0), "s", Identity(), DELAY_SD),
    ]
    return Parameters(tuple(items))
