"""Does a stored fit agree with itself, and what does it warn of?"""

from collections.abc import Iterator

import numpy as np

from icjax.fit._record import FitRecord, FitWindows

ROUNDING = 1e-9
"""rad; of sums in double precision."""

USUAL = (0.3, 2.0)
"""Mean square of the whitened residuals; beyond, what was assumed of noise and repetitions does not hold."""

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
        f"fit '{fit.name}': {len(fit.windows.trial)} contacts of {len(fit.trials)} trials, {fit.catch_trials} catch "
        f"trials; {told}"
    ]
    return lines + [f"{kind}: fit '{fit.name}': {text}" for kind, text in _findings(fit)]


def _findings(fit: FitRecord) -> Iterator[tuple[str, str]]:
    count = len(fit.joint_names)
    for field in ("joint_kinds", "refused"):
        if len(getattr(fit, field)) != count:
            yield "error", f"{field} has {len(getattr(fit, field))} entries for {count} joints"
            return
    if fit.windows.joint_names != fit.joint_names:
        yield "error", f"its windows are of the joints {', '.join(fit.windows.joint_names)}"
    for name, value, low, high in zip(fit.joint_names, fit.compliance, fit.lower, fit.upper, strict=True):
        if not 0 <= low <= value <= high:
            yield "error", f"compliance of '{name}' is not within its own interval, or negative"
    periods = fit.periods
    if not np.all((periods.lower <= periods.compliance) & (periods.compliance <= periods.upper)):
        yield "error", "the compliance of a period is not within its own interval"
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
    for text in (*fit.warnings, *unusual_chi2(fit), *far_from_prior(fit)):
        yield "suspicious", text


def unusual_chi2(fit: FitRecord) -> tuple[str, ...]:
    """A line where the residuals are far larger or smaller than was assumed."""
    if USUAL[0] <= fit.chi2 <= USUAL[1]:
        return ()
    return (
        f"chi2 is {fit.chi2:.3g}, far from 1: noise, repetitions or the model are not as assumed, and "
        f"intervals are too {'narrow' if fit.chi2 > 1 else 'wide'}",
    )


def far_from_prior(fit: FitRecord) -> tuple[str, ...]:
    """A line for each number that is not what was thought likely beforehand: a wrong mass or scale of the model."""
    parameters = fit.parameters
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
        if not np.all(windows.reference_sd[number, used] >= 0):
            yield "error", f"{where}: a standard deviation of the reference is negative or not a number"
