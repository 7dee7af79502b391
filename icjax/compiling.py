"""How XLA shall run a function: as one machine function, one problem of a batch after the other."""

from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from typing import Any

import jax
import jax.numpy as jnp
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


def mapped_on_cpu(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function; `vmap` runs it for one after the other on a CPU, for all at once on an accelerator.

    A loop over a batch waits for the slowest and moves all of it through memory in every turn: on a CPU a tenth of the
    throughput.

    **Arguments**: `function` of pytrees of arrays, no other arguments. Differentiate outside of it.
    """
    mapped = jax.custom_batching.custom_vmap(function)

    @mapped.def_vmap
    def rule(axis_size, batched, *arguments):
        def full(array, has):
            return array if has else jnp.broadcast_to(array, (axis_size, *jnp.shape(array)))

        arguments = jax.tree.map(full, arguments, tuple(batched))
        found = lax.platform_dependent(
            *arguments,
            cpu=lambda *arguments: lax.map(lambda item: mapped(*item), arguments),
            default=lambda *arguments: jax.vmap(function)(*arguments),
        )
        return found, jax.tree.map(lambda _: True, found)

    return mapped
