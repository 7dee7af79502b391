"""Lemke's complementary pivot method on a condensed dictionary.

The dictionary writes the n basic variables as affine functions of the n + 1 others, at first
``w = M z + d z0 + q``, with the positive covering vector d and the artificial variable z0:

    basic = table[:, :n+1] @ nonbasic + table[:, n]        (and one more column, see below)

A pivot exchanges one basic with one nonbasic variable and rewrites the n x (n + 3) table in one pass. The last
column carries a perturbation p: the method follows the problem with ``q + eps p`` in the limit eps -> 0+. Where the
ratio test ties, the perturbation decides, so that a degenerate problem does not cycle (with probability one for a
random p, in exact arithmetic) at a cost of O(n) instead of the O(n^2) of the lexicographic test that it replaces.
The final basis is one of the perturbed problem; a caller that knows which perturbations are physical thereby
chooses the basis, and with it the derivative, of a degenerate solution.

Variables are numbered w: 0 .. n-1, z: n .. 2n-1, z0: 2n.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from icjax.lcp._residual import residual
from icjax.typing import Float, Real

SOLVED, RAY, BREAKDOWN, MAX_PIVOTS, INVALID = range(5)


class Lemke(eqx.Module):
    """Lemke's method with retries.

    **Fields**

    - `max_pivots`: most pivots an attempt, None for 1000 + 50 n.
    - `attempts`: number of covering vectors tried before a failure is reported (first ones, then random ones).
    - `tolerance`: largest dimensionless residual that counts as solved (z and Mz + q scaled by
      ``max|q| / max|M|`` and ``max|q|``), None for 1e-10 in float64 and 1e-4 in float32.
    - `pivot_tolerance`: smallest pivot relative to the largest entry of its column, None for 1e-9 in
      float64 and 1e-3 in float32 (where up to n = 120 about one contact problem in 400 is reported unsolved).
    """

    max_pivots: int | None = eqx.field(default=None, static=True)
    attempts: int = eqx.field(default=4, static=True)
    tolerance: float | None = eqx.field(default=None, static=True)
    pivot_tolerance: float | None = eqx.field(default=None, static=True)

    def resolved_tolerance(self, dtype: np.dtype) -> float:
        """The residual that counts as solved for this floating-point type."""
        default = 1e-10 if np.dtype(dtype).itemsize >= 8 else 1e-4
        return default if self.tolerance is None else self.tolerance

    def resolved_pivot_tolerance(self, dtype: np.dtype) -> float:
        """The smallest relative pivot for this floating-point type."""
        default = 1e-9 if np.dtype(dtype).itemsize >= 8 else 1e-3
        return default if self.pivot_tolerance is None else self.pivot_tolerance


class Outcome(NamedTuple):
    """What the pivoting leaves: the point, its basis, and the account of it (dimensionless residual)."""

    z: Real
    basis: Real
    code: Real
    residual: Real
    pivots: Real
    attempts: Real


class _Walk(NamedTuple):
    table: jax.Array
    labels: jax.Array  # variable of each row, then of each of the n + 1 columns
    entering: jax.Array  # column
    pivots: jax.Array
    code: jax.Array


_RUNNING = -1


def lemke(
    solver: Lemke, M: Float[Real, "n n"], q: Float[Real, " n"], perturbation: Float[Real, " n"] | None = None
) -> Outcome:
    """Solves a finite LCP whose entries are of order one; retries with other covering vectors until solved.

    The first two attempts follow the given perturbation to its end; the others follow random positive ones, and let
    z0 leave as soon as it can.
    """
    n = q.shape[0]
    random = np.random.default_rng(20061)
    covers = np.concatenate([np.ones((1, n)), random.uniform(0.2, 1.0, (max(solver.attempts - 1, 0), n))])
    keys = random.uniform(1.0, 2.0, (covers.shape[0], n))
    covers, keys = jnp.asarray(covers, q.dtype), jnp.asarray(keys, q.dtype)
    if perturbation is not None:
        keys = keys.at[:2].set(perturbation[None, :])
    tolerance = solver.resolved_tolerance(q.dtype)

    def attempt(best: Outcome) -> Outcome:
        walk = _walk(solver, M, q, covers[best.attempts], keys[best.attempts], best.attempts > 1)
        z, basis = _point(walk)
        ended = walk.code == SOLVED
        found = residual(M, q, z)
        found = jnp.where(jnp.isnan(found), jnp.inf, found)
        code = jnp.where(ended & ~(found <= tolerance), BREAKDOWN, walk.code)
        code = jnp.where(code == _RUNNING, MAX_PIVOTS, code)
        better = (code == SOLVED) | (found < best.residual)
        return Outcome(
            z=jnp.where(better, z, best.z),
            basis=jnp.where(code == SOLVED, basis, False),
            code=jnp.where(better, code, best.code),
            residual=jnp.where(better, found, best.residual),
            pivots=best.pivots + walk.pivots,
            attempts=best.attempts + 1,
        )

    start = Outcome(
        z=jnp.zeros_like(q),
        basis=jnp.zeros(n, bool),
        code=jnp.array(BREAKDOWN, jnp.int32),
        residual=jnp.array(jnp.inf, q.dtype),
        pivots=jnp.array(0, jnp.int32),
        attempts=jnp.array(0, jnp.int32),
    )
    return lax.while_loop(lambda best: (best.code != SOLVED) & (best.attempts < covers.shape[0]), attempt, start)


def _walk(solver: Lemke, M, q, cover, key, hasty) -> _Walk:
    """One run of pivots from z = 0 along the almost complementary path of one covering vector."""
    n = q.shape[0]
    smallest = solver.resolved_pivot_tolerance(q.dtype)
    slack = float(64 * jnp.finfo(q.dtype).eps)
    most = 1000 + 50 * n if solver.max_pivots is None else solver.max_pivots

    def pivot(walk: _Walk) -> _Walk:
        table, labels = walk.table, walk.labels
        column = lax.dynamic_index_in_dim(table, walk.entering, 1, keepdims=False)
        constant, perturbation = table[:, n + 1], table[:, n + 2]
        # The first pivot brings in z0, just large enough that no basic variable is negative.
        first = walk.pivots == 0
        blocking = first | (column < -smallest * jnp.maximum(1.0, jnp.max(jnp.abs(column))))
        size = jnp.where(blocking, jnp.abs(column), 1.0)
        ratio = jnp.where(first, constant, jnp.maximum(constant, 0.0)) / size
        step = jnp.min(jnp.where(blocking, ratio, jnp.inf))
        left = jnp.where(blocking, constant - step * size, jnp.inf)
        tied = left <= slack * (1.0 + jnp.abs(constant))
        # A vanished z0 can leave at once, at either sign of its pivot: the point already solves the problem.
        artificial = labels[:n] == 2 * n
        vanished = artificial & (constant <= slack) & (jnp.abs(column) > smallest) & (hasty | ~jnp.any(blocking))
        second = jnp.where(tied, perturbation / size, jnp.inf)
        second = jnp.where(vanished | (hasty & tied & artificial), -jnp.inf, second)
        row = jnp.argmin(second).astype(jnp.int32)
        ray = ~jnp.any(tied | vanished)
        leaving = labels[row]
        partner = jnp.where(leaving < n, leaving + n, leaving - n)
        table, labels = _exchange(table, labels, row, walk.entering, column, ~ray)
        return _Walk(
            table=table,
            labels=labels,
            entering=jnp.argmax(labels[n:] == partner).astype(jnp.int32),
            pivots=walk.pivots + 1,
            code=jnp.where(ray, RAY, jnp.where(leaving == 2 * n, SOLVED, _RUNNING)).astype(jnp.int32),
        )

    start = _Walk(
        table=jnp.concatenate([M, cover[:, None], q[:, None], key[:, None]], axis=1),
        labels=jnp.arange(2 * n + 1, dtype=jnp.int32),
        entering=jnp.array(n, jnp.int32),
        pivots=jnp.array(0, jnp.int32),
        code=jnp.where(jnp.all(q >= 0), SOLVED, _RUNNING).astype(jnp.int32),
    )
    return lax.while_loop(lambda walk: (walk.code == _RUNNING) & (walk.pivots < most), pivot, start)


def _exchange(table, labels, row, entering, column, wanted):
    """If wanted, the Gauss-Jordan exchange of a row's basic with a column's nonbasic variable, in one pass."""
    n = table.shape[0]
    chosen = lax.dynamic_index_in_dim(table, row, 0, keepdims=False)
    pivot = chosen[entering]
    scaled = jnp.where(wanted, chosen / pivot, 0.0)
    in_row = ((jnp.arange(n) == row) & wanted)[:, None]
    in_column = ((jnp.arange(table.shape[1]) == entering) & wanted)[None, :]
    swept = table - column[:, None] * scaled[None, :]
    new = jnp.where(
        in_row,
        jnp.where(in_column, 1.0 / pivot, -scaled[None, :]),
        jnp.where(in_column, (column / pivot)[:, None], swept),
    )
    index = jnp.where(wanted, jnp.arange(labels.shape[0]), -1)
    swapped = jnp.where(index == row, labels[n + entering], labels)
    return new, jnp.where(index == n + entering, labels[row], swapped)


def _point(walk: _Walk):
    """The basic point z (never negative) and which z are basic."""
    n = walk.table.shape[0]
    basic, constant = walk.labels[:n], walk.table[:, n + 1]
    place = jnp.where((basic >= n) & (basic < 2 * n), basic - n, n)
    value = jnp.where(jnp.isfinite(constant), jnp.maximum(constant, 0.0), 0.0)
    z = jnp.zeros_like(constant).at[place].set(value, mode="drop")
    return z, jnp.zeros(n, bool).at[place].set(True, mode="drop")
