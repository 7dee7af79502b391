"""A thousand boxes thrown askew on a table and on a fixed block: does any contact give energy to what it stops?

    python experiments/drops.py [--count 1000]

Half fall on a table (a plane), half on the top of a block smaller than the box's reach (faces and edges meet). Energy
is kinetic and potential; what it gains after its least value is counted against the energy at the start. Writes
results/drops.json.
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
from icjax.synthesis import Object, Scene, Surface, Target, rollout

HALF = np.array([0.015, 0.025, 0.035])
STEPS = 400
BATCH = 50


def energy_of(item: Object, info, gravity):
    """Kinetic and potential, `[time]`."""
    R = jax.vmap(jax.vmap(quaternion_to_rotation))(info.object_quaternion)[:, 0]
    spin = jnp.einsum("tji,tj->ti", R, info.object_angular_velocity[:, 0])
    velocity, centre = info.object_velocity[:, 0], info.object_position[:, 0]
    moving = (item.mass * jnp.sum(velocity**2, axis=1) + jnp.einsum("ti,ij,tj->t", spin, item.inertia, spin)) / 2
    return moving - item.mass * centre @ gravity


def main() -> None:
    """Throw, judge, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000)
    count = parser.parse_args().count
    jax.config.update("jax_enable_x64", True)
    nobody = load_model('<mujoco model="nobody"/>')
    random = np.random.default_rng(8)
    result = {}
    for name, shape in (
        ("table", Plane(np.zeros(3), np.array([0.0, 0.0, 1.0]))),
        ("block", Box(np.array([0.03, 0.03, 0.02]))),
    ):
        each = count // 2
        turns = Rotation.random(each, random_state=9).as_matrix()
        velocity = random.normal(size=(each, 3)) * [0.3, 0.3, 0.2]
        spin = 5 * random.normal(size=(each, 3))
        friction = random.choice([0.0, 0.2, 0.8], each)

        @jax.jit
        def energies(numbers, shape=shape, name=name):
            def one(numbers):
                turn, velocity, spin, friction = numbers
                box = Object(
                    "box",
                    Box(HALF),
                    friction,
                    mass=0.1,
                    pose=Pose(turn, jnp.array([0.0, 0.0, 0.08])),
                    velocity=velocity,
                    angular_velocity=spin,
                )
                floor = Surface("floor", Plane(np.array([0, 0, -0.3]), np.array([0.0, 0.0, 1.0])), friction)
                surfaces = (Surface(name, shape, friction),) + ((floor,) if name == "block" else ())
                scene = Scene("drop", surfaces, facets=2, objects=(box,), contacts=8)
                nothing = jnp.zeros((STEPS, 0))
                _, info = rollout(nobody, scene, Target(nothing, nothing))
                return energy_of(box, info, scene.gravity), info.status

            return jax.lax.map(one, numbers)

        parts = [
            energies(tuple(x[at : at + BATCH] for x in (turns, velocity, spin, friction)))
            for at in range(0, each, BATCH)
        ]
        energy, status = (np.concatenate([np.asarray(part[i]) for part in parts]) for i in (0, 1))
        lowest = np.minimum.accumulate(energy, axis=1)[:, :-1]
        gained = np.max(energy[:, 1:] - lowest, axis=1) / np.abs(energy[:, 0])
        result[name] = {
            "thrown": each,
            "largest gain over all steps, share of the energy at the start": float(f"{gained.max():.2g}"),
            "gained more than 0.2 %": int(np.sum(gained > 2e-3)),
            "unsolved steps": int(np.sum(status > 0)),
            "steps": int(status.size),
        }
        print(name, result[name], flush=True)
    (Path(__file__).resolve().parent / "results" / "drops.json").write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
