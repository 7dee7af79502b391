"""Chunked scans equal plain scans, trace once, report, stop and resume."""

from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.files import FileError
from icjax.running import run, share_out


class Accumulate(eqx.Module):
    """A step whose result depends on the order and number of the inputs."""

    gain: jax.Array
    traces: list = eqx.field(static=True)

    def __call__(self, carry, x):
        self.traces.append(None)
        carry = self.gain * carry + x
        return carry, {"square": carry**2, "index": jnp.round(x).astype(jnp.int32)}


def make(n=23):
    return Accumulate(jnp.array(0.9), Traces()), jnp.array(0.3), jnp.asarray(np.random.default_rng(0).normal(size=n))


class Traces(list):
    """A hashable list: it may sit in the static part of a module."""

    __hash__ = object.__hash__

    def __eq__(self, other):
        return self is other


def expected(step, carry, xs):
    return jax.lax.scan(lambda c, x: step(c, x), carry, xs)


@pytest.mark.parametrize("chunk", [1, 5, 23, 100])
def test_chunks_equal_one_scan_and_trace_once(chunk):
    step, carry, xs = make()
    seen = []
    result = run(step, carry, xs, chunk=chunk, progress=seen.append)
    assert len(step.traces) == 1
    last, outputs = expected(step, carry, xs)
    assert result.steps == 23
    np.testing.assert_array_equal(result.carry, last)
    np.testing.assert_array_equal(result.outputs["square"], outputs["square"])
    np.testing.assert_array_equal(result.outputs["index"], outputs["index"])
    assert seen == pytest.approx([min(1.0, (i + 1) * chunk / 23) for i in range(-(-23 // chunk))])


def test_a_second_run_of_the_same_shapes_does_not_trace():
    step, carry, xs = make()
    run(step, carry, xs, chunk=5, progress=lambda fraction: None)
    traces = len(step.traces)
    run(eqx.tree_at(lambda s: s.gain, step, jnp.array(0.5)), carry + 1, xs[:17], chunk=5, progress=lambda f: None)
    assert len(step.traces) == traces


def test_differentiable_both_ways():
    step, carry, xs = make()

    def total(gain, progress):
        moved = eqx.tree_at(lambda s: s.gain, step, gain)
        return jnp.sum(run(moved, carry, xs, chunk=5, progress=progress).outputs["square"])

    plain = jax.grad(total)(jnp.array(0.9), None)
    np.testing.assert_allclose(jax.grad(total)(jnp.array(0.9), lambda fraction: None), plain, rtol=1e-14)
    np.testing.assert_allclose(jax.jacfwd(total)(jnp.array(0.9), None), plain, rtol=1e-14)


def test_cancel_then_resume(tmp_path):
    step, carry, xs = make()
    path = tmp_path / "run.ckpt"
    seen = []
    part = run(step, carry, xs, chunk=5, progress=seen.append, cancelled=lambda: len(seen) == 2, checkpoint=path)
    last, outputs = expected(step, carry, xs)
    assert part.steps == 10
    np.testing.assert_array_equal(part.outputs["square"], outputs["square"][:10])
    assert path.is_file()
    seen.clear()
    rest = run(step, carry, xs, chunk=5, progress=seen.append, checkpoint=path)
    assert len(seen) == 3  # 13 steps remained
    np.testing.assert_array_equal(rest.carry, last)
    np.testing.assert_array_equal(rest.outputs["square"], outputs["square"])
    assert list(tmp_path.iterdir()) == []  # a complete run leaves nothing behind


def test_cancelled_at_once():
    step, carry, xs = make()
    result = run(step, carry, xs, cancelled=lambda: True)
    assert result.steps == 0
    assert result.outputs["square"].shape == (0,)


def test_bad_checkpoints_and_inputs(tmp_path):
    step, carry, xs = make()
    path = tmp_path / "run.ckpt"
    run(step, carry, xs, chunk=5, checkpoint=path, cancelled=iter([False, True]).__next__)
    with pytest.raises(ValueError, match="other inputs"):
        run(step, carry, xs + 1.0, chunk=5, checkpoint=path)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(ValueError, match="cannot be read"):
        run(step, carry, xs, chunk=5, checkpoint=path)
    with pytest.raises(ValueError, match="chunk must be at least 1"):
        run(step, carry, xs, chunk=0)
    with pytest.raises(ValueError, match="one leading axis"):
        run(step, carry, (xs, xs[:3]))


def double(item, progress=None):
    if progress is not None:
        progress(0.5)
    if item == "bad":
        raise FileError(Path("a.toml"), "is bad")
    return 2 * item


class Gone(Executor):
    """An executor whose processes die: nothing that it began comes back."""

    def submit(self, function, /, *arguments, **keywords):
        future = Future()
        future.set_running_or_notify_cancel()
        future.set_exception(BrokenExecutor("gone"))
        return future


@pytest.mark.parametrize("executor", [None, ThreadPoolExecutor(1), Gone()])
def test_shared_work_comes_back_in_order_with_rising_progress(executor):
    seen = []
    assert share_out(executor, double, list(range(7)), seen.append) == [2 * item for item in range(7)]
    assert seen[-1] == pytest.approx(1.0) or executor is None
    assert seen == sorted(seen)


@pytest.mark.parametrize("executor", [None, ThreadPoolExecutor(1)])
@pytest.mark.parametrize("place", [0, 3])
def test_an_error_of_shared_work_is_raised_here(executor, place):
    items = [1, 2, 3, 4]
    items[place] = "bad"
    with pytest.raises(FileError, match="a.toml: is bad"):
        share_out(executor, double, items)


def test_a_file_error_survives_the_way_between_processes():
    import pickle

    error = pickle.loads(pickle.dumps(FileError("a.toml", "is bad")))
    assert (type(error), str(error), error.path) == (FileError, "a.toml: is bad", "a.toml")
