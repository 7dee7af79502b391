"""The central path of a complementarity system, by a predictor-corrector interior-point method; its derivative.

The path is the curve of points with all complementarity products equal to kappa, ``z * w = kappa``, z and w positive.
For kappa -> 0 it ends in a solution; for kappa > 0 it is a smooth function of the problem, also where the solution has
corners. A system says what its products are and how Newton's equations are solved, so that structure can be used.
"""

from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from icjax.compiling import as_one_kernel, as_primitive
from icjax.typing import Int, Real, Scalar

_CENTRED = 1e-6  # largest relative deviation of a product from kappa
_LEAST_CENTRING, _CORRECTION = 1e-3, 30.0
_SHORTEST = 1e-4
_SINGLE = 1e-10  # eps above which directions are refined
_STARTS = ((1.0, 0.9), (10.0, 0.5), (0.3, 0.5), (100.0, 0.5))  # size, and fraction of the way to the boundary


class System(eqx.Module):
    """Equations of a central path: products and defects of a point, Newton's equations, the way to the boundary.

    A point is a pytree of arrays. `live` marks the products that count.
    """

    @abstractmethod
    def live(self) -> Real:
        """Which products belong to the problem, bool `[product]`."""

    @abstractmethod
    def start(self, size: Scalar) -> Any:
        """An interior point with entries of this size."""

    @abstractmethod
    def products(self, point: Any) -> Real:
        """What shall become kappa, `[product]`."""

    @abstractmethod
    def defects(self, point: Any) -> Real:
        """What shall become zero, `[defect]`."""

    @abstractmethod
    def factor(self, point: Any) -> Any:
        """Whatever the directions from this point have in common."""

    @abstractmethod
    def direction(self, point: Any, factor: Any, products: Real, defects: Real) -> Any:
        """The change of the point that changes products and defects by these amounts, to first order (linear)."""

    @abstractmethod
    def reach(self, point: Any, direction: Any) -> Scalar:
        """The inverse of the step at which the boundary is met; not positive where there is none."""


def times(matrix: Real, vector: Real) -> Real:
    """A matrix product in full precision on every device."""
    return jnp.matmul(matrix, vector, precision=lax.Precision.HIGHEST)


def factored(matrix: Real) -> tuple[Real, Real]:
    """LU factors of the transpose and the permutation of its rows, for `solve_factored`.

    LAPACK reads columns, XLA writes rows: the transpose needs no copy.
    """
    lu, pivots, permutation = lax.linalg.lu(matrix.T)
    # On a CPU XLA runs the library's loop over the rows operation by operation: a fifth of the factorisation's time.
    return lu, lax.platform_dependent(pivots, permutation, cpu=lambda p, _: _permuted(p), default=lambda _, p: p)


def solve_factored(lu: Real, permutation: Real, rhs: Real) -> Real:
    """x of ``A x = rhs`` from `factored`; linear in the right side."""
    y = lax.linalg.triangular_solve(lu, rhs[:, None], left_side=True, lower=False, transpose_a=True)
    x = lax.linalg.triangular_solve(lu, y, left_side=True, lower=True, unit_diagonal=True, transpose_a=True)[:, 0]
    return jnp.zeros_like(x).at[permutation].set(x, unique_indices=True)


@as_primitive
@as_one_kernel
def _permuted(pivots):
    def swap(row, rows):
        here, there = rows[row], rows[pivots[row]]
        rows = lax.dynamic_update_index_in_dim(rows, there, row, 0)
        return lax.dynamic_update_index_in_dim(rows, here, pivots[row], 0)

    count = pivots.shape[0]
    return lax.fori_loop(0, count, swap, jnp.arange(count, dtype=pivots.dtype))


class Path(NamedTuple):
    """A point of the central path, whether it is one, and the number of Newton steps."""

    point: Any
    converged: Real
    steps: Real


def central_path(system: System, kappa: Scalar, max_steps: Int[Real, ""]) -> Path:
    """The point of the central path with products kappa.

    Mehrotra's predictor and corrector with one factorisation a step; in single precision every direction is refined
    once. After a stall (steps shorter than 1e-4, or `max_steps`) it begins again from other sizes, with shorter steps.
    The derivative is that of the implicit function theorem, in forward and reverse mode, of any order; it is zero where
    the path was not found.

    **Arguments**: `system`; `kappa` > 0, in the system's units, which should make its numbers of order one;
    `max_steps` of each of four attempts.

    **Returns**: the point, whether it was found (products within 1e-6 kappa, defects of the order of rounding), and
    the number of steps of all attempts.

    **Source**: Mehrotra (1992), SIAM J. Optim. 2, 575; Kojima, Megiddo, Noma and Yoshise (1991), *A Unified Approach to
    Interior Point Algorithms for Linear Complementarity Problems*.
    """
    return _path(system, kappa, max_steps)


def _changed(arguments, tangents) -> tuple[Path, Path]:
    """By the implicit function theorem."""
    system, kappa, max_steps = arguments
    system_dot, kappa_dot, _ = tangents
    path = _path(system, kappa, max_steps)
    point = path.point
    real, rest = eqx.partition(system, eqx.is_inexact_array)

    def at_the_point(real):
        moved = eqx.combine(real, rest)
        return moved.products(point), moved.defects(point)

    _, (products, defects) = jax.jvp(at_the_point, (real,), (system_dot,))
    change = system.direction(point, system.factor(point), kappa_dot - products, -defects)
    change = jax.tree.map(lambda x: jnp.where(path.converged, x, 0.0), change)
    return path, path._replace(point=change, converged=None, steps=None)


class _State(NamedTuple):
    point: Any
    products: Real
    defects: Real
    converged: Real
    steps: Real
    taken: Real  # steps of this attempt
    attempt: Real


def _followed(system: System, kappa, max_steps) -> Path:
    live = system.live()
    count = jnp.maximum(jnp.sum(live), 1)
    eps = float(jnp.finfo(kappa.dtype).eps)
    centred = max(_CENTRED, 10 * eps**0.5)
    sizes, fractions = jnp.asarray(_STARTS, kappa.dtype).T
    sizes = sizes * jnp.maximum(1.0, jnp.sqrt(kappa))

    def largest(x):
        return jnp.max(jnp.abs(x), initial=0.0)

    def at(point, steps, taken, attempt) -> _State:
        products, defects = system.products(point), system.defects(point)
        off = largest(jnp.where(live, products - kappa, 0.0))
        size = sum((largest(x) for x in jax.tree.leaves(point)), start=jnp.ones((), kappa.dtype))
        converged = (off <= centred * kappa) & (largest(defects) <= 100 * eps * size)
        return _State(point, products, defects, converged, steps, taken, attempt)

    def mean(products):
        return jnp.sum(jnp.where(live, products, 0.0)) / count

    def step(state: _State) -> _State:
        point, products, defects = state.point, state.products, state.defects
        now, fraction = mean(products), fractions[state.attempt]
        factor = system.factor(point)

        def direction(products, defects):
            found = system.direction(point, factor, products, defects)
            if eps > _SINGLE:
                got = jax.jvp(lambda x: (system.products(x), system.defects(x)), (point,), (found,))[1]
                found = _moved(found, 1.0, system.direction(point, factor, products - got[0], defects - got[1]))
            return found

        first = direction(kappa - products, -defects)
        ahead = 1.0 / jnp.maximum(system.reach(point, first), 1.0)
        share = mean(system.products(_moved(point, ahead, first))) / now
        target = jnp.maximum(kappa, jnp.clip(share**3, _LEAST_CENTRING, 1.0) * now)
        # What the first direction, taken whole, leaves of products and defects: their second order.
        whole = _moved(point, 1.0, first)
        bend = jnp.clip(system.products(whole) - kappa, -_CORRECTION * target, _CORRECTION * target)
        turn = jnp.clip(system.defects(whole), -_CORRECTION * target, _CORRECTION * target)
        second = direction(target - products - bend, -defects - turn)
        length = longest(point, second, fraction)
        stalled = ~((length > _SHORTEST) & (state.taken < max_steps))  # true for NaN
        attempt = state.attempt + stalled
        start = system.start(sizes[jnp.minimum(attempt, len(_STARTS) - 1)])
        moved = _moved(point, length, second)
        moved = jax.tree.map(lambda a, b: jnp.where(stalled, a, b), start, moved)
        return at(moved, state.steps + 1, jnp.where(stalled, 0, state.taken + 1), attempt)

    def longest(point, direction, fraction):
        return jnp.minimum(1.0, fraction / jnp.maximum(system.reach(point, direction), fraction))

    zero = jnp.array(0, jnp.int32)
    begin = at(system.start(sizes[0]), zero, zero, zero)
    end = lax.while_loop(lambda state: ~state.converged & (state.attempt < len(_STARTS)), step, begin)
    return Path(end.point, end.converged, end.steps)


_path = as_primitive(_followed, _changed)


def _moved(point, step, direction):
    return jax.tree.map(lambda x, d: x + step * d, point, direction)
