"""A small made-up finger session for pictures and pages: closed-form statics of one sliding contact plus noise.

It is no evidence about any estimator; it only has to look like data. The finger's reference follows sinusoids; a
vertical penalty balance gives the force, and theta = theta_r + C tau (Eq. 1) gives the measured angles.
"""

import functools
import json

import numpy as np

from icjax.interaction import CompliancePerEvent, Interaction, JointCompliance
from icjax.model import Model, index_finger
from icjax.recording import ContactEvents, Recording, SensorChannels, Session
from icjax.rollout import Rollout

COMPLIANCE = np.array([0.2, 0.9, 1.1, 0.8])
"""rad/Nm of wrist, MP, PIP, DIP; of the size that the paper's Table 1 gives for exploring."""
RATE = 200.0
DURATION = 3.0
PAD_COMPLIANCE = 1 / 750
BUMP = {"name": "bump", "centre": [0.006, 0.0, -0.006], "rotation": np.eye(3).tolist(), "radii": [0.02, 0.03, 0.012]}
PLATE = {"name": "plate", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}


def finger() -> Model:
    return index_finger(hand_length=0.19, root="free")


def time_axis() -> np.ndarray:
    return np.arange(0.0, DURATION, 1.0 / RATE)


@functools.cache
def reference() -> tuple[np.ndarray, np.ndarray]:
    """Root position [time, 3] and joint reference [time, 4] of a finger that strokes and lifts.

    The root is placed so that the stroke is centred on x = 0 and the reference goes 12 mm into the plate z = 0.
    """
    t, model = time_axis(), finger()
    press = np.sin(2 * np.pi * 1.0 * t - 0.9)
    planned = np.radians([2.0, 13.0, 23.0, 27.0]) + press[:, None] * np.radians([1.2, 5.0, 2.0, 1.5])
    tips = np.array([tip(model, np.zeros(3), angles)[0] for angles in planned])
    root = np.zeros((len(t), 3))
    root[:, 0] = 0.018 * np.sin(2 * np.pi * 0.5 * t) - tips[:, 0].mean()
    root[:, 2] = float(np.asarray(model.pad_radius)[0]) - tips[:, 2].min() - 0.012
    return root, planned


def tip(model: Model, root: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pad centre [3] and its Jacobian [3, 4] with respect to the hinges, for flexion about +y."""
    lengths = [*np.asarray(model.body_position)[2:, 0], float(np.asarray(model.pad_centre)[0, 0])]
    dip = float(np.asarray(model.pad_centre)[0, 2])
    total = np.cumsum(angles)
    joints, point = [], root + np.array([lengths[0], 0.0, 0.0])
    for angle, length in zip(total, lengths[1:], strict=True):
        joints.append(point)
        point = point + length * np.array([np.cos(angle), 0.0, -np.sin(angle)])
    point = point + dip * np.array([np.sin(total[-1]), 0.0, np.cos(total[-1])])
    axis = np.array([0.0, 1.0, 0.0])
    return point, np.stack([np.cross(axis, point - joint) for joint in joints], axis=1)


def surface(x: float, bump: bool) -> tuple[float, np.ndarray]:
    """Height and unit normal of the surface under x."""
    height, slope = 0.0, 0.0
    if bump:
        (a, _, c), centre = BUMP["radii"], BUMP["centre"]
        u = (x - centre[0]) / a
        if abs(u) < 0.98:
            top = centre[2] + c * np.sqrt(1 - u * u)
            if top > 0:
                height, slope = top, -c * u / (a * np.sqrt(1 - u * u))
    normal = np.array([-slope, 0.0, 1.0])
    return height, normal / np.linalg.norm(normal)


@functools.cache
def touch(friction: float, bump: bool) -> dict[str, np.ndarray]:
    """Statics of the reference at every sample: angles, force, point and normal of the contact, torque, gap."""
    model = finger()
    root, planned = reference()
    radius = float(np.asarray(model.pad_radius)[0])
    speed = np.gradient(root[:, 0], 1.0 / RATE)
    out: dict[str, list] = {key: [] for key in ("angles", "force", "point", "normal", "torque", "gap")}
    for k in range(len(root)):
        angles, force = planned[k], np.zeros(3)
        for _ in range(25):
            point, jacobian = tip(model, root[k], angles)
            height, normal = surface(point[0], bump)
            gap = (point[2] - height) * normal[2] - radius
            soft = normal @ (jacobian * COMPLIANCE) @ jacobian.T @ normal + PAD_COMPLIANCE
            size = max(0.0, force @ normal - (gap + PAD_COMPLIANCE * (force @ normal)) / soft)
            tangent = np.array([normal[2], 0.0, -normal[0]])
            force = size * (normal - friction * np.tanh(speed[k] / 0.005) * tangent)
            before, angles = angles, planned[k] + COMPLIANCE * (jacobian.T @ force)
            if np.abs(angles - before).max() < 1e-15:
                break
        out["angles"].append(angles)
        out["force"].append(force)
        out["torque"].append(jacobian.T @ force)
        out["point"].append(point - radius * normal)
        out["normal"].append(normal)
        out["gap"].append(gap)
    return {key: np.array(value) for key, value in out.items()}


def coordinates(root: np.ndarray, angles: np.ndarray) -> np.ndarray:
    quaternion = np.broadcast_to(np.array([1.0, 0.0, 0.0, 0.0]), (len(root), 4))
    return np.concatenate([root, quaternion, angles], axis=1)


def dofs(joints: np.ndarray) -> np.ndarray:
    return np.concatenate([np.zeros((len(joints), 6)), joints], axis=1)


def make_recording(name: str = "trial00", seed: int = 7) -> Recording:
    model, t, rng = finger(), time_axis(), np.random.default_rng(seed)
    root, planned = reference()
    state = touch(0.5, False)
    q = coordinates(root, state["angles"] + np.radians(0.03) * rng.standard_normal(planned.shape))
    force = state["force"] + np.where(state["force"][:, 2:] > 0, 0.008, 0.0) * rng.standard_normal((len(t), 3))
    touching = state["force"][:, 2] > 0.03
    edges = np.flatnonzero(np.diff(np.concatenate([[0], touching.astype(int), [0]])))
    release = np.array([t[e] if e < len(t) else np.nan for e in edges[1::2]])
    count = len(model.site_names)
    provenance = {"files": [f"{name}.c3d"], "simulated": True, "marker rate (Hz)": RATE, "seed": seed}
    return Recording(
        name=name,
        role="trial",
        catch_of=None,
        model=model,
        time=t,
        q=q,
        q_covariance=np.broadcast_to(np.radians(0.03) ** 2 * np.eye(10), (len(t), 10, 10)).copy(),
        q_offset_sd=np.full(10, np.radians(0.3)),
        valid=np.ones(len(t), bool),
        contact_names=("fingertip on plate",),
        contact_bodies=("distal",),
        contact_force=force[:, None, :],
        contact_point=np.where(touching[:, None], state["point"], np.nan)[:, None, :],
        contact_moment=np.zeros((len(t), 1, 3)),
        touching=touching[:, None],
        events=ContactEvents(onset=t[edges[::2]] - 0.002, release=release, contact=np.zeros(len(release), int)),
        marker_names=model.site_names,
        markers=np.full((len(t), count, 3), np.nan),
        marker_residual=np.full((len(t), count), 3e-4),
        channels=SensorChannels(
            sensor_names=("plate",),
            time=t,
            wrench=np.concatenate([np.zeros((len(t), 3)), force], axis=1)[:, None, :],
        ),
        friction=0.5,
        provenance=json.dumps(provenance),
    )


def make_session() -> Session:
    return Session(name="example", subject="nobody", recordings=(make_recording(),))


def make_per_event(recording: Recording, torque: np.ndarray) -> CompliancePerEvent:
    """Straight lines over 60 ms on either side of every onset; one event is turned negative, one not excited."""
    joints, t = ("wrist", "MP", "PIP", "DIP"), np.asarray(recording.time)
    onsets = np.asarray(recording.events.onset)
    shape = (len(onsets), 4)
    values, before, after, torques = (
        np.zeros(shape),
        np.zeros((*shape, 2)),
        np.zeros((*shape, 2)),
        np.zeros((*shape, 2)),
    )
    for event, onset in enumerate(onsets):
        s = t - onset
        past, future = (s > -0.06) & (s < 0), (s >= 0) & (s < 0.06)
        for joint in range(4):
            angle = np.asarray(recording.q)[:, 7 + joint]
            before[event, joint] = np.polyfit(s[past], angle[past], 1)[::-1]
            after[event, joint] = np.polyfit(s[future], angle[future], 1)[::-1]
            torques[event, joint] = np.polyfit(s[future], torque[future, joint], 1)[::-1]
            slope = torques[event, joint, 1]
            values[event, joint] = (after[event, joint, 1] - before[event, joint, 1]) / slope
    status = np.where(values > 0, 0, 1)
    status[1, 2], values[1, 2] = 1, -0.4
    status[2, 3] = 2
    return CompliancePerEvent(
        recording=(recording.name,) * len(onsets),
        joint_names=joints,
        onset=onsets,
        compliance=values,
        standard_error=0.12 * np.abs(values) + 0.03,
        status=status,
        r_squared=np.full((*shape, 3), 0.97),
        torque_change=0.06 * np.abs(torques[:, :, 1]),
        angle_before=before,
        angle_after=after,
        torque_after=torques,
        window=np.array([0.06, 0.06]),
    )


def make_interaction(recording: Recording) -> Interaction:
    root, planned = reference()
    model = recording.model
    torque = touch(0.5, False)["torque"]
    per_event = make_per_event(recording, torque)
    accepted = (np.asarray(per_event.status) == 0).sum(axis=0)
    negative = (np.asarray(per_event.status) == 1).sum(axis=0)
    steps = len(recording.time)
    return Interaction(
        name=recording.name,
        model=model,
        time=recording.time,
        compliance=np.broadcast_to(np.concatenate([np.zeros(6), COMPLIANCE]), (steps, 10)).copy(),
        compliance_sd=np.broadcast_to(np.concatenate([np.zeros(6), 0.15 * COMPLIANCE]), (steps, 10)).copy(),
        reference=coordinates(root, planned),
        reference_sd=np.where(np.asarray(recording.touching), np.radians(0.8), np.radians(0.1)) * np.ones((1, 10)),
        q=recording.q,
        torque=dofs(torque),
        contact_names=recording.contact_names,
        contact_force=recording.contact_force,
        contact_point=recording.contact_point,
        per_event=per_event,
        summary=JointCompliance(
            joint_names=per_event.joint_names,
            compliance=np.where(np.arange(4) == 3, np.nan, COMPLIANCE),
            lower=np.where(np.arange(4) == 3, np.nan, 0.8 * COMPLIANCE),
            upper=1.25 * COMPLIANCE,
            accepted=accepted,
            negative=negative,
            events=np.full(4, len(per_event.onset)),
        ),
        friction=recording.friction,
        provenance=json.dumps({"estimator": "linear windows of 60 ms", "recording": json.loads(recording.provenance)}),
    )


def make_rollout(name: str = "bump", friction: float = 0.5, bump: bool = True, failed: bool = False) -> Rollout:
    model, t = finger(), time_axis()
    root, planned = reference()
    state = touch(friction, bump)
    on_bump = np.array([surface(point[0], bump)[0] > 0 for point in state["point"]])
    columns = [~on_bump, on_bump] if bump else [np.ones(len(t), bool)]
    slots = ("fingertip:plate", "fingertip:bump")[: len(columns)]
    closed = np.stack([(state["force"][:, 2] > 0) & column for column in columns], axis=1)
    speed = np.abs(np.gradient(root[:, 0], 1.0 / RATE))
    shapes = [{**PLATE, "friction": friction}, {**BUMP, "friction": friction}][: len(columns)]
    status = np.zeros(len(t), int)
    if failed:
        status[300:303] = 3
    return Rollout(
        name=name,
        model=model,
        scene=json.dumps({"surfaces": shapes, "step": 1 / RATE, "facets": 4}),
        time=t,
        q=coordinates(root, state["angles"]),
        reference=coordinates(root, planned),
        torque=dofs(state["torque"]),
        slot_names=slots,
        contact_force=state["force"][:, None, :] * closed[:, :, None],
        contact_point=np.repeat(state["point"][:, None, :], len(slots), axis=1),
        contact_normal=np.repeat(state["normal"][:, None, :], len(slots), axis=1),
        gap=np.repeat(state["gap"][:, None], len(slots), axis=1),
        slip_state=np.where(closed, np.where(speed[:, None] > 0.01, 2, 1), 0),
        equilibrium_error=np.full((len(t), 10), 1e-5),
        residual=np.full(len(t), 3e-13),
        status=status,
        margin=np.full(len(t), 0.05),
    )
