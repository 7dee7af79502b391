"""Property tests of equations between arrays: both sides compiled once, numbers drawn by hypothesis."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

TOLERANCE = 1e-13
"""A hundred roundings of numbers up to ten, times the condition number of a logarithm away from angle pi."""


def holds(*strategies, tolerance=TOLERANCE, examples=30):
    """The decorated generator yields pairs (left, right), trees of arrays, that must be equal."""

    def decorate(equations):
        sides = jax.jit(lambda *numbers: list(equations(*map(jnp.asarray, numbers))))

        @settings(max_examples=examples, deadline=None, derandomize=True)
        @given(st.tuples(*strategies))
        def test(numbers):
            for left, right in sides(*numbers):
                for a, b in zip(jax.tree.leaves(left), jax.tree.leaves(right), strict=True):
                    np.testing.assert_allclose(a, b, rtol=0, atol=tolerance)

        test.__name__, test.__doc__, test.__module__ = equations.__name__, equations.__doc__, equations.__module__
        return test

    return decorate
