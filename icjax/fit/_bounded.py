"""The bounded alternative: L-BFGS-B by jaxopt."""

import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

REACH = 20.0
"""How far x may go from its start: e^20 where x is a logarithm."""


def bounded(problem, x, solver, tolerance, max_steps, told, cancelled):
    """L-BFGS-B within `REACH` of the start; see `solve`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        import jaxopt

    static, dynamic = eqx.partition(problem, lambda leaf: not eqx.is_array(leaf))

    def cost(x, dynamic):
        return eqx.combine(static, dynamic).cost(x)

    method = jaxopt.LBFGSB(fun=cost, maxiter=max_steps, tol=tolerance)
    bounds = (x - REACH, x + REACH)
    state = method.init_state(x, bounds=bounds, dynamic=dynamic)
    advance = jax.jit(lambda x, state: method.update(x, state, bounds=bounds, dynamic=dynamic))
    before = float(state.value)
    for step in range(1, max_steps + 1):
        if cancelled():
            return x, False, step - 1
        x, state = advance(x, state)
        now = float(state.value)
        told(x, now, step)
        if not np.isfinite(now):
            return x, False, step
        if float(state.error) <= tolerance or (step > 1 and abs(before - now) <= tolerance**2 * (1 + abs(now))):
            return x, bool(jnp.all(jnp.isfinite(x))), step
        before = now
    return x, False, max_steps
