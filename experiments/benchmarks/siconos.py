"""Frictional contact problems of Siconos through Lemke's method here, QuantEcon's and Drake's: success and time.

    uv run --extra bench python experiments/benchmarks/siconos.py [--shared SHARED_DATA] [--most 60] [--facets 2 4 8]

Every friction problem of `siconos_fc_lcp` with at most that many contacts, with every number m of tangent pairs,
smallest first until the time is over; what is then left is named. W is made symmetric (the files' may not be: the
stored asymmetry is printed, over the largest entry); planar problems get zeros along tangent 2, so that their W has
rank 2 N at most. Times and judgement are those of lcp.py: solved means a recomputed residual of at most 1e-10 with
max |q| = 1, whatever a solver says.

Prints a line a problem (n, rank of W, the least q^T z of the existence theorem of docs/contact_problem.md, which must
not be negative, then what every solver did) and a summary a solver, and writes experiments/results/siconos.json.
"""

import argparse
import json
import os
import time
from functools import partial
from pathlib import Path

from lcp import TIMED, Ours, measured  # first: it sets the number of threads

# isort: split
import jax
import numpy as np
from lcp_alternatives import alternatives
from scipy.optimize import linprog
from siconos_problems import read_contacts, read_friction

from icjax import lcp
from icjax.contact import ContactProblem, assemble, dimensionless, friction_cone
from icjax.results import RESULTS

RESULT = Path(__file__).resolve().parents[1] / "results" / "siconos.json"
SHARED = Path(os.environ.get("ICJAX_SHARED_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
ASYMMETRY = 0.01
"""Largest asymmetry of a stored W whose symmetric part is taken; gyroscopic terms make some of 0.2 %."""
SINGULAR = 1e-9
"""Eigenvalues of W below this part of the largest count as zero."""
FAILURES = ("secondary_ray", "breakdown", "max_pivots", "invalid_input")


@partial(jax.jit, static_argnums=1)
def assembled(contacts: ContactProblem, facets: int):
    """M and q of a problem in its own units."""
    return assemble(dimensionless(contacts, facets)[0], facets)


def existence(contacts: ContactProblem, facets: int) -> tuple[int, float]:
    """Rank of W, and the least q^T f of forces in the cones with W f = 0 and normal forces that add up to at most one.

    The latter over the largest |q|; a solution exists where it is not negative.
    """
    values, vectors = np.linalg.eigh(contacts.coupling)
    moving = values > SINGULAR * values[-1]
    if np.all(moving):
        return len(values), 0.0
    cone = friction_cone(contacts.frames, contacts.friction, facets)
    D, F = np.asarray(cone.D), np.asarray(cone.F)
    count, _, size = D.shape
    free = np.einsum("iaj,ia->ij", D, contacts.free_displacement.reshape(count, 3)).reshape(-1)
    free /= max(np.max(np.abs(free)), 1e-300)
    moved = np.einsum("iak,iaj->kij", vectors[:, moving].reshape(count, 3, -1), D).reshape(-1, count * size)
    within = (np.eye(count)[:, :, None] * F[:, None, :]).reshape(count, count * size)
    normal = np.tile(np.eye(size)[0], count)
    found = linprog(
        free,
        A_ub=np.vstack([-within, normal]),
        b_ub=np.append(np.zeros(count), 1.0),
        A_eq=moved,
        b_eq=np.zeros(len(moved)),
        method="highs",
    )
    return int(np.sum(moving)), float(found.fun) if found.success else float("nan")


def status(solution) -> str:
    """Name of the status of icjax."""
    return next((name for name in FAILURES if bool(solution.result == getattr(RESULTS, name))), "solved")


def problems(folder: Path, most: int) -> list[tuple[Path, int]]:
    """Files of friction problems and their numbers of contacts, fewest first."""
    files = [(path, len(read_friction(path).mu)) for path in sorted(folder.glob("fc_*/*"))]
    if not files:
        raise SystemExit(f"no friction problems in {folder}")
    return sorted(((path, count) for path, count in files if count <= most), key=lambda item: item[1])


def compared(path: Path, facets: int, ours: Ours, others: list, slowest: int) -> dict:
    """One problem through every solver."""
    contacts = read_contacts(path, ASYMMETRY)
    M, q = (np.ascontiguousarray(array) for array in assembled(contacts, facets))
    q = q / max(float(np.max(np.abs(q))), 1e-300)
    rank, least = existence(contacts, facets)
    tried = [solver for solver in others if len(q) <= slowest or "Drake" not in solver.name]
    found = {solver.name: measured(solver, M, q, TIMED) for solver in (ours, *tried)}
    solution = ours.one(M, q)
    stats = {name: int(solution.stats[name]) for name in ("pivots", "attempts")}
    found[ours.name] |= {"status": status(solution), **stats}
    return {
        "name": path.name,
        "contacts": len(contacts.gap),
        "facets": facets,
        "n": len(q),
        "asymmetry": read_friction(path).asymmetry(),
        "rank": rank,
        "least": least,
        "solvers": found,
    }


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description="Siconos problems through solvers")
    parser.add_argument("--shared", type=Path, default=SHARED, help="folder that holds siconos_fc_lcp")
    parser.add_argument("--most", type=int, default=60, help="contacts of the largest problem")
    parser.add_argument("--facets", type=int, nargs="+", default=[2, 4, 8], help="numbers of tangent pairs")
    parser.add_argument("--slowest", type=int, default=240, help="largest n that Drake's solvers are given")
    parser.add_argument("--seconds", type=float, default=600.0, help="after which no further problem is begun")
    arguments = parser.parse_args()
    start = time.perf_counter()
    ours, others = Ours("icjax Lemke", lcp.Lemke()), alternatives()
    files = problems(arguments.shared / "siconos_fc_lcp", arguments.most)
    cases = sorted(((path, count, m) for path, count in files for m in arguments.facets), key=_size)
    rows, left = [], []
    for path, _, facets in cases:
        if time.perf_counter() - start > arguments.seconds:
            left.append({"name": path.name, "facets": facets})
            continue
        rows.append(compared(path, facets, ours, others, arguments.slowest))
        print(_line(rows[-1], ours.name), flush=True)
    for solver in (ours, *others):
        print(_summary(rows, solver.name))
    if left:
        print("not tried:", ", ".join(f"{item['name']} (m = {item['facets']})" for item in left))
    RESULT.write_text(json.dumps({"problems": rows, "not tried": left}, indent=0) + "\n")
    print(f"wrote {RESULT}")


def _size(case: tuple[Path, int, int]) -> int:
    return case[1] * (2 * case[2] + 2)


def _line(row: dict, ours: str) -> str:
    own = row["solvers"][ours]
    verdicts = {
        (True, True): "solved",
        (True, False): "solved but denied",
        (False, False): "failed",
        (False, True): "falsely solved",
    }
    said = [(name, verdicts[found["solved"], found["claimed"]]) for name, found in row["solvers"].items()]
    others = ", ".join(f"{name} {verdict}" for name, verdict in said if name != ours)
    return (
        f"{row['name'][:36]:36s} m = {row['facets']}, n = {row['n']:4d}, rank {row['rank']} of {3 * row['contacts']}, "
        f"asymmetry {row['asymmetry']:.0e}, least {row['least']:.0e}: {own['status']} {own['residual']:.0e}, "
        f"{own['pivots']} pivots, {own['attempts']} attempts; {others}"
    )


def _summary(rows: list[dict], name: str) -> str:
    own = [row["solvers"] for row in rows if name in row["solvers"]]
    parts = [f"{name:22s} solved {sum(item[name]['solved'] for item in own):2d} of {len(own)}"]
    parts += [f"false successes {sum(item[name]['claimed'] and not item[name]['solved'] for item in own)}"]
    parts += [f"denied {sum(item[name]['solved'] and not item[name]['claimed'] for item in own)}"]
    reported = [item[name]["status"] for item in own if "status" in item[name]]
    parts += [f"{failure} {reported.count(failure)}" for failure in FAILURES if reported]
    for reference in ("QuantEcon", "QuantEcon, numba loop"):
        both = [item for item in own if item[name]["solved"] and item[reference]["solved"]]
        ratios = [item[name]["seconds"] / item[reference]["seconds"] for item in both]
        if ratios:
            parts += [f"{np.median(ratios):.2f} x {reference} ({len(ratios)})"]
    return ", ".join(parts)


if __name__ == "__main__":
    main()
