"""Which clock a trial's forces were recorded on, from what its session file says about [clock]."""

import dataclasses

import numpy as np

from icjax.capture._clock import Clock, clock_from_pulses
from icjax.capture._contact_lag import Signal, clock_from_contacts, pad_heights
from icjax.capture._pulses import Edges, rising_edges
from icjax.capture._sensors import sensor_wrench
from icjax.capture._spec import ClockSpec, SessionSpec, TrialSpec
from icjax.files import FileError, MotionFile


def trial_clock(spec: SessionSpec, trial: TrialSpec, markers: MotionFile, motion: MotionFile) -> Clock | None:
    """Clock of the forces of a trial; None where they come with the markers or the session has no [clock].

    **Arguments**: `markers`: the marker file with its own channels; `motion`: markers and forces together, their times
    as found.

    **Errors**: `FileError` naming the force file: no pulses, pulses that do not fit, or no certain correlation.
    """
    clock = spec.clock
    if clock is None or trial.forces is None:
        return None
    try:
        if clock.sync is not None:
            edges, reference = _pulses(clock, markers, dataclasses.replace(motion, path=str(trial.forces)))
            sample = 1.0 / motion.analog_rate
            return clock_from_pulses(edges, reference, sample, clock.drift_sd, clock.offset, clock.marker_sync is None)
        return _from_contacts(spec, clock, trial, motion)
    except FileError:
        raise
    except ValueError as error:
        raise FileError(trial.forces, f"its clock cannot be found: {error}") from error


def pulse_errors(clock: ClockSpec, motion: MotionFile) -> np.ndarray:
    """How late the pulses of a shared acquisition rise against where they should, s, one a pulse.

    **Errors**: `FileError` for a missing channel, `ValueError` for a channel without pulses.
    """
    assert clock.sync is not None
    assert clock.period is not None
    edges = rising_edges(motion.channels([clock.sync])[:, 0], motion.analog_time)
    k = np.round((edges.time - clock.start) / clock.period)
    return edges.time - clock.start - k * clock.period


def _pulses(clock: ClockSpec, markers: MotionFile, motion: MotionFile) -> tuple[Edges, np.ndarray]:
    assert clock.sync is not None
    edges = _edges(motion, clock.sync)
    if clock.period is None:
        assert clock.marker_sync is not None
        return edges, _edges(markers, clock.marker_sync).time
    if edges.began_high and clock.offset is None:
        raise ValueError(
            f"channel '{clock.sync}' begins within a pulse, so the first edge may be any pulse of the train; give the "
            "approximate offset as the key 'offset' of [clock]"
        )
    span = float(edges.time[-1] - edges.time[0]) if len(edges.time) else 0.0
    count = int(np.floor(span / clock.period + 0.5)) + 1
    if clock.offset is not None:
        count += int(np.ceil(abs(clock.offset) / clock.period)) + 1
    return edges, clock.start + clock.period * np.arange(count)


def _edges(motion: MotionFile, name: str) -> Edges:
    try:
        return rising_edges(motion.channels([name])[:, 0], motion.analog_time)
    except FileError:
        raise
    except ValueError as error:
        raise ValueError(f"channel '{name}' of {motion.path} {error}") from error


def _from_contacts(spec: SessionSpec, clock: ClockSpec, trial: TrialSpec, motion: MotionFile) -> Clock:
    """Clock from the depth of the touching pad and the force of the source, tared by their medians."""
    model = spec.model
    target = dict(trial.touches).get(str(clock.correlate))
    source = spec.source(str(clock.correlate))
    if target not in model.pad_names or source.kind != "six_axis" or source.surface is None:
        raise ValueError(
            f"[clock] correlate = '{clock.correlate}' needs a six_axis source with a surface that a pad touches"
        )
    pad = model.pad(target)
    labels = [(label, model.site(site)) for label, site in spec.markers]
    own = [(label, site) for label, site in labels if model.site_bodies[site] == model.pad_bodies[pad]]
    if len(own) < 3:
        raise ValueError(f"pad '{target}' sits on a body with {len(own)} markers; its height needs three")
    height = pad_heights(
        np.asarray(model.site_position)[[site for _, site in own]],
        np.asarray(model.pad_centre)[pad],
        np.stack([motion.marker(label) for label, _ in own], axis=1),
        motion.marker_time,
        np.array(source.surface.point),
        np.array(source.surface.normal),
    )
    plain = dataclasses.replace(source, tare=(), top=None)
    sensor = sensor_wrench(motion, dataclasses.replace(trial, tare=None), plain, spec.path)
    force = sensor.wrench[:, 3:] @ np.array(source.surface.normal)
    signal = Signal(motion.analog_time, force - np.median(force))
    radius = float(np.asarray(model.pad_radius)[pad])
    return clock_from_contacts(height, radius, signal, clock.offset or 0.0, clock.within, clock.drift_sd)
