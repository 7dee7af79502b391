"""Small hands for the tests of the stepper."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from icjax.geometry import Plane
from icjax.model import Model, load_model, pad_positions
from icjax.synthesis import Scene, State, StepInfo, Surface, Target, rollout

ENDPOINT = 1.0 / 85.0
PAD = 1.0 / 750.0
RADIUS = 0.0075


def sprung_tip(compliance: float = ENDPOINT, pad: float = PAD) -> Model:
    """A pad on three sliding springs: every contact force has a closed form."""
    slides = "".join(
        f'<joint name="{name}" type="slide" axis="{axis}" stiffness="{1 / compliance}"/>'
        for name, axis in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
    )
    model = load_model(f"""
        <mujoco model="sprung_tip"><worldbody><body name="tip">{slides}
        <geom name="pad" type="sphere" size="{RADIUS}" mass="0.01"/>
        </body></worldbody></mujoco>""")
    return dataclasses.replace(model, pad_compliance=np.array([pad]))


def planar_finger(pad: float = PAD, forearm: tuple[str, ...] = ("x", "z")) -> Model:
    """Wrist, MP, PIP and DIP hinges on a forearm that slides; compliances as measured on people."""
    axes = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    slides = "".join(f'<joint name="{name}" type="slide" axis="{axes[name]}"/>' for name in forearm)
    inertial = '<inertial pos="0 0 0" mass="0.01" diaginertia="1e-5 1e-5 1e-5"/>'
    chain = f'<geom name="pad" type="sphere" size="{RADIUS}" pos="0.016 0 -0.001" mass="0.01"/>'
    for name, offset, stiffness in (("DIP", 0.028, 0.6), ("PIP", 0.049, 2.1), ("MP", 0.092, 1.0), ("wrist", 0.0, 2.9)):
        joint = f'<joint name="{name}" axis="0 1 0" stiffness="{stiffness}"/>'
        chain = f'<body name="of_{name}" pos="{offset} 0 0">{joint}{inertial}{chain}</body>'
    model = load_model(f"""
        <mujoco model="planar_finger"><worldbody><body name="forearm">{slides}{inertial}{chain}
        </body></worldbody></mujoco>""")
    return dataclasses.replace(model, pad_compliance=np.array([pad]))


def compliance_of(model: Model) -> np.ndarray:
    """Compliance of the springs; zero (driven) where the model states none."""
    return np.where(np.isfinite(model.compliance), model.compliance, 0.0)


def floor(friction: float, facets: int = 4, height: float = 0.0) -> Scene:
    return Scene(
        name="flat",
        surfaces=(Surface("plate", Plane(np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 1.0])), friction),),
        facets=facets,
    )


def constant_targets(model: Model, reference) -> Target:
    reference = jnp.asarray(reference)
    return Target(reference=reference, compliance=jnp.tile(jnp.asarray(compliance_of(model)), (len(reference), 1)))


def pressing_finger(steps: int, depth: float = 0.01, stroke: float = 0.0) -> tuple[Model, np.ndarray, float]:
    """A bent finger whose reference sinks `depth` and moves by `stroke`: model, reference, height of the surface."""
    model = planar_finger()
    part = np.linspace(0.0, 1.0, steps)
    posture = np.array([0.0, 0.0, 0.1, 0.3, 0.4, 0.3])
    reference = posture[None, :] + np.zeros((steps, 1))
    reference[:, 1] -= depth * part
    reference[:, 0] += stroke * part
    return model, reference, float(pad_positions(model, jnp.asarray(posture))[0, 2]) - RADIUS - 0.002


def simulate(model: Model, scene: Scene, targets: Target) -> tuple[State, StepInfo]:
    """A rollout in chunks of one length, so that tests of one kind of hand share a compiled step."""
    return rollout(model, scene, targets, chunk=50, progress=lambda fraction: None)
