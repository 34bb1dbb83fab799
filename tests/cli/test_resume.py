"""A sweep goes on with the same command: what is done stays, the rest is done, and nobody else writes meanwhile."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest

import cfjax.gather
import cfjax.report.tracking
import cfjax.synthesis
import cfjax.train
from cfjax.conf import Config
from cfjax.result import Result


SWEEP = ("-m", "+path=circle", "path.speed=1,2,3", "hydra.sweep.dir=sw")


def test_only_what_is_not_done_runs_again(
    train: Callable[..., int], quick: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[float] = []
    whole = cfjax.synthesis.search

    def counted(problem: object, *rest: object) -> object:
        asked.append(problem.path.segments[0].point(0.0).speed)  # pyright: ignore
        return whole(problem, *rest)  # pyright: ignore

    monkeypatch.setattr(cfjax.synthesis, "search", counted)
    assert train(*SWEEP) == 0
    first = (tmp_path / "sw" / "0" / "result.json").read_bytes()
    (tmp_path / "sw" / "1" / "result.json").unlink()  # as where a job was killed
    (tmp_path / "sw" / "2" / "result.json").unlink()
    (tmp_path / "sw" / "2" / "error.json").write_text('{"kind": "crashed", "message": "once"}')
    asked.clear()
    assert train(*SWEEP) == 0
    assert asked == [2.0, 3.0]
    assert (tmp_path / "sw" / "0" / "result.json").read_bytes() == first
    table = pl.read_csv(tmp_path / "sw" / "table.csv")
    assert table["verdict"].to_list() == ["inconclusive"] * 3
    assert table["swept.path.speed"].to_list() == [1, 2, 3]


def test_the_same_command_finds_its_folder_and_another_one_does_not(
    train: Callable[..., int], quick: None, tmp_path: Path
) -> None:
    assert train("-m", "+path=circle", "path.speed=1,2") == 0
    assert train("-m", "+path=circle", "path.speed=1,2", "hydra.verbose=false") == 0
    assert len(list(tmp_path.glob("multirun/*"))) == 1
    assert train("-m", "+path=circle", "path.speed=1,3") == 0
    assert len(list(tmp_path.glob("multirun/*"))) == 2


def test_a_run_of_another_question_answers_for_no_job(train: Callable[..., int], quick: None, tmp_path: Path) -> None:
    assert train(*SWEEP) == 0
    config = tmp_path / "sw" / "1" / "config.yaml"
    config.write_text(config.read_text().replace("seed: 0", "seed: 1"))
    assert train(*SWEEP) == 2
    assert pl.read_csv(tmp_path / "sw" / "table.csv")["verdict"].to_list()[1] == "bad input"


@pytest.mark.slow
def test_a_job_whose_log_was_cut_off_is_logged_again(
    train: Callable[..., int], quick: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    logged: list[tuple[float, str | None]] = []

    def log(result: Result, config: Config, folder: Path, group: str | None) -> None:
        speed = result.problem.path.segments[0].point(0.0).speed
        logged.append((speed, group))
        (folder / "wandb" / f"offline-run-{len(logged)}").mkdir(parents=True)
        if len(logged) == 2:
            raise RuntimeError("cut off")

    monkeypatch.setattr(cfjax.report.tracking, "_log", log)
    assert train(*SWEEP, "logger=wandb") == 0
    assert train(*SWEEP, "logger=wandb") == 0
    assert logged == [(1.0, "sw"), (2.0, "sw"), (3.0, "sw"), (2.0, "sw")]
    assert [path.name for path in (tmp_path / "sw" / "1" / "wandb").iterdir()] == ["offline-run-4"]
    assert train(*SWEEP, "logger=wandb") == 0
    assert len(logged) == 4


@pytest.mark.slow
def test_hydras_own_files_may_be_cut_off(train: Callable[..., int], quick: None, tmp_path: Path) -> None:
    """They are the only ones that are not written whole; a finished job needs none of them, and all are made anew."""
    assert train(*SWEEP) == 0
    sweep = tmp_path / "sw"
    (sweep / "2" / "result.json").unlink()
    whole = {file: file.read_text() for file in (*sweep.glob("*/.hydra/*.yaml"), sweep / "multirun.yaml")}
    assert len(whole) == 10
    for file, text in whole.items():
        file.write_text(text[: len(text) - 3])
    assert cfjax.gather.main(["sw"]) == 0
    gathered = pl.read_csv(sweep / "gathered" / "table.csv", infer_schema=False)
    assert gathered["swept.path.speed"].to_list()[:2] == ["1", "2"]
    assert train(*SWEEP) == 0
    assert pl.read_csv(sweep / "table.csv")["swept.path.speed"].to_list() == [1, 2, 3]
    assert {file: file.read_text() for file in whole} == whole


KILLED = """
import sys, time
import cfjax.train, cfjax.synthesis
whole = cfjax.synthesis.search
def search(problem, *rest):
    if problem.path.segments[0].point(0.0).speed == 2.0:
        print("asleep", flush=True)
        time.sleep(100)
    return whole(problem, *rest)
cfjax.synthesis.search = search
sys.argv = ["train", *sys.argv[1:]]
sys.exit(cfjax.train.main())
"""
TINY = (
    "-m",
    "+path=straight",
    "path.speed=1.5,2,3",
    "certificate=tube",
    "sets.inlet=0.2",
    "cars=0",
    "robustness=false",
)


@pytest.mark.slow
def test_a_killed_sweep_goes_on(command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(Path(cfjax.train.__file__).parents[1])}
    line = [sys.executable, "-c", KILLED, *TINY]
    process = subprocess.Popen(line, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True)
    with process:
        assert process.stdout is not None
        while process.stdout.readline() != "asleep\n":
            assert process.poll() is None
        again = command(*TINY)
        assert (again.returncode, again.stderr.count("\n")) == (2, 1)
        assert "another process is at work in" in again.stderr
        process.send_signal(signal.SIGKILL)
    (sweep,) = tmp_path.glob("multirun/*")
    stamp = (sweep / "0" / "result.json").stat().st_mtime_ns
    done = command(*TINY)
    assert done.returncode == 0, done.stderr
    assert (sweep / "0" / "result.json").stat().st_mtime_ns == stamp
    assert pl.read_csv(sweep / "table.csv")["verdict"].to_list() == ["certified"] * 3


def test_gathered_while_a_job_is_open(
    train: Callable[..., int], quick: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert train(*SWEEP) == 0
    (tmp_path / "sw" / "1" / "result.json").unlink()
    assert cfjax.gather.main(["sw"]) == 0
    assert "1 of the 3 jobs that were begun have no verdict" in capsys.readouterr().out
    gathered = tmp_path / "sw" / "gathered"
    assert {file.name for file in gathered.iterdir()} == {"table.csv", "table.parquet", "margin.png"}
    assert pl.read_parquet(gathered / "table.parquet")["falsified"].to_list() == [1 / 3, None, 1 / 3]


def test_no_sweep_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cfjax.gather.main([str(tmp_path / "none")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
