"""Intervals from the curvature at a minimum, honest about directions that the data do not see."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.typing import Bool, Float, Real

QUANTILE = 1.959963984540054
"""Of the standard normal distribution at 97.5 %: 95 % lie within."""


class Laplace(eqx.Module):
    """Normal approximation of what is known of x, around the minimum of `|r(x)|^2 / 2` with r of unit variance.

    **Fields**

    - `sd` [n]: standard deviation of each number; infinite where neither data nor prior determine it.
    - `covariance` [n, n]: of what is determined; rows of undetermined numbers are NaN.
    - `learned` [n]: 1 - (posterior variance / prior variance): zero where only the prior speaks, one where only the
      data do; NaN where neither does.
    - `blind` [n, k]: orthonormal directions (in units of `scale`) that nothing determines.
    """

    sd: Float[Real, " n"]
    covariance: Float[Real, "n n"]
    learned: Float[Real, " n"]
    blind: Float[np.ndarray, "n k"]

    @property
    def determined(self) -> Bool[np.ndarray, " n"]:
        """Whether a number has a finite interval."""
        return np.isfinite(np.asarray(self.sd))

    @property
    def correlation(self) -> Float[np.ndarray, "n n"]:
        """Correlation of each pair; NaN where undetermined."""
        sd = np.where(self.determined, np.asarray(self.sd), np.nan)
        return np.asarray(self.covariance) / (sd[:, None] * sd[None, :])


def laplace(
    data: Float[Real, "row n"],
    prior: Float[Real, "row2 n"],
    *,
    scale: Float[Real, " n"] | None = None,
    smallest: float | None = None,
) -> Laplace:
    """Covariance (J^T J + P^T P)^-1 from the Jacobian J of whitened data and P of whitened priors.

    A direction counts as blind where its singular value is below `smallest` times the largest, numbers in units of
    `scale`: where it is no more than what rounding leaves of none. Then every number with a share in it has an
    infinite interval. A prior always counts, however well other numbers are measured. `learned` compares with the
    prior alone.

    **Arguments**: `data`, `prior` the Jacobians, rows of unit variance; `scale` typical changes of the numbers,
    default one (logarithms); `smallest`, default 1e-10 in double and 1e-4 in single precision.

    **Source**: Bates and Watts 1988, Nonlinear regression analysis; the Bayesian reading is Laplace's.
    """
    if smallest is None:
        smallest = 1e-4 if np.asarray(data).dtype == np.float32 else 1e-10
    J, P = np.asarray(data, float), np.asarray(prior, float)
    n = J.shape[1]
    units = np.ones(n) if scale is None else np.asarray(scale, float)
    both = np.concatenate([J, P]) * units[None, :]
    if both.shape[0] < n:
        both = np.concatenate([both, np.zeros((n - both.shape[0], n))])
    _, values, Vt = np.linalg.svd(both, full_matrices=False)
    seen = values > smallest * max(float(values.max(initial=0.0)), np.finfo(float).tiny)
    inverse = Vt[seen].T / values[seen][None, :]
    covariance = (inverse @ inverse.T) * units[:, None] * units[None, :]
    blind = Vt[~seen].T
    lost = np.linalg.norm(blind, axis=1) > 1e-6
    sd = np.where(lost, np.inf, np.sqrt(np.diagonal(covariance)))
    covariance = np.where(lost[:, None] | lost[None, :], np.nan, covariance)
    alone = np.diagonal(np.linalg.pinv(P.T @ P)) if P.size else np.zeros(n)
    stated = np.diagonal(P.T @ P) > 0 if P.size else np.zeros(n, bool)
    with np.errstate(invalid="ignore", divide="ignore"):
        learned = np.where(stated, 1.0 - np.where(lost, np.nan, sd) ** 2 / alone, np.where(lost, np.nan, 1.0))
    return Laplace(sd=sd, covariance=covariance, learned=np.clip(learned, 0.0, 1.0), blind=blind)


def interval(value: Float[Real, " n"], sd: Float[Real, " n"]) -> tuple[np.ndarray, np.ndarray]:
    """95 % interval of x: value -+ 1.96 sd. Map both ends through a monotone transform for that of the value."""
    value, sd = np.asarray(value), np.asarray(sd)
    return value - QUANTILE * sd, value + QUANTILE * sd


def jacobian(function, x: Float[Real, " n"], batch: int = 32) -> Float[jax.Array, "row n"]:
    """d function / dx in forward mode, at most `batch` columns at once, in blocks of one size."""
    count = x.shape[0]
    blocks = max(1, -(-count // batch))
    size = -(-count // blocks)
    directions = jnp.eye(count, blocks * size, dtype=x.dtype).T.reshape(blocks, size, count)
    along = jax.vmap(lambda direction: jax.jvp(function, (x,), (direction,))[1])
    columns = along(directions[0])[None] if blocks == 1 else jax.lax.map(along, directions)
    return columns.reshape(blocks * size, *columns.shape[2:])[:count].T
