"""Levenberg-Marquardt from many starts in small batches, finished ones leaving; a schedule for starts that fail.

Started directly from 40 starts of a full C and contact rollouts, 17 ended at the truth. In 13 friction ran away, to
zero or beyond what ever slips, where forces no longer depend on it; in 9 C went to the edge of the positive definite
matrices with contacts in the wrong state, in 1 it stopped with wrong states alone.

The schedule has less friction and soft forces, with priors that hold x near its start, then the exact problem. It
takes both: with less friction alone 14 ended at the truth, by the schedule 40. Starting C and theta_r from static
equilibrium with measured angles and forces (off by 0.4 of C, since a rollout's steps take the Jacobian at their start)
does not help friction: 18 as drawn, 40 with less.
"""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from icjax.fit import Problem
from icjax.inference import Cholesky, least_squares
from icjax.results import RESULTS

SOFT_FORCES = 0.1
"""Weight of all residuals in the first stage of the schedule, where priors hold x near its start."""

LOWERED = 0.2
"""Share of its start at which the schedule begins friction: where nothing slips, forces do not depend on it."""

PRIOR = 0.5
"""Standard deviation of these priors: of logarithms, and of the reference in units of 0.1 rad."""

ZERO = 1e-16
"""Sum of squares, in standard deviations, below which a start is taken as found: noise-free data of the model itself
have a minimum of zero, so that no start needs the truth to know that it failed. Along the direction that the data see
least, of singular value 0.8, this leaves 1e-8. Measured data would be held against the number of residuals instead."""


class Minimiser:
    """One compiled function for all stages: weights of the data and of the priors are arguments.

    A full C takes its steps in its entries, not in those of its Cholesky factor: angles in equilibrium are
    theta_r + C tau, nearly linear in the entries of C. In the factor the least visible direction, through three
    entries of the factor, is a curved and narrow valley (singular values 5000 to 0.8), and steps grow only as far as
    its curvature lets them: of 40 starts, 17, 29 and 39 were at the truth after 20, 40 and 80 steps of the schedule's
    last stage, the others on the way; in the entries all 40 within 20. A step that leaves the positive definite
    matrices has no factor, its residual is not finite, and it is refused.

    `icjax.fit.multi_start` is the same method from optimistix; there a batch steps until its slowest start is finished
    and compiles for minutes (about 150 s for this problem), so that a hundred rollouts take hours on two cores.
    """

    def __init__(self, problem: Problem, batch: int = 20, steps: int = 20):
        self.batch, self.problem = batch, problem
        size = problem.parameters.size
        self.scale = np.full(size, PRIOR)
        self.scale[problem.parameters.slices["reference"]] = 0.1 * PRIOR
        retract = by_entries(problem)

        def residual(x, given):
            weight, prior, centre = given
            return jnp.concatenate([weight * problem.data(x), prior * (x - centre) / self.scale])

        @jax.jit
        def minimise(x, weight, prior, centre):
            given = weight, prior, centre
            return least_squares(
                residual, x, given, nv=size, retract=retract, tolerance=1e-11, damping=1e-2, max_steps=steps
            )

        self._minimise = minimise

    def lowered(self, starts: np.ndarray) -> np.ndarray:
        """The same with less friction, so that contacts slip and forces tell of it."""
        found = starts.copy()
        for name, place in self.problem.parameters.slices.items():
            if name.startswith("friction"):
                found[:, place] += np.log(LOWERED)
        return found

    def __call__(self, starts: np.ndarray, weight: float, prior: float, rounds: int) -> tuple[np.ndarray, np.ndarray]:
        """x after at most `rounds` times `steps` steps, each start in a batch of those that are not finished, and the
        sums of squares there, infinite where a start never had one."""
        x, cost, open_ = starts.copy(), np.full(len(starts), np.inf), np.arange(len(starts))
        for _ in range(rounds):
            left = []
            for first in range(0, len(open_), self.batch):
                rows = open_[first : first + self.batch]
                padded = np.resize(rows, self.batch)  # repeats some to fill the batch
                constant = np.full((self.batch,), weight), np.full((self.batch,), prior)
                found = self._minimise(x[padded], *constant, starts[padded])
                value, squares = (np.asarray(part)[: len(rows)] for part in (found.value.value, found.value.cost))
                finite = np.isfinite(value).all(axis=1) & np.isfinite(squares)
                x[rows[finite]], cost[rows[finite]] = value[finite], squares[finite]
                done = np.asarray(found.result == RESULTS.solved)[: len(rows)]
                left.append(rows[~done & finite])
            open_ = np.concatenate(left) if left else open_[:0]
            if not len(open_):
                break
        return x, cost


def by_entries(problem: Problem) -> Callable[[Any, Any], Any]:
    """x + dx, but where C is full its part of dx changes the entries of C, in units of its transform's scales."""
    transform, place = problem.parameters["compliance"].transform, problem.parameters.slices["compliance"]
    if not isinstance(transform, Cholesky):
        return jnp.add
    size, lower = np.asarray(transform.scale), np.tril_indices(transform.order)

    def retract(x, dx):
        change = jnp.zeros((transform.order, transform.order)).at[lower].set(dx[place])
        change = (change + change.T) * size[:, None] * size[None, :]
        return (x + dx).at[place].set(transform.free(transform.value(x[place]) + change))

    return retract


def recovered(
    minimise: Minimiser, draw: Callable[[int], np.ndarray], good: Callable[[Any], bool], count: int, restarts: int
) -> tuple[dict[str, int], np.ndarray, np.ndarray]:
    """How many starts have reached the truth: directly, by the schedule, by the schedule from other starts.

    A start goes to the next stage while its residual is not `ZERO`; the truth only counts.

    **Returns**: the counts, and for every start where it began and where it ended.
    """
    begin = time.perf_counter()
    starts = draw(count)
    ended, squares, told = starts.copy(), np.full(count, np.inf), {}
    missing = np.arange(count)
    stages = ["direct", "schedule", *(f"schedule, start {number + 2}" for number in range(restarts))]
    for number, stage in enumerate(stages):
        here = starts[missing] if number < 2 else draw(len(missing))
        soft = here if number == 0 else minimise(minimise.lowered(here), SOFT_FORCES, 1.0, 1)[0]
        ended[missing], squares[missing] = minimise(soft, 1.0, 0.0, 2)
        right = np.array([good(x) for x in ended])
        missing = np.flatnonzero(squares > ZERO)
        told[stage] = int(right.sum())
        wrong = int(np.sum(~right & (squares <= ZERO)))
        print(
            f"  {stage}: {told[stage]} of {count} after {time.perf_counter() - begin:.0f} s, "
            f"{len(missing)} with a residual, {wrong} without one elsewhere",
            flush=True,
        )
        if not len(missing):
            break
    return told | {"no residual, not the truth": wrong}, starts, ended
