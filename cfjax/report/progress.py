"""How a run shows where it is: bars on a terminal, one line per finished stage in a file. All of it on stderr."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from cfjax.options import Progress as Callback


@contextmanager
def progress_on(console: Console | None = None) -> Iterator[Callback]:
    """A callback (stage, done, of) for the time of a run; a stage begins with its first call, ends at done = of."""
    console = Console(stderr=True) if console is None else console
    if not console.is_terminal:
        yield _Lines(console)
        return
    columns = (TextColumn("{task.description:>12}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console) as bars:
        yield _Bars(bars)


class _Bars:
    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._tasks: dict[str, TaskID] = {}

    def __call__(self, stage: str, done: int, of: int) -> None:
        if stage not in self._tasks:
            self._tasks[stage] = self._bars.add_task(stage, total=of)
        self._bars.update(self._tasks[stage], completed=done, total=of)


class _Lines:
    def __init__(self, console: Console) -> None:
        self._console = console
        self._before = time.monotonic()  # a stage that speaks up only at its end began when the one before it ended

    def __call__(self, stage: str, done: int, of: int) -> None:
        if done >= of:
            now = time.monotonic()
            print(f"{stage}: {done} of {of}, {now - self._before:.1f} s", file=self._console.file, flush=True)
            self._before = now
