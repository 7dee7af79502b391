"""How often 95 % intervals of a session's fit hold the truth, over many subjects of the virtual laboratory.

    python experiments/inverse_problems/coverage.py --sessions 400 --workers 2

Every session has another subject: compliances, damping and the masses that the model is told are drawn from wider
distributions than the priors of the fit (log C uniform within a factor of 14 about 0.5 rad/Nm, standard deviation 1.52
where the prior has 1.5; damping times within a factor of 4.2, 0.83 where that of a joint has 0.81; masses log-normal,
0.6 for 0.5). A subject who cannot reach the plate is drawn again. The session is recorded (MuJoCo, other physics than
the fit), captured and fitted with its catch trials and without them, all with the defaults. Only joints that are not
refused count; the refusal looks at the width of the interval alone. Every session is a line of coverage.jsonl, and a
run goes on where the last one ended; coverage.json and coverage.png tell what all lines together say.
"""

import contextlib
import dataclasses
import json
import multiprocessing
import os
import tempfile
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
import tyro
from scipy.stats import beta, norm

from icjax.capture import capture, read_session
from icjax.fit import SessionFit, fit_session
from icjax.inference import QUANTILE
from icjax.laboratory import record
from icjax.recording import Session

JOINTS = ("wrist", "MP", "PIP", "DIP")
TYPICAL = 0.5
TRIES = 100

NO_END = 1e9
"""rad/Nm, and one over it: stand for the end that an interval has not."""

DRAWN = ("trials", "contacts", "catch", "factor", "damping_factor", "mass_sd")
LEVELS = (0.5, 0.68, 0.8, 0.9, 0.95, 0.99)


@dataclasses.dataclass(frozen=True)
class Config:
    """`sessions` in all, from seed `first` on; `trials` of each with `contacts` and `catch` catch trials."""

    sessions: int = 400
    first: int = 1000
    trials: int = 3
    contacts: int = 2
    catch: int = 2
    factor: float = 14.0
    damping_factor: float = 4.2
    mass_sd: float = 0.6
    workers: int = 1
    out: Path = Path(__file__).resolve().parents[1] / "results" / "inverse_problems"


def main(config: Config) -> dict[str, Any]:
    """Fit what is missing, then sum up and draw."""
    path = config.out / "coverage.jsonl"
    config.out.mkdir(parents=True, exist_ok=True)
    done = {row["seed"] for row in read(path)}
    missing = [(config, seed) for seed in range(config.first, config.first + config.sessions) if seed not in done]
    with contextlib.ExitStack() as stack:
        results = map(one, missing)
        if config.workers > 1:
            os.environ |= dict.fromkeys(("NPROC", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")  # of a worker
            pool = stack.enter_context(multiprocessing.get_context("spawn").Pool(config.workers))
            results = pool.imap_unordered(one, missing)
        file = stack.enter_context(path.open("a"))
        for number, row in enumerate(results):
            file.write(json.dumps(row) + "\n")
            file.flush()
            print(f"{number + 1} of {len(missing)}: seed {row['seed']}, {row['with catch trials']['told']}", flush=True)
    rows = sorted(read(path), key=lambda row: row["seed"])
    stated = {key: value for key, value in dataclasses.asdict(config).items() if key in DRAWN}
    result = {"config": stated, "sessions": len(rows)}
    for kind in ("with catch trials", "without catch trials"):
        result[kind] = summary([row for row in rows if "joints" in row[kind]], kind)
        result[kind]["failed"] = [row[kind]["told"] for row in rows if "joints" not in row[kind]]
    (config.out / "coverage.json").write_text(json.dumps(result, indent=1) + "\n")
    draw(rows, config.out / "coverage.png")
    for kind in ("with catch trials", "without catch trials"):
        for joint, item in result[kind]["joints"].items():
            print(f"{kind}, {joint}: {item['held']} of {item['counted']} held, {item['refused']} refused; {item}")
    return result


def read(path: Path) -> list[dict[str, Any]]:
    """Lines written so far."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []


def one(task: tuple[Config, int]) -> dict[str, Any]:
    """Record, capture and fit the session of a seed."""
    config, seed = task
    jax.config.update("jax_enable_x64", True)
    generator = np.random.default_rng([seed, 7])
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(TRIES):
            C = TYPICAL * np.exp(np.log(config.factor) * generator.uniform(-1.0, 1.0, 4))
            damping = 0.03 * float(np.exp(np.log(config.damping_factor) * generator.uniform(-1.0, 1.0)))
            try:
                paths = record(
                    folder,
                    seed=seed,
                    trials=config.trials,
                    contacts=config.contacts,
                    catch=config.catch,
                    compliance=(float(C[0]), float(C[1]), float(C[2]), float(C[3])),
                    damping_time=damping,
                )
            except ValueError as error:
                if "cannot reach" not in str(error):
                    raise
                continue
            break
        else:
            raise RuntimeError(f"seed {seed}: no subject of {TRIES} reaches the plate")
        session = capture(read_session(paths.session))
    session = told_other_masses(session, config.mass_sd, generator)
    alone = dataclasses.replace(session, recordings=session.trials())
    return {
        "seed": seed,
        "truth": C.tolist(),
        "damping time": damping,
        "with catch trials": fitted(session),
        "without catch trials": fitted(alone),
    }


def told_other_masses(session: Session, sd: float, generator: np.random.Generator) -> Session:
    """The session with every body's mass and inertia multiplied by a factor of its own."""
    factor = np.exp(sd * generator.standard_normal(len(session.recordings[0].model.body_names)))
    recordings = []
    for item in session.recordings:
        masses = factor * np.asarray(item.model.body_mass)
        inertias = factor[:, None, None] * np.asarray(item.model.body_inertia)
        model = eqx.tree_at(lambda m: (m.body_mass, m.body_inertia), item.model, (masses, inertias))
        recordings.append(dataclasses.replace(item, model=model))
    return dataclasses.replace(session, recordings=tuple(recordings))


def fitted(session: Session) -> dict[str, Any]:
    """Numbers of a fit, or why there is none."""
    try:
        fit: SessionFit = fit_session(session)
    except ValueError as error:
        return {"told": f"no fit: {error}"}
    joints = [
        {
            "log C": [float(np.log(np.clip(end, 1.0 / NO_END, NO_END))) for end in (j.lower, j.compliance, j.upper)],
            "refused": bool(j.refused),
        }
        for j in fit.joints
    ]
    told = f"{fit.solution.stats['steps']} steps, chi2 {fit.chi2:.2f}, {sum(j['refused'] for j in joints)} refused"
    return {"joints": joints, "contacts": len(fit.made.windows), "told": told}


def summary(rows: list[dict[str, Any]], kind: str) -> dict[str, Any]:
    """Of each joint: how many intervals hold the truth, how wide they are, and how large the errors."""
    table: dict[str, Any] = {"joints": {}}
    every: list[float] = []
    for number, joint in enumerate(JOINTS):
        z, error, sd, refused, bounded = [], [], [], 0, 0
        for row in rows:
            item = row[kind]["joints"][number]
            if item["refused"]:
                refused += 1
                lower, _, upper = item["log C"]
                bounded += bool(lower <= np.log(row["truth"][number]) <= upper)
                continue
            error.append(item["log C"][1] - np.log(row["truth"][number]))
            sd.append(deviation(item["log C"], error[-1]))
            z.append(error[-1] / sd[-1])
        every += z
        table["joints"][joint] = {
            **held(z), "refused": refused, "bounds of these that hold": bounded, **sizes(error, sd),
        }  # fmt: skip
    table["all joints"] = held(every)
    table["levels"] = {str(level): share(every, level) for level in LEVELS}
    return table


def deviation(ends: list[float], error: float) -> float:
    """Standard deviation of log C on the side where the truth lies: the interval's half there over 1.96."""
    lower, value, upper = ends
    return ((value - lower) if error > 0 else (upper - value)) / QUANTILE


def held(z: list[float]) -> dict[str, Any]:
    """Coverage of 95 % intervals with its own 95 % interval (Clopper and Pearson 1934)."""
    count, good = len(z), int(np.sum(np.abs(z) <= QUANTILE))
    low = float(beta.ppf(0.025, good, count - good + 1)) if good else 0.0
    high = float(beta.ppf(0.975, good + 1, count - good)) if good < count else 1.0
    return {"counted": count, "held": good, "share": round(good / max(count, 1), 4),
            "interval": [round(low, 4), round(high, 4)]}  # fmt: skip


def share(z: list[float], level: float) -> float:
    """Of intervals of a level that hold the truth."""
    return round(float(np.mean(np.abs(z) <= norm.ppf(0.5 + level / 2))), 4) if z else float("nan")


def sizes(error: list[float], sd: list[float]) -> dict[str, Any]:
    """Median relative error and standard deviation of log C."""
    if not error:
        return {}
    return {
        "median error %": round(100 * float(np.median(np.abs(np.expm1(error)))), 1),
        "mean log error": round(float(np.mean(error)), 3),
        "median sd": round(float(np.median(sd)), 3),
    }


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Share of intervals that hold the truth over their level, and errors over standard deviations."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 3, figsize=(11, 3.4), constrained_layout=True)
    levels = np.linspace(0.02, 0.99, 60)
    panels[0].plot([0, 1], [0, 1], color="0.7", lw=1)
    for kind, color, panel in (
        ("with catch trials", "#2166ac", panels[1]),
        ("without catch trials", "#b2182b", panels[2]),
    ):
        z, sd, error = [], [], []
        for row in rows:
            for number, item in enumerate(row[kind].get("joints", ())):
                if not item["refused"]:
                    error.append(item["log C"][1] - np.log(row["truth"][number]))
                    sd.append(deviation(item["log C"], error[-1]))
                    z.append(error[-1] / sd[-1])
        if not z:
            continue
        panels[0].plot(levels, [share(z, level) for level in levels], color=color, label=f"{kind}, {len(z)} intervals")
        panel.plot(sd, error, ".", color=color, ms=3)
        reach = np.array([0.0, max(sd)])
        for sign in (-1, 1):
            panel.plot(reach, sign * QUANTILE * reach, color="0.4", lw=0.8)
        panel.set(xlabel="stated standard deviation of log C", ylabel="error of log C", title=kind)
    panels[0].set(xlabel="level of the interval", ylabel="share that holds the truth")
    panels[0].legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=130)
    pyplot.close(figure)


if __name__ == "__main__":
    main(tyro.cli(Config))
