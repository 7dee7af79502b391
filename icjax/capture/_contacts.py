"""The contacts of a trial: which body touches which source when, with what force and where."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from icjax.capture._cells import CellForces, cell_contact, pad_place, touched_body, world_wrench
from icjax.capture._contact_noise import force_noise, moment_noise, point_deviation
from icjax.capture._contact_point import contact_points
from icjax.capture._events import contact_events, force_course
from icjax.capture._joint_angles import JointAngles
from icjax.capture._sensors import SensorWrench
from icjax.capture._spec import SessionSpec, TrialSpec
from icjax.capture._synchronise import on_marker_clock, resampled
from icjax.files import FileError
from icjax.model import Model
from icjax.recording import SensorChannels

Interval = tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Contacts:
    """Contact channels of a trial, one a pair of source and body, as `Recording` holds them.

    `events`: (onset, release, channel), in order of onset; `thresholds`: what each source's noise asked for;
    `force_sd` N and `point_sd` m: see `force_noise` and `point_deviation`.
    """

    names: tuple[str, ...]
    bodies: tuple[str, ...]
    force: Float[np.ndarray, "frame contact 3"]
    point: Float[np.ndarray, "frame contact 3"]
    moment: Float[np.ndarray, "frame contact 3"]
    touching: Bool[np.ndarray, "frame contact"]
    events: list[tuple[float, float, int]]
    thresholds: dict[str, dict[str, float]]
    force_sd: Float[np.ndarray, " contact"]
    point_sd: Float[np.ndarray, "frame contact"]


def trial_contacts(
    spec: SessionSpec,
    trial: TrialSpec,
    sensors: tuple[SensorWrench, ...],
    angles: JointAngles,
    time: Float[np.ndarray, " frame"],
) -> Contacts:
    """Events of every source, each given to the body that made it, with force, point and moment at the frames.

    A source that several bodies touch in turn gives each of its contacts to the pad that is nearest to the line
    along which the force acts (median over the contact). Several at once on one source cannot be told apart.

    **Errors**: `FileError` naming the session and the trial.
    """
    count = len(trial.touches)
    force, point, moment = (np.zeros((len(time), count, 3)) for _ in range(3))
    force_sd, point_sd = np.full(count, np.nan), np.full((len(time), count), np.nan)
    touching = np.zeros((len(time), count), bool)
    events: list[tuple[float, float, int]] = []
    bodies, names, thresholds = [""] * count, [""] * count, {}
    for sensor in sensors:
        own = [index for index, (name, _) in enumerate(trial.touches) if name == sensor.name]
        targets = [trial.touches[index][1] for index in own]
        course = force_course(sensor, spec.filter.events, spec.contact)
        found = contact_events(course, spec.contact)
        # A force recording may be longer than the movement's; what it holds beside it is no event of the trial.
        found = [(on, off) for on, off in found if on <= time[-1] and not off < time[0]]
        thresholds[sensor.name] = {"noise": course.noise, "onset": course.onset, "release": course.release}
        if sensor.surface is not None:
            thresholds[sensor.name]["pulling_share"] = float(np.mean(course.value < -course.onset))
        wrench = on_marker_clock(sensor, time, spec.filter.forces)
        try:
            who = _who_touched(spec.model, targets, angles, wrench, time, found)
            for which, (index, target) in enumerate(zip(own, targets, strict=True)):
                names[index] = sensor.name if len(own) == 1 else f"{sensor.name}:{target}"
                bodies[index] = spec.model.body_names[touched_body(spec.model, target)]
                mine = [interval for interval, toucher in zip(found, who, strict=True) if toucher == which]
                events += [(onset, release, index) for onset, release in mine]
                on = _during(mine, time) & np.isfinite(wrench).all(axis=1)
                force_sd[index] = force_noise(sensor, spec.filter.forces)
                if sensor.pressing is not None:
                    pressing = resampled(sensor.pressing, sensor.time, sensor.rate, time, spec.filter.forces)
                    cells = CellForces(wrench, pressing)
                    contact = cell_contact(spec.model, spec.source(sensor.name), target, angles, cells, on)
                    force[:, index], point[:, index], moment[:, index] = contact
                    touching[:, index] = on & np.isfinite(contact.point).all(axis=1)
                    point_sd[touching[:, index], index] = spec.contact.point_sd
                    continue
                noise = moment_noise(sensor, spec.filter.forces, wrench[on])
                least = max(course.onset, noise / spec.contact.point_sd)
                thresholds[sensor.name]["centre_of_pressure_above"] = least
                if sensor.surface is not None and on.any():
                    used = wrench[on, 3:] @ np.array(sensor.surface.normal) >= least
                    thresholds[sensor.name]["centre_of_pressure_share"] = float(np.mean(used))
                centre, radius = _pad(spec.model, target, angles)
                point[:, index], moment[:, index] = _points(sensor, wrench, on, centre, radius, least)
                force[:, index] = np.where(on[:, None], wrench[:, 3:], 0.0)
                touching[:, index] = on
                point_sd[:, index] = point_deviation(force[:, index], sensor, noise, least, spec.contact.point_sd)
        except ValueError as error:
            raise FileError(spec.path, f"[[trial]] '{trial.name}': {error}") from error
    events.sort()
    return Contacts(tuple(names), tuple(bodies), force, point, moment, touching, events, thresholds, force_sd, point_sd)


def _during(intervals: list[Interval], time: np.ndarray) -> np.ndarray:
    on = np.zeros(len(time), bool)
    for onset, release in intervals:
        on |= (time >= onset) & ~(time > release)
    return on


def _who_touched(
    model: Model, targets: list[str], angles: JointAngles, wrench: np.ndarray, time: np.ndarray, found: list[Interval]
) -> list[int]:
    """Index of the target behind each contact: the pad nearest to the force's line of action, |m - c x f| / |f|."""
    if len(targets) == 1:
        return [0] * len(found)
    distances = []
    for target in targets:
        centre, _ = _pad(model, target, angles)
        if centre is None:
            raise ValueError(f"'{target}' is not a pad; bodies that touch one source in turn are told apart by pads")
        size = np.maximum(np.linalg.norm(wrench[:, 3:], axis=1), 1e-12)
        distances.append(np.linalg.norm(wrench[:, :3] - np.cross(centre, wrench[:, 3:]), axis=1) / size)
    table = np.stack(distances, axis=1)
    who = []
    for interval in found:
        on = _during([interval], time) & np.isfinite(table).all(axis=1)
        who.append(int(np.argmin(np.median(table[on], axis=0))) if on.any() else 0)
    return who


def _pad(model: Model, target: str, angles: JointAngles) -> tuple[np.ndarray | None, float]:
    """Centre at every frame and radius of a touched pad; None and zero for a body."""
    if target not in model.pad_names:
        return None, 0.0
    pad = model.pad(target)
    body = model.pad_bodies[pad]
    place = np.asarray(model.pad_centre)[pad]
    centre = angles.body_rotations[:, body] @ place + angles.body_positions[:, body]
    return centre, float(np.asarray(model.pad_radius)[pad])


def _points(
    sensor: SensorWrench,
    wrench: np.ndarray,
    touching: np.ndarray,
    centre: np.ndarray | None,
    radius: float,
    least: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Contact points and free moments; on a surface that moves, they are found in its place at rest and carried."""
    carrier = sensor.carrier
    if carrier is None:
        return contact_points(wrench, touching, sensor.surface, centre, radius, least)
    R, origin = carrier.rotation, carrier.carried(np.zeros(3))
    force = np.einsum("fji,fj->fi", R, wrench[:, 3:])
    about = np.einsum("fji,fj->fi", R, wrench[:, :3] - np.cross(origin, wrench[:, 3:]))
    at_rest = None if centre is None else carrier.at_rest(centre)
    wrench = np.concatenate([about, force], axis=1)
    point, free = contact_points(wrench, touching, sensor.surface, at_rest, radius, least)
    return carrier.carried(point), np.einsum("fij,fj->fi", R, free)


def sensor_channels(
    spec: SessionSpec,
    trial: TrialSpec,
    sensors: tuple[SensorWrench, ...],
    angles: JointAngles,
    frames: Float[np.ndarray, " frame"],
) -> SensorChannels:
    """Every source at its own rate, in world axes about the world origin; cells on a body are carried by its pose."""
    if not sensors:
        return SensorChannels(sensor_names=(), time=np.zeros(0), wrench=np.zeros((0, 0, 6)))
    wrenches = []
    for sensor in sensors:
        wrench, source = sensor.wrench, spec.source(sensor.name)
        if sensor.pressing is not None:
            target = dict(trial.touches)[sensor.name]
            if source.cells[0].position is None:
                place = pad_place(spec.model, target, source, angles)
                inside = np.clip(sensor.time, frames[0], frames[-1])
                at = np.stack([np.interp(inside, frames, column) for column in place.T], axis=1)
                wrench = np.concatenate([np.cross(at, wrench[:, 3:]), wrench[:, 3:]], axis=1)
            if source.frame == "body":
                body = touched_body(spec.model, target)
                pose = angles.body_rotations[:, body], angles.body_positions[:, body]
                wrench = world_wrench(wrench, sensor.time, frames, *pose)
        wrenches.append(wrench)
    return SensorChannels(
        sensor_names=tuple(sensor.name for sensor in sensors),
        time=sensors[0].time,
        wrench=np.stack(wrenches, axis=1),
    )
