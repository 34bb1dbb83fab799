"""How a run shows where it is: bars on a terminal, one line per finished stage in a file. All of it on stderr."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID, TextColumn
from rich.text import Text

from cfjax.clock import Clock


@contextmanager
def progress_on(console: Console | None = None) -> Iterator[Clock]:
    """The clock of a run, whose stages are shown as they begin and end."""
    console = Console(stderr=True) if console is None else console
    if not console.is_terminal:
        yield _Lines(console).clock
        return
    shown = _Bars()
    with Progress(TextColumn("{task.description:>12}"), BarColumn(), shown, console=console) as bars:
        shown.bars = bars
        yield shown.clock


class _Bars(ProgressColumn):
    """A bar for every stage, and beside it how far it is and its seconds; to and fro where it has one step alone."""

    max_refresh = 0.5
    bars: Progress

    def __init__(self) -> None:
        super().__init__()
        self.clock = Clock(self.show)
        self._tasks: dict[str, TaskID] = {}

    def show(self, stage: str, done: int, of: int) -> None:
        if stage not in self._tasks:
            self._tasks[stage] = self.bars.add_task(stage, total=None)
        self.bars.update(self._tasks[stage], completed=done, total=of if of > 1 or done else None)

    def render(self, task: Task) -> Text:
        count = f"{task.completed:.0f} of {task.total:.0f}, " if (task.total or 0) > 1 else ""
        return Text(f"{count}{self.clock.spent(task.description):.1f} s")


class _Lines:
    def __init__(self, console: Console) -> None:
        self.clock = Clock(self.show)
        self._console = console
        self._shown: set[str] = set()

    def show(self, stage: str, done: int, of: int) -> None:
        if done >= of:
            count = f"{done} of {of}, " if of > 1 else ""
            again = " in all" if stage in self._shown else ""
            self._shown.add(stage)
            line = f"{stage}: {count}{self.clock.spent(stage):.1f} s{again}"
            print(line, file=self._console.file, flush=True)
