"""Does a stored fit agree with itself, and what does it warn of?"""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from icjax.fit._record import FitRecord, FittedParameters, FitWindows
from icjax.results import RESULTS

ROUNDING = 1e-9
"""rad; of sums in double precision."""

LEAST_CHI2, MOST_CHI2, BY_CHANCE = 0.3, 1.25, 10.0
"""Mean square of the whitened residuals; beyond, what was assumed of noise and repetitions does not hold. By chance it
is above one by up to ten over the square root of their number: four standard deviations as seen in simulated sessions
(0.07 with six contacts, 1056 residuals)."""

FAR = 3.0
"""Standard deviations of its prior beyond which a number is called out."""


def check_fit(fit: FitRecord) -> list[str]:
    """Lines about a stored fit: what it holds, then lines that begin with "suspicious: " and "error: ".

    Intervals must hold their values, a window's reference must be the measured angle less the deviation, and the
    residuals must have the stated mean square.
    """
    told = ", ".join(
        f"{name} {'refused' if reason else f'{value:.3g}'} [{low:.3g}, {high:.3g}] {fit.units[name]}"
        for name, value, low, high, reason in zip(
            fit.joint_names, fit.compliance, fit.lower, fit.upper, fit.refused, strict=False
        )
    )
    if len(fit.periods.period_names) > 1:
        refused = np.asarray(fit.periods.refused)
        told += f", means of {len(refused)} parts ({refused.sum()} of {refused.size} of their numbers refused)"
    lines = [
        f"fit '{fit.title}': {len(fit.windows.trial)} contacts of {len(fit.trials)} trials, {fit.catch_trials} catch "
        f"trials; {told}"
    ]
    return lines + [f"{kind}: fit '{fit.title}': {text}" for kind, text in _findings(fit)]


def _findings(fit: FitRecord) -> Iterator[tuple[str, str]]:
    count = len(fit.joint_names)
    for field in ("joint_kinds", "refused"):
        if len(getattr(fit, field)) != count:
            yield "error", f"{field} has {len(getattr(fit, field))} entries for {count} joints"
            return
    yield from _agreeing(fit)
    if fit.windows.joint_names != fit.joint_names:
        yield "error", f"its windows are of the joints {', '.join(fit.windows.joint_names)}"
    for name, value, low, high in zip(fit.joint_names, fit.compliance, fit.lower, fit.upper, strict=True):
        if not 0 <= low <= value <= high:
            yield "error", f"compliance of '{name}' is not within its own interval, or negative"
    periods = fit.periods
    for what, low, value, high in (
        ("compliance", periods.lower, periods.compliance, periods.upper),
        ("factor", periods.factor_lower, periods.factor, periods.factor_upper),
    ):
        if not np.all((low >= 0) & (low <= value) & (value <= high)):
            yield "error", f"the {what} of a period is not within its own interval"
    parameters = fit.parameters
    for name, value, low, high in zip(
        parameters.parameter_names, parameters.value, parameters.lower, parameters.upper, strict=True
    ):
        if not low <= value <= high:
            yield "error", f"'{name}' is not within its own interval"
    yield from _windows(fit.windows)
    residual = fit.windows.residual[np.isfinite(fit.windows.residual)]
    if residual.size and not np.isclose(np.mean(residual**2), fit.chi2, rtol=1e-6):
        yield "error", f"chi2 is {fit.chi2:.3g}, the mean square of the residuals {np.mean(residual**2):.3g}"
    found = (*fit.warnings, *unusual_chi2(fit.chi2, residual.size), *far_from_prior(fit.parameters))
    for text in dict.fromkeys(found):
        yield "suspicious", text


def _agreeing(fit: FitRecord) -> Iterator[tuple[str, str]]:
    """Fields that say the same must say the same."""
    periods, parameters = fit.periods, fit.parameters
    if periods.joint_names != fit.joint_names:
        yield "error", f"its periods are of the joints {', '.join(periods.joint_names)}"
    if len(periods.period_names) == 1 and not np.array_equal(periods.refused[0], [bool(why) for why in fit.refused]):
        yield "error", "its one period refuses other joints than the fit"
    for field in ("units", "scales"):
        if len(getattr(parameters, field)) != len(parameters.parameter_names):
            yield "error", f"parameters: {field} has another length than parameter_names"
    if fit.result not in RESULTS._name_to_item:
        yield "error", f"result is {fit.result!r}, none of {', '.join(RESULTS._name_to_item)}"
    if fit.result != "solved" and not all(fit.refused):
        yield "error", f"it ended as {fit.result!r}, yet has numbers"
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.asarray(fit.upper) / np.asarray(fit.lower)
    if not np.allclose(width, fit.width, rtol=1e-6, equal_nan=True):
        yield "error", "width is not upper over lower"
    for name, learned in (
        ("", fit.learned),
        (" of a parameter", parameters.learned),
        (" of a period", periods.learned),
    ):
        if not np.all((np.asarray(learned) >= -ROUNDING) & (np.asarray(learned) <= 1 + ROUNDING)):
            yield "error", f"learned{name} is no share"
    if len(periods.period_names) == 1 and not np.allclose(periods.compliance[0], fit.compliance, rtol=1e-9):
        yield "error", "its one period has other compliances than the fit"
    for name, value in (
        ("sd of a parameter", parameters.sd), ("noise", fit.noise), ("inflation", fit.inflation),
        ("planned_inflation", fit.planned_inflation), ("repetitions", fit.windows.repetitions),
    ):  # fmt: skip
        if np.any(np.asarray(value, float) < 0):
            yield "error", f"{name} is negative"
    for field in ("options", "provenance"):
        try:
            told = json.loads(getattr(fit, field))
        except ValueError:
            told = None
        if not isinstance(told, dict):
            yield "error", f"{field} is no JSON text of names and values"
        elif field == "options":
            yield from _refusals(fit, told.get("widest"))
    repeated = bool(np.any(np.asarray(fit.windows.repetitions) > 0))
    if repeated and fit.catch_trials == 0:
        yield "error", "its windows have repetitions, yet it has no catch trials"
    for what, names in (("joint", fit.joint_names), ("parameter", parameters.parameter_names), ("trial", fit.trials)):
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            yield "error", f"{what} '{twice[0]}' is there twice"
    unknown = sorted(set(fit.windows.trial) - set(fit.trials))
    if unknown:
        yield "error", f"its windows are of trials that it does not name: {', '.join(unknown)}"
    if not (isinstance(fit.catch_trials, int) and fit.catch_trials >= 0):
        yield "error", f"catch_trials is {fit.catch_trials!r}, no number of catch trials"


def _refusals(fit: FitRecord, widest: Any) -> Iterator[tuple[str, str]]:
    if not (isinstance(widest, int | float) and widest > 1):
        yield "error", f"options: widest is {widest!r}, no ratio of an interval's ends"
        return
    for name, width, why in zip(fit.joint_names, fit.width, fit.refused, strict=True):
        if not why and not width <= widest * (1.0 + ROUNDING):
            yield "error", f"'{name}' has a number, yet its interval spans a factor of {width:.3g}, {widest:g} at most"


def unusual_chi2(chi2: float, residuals: int) -> tuple[str, ...]:
    """A line where the mean square of so many residuals is larger or smaller than was assumed."""
    if LEAST_CHI2 <= chi2 <= max(MOST_CHI2, 1.0 + BY_CHANCE / max(residuals, 1) ** 0.5):
        return ()
    factor = chi2**0.5
    told = f"narrow by a factor of {factor:.2g} at least" if chi2 > 1 else "wide"
    return (
        f"chi2 is {chi2:.3g}, far from 1: noise, repetitions or the model are not as assumed, and intervals are too "
        + told,
    )


def far_from_prior(parameters: FittedParameters) -> tuple[str, ...]:
    """A line for each number that is not what was thought likely beforehand: a wrong mass or scale of the model."""
    distance = parameters.prior_distance()
    return tuple(
        f"'{parameters.parameter_names[row]}' is {parameters.value[row]:.3g} {parameters.units[row]}".removesuffix(" 1")
        + f", {distance[row]:.1f} standard deviations of its prior from {parameters.nominal[row]:.3g}"
        for row in np.flatnonzero(distance > FAR)
    )


def _windows(windows: FitWindows) -> Iterator[tuple[str, str]]:
    for number, (trial, onset) in enumerate(zip(windows.trial, windows.onset, strict=True)):
        time = np.asarray(windows.time[number])
        used = np.isfinite(time)
        where = f"window {number} (trial '{trial}')"
        if not np.all(np.diff(time[used]) > 0) or not used.any() or used.argmin() not in (0, used.sum()):
            yield "error", f"{where}: its times do not increase, or have gaps"
            continue
        if not time[used][0] <= onset <= time[used][-1]:
            yield "error", f"{where}: its onset at {onset:g} s is not within it"
        apart = np.abs(windows.angle - windows.deviation - windows.reference)[number, used]
        if not np.all(apart < ROUNDING):
            yield "error", f"{where}: reference is not the measured angle less the deviation"
        if not np.all(np.isfinite(windows.residual[number, used])):
            yield "error", f"{where}: a residual is not a number"
        if not np.all(windows.reference_sd[number, used] >= 0):
            yield "error", f"{where}: a standard deviation of the reference is negative or not a number"
