"""The structured interior point against QuantEcon's Lemke on the same contact problems: time, gradient, success.

    uv run --extra bench python experiments/benchmarks/interior_point.py [--problems 2] [--success 100]

Random grasps of every family with two, four and eight facet pairs: QuantEcon's n grows with them, the path's 3 N
equations do not. `InteriorPoint(1e-4)` follows the path to products of 1e-4, which QuantEcon's exact answer is compared
with in time only; "with gradient" is the value and the gradient of a sum of squared displacements with respect to all
free displacements. "factorisations" is the time of LAPACK's LU of as many matrices of 3 N rows as the path takes steps:
the least that a Newton method of so many steps can take here. Polished means exact to 1e-10, to 1e-4 in single
precision. Success is counted on `--success` problems of each family (20 contacts, two facet pairs); a path counts as
found where the solver says so, a polished answer by its recomputed residual. Written to
experiments/results/interior_point.json.
"""

import argparse
import json
import time
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from lcp import RESULT, TIMED, judged
from lcp_alternatives import QuantEcon

from icjax.contact import FAMILIES, InteriorPoint, assemble, dimensionless, random_grasp, solve
from icjax.lcp import Lemke
from icjax.results import RESULTS

PATH = InteriorPoint(1e-4)
EXACT = InteriorPoint(1e-6, polish=True)
SAFE = InteriorPoint(1e-6, polish=True, fallback=Lemke())
SAFE32 = InteriorPoint(1e-4, polish=True, fallback=Lemke())


def repeated(solver, facets: int, gradient: bool):
    """A compiled loop over solutions of one problem, each waiting for the one before."""

    def value(free, problem):
        moved = eqx.tree_at(lambda p: p.free_displacement, problem, free)
        return jnp.sum(solve(moved, facets=facets, solver=solver).value.displacement ** 2)

    one = jax.value_and_grad(value) if gradient else lambda free, problem: (value(free, problem), jnp.zeros(()))

    @jax.jit
    def many(problem, count):
        def again(_, nothing):
            found, slope = one(problem.free_displacement + nothing, problem)
            return jnp.minimum(found + jnp.sum(slope**2), 0.0)

        return jax.lax.fori_loop(0, count, again, jnp.zeros(()))

    return many


def seconds(many, problem) -> float:
    """Of one solution."""
    many(problem, 1).block_until_ready()
    start = time.perf_counter()
    many(problem, 1).block_until_ready()
    count = max(1, int(TIMED / (time.perf_counter() - start)))
    best = float("inf")
    for _ in range(3):
        start = time.perf_counter()
        many(problem, count).block_until_ready()
        best = min(best, (time.perf_counter() - start) / count)
    return best


def factorisations():
    """A compiled loop over LU factorisations of one problem's W, each waiting for the one before."""

    @jax.jit
    def many(problem, count):
        def again(_, nothing):
            matrix = problem.coupling + jnp.eye(problem.coupling.shape[0]) + nothing
            return jnp.minimum(jnp.abs(jax.lax.linalg.lu(matrix)[0][0, 0]), 0.0)

        return jax.lax.fori_loop(0, count, again, jnp.zeros(()))

    return many


def speed(facets: int, contacts: int, problems: int) -> dict:
    """Median ratios of one size."""
    quantecon = QuantEcon()
    runs = {
        "path": repeated(PATH, facets, False),
        "path with gradient": repeated(PATH, facets, True),
        "polished": repeated(EXACT, facets, False),
        "Lemke": repeated(Lemke(), facets, False),
    }
    runs["factorisations"] = factorisations()
    steps = jax.jit(lambda problem: solve(problem, facets=facets, solver=PATH).stats["pivots"])
    times: dict[str, list[float]] = {name: [] for name in runs}
    taken = []
    for family in FAMILIES:
        for seed in range(problems):
            problem = jax.tree.map(jnp.asarray, random_grasp(1000 + seed, contacts, family))
            M, q = (np.ascontiguousarray(x) for x in assemble(dimensionless(problem, facets)[0], facets))
            q = q / np.max(np.abs(q))
            z, _ = quantecon.solve(M, q)
            if judged(M, q, z) > 1e-10:
                continue
            count = max(1, int(TIMED / quantecon.seconds(M, q, 1)))
            theirs = min(quantecon.seconds(M, q, count) / count for _ in range(2))
            taken.append(int(steps(problem)))
            for name, many in runs.items():
                often = taken[-1] if name == "factorisations" else 1
                times[name].append(often * seconds(many, problem) / theirs)
    row = {"n": contacts * (2 * facets + 2), "facets": facets, "problems": len(taken), "steps": float(np.median(taken))}
    row |= {name: round(float(np.median(ratios)), 3) for name, ratios in times.items()}
    gradient = np.asarray(times["path with gradient"]) / np.asarray(times["path"])
    return row | {"gradient over value": round(float(np.median(gradient)), 3)}


def success(count: int) -> list[dict]:
    """Problems of 20 contacts solved by each solver."""
    rows = []
    for name, solver, dtype in [
        ("path", PATH, np.float64),
        ("path", PATH, np.float32),
        ("polished", EXACT, np.float64),
        ("polished, else Lemke", SAFE, np.float64),
        ("polished, else Lemke", SAFE32, np.float32),
        ("Lemke", Lemke(), np.float32),
    ]:
        tolerance = 1e-10 if dtype == np.float64 else 1e-4
        run = jax.jit(jax.vmap(partial(solve, facets=2, solver=solver)))
        good, wrong = 0, 0
        for family in FAMILIES:
            made = [random_grasp(70_000 + seed, 20, family) for seed in range(count)]
            batch = jax.tree.map(lambda *x: np.stack(x), *made)
            batch = jax.tree.map(lambda x, d=dtype: x if x.dtype == bool else x.astype(d), batch)
            found = run(batch)
            said = np.asarray(found.result == RESULTS.solved)
            small = np.asarray(found.stats["residual"]) <= tolerance
            good += int(np.sum(said if name == "path" else said & small))
            wrong += 0 if name == "path" else int(np.sum(said & ~small))
        row = {"solver": name, "precision": np.dtype(dtype).name, "problems": count * len(FAMILIES)}
        rows.append(row | {"solved": good, "false successes": wrong})
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description="Interior point against QuantEcon's Lemke")
    parser.add_argument("--problems", type=int, default=2, help="of each family and size")
    parser.add_argument("--success", type=int, default=100, help="of each family")
    arguments = parser.parse_args()
    rows = []
    for facets, contacts in [(2, 20), (2, 40), (2, 80), (4, 24), (4, 48), (8, 13), (8, 27)]:
        rows.append(speed(facets, contacts, arguments.problems))
        print(rows[-1], flush=True)
    result = RESULT.with_name("interior_point.json")
    result.write_text(json.dumps({"over QuantEcon": rows, "success": success(arguments.success)}, indent=1) + "\n")
    print(f"wrote {result}")


if __name__ == "__main__":
    main()
