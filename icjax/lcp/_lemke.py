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

from icjax.lcp._residual import tolerance
from icjax.typing import Real

SOLVED, RAY, BREAKDOWN, MAX_PIVOTS, INVALID = range(5)


class Lemke(eqx.Module):
    """Lemke's method with retries.

    **Fields**

    - `max_pivots`: most pivots an attempt, None for 1000 + 50 n.
    - `attempts`: number of covering vectors tried before a failure is reported: first ones, then three random ones
      between 0.2 and 1 (against breakdown), then random ones between 1e-4 and 1, as likely in each decade (entries of
      one size lead to the same ray again).
    - `tolerance`: largest dimensionless residual that counts as solved (z and Mz + q scaled by
      ``max|q| / max|M|`` and ``max|q|``), None for 5e-11 in float64 and 5e-5 in float32.
    - `pivot_tolerance`: smallest pivot relative to the largest entry of its column, None for 1e-9 in
      float64 and 1e-3 in float32 (where up to n = 120 about one contact problem in 400 is reported unsolved).
    """

    max_pivots: int | None = eqx.field(default=None, static=True)
    attempts: int = eqx.field(default=16, static=True)
    tolerance: float | None = eqx.field(default=None, static=True)
    pivot_tolerance: float | None = eqx.field(default=None, static=True)

    def resolved_tolerance(self, dtype: np.dtype) -> float:
        """The residual that counts as solved for this floating-point type."""
        return tolerance(self.tolerance, dtype)

    def resolved_pivot_tolerance(self, dtype: np.dtype) -> float:
        """The smallest relative pivot for this floating-point type."""
        default = 1e-9 if np.dtype(dtype).itemsize >= 8 else 1e-3
        return default if self.pivot_tolerance is None else self.pivot_tolerance


class Outcome(NamedTuple):
    """What the pivoting leaves: the point, its basis, and the account of it."""

    z: Real
    basis: Real
    code: Real
    residual: Real
    """of the scaled problem"""
    absolute: Real
    """residual of the problem as given"""
    pivots: Real
    attempts: Real


class _End(NamedTuple):
    z: jax.Array  # the basic point, never negative
    basis: jax.Array  # which z are basic
    pivots: jax.Array
    code: jax.Array


class _Walk(NamedTuple):
    u: jax.Array  # [DELAY, n], changes that T does not have yet; those not waiting have v = 0
    v: jax.Array  # [DELAY, n + 1]
    waiting: jax.Array  # number of them
    column: jax.Array  # of the entering variable, up to date
    constants: jax.Array  # [2, n], with the perturbation
    basic: jax.Array  # variable of each row
    row: jax.Array  # of the basic one of each pair of partners
    place: jax.Array  # column of the nonbasic one
    artificial: jax.Array  # row of z0
    entering: jax.Array  # column of the entering variable, and its number
    variable: jax.Array
    pivots: jax.Array
    code: jax.Array


DELAY = 8
"""Pivots whose changes are made together; 6 to 12 take about the same time for n = 24 to 480."""

_RUNNING = -1


def lemke(solver: Lemke, M, q, scales, valid, perturbation=None) -> Outcome:
    """Solves an LCP whose entries times the scales of M and q, powers of two, are of order one; retries with other
    covering vectors until solved. What is not valid ends at once, at zero.

    The first two attempts follow the given perturbation to its end; the others follow random positive ones, and let
    z0 leave as soon as it can.
    """
    n = q.shape[0]
    random = np.random.default_rng(20061)
    others = [random.uniform(0.2, 1.0, (3, n)), 10.0 ** random.uniform(-4.0, 0.0, (max(solver.attempts - 4, 0), n))]
    covers = np.concatenate([np.ones((1, n)), *others])[: max(solver.attempts, 1)]
    keys = random.uniform(1.0, 2.0, (covers.shape[0], n))
    covers, keys = jnp.asarray(covers, q.dtype), jnp.asarray(keys, q.dtype)
    reached = solver.resolved_tolerance(q.dtype)
    scale_M, scale_q = scales
    scaled_q = jnp.where(valid, q * scale_q, 1.0)

    def attempt(best: Outcome) -> Outcome:
        hasty = best.attempts > 1
        key = keys[best.attempts]
        key = key if perturbation is None else jnp.where(hasty, key, perturbation)
        end = _walk(solver, M, scale_M, scaled_q, covers[best.attempts], key, hasty)
        w = jnp.matmul(M, end.z, precision=lax.Precision.HIGHEST) * scale_M + scaled_q
        found = jnp.max(jnp.abs(jnp.minimum(end.z, w)))
        found = jnp.where(jnp.isnan(found), jnp.inf, found)
        code = jnp.where((end.code == SOLVED) & ~(found <= reached), BREAKDOWN, end.code)
        code = jnp.where(code == _RUNNING, MAX_PIVOTS, code)
        z = end.z * (scale_M / scale_q)
        better = (code == SOLVED) | (found < best.residual)
        return Outcome(
            z=jnp.where(better, z, best.z),
            basis=jnp.where(code == SOLVED, end.basis, False),
            code=jnp.where(better, code, best.code),
            residual=jnp.where(better, found, best.residual),
            absolute=jnp.where(better, jnp.max(jnp.abs(jnp.minimum(z, w / scale_q))), best.absolute),
            pivots=best.pivots + end.pivots,
            attempts=best.attempts + 1,
        )

    infinite = jnp.array(jnp.inf, q.dtype)
    none = jnp.array(0, jnp.int32)
    code = jnp.array(BREAKDOWN, jnp.int32)
    start = Outcome(jnp.zeros_like(q), jnp.zeros(n, bool), code, infinite, infinite, none, none)
    most = jnp.where(valid, covers.shape[0], 1)
    best = lax.while_loop(lambda best: (best.code != SOLVED) & (best.attempts < most), attempt, start)
    # Rounding can turn the last pivot into a ray. Such a point solves the problem, but its basis is none.
    return best._replace(code=jnp.where(best.residual <= reached, SOLVED, best.code))


def _walk(solver: Lemke, M, scale, q, cover, key, hasty) -> _End:
    """One run of pivots from z = 0 along the almost complementary path of one covering vector."""
    n = q.shape[0]
    smallest = solver.resolved_pivot_tolerance(q.dtype)
    slack = float(64 * jnp.finfo(q.dtype).eps)
    most = 1000 + 50 * n if solver.max_pivots is None else solver.max_pivots
    rows = jnp.arange(n, dtype=jnp.int32)

    def pivot(T, walk: _Walk) -> _Walk:
        column = walk.column
        constant, perturbation = walk.constants
        size = jnp.abs(column)
        blocking = column < -smallest * jnp.maximum(1.0, _greatest(size))
        inverse = jnp.where(blocking, 1.0 / size, 0.0)
        step = _least(jnp.where(blocking, jnp.maximum(constant, 0.0) * inverse, jnp.inf))
        tied = blocking & (constant - step * size <= slack * (1.0 + jnp.abs(constant)))
        # A vanished z0 can leave at once, at either sign of its pivot: the point already solves the problem.
        artificial = rows == walk.artificial
        vanished = artificial & (constant <= slack) & (size > smallest) & (hasty | (step == jnp.inf))
        second = jnp.where(tied, perturbation * inverse, jnp.inf)
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
        return T, walk._replace(v=jnp.zeros_like(walk.v), waiting=jnp.array(0, jnp.int32))

    # T is kept transposed, so that the column, read most, lies in one piece. The first pivot brings in z0, just large
    # enough that no basic variable is negative.
    T = jnp.concatenate([M.T * scale, cover[None, :]])
    step = _least(q / cover)
    tied = q - step * cover <= slack * (1.0 + jnp.abs(q))
    _, row = _first_least(jnp.where(tied, key / cover, jnp.inf))
    count = [jnp.array(number, jnp.int32) for number in (0, n, 2 * n)]
    running = ~(_least(q) >= 0)
    start = _Walk(
        u=jnp.zeros((DELAY, n), q.dtype),
        v=jnp.zeros((DELAY, n + 1), q.dtype),
        waiting=count[0],
        column=cover,
        constants=jnp.stack([q, key]),
        basic=rows,
        row=rows,
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
    basis = end.basic[end.row] == rows + n
    value = end.constants[0][end.row]
    return _End(jnp.where(basis & jnp.isfinite(value), jnp.maximum(value, 0.0), 0.0), basis, end.pivots, end.code)


def _exchanged(T, walk: _Walk, row, wanted) -> _Walk:
    """If wanted, the entering variable has become basic in a row, and the partner of the one that left enters next."""
    n = walk.basic.shape[0]
    rows, columns = jnp.arange(n, dtype=jnp.int32), jnp.arange(n + 1, dtype=jnp.int32)
    column = walk.column
    pivot = column[row]
    inverse = jnp.where(wanted, 1.0 / pivot, 0.0)
    u = lax.dynamic_update_index_in_dim(walk.u, jnp.where(rows == row, pivot + 1.0, column), walk.waiting, 0)
    chosen = T[:, row] - _product(u[:, row], walk.v)  # the new change still has v = 0
    v = jnp.where(columns == walk.entering, jnp.where(wanted, 1.0 - inverse, 0.0), chosen * inverse)
    v = lax.dynamic_update_index_in_dim(walk.v, v, walk.waiting, 0)
    there = lax.dynamic_index_in_dim(walk.constants, row, 1)
    change = there * inverse
    moved = walk.constants - change * column[None, :]
    constants = jnp.where(rows[None, :] == row, jnp.where(wanted, -change, there), moved)

    left = walk.basic[row]
    partner = jnp.where(left < n, left + n, left - n)
    pair = jnp.minimum(left, partner)
    pair = jnp.where(pair < n, pair, 0)  # z0 has no partner
    entering = walk.place[pair]
    return walk._replace(
        u=u,
        v=v,
        waiting=walk.waiting + 1,
        column=T[entering] - _product(v[:, entering], u),
        constants=constants,
        basic=_set(walk.basic, row, walk.variable, wanted),
        row=_set(walk.row, walk.variable % n, row, wanted & (walk.variable < 2 * n)),
        place=_set(walk.place, pair, walk.entering, wanted & (left < 2 * n)),
        entering=entering,
        variable=partner,
        pivots=walk.pivots + 1,
    )


_product = partial(jnp.matmul, precision=lax.Precision.HIGHEST)
"""A sum of a few changes. (Written out it would be computed anew in each of the passes that read it.)"""


def _set(values, place, value, wanted):
    return lax.dynamic_update_index_in_dim(values, jnp.where(wanted, value, values[place]), place, 0)


def _least(values):
    """Without the handling of NaN that makes `jnp.min` slow."""
    return _reduced(values, jnp.inf, lambda a, b: jnp.where(b < a, b, a))


def _greatest(values):
    return _reduced(values, -jnp.inf, lambda a, b: jnp.where(b > a, b, a))


def _reduced(values, first, function):
    return lax.reduce((values,), (jnp.array(first, values.dtype),), lambda a, b: (function(a[0], b[0]),), (0,))[0]


def _first_least(values):
    """The least value and the first place where it is."""
    n = values.shape[0]
    least = _least(values)
    places = jnp.arange(n, dtype=jnp.int32)
    return least, jnp.minimum(jnp.min(jnp.where(values == least, places, n)), n - 1)
