"""Are the contacts of a stored recording those of the bodies that are said to make them?"""

import json
from collections.abc import Iterator

import equinox as eqx
import jax
import numpy as np

from icjax.capture._check import ERROR, SUSPICIOUS
from icjax.model import Model, forward_kinematics, pad_positions
from icjax.recording import NORMAL_ONLY, Recording

SAMPLED = 64
"""Frames of contact at which its point is compared with pad, body and force."""

FAR_FROM_PAD = 0.5
"""Of the pad's radius; a contact lies on the surface of its pad, which is pressed in by less than that."""

FAR_FROM_FORCE = 0.01
"""m; a force without a free moment passes through its contact point."""

FAR_FROM_BODY = 0.1
"""m; a contact lies this near, or as near as half of the body's length, to a marker or joint of that body."""

RARELY = 0.5
"""A centre of pressure that is used in fewer of the contact's frames hides where the sensor says the force is."""

PULLS = 0.02
"""Of the time; a surface that is touched pushes, and never pulls for longer than a spike."""

LATE = 0.01
"""s; forces that come later or earlier than the pad's touch spoil windows of 0.1 s."""

LATE_SDS = 5.0
"""Standard errors that such a delay must exceed."""

LARGE_FORCE = 5e3
"""N; six times the weight of a heavy person."""

Finding = tuple[str, str]
"""`ERROR` or `SUSPICIOUS`, and the text."""


def contact_findings(recording: Recording) -> Iterator[Finding]:
    """What contradicts itself, and what is too far away to be meant."""
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
        yield from _compression(recording, index)
        yield from _place(recording, index)
    for source in dict.fromkeys(name.split(":")[0] for name in recording.contact_names):
        yield from _course(recording, source)
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


def _place(recording: Recording, contact: int) -> Iterator[Finding]:
    """Where the contact is, seen from the body that makes it and from the force's line of action."""
    model, name, body = recording.model, recording.contact_names[contact], recording.contact_bodies[contact]
    on = np.asarray(recording.touching)[:, contact] & np.asarray(recording.valid)
    on &= np.isfinite(np.asarray(recording.q)).all(axis=1)
    if not on.any() or body not in (*model.body_names, *model.pad_names):
        return
    found = np.flatnonzero(on)
    rows = np.unique(found[np.linspace(0, len(found) - 1, SAMPLED).astype(int)])
    q, point = np.asarray(recording.q)[rows], np.asarray(recording.contact_point)[rows, contact]
    carrier = model.body(body) if body in model.body_names else model.pad_bodies[model.pad(body)]
    pads = [index for index, own in enumerate(model.pad_bodies) if own == carrier]
    if pads:
        centres = np.asarray(_pad_centres(model, q))[:, pads]
        radius = np.asarray(model.pad_radius)[pads]
        distance = np.linalg.norm(point[:, None] - centres, axis=2) - radius
        nearest = np.argmin(np.abs(distance), axis=1)
        far = abs(_typical(distance[np.arange(len(rows)), nearest]))
        least, what = FAR_FROM_PAD * float(radius.max()), f"the surface of the pad of {body}"
    else:
        places = _places(model, carrier, q)
        distance = np.linalg.norm(point[:, None] - places, axis=2)
        extent = float(np.linalg.norm(np.ptp(places[0], axis=0)))
        far, least, what = (
            _typical(distance.min(axis=1)),
            max(FAR_FROM_BODY, extent / 2),
            f"{body}, of {1e3 * extent:.0f} mm",
        )
    if far > least:
        yield (
            SUSPICIOUS,
            f"the contact point of '{name}' lies {1e3 * far:.0f} mm off {what} (median): does that body touch it, "
            "and are the source's position, rotation and sign right?",
        )
    else:
        lever = _lever(recording, contact, rows)
        if lever > FAR_FROM_FORCE:
            yield (
                SUSPICIOUS,
                f"the force of '{name}' passes {1e3 * lever:.0f} mm beside its contact point (median): are the "
                "source's position, rotation and unit of moment right?",
            )


def _compression(recording: Recording, contact: int) -> Iterator[Finding]:
    """A force that presses a soft pad flat is in another unit; the share of frames with a centre of pressure."""
    model, name, body = recording.model, recording.contact_names[contact], recording.contact_bodies[contact]
    force = np.linalg.norm(np.asarray(recording.contact_force)[:, contact], axis=1)
    largest = float(np.max(force, initial=0.0, where=np.isfinite(force)))
    for pad, carrier in enumerate(model.pad_bodies):
        pressed = largest * float(np.asarray(model.pad_compliance)[pad])
        if model.body_names[carrier] == body and pressed > 2 * float(np.asarray(model.pad_radius)[pad]):
            yield (
                SUSPICIOUS,
                f"the largest force of '{name}', {largest:.3g} N, would compress the pad of {body} by "
                f"{1e3 * pressed:.0f} mm; forces must be in N",
            )
    share = stated(recording, "contact_thresholds_n", name.split(":")[0], "centre_of_pressure_share")
    if share is not None and share < RARELY:
        yield (
            SUSPICIOUS,
            f"the centre of pressure of '{name}' is too uncertain in {1 - share:.0%} of the contact's frames, where "
            "the place of the pad is taken instead: is the unit of its moments right, is the sensor far away?",
        )


def _course(recording: Recording, source: str) -> Iterator[Finding]:
    """A force that pulls, or that comes when nothing meets the surface."""
    pulling = stated(recording, "contact_thresholds_n", source, "pulling_share")
    if pulling is not None and pulling > PULLS:
        yield (
            SUSPICIOUS,
            f"the force of '{source}' pulls at the subject in {pulling:.0%} of the time: does something touch in its "
            "tare window, does it drift, is its sign wrong?",
        )
    delay, sd = (stated(recording, "force_delays_s", source, key) for key in ("delay", "sd"))
    if delay is not None and sd is not None and abs(delay) > max(LATE, LATE_SDS * sd):
        when = "after" if delay > 0 else "before"
        yield (
            SUSPICIOUS,
            f"the force of '{source}' comes {1e3 * abs(delay):.0f} +- {1e3 * sd:.0f} ms {when} the pad meets the "
            "surface: are both clocks the same? [clock] correlate takes such a delay out",
        )


def stated(recording: Recording, *keys: str) -> float | None:
    """A number that capture wrote down in the provenance, under nested keys; None where there is none."""
    try:
        found = json.loads(recording.provenance)
        for key in keys:
            found = found[key]
    except (ValueError, TypeError, KeyError):
        return None
    return float(found) if isinstance(found, int | float) else None


def _typical(distance: np.ndarray) -> float:
    return float(np.median(distance[np.isfinite(distance)])) if np.isfinite(distance).any() else 0.0


def _places(model: Model, body: int, q: np.ndarray) -> np.ndarray:
    """World places of the body's origin, its sites and the origins of its children, `[frame, place, 3]`."""
    rotation, position = (np.asarray(item) for item in _bodies(model, q))
    sites = np.asarray(model.site_position)[[index for index, own in enumerate(model.site_bodies) if own == body]]
    on_sites = np.einsum("fij,sj->fsi", rotation[:, body], sites) + position[:, body, None]
    children = [index for index, parent in enumerate(model.body_parents) if parent == body]
    return np.concatenate([position[:, [body, *children]], on_sites], axis=1)


def _lever(recording: Recording, contact: int, rows: np.ndarray) -> float:
    """m; median distance of the measured force's line of action from the contact point, 0 where it was not measured."""
    channels, name = recording.channels, recording.contact_names[contact].split(":")[0]
    normal_only = bool(recording.contact_kinds) and recording.contact_kinds[contact] in NORMAL_ONLY
    if normal_only or name not in channels.sensor_names:
        return 0.0
    wrench = np.asarray(channels.wrench)[:, channels.sensor_names.index(name)]
    time = np.asarray(recording.time)[rows]
    wrench = np.stack([np.interp(time, np.asarray(channels.time), column) for column in wrench.T], axis=1)
    moment, force = wrench[:, :3], wrench[:, 3:]
    point, free = (
        np.asarray(recording.contact_point)[rows, contact],
        np.asarray(recording.contact_moment)[rows, contact],
    )
    size = np.linalg.norm(force, axis=1)
    left = np.cross(moment - np.cross(point, force) - free, force)
    return _typical(np.linalg.norm(left, axis=1) / np.where(size > 0, size, np.nan) ** 2)


@eqx.filter_jit
def _bodies(model: Model, q):
    poses = jax.vmap(lambda row: forward_kinematics(model, row))(q)
    return poses.rotation, poses.position


@eqx.filter_jit
def _pad_centres(model: Model, q):
    return jax.vmap(lambda row: pad_positions(model, row))(q)
