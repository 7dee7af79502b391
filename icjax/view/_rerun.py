"""Computing in the background what was asked for last."""

import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple


class Told(NamedTuple):
    """How a computation stands: `state` is "ready", "computing" or "failed", `fraction` is done, `text` the error."""

    state: str
    fraction: float = 0.0
    text: str = ""


class _Superseded(Exception):
    """Something else was asked for, or nobody waits any more."""


class Rerun:
    """The latest request, computed in a thread of its own.

    A request waits until none has come for `pause` seconds. A computation that has been superseded ends at its next
    report of progress. What fails is told; the results before it stay with whoever keeps them.

    **Arguments**: `compute(request, progress)`; `done(request, result)` takes a result, `told` every change of state,
    both in the thread; `pause` s.
    """

    def __init__(
        self,
        compute: Callable[[Any, Callable[[float], None]], Any],
        done: Callable[[Any, Any], None],
        told: Callable[[Told], None] = lambda told: None,
        pause: float = 0.3,
    ):
        self._compute, self._done, self._told, self._pause = compute, done, told, pause
        self._change = threading.Condition()
        self._asked: list[Any] = []
        self._since = 0.0
        self._busy = self._closed = False
        self._thread = threading.Thread(target=self._work, name="icjax rerun", daemon=True)
        self._thread.start()

    def ask(self, request: Any) -> None:
        """Compute this instead of what was asked for before."""
        with self._change:
            self._asked, self._since = [request], time.monotonic()
            self._change.notify_all()

    def wait(self, timeout: float | None = None) -> bool:
        """Until nothing is asked for or computed. **Returns**: False if that took longer than `timeout` s."""
        with self._change:
            return self._change.wait_for(lambda: self._closed or not (self._asked or self._busy), timeout)

    def close(self) -> None:
        """End the thread; a computation ends at its next report."""
        with self._change:
            self._closed, self._asked = True, []
            self._change.notify_all()

    def _next(self) -> Any:
        with self._change:
            self._busy = False
            self._change.notify_all()
            while not self._closed:
                left = self._since + self._pause - time.monotonic()
                if self._asked and left <= 0:
                    self._busy = True
                    return self._asked.pop()
                self._change.wait(left if self._asked else None)
            raise _Superseded

    def _work(self) -> None:
        while True:
            try:
                request = self._next()
            except _Superseded:
                return
            try:
                self._told(Told("computing"))
                result = self._compute(request, self._report)
                self._report(1.0)
                self._done(request, result)
                self._told(Told("ready", 1.0))
            except _Superseded:
                continue
            except Exception as error:  # whatever went wrong is the person's to read, and the next request may be right
                self._told(Told("failed", text=" ".join(str(error).split()) or type(error).__name__))

    def _report(self, fraction: float) -> None:
        if self._asked or self._closed:
            raise _Superseded
        self._told(Told("computing", fraction))
