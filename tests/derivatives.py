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


def check_derivatives(function, *points, tolerance=DIFFERENCE_TOLERANCE):
    """`function` of one array to one array, at each point; errors are relative to the largest derivative, or one.

    A point may be a tuple: the array, then further arguments that stay. All points share one compilation.
    """

    @jax.jit
    def derivatives(x, *given):
        steps = STEP * jnp.eye(x.size).reshape(x.size, *x.shape)
        both = jax.vmap(lambda step: function(x + step, *given), out_axes=-1)(jnp.concatenate([steps, -steps]))
        found = (both[..., : x.size] - both[..., x.size :]) / (2 * STEP)
        forward, reverse = jax.jacfwd(function)(x, *given), jax.jacrev(function)(x, *given)
        return forward, reverse, found.reshape(forward.shape)

    for point in points:
        x, *given = point if isinstance(point, tuple) else (point,)
        forward, reverse, central = map(np.asarray, derivatives(jnp.asarray(x, float), *given))
        size = max(1.0, np.abs(forward).max(initial=0.0))
        assert np.isfinite(forward).all(), point
        told = f"at {point}"
        np.testing.assert_allclose(reverse, forward, rtol=0, atol=MODES_TOLERANCE * size, err_msg=told)
        np.testing.assert_allclose(central, forward, rtol=0, atol=tolerance * size, err_msg=told)
