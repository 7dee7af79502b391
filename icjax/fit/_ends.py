"""Ends of intervals where the cost has risen, asymmetric where the data say so."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.fit._problem import Problem, intervals
from icjax.inference import QUANTILE, Laplace
from icjax.typing import Float

MOST_STEPS = 10
"""Of the search for an end."""

CLOSE = 0.01
"""Of the root of the rise, at an end."""

LONGEST = 1.5
"""Of the number, in one go; where it is a logarithm, a factor of 4.5."""

FARTHEST = 7.0
"""From the value; an end beyond, a factor of a thousand where the number is a logarithm, is none."""

LEAST_AT = np.arange(-4, 5) / 2.0
"""Where the least cost is looked for, in standard deviations."""


def likelihood_ends(
    problem: Problem, x: Any, known: Laplace, along: Float[np.ndarray, "number n"]
) -> tuple[Float[np.ndarray, " number"], Float[np.ndarray, " number"]]:
    r"""95 % intervals of the numbers a x (rows a of `along`) from the data, what was assumed of that number left out.

        {t : 2 (f(t) - min f) <= 1.96^2},    f(t) = cost(x + t v) - (a x + t - a x0)^2 / (2 a S0 a),
        v = S a / (a S a)

    S is the covariance of `known` and S0 that of the priors about x0, so that the second term is the prior of the
    number itself; those of all others stay. v is how x goes along with the number in the linear problem: to third order
    in t the cost is that of the profile (`profile`), in which all others are fitted anew. A compliance so small that
    deflections are hardly seen is known upwards, not downwards: its interval has no lower end, where the prior would
    lend it one.

    **Arguments**: `x` the minimum, `known` the covariance there.

    **Returns** lower and upper ends; infinite where the data determine none.

    **Source**: signed root of the likelihood ratio: Bates and Watts 1988, Nonlinear regression analysis, section 6.1.
    """
    x = np.asarray(x, float)
    seen = np.where(np.any((along != 0.0) & ~known.determined, axis=1), False, True)
    S = np.nan_to_num(np.asarray(known.covariance))
    size = np.einsum("kn,nm,km->k", along, S, along)
    seen = seen & (size > 0)
    v, sd = along @ S / np.where(seen, size, 1.0)[:, None], np.sqrt(np.where(seen, size, 1.0))
    apart, own = _own_prior(problem, x, along)

    def f(t: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Of one t of every number that is wanted."""
        costs = np.asarray(_costs(problem, jnp.asarray(x + t[:, None] * v), jnp.asarray(wanted)))
        return costs - 0.5 * own * (apart + t) ** 2

    least, at = _least(np.stack([f(step * sd, seen) for step in LEAST_AT]), sd)
    low, high = (
        np.where(seen, at + sign * _distance(f, at, sign, sd, least, seen), sign * np.inf) for sign in (-1.0, 1.0)
    )
    return tuple(along @ x + np.where(np.abs(end) > FARTHEST, np.copysign(np.inf, end), end) for end in (low, high))


def _own_prior(problem: Problem, x: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far every number is from the centre of its own prior, and one over that prior's variance, zero without."""
    residual, P = (np.asarray(part) for part in _prior(problem, jnp.asarray(x)))
    stated = intervals(np.zeros((0, len(x))), P)
    S0 = np.nan_to_num(np.asarray(stated.covariance))
    size = np.einsum("kn,nm,km->k", along, S0, along)
    has = (size > 0) & ~np.any((along != 0.0) & ~stated.determined, axis=1)
    return along @ (S0 @ (P.T @ residual)), np.where(has, 1.0 / np.where(has, size, 1.0), 0.0)


def _least(f: Float[np.ndarray, "step number"], sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least of f and where: of a parabola about the lowest of `LEAST_AT`. Were it still lower elsewhere, intervals
    would come out too wide."""
    f = np.where(np.isfinite(f), f, np.inf)
    best = np.clip(np.argmin(f, axis=0), 1, len(f) - 2)
    below, here, above = (np.take_along_axis(f, best[None] + step, axis=0)[0] for step in (-1, 0, 1))
    bend = below - 2.0 * here + above
    bowl = np.isfinite(bend) & (bend > 1e-12)
    step = np.where(bowl, 0.5 * np.subtract(below, above, where=bowl, out=np.zeros_like(here)), 0.0)
    step = np.clip(step / np.where(bowl, bend, 1.0), -1.0, 1.0)
    spacing = LEAST_AT[1] - LEAST_AT[0]
    lowest = here - 0.5 * np.where(bowl, bend, 0.0) * step**2
    return np.minimum(lowest, np.min(f, axis=0)), (LEAST_AT[best] + spacing * step) * sd


def _distance(f: Any, at: np.ndarray, sign: float, sd: np.ndarray, least: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """How far from the minimum the root of the rise is 1.96, by the secant method, always between what is inside and
    what is outside; infinite where it never is."""
    t = QUANTILE * sd
    inside, reached, outside = np.zeros(len(t)), np.zeros(len(t)), np.full(len(t), np.inf)
    found = ~seen
    for _ in range(MOST_STEPS):
        rise = f(at + sign * t, ~found) - least
        root = np.where(np.isfinite(rise), np.sqrt(2.0 * np.maximum(np.nan_to_num(rise), 0.0)), np.inf)
        found = found | (np.abs(root - QUANTILE) < CLOSE)
        if found.all():
            break
        within, slope = root < QUANTILE, (root - reached) / np.maximum(t - inside, 1e-300)
        outside = np.where(within, outside, np.minimum(outside, t))
        rises = (slope > 0) & np.isfinite(slope)
        wanted = t + np.where(rises, (QUANTILE - root) / np.where(rises, slope, 1.0), LONGEST)
        inside, reached = np.where(within, t, inside), np.where(within, root, reached)
        wanted = np.minimum(wanted, inside + LONGEST)
        half = np.where(np.isfinite(outside), 0.5 * (inside + outside), inside + LONGEST)
        wanted = np.where((wanted > inside) & (wanted < outside), wanted, half)
        t = np.where(found, t, wanted)
    return np.where(found | np.isfinite(outside), t, np.inf)


@eqx.filter_jit
def _costs(problem: Problem, x: jax.Array, wanted: jax.Array) -> jax.Array:
    """Zero where it is not wanted."""

    def one(of):
        x, wanted = of
        return jax.lax.cond(wanted, lambda: problem.cost(x), lambda: jnp.zeros((), x.dtype))

    return jax.lax.map(one, (x, wanted))


@eqx.filter_jit
def _prior(problem: Problem, x: jax.Array) -> tuple[jax.Array, jax.Array]:
    return jnp.asarray(problem.parameters.prior(x)), jax.jacfwd(problem.parameters.prior)(x)
