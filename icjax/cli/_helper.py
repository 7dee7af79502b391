"""A second process for what the first one need not wait for."""

import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager

from icjax.cli._main import configure_jax


@contextmanager
def helper() -> Iterator[Executor | None]:
    """A process that imports what drawing needs, seconds of work, while the caller computes; None on a single core.

    What the caller wants of it must be fetched before the end: then it is ended at once, as when the caller fails.
    """
    if len(os.sched_getaffinity(0)) < 2 if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1) < 2:
        yield None
        return
    executor = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))
    try:
        executor.submit(_prepare)
        yield executor
    finally:
        for process in multiprocessing.active_children():
            process.terminate()
        executor.shutdown(cancel_futures=True)


def _prepare() -> None:
    configure_jax()
    import matplotlib.backends.backend_svg
    import viser

    import icjax.report

    del matplotlib, viser, icjax
