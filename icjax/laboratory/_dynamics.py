"""Run the subject through a command on a surface and say what truly happened."""

import dataclasses
import os
from pathlib import Path

import mujoco
import mujoco.rollout
import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline

from icjax.laboratory._apparatus import DRIVEN, TIMESTEP, build
from icjax.laboratory._movement import RATE
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
    centre would be with the pad undeformed, `root` the position (x, z, m) and pitch (rad) of the forearm.
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
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **{field.name: getattr(self, field.name) for field in dataclasses.fields(self)})
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
    away = build(subject, dataclasses.replace(surface, lowered=surface.lowered + 1.0), markers)
    force = _applied(model, command)
    touching, sensed = _run(model, command, force)
    free, _ = _run(away, command, force)
    truth = _truth(model, subject, surface, command, touching[::FRAME], free[::FRAME], sensed[::FRAME])
    positions, names = _positions(model, touching[::FRAME])
    return Motion(truth=truth, marker_names=names, markers=positions, wrench=-sensed[::SAMPLE, :6])


def _applied(model: mujoco.MjModel, command: np.ndarray) -> np.ndarray:
    """Generalised force [step, nv] of the command: inverse dynamics where it is written down, splined between."""
    knots = np.arange(len(command)) / RATE
    spline = make_interp_spline(knots, command, k=5)
    position, velocity, acceleration = (spline(knots, order) for order in range(3))
    address = _driven(model)
    data = mujoco.MjData(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    wanted = np.empty_like(command)
    for frame in range(len(command)):
        data.qpos[address] = position[frame]
        data.qvel[address] = velocity[frame]
        data.qacc[address] = acceleration[frame]
        mujoco.mj_inverse(model, data)
        wanted[frame] = data.qfrc_inverse[address]
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    time = np.minimum(np.arange(FRAME * len(command)) * TIMESTEP, knots[-1])
    force = np.zeros((len(time), model.nv))
    force[:, address] = CubicSpline(knots, wanted)(time)
    return force


def _run(model: mujoco.MjModel, command: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Generalised positions and sensor readings before every step, both [step, ...] and at the same times."""
    data = mujoco.MjData(model)
    address = _driven(model)
    data.qpos[address] = command[0]
    data.qvel[address] = (command[1] - command[0]) * RATE
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    initial = np.zeros(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, initial, full)
    states, sensed = mujoco.rollout.rollout(
        model, data, initial[None], force[None], control_spec=int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
    )
    states = np.concatenate([initial[None], states[0, :-1]])
    return states[:, 1 : 1 + model.nq], sensed[0]


def _driven(model: mujoco.MjModel) -> list[int]:
    """Addresses of the commanded coordinates; positions and velocities share them, all joints being scalar."""
    return [int(model.joint(name).qposadr[0]) for name in DRIVEN]


def _truth(
    model: mujoco.MjModel,
    subject: Subject,
    surface: Surface,
    command: np.ndarray,
    touching: np.ndarray,
    free: np.ndarray,
    sensed: np.ndarray,
) -> Truth:
    frames = len(command)
    driven = _driven(model)
    force, point = sensed[:, 6:9], sensed[:, 9:12]
    tau = np.zeros((frames, len(JOINTS)))
    pad = np.zeros((frames, 3))
    bone = np.zeros((frames, 3))
    data = mujoco.MjData(model)
    hinges = [model.joint(name).id for name in JOINTS]
    distal, tip = model.body("distal").id, model.geom("pad").id
    for frame in range(frames):
        data.qpos[:] = touching[frame]
        mujoco.mj_kinematics(model, data)
        pad[frame] = data.geom_xpos[tip]
        bone[frame] = data.xpos[distal] + data.xmat[distal].reshape(3, 3) @ subject.pad_offset
        arm = point[frame] - data.xanchor[hinges]
        tau[frame] = np.sum(data.xaxis[hinges] * np.cross(arm, force[frame]), axis=1)
    return Truth(
        t=np.arange(frames) / RATE,
        command=command,
        theta=touching[:, driven[3:]],
        theta_free=free[:, driven[3:]],
        tau=tau,
        f_contact=force,
        pad=pad,
        bone=bone,
        root=touching[:, driven[:3]],
        C=np.asarray(subject.compliance),
        B=subject.damping,
        mu=surface.friction,
        pad_stiffness=subject.pad_stiffness,
    )


def _positions(model: mujoco.MjModel, states: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    data = mujoco.MjData(model)
    sites = [index for index in range(model.nsite) if model.site(index).name != "sensor"]
    names = tuple(model.site(index).name for index in sites)
    result = np.empty((len(states), len(sites), 3))
    for frame, state in enumerate(states):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        result[frame] = data.site_xpos[sites]
    return result, names
