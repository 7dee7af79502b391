"""Levenberg-Marquardt from many starts in small batches, finished ones leaving; a schedule for starts that fail."""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from icjax.fit import Problem
from icjax.inference import least_squares
from icjax.results import RESULTS

SOFT_FORCES = 0.1
"""Weight of all residuals in the first stage of the schedule, where priors hold x near its start."""

LOWERED = 0.2
"""Share of its start at which the schedule begins friction: where nothing slips, forces do not depend on it."""

PRIOR = 0.5
"""Standard deviation of these priors: of logarithms, and of the reference in units of 0.1 rad."""


class Minimiser:
    """One compiled function for all stages: weights of the data and of the priors are arguments.

    `icjax.fit.multi_start` is the same method from optimistix; there a batch steps until its slowest start is finished
    and compiles for minutes (about 150 s for this problem), so that a hundred rollouts take hours on two cores.
    """

    def __init__(self, problem: Problem, batch: int = 20, steps: int = 10):
        self.batch, self.steps, self.problem = batch, steps, problem
        size = problem.parameters.size
        place = problem.parameters.slices["reference"]
        self.scale = np.full(size, PRIOR)
        self.scale[place] = 0.1 * PRIOR

        def residual(x, given):
            weight, prior, centre = given
            return jnp.concatenate([weight * problem.data(x), prior * (x - centre) / self.scale])

        @jax.jit
        def minimise(x, weight, prior, centre):
            return least_squares(
                residual, x, (weight, prior, centre), nv=size, tolerance=1e-11, damping=1e-2, max_steps=steps
            )

        self._minimise = minimise

    def lowered(self, starts: np.ndarray) -> np.ndarray:
        """The same with less friction, so that contacts slip and forces tell of it."""
        found = starts.copy()
        for name, place in self.problem.parameters.slices.items():
            if name.startswith("friction"):
                found[:, place] += np.log(LOWERED)
        return found

    def __call__(self, starts: np.ndarray, weight: float, prior: float, rounds: int) -> np.ndarray:
        """x after at most `rounds` times `steps` steps, each start in a batch of those that are not finished."""
        x, open_ = starts.copy(), np.arange(len(starts))
        for _ in range(rounds):
            left = []
            for first in range(0, len(open_), self.batch):
                rows = open_[first : first + self.batch]
                padded = np.resize(rows, self.batch)  # repeats some to fill the batch
                constant = np.full((self.batch,), weight), np.full((self.batch,), prior)
                found = self._minimise(x[padded], *constant, starts[padded])
                finite = np.isfinite(np.asarray(found.value.value[: len(rows)])).all(axis=1)
                x[rows[finite]] = np.asarray(found.value.value)[: len(rows)][finite]
                done = np.asarray(found.result == RESULTS.solved)[: len(rows)]
                left.append(rows[~done & finite])
            open_ = np.concatenate(left) if left else open_[:0]
            if not len(open_):
                break
        return x


def recovered(
    minimise: Minimiser, draw: Callable[[int], np.ndarray], good: Callable[[Any], bool], count: int, restarts: int
) -> tuple[dict[str, int], np.ndarray, np.ndarray]:
    """How many starts have reached the truth: directly, by the schedule, by the schedule from other starts.

    **Returns**: the counts, and for every start where it began and where it ended.
    """
    begin = time.perf_counter()
    starts = draw(count)
    ended, told = starts.copy(), {}
    missing = np.arange(count)
    stages = ["direct", "schedule", *(f"schedule, start {number + 2}" for number in range(restarts))]
    for number, stage in enumerate(stages):
        here = starts[missing] if number < 2 else draw(len(missing))
        soft = here if number == 0 else minimise(minimise.lowered(here), SOFT_FORCES, 1.0, 2)
        ended[missing] = minimise(soft, 1.0, 0.0, 4)
        missing = np.array([i for i in missing if not good(ended[i])], int)
        told[stage] = count - len(missing)
        print(f"  {stage}: {told[stage]} of {count} after {time.perf_counter() - begin:.0f} s", flush=True)
        if not len(missing):
            break
    return told, starts, ended
