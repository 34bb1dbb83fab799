"""The launchers of a sweep, with real worker processes: one tiny sweep, which every launcher takes on in its turn."""

import importlib.util
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import polars as pl
import psutil
import pytest

import cfjax.train


# 3 s a job, and one that is refused at once
TINY = ("-m", "+path=straight", "certificate=tube", "cars=0", "robustness=false", "sets.inlet=0.1,0.2,-1")
LAUNCHERS = {  # with what they say when they begin
    "joblib": (("hydra.launcher.n_jobs=2",), "Joblib.Parallel(n_jobs=2"),
    "submitit_local": ((), "Submitit 'local'"),
    "ray": ((), "Started a local Ray instance"),
}
pytestmark = pytest.mark.slow
WITHOUT_RAY = pytest.mark.skipif(not importlib.util.find_spec("ray"), reason="the extra ray is not installed")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("launchers")


@contextmanager
def sweep(launcher: str, place: Path) -> Iterator["subprocess.Popen[str]"]:
    """The tiny sweep's command at work; stderr comes with stdout."""
    environment = {**os.environ, "PYTHONPATH": str(Path(cfjax.train.__file__).parents[1]), "RAY_AUTH_MODE": "disabled"}
    line = [sys.executable, "-m", "cfjax.train", *TINY, f"hydra/launcher={launcher}", *LAUNCHERS[launcher][0]]
    output: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(line, cwd=place, env=environment, text=True, **output) as process:
        yield process


def answer(job: Path) -> dict[str, Any]:
    """What the job found, without its times."""
    return {key: value for key, value in json.loads((job / "result.json").read_text()).items() if key != "seconds"}


def worker_on(job: Path, command: psutil.Process) -> psutil.Process | None:
    """The process that holds the job's lock."""
    for process in command.children(recursive=True):
        with suppress(psutil.Error):
            if str(job / ".lock") in [file.path for file in process.open_files()]:
                return process
    return None


def test_a_killed_worker_ends_the_command_with_its_table(place: Path) -> None:
    with sweep("joblib", place) as process:
        while not (locks := list(place.glob("multirun/*/1/.lock"))):
            assert process.poll() is None
            time.sleep(0.05)
        job = locks[0].parent
        while not (worker := worker_on(job, psutil.Process(process.pid))):
            assert process.poll() is None
            time.sleep(0.05)
        worker.kill()
        output, _ = process.communicate()
    assert process.returncode == 1
    assert "job 1: crashed: the job did not end" in output
    assert output.endswith("the same command goes on\n")
    assert not (job / "result.json").exists()


def test_a_worker_outlives_its_killed_command_by_one_job(place: Path) -> None:
    (job,) = place.glob("multirun/*/1")
    with sweep("joblib", place) as process:
        while not (worker := worker_on(job, psutil.Process(process.pid))):
            assert process.poll() is None
            time.sleep(0.05)
        process.kill()
    worker.wait(60)
    assert json.loads((job / "result.json").read_text())["verdict"] == "certified"


@pytest.mark.parametrize("launcher", ["joblib", "submitit_local", pytest.param("ray", marks=WITHOUT_RAY)])
def test_a_launcher_runs_what_the_one_before_left(launcher: str, place: Path) -> None:
    """A sweep is the same whoever runs it: of a finished one, with a result taken away, just that job runs again."""
    before = None
    jobs = sorted(result.parent for result in place.glob("multirun/*/[01]/result.json"))
    if len(jobs) == 2:
        before = answer(jobs[1]), (jobs[0] / "result.json").read_bytes()
        (jobs[1] / "result.json").unlink()
    with sweep(launcher, place) as process:
        output, _ = process.communicate()
    assert process.returncode == 2, output
    assert LAUNCHERS[launcher][1] in output
    assert "job 2: bad input: sets.inlet: expected a positive finite number, got -1" in output
    (folder,) = place.glob("multirun/*")
    table = pl.read_csv(folder / "table.csv")
    assert table["verdict"].to_list() == ["certified", "certified", "bad input"]
    assert table["swept.sets.inlet"].to_list() == [0.1, 0.2, -1.0]
    if before:
        assert before == (answer(folder / "1"), (folder / "0" / "result.json").read_bytes())
