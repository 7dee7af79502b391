"""The contacts of a pressure sensitive ball as those of a recording."""

import dataclasses
import json
from functools import partial
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float

from icjax.capture._ball import BallContacts, BallSpec, ball_contacts, ball_pose
from icjax.capture._ball_friction import balanced_friction, lifted
from icjax.capture._filters import runs
from icjax.capture._plate_motion import GRAVITY
from icjax.files import FileError, MotionFile
from icjax.model import Model, pad_positions
from icjax.recording import ContactEvents, Recording
from icjax.running import on_full_blocks
from icjax.typing import Real

THRESHOLD_SD = 5.0
"""A cell is loaded above so many standard deviations of what it shows when nothing touches it."""


def ball_recording(
    recording: Recording,
    motion: MotionFile,
    ball: BallSpec,
    pressure: MotionFile,
    *,
    reach: float = 0.006,
    cutoff: float = 20.0,
) -> Recording:
    """A recording with the contacts that a pressure sensitive ball measured.

    The ball's pose is that of its markers, fingertips are where the joint angles put them; every sample of the pressure
    map is taken apart by `ball_contacts`. Between samples force and centre of pressure follow straight lines on the
    ball, and the ball carries them; a contact begins and ends half-way between samples. A contact is that of a pad
    of the model and has its name. Slow and coarse as such a map is, it is meant for a reference trajectory with
    compliances known from elsewhere (`EstimationOptions(given=...)`), not for estimating them.

    Only normal forces are measured. Where the ball's mass is stated, and it is lifted from where it lay in the tare
    windows (along z), so that nothing but fingertips holds it, friction is completed by what balances its weight
    ([`balanced_friction`]); without it a reference trajectory would hold a free ball millimetres from where it was.

    **Arguments**

    - `recording`: angles of the hand, as `capture` returns it for a trial that touches no source.
    - `motion`: the file that it is from, with the ball's markers.
    - `ball`: from `read_ball`. `pressure`: a channel a cell, on the marker clock.
    - `reach` m: see `ball_contacts`. `cutoff` Hz: of the ball's markers.

    **Returns** the recording with contacts (`contact_kinds` "pressure_array": no measured friction) and events.

    **Errors**: `ValueError` for a model without pads; `FileError` for a cell or marker that a file lacks, samples that
    are not finite, no sample in the tare windows, or a pressure map that does not cover the movement.

    **Source**: Kry and Pai 2006, section 8.2.
    """
    model = recording.model
    if not model.pad_names:
        raise ValueError(f"recording '{recording.name}': its model has no pads that could touch the ball")
    time, frames = pressure.analog_time, np.asarray(recording.time)
    values, threshold = _tared(ball, pressure)
    period = float(time[-1] - time[0]) / (len(time) - 1)
    if time[0] > frames[0] + period or time[-1] < frames[-1] - period:
        raise FileError(
            pressure.path,
            f"covers {time[0]:g} to {time[-1]:g} s; the movement is from {frames[0]:g} to {frames[-1]:g} s",
        )
    R, p = ball_pose(ball, motion, cutoff)
    pads = np.asarray(on_full_blocks(partial(_pads, model), recording.q))
    local = np.einsum("fji,fkj->fki", R, pads - p[:, None])
    inside = np.clip(time, frames[0], frames[-1])
    at = np.stack([np.interp(inside, frames, column) for column in local.reshape(len(frames), -1).T], axis=1)
    found = ball_contacts(ball, values, at.reshape(len(time), -1, 3), np.asarray(model.pad_radius), threshold, reach)
    pressed, normal, touching, events = _between_samples(found, time, frames, period)
    outward = np.einsum("fij,fkj->fki", R, normal)
    point = ball.radius * outward + p[:, None]
    force = np.where(touching[:, :, None], pressed[:, :, None] * outward, 0.0)
    if ball.mass is not None:
        free = lifted(p[:, 2], _within(frames, ball.tare))[:, None, None]
        carried = balanced_friction(force, ball.radius * outward, touching, ball.mass * GRAVITY)
        force = force + free * (carried - force)
    provenance = json.loads(recording.provenance or "{}")
    provenance["normal_only"] = list(model.pad_names)
    provenance["pressure_ball"] = {
        "file": Path(pressure.path).name,
        "rate_hz": 1.0 / period,
        "cells": len(ball.cells),
        "reach_m": reach,
        "friction": "not measured" if ball.mass is None else "from the balance of the lifted ball",
        "largest_force_elsewhere_n": float(found.elsewhere.max()),
    }
    return dataclasses.replace(
        recording,
        contact_names=tuple(model.pad_names),
        contact_bodies=tuple(model.body_names[body] for body in model.pad_bodies),
        contact_force=force,
        contact_point=np.where(touching[:, :, None], point, np.nan),
        contact_moment=np.zeros_like(force),
        touching=touching,
        events=events,
        contact_kinds=("pressure_array",) * len(model.pad_names),
        contact_force_sd=None,
        contact_point_sd=None,
        provenance=json.dumps(provenance),
    )


@eqx.filter_jit
def _pads(model: Model, q: Float[Real, "frame coordinate"]) -> Float[Real, "frame pad 3"]:
    return jax.vmap(lambda row: pad_positions(model, row))(q)


def _tared(ball: BallSpec, pressure: MotionFile) -> tuple[np.ndarray, np.ndarray]:
    """Force of every cell [sample, cell] less its mean in the tare windows, and the threshold of every cell, N."""
    channels = tuple(cell.channel for cell in ball.cells)
    values = pressure.channels(channels) * np.array([cell.scale for cell in ball.cells])
    bad = ~np.isfinite(values)
    if bad.any():
        sample, cell = np.argwhere(bad)[0]
        raise FileError(
            pressure.path, f"cell '{channels[cell]}' is not a finite number at {pressure.analog_time[sample]:g} s"
        )
    unloaded = _within(pressure.analog_time, ball.tare)
    if unloaded.sum() < 5:
        raise FileError(
            pressure.path, f"has {unloaded.sum()} samples in the tare windows of {ball.path.name}; it needs five"
        )
    rest = values[unloaded]
    # Few samples make the deviation of one cell uncertain, all cells together do not: the larger of both counts.
    deviation = np.maximum(rest.std(axis=0), np.sqrt(np.mean(rest.var(axis=0))))
    return values - rest.mean(axis=0), THRESHOLD_SD * deviation


def _within(time: np.ndarray, windows: tuple[tuple[float, float], ...]) -> Bool[np.ndarray, " frame"]:
    return np.any([(time >= start - 1e-9) & (time <= stop + 1e-9) for start, stop in windows], axis=0)


def _between_samples(
    found: BallContacts, time: np.ndarray, frames: np.ndarray, period: float
) -> tuple[
    Float[np.ndarray, "frame finger"],
    Float[np.ndarray, "frame finger 3"],
    Bool[np.ndarray, "frame finger"],
    ContactEvents,
]:
    """Normal force, normal in the ball's frame and touching at the frames, and the events."""
    fingers = found.pressed.shape[1]
    pressed, normal = np.zeros((len(frames), fingers)), np.full((len(frames), fingers, 3), np.nan)
    touching, events = np.zeros((len(frames), fingers), bool), []
    for finger in range(fingers):
        for start, stop in runs(found.touching[:, finger]):
            onset = float(time[start]) - 0.5 * period if start > 0 else float(frames[0])
            release = float(time[stop - 1]) + 0.5 * period if stop < len(time) else float("nan")
            on = (frames >= onset) & ~(frames > release)
            events.append((onset, release, finger))
            touching[on, finger] = True
            pressed[on, finger] = np.interp(frames[on], time, found.pressed[:, finger])
            own = found.normal[start:stop, finger]
            mean = np.stack([np.interp(frames[on], time[start:stop], column) for column in own.T], axis=1)
            normal[on, finger] = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    events.sort()
    return (
        pressed,
        normal,
        touching,
        ContactEvents(
            onset=np.array([item[0] for item in events]),
            release=np.array([item[1] for item in events]),
            contact=np.array([item[2] for item in events], dtype=np.int64),
        ),
    )
