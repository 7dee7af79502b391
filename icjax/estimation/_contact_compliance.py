"""The paper's compliance estimate at every contact event (section 3.3)."""

from typing import NamedTuple

import numpy as np

from icjax.estimation._fit import correlated_noise, fit_rise, fit_slope_change
from icjax.estimation._inertial_torque import inertial_torque
from icjax.estimation._joints import angle_courses, chosen_dofs
from icjax.estimation._options import EstimationOptions
from icjax.estimation._smooth_motion import smooth_motion
from icjax.estimation._torque import body_index, joint_torque
from icjax.estimation._torque_error import TorqueDeviation
from icjax.interaction import STATUS, CompliancePerEvent
from icjax.model import Model
from icjax.recording import ContactEvents, Recording
from icjax.typing import Float, Real

ACCEPTED, NEGATIVE, NOT_EXCITED, TOO_FEW = range(len(STATUS))


class _Estimate(NamedTuple):
    """One event and joint."""

    compliance: float
    standard_error: float
    status: int
    r_squared: tuple[float, float, float]
    torque_change: float
    angle_before: np.ndarray
    angle_after: np.ndarray
    torque_after: np.ndarray


def compliance_at_contact(
    recordings: tuple[Recording, ...],
    options: EstimationOptions | None = None,
    torques: tuple[Float[Real, "_ dof"], ...] | None = None,
    deviations: tuple[TorqueDeviation, ...] | None = None,
) -> CompliancePerEvent:
    """Compliance of every joint at every contact event of the recordings.

    Polynomials are fitted by least squares to the joint angle just before and just after the onset and to the
    joint torque just after it. With s = t - onset,

        C = (d theta_after / ds - d theta_before / ds) / (d tau / ds)   at s = 0,

    the polynomial before contact standing for the movement that would have gone on (section 4.3: extrapolation).
    Conditions at contact: both angle polynomials have the same value there (Eq. 1 with tau = 0), the torque
    polynomial is zero there; slopes and curvatures are free. The three are fitted at once over both windows.

    A window ends early at the release, at the recording's end and at any other contact that loads the joint;
    invalid frames are left out. What remains must cover `options.coverage` of the window, else the event has too
    few samples. A joint is not excited where the torque's change over the window, or its slope at contact, does
    not exceed `options.excitation` times its noise, the one that the samples show or the one that `deviations` states,
    whichever is larger (`correlated_noise`: filtered noise hides from the samples). A negative estimate is kept and
    marked.

    The standard error is first-order propagation of the errors of both slopes (see `EstimationOptions` and
    `fit_slope_change`). It covers noise about the polynomials, and with `deviations` what the polynomials cannot show:
    an offset of the joint angles makes the torque too large or too small in the whole window by about the same share
    sd_tau / tau, which adds C sd_tau / tau. It does not cover the bias of the method: inertia,
    damping and planned deceleration after contact all change the angle's slope and are read as compliance.

    With `options.inertia` the torque is J^T f - M e'' - B e' (`inertial_torque`) instead of J^T f.

    **Arguments**

    - `recordings`: of one subject's model.
    - `options`: windows, degree, thresholds.
    - `torques`: `joint_torque` of each recording, Nm, if already computed.
    - `deviations`: `torque_deviation` of each recording; default none.

    **Returns** the estimates, in order of recording and onset. Where the status is "not excited" or "too few
    samples" the compliance is NaN and its standard error infinite.

    **Errors**: `ValueError` for an unknown joint or an empty tuple of recordings.

    Source: Kry and Pai 2006, sections 3.3 and 4.3, Figures 3 and 8.
    """
    options = options or EstimationOptions()
    if not recordings:
        raise ValueError("recordings: none given")
    model = recordings[0].model
    dofs = chosen_dofs(model, options.joints)
    if torques is None:
        torques = tuple(joint_torque(recording) for recording in recordings)
    names: list[str] = []
    onsets: list[float] = []
    rows: list[list[_Estimate]] = []
    if deviations is None:
        nothing = tuple(np.zeros(np.shape(torque)) for torque in torques)
        deviations = tuple(TorqueDeviation(item, item) for item in nothing)
    for recording, torque, deviation in zip(recordings, torques, deviations, strict=True):
        angle = angle_courses(model, recording.q, dofs)
        tau = np.asarray(torque)[:, list(dofs)]
        noise, shared = (np.asarray(item)[:, list(dofs)] for item in deviation)
        variance = np.diagonal(np.asarray(recording.q_covariance), axis1=1, axis2=2)[:, list(dofs)]
        loads = contacts_that_load(recording, dofs)
        motion = None
        if options.inertia:
            motion = smooth_motion(model, recording.time, recording.q, options.inertia_cutoff, recording.valid)
        for event, onset in enumerate(np.asarray(recording.events.onset)):
            names.append(recording.name)
            onsets.append(float(onset))
            static = tau
            if motion is not None:
                inertial = inertial_torque(recording, motion, float(onset), options.window_before, options.degree)
                static = tau - inertial[:, list(dofs)]
            rows.append(
                [
                    _at_event(
                        recording,
                        event,
                        angle[:, j],
                        static[:, j],
                        TorqueDeviation(noise[:, j], shared[:, j]),
                        variance[:, j],
                        loads[j],
                        options,
                    )
                    for j in range(len(dofs))
                ]
            )
    return _assemble(names, onsets, rows, tuple(model.dof_names[dof] for dof in dofs), options)


def contacts_that_load(recording: Recording, dofs: tuple[int, ...]) -> list[np.ndarray]:
    """For each degree of freedom, which contact channels touch a body that it moves: `[contact]` bool."""
    model: Model = recording.model
    bodies = [body_index(model, name) for name in recording.contact_bodies]
    return [model.path_mask[bodies, dof] > 0 for dof in dofs]


def free_interval(events: ContactEvents, event: int, loads: np.ndarray) -> tuple[float, float]:
    """Time around an onset in which no other contact loads the joint: from the last release to the next change.

    Empty before the onset (start = onset) where another contact is already there.
    """
    onset, release, contact = (np.asarray(x) for x in (events.onset, events.release, events.contact))
    release = np.where(np.isnan(release), np.inf, release)
    here = float(onset[event])
    others = (np.arange(len(onset)) != event) & (loads[contact] | (contact == contact[event]))
    earlier = others & (onset <= here)
    start = min(float(np.max(release[earlier], initial=-np.inf)), here)
    end = min(float(release[event]), float(np.min(onset[others & (onset > here)], initial=np.inf)))
    return start, end


def window_frames(
    recording: Recording, event: int, loads: np.ndarray, usable: np.ndarray, options: EstimationOptions
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time after the onset (s) of every frame, and which usable frames lie in the windows before and after it."""
    onset = float(np.asarray(recording.events.onset)[event])
    start, end = free_interval(recording.events, event, loads)
    s = np.asarray(recording.time) - onset
    edge = 1e-6 / recording.rate  # a sample on the edge of a window is in it, whatever its rounding
    before = usable & (s <= 0) & (s >= max(-options.window_before, start - onset) - edge)
    after = usable & (s > 0) & (s <= min(options.window_after, end - onset) + edge)
    return s, before, after


def _at_event(
    recording: Recording,
    event: int,
    angle: np.ndarray,
    torque: np.ndarray,
    deviation: TorqueDeviation,
    variance: np.ndarray,
    loads: np.ndarray,
    options: EstimationOptions,
) -> _Estimate:
    if not loads[int(np.asarray(recording.events.contact)[event])]:
        return _no_estimate(NOT_EXCITED, options.degree)
    usable = np.asarray(recording.valid) & np.isfinite(angle) & np.isfinite(torque)
    s, before, after = window_frames(recording, event, loads, usable, options)
    enough = all(
        side.sum() >= max(options.coverage * recording.rate * window, options.degree + 3)
        for side, window in ((before, options.window_before), (after, options.window_after))
    )
    if not enough:
        return _no_estimate(TOO_FEW, options.degree)
    rise = fit_rise(s[after], torque[after], options.degree)
    noise = float(np.nanmean(np.where(np.isfinite(variance), variance, 0.0)[before | after]))
    change = fit_slope_change(s[before], angle[before], s[after], angle[after], options.degree, noise)
    torque_change = float(np.polynomial.polynomial.polyval(s[after][-1], rise.coefficients))
    fits = (
        (*change.r_squared, rise.r_squared),
        torque_change,
        change.before,
        change.after,
        rise.coefficients,
    )
    stated = float(np.sqrt(np.mean(np.nan_to_num(deviation.noise[after]) ** 2)))
    noise, slope_noise = correlated_noise(rise, stated)
    least = max(options.excitation * noise, options.least_torque)
    if abs(torque_change) <= least or abs(rise.slope) <= options.excitation * slope_noise:
        return _Estimate(np.nan, np.inf, NOT_EXCITED, *fits)
    compliance = change.change / rise.slope
    fitted = np.hypot(change.change_se, compliance * rise.slope_se) / abs(rise.slope)
    share = np.sqrt(np.sum(deviation.offset[after] ** 2) / np.sum(torque[after] ** 2))
    error = float(np.hypot(fitted, compliance * share))
    return _Estimate(compliance, error, NEGATIVE if compliance < 0 else ACCEPTED, *fits)


def _no_estimate(status: int, degree: int) -> _Estimate:
    nothing = np.full(degree + 1, np.nan)
    return _Estimate(np.nan, np.inf, status, (np.nan, np.nan, np.nan), np.nan, nothing, nothing, nothing)


def _assemble(names, onsets, rows, joints, options) -> CompliancePerEvent:
    events, count = len(rows), len(joints)

    def table(field: str, *extra: int, dtype: type = float) -> np.ndarray:
        values = [[getattr(item, field) for item in row] for row in rows]
        return np.asarray(values, dtype=dtype).reshape(events, count, *extra)

    return CompliancePerEvent(
        recording=tuple(names),
        joint_names=joints,
        onset=np.asarray(onsets, dtype=float),
        compliance=table("compliance"),
        standard_error=table("standard_error"),
        status=table("status", dtype=np.int32),
        r_squared=table("r_squared", 3),
        torque_change=table("torque_change"),
        angle_before=table("angle_before", options.degree + 1),
        angle_after=table("angle_after", options.degree + 1),
        torque_after=table("torque_after", options.degree + 1),
        window=np.asarray([options.window_before, options.window_after]),
    )
