"""Run the hand through a command with an object on the table and say what truly happened."""

import dataclasses
import os
from pathlib import Path

import numpy as np

from icjax.laboratory._dynamics import ANALOG_RATE, feed_forward, run_applied, save_fields
from icjax.laboratory._free_object import FreeObject
from icjax.laboratory._hand import FINGERS, HAND_JOINTS, Hand
from icjax.laboratory._hand_model import HAND_DRIVEN, build_hand
from icjax.laboratory._instruments import Markers
from icjax.laboratory._movement import RATE
from icjax.laboratory._mujoco import MjData, MjModel, mujoco
from icjax.laboratory._stand import Stand


@dataclasses.dataclass(frozen=True)
class GraspTruth:
    """What an experimenter never sees. Time in s, angles in rad, forces on the fingers in N, world axes.

    `theta_free` is the same command without the object: the reference trajectory. `tau` is the torque of the contact
    forces about each joint (J^T f). `f_contact` [frame, finger, 3] acts at `point` (NaN where nothing touches); its
    part along the surface's normal is `f_normal`. `pad` [frame, finger, 3] is the centre of a fingertip sphere, `bone`
    where that centre would be with the pad undeformed, `root` [frame, 3] the wrist. `object_pose` [frame, 7]: position
    of the object's frame (m), quaternion (w first). `joints` and `fingers` name the columns.
    """

    t: np.ndarray
    command: np.ndarray
    theta: np.ndarray
    theta_free: np.ndarray
    tau: np.ndarray
    f_contact: np.ndarray
    f_normal: np.ndarray
    point: np.ndarray
    pad: np.ndarray
    bone: np.ndarray
    root: np.ndarray
    object_pose: np.ndarray
    C: np.ndarray
    B: np.ndarray
    mu: float
    pad_stiffness: float
    joints: np.ndarray
    fingers: np.ndarray

    def save(self, path: str | os.PathLike) -> Path:
        """Write every field to one NumPy archive."""
        return save_fields(self, path)


@dataclasses.dataclass(frozen=True)
class GraspMotion:
    """A truth and what instruments can see of it: markers [frame, marker, 3] and normal forces [sample, finger], N."""

    truth: GraspTruth
    marker_names: tuple[str, ...]
    markers: np.ndarray
    pressed: np.ndarray


def simulate_grasp(
    hand: Hand,
    thing: FreeObject,
    command: np.ndarray,
    markers: Markers,
    timestep: float,
    stand: Stand | None = None,
) -> GraspMotion:
    """Follow a command [frame, 24] (forearm x, y, z, then joints; at 500 Hz) with an object on the table or a stand.

    The generalised force is tau = tau_ff + K (theta_plan - theta) + B (theta_plan' - theta'), with tau_ff the inverse
    dynamics of the planned motion of the empty hand, gravity included: the weight of the object is met by compliance.

    **Errors**: `RuntimeError` where the simulation diverges.
    """
    alone, model = build_hand(hand, None, {}, timestep), build_hand(hand, thing, markers, timestep, stand)
    address = [int(model.joint(name).qposadr[0]) for name in HAND_DRIVEN]
    force = feed_forward(alone, command, address, timestep)
    free, _ = run_applied(alone, _start(alone, command, address), force)
    force = np.pad(force, ((0, 0), (0, model.nv - alone.nv)))
    q, sensed = run_applied(model, _start(model, command, address), force)
    if not (np.isfinite(q).all() and np.abs(q).max() < 100.0):
        raise RuntimeError(f"the simulation of '{thing.name}' diverged: use a smaller timestep than {timestep} s")
    frame, sample = round(1.0 / (RATE * timestep)), round(1.0 / (ANALOG_RATE * timestep))
    contact, normal = _contact(sensed)
    truth = _truth(model, hand, thing, command, q[::frame], sensed[::frame], contact[::frame], normal[::frame])
    truth = dataclasses.replace(truth, theta_free=free[::frame, address[3:]])
    names, seen = _marker_positions(model, tuple(markers), q[::frame])
    return GraspMotion(truth=truth, marker_names=names, markers=seen, pressed=normal[::sample])


def _start(model: MjModel, command: np.ndarray, address: list[int]) -> MjData:
    data = mujoco.MjData(model)
    data.qpos[address] = command[0]
    data.qvel[address] = (command[1] - command[0]) * RATE
    return data


def _contact(sensed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force on every finger [step, finger, 3] and its part along the line from the contact to the sphere's centre."""
    count = len(FINGERS)
    wrench = sensed[:, : 6 * count].reshape(-1, count, 6)
    force, place = wrench[:, :, :3], wrench[:, :, 3:]
    inward = sensed[:, 6 * count :].reshape(-1, count, 3) - place
    length = np.linalg.norm(inward, axis=2)
    return force, np.sum(force * inward, axis=2) / np.maximum(length, 1e-12)


def _marker_positions(model: MjModel, names: tuple[str, ...], q: np.ndarray) -> tuple[tuple[str, ...], np.ndarray]:
    sites = [model.site(name).id for name in names]
    positions = np.empty((len(q), len(sites), 3))
    data = mujoco.MjData(model)
    for index, coordinates in enumerate(q):
        data.qpos[:] = coordinates
        mujoco.mj_kinematics(model, data)
        positions[index] = data.site_xpos[sites]
    return names, positions


def _truth(
    model: MjModel,
    hand: Hand,
    thing: FreeObject,
    command: np.ndarray,
    q: np.ndarray,
    sensed: np.ndarray,
    contact: np.ndarray,
    normal: np.ndarray,
) -> GraspTruth:
    frames, count = len(q), len(FINGERS)
    joints = [int(model.joint(name).qposadr[0]) for name in HAND_JOINTS]
    place = sensed[:, : 6 * count].reshape(-1, count, 6)[:, :, 3:]
    pad = sensed[:, 6 * count :].reshape(-1, count, 3)
    bone, root, tau = np.empty((frames, count, 3)), np.empty((frames, 3)), np.zeros((frames, len(joints)))
    tips = [model.site(f"{finger}_tip").id for finger in FINGERS]
    bodies = [model.body(f"{finger}_distal").id for finger in FINGERS]
    forearm = model.body("forearm").id
    data, jacobian = mujoco.MjData(model), np.zeros((3, model.nv))
    for frame in range(frames):
        data.qpos[:] = q[frame]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        bone[frame], root[frame] = data.site_xpos[tips], data.xpos[forearm]
        for finger in np.flatnonzero(normal[frame]):
            mujoco.mj_jac(model, data, jacobian, None, place[frame, finger], bodies[finger])
            tau[frame] += contact[frame, finger] @ jacobian[:, joints]
    return GraspTruth(
        t=np.arange(frames) / RATE,
        command=command,
        theta=q[:, joints],
        theta_free=q[:, joints],
        tau=tau,
        f_contact=contact,
        f_normal=normal,
        point=np.where(normal[:, :, None] > 0.0, place, np.nan),
        pad=pad,
        bone=bone,
        root=root,
        object_pose=q[:, -7:],
        C=np.asarray(hand.compliance),
        B=hand.damping,
        mu=thing.friction,
        pad_stiffness=hand.pad_stiffness,
        joints=np.asarray(HAND_JOINTS),
        fingers=np.asarray(FINGERS),
    )
