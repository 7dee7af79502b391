"""Which derivative a solution carries; the forward result never depends on it."""

import equinox as eqx
import jax.numpy as jnp

from icjax.compiling import as_primitive
from icjax.lcp._central_path import System, central_path, factored, solve_factored, times
from icjax.typing import Float, Real, Scalar


class Exact(eqx.Module):
    """The derivative of the solution itself, on its final basis; one-sided where z and Mz + q vanish together."""


class Smoothed(eqx.Module):
    """The derivative of the central path's point ``z * w = kappa`` of the same problem, in place of the solution's.

    It is that of another function: smooth, and aware of contacts that do not touch yet. Where the path is not found,
    the exact derivative stands in.

    **Fields**

    - `kappa`: product of z and w, in units of `unit`.
    - `unit`: what kappa is a multiple of, in units of z times w (J for contact), or None for the problem's own scale,
      ``max|q|^2 / max|M|`` (for contact ``L^2 / w``) with powers of two.
    """

    kappa: float | Scalar = 1e-4
    unit: float | Scalar | None = None

    def __check_init__(self) -> None:
        if isinstance(self.kappa, float | int) and not self.kappa > 0:
            raise ValueError(f"kappa must be positive; got {self.kappa}")


def carried(value: Real, source: Real) -> Real:
    """The value, with the derivative of the source. What makes the source is not computed in `jit` without need."""
    return _carried(value, source)


_carried = as_primitive(lambda value, source: value, lambda arguments, tangents: (_carried(*arguments), tangents[1]))


class Dense(System):
    """An LCP without further structure: ``w = M z + q``, points (z, w)."""

    M: Float[Real, "n n"]
    q: Float[Real, " n"]

    def live(self):
        return jnp.ones(self.q.shape, bool)

    def start(self, size):
        ones = jnp.ones_like(self.q) * size
        return ones, ones

    def products(self, point):
        z, w = point
        return z * w

    def defects(self, point):
        z, w = point
        return w - times(self.M, z) - self.q

    def factor(self, point):
        z, w = point
        lu, permutation = factored(jnp.diag(w) + z[:, None] * self.M)
        return lu, permutation

    def direction(self, point, factor, products, defects):
        z, _ = point
        lu, permutation = factor
        change = solve_factored(lu, permutation, products - z * defects)
        return change, times(self.M, change) + defects

    def reach(self, point, direction):
        (z, w), (dz, dw) = point, direction
        return jnp.max(jnp.maximum(-dz / z, -dw / w), initial=0.0)


def smoothed(M: Float[Real, "n n"], q: Float[Real, " n"], kappa: Scalar, z: Float[Real, " n"]) -> Float[Real, " n"]:
    """The solution z with the derivative of the central path of a problem with entries of order one."""
    path = central_path(Dense(M=M, q=q), jnp.asarray(kappa, q.dtype), jnp.array(60, jnp.int32))
    return carried(z, jnp.where(path.converged, path.point[0], z))
