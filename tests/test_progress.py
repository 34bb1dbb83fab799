"""Bars on a terminal, quiet lines in a file, and one clock for both and for what is written."""

import io
import re
import sys
import time
from contextlib import suppress
from types import SimpleNamespace

import IPython.display
import pytest
from rich.console import Console

import cfjax
import cfjax.progress
from cfjax.clock import Clock
from cfjax.progress import progress_on, watched


@pytest.fixture
def hours(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What the clock reads: the last entry."""
    reads = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: reads[-1])
    return reads


@pytest.mark.parametrize("terminal", [False, True])
def test_lines_in_a_file_bars_on_a_terminal(terminal: bool, hours: list[float]) -> None:
    stream = io.StringIO()
    with progress_on(Console(file=stream, force_terminal=terminal, width=80)) as clock:
        for stage, spent in (("learn", 2.0), ("certify", 0.25), ("learn", 1.5)):
            with clock.stage(stage):
                for done in range(101):
                    clock(stage, done, 100)
                hours.append(hours[-1] + spent)
        with clock.stage("plot"):
            hours.append(hours[-1] + 7.0)
    assert clock.seconds == {"learn": 3.5, "certify": 0.25, "plot": 7.0}
    text = stream.getvalue()
    if terminal:
        last = [line.split("━\x1b[0m ")[-1].strip() for line in text.replace("\x1b[?25h", "").splitlines()[-3:]]
        assert last == ["100 of 100, 3.5 s", "100 of 100, 0.2 s", "7.0 s"]
    else:
        assert text.splitlines() == [
            "learn: 100 of 100, 2.0 s",
            "certify: 100 of 100, 0.2 s",
            "learn: 100 of 100, 3.5 s in all",
            "plot: 7.0 s",
        ]


def test_a_stage_is_shown_when_it_begins() -> None:
    stream = io.StringIO()
    with progress_on(Console(file=stream, force_terminal=True, width=80)) as clock, clock.stage("learn"):
        time.sleep(0.2)
    assert stream.getvalue().count("learn") > 1


def test_who_is_told_hears_of_begin_and_end_once(hours: list[float]) -> None:
    heard: list[tuple[str, int, int]] = []
    clock = Clock(lambda *call: heard.append(call), {"learn": 10.0})
    assert Clock.of(clock) is clock
    with clock.stage("tubes"):
        hours.append(1.0)
        with clock.stage("learn"):
            hours.append(3.0)
            clock("learn", 1, 2)
            with clock.stage("learn"):
                hours.append(4.0)
            clock("learn", 2, 2)
        hours.append(8.0)
    assert heard == [("tubes", 0, 1), ("learn", 0, 1), ("learn", 1, 2), ("learn", 2, 2), ("tubes", 1, 1)]
    assert clock.seconds == {"learn": 13.0, "tubes": 5.0}


def test_time_that_ends_in_an_error_counts_and_no_end_is_told(hours: list[float]) -> None:
    heard: list[tuple[str, int, int]] = []
    clock = Clock(lambda *call: heard.append(call))
    with suppress(ZeroDivisionError), clock.stage("certify"):
        hours.append(2.0)
        raise ZeroDivisionError
    assert heard == [("certify", 0, 1)]
    assert clock.seconds == {"certify": 2.0}


def test_a_long_stage_is_heard_of_before_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cfjax.progress, "QUIET", 0.04)
    stream = io.StringIO()
    with progress_on(Console(file=stream, width=80)) as clock, clock.stage("learn"):
        clock("learn", 1, 6)
        while not stream.getvalue():
            time.sleep(0.01)
    assert stream.getvalue().startswith("learn: 1 of 6, 0.")
    assert "so far" in stream.getvalue()


def test_before_the_first_step_one_hears_of_compiling(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cfjax.progress, "QUIET", 0.04)
    stream = io.StringIO()
    with progress_on(Console(file=stream, width=80)) as clock, clock.stage("learn"):
        clock("learn", 0, 6)
        while "so far" not in stream.getvalue():
            time.sleep(0.01)
        clock("learn", 6, 6)
    first, *_, last = stream.getvalue().splitlines()
    assert first.startswith("learn: 0 of 6 (compiling first), 0.")
    assert last.startswith("learn: 6 of 6, 0.")


def test_a_short_step_has_no_line() -> None:
    stream = io.StringIO()
    with progress_on(Console(file=stream, width=80)) as clock, clock.stage("plot"):
        pass
    assert not stream.getvalue()


def on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """A terminal in place of stderr; no fixture, as pytest sets stderr anew before a test is called."""
    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm-256color")
    return stream


def test_python_shows_bars_on_a_terminal_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    terminal = on_a_terminal(monkeypatch)
    with watched(None, {"learn": 10.0}) as clock, clock.stage("simulate"), watched(clock) as same:
        assert same is clock
    assert clock.seconds["learn"] == 10.0
    assert "simulate" in terminal.getvalue()
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with watched(None) as clock, clock.stage("learn"):
        pass
    assert (sys.stderr.getvalue(), capsys.readouterr()) == ("", ("", ""))


def test_who_asks_to_hear_has_no_bars(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = on_a_terminal(monkeypatch)
    heard: list[tuple[str, int, int]] = []
    with watched(lambda *call: heard.append(call)) as clock, clock.stage("learn"):
        pass
    assert heard == [("learn", 0, 1), ("learn", 1, 1)]
    assert not terminal.getvalue()


def test_a_notebook_has_a_line_for_every_stage(monkeypatch: pytest.MonkeyPatch, hours: list[float]) -> None:
    shown: list[str] = []

    class Output:
        def update(self, content: dict[str, str], raw: bool) -> None:
            assert raw
            shown.append(content["text/plain"])

    def display(content: dict[str, str], raw: bool, display_id: bool) -> Output:
        assert display_id and not shown
        Output().update(content, raw)
        return Output()

    monkeypatch.setattr(cfjax.progress, "Console", lambda: SimpleNamespace(is_jupyter=True))
    monkeypatch.setattr(IPython.display, "display", display)
    with watched(None) as clock:
        with clock.stage("learn"):
            hours.append(1.5)
            clock("learn", 1, 2)
        with clock.stage("simulate"):
            hours.append(4.0)
    assert shown == [
        "       learn  …",
        "       learn  1 of 2",
        "       learn  2 of 2, 1.5 s",
        "       learn  2 of 2, 1.5 s\n    simulate  …",
        "       learn  2 of 2, 1.5 s\n    simulate  2.5 s",
    ]


def test_a_synthesis_is_shown_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stages and seconds as `seconds` has them; one display for search and drive."""
    terminal = on_a_terminal(monkeypatch)
    problem = cfjax.Problem(cfjax.circle(1.5), 0.2, 0.5)
    result = cfjax.synthesize(problem, cfjax.Options(certificate="tube", cars=10))
    last = re.sub(r"\x1b\[[0-9;?]*\w", "", terminal.getvalue()).strip().splitlines()[-2:]
    shown = [(line.split()[0], line.split()[-2]) for line in last]
    assert shown == [(stage, f"{result.seconds[stage]:.1f}") for stage in ("tubes", "simulate")]
