"""Progress on the terminal: numbered steps with elapsed time, a bar where a step reports its fraction."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Steps:
    """Counts the steps of a verb, shows each one's progress on stderr and keeps its seconds."""

    def __init__(self, total: int):
        self.total = total
        self.seconds: dict[str, float] = {}

    @contextmanager
    def step(self, title: str) -> Iterator[Callable[[float], None]]:
        """Run one step; yields a function that takes the fraction done, 0 to 1."""
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        label = f"[{len(self.seconds) + 1}/{self.total}] {title}"
        console = Console(file=sys.stderr, highlight=False)
        start = time.perf_counter()
        if not console.is_terminal:
            print(label, file=sys.stderr, flush=True)
        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
        )
        with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
            task = bar.add_task(label, total=1.0)
            yield lambda fraction: bar.update(task, completed=float(fraction))
            bar.update(task, completed=1.0)
        self.seconds[title] = time.perf_counter() - start
