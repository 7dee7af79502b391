"""Are compliance, reference and friction found again? Noise-free data of the same model, many random starts.

    python experiments/inverse_problems/recovery.py

The planar index finger taps and strokes two plates of different height and friction with one intended movement:
theta_r is one cubic spline for both. Sought are C (diagonal, then full), theta_r, and the friction of each plate, from
(a) angles and torques in static equilibrium, (c) angles and contact forces of a rollout. A start is found again where C
and friction are right to 1e-6 (relative; entries of the full C relative to sqrt(C_ii C_jj)) and theta_r to 1e-8 rad.
Rollouts that end with a residual, which is zero at the truth, are tried again by a schedule (recovery_solver.py);
"recovered" counts after each stage.

The ill-posed case: a reference that is free in every sample explains any C, which `laplace` must say. Data and model
are the same here, so this judges the inverse problem and the solver, not the model. Writes recovery.json and
recovery.png.
"""

import dataclasses
import json
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from recovery_problem import ANGLE_SD, FORCE_SD, PLATES, Case, Truth
from recovery_solver import Minimiser, recovered

from icjax.fit import Parameter, Parameters, Problem, multi_start
from icjax.inference import jacobian, laplace

BOUNDS = np.array([1e-6, 1e-6, 1e-8])
"""Of C and friction, relative; of theta_r, rad."""


@dataclasses.dataclass(frozen=True)
class Config:
    """`starts` of every problem, within `factor` of C and friction; `spread` rad of the spline's coefficients;
    `restarts` from other starts where the schedule ends with a residual; `cases` of the two kinds, static and rollout,
    with a diagonal or full compliance; `blind` the ill-posed case."""

    starts: int = 100
    factor: float = 5.0
    spread: float = 0.05
    restarts: int = 3
    seed: int = 2006
    batch: int = 20
    cases: tuple[str, ...] = ("static diagonal", "static full", "rollout diagonal", "rollout full")
    blind: bool = True
    out: Path = Path(__file__).resolve().parents[1] / "results" / "inverse_problems"


def main(config: Config) -> dict[str, Any]:
    """All cases, the ill-posed one, JSON and figure."""
    jax.config.update("jax_enable_x64", True)
    config.out.mkdir(parents=True, exist_ok=True)
    result: dict[str, Any] = {
        "data": "noise-free, of the same model",
        "starts": config.starts,
        "factor of C and friction": config.factor,
        "spread of the spline's coefficients rad": config.spread,
        "bounds of C, friction (relative), theta_r (rad)": BOUNDS.tolist(),
        "sd of forces N, angles rad": [FORCE_SD, ANGLE_SD],
        "cases": {},
    }
    drawn: dict[str, Any] = {}
    for number, name in enumerate(config.cases):
        kind, form = name.split(" ")
        truth = Truth(Case(full=form == "full"))
        print(name, flush=True)
        result["cases"][name], drawn[name] = study(truth, kind, config, np.random.default_rng(config.seed + number))
        save(config.out / "recovery.json", result)
    if config.blind:
        result["ill-posed"] = ill_posed(Truth(Case()))
        save(config.out / "recovery.json", result)
    draw(drawn, config.out / "recovery.png")
    return result


def study(truth: Truth, kind: str, config: Config, rng: np.random.Generator) -> tuple[dict[str, Any], Any]:
    """One case: figures, and errors before and after."""
    problem = truth.problem(kind)
    parameters = problem.parameters

    def errors(x):
        return truth.errors(parameters, x)

    def good(x):
        return bool(np.all(errors(x) < BOUNDS))

    def take(count):
        return truth.starts(parameters, count, rng, config.factor, config.spread)

    if kind == "static":
        starts = take(config.starts)
        found = multi_start(problem, starts, tolerance=1e-12, max_steps=200)
        ended = np.asarray(found.value.x)
        told = {"direct": int(sum(good(x) for x in ended))}
        print(f"  direct: {told['direct']} of {config.starts}", flush=True)
    else:
        told, starts, ended = recovered(Minimiser(problem, config.batch), take, good, config.starts, config.restarts)
    before, after = (np.array([errors(x) for x in rows]) for rows in (starts, ended))
    right = np.all(after < BOUNDS, axis=1)
    J = np.asarray(jax.jit(lambda x: jacobian(problem.data, x))(parameters.start))
    singular = np.linalg.svd(J, compute_uv=False)
    sd = laplace(J, np.zeros((0, parameters.size))).sd
    place = parameters.slices
    figures = {
        "numbers": parameters.size,
        "residuals": J.shape[0],
        "condition": singular[0] / singular[-1],
        "slipping steps": truth.slipping,
        "recovered": told,
        "largest errors of those recovered: C, friction, theta_r": after[right].max(axis=0, initial=0.0),
        "median errors of the others": np.median(after[~right], axis=0) if (~right).any() else None,
        "sd of x with noise, C": sd[place["compliance"]],
        "sd of x with noise, friction": [float(sd[place[name]][0]) for name in place if name.startswith("friction")],
        "sd of x with noise, reference rad": float(np.max(sd[place["reference"]])),
    }
    return figures, (before, after)


def ill_posed(truth: Truth) -> dict[str, Any]:
    """Standard deviations of log C where theta_r is shared, where each trial has its own, and where it is free."""
    free = np.eye(truth.case.steps)
    C = truth.parameters(False)["compliance"]
    own = {f"reference of {name}": Parameter(f"reference of {name}", truth.reference) for name in PLATES}
    every = Parameter("reference", truth.basis @ truth.reference)
    first = next(iter(PLATES))
    info = truth.info[first]
    alone = truth.trial(first, np.asarray(info.contact_force), basis=free, angles=np.asarray(info.q))
    friction = truth.parameters(True)[f"friction of {first}"]
    problems = {
        "static, a spline shared by both plates": truth.problem("static"),
        "static, a spline of each plate": Problem(Parameters((C, *own.values())), truth.statics(shared=False)),
        "static, one plate, reference free in every sample": Problem(
            Parameters((C, every)), truth.statics(basis=free)[:1]
        ),
        "rollout, normal forces only, a spline shared by both plates": Truth(Case(normal=True)).problem("rollout"),
        "rollout, one plate, reference free in every sample": Problem(Parameters((C, every, friction)), (alone,)),
    }
    found = {}
    for name, problem in problems.items():
        x = problem.parameters.start
        J = jax.jit(lambda x, problem=problem: jacobian(problem.data, x))(x)
        known = laplace(J, jnp.zeros((0, x.size)))
        sd = np.asarray(known.sd[problem.parameters.slices["compliance"]])
        found[name] = {"sd of log C": [float(v) if np.isfinite(v) else "infinite" for v in sd]}
        found[name]["blind directions"] = known.blind.shape[1]
        print(f"{name}: sd of log C {sd}, {known.blind.shape[1]} blind directions", flush=True)
    return found


def save(path: Path, result: dict[str, Any]) -> None:
    """Three significant digits."""
    path.write_text(json.dumps(rounded(result), indent=1) + "\n")


def rounded(value: Any) -> Any:
    """Floats to three significant digits, arrays as lists, null for no number."""
    if isinstance(value, dict):
        return {str(key): rounded(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return rounded(value.tolist())
    if isinstance(value, list | tuple):
        return [rounded(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(f"{value:.3g}") if np.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


def draw(drawn: dict[str, Any], path: Path) -> None:
    """A panel a case: error of C at the start and at the end of every start."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    count = max(len(drawn), 1)
    figure, axes = pyplot.subplots(1, count, figsize=(max(2.8 * count, 6.0), 3.2), sharey=True, layout="constrained")
    for axis, (name, (before, after)) in zip(np.atleast_1d(axes), drawn.items(), strict=False):
        right = np.all(after < BOUNDS, axis=1)
        for chosen, colour in ((right, "#009E73"), (~right, "#D55E00")):
            axis.loglog(before[chosen, 0], np.maximum(after[chosen, 0], 1e-17), ".", color=colour, markersize=4)
        axis.axhline(BOUNDS[0], color="#5B616B", linewidth=0.8)
        axis.set_title(f"{name}: {right.sum()} of {len(right)}", loc="left", fontsize=9, fontweight="bold")
        axis.set_xlabel("error of C at the start")
        axis.xaxis.set_minor_formatter("")
        axis.spines[["top", "right"]].set_visible(False)
    np.atleast_1d(axes)[0].set_ylabel("error of C at the end")
    figure.supxlabel("Noise-free data of the same model; the line is the bound of 1e-6.", fontsize=7.5, color="#5B616B")
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


if __name__ == "__main__":
    main(tyro.cli(Config))
