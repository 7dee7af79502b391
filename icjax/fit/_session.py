"""A session to a problem: its contacts, its repetitions, and what is not known of subject and instruments."""

from typing import NamedTuple

import numpy as np

from icjax.estimation import compliant_dofs
from icjax.fit._dynamic import DynamicEquilibrium, whitener
from icjax.fit._options import FitOptions
from icjax.fit._parameters import Parameter, Parameters
from icjax.fit._problem import Problem
from icjax.fit._repetitions import Repetition, aligned
from icjax.fit._variability import Curve, Variability, covariance, learn
from icjax.fit._windows import Motion, contact_frames, inertia_along, motion_of, segment_groups, smoothed
from icjax.inference import Identity, Log
from icjax.model import Model
from icjax.recording import Session

LEAST_EVENTS = 3
"""Contacts below which nothing is fitted: four joints and their dampers cannot be told apart by fewer."""

SMEAR = 0.024
"""s before the onset in which the filter already shows the contact."""

LEAST_AFTER = 0.03
"""s; a contact that is released sooner tells nothing."""

GAIN_SD, DELAY_SD = 0.01, 0.0005
"""Of a calibrated force sensor's gain, and of its clock against the cameras', s."""


class Window(NamedTuple):
    """One contact: frames of the trial, its repetitions laid over it at the compared samples."""

    trial: str
    event: int
    first: int
    onset: int
    last: int
    samples: np.ndarray
    repetitions: tuple[Repetition, ...]


class SessionProblem(NamedTuple):
    """What `session_problem` made: the problem, the motions and windows behind it, and how far repetitions differ."""

    problem: Problem
    motions: dict[str, Motion]
    windows: tuple[Window, ...]
    groups: np.ndarray
    dof_names: tuple[str, ...]
    variability: Variability


def session_problem(session: Session, options: FitOptions | None = None) -> SessionProblem:
    """The dynamic equilibrium after every contact of a session as one problem of least squares.

    The mean of a trial's catch trials is its reference, their spread (`learn`) its covariance. Without them a planned
    deceleration after contact cannot be told from compliance, whatever else is measured.

    **Errors**: `ValueError` for a session without trials, catch trials or contact forces, with trials of different
    models or rates, with fewer than `LEAST_EVENTS` usable contacts, or a torque that never varies.
    """
    options = options or FitOptions()
    trials = session.trials()
    _check(session, trials)
    model = trials[0].model
    dofs = tuple(compliant_dofs(model))
    if not dofs:
        raise ValueError(f"session {session.name!r}: its model has no compliant joint")
    catches = {trial.name: session.catch_trials(trial.name) for trial in trials}
    motions = {trial.name: motion_of(trial, dofs) for trial in trials}
    used = [motion_of(item, dofs) for name in catches for item in catches[name]]
    of = {name: [item for item in used if item.recording.catch_of == name] for name in catches}
    windows = [
        window
        for name, motion in motions.items()
        for event in range(len(motion.recording.events.onset))
        if (window := _window(motion, event, of[name], options)) is not None
    ]
    if len(windows) < LEAST_EVENTS:
        raise ValueError(
            f"session {session.name!r}: {len(windows)} contacts with {LEAST_AFTER:g} s of touch and free movement "
            f"before it; a fit needs {LEAST_EVENTS}"
        )
    moved = max(float(np.ptp(motions[w.trial].torque[w.first : w.last + 1])) for w in windows)
    if moved < 1e-6:
        raise ValueError(f"session {session.name!r}: the contact torque never varies ({moved:.1e} Nm)")
    groups, segments = segment_groups(model, dofs)
    noise = np.mean([motion.noise for motion in motions.values()], axis=0)
    variability = _learn(windows, motions, noise, options)
    measurement = _measurement(session.name, windows, motions, groups, noise, variability, options)
    parameters = _parameters(model, dofs, segments, next(iter(motions.values())).offset_names, options)
    names = tuple(model.dof_names[dof] for dof in dofs)
    return SessionProblem(Problem(parameters, (measurement,)), motions, tuple(windows), groups, names, variability)


def _check(session: Session, trials) -> None:
    if not trials:
        roles = ", ".join(item.role for item in session.recordings) or "none"
        raise ValueError(f"session {session.name!r}: no recording with the role 'trial' (roles: {roles})")
    for trial in trials:
        if not trial.contact_names:
            raise ValueError(f"trial {trial.name!r}: no contact forces, so nothing pushes the joints")
        if not session.catch_trials(trial.name):
            raise ValueError(
                f"trial {trial.name!r}: no catch trial (the same movement with the surface taken away, role 'catch', "
                f"catch_of {trial.name!r}); without one a planned movement cannot be told from compliance"
            )
    first = trials[0]
    for item in session.recordings:
        if item.role not in ("trial", "catch"):
            continue
        if item.model.dof_names != first.model.dof_names:
            raise ValueError(f"{item.role} {item.name!r}: its model differs from that of {first.name!r}")
        if abs(item.rate - first.rate) > 1e-3 * first.rate:
            raise ValueError(
                f"{item.role} {item.name!r}: {item.rate:g} frames a second, {first.name!r} has {first.rate:g}"
            )


def _window(motion: Motion, event: int, catches: list[Motion], options: FitOptions) -> Window | None:
    first, onset, last = contact_frames(motion, event, options)
    rate = motion.recording.rate
    least_before = 2 * SMEAR * rate
    if last - onset < LEAST_AFTER * rate or onset - first < least_before or not motion.valid[first : last + 1].all():
        return None
    stride = max(1, round(options.spacing * rate))
    samples = np.arange(first, last + 1, stride)
    time = np.asarray(motion.recording.time)
    found = []
    for catch in catches:
        repetition = aligned(
            np.asarray(catch.recording.time)[catch.valid],
            catch.angle[catch.valid],
            time[samples],
            motion.angle[samples],
            samples <= onset - SMEAR * rate,
            np.sqrt(np.diagonal(motion.noise)) + np.radians(0.05),
            options.shift_sd,
        )
        if np.isfinite(repetition.angle).all():
            found.append(repetition)
    if catches and not found:
        return None
    return Window(motion.recording.name, event, first, onset, last, samples, tuple(found))


def _learn(windows, motions, noise, options) -> Variability:
    curves, correlations = [], []
    for window in windows:
        motion = motions[window.trial]
        s = (window.samples - window.onset) / motion.recording.rate
        rho = _correlation(motion, window.samples)
        for one, other in zip(window.repetitions, window.repetitions[1:], strict=False):
            curves.append(Curve(s, one.angle - other.angle, (one.rate, other.rate)))
            correlations.append(rho)
        free = s <= -SMEAR
        for one in window.repetitions[:1]:
            curves.append(Curve(s[free], motion.angle[window.samples][free] - one.angle[free], (one.rate[free],)))
            correlations.append(rho[np.ix_(free, free)])
    return learn(curves, noise, correlations, options.shift_sd)


def _correlation(motion: Motion, samples: np.ndarray) -> np.ndarray:
    return motion.correlation[np.abs(samples[:, None] - samples[None, :])]


def _measurement(name, windows, motions, groups, noise, variability, options) -> DynamicEquilibrium:
    rate = motions[windows[0].trial].recording.rate
    dofs = len(noise)
    length = max(w.last - w.first + 1 for w in windows)
    count = max(len(w.samples) for w in windows)
    rows: dict[str, list[np.ndarray]] = {key: [] for key in ("torque", "rate", "by", "frames", "y", "W")}
    inertia: list[list[np.ndarray]] = [[], [], []]
    movements = {name: smoothed(motions[name]) for name in dict.fromkeys(w.trial for w in windows)}
    for window in windows:
        motion = motions[window.trial]
        frames = np.arange(window.first, window.last + 1)
        torque = motion.torque[frames]
        rows["torque"].append(_filled(torque, length))
        rows["rate"].append(_filled(np.gradient(torque, 1.0 / rate, axis=0), length))
        rows["by"].append(_filled(motion.by_offset[frames], length))
        for store, part in zip(inertia, inertia_along(motion, movements[window.trial], groups, frames), strict=True):
            store.append(_filled(part, length, repeat=True))
        s = (window.samples - window.onset) / rate
        rho = _correlation(motion, window.samples)
        y, K = _against_repetitions(motion, window, s, variability, noise, rho, options.shift_sd)
        used = np.zeros((count, dofs), bool)
        used[: len(s)] = True
        full = np.eye(count * dofs)
        full[: len(s) * dofs, : len(s) * dofs] = K.reshape(len(s) * dofs, -1)
        rows["W"].append(whitener(full, used.ravel()))
        rows["y"].append(_filled(y, count))
        rows["frames"].append(_filled(window.samples - window.first, count))
    stacked = {key: np.stack(items) for key, items in rows.items() if items}
    first = motions[windows[0].trial]
    offset = np.linalg.cholesky(first.offset + 1e-18 * np.eye(len(first.offset)))
    return DynamicEquilibrium(
        name, 1.0 / rate, stacked["torque"], stacked["rate"], stacked["by"],
        (np.stack(inertia[0]), np.stack(inertia[1]), np.stack(inertia[2])),
        np.asarray(first.recording.model.armature)[list(first.dofs)], offset,
        stacked["frames"].astype(int), stacked["y"], stacked["W"],
    )  # fmt: skip


def _against_repetitions(motion, window, s, variability, noise, rho, shift_sd):
    n = len(window.repetitions)
    mean = np.mean([item.angle for item in window.repetitions], axis=0)
    K = (1.0 + 1.0 / n) * covariance(s, variability, noise, rho).reshape(mean.size, mean.size)
    for item in window.repetitions:
        K = K + (shift_sd / n) ** 2 * np.outer(item.rate.ravel(), item.rate.ravel())
    return motion.angle[window.samples] - mean, K


def _filled(values: np.ndarray, length: int, repeat: bool = False) -> np.ndarray:
    """Lengthened at the end, with zeros or the last row."""
    missing = length - len(values)
    if missing == 0:
        return values
    tail = np.repeat(values[-1:], missing, axis=0) if repeat else np.zeros((missing, *values.shape[1:]), values.dtype)
    return np.concatenate([values, tail])


def _parameters(model: Model, dofs, segments, offsets, options: FitOptions) -> Parameters:
    names = tuple(model.dof_names[dof] for dof in dofs)
    stated = np.asarray(model.compliance, float)[list(dofs)]
    nominal = np.where(np.isfinite(stated) & (stated > 0), stated, options.typical_compliance)
    count = len(dofs)
    items = [
        Parameter("compliance", nominal, "rad/Nm", Log(), options.compliance_sd, labels=names),
        Parameter(
            "damping time", np.full(count, options.damping_time), "s", Log(), options.damping_time_sd, labels=names
        ),
        Parameter("inertia", np.ones(len(segments)), "1", Log(), options.inertia_sd, labels=segments),
        Parameter("offsets", np.zeros(len(offsets)), "prior sd", Identity(), 1.0, labels=offsets),
        Parameter("sensor gain", np.array(1.0), "1", Log(), GAIN_SD),
        Parameter("sensor delay", np.array(0.0), "s", Identity(), DELAY_SD),
    ]
    return Parameters(tuple(items))
