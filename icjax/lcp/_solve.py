"""Solving an LCP, and the derivative of its solution by the implicit function theorem on the final basis."""

from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from icjax.lcp._lemke import INVALID, MAX_PIVOTS, RAY, SOLVED, Lemke, Outcome, lemke
from icjax.lcp._residual import residual
from icjax.results import RESULTS, Solution
from icjax.typing import Float, Real


def solve(
    M: Float[Real, "n n"],
    q: Float[Real, " n"],
    solver: Lemke = Lemke(),
    *,
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

    **Arguments**

    - `M`: `[n, n]`; n may be 0.
    - `q`: `[n]`.
    - `solver`: see [`Lemke`].
    - `perturbation`: `[n]` or None for a random positive one; breaks ties.
    - `throw`: raise an error instead of returning a failed status.

    **Returns**: a `Solution` with the value z `[n]` (at failure the best point met, at invalid input zeros),
    the result (`secondary_ray`, `breakdown`, `max_pivots` and `invalid_input` are told apart)
    and the statistics `residual` (``max|min(z, Mz + q)|``), `relative_residual` (of the scaled problem, compared
    with the solver's tolerance), `pivots` and `attempts`.

    **Errors**: `ValueError` if the shapes do not agree.

    **Source**: Kry and Pai (2006), Section 7.1.3; Cottle, Pang and Stone (1992), Algorithm 4.4.5.
    """
    if np.shape(M) != (np.size(q), np.size(q)) or np.ndim(q) != 1:
        raise ValueError(f"M must be [n, n] and q [n]; got M {np.shape(M)} and q {np.shape(q)}")
    dtype = jnp.result_type(M, q, jnp.finfo(jnp.result_type(float)).dtype if _integral(M, q) else q)
    M, q = jnp.asarray(M, dtype), jnp.asarray(q, dtype)
    p = None if perturbation is None else lax.stop_gradient(jnp.asarray(perturbation, dtype))
    outcome = _solve(solver, M, q, p)
    result = _result(outcome.code)
    stats = {
        "residual": residual(lax.stop_gradient(M), lax.stop_gradient(q), lax.stop_gradient(outcome.z)),
        "relative_residual": outcome.residual,
        "pivots": outcome.pivots,
        "attempts": outcome.attempts,
    }
    z = outcome.z
    if throw:
        z = result.error_if(z, outcome.code != SOLVED)
    return Solution(value=z, result=result, stats=stats)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _solve(solver: Lemke, M, q, perturbation) -> Outcome:
    return _primal(solver, M, q, perturbation)


@partial(jax.jit, static_argnums=0)
def _primal(solver: Lemke, M, q, perturbation) -> Outcome:
    """Compiled on its own, so that calls outside `jit` do not compile the loop again."""
    arrays = (M, q) if perturbation is None else (M, q, perturbation)
    return _mapped(solver)(*arrays)


@cache
def _mapped(solver: Lemke):
    """One problem after the other on a CPU, where a loop over a batch waits for the slowest and moves all of it through
    memory in every pivot (a tenth of the throughput); all at once on an accelerator."""
    mapped = jax.custom_batching.custom_vmap(partial(_scaled, solver))

    @mapped.def_vmap
    def rule(axis_size, batched, *arrays):
        full = [
            array if has else jnp.broadcast_to(array[None], (axis_size, *array.shape))
            for array, has in zip(arrays, batched, strict=True)
        ]
        outcome = lax.platform_dependent(
            *full,
            cpu=lambda *arrays: lax.map(lambda item: mapped(*item), arrays),
            default=lambda *arrays: jax.vmap(partial(_scaled, solver))(*arrays),
        )
        return outcome, jax.tree.map(lambda _: True, outcome)

    return mapped


def _scaled(solver: Lemke, M, q, perturbation=None) -> Outcome:
    """The problem divided by powers of two, solved, multiplied back."""
    n = q.shape[0]
    if n == 0:
        none = jnp.array(0, jnp.int32)
        return Outcome(q, jnp.zeros(0, bool), none, jnp.zeros((), q.dtype), none, none)
    valid = jnp.all(jnp.isfinite(M)) & jnp.all(jnp.isfinite(q))
    M = jnp.where(valid, M, jnp.eye(n, dtype=M.dtype))
    q = jnp.where(valid, q, 1.0)
    size_M, size_q = _power_of_two(jnp.max(jnp.abs(M))), _power_of_two(jnp.max(jnp.abs(q)))
    outcome = lemke(solver, M / size_M, q / size_q, perturbation)
    return outcome._replace(
        z=outcome.z * (size_q / size_M),
        code=jnp.where(valid, outcome.code, INVALID),
        residual=jnp.where(valid, outcome.residual, jnp.nan),
    )


@_solve.defjvp
def _solve_jvp(solver: Lemke, primals, tangents):
    """Calls the differentiable function itself, so that the rule can be differentiated again."""
    M, q, perturbation = primals
    M_dot, q_dot, _ = tangents
    outcome = _solve(solver, M, q, perturbation)
    z, basis = outcome.z, outcome.basis
    if q.shape[0] == 0:
        z_dot = q_dot
    else:
        matrix = jnp.where(basis[:, None] & basis[None, :], M, jnp.eye(q.shape[0], dtype=M.dtype))
        change = jnp.matmul(M_dot, z, precision=lax.Precision.HIGHEST) + q_dot
        z_dot = jnp.linalg.solve(matrix, -jnp.where(basis, change, 0.0))
    return outcome, Outcome(
        z=z_dot,
        basis=_no_tangent(basis),
        code=_no_tangent(outcome.code),
        residual=jnp.zeros_like(outcome.residual),
        pivots=_no_tangent(outcome.pivots),
        attempts=_no_tangent(outcome.attempts),
    )


def _no_tangent(x):
    return np.zeros(jnp.shape(x), jax.dtypes.float0)


def _integral(*arrays) -> bool:
    return not any(jnp.issubdtype(jnp.result_type(a), jnp.floating) for a in arrays)


def _power_of_two(x):
    """The power of two just above x, 1 for zero: dividing by it rounds nothing."""
    _, exponent = jnp.frexp(x)
    return jnp.where(x > 0, jnp.ldexp(jnp.ones_like(x), exponent), 1.0)


def _result(code):
    result = RESULTS.where(code == SOLVED, RESULTS.solved, RESULTS.breakdown)
    result = RESULTS.where(code == RAY, RESULTS.secondary_ray, result)
    result = RESULTS.where(code == MAX_PIVOTS, RESULTS.max_pivots, result)
    return RESULTS.where(code == INVALID, RESULTS.invalid_input, result)
