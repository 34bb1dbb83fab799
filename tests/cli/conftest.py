"""The command in this process, with results made by hand where a synthesis would be slow, and in its own."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import absl.logging
import pytest

import cfjax.report.page
import cfjax.report.plot
import cfjax.synthesis
import cfjax.train
from cfjax.options import Options, Progress
from cfjax.problem import Problem
from cfjax.result import Result


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, hand_made: Callable[..., Result]) -> None:
    """search returns a hand-made result, and nothing is drawn."""

    def search(problem: Problem, options: Options = Options(), progress: Progress | None = None) -> Result:
        if progress is not None:
            progress("learn", 6, 6)
        return hand_made(problem, options.template)

    monkeypatch.setattr(cfjax.synthesis, "search", search)
    monkeypatch.setattr(cfjax.report.plot, "save_picture", lambda result, path: path.write_bytes(b"a picture"))
    monkeypatch.setattr(cfjax.report.page, "save_page", lambda result, path: path.write_text("a page"))


@pytest.fixture
def train(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., int]:
    """cfjax.train.main with the given arguments, in an empty working directory; returns the exit code."""
    for name, value in dict(os.environ).items():
        monkeypatch.setenv(name, value)  # puts back what the command sets
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    # Hydra shuts down all log handlers, and absl's closes the stream that stderr was when optax was imported: pytest's
    monkeypatch.setattr(absl.logging.get_absl_handler().python_handler, "stream", sys.__stderr__)
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> int:
        monkeypatch.setattr(sys, "argv", ["train.py", *arguments])
        return cfjax.train.main()

    return run


@pytest.fixture
def command(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """`python -m cfjax.train` in a process of its own, in an empty working directory."""
    package = Path(cfjax.train.__file__).parents[1]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(package), os.environ.get("PYTHONPATH", "")])}

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        line = [sys.executable, "-m", "cfjax.train", *arguments]
        return subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    return run
