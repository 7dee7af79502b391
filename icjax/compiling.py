"""Many small operations as one machine function."""

from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from typing import Any

import jax
from jax import lax
from jax.experimental.xla_metadata import set_xla_metadata

KNOWN = ((0, 10), (0, 11))
"""Versions of jaxlib, from and below, whose CPU compiler was seen to honour the mark (`tests/test_compiling.py`)."""

_MARK = {"xla_cpu_small_call": "true", "inlineable": "false"}


def as_one_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function; on a CPU its operations are compiled into a single machine function.

    XLA's CPU backend runs a program operation by operation, 50 to 100 ns for each beside its work: most of the time of
    a loop over small arrays. It compiles a call with the frontend attribute `xla_cpu_small_call` as a whole, loops
    included, as it does of its own accord with loops over less than a kilobyte; such a loop must not contain this
    call. Elsewhere, and with a version of jaxlib that is not known to do so, nothing changes.

    **Arguments**: `function` of arrays, made of elementwise operations, reductions, slices, matrix products and loops
    over them; scatters, sorts, factorisations and callbacks cannot be part of it. Differentiate outside of it.
    """

    @partial(jax.jit, inline=False)
    def marked(*arguments):
        with set_xla_metadata(**dict.fromkeys(_MARK)):  # the mark is for the call and for nothing within
            return function(*arguments)

    def called(*arguments):
        with set_xla_metadata(**_MARK):
            return marked(*arguments)

    def chosen(*arguments):
        return lax.platform_dependent(*arguments, cpu=called, default=function)

    found = tuple(int(part) for part in version("jaxlib").split(".")[:2])
    return chosen if KNOWN[0] <= found < KNOWN[1] else function
