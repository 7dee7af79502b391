"""One check for every differentiable function: forward mode = reverse mode = central difference."""

import jax
import jax.numpy as jnp
import numpy as np

STEP = float(np.finfo(float).eps) ** (1 / 3)
"""Step of central differences that balances truncation and rounding, for values and arguments of order one."""

DIFFERENCE_TOLERANCE = 1e-8
"""About a hundred times STEP squared, which is the error of a central difference."""

MODES_TOLERANCE = 1e-12
"""Forward and reverse mode compute the same sums in another order."""


def check_derivatives(function, x, tolerance=DIFFERENCE_TOLERANCE):
    """`function` of one array to one array; errors are relative to the largest entry of the derivative, or one."""
    x = jnp.asarray(x, float)
    steps = STEP * jnp.eye(x.size).reshape(x.size, *x.shape)

    @jax.jit
    def derivatives(x):
        central = jax.vmap(lambda step: (function(x + step) - function(x - step)) / (2 * STEP), out_axes=-1)(steps)
        return jax.jacfwd(function)(x), jax.jacrev(function)(x), central

    forward, reverse, central = map(np.asarray, derivatives(x))
    central = central.reshape(forward.shape)
    size = max(1.0, np.abs(forward).max(initial=0.0))
    assert np.isfinite(forward).all()
    np.testing.assert_allclose(reverse, forward, rtol=0, atol=MODES_TOLERANCE * size)
    np.testing.assert_allclose(central, forward, rtol=0, atol=tolerance * size)
