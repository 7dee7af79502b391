"""How the estimate of Kry and Pai (2006, section 3.3) depends on windows and degree, against the truth.

    python experiments/kry_pai_2006/sensitivity.py

On three simulated sessions (MuJoCo, independent of icjax; no person was measured): the pooled value over its truth for
every window and degree, the same with separate windows before and after contact, and whether the rule that calls an
event stable picks the better ones. The truth only judges. Writes sensitivity.json and sensitivity_SESSION.png.
"""

import dataclasses
import json
from pathlib import Path

import jax
import numpy as np
import tyro
from virtual_sessions import JOINTS, RESULTS, SIMULATED, rounded, trials_of, true_compliance, write

from icjax.estimation import EstimationOptions, Sensitivity, joint_torque, sensitivity
from icjax.view import plot_sensitivity
from icjax.view._style import style


@dataclasses.dataclass(frozen=True)
class Config:
    """Sessions and the grid."""

    sessions: tuple[str, ...] = ("explore", "scratch", "explore_cruise")
    windows: tuple[float, ...] = (0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1, 0.12, 0.14, 0.16)
    separate: tuple[float, ...] = (0.04, 0.07, 0.1)
    degrees: tuple[int, ...] = (1, 2)
    drawn: tuple[str, ...] = ("explore", "scratch")
    cache: Path | None = None
    """Folder that keeps the captured sessions."""
    out: Path = RESULTS


def main(config: Config) -> dict:
    """Capture, repeat the estimate, judge, draw."""
    jax.config.update("jax_enable_x64", True)
    options = EstimationOptions(joints=JOINTS)
    result: dict = {
        "data": SIMULATED,
        "measure": "pooled value / truth - 1; null where the pooled value is not positive",
        "degrees": list(config.degrees),
    }
    for name in config.sessions:
        trials, truth = trials_of(name, config.cache), true_compliance(name)
        torques = tuple(np.asarray(joint_torque(item)) for item in trials)
        found = sensitivity(trials, config.windows, config.degrees, options, torques)
        pairs = sensitivity(trials, config.separate, config.degrees, options, torques, separate=True)
        result[name] = {
            "windows s": list(config.windows),
            "pooled error, joint: [window][degree]": by_joint(found.pooled / truth[:, None, None] - 1.0),
            "pairs of windows s, before and after": np.asarray(pairs.window),
            "pooled error of the pairs, joint: [pair][degree]": by_joint(pairs.pooled / truth[:, None, None] - 1.0),
            "events": len(found.onset),
            "stable events": by_joint(np.asarray(found.stable).sum(axis=0)),
            "median size of the error of one event at 100 ms, quadratic": judge_rule(found, truth, config),
        }
        figure = plot_sensitivity(found, dict(zip(JOINTS, (float(value) for value in truth), strict=True)))
        figure.supxlabel(f"Session {name}. Data {SIMULATED}.", fontsize=7.5, color="#5B616B")
        if name in config.drawn:
            with style():
                figure.savefig(config.out / f"sensitivity_{name}.png", dpi=100)
    write(config.out / "sensitivity.json", result)
    return result


def judge_rule(found: Sensitivity, truth: np.ndarray, config: Config) -> dict:
    """Median of |estimate / truth - 1| of the stable events and of the others, and how many there are."""
    at = config.windows.index(0.1), config.degrees.index(2)
    error = np.abs(np.asarray(found.compliance)[:, :, at[0], at[1]] / truth - 1.0)
    table = {}
    for j, joint in enumerate(JOINTS):
        stable, known = np.asarray(found.stable)[:, j], np.isfinite(error[:, j])
        table[joint] = {
            word: {"events": int(np.sum(which & known)), "error": median(error[which & known, j])}
            for word, which in (("stable", stable), ("not stable", ~stable))
        }
    return table


def median(values: np.ndarray) -> float:
    """NaN for none."""
    return float(np.median(values)) if len(values) else np.nan


def by_joint(table: np.ndarray) -> dict:
    """First axis as names."""
    return dict(zip(JOINTS, table, strict=True))


if __name__ == "__main__":
    print(json.dumps(rounded(main(tyro.cli(Config))), indent=1))
