"""Solvers of contact problems against QuantEcon's and Drake's Lemke, in one run: time, success, false success.

    uv run --extra bench python experiments/benchmarks/lcp.py [--problems 3] [--sizes 24 60 120 240 480]

Problems: random grasps of every family of `icjax.contact.random_grasp`, made dimensionless, two facet pairs, n = 6 N.
Every answer is judged by this script: solved means max |min(z, M z + q)| <= 1e-10 (max |q| = 1), whatever its solver
says. A solver that says so and is wrong has made a false success. Times are of one problem on one core, repeated inside
compiled code (icjax: one `jit`; QuantEcon: one numba loop; Drake: its solver object, program made beforehand); a ratio
is ours over theirs for the same problem, the table gives medians over the problems that both have solved. Written to
experiments/results/lcp.json.
"""

import argparse
import json
import os
import time
from functools import partial
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
from lcp_alternatives import alternatives

from icjax import lcp
from icjax.contact import FAMILIES, assemble, dimensionless, random_grasp
from icjax.results import RESULTS

RESULT = Path(__file__).resolve().parents[1] / "results" / "lcp.json"
FACETS = 2
REACHED = 1e-10
TIMED = 0.05
"""s; a problem is repeated for about that long."""


class Ours:
    """One of icjax's solvers, repeated inside one compiled program."""

    def __init__(self, name: str, solver) -> None:
        self.name = name
        self.one = jax.jit(partial(lcp.solve, solver=solver))
        self.many = jax.jit(partial(_repeated, solver))

    def solve(self, M: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, bool]:
        """z and whether the solver says that it has solved the problem."""
        solution = self.one(M, q)
        return np.asarray(solution.value), bool(solution.result == RESULTS.solved)

    def seconds(self, M: np.ndarray, q: np.ndarray, count: int) -> float:
        """Of `count` solutions one after the other, each waiting for the one before."""
        jax.block_until_ready(self.many(M, q, 1))
        start = time.perf_counter()
        jax.block_until_ready(self.many(M, q, count))
        return time.perf_counter() - start


def _repeated(solver, M, q, count):
    def again(_, nothing):
        return jnp.minimum(jnp.sum(lcp.solve(M, q + nothing, solver).value), 0.0)

    return jax.lax.fori_loop(0, count, again, jnp.zeros((), q.dtype))


def problem(seed: int, contacts: int, family: str) -> tuple[np.ndarray, np.ndarray]:
    """M and q of a random grasp, with max |q| = 1."""
    M, q = assemble(dimensionless(random_grasp(seed, contacts, family), FACETS)[0], FACETS)
    size = float(jnp.max(jnp.abs(q)))
    return np.ascontiguousarray(M), np.ascontiguousarray(q) / size


def judged(M: np.ndarray, q: np.ndarray, z: np.ndarray) -> float:
    """Residual of the dimensionless problem, infinite for no number."""
    found = float(np.max(np.abs(np.minimum(z, M @ z + q))))
    return found if np.isfinite(found) else float("inf")


def measured(solver, M: np.ndarray, q: np.ndarray, timed: float) -> dict:
    """Seconds, residual and claim of one solver on one problem."""
    z, claimed = solver.solve(M, q)
    residual = judged(M, q, z)
    first = solver.seconds(M, q, 1)
    count = max(1, int(timed / max(first, 1e-7)))
    seconds = min(solver.seconds(M, q, count) / count for _ in range(2))
    return {"seconds": seconds, "residual": residual, "claimed": claimed, "solved": residual <= REACHED}


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", type=int, default=3, help="of each family and size")
    parser.add_argument("--sizes", type=int, nargs="+", default=[24, 60, 120, 240, 480])
    parser.add_argument("--slowest", type=int, default=240, help="largest size that Drake's solvers are given")
    arguments = parser.parse_args()
    solvers = [Ours("icjax Lemke", lcp.Lemke()), *alternatives()]
    rows = []
    for n in arguments.sizes:
        for family in FAMILIES:
            for seed in range(arguments.problems):
                M, q = problem(1000 + seed, n // (2 * FACETS + 2), family)
                for solver in solvers:
                    if n <= arguments.slowest or "Drake" not in solver.name:
                        found = measured(solver, M, q, TIMED)
                        rows.append({"n": n, "family": family, "seed": seed, "solver": solver.name, **found})
        _print(rows, n, solvers)
    RESULT.write_text(json.dumps(rows, indent=0) + "\n")
    print(f"wrote {RESULT}")


def _print(rows: list[dict], n: int, solvers: list) -> None:
    reference = "QuantEcon lcp_lemke"
    here = {(r["family"], r["seed"], r["solver"]): r for r in rows if r["n"] == n}
    keys = sorted({key[:2] for key in here})
    print(f"n = {n}: {len(keys)} problems")
    for solver in solvers:
        own = [here[(*key, solver.name)] for key in keys if (*key, solver.name) in here]
        if not own:
            continue
        ratios = [
            here[(*key, solver.name)]["seconds"] / here[(*key, reference)]["seconds"]
            for key in keys
            if here[(*key, solver.name)]["solved"] and here[(*key, reference)]["solved"]
        ]
        print(
            f"  {solver.name:22s} {np.median(ratios):8.2f} x QuantEcon ({len(ratios)} problems), "
            f"{1e6 * np.median([r['seconds'] for r in own]):10.0f} us, solved {sum(r['solved'] for r in own)}, "
            f"false successes {sum(r['claimed'] and not r['solved'] for r in own)}, "
            f"denied {sum(r['solved'] and not r['claimed'] for r in own)}"
        )


if __name__ == "__main__":
    main()
