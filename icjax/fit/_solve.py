"""Minimise a problem: progress, cancellation, checkpoint, many starts."""

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from icjax.fit._bounded import bounded
from icjax.fit._checkpoint import read_checkpoint, write_checkpoint
from icjax.fit._problem import Problem
from icjax.inference import jacobian
from icjax.results import RESULTS, Solution
from icjax.typing import Float, Real

RESOLVED, STILL = 1e-12, 3
"""Relative decrease of the cost that double precision still tells from none, and steps in a row without it (or without
the tolerance) after which Levenberg-Marquardt looks how far the minimum is: steps are accepted and refused by chance
there, or go from one side of the minimum to the other where residuals bend."""

Solver = Literal["levenberg_marquardt", "bfgs", "lbfgsb"]


class Progress(NamedTuple):
    """What a listener is told after every step: of all stages, `stage` counts from zero; `remaining` s if all steps are
    needed, at the pace of those after the first, which compiles; NaN at the first."""

    stage: int
    step: int
    cost: float
    seconds: float
    remaining: float


class Minimum(eqx.Module):
    """Where a solver ended: `x`, `cost` (half the sum of squares), `gradient` there."""

    x: Float[Real, " n"]
    cost: Float[Real, ""]
    gradient: Float[Real, " n"]


def solve(
    problem: Problem | Sequence[Problem],
    start: Float[Real, " n"] | None = None,
    *,
    solver: Solver = "levenberg_marquardt",
    tolerance: float = 1e-8,
    max_steps: int = 100,
    progress: Callable[[Progress], Any] | None = None,
    cancelled: Callable[[], bool] | None = None,
    checkpoint: str | os.PathLike | None = None,
    keep_checkpoint: bool = False,
) -> Solution[Minimum]:
    """Minimise half the sum of squares of a problem's residuals.

    Several problems with the same parameters are solved one after the other, each from where the last ended: from a
    smoothed contact, whose derivative sees contacts before they touch, to the exact one.

    **Arguments**

    - `problem`: or a sequence of them. `start`: x, default the nominal values.
    - `solver`: "levenberg_marquardt" (optimistix; uses that the cost is a sum of squares), "bfgs" (optimistix; needs
      only gradients), "lbfgsb" (jaxopt; within the bounds that `Logistic` transforms do not cover: x within 20 of the
      start).
    - `tolerance`: relative, of x and of the cost; Levenberg-Marquardt also ends where the cost hardly falls and the
      minimum is within sqrt(tolerance) standard deviations. `max_steps`: of every stage.
    - `progress`: told a `Progress` after every step. `cancelled`: asked before each; the best x so far is returned
      with the result `not_converged`.
    - `checkpoint`: file, complete or not at all, that holds stage and x after every step, and the cost of the nominal
      values, which tells problems apart; a later call goes on from
      it, and it is removed at the end unless `keep_checkpoint`. It starts the step's damping anew.

    **Returns** `result` `solved`, `not_converged` (steps, cancelled) or `invalid_input` (a residual that is not
    finite at the start); `stats` has `steps`, `evaluations` and `seconds`.

    **Errors**: `ValueError` for a start of the wrong length, a tolerance that is not between 0 and 1, and for a
    checkpoint of another problem.
    """
    _check_effort(tolerance, max_steps)
    stages = (problem,) if isinstance(problem, Problem) else tuple(problem)
    if not stages:
        raise ValueError("problem: an empty sequence")
    size = stages[0].parameters.size
    x = stages[0].parameters.start if start is None else jnp.asarray(start)
    if x.shape != (size,):
        raise ValueError(f"start has the shape {x.shape}; the parameters that are not frozen have {size} numbers")
    if solver not in ("levenberg_marquardt", "bfgs", "lbfgsb"):
        raise ValueError(f"solver = {solver!r}: must be 'levenberg_marquardt', 'bfgs' or 'lbfgsb'")
    begin, steps, evaluations, first = time.perf_counter(), 0, 0, 0
    result = RESULTS.solved
    mark = float(_cost(stages[0], stages[0].parameters.start)) if checkpoint is not None else 0.0
    if checkpoint is not None and Path(checkpoint).is_file():
        first, x = read_checkpoint(Path(checkpoint), size, len(stages), mark)
    ended: list[float] = []
    run = bounded if solver == "lbfgsb" else _stepwise
    for number, stage in enumerate(stages):
        if number < first:
            continue
        if not np.isfinite(float(_cost(stage, x))):
            result = RESULTS.invalid_input
            break

        def told(x, cost, step, number=number):
            if checkpoint is not None:
                write_checkpoint(Path(checkpoint), number, np.asarray(x), mark)
            if progress is not None:
                spent = time.perf_counter() - begin
                ended.append(spent)
                pace = (spent - ended[0]) / (len(ended) - 1) if len(ended) > 1 else float("nan")
                left = (len(stages) - number) * max_steps - step
                progress(Progress(number, step, cost, spent, pace * left))

        x, done, count = run(stage, x, solver, tolerance, max_steps, told, cancelled or (lambda: False))
        steps, evaluations = steps + count, evaluations + count + 1
        result = RESULTS.solved if done else RESULTS.not_converged
        if cancelled is not None and cancelled() and not done:
            break
    cost, gradient = _cost_and_gradient(stages[-1], x)
    if result == RESULTS.solved and checkpoint is not None and not keep_checkpoint:
        Path(checkpoint).unlink(missing_ok=True)
    stats = {"steps": steps, "evaluations": evaluations, "seconds": time.perf_counter() - begin}
    return Solution(value=Minimum(x, cost, gradient), result=result, stats=stats)


def multi_start(
    problem: Problem,
    starts: Float[Real, "start n"],
    *,
    tolerance: float = 1e-8,
    max_steps: int = 100,
    batch: int | None = None,
) -> Solution[Minimum]:
    """Levenberg-Marquardt from many starts at once (`vmap`).

    **Arguments**: `starts` x of each; `batch` how many at once, default all.

    **Returns** a batched `Solution`: `value.x` `[start, n]`, `result` of each; take the least `cost` of the solved.

    **Errors**: `ValueError` for starts of the wrong shape and a tolerance that is not between 0 and 1.
    """
    _check_effort(tolerance, max_steps)
    size = problem.parameters.size
    if np.ndim(starts) != 2 or np.shape(starts)[1] != size:
        raise ValueError(f"starts has the shape {np.shape(starts)}; must be [start, {size}], the numbers not frozen")
    value, result, steps = _from_each(problem, jnp.asarray(starts), tolerance, max_steps, batch)
    return Solution(value=value, result=result, stats={"steps": steps})


def _check_effort(tolerance: float, max_steps: int) -> None:
    if not 0 < tolerance < 1:
        raise ValueError(f"tolerance = {tolerance}: must be between 0 and 1, it is relative")
    if max_steps < 0:
        raise ValueError(f"max_steps = {max_steps}: must not be negative")


@eqx.filter_jit
def _from_each(problem, starts, tolerance, max_steps, batch):
    def one(x):
        found = optx.least_squares(
            lambda x, problem: problem.residual(x),
            optx.LevenbergMarquardt(tolerance, tolerance),
            x,
            problem,
            max_steps=max_steps,
            throw=False,
        )
        good = (found.result == optx.RESULTS.successful) & jnp.all(jnp.isfinite(found.value))
        cost, gradient = jax.value_and_grad(problem.cost)(found.value)
        result = RESULTS.where(good, RESULTS.solved, RESULTS.not_converged)
        return Minimum(found.value, cost, gradient), result, found.stats["num_steps"]

    if batch is None:
        return eqx.filter_vmap(one)(starts)
    return jax.lax.map(one, starts, batch_size=batch)


def _stepwise(problem, x, solver, tolerance, max_steps, told, cancelled):
    """optimistix, one compiled step at a time; another problem of the same form compiles nothing new."""
    least = solver == "levenberg_marquardt"
    method: Any = (optx.LevenbergMarquardt if least else optx.BFGS)(tolerance, tolerance)
    function = _residual_of if least else _cost_of
    state, last, still = _begin(method, function, x, problem), np.inf, 0
    for step in range(1, max_steps + 1):
        if cancelled():
            return x, False, step - 1
        before = x
        x, state, done, well, cost = _advance(method, function, x, problem, state)
        told(x, float(cost), step)
        if bool(done):
            return x, bool(well), step
        still = still + 1 if last - float(cost) <= max(RESOLVED, tolerance) * float(cost) else 0
        if least and still % STILL == STILL - 1:
            if _distance(problem, x) < tolerance**0.5:
                return x, True, step
            between = _between(problem, before, x, last, float(cost))
            if between is not None:
                x, state = between, _begin(method, function, between, problem)
        last = float(cost)
    return x, False, max_steps


def _between(problem: Problem, before: jax.Array, after: jax.Array, last: float, cost: float) -> jax.Array | None:
    """Least of a parabola through the cost at both ends of a step and half-way, if it lies lower than both; where steps
    go from one side of the minimum to the other it lies close to it."""
    middle = float(_cost(problem, 0.5 * (before + after)))
    bend = last - 2.0 * middle + cost
    if not (middle < cost and bend > 0):
        return None
    share = float(np.clip(0.5 + 0.25 * (last - cost) / bend, 0.0, 1.0))
    found = before + share * (after - before)
    return found if float(_cost(problem, found)) < cost else None


def _distance(problem: Problem, x: jax.Array) -> float:
    """Length of the Gauss-Newton step to the minimum in standard deviations, |P r| with P the projection on J."""
    r, data, prior = linearised(problem, x)
    J = np.concatenate([np.asarray(data), np.asarray(prior)])
    norm = np.linalg.norm(J, axis=0)
    Q, _ = np.linalg.qr(J / np.where(norm > 0, norm, 1.0))
    return float(np.linalg.norm(Q.T @ np.asarray(r)))


@eqx.filter_jit
def linearised(problem: Problem, x: Float[Real, " n"]) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Residual with priors, and the Jacobians of data and of priors."""
    return jnp.asarray(problem.residual(x)), jacobian(problem.data, x), jacobian(problem.parameters.prior, x)


def _residual_of(x, problem):
    return problem.residual(x), None


def _cost_of(x, problem):
    return problem.cost(x), None


@eqx.filter_jit
def _begin(method, function, x, problem):
    shape = jax.eval_shape(lambda x: function(x, problem)[0], x)
    return method.init(function, x, problem, {}, shape, None, frozenset())


@eqx.filter_jit
def _advance(method, function, x, problem, state):
    x, state, _ = method.step(function, x, problem, {}, state, frozenset())
    done, result = method.terminate(function, x, problem, {}, state, frozenset())
    return x, state, done, result == optx.RESULTS.successful, state.f_info.as_min()


@eqx.filter_jit
def _cost(problem, x):
    return problem.cost(x)


@eqx.filter_jit
def _cost_and_gradient(problem, x):
    return jax.value_and_grad(problem.cost)(x)
