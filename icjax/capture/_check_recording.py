"""Is a stored recording one that estimation and transfer can trust? What its numbers say about themselves."""

import json
from collections.abc import Iterator

import equinox as eqx
import jax
import numpy as np

from icjax.capture._check import ERROR, EXTENT, SUSPICIOUS
from icjax.model import Model, pad_positions
from icjax.recording import ROLES, Recording, Session

UNIT = 1e-6
"""How far a quaternion's length and a rotation matrix may be from unity."""

SLOW = 200.0
"""Hz; below this a window of 100 ms after contact holds fewer than 20 samples (the paper recorded 500 Hz)."""

LARGE_RESIDUAL = 0.01
"""m RMS; markers farther than this from the model belong to another model or map."""

PLACEMENTS = 3.0
"""Markers whose RMS distance to the model is this many times the stated placement (of three axes) do not fit it."""

SAMPLED = 64
"""Frames of contact at which its point is compared with the pad."""

FAR_FROM_PAD = 0.02
"""m; a fingertip's contact lies within millimetres of its pad."""

LARGE_FORCE = 5e3
"""N; six times the weight of a heavy person."""

LARGE_ANGLE_SD = np.radians(5.0)
"""rad; a joint angle known no better than this gives no useful torque arm."""


def check_recording(session: Session) -> list[str]:
    """Lines about a stored session: what it holds, then lines that begin with "suspicious: " and "error: ".

    An error is a number that contradicts the meaning of its field (time that does not increase, a force without a
    point, an event outside the recording, a covariance that is none, a body that the model lacks). What is possible
    but rarely meant is suspicious. The form of the file itself is checked by `icjax.files.layout_problems`.
    """
    roles = [item.role for item in session.recordings]
    counts = ", ".join(f"{roles.count(role)} {role}" for role in dict.fromkeys(roles))
    lines = [f"session '{session.name}' of subject '{session.subject}': {counts or 'no recordings'}"]
    names = [item.name for item in session.recordings]
    lines += [f"{ERROR}recording '{name}' is there twice" for name in dict.fromkeys(names) if names.count(name) > 1]
    for recording in session.recordings:
        lines.append(_summary(recording))
        found = [*_form(recording, names), *_model(recording.model), *_poses(recording), *_contacts(recording)]
        lines += [f"{kind}recording '{recording.name}': {text}" for kind, text in found]
    return lines


Finding = tuple[str, str]
"""`ERROR` or `SUSPICIOUS`, and the text."""


def _summary(recording: Recording) -> str:
    time = recording.time
    lasted = f"{float(time[-1] - time[0]):.2f} s at {recording.rate:g} Hz" if len(time) > 1 else "one frame"
    contacts = ", ".join(recording.contact_names) or "none"
    return (
        f"recording '{recording.name}' ({recording.role}): {len(time)} frames, {lasted}; "
        f"{recording.model.nv} degrees of freedom, {len(recording.marker_names)} markers, "
        f"contacts {contacts}, {len(recording.events.onset)} events"
    )


def _form(recording: Recording, names: list[str]) -> Iterator[Finding]:
    if recording.role not in ROLES:
        yield ERROR, f"its role '{recording.role}' is none of {', '.join(ROLES)}"
    if (recording.role == "catch") != (recording.catch_of is not None):
        yield ERROR, "catch_of must be stated exactly when the role is 'catch'"
    elif recording.catch_of is not None and recording.catch_of not in names and len(names) > 1:
        yield ERROR, f"catch_of names '{recording.catch_of}', which the file does not hold"
    time = np.asarray(recording.time)
    wrong = np.flatnonzero(~(np.diff(time) > 0))
    if len(time) < 2:
        yield ERROR, "it has fewer than two frames"
    elif not np.isfinite(time).all() or len(wrong):
        row = int(wrong[0]) if len(wrong) else int(np.argmin(np.isfinite(time)))
        yield ERROR, f"time does not increase after frame {row + 1} ({time[row]:g} s)"
    elif recording.rate < SLOW and len(recording.events.onset):
        yield SUSPICIOUS, f"{recording.rate:g} Hz is slow for compliance at contact; 500 Hz is good"
    try:
        json.loads(recording.provenance)
    except ValueError:
        yield SUSPICIOUS, "provenance is not JSON text: nobody can tell how it was made"


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
    if not valid.all():
        share = 100 * float(np.mean(~valid))
        yield (SUSPICIOUS if share > 5 else ""), f"{share:.1f} % of the frames have no pose"
    covariance = np.asarray(recording.q_covariance)[valid]
    variances = np.diagonal(covariance, axis1=1, axis2=2)
    if np.isfinite(covariance).all() and len(covariance):
        asymmetry = np.abs(covariance - np.swapaxes(covariance, 1, 2)).max()
        if np.any(variances < 0) or asymmetry > 1e-6 * max(float(variances.max()), 1e-300):
            yield ERROR, "q_covariance is not symmetric with a positive diagonal"
    elif len(covariance):
        yield SUSPICIOUS, "q_covariance is not finite in some valid frames"
    for name, sd in zip(recording.model.dof_names, np.sqrt(np.abs(np.nanmedian(variances, axis=0))), strict=True):
        if sd > LARGE_ANGLE_SD:
            yield SUSPICIOUS, f"the angle of '{name}' is known to {np.degrees(sd):.1f} degrees (or {sd:.2g} m) only"
    residual = np.asarray(recording.marker_residual)[valid]
    residual = residual[np.isfinite(residual)]
    if residual.size:
        rms = float(np.sqrt(np.mean(residual**2)))
        stated = _stated(recording, "placement_sd_m")
        if rms > LARGE_RESIDUAL or (stated and rms > PLACEMENTS * 3**0.5 * stated):
            per_marker = np.sqrt(np.nanmean(np.asarray(recording.marker_residual)[valid] ** 2, axis=0))
            worst = recording.marker_names[int(np.nanargmax(per_marker))]
            yield (
                SUSPICIOUS,
                f"markers lie {1e3 * rms:.1f} mm RMS from the model, '{worst}' most: wrong map, unit or size?",
            )
    markers = np.asarray(recording.markers).reshape(-1, 3)
    markers = markers[np.isfinite(markers).all(axis=1)]
    if len(markers):
        extent = float(np.max(markers.max(axis=0) - markers.min(axis=0)))
        if not EXTENT[0] <= extent <= EXTENT[1]:
            yield SUSPICIOUS, f"markers spread over {extent:g} m; they must be in m"


def _contacts(recording: Recording) -> Iterator[Finding]:
    model, touching = recording.model, np.asarray(recording.touching)
    for body in recording.contact_bodies:
        if body not in model.body_names and body not in model.pad_names:
            yield ERROR, f"contact_bodies names '{body}', neither a body nor a pad of the model"
    force, point = np.asarray(recording.contact_force), np.asarray(recording.contact_point)
    for index, name in enumerate(recording.contact_names):
        on = touching[:, index]
        if not np.isfinite(force[on, index]).all():
            yield ERROR, f"contact_force of '{name}' is not finite while it touches"
        elif np.any(force[~on, index] != 0):
            yield ERROR, f"contact_force of '{name}' is not zero while nothing touches"
        elif not np.isfinite(point[on, index]).all():
            yield (
                ERROR,
                f"contact_point of '{name}' is unknown in {(~np.isfinite(point[on, index]).all(1)).sum()} frames",
            )
        elif on.any() and np.linalg.norm(force[on, index], axis=1).max() > LARGE_FORCE:
            yield SUSPICIOUS, f"contact_force of '{name}' exceeds {LARGE_FORCE:g} N; it must be in N"
        far = _beside_pad(recording, index)
        if far > FAR_FROM_PAD:
            body = recording.contact_bodies[index]
            yield (
                SUSPICIOUS,
                f"the contact point of '{name}' lies {1e3 * far:.0f} mm beside the pad of {body} (median): "
                "is the source's position, rotation or sign right?",
            )
    yield from _events(recording)
    if recording.role == "catch" and touching.any():
        yield SUSPICIOUS, "something touches in this catch trial"
    if recording.role == "trial" and recording.contact_names and not touching.any():
        yield SUSPICIOUS, "nothing touches in this trial"


def _events(recording: Recording) -> Iterator[Finding]:
    events, time = recording.events, np.asarray(recording.time)
    onset, release = np.asarray(events.onset), np.asarray(events.release)
    if np.any(np.diff(onset) < 0):
        yield ERROR, "events are not in the order of their onsets"
    for number, (start, stop, contact) in enumerate(zip(onset, release, np.asarray(events.contact), strict=True), 1):
        if not 0 <= contact < len(recording.contact_names):
            yield ERROR, f"event {number} is of contact {contact}, of {len(recording.contact_names)}"
        elif not time[0] <= start <= time[-1] or stop <= start:
            yield (
                ERROR,
                f"event {number} lasts from {start:g} to {stop:g} s, in a recording of {time[0]:g} to {time[-1]:g} s",
            )


def _beside_pad(recording: Recording, contact: int) -> float:
    """m; median distance between a contact point and the nearest pad of the touched body, 0 without such a pad."""
    model, on = recording.model, np.asarray(recording.touching)[:, contact] & np.asarray(recording.valid)
    body = recording.contact_bodies[contact]
    pads = [index for index, carrier in enumerate(model.pad_bodies) if model.body_names[carrier] == body]
    if not pads or not on.any():
        return 0.0
    found = np.flatnonzero(on)
    frames = found[np.linspace(0, len(found) - 1, SAMPLED).astype(int)]
    centres = np.asarray(_pad_centres(model, np.asarray(recording.q)[frames]))[:, pads]
    points = np.asarray(recording.contact_point)[frames, contact]
    distance = np.linalg.norm(points[:, None] - centres, axis=2) - np.asarray(model.pad_radius)[pads]
    return float(np.nanmedian(distance.min(axis=1)))


@eqx.filter_jit
def _pad_centres(model: Model, q):
    return jax.vmap(lambda row: pad_positions(model, row))(q)


def _stated(recording: Recording, key: str) -> float | None:
    try:
        value = json.loads(recording.provenance).get(key)
    except (ValueError, AttributeError):
        return None
    return float(value) if isinstance(value, int | float) else None
