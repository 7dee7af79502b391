"""Fits of the simulated sessions with two, one and no catch trial a trial, beside the paper's estimator.

    python experiments/inverse_problems/session_fits.py

One method and one set of defaults. Errors of compliance, whether intervals hold the truth, and the error of the
reference trajectory during contact (to 100 ms) after one constant offset a joint and session is taken away: that of
the angles, which marker placement leaves. The time of a fit includes compilation. Writes session_fits.json and
session_fits.png.
"""

import dataclasses
import os
import sys
import time
from pathlib import Path
from typing import Any

import jax
import matplotlib
import numpy as np
import tyro

from icjax.capture import capture, read_session
from icjax.estimation import estimates
from icjax.fit import SessionFit, contact_free, fit_session
from icjax.recording import Session

matplotlib.use("Agg")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "kry_pai_2006"))
from virtual_sessions import JOINTS, ROOT, SIMULATED, rounded, shared_data, true_compliance, truth_of, write


@dataclasses.dataclass(frozen=True)
class Config:
    """`sessions` of virtual_sessions that have catch trials; `cache` a folder with captured sessions NAME.nc."""

    sessions: tuple[str, ...] = ("explore", "scratch")
    catches: tuple[int, ...] = (2, 1, 0)
    cache: Path | None = None
    out: Path = Path(__file__).resolve().parents[1] / "results" / "inverse_problems"


def main(config: Config) -> dict[str, Any]:
    """Capture, fit, judge, draw, write."""
    jax.config.update("jax_enable_x64", True)
    result: dict[str, Any] = {"data": SIMULATED, "sessions": {}}
    for name in config.sessions:
        session = captured(name, config.cache)
        truth = true_compliance(name)
        paper = next(estimates(session, wanted=(session.trials()[0].name,))).summary
        rows: dict[str, Any] = {"truth": dict(zip(JOINTS, truth.tolist(), strict=True))}
        rows["the paper"] = judged_paper(paper, truth)
        for count in config.catches:
            begin = time.perf_counter()
            fit = fit_session(with_catches(session, count))
            rows[f"{count} catch trials"] = judged(fit, name, truth) | {"seconds": time.perf_counter() - begin}
        result["sessions"][name] = rows
        for kind, row in rows.items():
            print(name, kind, rounded(row), flush=True)
    write(config.out / "session_fits.json", result)
    draw(result, config.out / "session_fits.png")
    return result


def captured(name: str, cache: Path | None) -> Session:
    """The whole session, catch trials too."""
    if cache is not None and (cache / f"{name}.nc").exists():
        return Session.load(cache / f"{name}.nc")
    os.environ["ICJAX_SHARED_DATA"] = str(shared_data())
    session = capture(read_session(ROOT / "experiments" / "sessions" / f"virtual_{name}.toml"))
    if cache is not None:
        session.save(cache / f"{name}.nc")
    return session


def with_catches(session: Session, count: int) -> Session:
    """The session with the first `count` catch trials of every trial."""
    kept = [recording for trial in session.trials() for recording in (trial, *session.catch_trials(trial.name)[:count])]
    return dataclasses.replace(session, recordings=tuple(kept))


def judged_paper(paper, truth: np.ndarray) -> dict[str, Any]:
    """Errors of the paper's estimate, in percent, and whether its interval holds the truth."""
    place = [paper.joint_names.index(joint) for joint in JOINTS]
    value, lower, upper = (np.asarray(item)[place] for item in (paper.compliance, paper.lower, paper.upper))
    return {
        "compliance": value,
        "error %": 100 * (value / truth - 1),
        "lower": lower,
        "upper": upper,
        "holds": (lower <= truth) & (truth <= upper),
    }


def judged(fit: SessionFit, name: str, truth: np.ndarray) -> dict[str, Any]:
    """Errors in percent, intervals, refusals, and degrees of the reference."""
    value, lower, upper = (np.array([getattr(j, key) for j in fit.joints]) for key in ("compliance", "lower", "upper"))
    z = np.log(value / truth) / (np.log(upper / np.maximum(lower, 1e-12)) / (2 * 1.96))
    return {
        "compliance": value,
        "error %": 100 * (value / truth - 1),
        "lower": lower,
        "upper": upper,
        "holds": (lower <= truth) & (truth <= upper),
        "error over sd of log C": z,
        "refused": [bool(j.refused) for j in fit.joints],
        "reference, degrees RMS": np.degrees(reference_error(fit, name)),
        "contacts": len(fit.made.windows),
        "chi2": fit.chi2,
        "steps": fit.solution.stats["steps"],
        "warnings": list(fit.warnings),
    }


def reference_error(fit: SessionFit, name: str) -> np.ndarray:
    """RMS error of the reference after first touch, the constant offset of the angles taken away, rad a joint."""
    reference = contact_free(fit)
    error, offset = [], []
    for number, window in enumerate(fit.made.windows):
        motion, count = fit.made.motions[window.trial], len(window.samples)
        true = truth_of(name, window.trial)
        when = np.asarray(motion.recording.time)[window.samples]
        free, moved = (
            np.stack([np.interp(when, true["t"], column) for column in true[key].T], axis=1)
            for key in ("theta_free", "theta")
        )
        offset.append(motion.angle[window.samples] - moved)
        error.append((reference.angle[number, :count] - free)[window.samples >= window.onset])
    return np.sqrt(np.mean((np.concatenate(error) - np.concatenate(offset).mean(axis=0)) ** 2, axis=0))


def draw(result: dict[str, Any], path: Path) -> None:
    """Intervals over truth, a panel a session."""
    from matplotlib import pyplot

    sessions = result["sessions"]
    figure, panels = pyplot.subplots(1, len(sessions), figsize=(4.6 * len(sessions), 3.4), sharey=True, squeeze=False)
    for panel, (name, rows) in zip(panels[0], sessions.items(), strict=True):
        truth = np.array(list(rows["truth"].values()))
        kinds = [kind for kind in rows if kind != "truth"]
        for number, kind in enumerate(kinds):
            row = rows[kind]
            at = np.arange(len(JOINTS)) + 0.17 * (number - (len(kinds) - 1) / 2)
            with np.errstate(invalid="ignore"):
                value, lower, upper = (np.asarray(row[key], float) / truth for key in ("compliance", "lower", "upper"))
            lower, upper = np.clip(lower, 0.02, None), np.clip(upper, None, 50.0)
            color = f"C{number}" if kind != "the paper" else "0.6"
            panel.vlines(at, lower, upper, color=color, lw=2, label=kind)
            kept = ~np.asarray(row.get("refused", np.zeros(len(JOINTS), bool)))
            panel.plot(at[kept], value[kept], "o", color=color, ms=4)
        panel.axhline(1.0, color="0.3", lw=0.8)
        panel.set(yscale="log", title=name, ylim=(0.08, 12), xticks=range(len(JOINTS)), xticklabels=JOINTS)
    panels[0, 0].set_ylabel("compliance over truth, 95 % interval")
    panels[0, -1].legend(frameon=False, fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=130)
    pyplot.close(figure)


if __name__ == "__main__":
    main(tyro.cli(Config))
