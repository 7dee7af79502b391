"""A fit, or a plan, as a table of text."""

from math import degrees
from textwrap import wrap
from typing import Any

import numpy as np

from icjax.fit._design import Design
from icjax.fit._design_figures import design_figures
from icjax.fit._record import FitRecord
from icjax.fit._session import LEAST_EVENTS

WIDTH = 110
"""Characters of a line, as many as the table has."""

MANY = 200
"""Contacts that nobody records."""

MOST_LINES = 12
"""About what joints of probes are missing, above which each joint has one."""

WIDEST_NAME = 40
"""Characters of a probe's name in a table."""


def fit_text(record: FitRecord) -> str:
    """Compliance of each joint beside the paper's, as a table of text, then refusals, warnings and what it rests on:
    what `icjax fit` prints."""
    units = sorted(set(record.units.values()), reverse=True)
    name = max(12, *(len(joint) for joint in record.joint_names))
    lines = [
        f"{'joint':{name}s} {'fit ' + ', '.join(units):>14s}  {'95 % interval':>18s} {'learned':>8s}"
        f"   {'the paper':>14s}  {'95 % interval':>18s}"
    ]
    paper = record.paper
    for index, joint in enumerate(record.joint_names):
        refused = record.refused[index]
        told = "refused" if refused else f"{record.compliance[index]:.3g}"
        cells = ("", "")
        if joint in paper.joint_names:
            row = paper.joint_names.index(joint)
            value, lower, upper = (float(x[row]) for x in (paper.compliance, paper.lower, paper.upper))
            cells = (f"{value:.3g}" if np.isfinite(value) else "not estimated", _interval(lower, upper))
        lines.append(
            f"{joint:{name}s} {told:>14s}  {_interval(float(record.lower[index]), float(record.upper[index])):>18s} "
            f"{record.learned[index]:>8.0%}   {cells[0]:>14s}  {cells[1]:>18s}"
        )
    if np.isfinite(record.profile).any():
        told = (f"{joint} {_interval(float(a), float(b))}" for joint, a, b in zip(
            record.joint_names, *np.asarray(record.profile), strict=True))  # fmt: skip
        lines += wrap(f"by profile likelihood: {', '.join(told)}", WIDTH, subsequent_indent="    ")
    lines += _by_period(record)
    for joint, reason in zip(record.joint_names, record.refused, strict=True):
        if reason:
            lines += wrap(f"{joint} refused: {reason}", WIDTH, subsequent_indent="    ")
    lines.append(
        f"{len(record.windows.trial)} contacts of {len(record.trials)} trials against {record.catch_trials or 'no'} "
        f"catch trials; chi2 {record.chi2:.2f} (1 where noise and repetitions are as assumed)"
    )
    for text in record.warnings:
        lines += wrap(f"warning: {text}", WIDTH, subsequent_indent="    ")
    return "\n".join(lines)


def _by_period(record: FitRecord) -> list[str]:
    """A row for every period, and one for its ratio to the first; none where there is one."""
    periods = record.periods
    if len(periods.period_names) == 1:
        return []
    name = max(map(len, periods.period_names))
    lines = [
        "above: geometric means of the following, rad/Nm with 95 % intervals (of refused ones the bounds)",
        f"{'':{name}s}" + "".join(f"  {joint:>24s}" for joint in periods.joint_names),
    ]
    numbers = (np.asarray(x) for x in (periods.compliance, periods.lower, periods.upper, periods.refused))
    for period, *row in zip(periods.period_names, *numbers, strict=True):
        cells = (
            f"{'refused' if no else f'{value:.3g}'} {_interval(lower, upper)}"
            for value, lower, upper, no in zip(*row, strict=True)
        )
        lines.append(f"{period:{name}s}" + "".join(f"  {cell:>24s}" for cell in cells))
    lines.append(
        f"as multiples of {periods.period_names[0]}, with 95 % intervals, what was assumed of changes left out of these"
    )
    numbers = (np.asarray(x) for x in (periods.factor, periods.factor_lower, periods.factor_upper))
    for period, *row in list(zip(periods.period_names, *numbers, strict=True))[1:]:
        cells = (f"{value:.3g} {_interval(lower, upper)}" for value, lower, upper in zip(*row, strict=True))
        lines.append(f"{period:{name}s}" + "".join(f"  {cell:>24s}" for cell in cells))
    return lines


def _interval(lower: float, upper: float) -> str:
    """A 95 % interval as text, a bound where it has one end only."""
    if not upper < float("inf"):
        return f"> {lower:.3g}" if lower > 0 else "unbounded"
    return f"[{lower:.3g}, {upper:.3g}]" if lower > 0 else f"< {upper:.3g}"


def design_text(plan: Design, best: int = 3) -> str:
    """Expected widths of every probe, best first, what the joints without a number are missing, and the best sets of
    one to `best` probes: what `icjax design` prints, from `design_figures`.

    **Errors**: `ValueError` for a `best` below one.
    """
    found = design_figures(plan, best)
    joints, rows, widest = found["joints"], found["probes"], found["widest"]
    few = [row["probe"] for row in rows if row["contacts"] < LEAST_EVENTS]
    label = min(max(len(row["probe"]) for row in rows), WIDEST_NAME)
    lines = [
        f"expected 95 % intervals, largest over smallest value; "
        f"{f'{plan.catch_trials} catch trials a trial' if plan.catch_trials else 'no catch trials'}; "
        f"* above {widest:g}{f' or from fewer than {LEAST_EVENTS} contacts' if few else ''}: no number",
        f"{'probe':{label}s} {'contacts':>8s}" + "".join(f"{joint[:9]:>10s}" for joint in joints),
    ]
    for row in rows:
        told = _widths(row["width"], widest, row["contacts"])
        lines.append(f"{row['probe'][:label]:{label}s} {row['contacts']:8d}{told}")
    missing = _all_missing(joints, rows, widest, plan.catch_trials)
    if few:
        which = "every probe has fewer" if len(few) == len(rows) else f"fewer have {'; '.join(few)}"
        missing.append(f"a session needs at least {LEAST_EVENTS} contacts; {which}")
    told = missing or ["every joint gets a number from every probe"]
    lines += ["", *(part for line in told for part in wrap(line, WIDTH, subsequent_indent="    ")), ""]
    for item in found["best sets"]:
        number = len(item["probes"])
        lines.append(
            f"best {f'{number} together' if number > 1 else 'alone'}, {item['contacts']} contacts in all: "
            + "; ".join(item["probes"])
        )
        lines.append(f"{'':{label}s} {item['contacts']:8d}{_widths(item['width'], widest, item['contacts'])}")
    cure = "load it more" if plan.catch_trials else "record catch trials"
    never = [j for j in range(len(joints)) if all(_wide(row["width"][j], widest) for row in rows)]
    lines += [f"{joints[j]}: no probe tells it; {cure}" for j in never]
    return "\n".join(lines)


def _wide(width: float | None, widest: float) -> bool:
    return width is None or width > widest


def _all_missing(joints: list[str], rows: list[dict[str, Any]], widest: float, catch_trials: int) -> list[str]:
    """What each refused joint of each probe is missing; where that would be many lines, of each joint the probe that
    comes nearest to a number. Probes that only need the least number of contacts are not among them."""
    found = [(row, j) for row in rows for j in range(len(joints)) if _wide(row["width"][j], widest)]
    if len(found) <= MOST_LINES:
        return [_missing(joints, row, j, catch_trials) for row, j in found]
    lines = []
    for j in range(len(joints)):
        own = [row for row, number in found if number == j]
        nearest = min(own, key=lambda row: row["width"][j] or float("inf"), default=None)
        if nearest is not None:
            others = f" ({len(own) - 1} other probes tell it less)" if len(own) > 1 else ""
            lines.append(_missing(joints, nearest, j, catch_trials) + others)
    return lines


def _widths(width: list[float | None], widest: float, contacts: int) -> str:
    few = contacts < LEAST_EVENTS
    shown = [("inf" if w is None else f"{w:.3g}") + ("*" if few or _wide(w, widest) else " ") for w in width]
    return "".join(f"{item:>10s}" for item in shown).rstrip()


def _missing(joints: list[str], row: dict[str, Any], j: int, catch_trials: int) -> str:
    needed = row["contacts needed"][j]
    helps = needed is not None and needed <= MANY
    cure = f", or {needed:.0f} contacts" if helps else "; more contacts are no cure"
    doubtful, first = "repetitions leave", ""
    if not catch_trials:
        doubtful, first = "the movement before contact leaves", "a catch trial, or "
    return (
        f"{row['probe']}: {joints[j]} is loaded by {1e3 * row['torque Nm'][j]:.1f} mNm and moves "
        f"{degrees(row['deflection rad'][j]):.2f} degrees where {doubtful} {degrees(row['doubt rad'][j]):.2f} open; "
        f"missing: {first}a contact that loads it more{cure}"
    )
