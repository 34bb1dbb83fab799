"""Bars on a terminal, quiet lines in a file."""

import io

import pytest
from rich.console import Console

from cfjax.report.progress import progress_on


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
