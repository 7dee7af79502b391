"""`icjax design`: which contacts to record, before anyone is recorded."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

if TYPE_CHECKING:
    from icjax.fit import Design as Plan

WIDEST_NAME = 40


@dataclass(frozen=True)
class Design:
    """Rank contacts by how wide each joint's 95 % interval would be; say what each joint is missing.

    An interval's width is the ratio of its ends. Joints above a factor of 4 get no number from a fit.
    """

    plan: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="PLAN.TOML")] = None
    """Model, instruments and candidate contacts; its keys are explained in the guide "Designing a session"."""
    model: Literal["index_finger"] | None = None
    """In place of a file: a shipped model with candidates of ours."""
    catch_trials: int | None = None
    """Catch trials of every trial, 0 for none, in place of the file's (2 if it says nothing)."""
    contacts: int | None = None
    """Contacts of every probe, in place of the file's."""
    best: int = 3
    """How many contacts to combine, chosen one after the other."""
    out: Path | None = None
    """File for the figures, JSON; nothing is written if not given."""

    def run(self) -> None:
        from icjax.cli._output import Steps

        if (self.plan is None) == (self.model is None):
            raise ValueError("give either PLAN.TOML or --model index_finger")
        if self.best < 1:
            raise ValueError(f"--best {self.best}: must be at least 1")
        with Steps(1).step("expected intervals"):
            plan = self._plan()
        found = figures(plan, min(self.best, len(plan.probes)))
        print(text(plan, found))
        if self.out is not None:
            self.out.parent.mkdir(parents=True, exist_ok=True)
            self.out.write_text(json.dumps(found, indent=1) + "\n")
            print(f"wrote {self.out}")

    def _plan(self) -> "Plan":
        import dataclasses

        from icjax.fit import Planned, design, finger_candidates, read_design
        from icjax.model import index_finger

        if self.plan is not None:
            planned = read_design(self.plan)
        else:
            model = index_finger()
            planned = Planned(model, finger_candidates(model))
        probes = planned.probes
        if self.contacts is not None:
            probes = tuple(dataclasses.replace(probe, contacts=self.contacts) for probe in probes)
        catch_trials = planned.catch_trials if self.catch_trials is None else self.catch_trials
        return design(planned.model, probes, catch_trials, noise=planned.noise)


def figures(plan: "Plan", best: int) -> dict[str, Any]:
    """What is printed, as numbers: widths, peak torque (Nm), deflection and doubt (rad), contacts needed."""
    import numpy as np

    def plain(values) -> list[float | None]:
        return [float(f"{value:.4g}") if np.isfinite(value) else None for value in values]

    def row(item: int) -> dict[str, Any]:
        return {
            "probe": plan.probes[item].name,
            "contacts": plan.probes[item].contacts,
            "width": plain(widths[item]),
            "refused": [
                joint for joint, w in zip(plan.joints, widths[item], strict=True) if not w <= plan.options.widest
            ],
            "torque Nm": plain(plan.torque[item]),
            "deflection rad": plain(plan.deflection[item]),
            "doubt rad": plain(plan.doubt[item]),
            "contacts needed": plain(plan.contacts_needed([item])),
        }

    widths = plan.widths
    total = max(probe.contacts for probe in plan.probes)
    sets = []
    for count in range(1, best + 1):
        chosen = plan.best_set(count, total)
        width = plan.expected(chosen, total).width
        sets.append({"probes": [plan.probes[item].name for item in chosen], "contacts": total, "width": plain(width)})
    return {
        "joints": list(plan.joints),
        "catch trials": plan.catch_trials,
        "widest": plan.options.widest,
        "probes": [row(item) for item in plan.ranking()],
        "best sets": sets,
    }


def text(plan: "Plan", found: dict[str, Any]) -> str:
    """The ranking, what the joints without a number are missing, the best combinations."""
    label = min(max(len(row["probe"]) for row in found["probes"]), WIDEST_NAME)
    head = "".join(f"{joint[:9]:>10s}" for joint in found["joints"])
    lines = [
        f"expected 95 % intervals, largest over smallest value; {found['catch trials'] or 'no'} catch trials a trial; "
        f"* above {found['widest']:g}: no number",
        f"{'probe':{label}s} {'contacts':>8s}{head}",
    ]
    for row in found["probes"]:
        lines.append(f"{row['probe'][:label]:{label}s} {row['contacts']:8d}{_cells(row['width'], found['widest'])}")
    open_by = "repetitions leave" if found["catch trials"] else "the movement before contact leaves"
    missing = [line for row in found["probes"] for line in _missing(found["joints"], row, open_by)]
    lines += ["", *(missing or ["every joint gets a number from every probe"]), ""]
    for item in found["best sets"]:
        lines.append(f"best {len(item['probes'])} of {item['contacts']} contacts: {'; '.join(item['probes'])}")
        lines.append(f"{'':{label}s} {item['contacts']:8d}{_cells(item['width'], found['widest'])}")
    never = [j for j, name in enumerate(found["joints"]) if all(name in row["refused"] for row in found["probes"])]
    lines += [f"{found['joints'][j]}: no probe tells it; load it more" for j in never]
    return "\n".join(lines)


def _cells(width: list[float | None], widest: float) -> str:
    shown = [("inf" if w is None else f"{w:.3g}") + ("*" if w is None or w > widest else " ") for w in width]
    return "".join(f"{item:>10s}" for item in shown)


def _missing(joints: list[str], row: dict[str, Any], open_by: str) -> list[str]:
    from math import degrees

    lines = []
    for j, joint in enumerate(joints):
        if joint not in row["refused"]:
            continue
        needed = row["contacts needed"][j]
        cure = "more contacts do not help" if needed is None else f"or {needed:.0f} contacts"
        lines.append(
            f"{row['probe']}: {joint} is loaded by {1e3 * row['torque Nm'][j]:.1f} mNm and moves "
            f"{degrees(row['deflection rad'][j]):.2f} degrees where {open_by} "
            f"{degrees(row['doubt rad'][j]):.2f} open; missing: a contact that loads it more, {cure}"
        )
    return lines
