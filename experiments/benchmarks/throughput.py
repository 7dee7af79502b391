"""Many contact problems at once: solves a second of icjax's solvers under `vmap`, against QuantEcon on as many cores.

    uv run --extra bench python experiments/benchmarks/throughput.py [--problems 1024] [--devices 2]

Random grasps of ten contacts with two facet pairs (n = 60) of all families of `icjax.contact.random_grasp`. On a CPU:
`lax.map` and `vmap` on one device, and `vmap` on each of several (`shard_map`), beside QuantEcon's `lcp_lemke` in as
many processes, which hold the problems before they are timed. On an accelerator, where there is one: `vmap` of several
batch sizes, in both precisions, beside one core of its host. A success is a residual of at most 1e-10 (float32: 1e-4),
recomputed in double precision; the path of `InteriorPoint` is no solution, its success is to have been found.
Written to experiments/results/throughput.json (or throughput_gpu.json).
"""

import argparse
import json
import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

RESULTS_FOLDER = Path(__file__).resolve().parents[1] / "results"
CONTACTS, FACETS = 10, 2
PIVOTS = 1000 + 50 * CONTACTS * (2 * FACETS + 2)
"""Most that QuantEcon may take, as many as icjax: a few problems end there, and would else take most of the time."""


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", type=int, default=1024)
    parser.add_argument("--devices", type=int, default=2, help="CPU devices and processes")
    parser.add_argument("--batches", type=int, nargs="+", default=[64, 1024, 16384], help="on an accelerator")
    arguments = parser.parse_args()
    flags = f"--xla_force_host_platform_device_count={arguments.devices} --xla_cpu_multi_thread_eigen=false"
    os.environ.setdefault("XLA_FLAGS", flags)
    import jax

    jax.config.update("jax_enable_x64", True)
    if jax.default_backend() == "cpu":
        rows, name = on_cpu(arguments.problems, arguments.devices), "throughput.json"
    else:
        rows, name = on_accelerator(arguments.batches), "throughput_gpu.json"
    (RESULTS_FOLDER / name).write_text(json.dumps(rows, indent=1) + "\n")
    print(f"wrote {RESULTS_FOLDER / name}")


def grasps(count: int):
    """A batch of problems, and M and q of each, all dimensionless with max |q| = 1."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    from icjax.contact import FAMILIES, assemble, dimensionless, random_grasp

    few = min(count, 1024)
    made = [random_grasp(5000 + seed, CONTACTS, FAMILIES[seed % len(FAMILIES)]) for seed in range(few)]
    batch = jax.tree.map(lambda *leaves: np.resize(np.stack(leaves), (count, *np.shape(leaves[0]))), *made)
    with jax.default_device(jax.devices("cpu")[0]):
        scaled = jax.jit(jax.vmap(lambda p: dimensionless(p, FACETS)[0]))(batch)
        M, q = jax.jit(jax.vmap(lambda p: assemble(p, FACETS)))(scaled)
        size = jnp.max(jnp.abs(q), axis=1, keepdims=True)
    return jax.tree.map(np.asarray, scaled), np.asarray(M), np.asarray(q / size)


def solvers():
    """Functions of one problem in both forms, that return numbers and whether they claim success."""
    from icjax import contact, lcp
    from icjax.results import RESULTS

    def lemke(problem, M, q):
        found = lcp.solve(M, q)
        return found.value, found.result == RESULTS.solved

    def interior(problem, M, q):
        found = contact.solve(problem, facets=FACETS, solver=contact.InteriorPoint(1e-4))
        return found.value.force, found.result == RESULTS.solved

    return {"Lemke": lemke, "InteriorPoint(1e-4)": interior}


def timed(function, *arrays) -> tuple[float, tuple]:
    """The least of three times, s, and the answer."""
    import jax

    answer = jax.block_until_ready(function(*arrays))
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        jax.block_until_ready(function(*arrays))
        seconds.append(time.perf_counter() - start)
    return min(seconds), answer


def success(name: str, M, q, answer) -> float:
    """Share of problems solved (Lemke) or of paths found."""
    import numpy as np

    value, claimed = (np.asarray(part) for part in answer)
    if name != "Lemke":
        return float(np.mean(claimed))
    z = value.astype(float)
    residual = np.max(np.abs(np.minimum(z, np.einsum("kij,kj->ki", M, z) + q)), axis=1)
    return float(np.mean(residual <= (1e-10 if value.dtype == np.float64 else 1e-4)))


def told(rows: list[dict], **row) -> None:
    """Keep and print."""
    rows.append(row)
    print(
        ", ".join(f"{key} {value:.4g}" if isinstance(value, float) else f"{key} {value}" for key, value in row.items())
    )


def on_cpu(count: int, devices: int) -> list[dict]:
    """Solves a second on one device and on all of them."""
    import jax
    import numpy as np
    from jax import lax
    from jax.sharding import Mesh, PartitionSpec

    rows: list[dict] = []
    problem, M, q = grasps(count)
    mesh = Mesh(np.asarray(jax.devices()[:devices]), ("batch",))
    for name, solve in solvers().items():

        def mapped(problem, M, q, solve=solve):
            return lax.map(lambda item: solve(*item), (problem, M, q))

        spread = jax.shard_map(
            jax.vmap(solve),
            mesh=mesh,
            in_specs=PartitionSpec("batch"),
            out_specs=PartitionSpec("batch"),
            check_vma=False,
        )
        forms = {"lax.map": mapped, "vmap": jax.vmap(solve), f"vmap on {devices} devices": spread}
        for form, function in forms.items():
            seconds, answer = timed(jax.jit(function), problem, M, q)
            told(rows, solver=name, form=form, per_second=count / seconds, success=success(name, M, q, answer))
    told(rows, solver="QuantEcon", form=f"{devices} processes", per_second=count / quantecon_seconds(M, q, devices))
    return rows


def quantecon_seconds(M, q, processes: int) -> float:
    """The least of three times for all problems, each process with its share of them."""
    import numpy as np

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problems.npz"
        np.savez(path, M=M, q=q)
        with ProcessPoolExecutor(processes, get_context("spawn"), _load, (path,)) as pool:
            shares = [range(k, len(q), processes) for k in range(processes)]
            seconds = []
            for _ in range(5):  # the first compiles
                start = time.perf_counter()
                list(pool.map(_quantecon, shares))
                seconds.append(time.perf_counter() - start)
    return min(seconds[2:])


_problems: list = []


def _load(path: Path) -> None:
    import numpy as np

    held = np.load(path)
    M, q = held["M"], held["q"]
    _problems[:] = [(np.ascontiguousarray(M[i]), np.ascontiguousarray(q[i])) for i in range(len(q))]


def _quantecon(share: range) -> float:
    from quantecon.optimize import lcp_lemke

    return float(sum(lcp_lemke(*_problems[i], max_iter=PIVOTS).z[0] for i in share))


def on_accelerator(batches: list[int]) -> list[dict]:
    """Solves a second on the accelerator, and on one core beside it."""
    import jax
    import numpy as np

    rows: list[dict] = []
    device = str(jax.devices()[0].device_kind)
    for name, solve in solvers().items():
        for count in batches:
            problem, M, q = grasps(count)
            for dtype in (np.float64, np.float32):
                arrays = jax.tree.map(lambda x, d=dtype: x if x.dtype == bool else x.astype(d), (problem, M, q))
                seconds, answer = timed(jax.jit(jax.vmap(solve)), *jax.device_put(arrays))
                row = {"device": device, "solver": name, "batch": count, "precision": np.dtype(dtype).name}
                told(rows, **row, per_second=count / seconds, success=success(name, M, q, answer))
        few = min(batches[0], 64)
        problem, M, q = grasps(few)
        with jax.default_device(jax.devices("cpu")[0]):
            seconds, answer = timed(jax.jit(jax.vmap(solve)), problem, M, q)
        row = {"device": "cpu, one core", "solver": name, "batch": few, "precision": "float64"}
        told(rows, **row, per_second=few / seconds, success=success(name, M, q, answer))
    return rows


if __name__ == "__main__":
    main()
