"""What looks wrong in the forces of a trial before anything is computed from them."""

import dataclasses
from typing import NamedTuple

import numpy as np

from icjax.capture._cells import beyond_calibration
from icjax.capture._filters import HIGHEST_CUTOFF, lowpass, noise_gain
from icjax.capture._sensors import SensorWrench, sensor_wrench
from icjax.capture._spec import SessionSpec, SourceSpec, TrialSpec
from icjax.files import MotionFile

BASELINE = 10.0
"""An unloaded force above ten times the noise is an offset worth knowing (it is subtracted)."""

FLAT_TOP = 10
"""Successive samples that equal the largest value of a channel: it saturates."""

PULLING = 5.0
"""A force that pulls on the surface this many times harder than it ever presses has the wrong sign."""

UNQUIET = 20.0
"""A tare window in which the force varies by this many times its noise from sample to sample was loaded."""


class Findings(NamedTuple):
    """Texts about one trial: worth knowing, doubtful, and what capture would refuse."""

    notes: list[str]
    doubts: list[str]
    errors: list[str]


def force_findings(spec: SessionSpec, trial: TrialSpec, motion: MotionFile) -> Findings:
    """Empty, constant and saturated channels, baselines, loaded tare windows, reversed signs, missing geometry."""
    found = Findings([], [], [])
    for name, target in trial.touches:
        source = spec.source(name)
        unplaced = source.surface is None and source.kind in ("six_axis", "force_at_point")
        if unplaced and target not in spec.model.pad_names:
            found.errors.append(f"source '{name}' needs a surface, or '{target}' must be a pad of the model")
    for name in dict.fromkeys(name for name, _ in trial.touches):
        source = spec.source(name)
        sensor = sensor_wrench(motion, trial, source, spec.path)
        found.doubts.extend(_channel_doubts(motion, source))
        beyond = beyond_calibration(motion, source)
        if beyond > 0:
            found.doubts.append(f"source '{name}' is above its calibrated range in {100 * beyond:.1f} % of the samples")
        noise = _sample_noise(sensor, spec.filter.events)
        if sensor.unloaded.any():
            quiet = sensor.wrench[sensor.unloaded, 3:]
            offset = np.linalg.norm(_untared(spec, trial, motion, source)[sensor.unloaded, 3:].mean(axis=0))
            if noise > 0 and offset > BASELINE * noise:
                found.notes.append(
                    f"source '{name}' reads {offset:.3g} N unloaded (noise {noise:.2g} N, filtered); tared"
                )
            spread = float(np.max(np.ptp(_smooth(quiet, sensor.rate, spec.filter.events), axis=0)))
            if noise > 0 and spread > UNQUIET * noise:
                found.doubts.append(
                    f"source '{name}' changes by {spread:.3g} N within its tare windows (noise {noise:.2g} N, "
                    "filtered); loaded?"
                )
        found.doubts.extend(_pressing_doubts(spec, trial, sensor, noise))
    return found


def _pressing_doubts(spec: SessionSpec, trial: TrialSpec, sensor: SensorWrench, noise: float) -> list[str]:
    if trial.role != "trial":
        return []
    force = _smooth(sensor.wrench[:, 3:], sensor.rate, spec.filter.events)
    size = float(np.linalg.norm(force, axis=1).max())
    if size < BASELINE * noise:
        return [f"source '{sensor.name}' is never loaded: its force stays below {size:.2g} N"]
    if sensor.surface is None:
        return []
    pressing = force @ np.array(sensor.surface.normal)
    if -pressing.min() > PULLING * max(float(pressing.max()), noise):
        return [
            f"source '{sensor.name}' pulls on its surface with up to {-pressing.min():.3g} N and never presses: "
            "is its sign or the normal reversed?"
        ]
    return []


def _sample_noise(sensor: SensorWrench, cutoff: float) -> float:
    """N; noise of the smoothed force, from differences of successive samples, which a slow load does not enter."""
    steps = np.diff(sensor.wrench[sensor.unloaded, 3:] if sensor.unloaded.sum() > 10 else sensor.wrench[:, 3:], axis=0)
    white = float(np.max(1.4826 * np.median(np.abs(steps), axis=0))) / np.sqrt(2)
    return white * noise_gain(sensor.rate, min(cutoff, HIGHEST_CUTOFF * sensor.rate))


def _smooth(force: np.ndarray, rate: float, cutoff: float) -> np.ndarray:
    return lowpass(force, rate, min(cutoff, HIGHEST_CUTOFF * rate))


def _channel_doubts(motion: MotionFile, source: SourceSpec) -> list[str]:
    doubts = []
    columns = motion.plates[source.plate - 1].channels if source.plate else _columns(motion, source)
    # A point of application on the level floor keeps one coordinate, and the moment about it two.
    forces = columns[:3] if source.kind == "force_at_point" else columns
    for column in columns:
        channel, label = motion.analog[:, column], motion.analog_names[column]
        if not np.isfinite(channel).any():
            doubts.append(f"channel '{label}' is empty")
        elif float(np.nanstd(channel)) == 0 and column in forces:
            doubts.append(f"channel '{label}' is constant")
        elif float(np.nanstd(channel)) > 0 and _saturates(channel):
            doubts.append(f"channel '{label}' stays at its largest value {np.nanmax(np.abs(channel)):g}; saturated?")
    return doubts


def _untared(spec: SessionSpec, trial: TrialSpec, motion: MotionFile, source: SourceSpec) -> np.ndarray:
    return sensor_wrench(
        motion, dataclasses.replace(trial, tare=()), dataclasses.replace(source, tare=(), top=None), spec.path
    ).wrench


def _columns(motion: MotionFile, source: SourceSpec) -> tuple[int, ...]:
    return tuple(motion.analog_names.index(name) for name in source.channels)


def _saturates(channel: np.ndarray) -> bool:
    """Whether a channel rests at one of its extremes."""
    for extreme in (np.nanmax(channel), np.nanmin(channel)):
        at = np.concatenate([[0], (channel == extreme).astype(int), [0]])
        edges = np.diff(at)
        lengths = np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)
        if extreme != 0 and len(lengths) and lengths.max() >= FLAT_TOP:
            return True
    return False
