"""The section about a fit of the whole session: compliances, what they explain, what they leave, what was assumed."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from icjax import view
from icjax.fit import FitRecord
from icjax.report._estimates import interval_text, true_compliance, value_text
from icjax.report._page import Section, absent, figure, folded, note, pairs, paragraph, table, text

MOST = 6
"""Joints drawn over time; those of which the data said most."""

OPTIONS = {
    "after": "{:g} s after the onset are compared",
    "before": "{:g} s before it hold what was expected against the trial",
    "settle": "{:g} s after a release nothing is compared",
    "spacing": "{:g} s between compared samples",
    "typical_compliance": "{:g} rad/Nm, centre of the prior where the model states none",
    "compliance_sd": "{:g}, of log C beforehand",
    "compliance_by": "one in every {}",
    "compliance_change": "{:g}, of log C of a trial or contact about what all have in common, where it may change",
    "damping_time_spread": "{:g}, of a joint's about that of all joints",
    "damping_time": "{:g} s, damping over stiffness beforehand",
    "damping_time_sd": "{:g}, of its logarithm beforehand, for all joints together",
    "inertia_sd": "{:g}, relative, of the segments' masses beforehand",
    "shift_sd": "{:g} s, by which a repetition may begin earlier or later",
    "widest": "{:g}, largest ratio of an interval's ends that is not refused",
}


def fits(records: Sequence[FitRecord], metrics: Mapping[str, Any] | None = None) -> Section | None:
    """Every fit with its figures; None where there is none."""
    if not records:
        return None
    truth = true_compliance(metrics)
    body = "".join(_fit(number, record, truth, len(records) > 1) for number, record in enumerate(records))
    return Section("fit", "Fit of the whole session", body)


def _fit(number: int, fit: FitRecord, truth: Mapping[str, float], named: bool) -> str:
    body = f"<h3>{text(fit.title)}</h3>" if named else ""
    body += paragraph(
        f"{_count(len(fit.windows.trial), 'contact')} of {_count(len(fit.trials), 'trial')} were fitted together "
        f"against {_expected(fit)}: what a "
        "finger with this compliance, damping and mass would do after each contact, held against what it did. Inertia, "
        "damping and planned movement are part of the model, which the paper's estimator leaves out."
    )
    body += table(*_compliances(fit, truth), words=(0,))
    body += paragraph(
        "Learned is the share of what was open beforehand that the data removed. The correlation of a compliance with "
        "the reference (median over the contacts) says how far one could be traded for the other."
    )
    refused = [f"{name}: refused, since {why}." for name, why in _refusals(fit)]
    body += "".join(absent(line) for line in refused)
    body += note(list(fit.warnings)) if fit.warnings else ""
    body += _by_period(number, fit)
    body += figure(
        view.svg(view.plot_fit_compliance(fit, truth), f"fit-{number}-compliance", "compliance with intervals"),
        "95 % intervals of the fit and of the paper's estimate of the same session. The latter state the scatter of "
        "the contacts, not the bias of the method.",
    )
    if np.isfinite(np.asarray(fit.profile)).any():
        ends = zip(fit.joint_names, *np.asarray(fit.profile), strict=True)
        told = ", ".join(f"{joint} {interval_text(float(low), float(high))}" for joint, low, high in ends)
        body += paragraph(f"95 % intervals by profile likelihood, all else fitted anew at every value: {told}.")
    shown, left = _drawn(fit)
    body += "<h3>Does it explain what happened?</h3>"
    body += figure(
        view.svg(view.plot_fit_response(fit, shown), f"fit-{number}-response", "deviation after contact"),
        "Deviation from the movement without contact, measured and predicted, at the contacts with the strongest, "
        "the middle and the weakest torque of each joint (trial, time and largest torque above). Measured is the "
        "trial less what was expected (the mean of its catch trials with their drift, or the movement as it was before "
        "contact), as foretold from the movement before contact. "
        "Band: what 95 % of repetitions would leave open. Shaded: contact.",
    )
    body += figure(
        view.svg(view.plot_fit_spectrum(fit), f"fit-{number}-spectrum", "spectrum of the whitened residuals"),
        f"Whitened residuals over frequency, mean of all contacts; their mean square is {fit.chi2:.2f}. Above one: "
        "something that the model does not know. Below one: repetitions differ less than was assumed, and "
        "intervals are wide.",
    )
    body += "<h3>Where the joints would have gone</h3>"
    body += figure(
        view.svg(view.plot_fit_reference(fit, shown), f"fit-{number}-reference", "reference trajectory with its band"),
        "The measured angle less the fitted deviation, with the 95 % band of the fit's numbers and of the angles' "
        "noise. A constant offset of a joint angle is in all curves alike and not part of the band.",
    )
    if left:
        body += absent(f"Not drawn: {', '.join(left)}.")
    return body + _assumed(fit)


def _compliances(fit: FitRecord, truth: Mapping[str, float]) -> tuple[list[str], list[list[str]]]:
    units = set(fit.units.values())
    head = [
        "joint",
        f"fit ({'rad/Nm' if units == {'rad/Nm'} else 'rad/Nm, m/N'})",
        "95 % interval",
        "learned",
        "correlation with reference",
        "paper's estimate",
        "95 % interval",
        *(["truth (virtual subject)"] if truth else []),
    ]
    rows = []
    for index, joint in enumerate(fit.joint_names):
        told = "refused" if fit.refused[index] else value_text(float(fit.compliance[index]))
        trade = np.asarray(fit.windows.correlation)[:, index]
        trade = trade[np.isfinite(trade)]
        row = [
            joint,
            told,
            _whole(interval_text(float(fit.lower[index]), float(fit.upper[index]))),
            f"{float(fit.learned[index]):.0%}",
            f"{np.median(trade):.2f}".replace("-", "−") if trade.size else "none",
        ]
        if joint in fit.paper.joint_names:
            at = fit.paper.joint_names.index(joint)
            row.append(value_text(float(fit.paper.compliance[at])))
            row.append(_whole(interval_text(float(fit.paper.lower[at]), float(fit.paper.upper[at]))))
        else:
            row += ["", ""]
        rows.append([*row, *([f"{truth[joint]:#.3g}" if joint in truth else "not stated"] if truth else [])])
    return head, rows


def _by_period(number: int, fit: FitRecord) -> str:
    """Compliance of every trial or contact, where it may change."""
    periods = fit.periods
    if len(periods.period_names) == 1:
        return ""
    numbers = [np.asarray(x) for x in (periods.compliance, periods.lower, periods.upper, periods.refused)]
    rows = [
        [period, *(_cell(*(float(x[row, joint]) for x in numbers)) for joint in range(len(periods.joint_names)))]
        for row, period in enumerate(periods.period_names)
    ]
    body = paragraph(
        "Compliance may change between these parts of the session (rad/Nm, with 95 % intervals; of refused ones the "
        "bounds); above are the geometric means. Each part is drawn to what all have in common, so that a change must "
        "show in the data."
    )
    numbers = [np.asarray(x) for x in (periods.factor, periods.factor_lower, periods.factor_upper)]
    changes = [
        [period, *(_factor(*(float(x[row, joint]) for x in numbers)) for joint in range(len(periods.joint_names)))]
        for row, period in enumerate(periods.period_names)
    ]
    head = ["", *periods.joint_names]
    first = periods.period_names[0]
    return (
        body
        + table(head, rows, words=(0,))
        + figure(
            view.svg(view.plot_fit_periods(fit), f"fit-{number}-periods", "compliance of every part"),
            "Compliance of every part with its 95 % interval; line and band: their geometric mean.",
        )
        + paragraph(
            f"The same as multiples of {first}, with 95 % intervals, in which what was assumed of changes has no part. "
            "One in twenty leaves out 1 by chance."
        )
        + table(head, changes[1:], words=(0,))
    )


def _factor(value: float, lower: float, upper: float) -> str:
    return _whole(f"{value_text(value)} ({interval_text(lower, upper)})")


def _cell(value: float, lower: float, upper: float, refused: float) -> str:
    return _whole(f"{'refused' if refused else value_text(value)} ({interval_text(lower, upper)})")


def _whole(words: str) -> str:
    """Without a place to break the line."""
    return words.replace(" ", "\N{NO-BREAK SPACE}")


def _refusals(fit: FitRecord) -> list[tuple[str, str]]:
    return [(name, why) for name, why in zip(fit.joint_names, fit.refused, strict=True) if why]


def _drawn(fit: FitRecord) -> tuple[list[str], list[str]]:
    """Joints that are drawn over time, and the others."""
    known = np.nan_to_num(np.asarray(fit.learned))
    best = set(np.argsort(-known, kind="stable")[:MOST].tolist())
    names = fit.joint_names
    return [n for i, n in enumerate(names) if i in best], [n for i, n in enumerate(names) if i not in best]


def _assumed(fit: FitRecord) -> str:
    body = "<h3>What was assumed</h3>" + paragraph(
        (
            "Compliance and damping are constant through a session and the same in every contact; each joint has its "
            "own. "
            if len(fit.periods.period_names) == 1
            else "Damping time is constant through a session, compliance in each of its parts; each joint has its own. "
        )
        + "Masses, offsets of the joint angles, the place, gain and delay of the force sensor are uncertain within "
        "their priors. "
        + (
            "A trial departs from what was intended as its catch trials depart from each other. "
            if fit.catch_trials
            else ""
        )
        + "Intervals hold if all that holds."
    )
    options = json.loads(fit.options)
    body += pairs([(name.replace("_", " "), OPTIONS.get(name, "{}").format(value)) for name, value in options.items()])
    body += "".join(paragraph(line) for line in _processes(fit))
    parameters = fit.parameters
    refused = {f"compliance {name}" for name, why in zip(fit.joint_names, fit.refused, strict=True) if why}
    refused |= {
        f"compliance {joint}, {period}"
        for period, row in zip(fit.periods.period_names, np.asarray(fit.periods.refused), strict=True)
        for joint, no in zip(fit.periods.joint_names, row, strict=True)
        if no
    }
    lines = [f"{'':28s}{'beforehand':>12s}{'fit':>12s}{'95 % interval':>26s}{'learned':>9s}  unit"]
    for row, name in enumerate(parameters.parameter_names):
        interval = f"{parameters.lower[row]:.3g} to {parameters.upper[row]:.3g}"
        value = "refused" if name in refused else f"{parameters.value[row]:.3g}"
        lines.append(
            f"{name:28s}{parameters.nominal[row]:>12.3g}{value:>12s}{interval:>26s}"
            f"{parameters.learned[row]:>9.0%}  {parameters.units[row]}"
        )
    if any(name.startswith("carried") for name in parameters.parameter_names):
        lines.append("\ncarried: how far the arm gave way to the contacts, in what its own fit leaves open")
    return body + folded("Every number that was fitted", "\n".join(lines))


def _expected(fit: FitRecord) -> str:
    if fit.catch_trials:
        return f"{_count(fit.catch_trials, 'catch trial')}, the same movement with the surface taken away"
    return "the movement before contact, continued as free movement of these trials goes on (there are no catch trials)"


def _processes(fit: FitRecord) -> list[str]:
    """How repetitions scatter, and how free movement goes on; each only where it was used."""
    lines = []
    joints = list(zip(fit.joint_names, fit.joint_kinds, strict=True))
    if np.isfinite(np.asarray(fit.variability)).any():
        fast, slow = np.degrees(np.asarray(fit.variability))
        spread = [f"{joint} {a:.2g}° and {b:.2g}°" if kind != "slide" else joint
                  for (joint, kind), a, b in zip(joints, fast, slow, strict=True)]  # fmt: skip
        lines.append(f"Repetitions scatter about what was intended by (tremor and slow wandering): {', '.join(spread)};"
                     f" noise from frame to frame is {_times(fit.noise)} what the recording states."
                     + _multiplied(fit.inflation))  # fmt: skip
    if np.isfinite(np.asarray(fit.planned_movement)).any():
        reach, length = np.asarray(fit.planned_movement)[:2]
        spread = [f"{joint} {a:.2g} s within {b:.2g} s" for (joint, _), a, b in zip(joints, reach, length, strict=True)]
        lines.append("Planned movement departs from going on as before by its speed times (root mean square) "
                     f"{', '.join(spread)}. All contacts together may do so once more in the same way."
                     + _multiplied(fit.planned_inflation))  # fmt: skip
    return lines


def _times(factor: Any) -> str:
    low, high = float(np.min(factor)), float(np.max(factor))
    return f"{low:.2g} times" if high - low < 0.05 else f"{low:.2g} to {high:.2g} times"


def _multiplied(inflation: float) -> str:
    return f" That variance was multiplied by {inflation:.2f}." if inflation > 1.0 else ""


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")
