"""A thousand boxes thrown askew on a table and on a fixed block: does any contact give energy to what it stops?

    python experiments/drops.py [--count 1000]

Half fall on a table (a plane), half on the top of a block smaller than the box's reach (faces and edges meet), and
from there on a floor. Energy is kinetic, by the momentum that the state carries (the mean angular velocity of a step,
which a rollout lists, is another one where the body spins fast and has just hit something), and potential. What it
gains after its least value is counted against the energy at the start, m g (0.08 m) and the throw. Bodies overlap after
a step in which an edge sweeps into another, by the square of its turn; parting them does the work that is left: it must
fall with the step, so all is done with 2 ms and with 1 ms. Writes results/drops.json.
"""

import argparse
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from icjax.geometry import Box, Plane
from icjax.model import load_model
from icjax.spatial import Pose, quaternion_to_rotation
from icjax.synthesis import Object, Scene, Surface, Target, init, step

HALF = np.array([0.015, 0.025, 0.035])
DURATION = 0.8
"""s."""
STEP_TIMES = (0.002, 0.001)
"""s."""
BATCH = 50


def energy_of(item: Object, motion, gravity):
    """Kinetic and potential."""
    R = quaternion_to_rotation(motion.quaternion)
    momentum = R.T @ motion.angular_momentum
    moving = item.mass * jnp.sum(motion.velocity**2) + momentum @ jnp.linalg.solve(item.inertia, momentum)
    return moving / 2 - item.mass * motion.position @ gravity


def main() -> None:
    """Throw, judge, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000)
    count = parser.parse_args().count
    jax.config.update("jax_enable_x64", True)
    nobody = load_model('<mujoco model="nobody"/>')
    random = np.random.default_rng(8)
    each = count // 2
    result = {}
    for name, shape in (
        ("table", Plane(np.zeros(3), np.array([0.0, 0.0, 1.0]))),
        ("block", Box(np.array([0.03, 0.03, 0.02]))),
    ):
        thrown = (
            Rotation.random(each, random_state=9).as_matrix(),
            random.normal(size=(each, 3)) * [0.3, 0.3, 0.2],
            5 * random.normal(size=(each, 3)),
            random.choice([0.0, 0.2, 0.8], each),
        )
        for h in STEP_TIMES:
            row = f"{name}, {1e3 * h:g} ms"
            result[row] = judged(*energies(nobody, name, shape, h, thrown))
            print(row, result[row], flush=True)
    (Path(__file__).resolve().parent / "results" / "drops.json").write_text(json.dumps(result, indent=1) + "\n")


def energies(nobody, name: str, shape, h: float, thrown):
    """Energy and status `[throw, step]`."""

    def one(numbers):
        turn, velocity, spin, friction = numbers
        pose = Pose(turn, jnp.array([0.0, 0.0, 0.08]))
        box = Object("box", Box(HALF), friction, mass=0.1, pose=pose, velocity=velocity, angular_velocity=spin)
        floor = Surface("floor", Plane(np.array([0, 0, -0.3]), np.array([0.0, 0.0, 1.0])), friction)
        surfaces = (Surface(name, shape, friction),) + ((floor,) if name == "block" else ())
        scene = Scene("drop", surfaces, facets=2, step=h, objects=(box,))
        nothing = jnp.zeros(0)

        def advance(state, _):
            state, info = step(nobody, scene, state, Target(nothing, nothing))
            return state, (energy_of(box, state.motions[0], scene.gravity), info.status)

        return jax.lax.scan(advance, init(nobody, scene, nothing), length=round(DURATION / h))[1]

    run = jax.jit(lambda numbers: jax.lax.map(one, numbers))
    parts = [run(tuple(x[at : at + BATCH] for x in thrown)) for at in range(0, len(thrown[0]), BATCH)]
    return [np.concatenate([np.asarray(part[i]) for part in parts]) for i in (0, 1)]


def judged(energy: np.ndarray, status: np.ndarray) -> dict:
    """How much energy came from nowhere."""
    lowest = np.minimum.accumulate(energy, axis=1)[:, :-1]
    gained = np.max(energy[:, 1:] - lowest, axis=1) / np.abs(energy[:, 0])
    return {
        "thrown": len(energy),
        "largest gain over all steps, share of the energy at the start": float(f"{gained.max():.2g}"),
        "99 % gain less than": float(f"{np.quantile(gained, 0.99):.2g}"),
        "gained more than 0.2 %": int(np.sum(gained > 2e-3)),
        "unsolved steps": int(np.sum(status > 0)),
        "steps": int(status.size),
    }


if __name__ == "__main__":
    main()
