"""Do the forces of a trial come when its pads meet the surface? A check of clocks that are said to be one."""

import numpy as np

from icjax.capture._contact_lag import Signal, clock_from_contacts
from icjax.capture._contacts import Contacts
from icjax.capture._joint_angles import JointAngles
from icjax.capture._sensors import SensorWrench
from icjax.capture._spec import SessionSpec, TrialSpec

WITHIN = 0.4
"""s; larger delays are not looked for."""

CONTACTS = 2
"""Fewer contacts make no rhythm: a surface that moves may look like a delay."""

CORRELATION = 0.7
"""Depth and force of a pad on a fixed surface correlate by more than that when one is shifted onto the other."""


def force_delays(
    spec: SessionSpec,
    trial: TrialSpec,
    sensors: tuple[SensorWrench, ...],
    contacts: Contacts,
    angles: JointAngles,
    time: np.ndarray,
) -> dict[str, dict[str, float]]:
    """How long after the pad meets the surface the force appears, and the standard error, s, for every source.

    The correlation of `clock_from_contacts`, the pad's height taken from the solved poses. Sources without a surface,
    without one pad that touches them at least twice, and those whose correlation settles nothing are left out.
    """
    model, found = spec.model, {}
    usable = angles.valid & np.isfinite(angles.body_positions).all(axis=(1, 2))
    if usable.sum() < 2:
        return {}
    for sensor in sensors:
        source = spec.source(sensor.name)
        own = [index for index, (name, _) in enumerate(trial.touches) if name == sensor.name]
        target = trial.touches[own[0]][1]
        if source.surface is None or len(own) > 1 or target not in model.pad_names:
            continue
        if sum(item[2] == own[0] for item in contacts.events) < CONTACTS:
            continue
        pad, normal = model.pad(target), np.array(source.surface.normal)
        body = model.pad_bodies[pad]
        centre = angles.body_rotations[usable, body] @ np.asarray(model.pad_centre)[pad]
        centre = centre + angles.body_positions[usable, body]
        height = np.interp(time, time[usable], (centre - np.array(source.surface.point)) @ normal)
        force = np.nan_to_num(sensor.wrench[:, 3:] @ normal)
        radius = float(np.asarray(model.pad_radius)[pad])
        try:
            clock = clock_from_contacts(
                Signal(time, height), radius, Signal(sensor.time, force), 0.0, WITHIN, 1e-4, CORRELATION
            )
        except ValueError:
            continue
        found[sensor.name] = {"delay": clock.offset, "sd": clock.offset_sd}
    return found
