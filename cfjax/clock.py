"""One clock for the stages of a run: what is shown while it runs is what `seconds` in result.json says."""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from cfjax.options import Progress


class Clock:
    """Seconds of each stage, and somebody who hears of them: at once where one begins, and when it ends.

    Stages may lie in each other: while an inner one runs, the outer one stands still. A clock is a `Progress` itself,
    for what runs within a stage.
    """

    def __init__(self, show: Progress | None = None, seconds: Mapping[str, float] | None = None) -> None:
        self._show: Progress = show or (lambda stage, done, of: None)
        self._spent = dict(seconds or {})
        self._open: list[str] = []
        self._of: dict[str, int] = {}
        self._since = time.perf_counter()

    @staticmethod
    def of(progress: Progress | None, seconds: Mapping[str, float] | None = None) -> "Clock":
        """The clock that somebody handed on, or a new one that goes on from `seconds` and tells `progress`."""
        return progress if isinstance(progress, Clock) else Clock(progress, seconds)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """What is done within counts for the stage, whatever comes of it; its end is shown if it comes to one."""
        if name in self._open:
            yield
            return
        self._stop()
        self._open.append(name)
        self._of[name] = 1
        self._spent.setdefault(name, 0.0)
        self._show(name, 0, 1)
        try:
            yield
        finally:
            self._stop()
            self._open.remove(name)
        self._show(name, self._of[name], self._of[name])

    def __call__(self, stage: str, done: int, of: int) -> None:
        """How far an open stage is; that it has ended is said where it ends."""
        self._of[stage] = of
        if done < of or stage not in self._open:
            self._show(stage, done, of)

    def spent(self, stage: str) -> float:
        """Seconds in the stage so far."""
        running = time.perf_counter() - self._since if self._open and self._open[-1] == stage else 0.0
        return self._spent.get(stage, 0.0) + running

    @property
    def seconds(self) -> dict[str, float]:
        """Of every stage so far, in the order in which they began."""
        return {stage: self.spent(stage) for stage in self._spent}

    def _stop(self) -> None:
        """What has passed counts for the innermost open stage."""
        now = time.perf_counter()
        if self._open:
            self._spent[self._open[-1]] += now - self._since
        self._since = now
