"""How JAX shall run a function: as one machine function, as an operation with its own derivative and batches.

Also where what took long to compute is kept.
"""

import os
from collections.abc import Callable
from functools import cached_property, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.core import ShapedArray
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

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


def as_primitive(function: Callable[..., Any], derivative: Callable[..., Any] | None = None) -> Callable[..., Any]:
    """The same function as an operation of JAX of its own: compiled once, with this derivative and no other.

    Within a scan, reverse mode of a function with a rule by `jax.custom_jvp` drops the rule, and a second derivative
    would be one of the loops inside, where it works at all. An operation keeps its rule.

    `vmap` runs it for one after the other on a CPU, for all at once on an accelerator: a loop over a batch waits for
    the slowest and moves all of it through memory in every turn, on a CPU a tenth of the throughput.

    **Arguments**: `function` of pytrees of arrays to a pytree of arrays; `derivative` of its arguments and their
    tangents, two tuples, to the result and its tangent, with None for tangents of what is not real. It may call the
    operation itself, and is then differentiable again. Without it the result is constant.
    """
    operation = _Operation(function, derivative)

    def called(*arguments):
        leaves, tree = jax.tree.flatten(arguments)
        leaves = [jnp.asarray(leaf) for leaf in leaves]
        shape = operation.compiled.eval_shape(*jax.tree.unflatten(tree, leaves))
        found = _operation.bind(*leaves, operation=operation, tree=tree)
        return jax.tree.unflatten(jax.tree.structure(shape), found)

    return called


def cache_folder() -> Path:
    """`$ICJAX_CACHE`, or `icjax` in the cache folder of the user."""
    stated = os.environ.get("ICJAX_CACHE")
    return Path(stated) if stated else Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "icjax"


class _Operation:
    """What the primitive is a call of; equal to itself only."""

    def __init__(self, function, derivative) -> None:
        self.compiled, self.derivative = jax.jit(function), derivative

    @cached_property
    def batched(self) -> "_Operation":
        """Of arguments with one more axis in front."""
        one, derivative = self.compiled, self.derivative

        def many(*arguments):
            return lax.platform_dependent(
                *arguments, cpu=lambda *batch: lax.map(lambda item: one(*item), batch), default=jax.vmap(one)
            )

        return _Operation(many, None if derivative is None else jax.vmap(derivative))

    def leaves(self, leaves, tree):
        return jax.tree.leaves(self.compiled(*jax.tree.unflatten(tree, leaves)))


_operation = Primitive("icjax_operation")
_operation.multiple_results = True


@_operation.def_impl
def _evaluated(*leaves, operation, tree):
    return operation.leaves(leaves, tree)


@_operation.def_abstract_eval
def _shapes(*leaves, operation, tree):
    shapes = [jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) for leaf in leaves]
    found = jax.tree.leaves(operation.compiled.eval_shape(*jax.tree.unflatten(tree, shapes)))
    return [ShapedArray(leaf.shape, leaf.dtype) for leaf in found]


def _batched(leaves, axes, *, operation, tree):
    size = next(leaf.shape[axis] for leaf, axis in zip(leaves, axes, strict=True) if axis is not None)
    full = [
        jnp.broadcast_to(leaf, (size, *leaf.shape)) if axis is None else jnp.moveaxis(leaf, axis, 0)
        for leaf, axis in zip(leaves, axes, strict=True)
    ]
    found = _operation.bind(*full, operation=operation.batched, tree=tree)
    return found, [0] * len(found)


def _differentiated(leaves, tangents, *, operation, tree):
    def real(leaf):
        return jnp.issubdtype(leaf.dtype, jnp.inexact)

    def filled(leaf, tangent):
        if not real(leaf):
            return None
        return jnp.zeros_like(leaf) if isinstance(tangent, ad.Zero) else tangent

    if operation.derivative is None:
        found = _operation.bind(*leaves, operation=operation, tree=tree)
        changes = [None] * len(found)
    else:
        changes = [filled(leaf, tangent) for leaf, tangent in zip(leaves, tangents, strict=True)]
        found, changes = operation.derivative(*(jax.tree.unflatten(tree, x) for x in (leaves, changes)))
        found, changes = jax.tree.leaves(found), jax.tree.leaves(changes, is_leaf=lambda leaf: leaf is None)

    def zero(result):
        return ad.Zero(jax.typeof(result).to_tangent_aval())

    return found, [zero(x) if change is None else change for x, change in zip(found, changes, strict=True)]


batching.primitive_batchers[_operation] = _batched
ad.primitive_jvps[_operation] = _differentiated
mlir.register_lowering(_operation, mlir.lower_fun(_evaluated, multiple_results=True))
