"""Profile likelihood: how far one number can go while all others do their best."""

from typing import NamedTuple

import numpy as np

from icjax.fit._problem import Problem
from icjax.fit._solve import linearised
from icjax.inference import QUANTILE
from icjax.typing import Float, Real

MOST_POINTS = 25
"""Points on either side after which a bound counts as not found."""

CLOSE = 0.01
"""Of the root of the rise, at a bound."""

SETTLED = 1e-4
"""Decrease of the cost that another step of the others promises, below which they are at their best."""

MOST_STEPS = 20
"""Of the others at one point."""

LONGEST = 1.5
"""Of the number, in one go; where it is a logarithm, a factor of 4.5."""


class Profile(NamedTuple):
    """Profile of one number of x.

    - `name`; `x` [point] in increasing order; `rise` [point]: twice what the cost is above its minimum with all others
      fitted anew, 3.84 at the ends of a 95 % interval.
    - `lower`, `upper`: these ends, infinite where the rise stays below within `reach` of the minimum.
    """

    name: str
    x: Float[np.ndarray, " point"]
    rise: Float[np.ndarray, " point"]
    lower: float
    upper: float


def profile(problem: Problem, x: Float[Real, " n"], index: int, *, reach: float = 10.0) -> Profile:
    r"""The interval of {x_i : 2 (min over the others of cost(x) - cost at the minimum) <= 1.96^2}.

    Unlike an interval of Laplace it need not be symmetric in x, and it does not depend on how x is chosen; priors count
    as measurements. The others follow by Gauss-Newton steps from where the last points predict them; the ends are found
    by the secant method in the signed root of the rise, which is linear in x where Laplace is exact.

    **Arguments**: `x` at the minimum (`solve`); `index` of the number among `problem.parameters.names`; `reach` how far
    from the minimum is looked.

    **Errors**: `ValueError` for an index that does not exist, an x of another length, a reach that is not above zero,
    or an x from which another point is found whose cost is lower by more than what would matter: it was no minimum.

    **Source**: Bates and Watts 1988, Nonlinear regression analysis, section 6.1.
    """
    names = problem.parameters.names
    start = np.array(x, float)
    if start.shape != (len(names),):
        raise ValueError(f"x has the shape {list(start.shape)}; the problem has {len(names)} numbers")
    if index not in range(len(names)):
        raise ValueError(f"index {index!r}: the problem has the numbers 0 to {len(names) - 1}")
    if not (np.isfinite(start).all() and reach > 0):
        raise ValueError(f"x has a number that is not finite, or reach = {reach} is not above zero")
    lowest, J = _at(problem, start)
    found = [(float(start[index]), 0.0)]
    ends = []
    for side in (-1.0, 1.0):
        end, points = _one_side(problem, start, index, side, (0.5 * float(lowest @ lowest), J), reach)
        ends.append(end)
        found += points
    found.sort()
    return Profile(names[index], np.array([a for a, _ in found]), np.array([b for _, b in found]), ends[0], ends[1])


def _one_side(problem, start, index, side, minimum, reach) -> tuple[float, list[tuple[float, float]]]:
    """Where the root of the rise is 1.96 on one side, and all points on the way."""
    lowest, J = minimum
    rest = np.arange(len(start)) != index
    x, root, points = start, 0.0, []
    follow, sd = _follow(J, rest, index)
    step, inside, outside = min(QUANTILE * sd, LONGEST), 0.0, np.inf
    for _ in range(MOST_POINTS):
        trial = x.copy()
        trial[index] += side * step
        trial[rest] += follow * side * step
        trial, cost, J = _best_of_others(problem, trial, rest)
        if cost < lowest - 0.01:
            raise ValueError(
                f"{problem.parameters.names[index]}: the cost at {trial[index]:.4g} is {lowest - cost:.3g} lower than "
                "where the profile began; solve again from there"
            )
        before, x, root = (abs(x[index] - start[index]), root), trial, np.sqrt(max(2.0 * (cost - lowest), 0.0))
        apart = abs(x[index] - start[index])
        points.append((float(x[index]), float(root**2)))
        if abs(root - QUANTILE) < CLOSE:
            return float(x[index]), points
        inside, outside = (max(inside, apart), outside) if root < QUANTILE else (inside, min(outside, apart))
        if inside >= reach:
            return side * np.inf, points
        slope = (root - before[1]) / (apart - before[0])
        wanted = apart + (QUANTILE - root) / slope if slope > 0 else np.inf
        wanted = min(wanted, inside + LONGEST, reach)
        if np.isfinite(outside) and not inside < wanted < outside:
            wanted = 0.5 * (inside + outside)
        step, follow = wanted - apart, _follow(J, rest, index)[0]
    return side * np.inf, points


def _follow(J: np.ndarray, rest: np.ndarray, index: int) -> tuple[np.ndarray, float]:
    """How the others go along with the number in the linear problem, and its standard deviation there."""
    follow, *_ = np.linalg.lstsq(J[:, rest], -J[:, index], rcond=None)
    left = float(np.linalg.norm(J[:, index] + J[:, rest] @ follow))
    return follow, 1.0 / left if left > 0 else np.inf


def _best_of_others(problem: Problem, x: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """The others at their best: x, its cost and its Jacobian."""
    r, J = _at(problem, x)
    cost, share = 0.5 * float(r @ r), 1.0
    for _ in range(MOST_STEPS):
        step, *_ = np.linalg.lstsq(J[:, rest], -r, rcond=None)
        promised = cost - 0.5 * float(np.sum((r + J[:, rest] @ step) ** 2))
        if promised < SETTLED:
            break
        while share > 1e-3:
            trial = x.copy()
            trial[rest] += share * step
            there, J_there = _at(problem, trial)
            if 0.5 * float(there @ there) < cost:
                break
            share *= 0.5
        else:
            break
        x, r, J, cost, share = trial, there, J_there, 0.5 * float(there @ there), min(1.0, 2.0 * share)
    return x, cost, J


def _at(problem: Problem, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    residual, data, prior = linearised(problem, x)
    return np.asarray(residual), np.concatenate([np.asarray(data), np.asarray(prior)])
