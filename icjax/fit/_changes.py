"""Whether a session fitted with one compliance speaks for one that changes from trial to trial."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2 as chi_square

from icjax.fit._contacts import apparent
from icjax.fit._joints import JointFit
from icjax.fit._options import FitOptions
from icjax.fit._session import SessionProblem
from icjax.typing import Float

LIKELY = 1e-3
"""Probability, of any joint's test in a session whose compliance is one, below which a change is told."""

FELT = 0.1
"""Standard deviations by which a factor of e in a trial's compliance must show; what shows less is not asked."""


def changed(
    made: SessionProblem,
    data: Float[np.ndarray, "row n"],
    prior: Float[np.ndarray, "row2 n"],
    residual: Float[np.ndarray, " all"],
) -> dict[str, float]:
    """Of every joint, how probable it is that trials of one compliance fit as badly together as these do.

    A score test: to the linearised problem each trial's own log C of the joint is added, all others staying free; the
    sum of squares falls by what chance alone makes chi-squared with as many degrees of freedom, in units of the mean
    square of the residuals where that is above one. Trials that share catch trials err alike, so that their
    differences err no more than if each had its own: rows count as they would then (`apparent`). Empty where
    compliance may change already, or with one trial.

    **Arguments**: `data`, `prior` Jacobians of whitened rows at the minimum, `residual` of both.

    **Source**: Rao 1948, Large sample tests of statistical hypotheses concerning several parameters.
    """
    trials = list(dict.fromkeys(window.trial for window in made.windows))
    if len(trials) < 2 or len(made.periods) > 1:
        return {}
    measurement, at = made.problem.measurements[0], made.problem.parameters.slices["compliance"]
    common, length = measurement.common, np.asarray(measurement.whitening).shape[1]
    of = np.repeat([trials.index(window.trial) for window in made.windows], length)
    size = np.repeat([apparent(window) for window in made.windows], length)
    data, residual = data / size[:, None], residual / np.concatenate([size, np.ones(len(prior))])
    columns = data[:, at] if common is None else common.plain(data[:, at])
    Q, _ = np.linalg.qr(np.concatenate([data, prior]))
    noise = max(1.0, float(np.mean(residual[: len(data)][np.any(data != 0.0, axis=1)] ** 2)))
    found = {}
    for joint, name in enumerate(made.dof_names):
        own = columns[:, joint : joint + 1] * (of[:, None] == np.arange(len(trials) - 1))
        own = own if common is None else np.asarray(common.whitened(own))
        own = np.concatenate([own, np.zeros((len(prior), own.shape[1]))])
        U, felt, _ = np.linalg.svd(own - Q @ (Q.T @ own), full_matrices=False)
        used = felt > FELT
        fall = float(np.sum((U[:, used].T @ residual) ** 2)) / noise
        found[name] = float(chi_square.sf(fall, used.sum())) if used.any() else 1.0
    return found


def change_warnings(probability: dict[str, float]) -> tuple[str, ...]:
    """One line where a joint's trials are less probable together than `LIKELY` over the number of joints."""
    told = [f"{name} {p:.1g}" for name, p in probability.items() if p * len(probability) < LIKELY]
    if not told:
        return ()
    return (
        f"trials speak for different compliances (probability of such a difference by chance: {', '.join(told)}): one "
        'compliance through the session, with its interval, is then no trial\'s; fit them with compliance_by = "trial"',
    )


def spread_warnings(
    names: Sequence[str], periods: Sequence[Sequence[JointFit]], options: FitOptions
) -> tuple[str, ...]:
    """One line where compliances of periods differ by more than `FitOptions.compliance_change` makes likely."""
    told = []
    for joint, name in enumerate(names):
        found = np.log([row[joint].compliance for row in periods if not row[joint].refused])
        if len(found) < 2:
            continue
        size = float(np.std(found, ddof=1))
        free = len(found) - 1
        if chi_square.sf(free * (size / options.compliance_change) ** 2, free) * len(names) < LIKELY:
            told.append(f"{name} by {size:.2g}")
    if not told:
        return ()
    return (
        f"log C differs more than compliance_change = {options.compliance_change:g} says ({', '.join(told)}, standard "
        "deviations): each number is drawn too far to the others; fit with a larger one",
    )
