"""Progress on the terminal: numbered steps with elapsed time, a bar where a step reports its fraction."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

PAUSE = 5.0
"""s between two notes where there is no terminal."""


class Steps:
    """Counts the steps of a verb, shows each one's progress on stderr and keeps its seconds."""

    def __init__(self, total: int):
        self.total = total
        self.seconds: dict[str, float] = {}

    @contextmanager
    def step(self, title: str) -> Iterator[Callable[..., None]]:
        """Run one step; yields a function that takes the fraction done, 0 to 1, and a note on how it stands if any.

        Notes stand beside the bar; where there is no terminal, every few seconds one is a line, and the last.
        """
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

            said, left = float("-inf"), ""

            def told(fraction: float, note: str = "") -> None:
                nonlocal said, left
                left = note
                bar.update(task, completed=float(fraction), description=f"{label}: {note}" if note else label)
                if note and not console.is_terminal and time.perf_counter() - said >= PAUSE:
                    said, left = time.perf_counter(), ""
                    print(f"  {note}", file=sys.stderr, flush=True)

            yield told
            if left and not console.is_terminal:
                print(f"  {left}", file=sys.stderr, flush=True)
            bar.update(task, completed=1.0, description=label)
        self.seconds[title] = time.perf_counter() - start
