"""The movement that would have gone on without contact, with its band, and how it trades off with compliance."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.fit._problem import Problem
from icjax.fit._result import SessionFit
from icjax.inference import jacobian
from icjax.typing import Float

AWARE = 1e-6
"""Share of a number's largest derivative of e below which e counts as not depending on it: the filter's tails."""


class Reference(NamedTuple):
    """Of every contact window at its compared samples; NaN past a window's end.

    - `deviation` [window, sample, joint]: rad, e of the fit.
    - `angle`: rad, measured less deviation. `sd`: rad, its standard deviation.
    - `correlation` [window, joint]: of log C with the mean of `angle` over the window.
    """

    deviation: Float[np.ndarray, "window sample joint"]
    angle: Float[np.ndarray, "window sample joint"]
    sd: Float[np.ndarray, "window sample joint"]
    correlation: Float[np.ndarray, "window joint"]


def contact_free(fit: SessionFit) -> Reference:
    """Reference trajectory of a fit around every contact, q_ref = q - e(x), x what the fit found.

    The variance is the diagonal of J S J^T + N, with J the exact derivative of e by x, S the covariance of x
    (`SessionFit.laplace`) and N that of the angles from frame to frame (`Motion.noise`). Where e
    depends on a number that neither data nor prior determine, it is infinite. The constant offset of a joint angle is
    in q and in q_ref alike and no part of the band; neither is a model that is wrong.

    A larger C with a reference farther from the measured angle fits nearly as well: `correlation` says how nearly. It
    is that of S alone, NaN for a joint that no number of the fit moves.

    **Returns** `Reference`, joints in the order of `SessionProblem.dof_names`.
    """
    made, x = fit.made, jnp.asarray(fit.solution.value.x)
    shape = np.shape(made.problem.measurements[0].difference)
    deviation, by = (np.array(item) for item in _deviation(made.problem, x))
    deviation, by = deviation.reshape(shape), by.reshape(*shape, -1)
    by = np.where(np.abs(by) > AWARE * np.abs(by).max(axis=(0, 1, 2)), by, 0.0)
    covariance = np.asarray(fit.laplace.covariance)
    known = np.asarray(fit.laplace.determined)
    place, period = made.problem.parameters.slices["compliance"], made.problem.measurements[0].period
    compliance = np.arange(place.start, place.stop).reshape(-1, shape[2])
    angle, sd = np.full(shape, np.nan), np.full(shape, np.nan)
    correlation = np.full((shape[0], shape[2]), np.nan)
    for number, window in enumerate(made.windows):
        motion, count = made.motions[window.trial], len(window.samples)
        rows = by[number, :count]
        angle[number, :count] = motion.angle[window.samples] - deviation[number, :count]
        sd[number, :count] = np.sqrt(_variance(rows, covariance, known) + np.diagonal(motion.noise))
        own = compliance[0 if period is None else period[number]]
        correlation[number] = _correlation(-rows.mean(axis=0), covariance, known, own)
        deviation[number, count:] = np.nan
    return Reference(deviation, angle, sd, correlation)


@eqx.filter_jit
def _deviation(problem: Problem, x: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Flat e at the compared samples, and its Jacobian."""
    measurement = problem.measurements[0]

    def at(x):
        e = measurement.deviation(problem.parameters.values(x))
        return jnp.ravel(jax.vmap(lambda e, rows: e[rows])(e, jnp.asarray(measurement.frames)))

    return at(x), jacobian(at, x)


def _variance(
    by: Float[np.ndarray, "*rows n"], covariance: Float[np.ndarray, "n n"], known: np.ndarray
) -> Float[np.ndarray, "*rows"]:
    """by Sigma by^T of every row; infinite where a row depends on a number that is not determined."""
    Sigma = np.where(known[:, None] & known[None, :], covariance, 0.0)
    variance = np.einsum("...i,ij,...j->...", by, Sigma, by)
    lost = np.any(by[..., ~known] != 0.0, axis=-1)
    return np.where(lost, np.inf, np.maximum(variance, 0.0))


def _correlation(
    by: Float[np.ndarray, "joint n"], covariance: Float[np.ndarray, "n n"], known: np.ndarray, own: np.ndarray
) -> Float[np.ndarray, " joint"]:
    """Of each joint's log C, numbers `own`, with a quantity of the same joint whose derivative is a row of `by`."""
    variance = _variance(by, covariance, known)
    Sigma = np.where(known[:, None] & known[None, :], covariance, 0.0)
    together = np.einsum("jn,jn->j", by, Sigma[own])
    scale = np.sqrt(variance * np.diagonal(covariance)[own])
    good = np.isfinite(scale) & (scale > 0)
    return np.where(good, np.divide(together, scale, out=np.zeros_like(together), where=good), np.nan)
