"""How a run shows where it is: bars on a terminal; in a file one line per finished stage, and one where it takes long.

All of it on stderr.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from cfjax.options import Progress as Callback


P = ParamSpec("P")
T = TypeVar("T")
QUIET = 20.0  # s: so long a file hears nothing of a run, at most
SHORT = 1.0  # s: a stage of one step that takes less is worth no line


@contextmanager
def progress_on(console: Console | None = None) -> Iterator[Callback]:
    """A callback (stage, done, of) for the time of a run; a stage begins with its first call, ends at done = of."""
    console = Console(stderr=True) if console is None else console
    if not console.is_terminal:
        lines = _Lines(console)
        try:
            yield lines
        finally:
            lines.close()
        return
    columns = (TextColumn("{task.description:>12}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console) as bars:
        yield _Bars(bars)


def staged(progress: Callback, stage: str, work: Callable[P, T]) -> Callable[P, T]:
    """The same work, that says when it begins and when it has ended; an error ends nothing."""

    def said(*args: P.args, **kwargs: P.kwargs) -> T:
        progress(stage, 0, 1)
        done = work(*args, **kwargs)
        progress(stage, 1, 1)
        return done

    return said


class _Bars:
    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._tasks: dict[str, TaskID] = {}

    def __call__(self, stage: str, done: int, of: int) -> None:
        if stage not in self._tasks:
            self._tasks[stage] = self._bars.add_task(stage, total=of)
        self._bars.update(self._tasks[stage], completed=done, total=of)


class _Lines:
    """A line when a stage of some length ends, and one whenever nothing was heard of a run for a while."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._before = time.monotonic()  # a stage that speaks up only at its end began when the one before it ended
        self._spoken = self._before
        self._now = "begin"
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def __call__(self, stage: str, done: int, of: int) -> None:
        with self._lock:
            self._now = f"{stage}: {done} of {of}"
            if done >= of:
                if of > 1 or time.monotonic() - self._before >= SHORT:
                    self._say(self._now)
                self._now, self._before = f"after {stage}", time.monotonic()

    def close(self) -> None:
        self._ended.set()
        self._listener.join()

    def _say(self, what: str) -> None:
        self._spoken = time.monotonic()
        print(f"{what}, {self._spoken - self._before:.1f} s", file=self._console.file, flush=True)

    def _listen(self) -> None:
        while not self._ended.wait(QUIET / 4):
            with self._lock:
                if time.monotonic() - self._spoken >= QUIET:
                    self._say(f"{self._now} so far")
