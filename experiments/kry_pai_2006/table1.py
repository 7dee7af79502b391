"""Table 1 of Kry and Pai (2006): joint compliance while exploring and while scratching a surface.

    python experiments/kry_pai_2006/table1.py

The paper measured people; the sessions here are simulated (MuJoCo, independent of icjax), of two virtual subjects whose
true compliance is known, so our columns are to be compared with their own truth and not with the paper's numbers. What
the paper's table shows, and what is asked of the data here, is that the task changes the compliance (by about a factor
of two) and that some joints only have an upper bound. The interval of the ratio scratching / exploring is Fieller's
(1954); it has no end on the side where exploring might be zero. Writes table1.json and table1.png.
"""

import dataclasses
from pathlib import Path

import jax
import numpy as np
import tyro
from virtual_sessions import JOINTS, RESULTS, SIMULATED, trials_of, true_compliance, write

from icjax.estimation import EstimationOptions, compliance_at_contact, joint_torque, pool, summarise
from icjax.interaction import STATUS, CompliancePerEvent

TASKS = {"exploring": "explore", "scratching": "scratch"}
PAPER = {
    "exploring": {"wrist": "0.3488", "MP": "0.9882", "PIP": "0.6715", "DIP": "2.0052"},
    "scratching": {"wrist": "0.1531", "MP": "0.4788", "PIP": "< 0.8426", "DIP": "< 0.8432"},
}


@dataclasses.dataclass(frozen=True)
class Config:
    """The estimator's choices; the program's defaults."""

    window: float = 0.1
    degree: int = 2
    cache: Path | None = None
    """Folder that keeps the captured sessions."""
    out: Path = RESULTS


def main(config: Config) -> dict:
    """Capture, estimate, compare, draw."""
    jax.config.update("jax_enable_x64", True)
    options = EstimationOptions(
        window_before=config.window, window_after=config.window, degree=config.degree, joints=JOINTS
    )
    events, truth = {}, {}
    for task, name in TASKS.items():
        trials = trials_of(name, config.cache)
        torques = tuple(np.asarray(joint_torque(item)) for item in trials)
        events[task] = compliance_at_contact(trials, options, torques)
        truth[task] = true_compliance(name)
    result = {
        "data": f"{SIMULATED}; the paper's column is of people and not comparable in value",
        "windows s, degree": [config.window, config.degree],
        **{task: {joint: column(events[task], j, PAPER[task][joint], truth[task][j]) for j, joint in enumerate(JOINTS)}
           for task in TASKS},
        "scratching / exploring": {
            joint: {
                "paper": paper_ratio(joint),
                "ours": ratio(events["scratching"], events["exploring"], j),
                "truth": truth["scratching"][j] / truth["exploring"][j],
            }
            for j, joint in enumerate(JOINTS)
        },
    }  # fmt: skip
    write(config.out / "table1.json", result)
    draw(config.out / "table1.png", result)
    return result


def column(per_event: CompliancePerEvent, j: int, paper: str, truth: float) -> dict:
    """One joint and task: the paper's entry, ours as the paper prints it, interval, counts, truth."""
    summary = summarise(per_event)
    value, lower, upper = (float(item[j]) for item in (summary.compliance, summary.lower, summary.upper))
    if lower > 0:
        entry = f"{value:.4f}"
    else:
        entry = f"< {upper:.4f}" if np.isfinite(upper) else "not estimated"
    status = np.asarray(per_event.status)[:, j]
    return {
        "paper": paper,
        "ours": entry,
        "value": value,
        "95 % interval": [lower, upper],
        "truth": float(truth),
        "error": value / truth - 1.0,
        "interval holds the truth": bool(lower <= truth <= upper),
        "events": {word: int(np.sum(status == code)) for code, word in enumerate(STATUS)},
    }


def paper_ratio(joint: str) -> float | str:
    """Of the paper's two entries; a bound stays one."""
    scratching = PAPER["scratching"][joint]
    value = float(scratching.removeprefix("< ")) / float(PAPER["exploring"][joint])
    return f"< {value:.2f}" if scratching.startswith("<") else value


def ratio(above: CompliancePerEvent, below: CompliancePerEvent, j: int) -> dict:
    """Pooled scratching over pooled exploring with Fieller's 95 % interval (None: no end)."""
    (a, a_sd), (b, b_sd) = (pooled(item, j) for item in (above, below))
    g = (1.96 * b_sd / b) ** 2
    if g >= 1:
        return {"value": a / b, "95 % interval": [None, None], "why": "exploring is not told apart from zero"}
    middle = (a / b) / (1 - g)
    half = 1.96 / abs(b) / (1 - g) * np.sqrt((1 - g) * a_sd**2 + (a / b) ** 2 * b_sd**2)
    return {"value": a / b, "95 % interval": [max(middle - half, 0.0), middle + half]}


def pooled(per_event: CompliancePerEvent, j: int) -> tuple[float, float]:
    """Pooled value, not cut at zero, and its standard deviation."""
    used = np.asarray(per_event.status)[:, j] <= STATUS.index("negative")
    found = pool(np.asarray(per_event.compliance)[used, j], np.asarray(per_event.standard_error)[used, j])
    return found.value, (found.upper - found.lower) / 2 / 1.96


def draw(path: Path, result: dict) -> None:
    """Ours with interval, truth, and the paper's entry, a panel a task."""
    from icjax.view._style import INK, MEASURED, QUIET, new_figure, style

    with style():
        figure = new_figure(8.0, 3.6)
        for axis, task in zip(figure.subplots(1, 2, sharey=True), TASKS, strict=True):
            for j, joint in enumerate(JOINTS):
                entry = result[task][joint]
                low, high = (x if np.isfinite(x) else 20.0 for x in entry["95 % interval"])
                axis.plot([j - 0.15] * 2, [low, high], color=MEASURED, lw=5, alpha=0.3, solid_capstyle="butt")
                if low > 0:
                    axis.plot(j - 0.15, entry["value"], "o", color=MEASURED, ms=5)
                else:
                    axis.plot(j - 0.15, high, "v", color=MEASURED, ms=6)
                axis.plot(j, entry["truth"], "D", color=INK, ms=5)
                bound = entry["paper"].startswith("<")
                axis.plot(j + 0.15, float(entry["paper"].removeprefix("< ")), "v" if bound else "s", color=QUIET, ms=5)
            axis.set_xticks(range(4), JOINTS)
            axis.set_xlim(-0.5, 3.5)
            axis.set_yscale("symlog", linthresh=0.5, linscale=1.0)
            axis.set_ylim(0, 10)
            axis.set_yticks([0, 0.25, 0.5, 1, 2, 5, 10], ["0", "0.25", "0.5", "1", "2", "5", "10"])
            axis.set_title(f"{task} (simulated session {TASKS[task]})")
        figure.axes[0].set_ylabel("compliance (rad/Nm)")
        for mark, colour, label in (
            ("o", MEASURED, "ours, 95 % interval"),
            ("v", MEASURED, "less than (of either)"),
            ("D", INK, "truth of the simulated subject"),
            ("s", QUIET, "paper (people)"),
        ):
            figure.axes[0].plot([], [], mark, color=colour, label=label, ms=5)
        figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
        figure.savefig(path, dpi=130)


if __name__ == "__main__":
    found = main(tyro.cli(Config))
    print(f"{'':12s}{'joint':7s}{'paper':>10s}{'ours':>14s}{'truth':>8s}  interval")
    for task in TASKS:
        for joint, entry in found[task].items():
            ends = ", ".join(f"{end:.3f}" for end in entry["95 % interval"])
            print(f"{task:12s}{joint:7s}{entry['paper']:>10s}{entry['ours']:>14s}{entry['truth']:8.3f}  [{ends}]")
    print(found["scratching / exploring"])
