"""A fit as a table of text."""

from textwrap import wrap

import numpy as np

from icjax.fit._check_fit import far_from_prior, unusual_chi2
from icjax.fit._record import FitRecord

WIDTH = 110
"""Characters of a line, as many as the table has."""


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
    for text in (*record.warnings, *unusual_chi2(record), *far_from_prior(record)):
        lines += wrap(f"warning: {text}", WIDTH, subsequent_indent="    ")
    return "\n".join(lines)


def _by_period(record: FitRecord) -> list[str]:
    """Of every joint what each period says; none where there is one."""
    periods, lines = record.periods, []
    if len(periods.period_names) == 1:
        return lines
    for index, joint in enumerate(periods.joint_names):
        rows = zip(periods.period_names, *(np.asarray(x)[:, index] for x in (
            periods.compliance, periods.lower, periods.upper, periods.refused)), strict=True)  # fmt: skip
        told = (f"{name} {'refused' if no else f'{value:.3g}'} {_interval(a, b)}" for name, value, a, b, no in rows)
        lines += wrap(f"{joint} by {'; '.join(told)}", WIDTH, subsequent_indent="    ")
    return lines


def _interval(lower: float, upper: float) -> str:
    """A 95 % interval as text, an upper bound where it begins at zero."""
    if not upper < float("inf"):
        return "unbounded"
    return f"[{lower:.3g}, {upper:.3g}]" if lower > 0 else f"< {upper:.3g}"
