"""Bars on a terminal, quiet lines in a file."""

import io
import time

import pytest
from rich.console import Console

import cfjax.report.progress
from cfjax.report.progress import progress_on, staged


@pytest.mark.parametrize("terminal", [False, True])
def test_lines_in_a_file_bars_on_a_terminal(terminal: bool) -> None:
    stream = io.StringIO()
    with progress_on(Console(file=stream, force_terminal=terminal, width=80)) as progress:
        for stage in ("learn", "certify", "learn"):
            for done in range(101):
                progress(stage, done, 100)
    text = stream.getvalue()
    if terminal:
        assert "100/100" in text
    else:
        stages = [line.split(",")[0] for line in text.splitlines()]
        assert stages == ["learn: 100 of 100", "certify: 100 of 100", "learn: 100 of 100"]


def test_a_long_stage_is_heard_of_before_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cfjax.report.progress, "QUIET", 0.04)
    stream = io.StringIO()
    with progress_on(Console(file=stream, width=80)) as progress:
        progress("learn", 1, 6)
        while not stream.getvalue():
            time.sleep(0.01)
    assert stream.getvalue().startswith("learn: 1 of 6 so far, 0.")


def test_a_short_step_has_no_line_and_an_error_ends_no_stage() -> None:
    heard: list[tuple[str, int, int]] = []
    assert staged(lambda *news: heard.append(news), "plot", max)(1, 2) == 2
    assert heard == [("plot", 0, 1), ("plot", 1, 1)]
    with pytest.raises(ZeroDivisionError):
        staged(lambda *news: heard.append(news), "report", divmod)(1, 0)
    assert heard[2:] == [("report", 0, 1)]
    stream = io.StringIO()
    with progress_on(Console(file=stream, width=80)) as progress:
        staged(progress, "plot", max)(1, 2)
    assert not stream.getvalue()
