"""Long scans in pieces: progress, cancellation, checkpoint and resume, one trace; rows filled up to share one; calls
made by other processes."""

import hashlib
import os
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer


class Run(NamedTuple):
    """What a run returns.

    **Fields**: `carry` after the last step taken; `outputs` of the steps taken, stacked; `steps` taken, fewer than
    asked only after cancellation.
    """

    carry: Any
    outputs: Any
    steps: int


def run(
    step: Callable[[Any, Any], tuple[Any, Any]],
    carry: Any,
    inputs: Any,
    *,
    chunk: int = 500,
    progress: Callable[[float], Any] | None = None,
    cancelled: Callable[[], bool] | None = None,
    checkpoint: str | os.PathLike | None = None,
) -> Run:
    """Scan `step` over the leading axis of `inputs`, `carry, output = step(carry, input)`.

    Without the three options it is one `lax.scan` and can be used inside any transformation. With one of them the
    scan is cut into chunks of equal length (the last one padded, its padding dropped), so that `step` is still
    traced once. Give `step` as an `eqx.Module` with a `__call__` and later runs of the same shapes reuse the
    compiled chunk.

    **Arguments**

    - `step`, `carry`, `inputs`: as for `jax.lax.scan`.
    - `chunk`: steps between two reports.
    - `progress`: called with the fraction done, 0 to 1, after each chunk.
    - `cancelled`: asked before each chunk; the run ends early when it says True.
    - `checkpoint`: file written after each chunk (complete or not at all), resumed from where it exists and belongs
      to the same initial carry and inputs, and removed when the run is complete.

    **Errors**: `ValueError` for inputs of unequal length, a chunk below one, or a checkpoint of another run.
    """
    lengths = {np.shape(leaf)[0] if np.ndim(leaf) else -1 for leaf in jax.tree.leaves(inputs)}
    if len(lengths) != 1 or -1 in lengths:
        raise ValueError(f"inputs must share one leading axis; their lengths are {sorted(lengths)} (-1: a scalar)")
    if chunk < 1:
        raise ValueError(f"chunk must be at least 1; got {chunk}")
    total = lengths.pop()
    if progress is None and cancelled is None and checkpoint is None:
        carry, outputs = _whole(step, carry, inputs)
        return Run(carry, outputs, total)

    carry = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.result_type(leaf)), carry)  # no weak types: one trace
    # Cut and joined in NumPy, no small programs to compile; in JAX where a derivative is on its way through.
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((step, carry, inputs)))
    numpy = jnp if traced else np
    inputs = jax.tree.map(numpy.asarray, inputs)
    pieces: list[Any] = []
    done = 0
    identity = None if checkpoint is None else _identity(carry, inputs)
    if checkpoint is not None and Path(checkpoint).is_file():
        carry, piece, done = _resume(Path(checkpoint), identity, step, carry, inputs)
        pieces.append(piece)
    while done < total and not (cancelled is not None and cancelled()):
        count = min(chunk, total - done)
        piece = jax.tree.map(lambda leaf, a=done, n=count: _padded(numpy, leaf[a : a + n], chunk), inputs)
        carry, outputs = _chunk(step, carry, piece, np.arange(chunk) < count)
        pieces.append(jax.tree.map(lambda leaf, n=count: numpy.asarray(leaf)[:n], outputs))
        done += count
        if checkpoint is not None:
            pieces = [_joined(numpy, pieces)]
            _save(Path(checkpoint), identity, carry, pieces[0], done)
        if progress is not None:
            jax.block_until_ready(carry)
            progress(done / total)
    if checkpoint is not None and done == total:
        Path(checkpoint).unlink(missing_ok=True)
    if not pieces:
        pieces = [_empty(step, carry, inputs)]
    return Run(carry, _joined(numpy, pieces), done)


class Later:
    """A call made by another process where one is given, at once where not.

    **Arguments**: `executor` or None; `function` and its `arguments`, which must be fit to be sent to a process.
    """

    def __init__(self, executor: Executor | None, function: Callable[..., Any], *arguments: Any, **keywords: Any):
        self._call = partial(function, *arguments, **keywords)
        self._future = None if executor is None else executor.submit(self._call)
        self._value = self._call() if self._future is None else None

    def result(self) -> Any:
        """What the call returns or raises; made here if the other process has gone."""
        if self._future is None:
            return self._value
        try:
            return self._future.result()
        except BrokenExecutor:
            return self._call()


def share_out(
    executor: Executor | None,
    function: Callable[..., Any],
    items: Sequence[Any],
    progress: Callable[[float], Any] | None = None,
) -> list[Any]:
    """`[function(item) for item in items]`, by the other processes from the front and by this one from the back.

    **Arguments**: `executor` of the other processes or None; `function(item, progress=None)`, fit to be sent to a
    process, as are the items and what it returns; its `progress` is told the finished fraction of one item; `progress`
    is told that of all, 0 to 1.

    **Errors**: what `function` raises; the items that nobody has begun are then left.
    """
    told = progress or (lambda fraction: None)
    if executor is None:
        return [
            function(item, progress=lambda part, index=index: told((index + part) / len(items)))
            for index, item in enumerate(items)
        ]
    futures: list[Future] = [executor.submit(function, item) for item in items]
    own: dict[int, Any] = {}

    def done(part: float = 0.0) -> None:
        elsewhere = sum(future.done() and not future.cancelled() for future in futures)
        told(min(1.0, (len(own) + elsewhere + part) / len(items)))

    try:
        for index in reversed(range(len(items))):
            if futures[index].cancel():
                own[index] = function(items[index], progress=done)
                done()
        for index, future in enumerate(futures):
            if index not in own:
                try:
                    own[index] = future.result()
                except BrokenExecutor:
                    own[index] = function(items[index])
                done()
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    return [own[index] for index in range(len(items))]


def on_full_blocks(function: Callable[..., Any], *arrays: Any, block: int = 2048) -> Any:
    """Call a compiled function of rows, filled up to whole blocks so that trials of every length share it.

    **Arguments**: `function` of the arrays, row by row along their common leading axis; `arrays` of one length,
    traced or not; `block` rows to fill up to, by repeating the last row.

    **Returns**: what `function` returns, without the rows that were filled in.
    """
    count = np.shape(arrays[0])[0]
    missing = -count % block if count else 0

    def filled(array):
        module = np if isinstance(array, np.ndarray) else jnp
        return module.concatenate([array, module.repeat(array[-1:], missing, axis=0)]) if missing else array

    return jax.tree.map(lambda leaf: leaf[:count], function(*(filled(array) for array in arrays)))


@eqx.filter_jit
def _whole(step, carry, inputs):
    return jax.lax.scan(lambda c, x: step(c, x), carry, inputs)


@eqx.filter_jit
def _chunk(step, carry, inputs, wanted):
    def guarded(carry, item):
        want, x = item
        after, output = step(carry, x)
        return jax.tree.map(lambda new, old: jnp.where(want, new, old), after, carry), output

    return jax.lax.scan(guarded, carry, (wanted, inputs))


def _padded(numpy, leaf, length):
    """Repeat the last row up to the length of a chunk."""
    missing = length - leaf.shape[0]
    return numpy.concatenate([leaf, numpy.repeat(leaf[-1:], missing, axis=0)]) if missing else leaf


def _joined(numpy, pieces):
    return jax.tree.map(lambda *leaves: jnp.asarray(numpy.concatenate(leaves)), *pieces)


def _empty(step, carry, inputs, rows=0):
    """Outputs of `rows` steps, as zeros of the right shapes."""
    first = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(np.shape(leaf)[1:], jnp.result_type(leaf)), inputs)
    shapes = eqx.filter_eval_shape(lambda c, x: step(c, x)[1], carry, first)
    return jax.tree.map(lambda leaf: jnp.zeros((rows, *leaf.shape), leaf.dtype), shapes)


def _identity(carry, inputs):
    """Fingerprint of the run, so that a checkpoint is never resumed with other inputs."""
    digest = hashlib.sha256()
    for leaf in jax.tree.leaves((carry, inputs)):
        array = np.asarray(leaf)
        digest.update(f"{array.shape} {array.dtype}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return np.frombuffer(digest.digest(), np.uint8)


def _save(path, identity, carry, outputs, done):
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            np.save(file, identity)
            np.save(file, np.int64(done))
            eqx.tree_serialise_leaves(file, (carry, outputs))
        os.replace(temporary, path)
    finally:
        Path(temporary).unlink(missing_ok=True)


def _resume(path, identity, step, carry, inputs):
    try:
        with path.open("rb") as file:
            same = np.array_equal(np.load(file), identity)
            done = int(np.load(file)) if same else 0
            if same:
                like = (carry, _empty(step, carry, inputs, done))
                carry, outputs = eqx.tree_deserialise_leaves(file, like)
    except (OSError, ValueError, EOFError, RuntimeError) as error:
        raise ValueError(f"checkpoint {path} cannot be read: {error}; remove it to start anew") from error
    if not same:
        raise ValueError(f"checkpoint {path} belongs to a run with other inputs; remove it to start anew")
    return carry, outputs, done
