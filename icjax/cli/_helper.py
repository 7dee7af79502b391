"""A second process for what the first one need not wait for, or may share."""

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import wait

from icjax.cli._main import configure_jax


@contextmanager
def helper(prepare: Callable[[], object] | None = None) -> Iterator[Executor | None]:
    """A process that works while the caller computes; None on a single core.

    What the caller wants of it must be fetched before the end: then it is ended at once, as when the caller fails.

    **Arguments**: `prepare` is called in it first, after JAX is configured: imports, seconds of work.
    """
    if len(os.sched_getaffinity(0)) < 2 if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1) < 2:
        yield None
        return
    others = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(1, mp_context=context, initializer=_begin)
    try:
        if prepare is not None:
            executor.submit(prepare)
        yield executor
    finally:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        executor.shutdown(cancel_futures=True)


def _begin() -> None:
    """First thing in the process: end with the one that began it, however that ends, and configure JAX."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()
    configure_jax()


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)


def import_drawing() -> None:
    """Import what the report needs."""
    import matplotlib.backends.backend_svg
    import viser

    import icjax.report

    del matplotlib, viser, icjax
