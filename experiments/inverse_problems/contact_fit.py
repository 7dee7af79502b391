"""Through contact: compliance of five fingers and friction from forces on a known box, judged on other objects.

    python experiments/inverse_problems/contact_fit.py [--cache DIR]

Fitted are the recordings of the box of `virtual_sessions/grasp5` alone (12, 60 and 120 g): film
sensors (normal force only) and joint angles, by whole rollouts ([`icjax.fit.ContactForces`]): compliance of 21 joints,
friction of finger and box, stiffness of five pads, deviation of the reference. Predicted are forces on the wider box,
the wedge and the sphere, with what was fitted and with the paper's estimate (from the first recording, as in
`kry_pai_2006/grasp5.py`, and pooled over the same four), and compared with the truth, which nothing else sees.

What anchors the reference: two trials lose the box (120 g, and a slippery one). From then on their hand moves as it
was meant to, while that of the others still presses: they stand for catch trials. Between touch and loss the reference
is free to deviate (see `Course`). Beforehand compliances are those of Table 1 of Kry and Pai within a factor of two.

The second study is of the model itself: another hand's compliances, forces and angles simulated by icjax with noise,
gain errors and angles as noisy as recorded ones; the same fit, the same prediction. Writes contact_fit.json and
contact_fit.png. NRMSE: RMS error over RMS truth, of the total normal force, of every finger, and pooled (all fingers'
errors over all fingers' forces).
"""

import dataclasses
import time
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import tyro
from contact_fit_errors import expected_sd
from contact_fit_problem import Course, Together, joints_of, measured, parameters
from contact_fit_simulated import simulated
from grasp5 import interaction_of, judged, scene_of, solids, true_interaction, with_forearm
from recovery import save
from virtual_sessions import SIMULATED, trials_of, truth_of

from icjax.estimation import estimate
from icjax.fit import Problem, solve
from icjax.inference import QUANTILE, jacobian, laplace
from icjax.interaction import Interaction
from icjax.recording import Recording, Session
from icjax.synthesis import transfer

BOXES = ("box12g", "box60g", "box120g", "slip60g")
"""Recordings of the box; the first is that of the paper's estimate."""

COMPARED = BOXES[:3]
"""Those whose forces are compared; the slippery one only shows the reference after the loss."""

OTHERS = ("wide12g", "wedge12g", "sphere12g")


@dataclasses.dataclass(frozen=True)
class Config:
    """`studies`: of the recorded session, of the model itself; `steps` of each stage at most; `spread` of log C of the
    simulated hand about typical values; `cache` keeps the captured session."""

    studies: tuple[str, ...] = ("recorded", "own")
    steps: int = 8
    spread: float = 0.4
    seed: int = 5
    cache: Path | None = None
    out: Path = Path(__file__).resolve().parents[1] / "results" / "inverse_problems"


def main(config: Config) -> dict[str, Any]:
    """Both studies, JSON and figure."""
    jax.config.update("jax_enable_x64", True)
    config.out.mkdir(parents=True, exist_ok=True)
    trials = {item.name: item for item in trials_of("grasp5", config.cache)}
    truths = {name: truth_of("grasp5", name) for name in trials}
    result: dict[str, Any] = {"data": SIMULATED, "fitted from": list(BOXES), "studies": {}}
    curves = {}
    for study in config.studies:
        print(study, flush=True)
        if study == "own":
            base = interaction_of(trials[BOXES[0]])
            trials, truths = simulated(trials, truths, base, config.spread, np.random.default_rng(config.seed))
        result["studies"][study], curves[study] = studied(trials, truths, config)
        save(config.out / "contact_fit.json", result)
    draw(curves, config.out / "contact_fit.png")
    return result


def studied(trials: dict[str, Recording], truths: dict[str, Any], config: Config) -> tuple[dict[str, Any], Any]:
    """Fit, intervals, predictions; figures and the forces to draw."""
    one = interaction_of(trials[BOXES[0]])
    pooled = estimate(Session("grasp5", "C", tuple(trials[name] for name in BOXES)))[0]
    pooled = dataclasses.replace(pooled, model=one.model)
    found, figures = fitted(one, trials, config)
    truth = truths[BOXES[0]]
    figures["compliance"] = against(figures.pop("sd of log C"), found, truth["C"], one, pooled)
    mu = figures["friction"]["fit"]
    figures["friction"]["truth"] = float(truth["mu"])
    runs = {"paper": (one, None), "paper, four boxes": (pooled, None), "fit": (found, mu)}
    runs["truth"] = (true_interaction(one, truth), None)
    figures["objects"], curves = {}, {}
    for name in OTHERS:
        figures["objects"][name], curves[name] = predicted(runs, trials[name], truths[name])
    return figures, curves


def fitted(start: Interaction, trials: dict[str, Recording], config: Config) -> tuple[Interaction, dict[str, Any]]:
    """Course, problem, solution and its intervals; the interaction with what was found."""
    course = Course(tuple(trials[name] for name in BOXES))
    data = Together.of(tuple(measured(trials[name], start.model, course, solids()[name]) for name in COMPARED))
    stated = parameters(start.model, course)
    problem = Problem(stated, (data,))
    first = eqx.tree_at(lambda item: item.measurements[0].trials.counts, problem, whole_first(data.trials.counts))
    begin = time.perf_counter()
    solution = solve(
        (first, problem), tolerance=1e-3, max_steps=config.steps, progress=lambda at: print(at, flush=True)
    )
    seconds, x = time.perf_counter() - begin, solution.value.x
    values = {key: np.asarray(value) for key, value in stated.values(x).items()}
    scale = np.concatenate([np.full(item.size, item.prior_sd) for item in stated.of])
    J = derivative(problem, x)
    known = laplace(J, jacobian(stated.prior, x), scale=jnp.asarray(scale))
    sd = expected_sd(problem, x, J, known, course)
    place = stated.slices
    compared = int(data.trials.counts.sum()) * (data.trials.force.shape[-1] + len(data.trials.dofs))
    reference = course.q + course.basis @ values["reference"]
    compliance = np.concatenate([np.zeros(3), values["compliance"]])
    found = dataclasses.replace(
        start,
        model=dataclasses.replace(start.model, pad_compliance=1.0 / values["pad stiffness"]),
        compliance=np.broadcast_to(compliance, np.shape(start.compliance)),
        reference=np.concatenate([np.asarray(start.q)[:, :3], reference], axis=1),
    )
    mu, mu_sd = float(values["friction of object"]), float(sd[place["friction of object"]][0])
    return found, {
        "numbers": stated.size,
        "residuals": compared,
        "mean square residual": float(2.0 * solution.value.cost / compared),
        "steps": solution.stats["steps"],
        "seconds, compilation included": round(seconds),
        "unsolved steps": np.asarray(data.unsolved(stated.values(x))),
        "sd of log C": sd[place["compliance"]],
        "over that of the weights": np.median(sd[place["compliance"]] / np.asarray(known.sd)[place["compliance"]]),
        "friction": {"fit": mu, "95 %": mu * np.exp(np.array([-1.0, 1.0]) * QUANTILE * mu_sd)},
        "pads N/m": values["pad stiffness"],
    }


def whole_first(counts: Any) -> Any:
    """The first, lightest trial whole, of the others what the last counts: the squeeze. Hands that are too soft at the
    start lose the heavier boxes, and what follows the loss has no derivative that leads back."""
    return counts & counts[-1:] | (jnp.arange(counts.shape[0]) == 0)[:, None]


@eqx.filter_jit
def derivative(problem: Problem, x: Any) -> Any:
    """Of the residuals of the data; compiled once for both studies."""
    return jacobian(problem.data, x)


def against(sd: Any, found: Interaction, truth: Any, one: Interaction, pooled: Interaction) -> dict[str, Any]:
    """Compliance of every joint with its interval, the paper's and the true one."""
    names = joints_of(found.model)
    fit, paper, four = (np.asarray(item.compliance)[0, 3:] for item in (found, one, pooled))
    ends = fit[:, None] * np.exp(np.array([-1.0, 1.0]) * QUANTILE * sd[:, None])
    within = (ends[:, 0] <= truth) & (truth <= ends[:, 1])
    for row in zip(names, fit, *ends.T, truth, paper, strict=True):
        print("{:12s} {:.3f} [{:.3f}, {:.3f}] truth {:.3f}, paper {:.3f}".format(*row))
    error = np.abs(np.log(fit / truth))
    print(f"{within.sum()} of {within.size} intervals hold the truth; median error {100 * np.median(error):.0f} %")
    return {
        "joints": names,
        "fit rad/Nm": fit,
        "95 %": ends,
        "truth": truth,
        "paper": paper,
        "paper, four boxes": four,
        "intervals that hold the truth": int(within.sum()),
        "median of |log(fit / truth)|": float(np.median(error)),
        "ends of the intervals, median ratio": float(np.median(ends[:, 1] / ends[:, 0])),
    }


def predicted(runs: dict[str, Any], recording: Recording, truth: dict[str, Any]) -> tuple[dict[str, Any], Any]:
    """Figures of every way on another object, ratios to the fit, and the forces."""
    figures, forces = {}, {}
    for kind, (interaction, mu) in runs.items():
        stated = recording if mu is None else dataclasses.replace(recording, friction=mu)
        scene = scene_of(stated, solids()[recording.name])
        numbers, force = judged(transfer(with_forearm(interaction, recording), scene), truth)
        kept = ("total NRMSE", "finger NRMSE", "rise mm", "rise mm, truth", "unsolved steps")
        figures[kind] = {key: numbers[key] for key in kept}
        off = np.sum((force - truth["f_normal"]) ** 2) / np.sum(truth["f_normal"] ** 2)
        figures[kind]["pooled NRMSE"] = float(np.sqrt(off))
        forces[kind] = force
    for kind in ("paper", "paper, four boxes"):
        for which in ("total", "pooled"):
            ratio = figures[kind][f"{which} NRMSE"] / figures["fit"][f"{which} NRMSE"]
            figures[kind][f"{which} over that of the fit"] = ratio
    print(recording.name)
    for kind, numbers in figures.items():
        fingers = " ".join(f"{100 * value:.0f}" for value in numbers["finger NRMSE"])
        over = "".join(f", {numbers[key]:.2f} of the fit's {key[:6]}" for key in numbers if key.endswith("the fit"))
        print(f"  {kind:18s} total {100 * numbers['total NRMSE']:.1f} %, pooled {100 * numbers['pooled NRMSE']:.1f} %"
              f", fingers {fingers} %{over}", flush=True)  # fmt: skip
    return figures, (truth, forces)


def draw(curves: dict[str, Any], path: Path) -> None:
    """A row a study, a panel an object: thumb above, the four fingers together below."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(
        len(curves),
        len(OTHERS),
        figsize=(10, 2.7 * len(curves) + 0.4),
        squeeze=False,
        sharex=True,
        layout="constrained",
    )
    colours = {"paper": "#D55E00", "fit": "#009E73"}
    for row, (study, objects) in zip(axes, curves.items(), strict=True):
        for axis, (name, (truth, forces)) in zip(row, objects.items(), strict=True):
            seconds = truth["t"] - truth["t"][0]
            for part in (slice(0, 1), slice(1, 5)):
                axis.plot(seconds, truth["f_normal"][:, part].sum(axis=1), color="#1F2430", linewidth=2.6, alpha=0.35)
                for kind, colour in colours.items():
                    axis.plot(seconds, forces[kind][:, part].sum(axis=1), color=colour, linewidth=1.0)
            axis.set_title(f"{name}, {study}", loc="left", fontsize=9, fontweight="bold")
            axis.set_xlim(0.7, seconds[-1])
            axis.spines[["top", "right"]].set_visible(False)
        row[0].set_ylabel("normal force, N")
    for axis in axes[-1]:
        axis.set_xlabel("time, s")
    handles = [pyplot.Line2D([], [], color="#1F2430", linewidth=2.6, alpha=0.35, label="truth")]
    names = {"paper": "the paper's estimate", "fit": "fit by rollouts on the box"}
    handles += [pyplot.Line2D([], [], color=colours[kind], label=names[kind]) for kind in colours]
    axes[0, 0].legend(handles=handles, frameon=False, fontsize=8)
    note = "Thumb, and the four fingers together. Recorded: MuJoCo subject C; own: icjax with noise. No person."
    figure.supxlabel(note, fontsize=7.5, color="#5B616B")
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


if __name__ == "__main__":
    main(tyro.cli(Config))
