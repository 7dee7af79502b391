"""Run the subject through a command on a surface and say what truly happened."""

import dataclasses
import os
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline

from icjax.laboratory._apparatus import DRIVEN, TIMESTEP, build
from icjax.laboratory._fingertip import Fingertip
from icjax.laboratory._movement import RATE
from icjax.laboratory._mujoco import MjData, MjModel, mujoco, rollout
from icjax.laboratory._subject import JOINTS, Subject
from icjax.laboratory._surface import Surface

ANALOG_RATE = 1000.0
"""Of the force sensor, Hz."""

FRAME = round(1.0 / (RATE * TIMESTEP))
SAMPLE = round(1.0 / (ANALOG_RATE * TIMESTEP))
"""Steps of the simulation in a marker frame and in an analog sample."""

Markers = dict[str, tuple[str, np.ndarray]]


@dataclasses.dataclass(frozen=True)
class Truth:
    """What an experimenter never sees. Time in s, angles in rad, forces on the finger in N, world axes.

    `theta_free` is the same command without anything to touch: the reference trajectory. `tau` is the torque of
    the contact force about each joint (J^T f). `pad` is the centre of the fingertip sphere, `bone` where that
    centre would be with the pad undeformed, `root` the world position (x, z, m) of the
    wrist, at which the forearm's frame lies, and the forearm's pitch (rad).
    """

    t: np.ndarray
    command: np.ndarray
    theta: np.ndarray
    theta_free: np.ndarray
    tau: np.ndarray
    f_contact: np.ndarray
    pad: np.ndarray
    bone: np.ndarray
    root: np.ndarray
    C: np.ndarray
    B: np.ndarray
    mu: float
    pad_stiffness: float

    def save(self, path: str | os.PathLike) -> Path:
        """Write every field to one NumPy archive."""
        return save_fields(self, path)


def save_fields(truth: Any, path: str | os.PathLike) -> Path:
    """Write every field of a dataclass to one NumPy archive."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **{field.name: getattr(truth, field.name) for field in dataclasses.fields(truth)})
    return path


@dataclasses.dataclass(frozen=True)
class Motion:
    """A truth together with what instruments can see: markers [frame, marker, 3] and wrench [sample, 6] (N, Nm)."""

    truth: Truth
    marker_names: tuple[str, ...]
    markers: np.ndarray
    wrench: np.ndarray


def simulate(subject: Subject, surface: Surface, command: np.ndarray, markers: Markers) -> Motion:
    """Follow a command [frame, 7] (forearm x, z, pitch, then joints; at 500 Hz) on a surface.

    The generalised force is tau = tau_ff + K (theta_plan - theta) + B (theta_plan' - theta'), with tau_ff the
    inverse dynamics of the planned motion, gravity included; springs and dampers are MuJoCo's own, so only
    tau_ff + K theta_plan + B theta_plan' is applied. The sensor reports the wrench that the finger applies to
    the plate, in its own axes, about its own point, together with the weight and inertia of the plate above it.
    """
    model = build(subject, surface, markers)
    force = feed_forward(model, command, _driven(model), TIMESTEP)
    free = _run_free(model, command, force)
    touching = _run_touching(model, subject, surface, command, force) if surface.lowered == 0.0 else free
    positions, names = _positions(model, touching.q[::FRAME])
    wrench = -touching.sensed[::SAMPLE]
    truth = _truth(model, subject, surface, command, touching, free.q[::FRAME])
    return Motion(truth=truth, marker_names=names, markers=positions, wrench=wrench)


@dataclasses.dataclass(frozen=True)
class Run:
    """State and readings before every step: coordinates, sensor [6], force on the finger and its point [3]."""

    q: np.ndarray
    sensed: np.ndarray
    contact: np.ndarray
    point: np.ndarray


def feed_forward(model: MjModel, command: np.ndarray, address: list[int], timestep: float) -> np.ndarray:
    """Generalised force [step, nv] of a command [frame, coordinate] of the coordinates at `address`.

    Inverse dynamics where the command is written down, splined between.
    """
    knots = np.arange(len(command)) / RATE
    spline = make_interp_spline(knots, command, k=5)
    position, velocity, acceleration = (spline(knots, order) for order in range(3))
    data = mujoco.MjData(model)
    wanted = np.empty_like(command)
    for frame in range(len(command)):
        data.qpos[address] = position[frame]
        data.qvel[address] = velocity[frame]
        data.qacc[address] = acceleration[frame]
        mujoco.mj_inverse(model, data)
        wanted[frame] = data.qfrc_inverse[address]
    steps = round(1.0 / (RATE * timestep)) * len(command)
    time = np.minimum(np.arange(steps) * timestep, knots[-1])
    force = np.zeros((steps, model.nv))
    force[:, address] = CubicSpline(knots, wanted)(time)
    return force


def run_applied(model: MjModel, data: MjData, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates before every step [step, nq] and readings [step, sensor] under a generalised force: one call."""
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    initial = np.zeros(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, initial, full)
    states, sensed = rollout(
        model, data, initial[None], force[None], control_spec=int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
    )
    states = np.concatenate([initial[None], states[0, :-1]])
    return states[:, 1 : 1 + model.nq], sensed[0]


def _start(model: MjModel, command: np.ndarray) -> MjData:
    data = mujoco.MjData(model)
    address = _driven(model)
    data.qpos[address] = command[0]
    data.qvel[address] = (command[1] - command[0]) * RATE
    return data


def _run_free(model: MjModel, command: np.ndarray, force: np.ndarray) -> Run:
    """Without anything to touch."""
    q, sensed = run_applied(model, _start(model, command), force)
    nothing = np.zeros((len(force), 3))
    return Run(q=q, sensed=sensed, contact=nothing, point=nothing)


def _run_touching(model: MjModel, subject: Subject, surface: Surface, command: np.ndarray, force: np.ndarray) -> Run:
    """With the plate: the force of the fingertip acts on the distal phalanx, its reaction on the plate."""
    data = _start(model, command)
    tip = Fingertip(subject, surface)
    distal, plate, pad = model.body("distal").id, model.body("plate").id, model.site("pad").id
    pad_at, plate_at = data.site_xpos[pad], data.xpos[plate]
    push, reaction = data.xfrc_applied[distal], data.xfrc_applied[plate]
    distal_com, plate_com = data.xipos[distal], data.xipos[plate]
    q, sensed = np.empty((len(force), model.nq)), np.empty((len(force), model.nsensordata))
    contact, point = np.zeros((len(force), 3)), np.zeros((len(force), 3))
    for step in range(len(force)):
        mujoco.mj_step1(model, data)
        data.qfrc_applied[:] = force[step]
        plate_x, plate_z = plate_at[0], plate_at[2]
        fx, fz, x, z = tip.touch(float(pad_at[0] - plate_x), float(pad_at[2] - plate_z), TIMESTEP)
        if fz != 0.0 or contact[step - 1, 2] != 0.0:
            x, z = x + plate_x, z + plate_z
            push[:] = (fx, 0.0, fz, 0.0, (z - distal_com[2]) * fx - (x - distal_com[0]) * fz, 0.0)
            reaction[:] = (-fx, 0.0, -fz, 0.0, (x - plate_com[0]) * fz - (z - plate_com[2]) * fx, 0.0)
            contact[step] = fx, 0.0, fz
            point[step] = x, 0.0, z
        q[step] = data.qpos
        mujoco.mj_step2(model, data)
        sensed[step] = data.sensordata
    return Run(q=q, sensed=sensed, contact=contact, point=point)


def _driven(model: MjModel) -> list[int]:
    """Addresses of the commanded coordinates; positions and velocities share them, all joints being scalar."""
    return [int(model.joint(name).qposadr[0]) for name in DRIVEN]


def _truth(
    model: MjModel,
    subject: Subject,
    surface: Surface,
    command: np.ndarray,
    run: Run,
    free: np.ndarray,
) -> Truth:
    frames = len(command)
    driven = _driven(model)
    touching, force, point = run.q[::FRAME], run.contact[::FRAME], run.point[::FRAME]
    bone = np.zeros((frames, 3))
    data = mujoco.MjData(model)
    hinges = [model.joint(name).id for name in JOINTS]
    tip = model.site("pad").id
    root = np.zeros((frames, 3))
    forearm = model.body("forearm").id
    anchors = np.zeros((frames, len(JOINTS), 3))
    axes = np.zeros((frames, len(JOINTS), 3))
    for frame in range(frames):
        data.qpos[:] = touching[frame]
        mujoco.mj_kinematics(model, data)
        bone[frame] = data.site_xpos[tip]
        root[frame] = data.xpos[forearm, 0], data.xpos[forearm, 2], data.qpos[driven[2]]
        anchors[frame] = data.xanchor[hinges]
        axes[frame] = data.xaxis[hinges]
    moment = np.cross(point[:, None, :] - anchors, force[:, None, :])
    tau = np.sum(axes * moment, axis=2)
    return Truth(
        t=np.arange(frames) / RATE,
        command=command,
        theta=touching[:, driven[3:]],
        theta_free=free[:, driven[3:]],
        tau=tau,
        f_contact=force,
        pad=bone + force / subject.pad_stiffness,
        bone=bone,
        root=root,
        C=np.asarray(subject.compliance),
        B=subject.damping,
        mu=surface.friction,
        pad_stiffness=subject.pad_stiffness,
    )


def _positions(model: MjModel, states: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    data = mujoco.MjData(model)
    sites = [index for index in range(model.nsite) if model.site(index).name not in ("sensor", "pad")]
    names = tuple(model.site(index).name for index in sites)
    result = np.empty((len(states), len(sites), 3))
    for frame, state in enumerate(states):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        result[frame] = data.site_xpos[sites]
    return result, names
