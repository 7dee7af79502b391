"""Where compliance may change: by what factor it did, and what every part of a session says of its own."""

from typing import Any, NamedTuple

import numpy as np

from icjax.fit._ends import likelihood_ends
from icjax.fit._problem import Problem
from icjax.fit._session import SessionProblem
from icjax.inference import Laplace
from icjax.typing import Float


class Numbers(NamedTuple):
    """Linear combinations of x at the minimum: value, standard deviation and 95 % interval of each."""

    value: Float[np.ndarray, " number"]
    sd: Float[np.ndarray, " number"]
    lower: Float[np.ndarray, " number"]
    upper: Float[np.ndarray, " number"]


class Changes(NamedTuple):
    """Of every period and joint, all [period, joint].

    - `factor`, `lower`, `upper`: compliance over that of the first period, with its 95 % interval; ones for the first.
    - `learned`: share of the prior variance of its deviation from the mean of all periods that the data removed; where
      it is small the period's number is that of the others.
    """

    factor: Float[np.ndarray, "period joint"]
    lower: Float[np.ndarray, "period joint"]
    upper: Float[np.ndarray, "period joint"]
    learned: Float[np.ndarray, "period joint"]


def numbers_of(
    problem: Problem, x: Any, plain: Laplace, known: Laplace, along: Float[np.ndarray, "number n"]
) -> Numbers:
    """Combinations a x (rows a of `along`) with the ends of `likelihood_ends`, farther out in the ratio in which
    `known` is wider than `plain`, which takes hyperparameters for known. Ends always hold the value, which the number's
    own prior has a part in."""
    value = along @ np.asarray(x)
    sd, narrow = (np.sqrt(np.einsum("kn,nm,km->k", along, np.nan_to_num(s.covariance), along)) for s in (known, plain))
    wider = np.divide(sd, narrow, out=np.ones_like(sd), where=narrow > 0)
    low, high = (value + wider * (end - value) for end in likelihood_ends(problem, x, plain, along))
    return Numbers(value, sd, np.minimum(low, value), np.maximum(high, value))


def changes_of(made: SessionProblem, x: Any, plain: Laplace, known: Laplace, change: float) -> Changes | None:
    """How compliance changes between the periods of a session; None where there is one.

    **Arguments**: `change` the prior's standard deviation of log C of a period about what all have in common.
    """
    periods, joints = len(made.periods), len(made.dof_names)
    if periods == 1:
        return None
    at = made.problem.parameters.slices["compliance"]

    def rows(of_periods: np.ndarray) -> np.ndarray:
        along = np.zeros((len(of_periods) * joints, len(x)))
        along[:, at] = np.kron(of_periods, np.eye(joints))
        return along

    found = numbers_of(made.problem, x, plain, known, rows(np.eye(periods)[1:] - np.eye(periods)[:1]))
    factor, lower, upper = (
        np.concatenate([np.ones((1, joints)), np.exp(part).reshape(-1, joints)])
        for part in (found.value, found.lower, found.upper)
    )
    apart = rows(np.eye(periods) - 1.0 / periods)
    variance = np.einsum("kn,nm,km->k", apart, np.nan_to_num(known.covariance), apart).reshape(-1, joints)
    learned = np.clip(1.0 - variance / (change**2 * (1.0 - 1.0 / periods)), 0.0, 1.0)
    return Changes(factor, lower, upper, learned)
