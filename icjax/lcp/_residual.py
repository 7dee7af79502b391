"""The natural residual of a linear complementarity problem: the judge of every solver."""

import jax.numpy as jnp
import numpy as np
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


def tolerance(given: float | None, dtype: np.dtype) -> float:
    """The residual of a problem with entries of order one that counts as solved, by default 1e-10 (float32: 1e-4).

    Half of that, because scaling by powers of two may make residuals smaller by up to two.
    """
    return given if given is not None else (5e-11 if np.dtype(dtype).itemsize >= 8 else 5e-5)
