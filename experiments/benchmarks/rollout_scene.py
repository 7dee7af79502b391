"""The scene that the rollout benchmark steps through, for icjax, MuJoCo and MJX: five fingers lift a box from a table.

The hand is that of `experiments/sessions/models/virtual_subject_C.xml`; it closes in 0.3 s, lifts by 80 mm and holds.
MuJoCo's hand has the same springs, whose slack follows the same reference, with damping of 20 ms; gravity pulls the box
only. No icjax here: MJX runs in an environment of its own.
"""

from pathlib import Path

import numpy as np

MODEL = Path(__file__).resolve().parents[1] / "sessions" / "models" / "virtual_subject_C.xml"
STEP, STEPS = 0.002, 500
HALF_SIZES = (0.015, 0.035, 0.025)
FRICTION, MASS, TABLE_FRICTION = 0.9, 0.012, 0.6
FOREARM = 3
"""Slides of the forearm, the first coordinates; driven."""

OPEN = (
    [0.0, 0.299, 0.0, 1.319, 1.260, 1.090, 0.0, 0.876, 0.468, 0.885, 0.0, 1.146, 0.619]
    + [0.871, 0.0, 1.006, 0.578, 1.441, 0.0, 0.024, -0.059]
)  # fmt: skip
CLOSED = (
    [0.0, 0.617, 0.0, 1.441, 1.178, 1.458, 0.0, 0.752, 0.370, 1.221, 0.0, 1.095, 0.550]
    + [1.186, 0.0, 0.993, 0.513, 1.751, 0.0, 0.016, -0.060]
)  # fmt: skip
"""rad; wrist, then four joints a finger from the thumb."""

COMPLIANCE = (
    [0.15, 0.25, 0.4, 0.3, 0.5, 0.4, 0.4, 0.45, 0.6, 0.4, 0.4, 0.45, 0.6]
    + [0.45, 0.45, 0.5, 0.7, 0.5, 0.5, 0.6, 0.8]
)  # fmt: skip
"""rad/Nm."""


def smooth(part):
    """Minimum jerk from 0 to 1."""
    part = np.clip(part, 0.0, 1.0)
    return part**3 * (10 - 15 * part + 6 * part**2)


def reference() -> np.ndarray:
    """theta_r of every step, `[STEPS, 24]`."""
    time = STEP * np.arange(1, STEPS + 1)
    closing, lifting = smooth(time / 0.3), smooth((time - 0.35) / 0.4)
    joints = np.array(OPEN) + closing[:, None] * (np.array(CLOSED) - np.array(OPEN))
    forearm = np.zeros((STEPS, FOREARM))
    forearm[:, 2] = 0.08 * lifting
    return np.concatenate([forearm, joints], axis=1)


def mujoco_model():
    """The same for MuJoCo: pads and box collide, the springs hold the hand."""
    import mujoco

    spec = mujoco.MjSpec.from_file(str(MODEL))
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    for body in spec.bodies:
        body.gravcomp = 1.0
    for geom in spec.geoms:
        pad = geom.type == mujoco.mjtGeom.mjGEOM_SPHERE
        geom.contype, geom.conaffinity = (1, 2) if pad else (0, 0)
        geom.friction = [FRICTION, 0.0, 0.0]
        geom.condim = 3
    for number, joint in enumerate(spec.joints):
        stiffness = 20000.0 if number < FOREARM else 1.0 / COMPLIANCE[number - FOREARM]
        joint.stiffness = np.array([stiffness, 0.0, 0.0]) if np.ndim(joint.stiffness) else stiffness
        damping = 250.0 if number < FOREARM else 0.02 * stiffness
        joint.damping = np.array([damping, 0.0, 0.0]) if np.ndim(joint.damping) else damping
    table = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1], contype=2, conaffinity=4)
    table.friction, table.condim = [TABLE_FRICTION, 0.0, 0.0], 3
    box = spec.worldbody.add_body(name="box", pos=[0, 0, HALF_SIZES[2]])
    box.add_freejoint()
    solid = box.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=HALF_SIZES, mass=MASS, contype=6, conaffinity=1)
    solid.friction, solid.condim = [FRICTION, 0.0, 0.0], 3
    return spec.compile()


def start(model) -> np.ndarray:
    """Configuration at the first reference, the box on the table."""
    q = np.array(model.qpos0)
    q[: FOREARM + len(OPEN)] = reference()[0]
    return q
