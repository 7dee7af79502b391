"""Five fingers lift a box: time of a rollout, of many, and of a gradient, beside MuJoCo and MJX on the same machine.

    uv venv mjx && uv pip install --python mjx mujoco-mjx
    uv run --all-extras python experiments/benchmarks/rollout.py --mjx mjx/bin/python

The scene (`rollout_scene.py`): 24 degrees of freedom, five soft pads, a box on a table, steps of 2 ms, room for ten
contacts with two facet pairs (n = 60). Every part runs in a process of its own:

- one: 500 steps in one scan on one thread, compiled cold and from JAX's cache; MuJoCo C (called from Python, one
  `mj_step` a step) and MJX (float32) with the same hand, reference, box and step;
- gradient: reverse mode of a sum over forces and object, by all compliances, friction, mass and the whole reference
  (12 000 numbers and more); differences through MuJoCo take a rollout a number;
- many: 256 rollouts with other compliances, frictions and masses, on one CPU device and on two (`shard_map`).

One device has one thread (`NPROC=1`; compilation may have more): with two, XLA passes a rollout's small operations from
thread to thread and is slower by half. All parts run twice, in turn, and the faster is kept, since shared machines are
slow for seconds at a time.

Written to experiments/results/rollout.json. On a machine with an accelerator `--part accelerator` writes
rollout_gpu.json: rollouts a second under `vmap`.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
RESULT = HERE.parent / "results" / "rollout.json"
FACETS, CONTACTS = 2, 10
PARTS = ("one", "gradient", "many", "mujoco", "accelerator")
REPEATS = 5


def setting():
    """Model, and a function from compliance, friction, mass and reference to the rollout's outputs."""
    import dataclasses

    import jax
    import jax.numpy as jnp
    import numpy as np
    import rollout_scene as scene

    from icjax.geometry import Box, Plane
    from icjax.model import load_model
    from icjax.spatial import Pose
    from icjax.synthesis import Object, Scene, Surface, Target, rollout

    jax.config.update("jax_enable_x64", True)
    model = load_model(scene.MODEL)
    model = dataclasses.replace(model, pad_compliance=np.full(5, 1 / 750))
    table = Surface("table", Plane(np.zeros(3), np.array([0.0, 0.0, 1.0])), scene.TABLE_FRICTION)

    def run(compliance, friction, mass, reference):
        pose = Pose(np.eye(3), np.array([0.0, 0.0, scene.HALF_SIZES[2]]))
        box = Object("box", Box(np.array(scene.HALF_SIZES)), friction, mass=mass, pose=pose)
        stage = Scene("lift", (table,), facets=FACETS, step=scene.STEP, objects=(box,), contacts=CONTACTS)
        driven = jnp.concatenate([jnp.zeros(scene.FOREARM), compliance])
        targets = Target(reference, jnp.broadcast_to(driven, (reference.shape[0], driven.shape[0])))
        return rollout(model, stage, targets)[1]

    numbers = (jnp.array(scene.COMPLIANCE), jnp.array(scene.FRICTION), jnp.array(scene.MASS))
    return run, (*numbers, jnp.asarray(scene.reference()))


def compiled(function, *arguments):
    """The machine function, and the seconds that tracing and compiling took."""
    import jax

    begin = time.perf_counter()
    return jax.jit(function).lower(*arguments).compile(), time.perf_counter() - begin


def best(function, *arguments, repeats: int = REPEATS):
    """The last value, and the least time of some calls."""
    import jax

    times, value = [], None
    for _ in range(repeats):
        begin = time.perf_counter()
        value = jax.block_until_ready(function(*arguments))
        times.append(time.perf_counter() - begin)
    return value, min(times)


def one() -> dict:
    """One rollout."""
    import numpy as np
    import rollout_scene as scene

    run, numbers = setting()
    function, compiling = compiled(run, *numbers)
    info, seconds = best(function, *numbers)
    height = np.asarray(info.object_position)[:, 0, 2]
    return {
        "seconds a step": seconds / scene.STEPS,
        "times real time": scene.STEPS * scene.STEP / seconds,
        "compile s": compiling,
        "unsolved steps": int(np.sum(np.asarray(info.status) > 0)),
        "most contacts at once": int(np.sum(np.asarray(info.slip_state) > 0, axis=1).max()),
        "box rises mm": 1e3 * float(height[-1] - height[0]),
        "memory MB": memory(),
    }


def gradient() -> dict:
    """Reverse mode against the forward pass."""
    import jax
    import jax.numpy as jnp
    import numpy as np
    import rollout_scene as scene

    run, numbers = setting()

    def loss(*numbers):
        info = run(*numbers)
        return jnp.sum(info.contact_force**2) + jnp.sum(info.object_position**2)

    forward, _ = compiled(loss, *numbers)
    _, plain = best(forward, *numbers)
    backward, compiling = compiled(jax.grad(loss, argnums=(0, 1, 2, 3)), *numbers)
    found, seconds = best(backward, *numbers)
    assert all(np.isfinite(np.asarray(x)).all() for x in found)
    count = sum(np.size(x) for x in numbers)
    return {
        "over forward": seconds / plain,
        "seconds": seconds,
        "forward seconds": plain,
        "compile s": compiling,
        "parameters": count,
        "differences, s": count * scene.STEPS * mujoco()["seconds a step"],
        "temporary MB": backward.memory_analysis().temp_size_in_bytes / 1e6,
        "memory MB": memory(),
    }


def many(count: int = 256) -> dict:
    """Rollouts a second on all CPU devices of this process."""
    import jax
    import jax.numpy as jnp
    import numpy as np
    from jax.sharding import Mesh, PartitionSpec

    run, (compliance, friction, mass, reference) = setting()
    random = np.random.default_rng(5)
    varied = (
        jnp.asarray(random.uniform(0.7, 1.4, (count, 1))) * compliance[None],
        jnp.asarray(random.uniform(0.6, 1.2, count)),
        jnp.asarray(random.uniform(0.01, 0.1, count)),
    )

    def each(*varied):
        return jax.lax.map(lambda x: run(*x, reference).object_position[-1, 0, 2], varied)

    part, mesh = PartitionSpec("device"), Mesh(np.array(jax.devices("cpu")), ("device",))
    function, _ = compiled(jax.shard_map(each, mesh=mesh, in_specs=part, out_specs=part, check_vma=False), *varied)
    height, seconds = best(function, *varied, repeats=2)
    return {
        "rollouts": count,
        "a second": count / seconds,
        "lifted": int(np.sum(np.asarray(height) > 0.08)),
        "memory MB": memory(),
    }


def accelerator(batches: tuple[int, ...] = (64, 1024, 4096)) -> dict:
    """Rollouts a second of one accelerator under `vmap`, and of one core of its host."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    run, (compliance, friction, mass, reference) = setting()
    random = np.random.default_rng(5)
    rows: dict = {"device": jax.devices()[0].device_kind, "steps": reference.shape[0]}

    def each(*varied):
        info = run(*varied, reference)
        return info.object_position[-1, 0, 2], jnp.sum(info.status > 0)

    for count in batches:
        varied = (
            jnp.asarray(random.uniform(0.7, 1.4, (count, 1))) * compliance[None],
            jnp.asarray(random.uniform(0.6, 1.2, count)),
            jnp.asarray(random.uniform(0.01, 0.1, count)),
        )
        function, compiling = compiled(jax.vmap(each), *varied)
        (height, unsolved), seconds = best(function, *varied, repeats=2)
        rows[f"batch of {count}"] = {
            "rollouts a second": count / seconds,
            "seconds": seconds,
            "compile s": compiling,
            "lifted": int(np.sum(np.asarray(height) > 0.08)),
            "unsolved steps": int(np.sum(np.asarray(unsolved))),
        }
        print(count, rows[f"batch of {count}"], flush=True)
    with jax.default_device(jax.devices("cpu")[0]):
        single = jax.device_put((compliance, friction, mass, reference), jax.devices("cpu")[0])
        function, _ = compiled(run, *single)
        _, seconds = best(function, *single)
    rows["one core of its host, rollouts a second"] = 1.0 / seconds
    return rows


def mujoco() -> dict:
    """MuJoCo C through its Python bindings."""
    import mujoco as mj
    import rollout_scene as scene

    model, reference = scene.mujoco_model(), scene.reference()
    hand, times, contacts = reference.shape[1], [], 0
    for _ in range(REPEATS):
        data = mj.MjData(model)
        data.qpos[:] = scene.start(model)
        begin = time.perf_counter()
        for slack in reference:
            model.qpos_spring[:hand] = slack
            mj.mj_step(model, data)
            contacts = max(contacts, data.ncon)
        times.append(time.perf_counter() - begin)
    return {
        "seconds a step": min(times) / len(reference),
        "most contacts at once": contacts,
        "box rises mm": 1e3 * float(data.qpos[-5] - scene.HALF_SIZES[2]),
    }


def memory() -> float:
    """Most memory that this process has held, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def apart(part: str, devices: int = 1, **environment: str) -> dict:
    """A part in a process of its own."""
    flags = f"--xla_force_host_platform_device_count={devices} --xla_cpu_multi_thread_eigen=false"
    command = [sys.executable, str(Path(__file__).resolve()), "--part", part]
    settings = {**os.environ, "XLA_FLAGS": flags, "NPROC": "1", **environment}
    found = subprocess.run(command, env=settings, capture_output=True, text=True, check=True)
    return json.loads(found.stdout.splitlines()[-1])


def measured(mjx: Path | None) -> dict:
    """One round of all parts."""
    rows: dict = {}
    with tempfile.TemporaryDirectory() as cache:
        kept = {"JAX_COMPILATION_CACHE_DIR": cache, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.2"}
        rows["one rollout"] = apart("one", **kept)
        rows["one rollout"]["compile from cache s"] = apart("one", **kept)["compile s"]
    rows["MuJoCo C"] = apart("mujoco")
    if mjx is not None:
        found = subprocess.run([mjx.absolute(), HERE / "rollout_mjx.py"], capture_output=True, text=True, check=True)
        rows["MJX"] = json.loads(found.stdout.splitlines()[-1])
    rows["gradient"] = apart("gradient")
    rows["many, one device"] = apart("many")
    rows["many, two devices"] = apart("many", devices=2)
    return rows


def speed(row: dict) -> float:
    """What the faster of two rounds is known by."""
    return row["a second"] if "a second" in row else 1.0 / row.get("seconds a step", row.get("seconds"))


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--part", choices=PARTS, help="print one part as JSON")
    parser.add_argument("--mjx", type=Path, help="Python of an environment with mujoco-mjx")
    arguments = parser.parse_args()
    if arguments.part:
        found = globals()[arguments.part]()
        print(json.dumps(found))
        if arguments.part == "accelerator":
            RESULT.with_name("rollout_gpu.json").write_text(json.dumps(rounded(found), indent=1) + "\n")
        return
    first, second = measured(arguments.mjx), measured(arguments.mjx)
    rows: dict = {name: max(first[name], second[name], key=speed) for name in first}
    if "MJX" in rows:
        rows["MJX over icjax"] = rows["MJX"]["seconds a step"] / rows["one rollout"]["seconds a step"]
    rows["two devices over one"] = rows["many, two devices"]["a second"] / rows["many, one device"]["a second"]
    rows = {name: rounded(value) for name, value in rows.items()}
    for name, value in rows.items():
        print(f"{name}: {value}")
    RESULT.write_text(json.dumps(rows, indent=1) + "\n")
    print(f"wrote {RESULT}")


def rounded(value):
    """To three digits."""
    if isinstance(value, dict):
        return {name: rounded(item) for name, item in value.items()}
    return float(f"{value:.3g}") if isinstance(value, float) else value


if __name__ == "__main__":
    main()
