"""How wrong a fit through contact is expected to be, from errors as they are and not as its weights have them.

The weights take the errors of samples for independent. Two are not: a film's gain error stays through all trials, and
the course that the trials share, a mean of measured angles, is wrong at one moment in all of them alike.
"""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from contact_fit_problem import FORCE_SD, GAIN_SD, MODEL_SD, Course, Together, compared_rows

from icjax.fit import Problem
from icjax.inference import Laplace
from icjax.typing import Float


def expected_sd(
    problem: Problem, x: Any, J: Float[np.ndarray, "row n"], known: Laplace, course: Course
) -> Float[np.ndarray, " n"]:
    r"""Standard deviation of the estimate's error, to first order.

    With S the covariance that the weights give, errors \(\varepsilon\) of the whitened residual, of variance R, move
    the estimate by \(-S J^T \varepsilon\):

    \[ \mathrm{cov} = S (P^T P + J^T R J) S, \qquad S = (P^T P + J^T J)^{-1}. \]

    R has noise of forces from sample to sample, a gain error of every film (`GAIN_SD`), and noise of the angles of
    every trial, one number a joint and step, that shows in the trial's own angles and, with its weight, in the course
    of all.

    Source: Huber 1967, The behavior of maximum likelihood estimates under nonstandard conditions.
    """
    trials = problem.measurements[0].trials
    count, rows, films = trials.force.shape
    S = np.asarray(known.covariance)
    moved = S @ np.asarray(J).T
    forces, angles = np.split(moved.reshape(len(S), count, -1), [rows * films], axis=2)
    forces, angles = forces.reshape(len(S), count, rows, films), angles.reshape(len(S), count, rows, -1)
    force, sd = np.asarray(trials.force), np.asarray(trials.force_sd)
    hidden = sd > np.hypot(FORCE_SD, GAIN_SD * force) * (1.0 + 1e-9)  # the film is below its threshold
    noise, gain = np.where(hidden, 1.0, FORCE_SD / sd), np.where(hidden, 0.0, GAIN_SD * force / sd)
    variance = np.diagonal(S - moved @ moved.T)  # of the priors
    variance = variance + np.sum((forces * noise) ** 2, axis=(1, 2, 3))
    variance = variance + np.sum(np.einsum("ntrf,trf->nf", forces, gain) ** 2, axis=1)
    angle_sd = np.asarray(trials.angle_sd)[0]
    variance = variance + np.sum((angles * (MODEL_SD / angle_sd)) ** 2, axis=(1, 2, 3))
    slope = np.stack([np.asarray(_by_course(problem, x, row)) for row in moved])
    weight = course.weight[:, compared_rows(course)]
    in_all = np.einsum("tr,nrj->ntrj", weight, slope)
    in_all[:, :count] += angles / angle_sd
    clean = np.sqrt(angle_sd**2 - MODEL_SD**2)
    return np.sqrt(variance + np.sum((in_all * clean) ** 2, axis=(1, 2, 3)))


@eqx.filter_jit
def _by_course(problem: Problem, x: Any, weight: Any) -> Any:
    """d (weight . r) / d course [row, joint]; all trials have one course."""
    together = problem.measurements[0]

    def told(nominal):
        moved = eqx.tree_at(lambda item: item.trials.nominal, together, nominal)
        return weight @ moved.residual(problem.parameters.values(x))

    assert isinstance(together, Together)
    return jax.grad(told)(together.trials.nominal).sum(axis=0)[:, 3:]
