"""Solvers of contact problems against QuantEcon's and Drake's Lemke, in one run: time, success, false success.

    uv run --extra bench python experiments/benchmarks/lcp.py [--problems 3] [--sizes 24 60 120 240 480]

Problems: random grasps of every family of `icjax.contact.random_grasp`, made dimensionless, two facet pairs, n = 6 N.
Every answer is judged by this script: solved means max |min(z, M z + q)| <= 1e-10 (max |q| = 1), whatever its solver
says. A solver that says so and is wrong has made a false success. Times are of one problem on one core, repeated inside
compiled code for icjax (one `jit`) and, on the line of that name, for QuantEcon (one numba loop, work space given);
QuantEcon's other line is a call from Python, Drake's are its solver objects, programs made beforehand. A ratio is ours
over theirs for the same problem, the table gives medians over the problems that both have solved.

Then success alone, on many more problems: random grasps of all families, N from 1 to 20, and problems made from a
solution (W of integers and low rank, contact states drawn first), which may violate the condition for existence of the
documentation and have solutions all the same. Written to experiments/results/lcp.json.
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
from icjax.contact import FAMILIES, ContactProblem, assemble, dimensionless, random_grasp
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


@jax.jit
def assembled(grasp: ContactProblem):
    """M and q of a problem in its own units."""
    return assemble(dimensionless(grasp, FACETS)[0], FACETS)


def problem(seed: int, contacts: int, family: str) -> tuple[np.ndarray, np.ndarray]:
    """M and q of a random grasp, with max |q| = 1."""
    M, q = (np.ascontiguousarray(array) for array in assembled(random_grasp(seed, contacts, family)))
    return M, q / np.max(np.abs(q))


def judged(M: np.ndarray, q: np.ndarray, z: np.ndarray) -> float:
    """Residual of the dimensionless problem, infinite for no number."""
    found = float(np.max(np.abs(np.minimum(z, M @ z + q))))
    return found if np.isfinite(found) else float("inf")


def measured(solver, M: np.ndarray, q: np.ndarray, timed: float) -> dict:
    """Seconds, residual and claim of one solver on one problem."""
    z, claimed = solver.solve(M, q)
    residual = judged(M, q, z)
    if residual > REACHED:
        return {"seconds": None, "residual": residual, "claimed": claimed, "solved": False}
    first = solver.seconds(M, q, 1)
    count = max(1, int(timed / max(first, 1e-7)))
    seconds = min(solver.seconds(M, q, count) / count for _ in range(2))
    return {"seconds": seconds, "residual": residual, "claimed": claimed, "solved": True}


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", type=int, default=3, help="of each family and size")
    parser.add_argument("--sizes", type=int, nargs="+", default=[24, 60, 120, 240, 480])
    parser.add_argument("--success", type=int, default=10_000, help="problems for success alone")
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
    sure = success(arguments.success)
    RESULT.write_text(json.dumps({"speed": rows, "success": sure}, indent=0) + "\n")
    print(f"wrote {RESULT}")


def success(count: int) -> dict:
    """Solved, unsolved and falsely solved problems of both kinds, as numbers of problems."""
    kinds = {"grasps": _grasps(count), "made from a solution": _made(count)}
    found = {}
    for kind, problems in kinds.items():
        total = {"problems": 0, "solved": 0, "false successes": 0, "repeated": 0, "largest residual of a success": 0.0}
        for M, q in problems:
            solution = jax.jit(jax.vmap(lcp.solve))(M, q)
            said = np.asarray(solution.result == RESULTS.solved)
            residuals = np.array([judged(*item) for item in zip(M, q, np.asarray(solution.value), strict=True)])
            total["problems"] += len(q)
            total["solved"] += int(np.sum(residuals <= REACHED))
            total["false successes"] += int(np.sum(said & (residuals > REACHED)))
            total["repeated"] += int(np.sum(np.asarray(solution.stats["attempts"]) > 1))
            largest = float(np.max(residuals[said], initial=0.0))
            total["largest residual of a success"] = max(total["largest residual of a success"], largest)
        print(f"{kind}: {total}")
        found[kind] = total
    return found


def _grasps(count: int):
    """Batches of equal size, the families in turn."""
    for contacts in (1, 2, 4, 10, 20):
        seeds = range(100_000, 100_000 + count // 5)
        made = [problem(seed, contacts, FAMILIES[seed % len(FAMILIES)]) for seed in seeds]
        yield np.stack([M for M, _ in made]), np.stack([q for _, q in made])


def _made(count: int):
    """Contacts on one plane with W = B B^T of integers and low rank; forces and motions of open, sticking and sliding
    contacts are drawn, and the free displacement is what makes them the solution."""
    rng = np.random.default_rng(2006)
    frame = np.eye(3)[:, [2, 0, 1]]
    for contacts in (1, 2, 3, 4):
        problems = []
        for _ in range(count // 4):
            B = rng.integers(-3, 4, (3 * contacts, int(rng.integers(1, 3 * contacts)))).astype(float)
            friction = rng.choice([0.3, 0.5, 1.0, 2.0], contacts)
            force, moved = np.zeros((contacts, 3)), np.zeros((contacts, 3))
            gap = rng.choice([0.0, 0.0, -1.0, 1.0], contacts)
            for i, state in enumerate(rng.integers(0, 3, contacts)):
                moved[i, 0] = -gap[i] + (rng.integers(0, 2) if state == 0 else 0)
                force[i, 0] = 0 if state == 0 else rng.integers(0, 3)
                if state == 0:
                    moved[i, 1:] = rng.integers(-1, 2, 2)
                if state == 2:
                    along, sign = rng.integers(1, 3), rng.choice([-1.0, 1.0])
                    force[i, along] = -sign * friction[i] * force[i, 0]
                    moved[i, along] = sign * rng.integers(0, 3)
            free = moved.reshape(-1) - B @ (B.T @ force.reshape(-1))
            wide = np.kron(np.eye(contacts), frame)
            made = ContactProblem(
                wide @ B @ B.T @ wide.T,
                wide @ free,
                gap,
                np.repeat(frame[None], contacts, axis=0),
                friction,
                np.ones(contacts, bool),
            )
            M, q = assembled(made)
            problems.append((np.asarray(M), np.asarray(q) / max(float(np.max(np.abs(q))), 1e-300)))
        yield np.stack([M for M, _ in problems]), np.stack([q for _, q in problems])


def _print(rows: list[dict], n: int, solvers: list) -> None:
    reference = "QuantEcon"
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
        solved = [r for r in own if r["solved"]]
        print(
            f"  {solver.name:22s} {np.median(ratios):8.2f} x QuantEcon ({len(ratios)} problems), "
            f"{1e6 * np.median([r['seconds'] for r in solved]):10.0f} us, solved {len(solved)}, "
            f"false successes {sum(r['claimed'] and not r['solved'] for r in own)}, "
            f"denied {sum(not r['claimed'] for r in solved)}"
        )


if __name__ == "__main__":
    main()
