"""Lemke's complementary pivot method on a condensed dictionary.

The dictionary writes the n basic variables as affine functions of the n + 1 others, at first
``w = M z + d z0 + q``, with the positive covering vector d and the artificial variable z0:

    basic = T @ nonbasic + constant

A pivot exchanges a basic with a nonbasic variable. With the entering column c and the leaving row r of T, p = T_rc,
it is a change of rank one, ``T - u v^T``: u is the column, but p + 1 in the leaving row, v the row over p, but
1 - 1/p in the entering column. A pivot reads one column and one row only, so `DELAY` of these changes are kept aside
and made together, which spares the time of moving T through memory. (Setting row and column to zero and adding to
them would round less, but costs twice the time and was not seen to be more accurate.)

The column of constants has a companion, a perturbation: the method follows the problem with ``q + eps perturbation``
in the limit eps -> 0+. Where the ratio test ties, the perturbation decides, so that a degenerate problem does not cycle
(with probability one for a random perturbation, in exact arithmetic) at a cost of O(n) instead of the O(n^2) of the
lexicographic test that it replaces. The final basis is one of the perturbed problem; a caller that knows which
perturbations are physical thereby chooses the basis, and with it the derivative, of a degenerate solution.

Variables are numbered w: 0 .. n-1, z: n .. 2n-1, z0: 2n; w_i and z_i are partners, one of them nonbasic (both, where
the one that left waits for the other to enter).
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from icjax.compiling import as_one_kernel
from icjax.lcp._residual import residual
from icjax.typing import Float, Real

SOLVED, RAY, BREAKDOWN, MAX_PIVOTS, INVALID = range(5)


class Lemke(eqx.Module):
    """Lemke's method with retries.

    **Fields**

    - `max_pivots`: most pivots an attempt, None for 1000 + 50 n.
    - `attempts`: number of covering vectors tried before a failure is reported: first ones, then three random ones
      between 0.2 and 1 (against breakdown), then random ones between 1e-4 and 1, as likely in each decade (entries of
      one size lead to the same ray again).
    - `tolerance`: largest dimensionless residual that counts as solved (z and Mz + q scaled by
      ``max|q| / max|M|`` and ``max|q|``), None for 1e-10 in float64 and 1e-4 in float32.
    - `pivot_tolerance`: smallest pivot relative to the largest entry of its column, None for 1e-9 in
      float64 and 1e-3 in float32 (where up to n = 120 about one contact problem in 400 is reported unsolved).
    """

    max_pivots: int | None = eqx.field(default=None, static=True)
    attempts: int = eqx.field(default=16, static=True)
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


class _End(NamedTuple):
    basic: jax.Array  # variable of each row, and its value
    constant: jax.Array
    pivots: jax.Array
    code: jax.Array


class _Walk(NamedTuple):
    u: jax.Array  # [DELAY, n], changes that T does not have yet
    v: jax.Array  # [DELAY, n + 1]
    waiting: jax.Array  # number of them
    column: jax.Array  # of the entering variable, up to date
    constant: jax.Array
    perturbation: jax.Array
    basic: jax.Array  # variable of each row
    place: jax.Array  # column of the nonbasic one of each pair of partners
    artificial: jax.Array  # row of z0
    entering: jax.Array  # column of the entering variable, and its number
    variable: jax.Array
    pivots: jax.Array
    code: jax.Array


DELAY = 4
"""Pivots whose changes are made together; 2 to 8 take about the same time for n = 24 to 480."""

LEAST = 16
"""n from which the walk is one kernel. XLA makes one of a loop over less than a kilobyte by itself; one within the
other ends the process."""

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
    others = [random.uniform(0.2, 1.0, (3, n)), 10.0 ** random.uniform(-4.0, 0.0, (max(solver.attempts - 4, 0), n))]
    covers = np.concatenate([np.ones((1, n)), *others])[: max(solver.attempts, 1)]
    keys = random.uniform(1.0, 2.0, (covers.shape[0], n))
    covers, keys = jnp.asarray(covers, q.dtype), jnp.asarray(keys, q.dtype)
    if perturbation is not None:
        keys = keys.at[:2].set(perturbation[None, :])
    tolerance = solver.resolved_tolerance(q.dtype)
    walk = partial(_walk, solver)
    walk = as_one_kernel(walk) if n >= LEAST else walk

    def attempt(best: Outcome) -> Outcome:
        end = walk(M, q, covers[best.attempts], keys[best.attempts], best.attempts > 1)
        z, basis = _point(end)
        ended = end.code == SOLVED
        found = residual(M, q, z)
        found = jnp.where(jnp.isnan(found), jnp.inf, found)
        code = jnp.where(ended & ~(found <= tolerance), BREAKDOWN, end.code)
        code = jnp.where(code == _RUNNING, MAX_PIVOTS, code)
        better = (code == SOLVED) | (found < best.residual)
        return Outcome(
            z=jnp.where(better, z, best.z),
            basis=jnp.where(code == SOLVED, basis, False),
            code=jnp.where(better, code, best.code),
            residual=jnp.where(better, found, best.residual),
            pivots=best.pivots + end.pivots,
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


def _walk(solver: Lemke, M, q, cover, key, hasty) -> _End:
    """One run of pivots from z = 0 along the almost complementary path of one covering vector."""
    n = q.shape[0]
    smallest = solver.resolved_pivot_tolerance(q.dtype)
    slack = float(64 * jnp.finfo(q.dtype).eps)
    most = 1000 + 50 * n if solver.max_pivots is None else solver.max_pivots
    rows = jnp.arange(n, dtype=jnp.int32)

    def pivot(T, walk: _Walk) -> _Walk:
        column, constant = walk.column, walk.constant
        blocking = column < -smallest * jnp.maximum(1.0, jnp.max(jnp.abs(column)))
        size = jnp.where(blocking, jnp.abs(column), 1.0)
        step = jnp.min(jnp.where(blocking, jnp.maximum(constant, 0.0) / size, jnp.inf))
        tied = blocking & (constant - step * size <= slack * (1.0 + jnp.abs(constant)))
        # A vanished z0 can leave at once, at either sign of its pivot: the point already solves the problem.
        artificial = rows == walk.artificial
        vanished = artificial & (constant <= slack) & (jnp.abs(column) > smallest) & (hasty | (step == jnp.inf))
        second = jnp.where(tied, walk.perturbation / size, jnp.inf)
        second = jnp.where(vanished | (hasty & tied & artificial), -jnp.inf, second)
        least, row = _first_least(second)
        ray = least == jnp.inf
        solved = row == walk.artificial
        code = jnp.where(ray, RAY, jnp.where(solved, SOLVED, _RUNNING)).astype(jnp.int32)
        return _exchanged(T, walk, row, ~ray)._replace(code=code)

    def block(state):
        T, walk = state
        walk = lax.while_loop(
            lambda walk: (walk.code == _RUNNING) & (walk.waiting < DELAY) & (walk.pivots < most),
            partial(pivot, T),
            walk,
        )
        for u, v in zip(walk.u, walk.v, strict=True):
            T = T - v[:, None] * u[None, :]
        none = jnp.array(0, jnp.int32)
        return T, walk._replace(u=jnp.zeros_like(walk.u), v=jnp.zeros_like(walk.v), waiting=none)

    # T is kept transposed, so that the column, read most, lies in one piece. The first pivot brings in z0, just large
    # enough that no basic variable is negative.
    T = jnp.concatenate([M.T, cover[None, :]])
    step = jnp.min(q / cover)
    tied = q - step * cover <= slack * (1.0 + jnp.abs(q))
    _, row = _first_least(jnp.where(tied, key / cover, jnp.inf))
    count = [jnp.array(number, jnp.int32) for number in (0, n, 2 * n)]
    running = ~jnp.all(q >= 0)
    start = _Walk(
        u=jnp.zeros((DELAY, n), q.dtype),
        v=jnp.zeros((DELAY, n + 1), q.dtype),
        waiting=count[0],
        column=cover,
        constant=q,
        perturbation=key,
        basic=rows,
        place=rows,
        artificial=jnp.where(running, row, -1),
        entering=count[1],
        variable=count[2],
        pivots=count[0],
        code=jnp.where(running, _RUNNING, SOLVED).astype(jnp.int32),
    )
    first = _exchanged(T, start, row, running)
    first = first._replace(pivots=running.astype(jnp.int32))
    _, end = lax.while_loop(lambda state: (state[1].code == _RUNNING) & (state[1].pivots < most), block, (T, first))
    return _End(end.basic, end.constant, end.pivots, end.code)


def _exchanged(T, walk: _Walk, row, wanted) -> _Walk:
    """If wanted, the entering variable has become basic in a row, and the partner of the one that left enters next."""
    n = walk.basic.shape[0]
    rows, columns = jnp.arange(n, dtype=jnp.int32), jnp.arange(n + 1, dtype=jnp.int32)
    chosen = lax.dynamic_index_in_dim(T, row, 1, keepdims=False)
    for change, v in zip(lax.dynamic_index_in_dim(walk.u, row, 1, keepdims=False), walk.v, strict=True):
        chosen = chosen - change * v
    pivot = walk.column[row]
    inverse = jnp.where(wanted, 1.0 / pivot, 0.0)
    u = jnp.where(rows == row, pivot + 1.0, walk.column)
    v = jnp.where(columns == walk.entering, jnp.where(wanted, 1.0 - inverse, 0.0), chosen * inverse)
    all_u = lax.dynamic_update_index_in_dim(walk.u, u, walk.waiting, 0)
    all_v = lax.dynamic_update_index_in_dim(walk.v, v, walk.waiting, 0)

    def exchanged(values):
        kept = jnp.where((rows == row) & wanted, 0.0, values)
        return kept - jnp.where(rows == row, 1.0, walk.column) * (values[row] * inverse)

    left = walk.basic[row]
    partner = jnp.where(left < n, left + n, left - n)
    pair = jnp.minimum(left, partner)
    pair = jnp.where(pair < n, pair, 0)  # z0 has no partner
    entering = walk.place[pair]
    column = lax.dynamic_index_in_dim(T, entering, 0, keepdims=False)
    for change, u_of in zip(lax.dynamic_index_in_dim(all_v, entering, 1, keepdims=False), all_u, strict=True):
        column = column - change * u_of
    return walk._replace(
        u=all_u,
        v=all_v,
        waiting=walk.waiting + 1,
        column=column,
        constant=exchanged(walk.constant),
        perturbation=exchanged(walk.perturbation),
        basic=jnp.where((rows == row) & wanted, walk.variable, walk.basic),
        place=jnp.where((rows == pair) & wanted & (left < 2 * n), walk.entering, walk.place),
        entering=entering,
        variable=partner,
        pivots=walk.pivots + 1,
    )


def _first_least(values):
    """The least value and the first place where it is; the last place of all where no value is finite."""
    n = values.shape[0]

    def lesser(a, b):
        before = (a[0] < b[0]) | ((a[0] == b[0]) & (a[1] < b[1]))
        return jnp.where(before, a[0], b[0]), jnp.where(before, a[1], b[1])

    infinite = jnp.array(jnp.inf, values.dtype)
    places = jnp.arange(n, dtype=jnp.int32)
    return lax.reduce((values, places), (infinite, jnp.array(n - 1, jnp.int32)), lesser, (0,))


def _point(end: _End):
    """The basic point z (never negative) and which z are basic."""
    n = end.basic.shape[0]
    place = jnp.where((end.basic >= n) & (end.basic < 2 * n), end.basic - n, n)
    value = jnp.where(jnp.isfinite(end.constant), jnp.maximum(end.constant, 0.0), 0.0)
    z = jnp.zeros_like(value).at[place].set(value, mode="drop")
    return z, jnp.zeros(n, bool).at[place].set(True, mode="drop")
