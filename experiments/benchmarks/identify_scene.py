"""The finger of the identification benchmark, for icjax and for MuJoCo: wrist, MP, PIP and DIP press a plane slowly.

The finger is `icjax.model.index_finger(root="fixed")`; its four springs pull towards a reference that moves for
`DURATION` seconds, and the plane is frictionless, so that the equilibrium is the same in both (MuJoCo holds a sticking
contact by slow creep, icjax by the elasticity of the pad). MuJoCo's springs are position servos: torque
k (reference - angle). Its contact is a linear spring of the pad's 750 N/m. No icjax here: `mujoco.sysid` runs in an
environment of its own.
"""

import numpy as np

JOINTS = ("wrist", "MP", "PIP", "DIP")
STIFFNESS = np.array([3.2, 0.85, 1.3, 0.55])
"""Nm/rad, of the measured finger."""

PAD = 750.0
"""N/m."""

PLANE = -0.055
"""m, height of the plane; the wrist is the origin."""

OPEN = np.array([0.0, 0.3, 0.5, 0.3])
DURATION, SAMPLES = 4.0, 200
NOISE_FORCE, NOISE_ANGLE = 0.02, 3e-3
"""N and rad, standard deviations."""

TRUE_STEP, TRUE_DAMPING, TRUE_ARMATURE = 2e-4, 0.004, 0.0
"""Of the simulation that is measured: s; damping over stiffness, s; kg m2."""


def reference(time: np.ndarray) -> np.ndarray:
    """theta_r `[time, 4]`, rad: two presses, the second with the finger more bent."""
    part = np.asarray(time)[:, None] / DURATION
    press = np.sin(2 * np.pi * part) ** 2
    bend = np.clip((part - 0.25) / 0.5, 0.0, 1.0)
    bend = bend**3 * (10 - 15 * bend + 6 * bend**2)
    return OPEN + press * np.array([0.15, 0.55, 0.35, 0.35]) + bend * np.array([0.1, -0.35, 0.55, 0.2])


def sample_times() -> np.ndarray:
    """s, the ends of the samples' steps."""
    return DURATION / SAMPLES * np.arange(1, SAMPLES + 1)


def mujoco_spec(mjcf: str, step: float, damping: np.ndarray, armature: float, stiffness=STIFFNESS):
    """MuJoCo's finger with servos for springs, and sensors: four angles, then the contact force."""
    import mujoco as mj

    spec = mj.MjSpec.from_string(mjcf)
    spec.option.timestep = step
    spec.option.integrator = mj.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = [0.0, 0.0, 0.0]
    damping = np.broadcast_to(damping, (4,))
    for joint, b in zip(spec.joints, damping, strict=True):
        joint.stiffness = np.zeros(3) if np.ndim(joint.stiffness) else 0.0
        joint.damping = np.array([b, 0.0, 0.0]) if np.ndim(joint.damping) else float(b)
        joint.armature = armature
        joint.limited = mj.mjtLimited.mjLIMITED_FALSE
    for name, k in zip(JOINTS, stiffness, strict=True):
        servo = spec.add_actuator(name=name, target=name, trntype=mj.mjtTrn.mjTRN_JOINT)
        servo.gaintype, servo.biastype = mj.mjtGain.mjGAIN_FIXED, mj.mjtBias.mjBIAS_AFFINE
        servo.gainprm[0], servo.biasprm[1] = k, -k
        spec.add_sensor(name=f"angle {name}", type=mj.mjtSensor.mjSENS_JOINTPOS, objtype=mj.mjtObj.mjOBJ_JOINT,
                        objname=name)  # fmt: skip
    tip = next(geom for geom in spec.geoms if geom.name == "fingertip")
    tip.contype, tip.conaffinity, tip.condim, tip.priority = 1, 2, 1, 1
    site = spec.body("distal").add_site(name="tip", pos=tip.pos, size=[0.02, 0.02, 0.02])
    site.type = mj.mjtGeom.mjGEOM_SPHERE
    spec.add_sensor(name="force", type=mj.mjtSensor.mjSENS_TOUCH, objtype=mj.mjtObj.mjOBJ_SITE, objname="tip")
    plane = spec.worldbody.add_geom(type=mj.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1], pos=[0, 0, PLANE])
    plane.contype, plane.conaffinity, plane.condim = 2, 1, 1
    share = 0.9
    tip.solimp = [share, share, 0.001, 0.5, 2]
    weight = spec.compile().body("distal").invweight0[0]
    # Force at rest: d^2 k / ((1 - d) A) times the depth, A the inverse mass that the compiler states.
    stiffness = PAD * (1 - share) * weight / share**2
    tip.solref = [-stiffness * share**2, -2.0 * np.sqrt(stiffness) * share]
    return spec


def start(model) -> np.ndarray:
    """Full state at rest at the first reference."""
    import mujoco as mj

    data = mj.MjData(model)
    data.qpos[:] = reference(np.zeros(1))[0]
    state = np.empty(mj.mj_stateSize(model, mj.mjtState.mjSTATE_FULLPHYSICS))
    mj.mj_getState(model, data, state, mj.mjtState.mjSTATE_FULLPHYSICS)
    return state


def simulate(mjcf: str, step: float, damping, armature: float, stiffness=STIFFNESS, held: int = 1) -> np.ndarray:
    """Angles and force `[SAMPLES, 5]`; the reference moves `held` times more slowly."""
    import mujoco as mj
    from mujoco import rollout

    model = mujoco_spec(mjcf, step, damping, armature, stiffness).compile()
    every = round(held * DURATION / SAMPLES / step)
    control = reference(step / held * np.arange(1, every * SAMPLES + 1))
    _, sensors = rollout.rollout(model, mj.MjData(model), start(model), control)
    # Sensors are those of the state that a step starts from: take the step after.
    again = np.concatenate([sensors[0], sensors[0][-1:]])[every::every]
    return again[:SAMPLES]


def measured(mjcf: str, seed: int = 7) -> np.ndarray:
    """What both are given: a damped simulation in small steps, with noise."""
    clean = simulate(mjcf, TRUE_STEP, TRUE_DAMPING * STIFFNESS, TRUE_ARMATURE)
    random = np.random.default_rng(seed)
    return clean + random.normal(size=clean.shape) * deviations()


def deviations() -> np.ndarray:
    """Of the five columns."""
    return np.array([NOISE_ANGLE] * 4 + [NOISE_FORCE])
