"""How a run shows where it is: bars on a terminal; in a file one line per finished stage, and one where it takes long.

All of it on stderr. In a notebook each cell has a line for every stage, below the cell.
"""

import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, ProgressColumn, Task, TaskID, TextColumn
from rich.progress import Progress as Bars
from rich.text import Text

from cfjax.clock import Clock
from cfjax.options import Progress


QUIET = 20.0  # s: so long a file hears nothing of a run, at most
SHORT = 1.0  # s: a stage of one step that takes less is worth no line


@contextmanager
def watched(progress: Progress | None, seconds: Mapping[str, float] | None = None) -> Iterator[Clock]:
    """The clock of what Python asked for: the one that was handed on, or a new one, which tells `progress`.

    Where that is None, a terminal has bars and a notebook lines; a file or a pipe hears nothing.
    """
    if progress is not None:
        yield Clock.of(progress, seconds)
    elif Console().is_jupyter:
        yield _Cell(seconds).clock
    elif sys.stderr.isatty():
        with progress_on(seconds=seconds) as clock:
            yield clock
    else:
        yield Clock(seconds=seconds)


@contextmanager
def progress_on(console: Console | None = None, seconds: Mapping[str, float] | None = None) -> Iterator[Clock]:
    """The clock of a run, whose stages are shown as they begin and end; it goes on from `seconds`."""
    console = Console(stderr=True) if console is None else console
    if not console.is_terminal:
        lines = _Lines(console, seconds)
        try:
            yield lines.clock
        finally:
            lines.close()
        return
    shown = _Bars(seconds)
    columns = (TextColumn("{task.description:>12}"), BarColumn(), shown)
    # what is printed meanwhile appears above the bars, unless it goes to a file
    with Bars(*columns, console=console, redirect_stdout=sys.stdout.isatty()) as bars:
        shown.bars = bars
        yield shown.clock


def _count(done: int, of: int) -> list[str]:
    """How far a stage of several steps is. Before the first one, programs are compiled, or loaded where kept."""
    if of <= 1:
        return []
    return [f"{done} of {of}" if done else f"0 of {of} (compiling first)"]


class _Bars(ProgressColumn):
    """A bar for every stage, and beside it how far it is and its seconds; to and fro where it has one step alone."""

    max_refresh = 0.5
    bars: Bars

    def __init__(self, seconds: Mapping[str, float] | None) -> None:
        super().__init__()
        self.clock = Clock(self.show, seconds)
        self._tasks: dict[str, TaskID] = {}

    def show(self, stage: str, done: int, of: int) -> None:
        if stage not in self._tasks:
            self._tasks[stage] = self.bars.add_task(stage, total=None)
        self.bars.update(self._tasks[stage], completed=done, total=of if of > 1 or done else None)

    def render(self, task: Task) -> Text:
        count = _count(int(task.completed), int(task.total or 0))
        return Text(", ".join([*count, f"{self.clock.spent(task.description):.1f} s"]))


class _Lines:
    """A line when a stage of some length ends, and one whenever nothing was heard of a run for a while."""

    def __init__(self, console: Console, seconds: Mapping[str, float] | None) -> None:
        self.clock = Clock(self.show, seconds)
        self._console = console
        self._shown: set[str] = set()
        self._now = ("begin", 0, 1)
        self._spoken = time.monotonic()
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def show(self, stage: str, done: int, of: int) -> None:
        with self._lock:
            self._now = stage, done, of
            if done >= of and (of > 1 or self.clock.spent(stage) >= SHORT):
                again = " in all" if stage in self._shown else ""
                self._shown.add(stage)
                self._say(again)

    def close(self) -> None:
        self._ended.set()
        self._listener.join()

    def _say(self, note: str) -> None:
        stage, done, of = self._now
        self._spoken = time.monotonic()
        said = ", ".join([*_count(done, of), f"{self.clock.spent(stage):.1f} s"])
        print(f"{stage}: {said}{note}", file=self._console.file, flush=True)

    def _listen(self) -> None:
        while not self._ended.wait(QUIET / 4):
            with self._lock:
                if time.monotonic() - self._spoken >= QUIET:
                    self._say(" so far")


class _Cell:
    """A line for every stage in an output of a notebook's cell, which changes as they go on."""

    def __init__(self, seconds: Mapping[str, float] | None) -> None:
        self.clock = Clock(self.show, seconds)
        self._lines: dict[str, str] = {}
        self._output: Any = None

    def show(self, stage: str, done: int, of: int) -> None:
        spent = [f"{self.clock.spent(stage):.1f} s"] if done >= of else []
        self._lines[stage] = f"{stage:>12}  {', '.join(_count(done, of) + spent) or '…'}"
        content = {"text/plain": "\n".join(self._lines.values())}
        if self._output is None:
            from IPython.display import display  # what runs in a notebook has it

            self._output = display(content, raw=True, display_id=True)
        else:
            self._output.update(content, raw=True)
