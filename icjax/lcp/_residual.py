"""The natural residual of a linear complementarity problem: the judge of every solver."""

import jax.numpy as jnp
from jax import lax

from icjax.typing import Float, Real, Scalar


def residual(M: Float[Real, "n n"], q: Float[Real, " n"], z: Float[Real, " n"]) -> Scalar:
    """Largest violation of complementarity, ``max |min(z, Mz + q)|``; zero exactly at the solutions.

    It compares z with Mz + q, so it means most for a dimensionless problem with entries of order one.

    **Arguments**: `M` `[n, n]`, `q` `[n]`, `z` `[n]`.

    **Returns**: a scalar, NaN if the input holds NaN; zero for n = 0.

    **Source**: Cottle, Pang and Stone (1992), *The Linear Complementarity Problem*, Section 1.5 (the min map).
    """
    w = jnp.matmul(M, z, precision=lax.Precision.HIGHEST) + q
    return jnp.max(jnp.abs(jnp.minimum(z, w)), initial=0.0)
