"""Four hundred real tosses of a cube (ContactNets) from their recorded release: where, and on which face, it rests.

    uv run python experiments/cube_tosses.py [--tosses 400] [--seconds 3]

The cube of Pfrommer, Halm and Posa (2020) with their mass, inertia and friction, simulated by icjax and, in the same
run, by MuJoCo with its default contact, both at 2 ms and without any number fitted here. A toss is chaotic: what can be
compared is how often the face is right and how far from the recorded place the cube lies. "Released where it rests"
says how far a guess without simulation is off. Written to experiments/results/cube_tosses.json.
"""

import argparse
import json
import os
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from icjax.geometry import Box, Plane
from icjax.model import load_model
from icjax.spatial import Pose
from icjax.synthesis import Object, Scene, Surface, Target, rollout

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("ICJAX_SHARED_DATA", ROOT.parent / "shared" / "data")) / "contactnets_tosses"
HALF_WIDTH, GRAVITY, RATE = 0.0524, 9.81, 148.0
STEP = 0.002
UP = np.array([0.0, 0.0, 1.0])


def recorded(count: int) -> tuple[np.ndarray, dict]:
    """Release `[toss, 13]` and rest `[toss, 7]` of each toss in SI units, and the published numbers."""
    numbers = json.loads((DATA / "experiment.json").read_text())
    rows = np.load(DATA / "tosses.npz")
    scale = np.concatenate([np.full(3, HALF_WIDTH), np.ones(4), np.full(3, HALF_WIDTH), np.ones(3)])
    tosses = [rows[f"toss_{number:03d}"][:, :13] * scale for number in range(count)]
    release = np.array([toss[1] for toss in tosses])
    release[:, 9] -= GRAVITY / RATE / 2  # a recorded velocity is the mean over the frame before
    rest = np.array([toss[-1, :7] for toss in tosses])
    return np.concatenate([release, rest], axis=1), numbers


def ours(release: np.ndarray, numbers: dict, seconds: float) -> np.ndarray:
    """Last pose of each toss, `[toss, 7]`."""
    nobody = load_model('<mujoco model="nobody"/>')
    inertia = numbers["inertia"] * HALF_WIDTH**2 * np.eye(3)
    table = Surface("table", Plane(np.zeros(3), UP), numbers["mu"])
    steps = round(seconds / STEP)
    targets = Target(jnp.zeros((steps, 0)), jnp.zeros((steps, 0)))

    def one(row):
        rotation, position, velocity, spin = row
        cube = Object(
            "cube",
            Box(np.full(3, HALF_WIDTH)),
            numbers["mu"],
            mass=numbers["mass"],
            inertia=inertia,
            pose=Pose(rotation, position),
            velocity=velocity,
            angular_velocity=rotation @ spin,
        )
        scene = Scene("toss", (table,), objects=(cube,), facets=4, step=STEP)
        state, info = rollout(nobody, scene, targets)
        last = jnp.concatenate([state.motions[0].position, state.motions[0].quaternion])
        return last, jnp.sum(info.status != 0)

    rotation = Rotation.from_quat(release[:, 3:7], scalar_first=True).as_matrix()
    rows = (rotation, release[:, :3], release[:, 7:10], release[:, 10:13])
    last, failed = jax.jit(lambda rows: jax.lax.map(one, rows))(rows)
    print(f"steps not solved: {int(np.sum(failed))} of {steps * len(release)}")
    return np.asarray(last)


def mujocos(release: np.ndarray, numbers: dict, seconds: float) -> np.ndarray:
    """The same by MuJoCo: its default solver, contact and cone."""
    moment = numbers["inertia"] * HALF_WIDTH**2
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{STEP}" gravity="0 0 {-GRAVITY}"/><worldbody>
        <geom type="plane" size="9 9 1" friction="{numbers["mu"]}"/>
        <body><freejoint/><inertial pos="0 0 0" mass="{numbers["mass"]}" diaginertia="{moment} {moment} {moment}"/>
        <geom type="box" size="{HALF_WIDTH} {HALF_WIDTH} {HALF_WIDTH}" friction="{numbers["mu"]}"/></body>
        </worldbody></mujoco>""")
    data, last = mujoco.MjData(model), []
    for row in release:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = row[:7]
        data.qvel[:] = row[7:13]  # linear in world, angular in body axes, as recorded
        mujoco.mj_step(model, data, nstep=round(seconds / STEP))
        last.append(data.qpos.copy())
    return np.array(last)


def face(pose: np.ndarray) -> np.ndarray:
    """Number of the face that is up, 0 to 5."""
    up = Rotation.from_quat(pose[:, 3:7], scalar_first=True).as_matrix()[:, 2]
    axis = np.argmax(np.abs(up), axis=1)
    return 2 * axis + (np.take_along_axis(up, axis[:, None], axis=1)[:, 0] > 0)


def judged(last: np.ndarray, rest: np.ndarray) -> dict:
    """Fraction of right faces, median and quartiles of the distance in the plane (m)."""
    away = np.linalg.norm(last[:, :2] - rest[:, :2], axis=1)
    quartiles = np.percentile(away, [25, 50, 75])
    return {
        "right face": round(float(np.mean(face(last) == face(rest))), 4),
        "position error, m": [round(float(x), 4) for x in quartiles],
        "height error, m": round(float(np.median(np.abs(last[:, 2] - HALF_WIDTH))), 5),
    }


def main() -> None:
    """Simulate, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tosses", type=int, default=400)
    parser.add_argument("--seconds", type=float, default=3.0)
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    both, numbers = recorded(arguments.tosses)
    release, rest = both[:, :13], both[:, 13:]
    result: dict = {"tosses": arguments.tosses, "step": STEP, "seconds": arguments.seconds}
    for name, simulate in (("icjax", ours), ("MuJoCo", mujocos)):
        begin = time.perf_counter()
        result[name] = judged(simulate(release, numbers, arguments.seconds), rest)
        print(f"{name}: {result[name]}, {time.perf_counter() - begin:.0f} s", flush=True)
    result["released where it rests"] = judged(release, rest)
    print(f"released where it rests: {result['released where it rests']}")
    path = ROOT / "experiments" / "results" / "cube_tosses.json"
    path.write_text(json.dumps(result, indent=1) + "\n")
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
