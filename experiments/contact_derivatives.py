"""Derivatives of contact displacements against central differences, over every family of random grasps.

    uv run python experiments/contact_derivatives.py [--problems 40]

The directional derivative of ``W f`` (all displacements) along a random direction in coupling, free displacement, gaps,
friction and contact frames together, exact (Lemke's final basis), against the central difference of the same function,
relative to the larger of the two. Problems with a contact margin below 1e-6, or whose slip states differ between the
two ends of the difference, are near a tie and left out; their number is printed. "path" is the derivative of
`InteriorPoint(1e-4)` (products of 1e-7 J) against differences of the path itself, where all three were found;
"distance" how far it is from the exact one; "single" how far the exact one is in single precision from itself in
double.
Written to experiments/results/contact_derivatives.json.
"""

import argparse
import json
from functools import partial
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.contact import FAMILIES, InteriorPoint, random_grasp, solve
from icjax.lcp import Lemke
from icjax.results import RESULTS

RESULT = Path(__file__).resolve().parent / "results" / "contact_derivatives.json"
CONTACTS, FACETS = 8, 4
STEP = 1e-6
"""Relative; truncation 1e-12, rounding 1e-10."""


def _parts(problem):
    return problem.coupling, problem.free_displacement, problem.gap, problem.friction, problem.frames


def _displacement(solver, problem, parts):
    moved = eqx.tree_at(_parts, problem, parts)
    solution = solve(moved, facets=FACETS, solver=solver)
    found = solution.value
    good = solution.result == RESULTS.solved
    return found.displacement - moved.free_displacement.reshape(-1, 3), (found, good)


@partial(jax.jit, static_argnums=0)
def compared(exact: bool, problem, direction):
    """Derivative, difference, and whether the problem is away from ties."""
    solver = Lemke() if exact else InteriorPoint(1e-4, unit=1e-3)
    parts = _parts(problem)
    run = partial(_displacement, solver, problem)
    _, slope, (found, good) = jax.jvp(run, (parts,), (direction,), has_aux=True)
    ends = [run(jax.tree.map(lambda x, d, s=s: x + s * STEP * d, parts, direction)) for s in (1, -1)]
    good = jnp.stack([good, *(good for _, (_, good) in ends)])
    same = jnp.stack([jnp.all(end.slip_state == found.slip_state) for _, (end, _) in ends])
    same = jnp.all(same) & jnp.all(good)
    # The path has no ties, but it may not be found.
    regular = (found.margin > 1e-6) & same if exact else jnp.all(good)
    return slope, (ends[0][0] - ends[1][0]) / (2 * STEP), regular


@jax.jit
def in_single(problem, direction):
    """The exact derivative in single precision."""
    problem, direction = jax.tree.map(lambda x: x if x.dtype == bool else x.astype(jnp.float32), (problem, direction))
    run = partial(_displacement, Lemke(), problem)
    return jax.jvp(run, (_parts(problem),), (direction,), has_aux=True)[1]


def directed(problem, rng):
    """A random direction of the size of the problem; symmetric in W, friction only where there is some."""
    d_W = rng.normal(size=problem.coupling.shape) * np.max(np.abs(problem.coupling))
    sizes = [np.max(np.abs(problem.free_displacement))] * 2
    d_free = rng.normal(size=problem.free_displacement.shape) * sizes[0]
    d_gap = rng.normal(size=problem.gap.shape) * sizes[1]
    d_friction = rng.normal(size=problem.friction.shape) * problem.friction
    turn = 0.1 * rng.normal(size=(problem.frames.shape[0], 3))
    d_frames = np.cross(turn[:, :, None], problem.frames, axis=1)
    return (d_W + d_W.T) / 2 * 0.01, d_free, d_gap, d_friction, d_frames


def main() -> None:
    """Compare, print, write."""
    parser = argparse.ArgumentParser(description="Contact derivatives against central differences")
    parser.add_argument("--problems", type=int, default=40, help="of each family")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    rng = np.random.default_rng(41)
    rows, every = [], []
    for family in FAMILIES:
        errors, path_errors, distances, single, regular = [], [], [], [], 0
        for seed in range(arguments.problems):
            problem = jax.tree.map(jnp.asarray, random_grasp(9000 + seed, CONTACTS, family))
            direction = jax.tree.map(jnp.asarray, directed(problem, rng))
            slope, difference, away = compared(True, problem, direction)
            smooth, smooth_difference, followed = compared(False, problem, direction)
            size = max(float(jnp.max(jnp.abs(slope))), float(jnp.max(jnp.abs(difference))), 1e-30)
            path_size = max(float(jnp.max(jnp.abs(smooth))), 1e-30)
            if followed:
                path_errors.append(float(jnp.max(jnp.abs(smooth - smooth_difference))) / path_size)
                distances.append(float(jnp.max(jnp.abs(smooth - slope))) / size)
            if away:
                regular += 1
                errors.append(float(jnp.max(jnp.abs(slope - difference))) / size)
                single.append(float(jnp.max(jnp.abs(in_single(problem, direction) - slope))) / size)
        row = {"family": family, "problems": arguments.problems, "away from ties": regular}
        if errors:
            row |= {"median": float(np.median(errors)), "99th percentile": float(np.quantile(errors, 0.99))}
            row |= {"single, median": float(np.median(single)), "single, 90th": float(np.quantile(single, 0.9))}
        row |= {"paths": len(path_errors), "path, median": float(np.median(path_errors))}
        row |= {"distance, median": float(np.median(distances))}
        rows.append(row)
        every.append((errors, single))
        print(", ".join(f"{k} {v:.2g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()), flush=True)
    errors, single = (np.concatenate(x) for x in zip(*every, strict=True))
    row = {"family": "all", "problems": arguments.problems * len(FAMILIES), "away from ties": len(errors)}
    row |= {"median": float(np.median(errors)), "99th percentile": float(np.quantile(errors, 0.99))}
    row |= {"single, median": float(np.median(single)), "single within 1e-3": int(np.sum(single < 1e-3))}
    rows.append(row)
    print(row)
    RESULT.write_text(json.dumps(rows, indent=1) + "\n")
    print(f"wrote {RESULT}")


if __name__ == "__main__":
    main()
