"""The time around every contact, cut out of a session: angles, torque and inertia of the compliant joints."""

import json
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.capture import lowpass
from icjax.estimation import Motion as SmoothMotion
from icjax.estimation import body_index, joint_torque, smooth_motion, torque_derivatives
from icjax.fit._options import FitOptions
from icjax.model import Model
from icjax.recording import Recording
from icjax.running import on_full_blocks
from icjax.typing import Float

BLOCK = 512
"""Frames with contact that one compiled call takes."""

POINT_SD = 0.5e-3
"""m; how well the place of a force sensor is known in the frame of the cameras, per axis."""

SMEAR = 0.024
"""s about an instant in which the filter shows what happened there."""

FALLBACK_CUTOFF = 20.0
"""Hz, of the derivatives of angles where a recording does not say how it was filtered."""


class Motion(NamedTuple):
    """One recording as the fit needs it, at its own rate, compliant degrees of freedom only.

    - `angle`, `torque` [time, dof]; the torque is filtered as the angles are.
    - `rest_torque` [time, rest]: of the degrees of freedom that are not fitted, filtered too.
    - `by_offset` [time, dof, offset]: derivative of the torque by what is wrong all the time: offsets of all
      coordinates of the model, then places of the contacts (three a contact, world axes).
    - `noise` [dof, dof]: covariance of the frame-to-frame error of the angles; `correlation` [lag]: its
      autocorrelation from the filter, lag in frames.
    - `offset` [offset, offset]: covariance of these; `offset_names` of each.
    """

    recording: Recording
    dofs: tuple[int, ...]
    angle: np.ndarray
    torque: np.ndarray
    rest_torque: np.ndarray
    by_offset: np.ndarray
    noise: np.ndarray
    correlation: np.ndarray
    offset: np.ndarray
    offset_names: tuple[str, ...]
    valid: np.ndarray


def motion_of(recording: Recording, dofs: tuple[int, ...]) -> Motion:
    """Angles and torque of a recording in one bandwidth.

    A frame is valid where the pose is known and, within `SMEAR` of it, the torque of what touches.

    **Errors**: `ValueError` for a compliant joint that is no hinge or slide, or a recording without a valid frame or
    without knowledge of how exact its angles and their offsets are.
    """
    model, columns = recording.model, list(dofs)
    cutoff = _cutoff(recording)
    rate = recording.rate
    coordinates = _coordinates(model, dofs)
    measured = np.asarray(joint_torque(recording))
    finite: np.ndarray = np.asarray(np.all(np.isfinite(np.asarray(recording.q)), axis=1))
    unknown: np.ndarray = np.asarray(np.any(~np.isfinite(measured), axis=1))
    valid = np.asarray(recording.valid) & finite & ~_spread(unknown, SMEAR, SMEAR, rate)
    angle = np.asarray(recording.q)[:, coordinates]
    every = np.nan_to_num(measured)
    by_offset = _torque_by_offset(recording)[:, columns]
    correlation = np.zeros(len(recording.time))
    correlation[0] = 1.0
    if cutoff is not None:
        every, by_offset = lowpass(every, rate, cutoff), lowpass(by_offset, rate, cutoff)
        impulse = np.zeros(4 * len(recording.time))
        impulse[2 * len(recording.time)] = 1.0
        response = np.fft.rfft(lowpass(impulse, rate, cutoff))
        power = np.fft.irfft(np.abs(response) ** 2)
        correlation = power[: len(recording.time)] / power[0]
    noise = _frame_noise(recording, valid, columns)
    offset = recording.q_offset_covariance
    offset = np.diag(np.asarray(recording.q_offset_sd) ** 2) if offset is None else np.asarray(offset)
    places = tuple(f"{contact} {axis}" for contact in recording.contact_names for axis in "xyz")
    whole = np.zeros((model.nv + len(places),) * 2)
    if not np.isfinite(offset).all():
        raise ValueError(
            f"{recording.role} {recording.name!r}: q_offset_sd (or q_offset_covariance) is not finite; a fit must know "
            "how far marker placement may be wrong"
        )
    whole[: model.nv, : model.nv] = offset
    whole[model.nv :, model.nv :] = POINT_SD**2 * np.eye(len(places))
    return Motion(
        recording, dofs, angle, every[:, columns], np.delete(every, columns, axis=1), by_offset, noise, correlation,
        whole, (*model.dof_names, *places), valid,
    )  # fmt: skip


def _frame_noise(recording: Recording, valid: np.ndarray, columns: list[int]) -> np.ndarray:
    """Mean covariance [dof, dof] of the angles over the valid frames that state it."""
    if not valid.any():
        raise ValueError(f"{recording.role} {recording.name!r}: no frame has a pose")
    covariance = np.asarray(recording.q_covariance, float)[valid][:, columns][:, :, columns]
    stated = np.isfinite(covariance).all(axis=(1, 2))
    if not stated.any():
        raise ValueError(
            f"{recording.role} {recording.name!r}: q_covariance is not finite in any frame; a fit must know how exact "
            "the angles are"
        )
    return covariance[stated].mean(axis=0)


def without_contact(motion: Motion, before: float, after: float) -> Motion:
    """The same, valid only where nothing touches, nor within `before` s of an onset or `after` s of a release."""
    recording = motion.recording
    touched: np.ndarray = np.asarray(np.any(np.asarray(recording.touching), axis=1))
    if not touched.any():
        return motion
    return motion._replace(valid=motion.valid & ~_spread(touched, before, after, recording.rate))


def _spread(found: np.ndarray, before: float, after: float, rate: float) -> np.ndarray:
    """Where something is found within `before` s later or `after` s earlier."""
    lead, tail = (int(np.ceil(seconds * rate)) for seconds in (before, after))
    return np.convolve(found, np.ones(lead + tail + 1))[lead : lead + len(found)] > 0.5


def smoothed(motion: Motion) -> SmoothMotion:
    """The whole movement with velocity and acceleration, smoothed as it was filtered."""
    recording = motion.recording
    cutoff = _cutoff(recording) or FALLBACK_CUTOFF
    return smooth_motion(recording.model, recording.time, recording.q, cutoff, motion.valid)


def contact_frames(motion: Motion, event: int, options: FitOptions) -> tuple[int, int, int]:
    """First frame, frame of the onset and last frame of an event's window.

    It begins where nothing has touched for a while and ends with the event; what else touches meanwhile is part of the
    torque, so that the fingers of a grasp share the window of the first (in order of the events where two touch at
    the same time).
    """
    recording = motion.recording
    events, rate = recording.events, recording.rate
    onset, release = np.asarray(events.onset, float), np.asarray(events.release, float)
    here, begin = onset[event], float(np.asarray(recording.time)[0])
    earlier = (onset < here) | ((onset == here) & (np.arange(len(onset)) < event))
    ended = np.where(np.isnan(release), np.inf, release)
    free_from = np.max(ended[earlier], initial=begin - options.settle) + options.settle
    until = min(ended[event], here + options.after, float(np.asarray(recording.time)[-1]))
    free_from = min(free_from, here)  # where something else touches all the while: no free movement, nor a window
    first = int(np.ceil((max(here - options.before, free_from) - begin) * rate))
    last = int(np.floor((until - begin) * rate))
    return first, round((here - begin) * rate), last


def _torque_by_offset(recording: Recording) -> Float[np.ndarray, "time dof offset"]:
    bodies = tuple(body_index(recording.model, name) for name in recording.contact_bodies)
    on = np.flatnonzero(np.asarray(recording.touching).any(axis=1))
    nv = recording.model.nv
    result = np.zeros((len(recording.time), nv, nv + 3 * len(recording.contact_names)))
    if on.size:
        rows = (recording.q, recording.contact_force, recording.contact_point, recording.contact_moment)
        arrays = [np.nan_to_num(np.asarray(row)[on]) for row in rows] + [np.asarray(recording.touching)[on]]
        result[on] = np.asarray(on_full_blocks(partial(_all_by_offset, recording.model, bodies), *arrays, block=BLOCK))
    return result


@eqx.filter_jit
def _all_by_offset(model, bodies, *rows):
    def at(row):
        D, _, P = torque_derivatives(model, bodies, *row)
        return jnp.concatenate([D, P.reshape(P.shape[0], -1)], axis=1)

    return jax.lax.map(at, rows, batch_size=BLOCK)


def _coordinates(model: Model, dofs: tuple[int, ...]) -> list[int]:
    found = []
    for kind, at, span, name in zip(
        model.joint_types, model.coordinate_slices, model.dof_slices, model.joint_names, strict=True
    ):
        wanted = [dof for dof in dofs if span.start <= dof < span.stop]
        if wanted and kind not in ("hinge", "slide"):
            raise ValueError(f"joint {name!r} is a {kind} joint; a fit takes hinges and slides only")
        found += [at.start + dof - span.start for dof in wanted]
    return found


def _cutoff(recording: Recording) -> float | None:
    """Hz at which the recording's angles were filtered, None where they were not or it is not known."""
    try:
        said = json.loads(recording.provenance).get("filter_hz", {})
    except (ValueError, AttributeError):
        return None
    cutoff = said.get("markers") if len(recording.marker_names) else said.get("angles")
    return float(cutoff) if cutoff and cutoff < 0.38 * recording.rate else None
