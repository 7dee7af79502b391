"""Ends of intervals where the cost has risen, asymmetric where the data say so."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.fit._problem import Problem
from icjax.inference import QUANTILE, Laplace
from icjax.typing import Float

MOST_STEPS = 10
"""Of the search for an end."""

CLOSE = 0.01
"""Of the root of the rise, at an end."""

LONGEST = 1.5
"""Of the number, in one go; where it is a logarithm, a factor of 4.5."""


def likelihood_ends(
    problem: Problem, x: Any, known: Laplace, along: Float[np.ndarray, "number n"]
) -> tuple[Float[np.ndarray, " number"], Float[np.ndarray, " number"]]:
    r"""95 % intervals of the numbers a x (rows a of `along`): {t : 2 (cost(x + t v) - cost(x)) <= 1.96^2}.

    v = S a / (a S a) is how x goes along with the number in the linear problem, S the covariance of `known`: to third
    order in t the cost is that of the profile (`profile`), in which all others are fitted anew. A compliance so small
    that deflections are hardly seen is known upwards, not downwards, and its interval says so; Laplace's, symmetric in
    log C, does not.

    **Arguments**: `x` the minimum, `known` the covariance there.

    **Returns** lower and upper ends; infinite where nothing determines a number.

    **Source**: signed root of the likelihood ratio: Bates and Watts 1988, Nonlinear regression analysis, section 6.1.
    """
    x = np.asarray(x, float)
    seen = np.where(np.any((along != 0.0) & ~known.determined, axis=1), False, True)
    S = np.nan_to_num(np.asarray(known.covariance))
    size = np.einsum("kn,nm,km->k", along, S, along)
    seen = seen & (size > 0)
    v = along @ S / np.where(seen, size, 1.0)[:, None]
    least = float(_costs(problem, jnp.asarray(x[None]))[0])
    ends = [
        along @ x + sign * np.where(seen, _distance(problem, x, sign * v, np.sqrt(size), least), np.inf)
        for sign in (-1.0, 1.0)
    ]
    return ends[0], ends[1]


def _distance(problem: Problem, x: np.ndarray, v: np.ndarray, sd: np.ndarray, least: float) -> np.ndarray:
    """How far along every row of v the root of the rise is 1.96, by the secant method, always between what is inside
    and what is outside."""
    t = QUANTILE * np.where(sd > 0, sd, 1.0)
    inside, at, outside = np.zeros(len(t)), np.zeros(len(t)), np.full(len(t), np.inf)
    for _ in range(MOST_STEPS):
        rise = np.asarray(_costs(problem, jnp.asarray(x + t[:, None] * v))) - least
        root = np.where(np.isfinite(rise), np.sqrt(2.0 * np.maximum(rise, 0.0)), np.inf)
        found = np.abs(root - QUANTILE) < CLOSE
        if found.all():
            break
        within, slope = root < QUANTILE, (root - at) / np.maximum(t - inside, 1e-300)
        outside = np.where(within, outside, np.minimum(outside, t))
        rises = (slope > 0) & np.isfinite(slope)
        wanted = t + np.where(rises, (QUANTILE - root) / np.where(rises, slope, 1.0), LONGEST)
        inside, at = np.where(within, t, inside), np.where(within, root, at)
        wanted = np.minimum(wanted, inside + LONGEST)
        half = np.where(np.isfinite(outside), 0.5 * (inside + outside), inside + LONGEST)
        wanted = np.where((wanted > inside) & (wanted < outside), wanted, half)
        t = np.where(found, t, wanted)
    return t


@eqx.filter_jit
def _costs(problem: Problem, x: jax.Array) -> jax.Array:
    return jax.lax.map(problem.cost, x)
