"""Solving an LCP, and the derivative of its solution by the implicit function theorem on the final basis."""

from functools import cache, partial
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax

from icjax.compiling import as_one_kernel, as_primitive
from icjax.lcp._adjoint import Exact, Smoothed, smoothed
from icjax.lcp._lemke import BREAKDOWN, INVALID, MAX_PIVOTS, RAY, SOLVED, Lemke, Outcome, lemke
from icjax.results import RESULTS, Solution
from icjax.typing import Float, Real

WORTH_CHOOSING = 96
"""n below which the derivative solves for all rows: the choice costs as much as it saves."""

LEAST, MOST = 16, 1024
"""n from which to which a problem is one kernel. XLA makes one of a loop over less than a kilobyte by itself; one
within the other ends the process, and so does a kernel for n = 1330 (seen with jaxlib 0.10.2)."""


def solve(
    M: Float[Real, "n n"],
    q: Float[Real, " n"],
    solver: Lemke = Lemke(),
    *,
    adjoint: Exact | Smoothed = Exact(),
    perturbation: Float[Real, " n"] | None = None,
    throw: bool = False,
) -> Solution[Any]:
    """Finds z with ``z >= 0, Mz + q >= 0, z^T (Mz + q) = 0`` by Lemke's method.

    The problem is first scaled by powers of two (exact in floating point) to ``max|q|`` and ``max|M|`` of order one.
    The status is decided by the recomputed residual of the returned z, not by how the pivoting ended; a failed attempt
    is repeated with another covering vector.

    The derivative is exact on the final basis B, the rows whose z is basic:
    ``dz_B = -M_BB^-1 (dM z + dq)_B`` and zero elsewhere, in forward and reverse mode, of any order, under `vmap`,
    `jit` and `scan`. Where a z and its Mz + q vanish together (weak complementarity) the basis, and so the derivative,
    is that of the problem with ``q + eps perturbation``, eps -> 0+: one-sided in general. Differentiation never
    changes the forward result. The derivative of a failed solve is zero, never NaN: look at `result` before using it.
    (It is zero too where every attempt ended on a ray beside a solution.)

    **Arguments**

    - `M`: `[n, n]`; n may be 0.
    - `q`: `[n]`.
    - `solver`: see [`Lemke`].
    - `adjoint`: the derivative that z carries, [`Exact`][icjax.lcp.Exact] (above) or
      [`Smoothed`][icjax.lcp.Smoothed].
    - `perturbation`: `[n]` or None for a random positive one; breaks ties.
    - `throw`: raise an error instead of returning a failed status.

    **Returns**: a `Solution` with the value z `[n]` (at failure the best point met, at invalid input zeros),
    the result (`secondary_ray`, `breakdown`, `max_pivots` and `invalid_input` are told apart)
    and the statistics `residual` (``max|min(z, Mz + q)|``), `relative_residual` (of the scaled problem, compared
    with the solver's tolerance), `pivots` and `attempts`.

    **Errors**: `ValueError` if the shapes do not agree, `TypeError` for another solver.

    **Source**: Kry and Pai (2006), Section 7.1.3; Cottle, Pang and Stone (1992), Algorithm 4.4.5.
    """
    if not isinstance(solver, Lemke):
        raise TypeError(f"solver must be Lemke (the others need a contact problem); got {type(solver).__name__}")
    if np.shape(M) != (np.size(q), np.size(q)) or np.ndim(q) != 1:
        raise ValueError(f"M must be [n, n] and q [n]; got M {np.shape(M)} and q {np.shape(q)}")
    dtype = jnp.result_type(M, q, jnp.finfo(jnp.result_type(float)).dtype if _integral(M, q) else q)
    M, q = jnp.asarray(M, dtype), jnp.asarray(q, dtype)
    p = None if perturbation is None else lax.stop_gradient(jnp.asarray(perturbation, dtype))
    outcome = _solve(solver, M, q, p)
    result = _result(outcome.code)
    stats = {
        "residual": outcome.absolute,
        "relative_residual": outcome.residual,
        "pivots": outcome.pivots,
        "attempts": outcome.attempts,
    }
    z = outcome.z
    if isinstance(adjoint, Smoothed) and z.size:
        by_M, by_q = (_scale(jnp.max(jnp.abs(lax.stop_gradient(x)))) for x in (M, q))
        unit = 1.0 if adjoint.unit is None else adjoint.unit * by_q**2 / by_M
        z = smoothed(M * by_M, q * by_q, jnp.asarray(adjoint.kappa * unit, dtype), z * (by_q / by_M)) * (by_M / by_q)
    if throw:
        z = result.error_if(z, outcome.code != SOLVED)
    return Solution(value=z, result=result, stats=stats)


def _solve(solver: Lemke, M, q, perturbation) -> Outcome:
    arrays = (M, q) if perturbation is None else (M, q, perturbation)
    return _operation(solver)(*arrays)


@cache
def _operation(solver: Lemke):
    return as_primitive(partial(_scaled, solver), partial(_changed, solver))


def _scaled(solver: Lemke, *arrays) -> Outcome:
    """One problem, on a CPU as one kernel."""
    q = arrays[1]
    if q.shape[0] == 0:
        none, zero = jnp.array(0, jnp.int32), jnp.zeros((), q.dtype)
        return Outcome(q, jnp.zeros(0, bool), none, zero, zero, none, none)
    one = partial(_one, solver)
    return (as_one_kernel(one) if LEAST <= q.shape[0] <= MOST else one)(*arrays)


def _one(solver: Lemke, M, q, perturbation=None) -> Outcome:
    """The problem scaled by powers of two and solved."""
    sizes = _largest(M), jnp.max(jnp.abs(q))
    valid = jnp.isfinite(sizes[0]) & jnp.isfinite(sizes[1])
    outcome = lemke(solver, M, q, [_scale(size) for size in sizes], valid, perturbation)
    broken = (outcome.code == SOLVED) & ~jnp.all(jnp.isfinite(outcome.z))  # z overflows in the units of the problem
    return outcome._replace(
        code=jnp.where(valid, jnp.where(broken, BREAKDOWN, outcome.code), INVALID),
        residual=jnp.where(valid, outcome.residual, jnp.nan),
        absolute=jnp.where(valid, outcome.absolute, jnp.nan),
    )


def _largest(M):
    """The largest absolute value of a matrix, NaN if there is one; four rows at a time (a reduction of the whole cannot
    be part of a kernel)."""
    n = M.shape[0]
    if n < LEAST:
        return jnp.max(jnp.abs(M))

    def further(state):
        step, largest = state
        for k in range(4):
            largest = jnp.maximum(largest, jnp.abs(lax.dynamic_index_in_dim(M, 4 * step + k, 0, keepdims=False)))
        return step + 1, largest

    start = jnp.array(0, jnp.int32), jnp.zeros(n, M.dtype)
    return jnp.max(lax.while_loop(lambda state: 4 * state[0] < n, further, start)[1])


def _changed(solver: Lemke, arguments, tangents) -> tuple[Outcome, Outcome]:
    """On the final basis; calls the operation itself, so that the rule can be differentiated again."""
    M, q, *perturbation = arguments
    M_dot, q_dot = tangents[:2]
    outcome = _solve(solver, M, q, *perturbation or [None])
    z, basis = outcome.z, outcome.basis
    if q.shape[0] == 0:
        z_dot = q_dot
    else:
        change = jnp.matmul(M_dot, z, precision=lax.Precision.HIGHEST) + q_dot
        z_dot = _on_basis(M, basis, -change)
    rest = dict.fromkeys(set(Outcome._fields) - {"z"})
    return outcome, outcome._replace(z=z_dot, **rest)


def _on_basis(M, basis, right):
    """x with M x = `right` on the basis and zero off it.

    Facets of a friction cone make a large problem with a small basis: a system of a quarter or half of the rows is
    solved where they hold it, which is 64 or 8 times less work than all rows.
    """
    n = M.shape[0]
    if n < WORTH_CHOOSING:
        return _on_rows(n, M, basis, right)
    sizes = (n // 4, n // 2, n)
    level = jnp.searchsorted(jnp.array(sizes), jnp.sum(basis))
    return lax.switch(level, [partial(_on_rows, size) for size in sizes], M, basis, right)


def _on_rows(size, M, basis, right):
    rows = jnp.argsort(~basis, stable=True)[:size]
    on = basis[rows]
    matrix = jnp.where(on[:, None] & on[None, :], M[rows[:, None], rows[None, :]], jnp.eye(size, dtype=M.dtype))
    return jnp.zeros_like(right).at[rows].add(jnp.linalg.solve(matrix, jnp.where(on, right[rows], 0.0)))


def _integral(*arrays) -> bool:
    return not any(jnp.issubdtype(jnp.result_type(a), jnp.floating) for a in arrays)


def _scale(x):
    """The power of two that takes x to between 1/2 and 1, 1 for zero: multiplying by it rounds nothing."""
    least = 4 * float(jnp.finfo(x.dtype).tiny)
    bounded = jnp.clip(x, least, 1 / least)
    return jnp.where(x > 0, jnp.frexp(bounded)[0] / bounded, 1.0)


def _result(code):
    result = RESULTS.where(code == SOLVED, RESULTS.solved, RESULTS.breakdown)
    result = RESULTS.where(code == RAY, RESULTS.secondary_ray, result)
    result = RESULTS.where(code == MAX_PIVOTS, RESULTS.max_pivots, result)
    return RESULTS.where(code == INVALID, RESULTS.invalid_input, result)
