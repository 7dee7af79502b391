"""Is a stored recording one that estimation and transfer can trust? What its numbers say about themselves."""

import itertools
import json
from collections.abc import Iterator

import numpy as np

from icjax.capture._check import ERROR, SUSPICIOUS
from icjax.capture._check_contacts import Finding, contact_findings, stated
from icjax.capture._check_markers import marker_findings
from icjax.model import Model
from icjax.recording import ROLES, Recording, Session

UNIT = 1e-6
"""How far a quaternion's length and a rotation matrix may be from unity."""

SLOW = 200.0
"""Hz; below this a window of 100 ms after contact holds fewer than 20 samples (the paper recorded 500 Hz)."""

SMEARING = 15.0
"""Hz; below it compliance at contact is biased by more than a tenth (windows of 0.1 s)."""

LARGE_ANGLE_SD = np.radians(5.0)
"""rad; a joint angle known no better than this gives no useful torque arm."""

LARGE_PLACE_SD = 0.02
"""m; the same for a slide or the place of a free joint."""

TURNING = {"hinge": [True], "slide": [False], "ball": 3 * [True], "free": 3 * [True] + 3 * [False]}
"""Which degrees of freedom of a joint are angles."""


def check_recording(session: Session) -> list[str]:
    """Lines about a stored session: what it holds, then lines that begin with "suspicious: " and "error: ".

    An error is a number that contradicts the meaning of its field (time that does not increase, a force without a
    point, an event outside the recording, a covariance that is none, a body that the model lacks). What is possible
    but rarely meant is suspicious, and so is what capture doubted of the forces (saturated or dead channels, loaded
    tare windows). The form of the file itself is checked by `icjax.files.layout_problems`.
    """
    roles = [item.role for item in session.recordings]
    counts = ", ".join(f"{roles.count(role)} {role}" for role in dict.fromkeys(roles))
    subject = f" of subject '{session.subject}'" if session.subject else ""
    lines = [f"session '{session.name}'{subject}: {counts or 'no recordings'}"]
    names = [item.name for item in session.recordings]
    lines += [f"{ERROR}recording '{name}' is there twice" for name in dict.fromkeys(names) if names.count(name) > 1]
    for first, second in itertools.combinations(session.recordings, 2):
        if first.q.shape == second.q.shape and np.array_equal(first.q, second.q):
            lines.append(f"{SUSPICIOUS}recordings '{first.name}' and '{second.name}' hold the same movement")
    for recording in session.recordings:
        lines.append(_summary(recording))
        found = [*_form(recording, names), *_model(recording.model), *_poses(recording), *contact_findings(recording)]
        lines += [f"{kind}recording '{recording.name}': {text}" for kind, text in found]
    return lines


def _summary(recording: Recording) -> str:
    time = recording.time
    lasts = float(time[-1] - time[0])
    lasted = f"{lasts:.2f} s at {recording.rate:g} Hz" if lasts > 0 else "no time"
    contacts = ", ".join(recording.contact_names) or "none"
    return (
        f"recording '{recording.name}' ({recording.role}): {len(time)} frames, {lasted}; "
        f"{recording.model.nv} degrees of freedom, {len(recording.marker_names)} markers, "
        f"contacts {contacts}, {len(recording.events.onset)} events"
    )


def _form(recording: Recording, names: list[str]) -> Iterator[Finding]:
    if recording.role not in ROLES:
        yield ERROR, f"its role '{recording.role}' is none of {', '.join(ROLES)}"
    if (recording.role == "catch") != bool(recording.repeats):
        yield ERROR, "catch_of must be stated exactly when the role is 'catch'"
    for repeated in recording.repeats if len(names) > 1 else ():
        if repeated not in names:
            yield ERROR, f"catch_of names '{repeated}', which the file does not hold"
    time = np.asarray(recording.time)
    wrong = np.flatnonzero(~(np.diff(time) > 0))
    if len(time) < 2:
        yield ERROR, "it has fewer than two frames"
    elif not np.isfinite(time).all() or len(wrong):
        row = int(wrong[0]) if len(wrong) else int(np.argmin(np.isfinite(time)))
        yield ERROR, f"time does not increase after frame {row + 1} ({time[row]:g} s)"
    elif recording.friction is not None and not isinstance(recording.friction, int | float):
        yield ERROR, f"friction is {recording.friction!r}, no number"
    elif recording.rate < SLOW and len(recording.events.onset):
        yield SUSPICIOUS, f"{recording.rate:g} Hz is slow for compliance at contact; 500 Hz is good"
    try:
        provenance = json.loads(recording.provenance)
    except (ValueError, TypeError):
        yield SUSPICIOUS, "provenance is not JSON text: nobody can tell how it was made"
    else:
        doubts = provenance.get("doubts") if isinstance(provenance, dict) else None
        yield from ((SUSPICIOUS, str(text)) for text in (doubts if isinstance(doubts, list) else ()))


def _model(model: Model) -> Iterator[Finding]:
    rotations = np.asarray(model.body_rotation)
    tilt = np.abs(np.einsum("bij,bkj->bik", rotations, rotations) - np.eye(3)).max(axis=(1, 2))
    for name, error in zip(model.body_names, tilt, strict=True):
        if not error <= UNIT:
            yield ERROR, f"model: body_rotation of '{name}' is no rotation matrix"
    for name, mass in zip(model.body_names, np.asarray(model.body_mass), strict=True):
        if not (np.isfinite(mass) and mass >= 0):
            yield ERROR, f"model: body_mass of '{name}' is {mass:g} kg"
    for name, value in zip(model.dof_names, np.asarray(model.compliance), strict=True):
        if not value >= 0:
            yield ERROR, f"model: compliance of '{name}' is {value:g}"
    lengths = np.linalg.norm(np.asarray(model.joint_axis), axis=1)
    for name, kind, length in zip(model.joint_names, model.joint_types, lengths, strict=True):
        if kind in ("hinge", "slide") and not abs(length - 1) <= UNIT:
            yield ERROR, f"model: joint_axis of '{name}' has the length {length:g}"


def _poses(recording: Recording) -> Iterator[Finding]:
    q, valid = np.asarray(recording.q), np.asarray(recording.valid)
    bad = valid & ~np.isfinite(q).all(axis=1)
    if bad.any():
        yield ERROR, f"q is not finite in {bad.sum()} valid frames, the first at {recording.time[bad.argmax()]:g} s"
    for name, kind, part in zip(
        recording.model.joint_names, recording.model.joint_types, recording.model.coordinate_slices, strict=True
    ):
        if kind in ("ball", "free"):
            length = np.linalg.norm(q[valid][:, part.stop - 4 : part.stop], axis=1)
            if np.any(np.abs(length - 1) > UNIT):
                yield ERROR, f"the quaternion of '{name}' is not of unit length"
    if not valid.any():
        yield ERROR, "no frame has a pose: do the markers' names, places and unit fit the model?"
        return
    if not valid.all():
        share = 100 * float(np.mean(~valid))
        yield (SUSPICIOUS if share > 5 else ""), f"{share:.1f} % of the frames have no pose"
    covariance = np.asarray(recording.q_covariance)
    covariance = covariance if valid.all() else covariance[valid]
    variances = np.diagonal(covariance, axis1=1, axis2=2)
    mirrored = np.swapaxes(covariance, 1, 2)
    if not np.isfinite(covariance).all():
        yield SUSPICIOUS, "q_covariance is not finite in some valid frames: how well the angles are known is unknown"
    elif np.any(variances < 0) or (
        not np.array_equal(covariance, mirrored)
        and np.abs(covariance - mirrored).max() > 1e-6 * max(float(variances.max()), 1e-300)
    ):
        yield ERROR, "q_covariance is not symmetric with a positive diagonal"
    yield from _vague(recording.model, variances)
    yield from _filtered(recording)
    yield from marker_findings(recording, stated(recording, "placement_sd_m"))


def _filtered(recording: Recording) -> Iterator[Finding]:
    """A cut-off that smears the bend of an angle over the window in which compliance looks for it."""
    cutoff = stated(recording, "filter_hz", "markers")
    if recording.marker_names and len(recording.events.onset) and cutoff is not None and cutoff < SMEARING:
        yield (
            SUSPICIOUS,
            f"markers filtered at {cutoff:g} Hz: the bend of an angle at contact is smeared, the paper's estimate of "
            "compliance comes out too small (a fifth at 10 Hz, half at 6 Hz); [filter] markers says how much",
        )


def _vague(model: Model, variances: np.ndarray) -> Iterator[Finding]:
    """Coordinates that the markers leave open, all in one line."""
    known = np.isfinite(variances).all(axis=1)
    if not known.any():
        return
    sd = np.sqrt(np.abs(np.median(variances[known], axis=0)))
    turns = np.concatenate([TURNING[kind] for kind in model.joint_types]) if model.joint_types else np.zeros(0, bool)
    told = [
        f"{name} {np.degrees(value):.1f} degrees" if turn else f"{name} {1e3 * value:.0f} mm"
        for name, value, turn in zip(model.dof_names, sd, turns, strict=True)
        if value > (LARGE_ANGLE_SD if turn else LARGE_PLACE_SD)
    ]
    if told:
        yield (
            SUSPICIOUS,
            f"some coordinates are known poorly (standard deviation): {', '.join(told)}; more markers, or [posture] in "
            "the session, would tell",
        )
