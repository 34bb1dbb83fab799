"""Runs and sweeps through the command, on results made by hand: files, exit codes, what is printed."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import cfjax.report.plot
import cfjax.synthesis
import cfjax.train
from cfjax.conf import Config, preset, problem_of, yaml_of
from cfjax.funnel import Objective
from cfjax.problem import Problem, ball
from cfjax.report.run_folder import read_run, write_run
from cfjax.result import Result
from cfjax.verdict import Verdict
from scripts.keys import GROUPED, keys_of
from tests.shapes import eight, slalom


def _without_stages(said: str) -> list[str]:
    """The lines of stderr but those of stages of one step, which are said where the machine is slow."""
    return [line for line in said.splitlines() if not re.fullmatch(r"\w+: [\d.]+ s( in all)?", line)]


def test_run_ends_with_its_folder(
    train: Callable[..., int], quick: None, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert train("+path=circle", "method=tt", "template=paper") == 1  # inconclusive
    captured = capfd.readouterr()
    last = captured.out.splitlines()[-1]
    folder = Path(last.removeprefix("run: "))
    assert last.startswith("run: ")
    assert folder.is_relative_to(tmp_path / "outputs")
    files = {entry.name for entry in folder.iterdir()}
    assert files == {"result.json", "reference.csv", "funnel.png", "report.html", "config.yaml", ".hydra", ".lock"}
    data = json.loads((folder / "result.json").read_text())
    assert (data["verdict"], data["method"], data["path"], data["template"]) == (
        "inconclusive",
        "tt",
        "circle",
        "paper",
    )
    assert data["inputs"]["u0"] == [1.0, 1.0]
    assert _without_stages(captured.err) == ["learn: 6 of 6, 0.0 s"]


def test_without_a_path_it_is_the_oval(train: Callable[..., int], quick: None) -> None:
    assert train("hydra.run.dir=here") == 1
    assert read_run(Path("here")).problem == problem_of(preset("oval"))
    assert "name: oval" in Path("here/config.yaml").read_text()
    assert train("path.speed=1.5", "hydra.run.dir=there", "sets.inlet=0.4") == 1
    assert read_run(Path("there")).problem == problem_of(preset("oval", ["path.speed=1.5", "sets.inlet=0.4"]))


def test_sweep_without_a_path(train: Callable[..., int], quick: None, tmp_path: Path) -> None:
    assert train("-m", "path.speed=1,1.5") == 0
    assert [(row["path"], row["overrides"]) for row in _sweep(tmp_path)] == [
        ("oval", "+path=oval path.speed=1"),
        ("oval", "+path=oval path.speed=1.5"),
    ]


@pytest.mark.parametrize("chdir", ["false", "true"])
def test_waypoints_travel_with_the_run(
    chdir: str,
    train: Callable[..., int],
    quick: None,
    write: Callable[..., Path],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    file = write(slalom())
    problem = problem_of(preset("waypoints", [f"path.file={file}"]))
    text = file.read_bytes()
    assert train("+path=waypoints", "path.file=points.csv", "hydra.run.dir=here/run", f"hydra.job.chdir={chdir}") == 1
    assert f"{problem.path.source}\n" in capfd.readouterr().out
    file.unlink()
    folder = tmp_path / "here" / "run"
    assert (folder / "waypoints.csv").read_bytes() == text
    assert f"file: {file}\n" in (folder / "config.yaml").read_text()
    assert read_run(folder).problem == problem
    assert json.loads((folder / "result.json").read_text())["source"] == problem.path.source
    assert read_run(folder).problem.path.source == problem.path.source  # not that of the copy


@pytest.mark.slow
def test_waypoints_of_every_job_of_a_sweep(
    train: Callable[..., int], quick: None, write: Callable[..., Path], tmp_path: Path
) -> None:
    files = [write(make()).rename(tmp_path / name) for make, name in ((slalom, "slalom.csv"), (eight, "eight.csv"))]
    problems = [problem_of(preset("waypoints", [f"path.file={file}"])) for file in files]
    assert train("-m", "+path=waypoints", "path.file=slalom.csv,eight.csv,none.csv", "hydra.sweep.dir=all") == 2
    for file in files:
        file.unlink()
    assert [read_run(tmp_path / "all" / str(job)).problem for job in (0, 1)] == problems
    with (tmp_path / "all" / "table.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert [(row["path"], row["verdict"]) for row in rows] == [
        ("waypoints", "inconclusive"),
        ("waypoints", "inconclusive"),
        ("waypoints", "bad input"),
    ]
    assert f"{tmp_path}/none.csv: expected a CSV file of waypoints, there is no such file" in rows[2]["message"]


def test_two_runs_never_share_a_folder(train: Callable[..., int], quick: None, tmp_path: Path) -> None:
    assert [train("+path=straight") for _ in range(3)] == [1, 1, 1]
    assert len(list(tmp_path.glob("outputs/*/*/result.json"))) == 3


def test_finished_run_is_not_written_over(
    train: Callable[..., int], quick: None, capfd: pytest.CaptureFixture[str]
) -> None:
    assert train("+path=straight", "hydra.run.dir=here") == 1
    assert train("+path=straight", "hydra.run.dir=here") == 2
    assert "already holds a run" in capfd.readouterr().err


def test_interrupt(
    train: Callable[..., int], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cfjax.synthesis, "search", interrupted)
    assert train("+path=circle", "hydra.run.dir=here") == 130
    assert _without_stages(capfd.readouterr().err) == ["interrupted"]
    assert {entry.name for entry in (tmp_path / "here").iterdir()} == {".hydra", ".lock"}


def test_picture_that_fails_costs_nothing(
    train: Callable[..., int], quick: None, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("no ink")

    monkeypatch.setattr(cfjax.report.plot, "save_picture", broken)
    assert train("+path=circle", "hydra.run.dir=here") == 1
    assert "warning: funnel.png could not be drawn (RuntimeError: no ink)" in capfd.readouterr().err
    assert read_run(Path("here")).verdict is Verdict.INCONCLUSIVE


def test_help_and_configuration_are_shown(train: Callable[..., int], capfd: pytest.CaptureFixture[str]) -> None:
    assert train("--cfg", "job", "+path=circle") == 0
    assert "radius: 1.5" in capfd.readouterr().out
    for arguments in (["--cfg", "job"], ["path.speed=1.25", "--cfg", "job"], ["--cfg", "job", "seed=3", "cars=2"]):
        assert train(*arguments) == 0
        assert "name: oval" in capfd.readouterr().out


def test_help_is_one_screen_with_all_that_can_be_asked(
    train: Callable[..., int], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert train("--help") == 0
    text = capfd.readouterr().out
    assert len(text.splitlines()) <= 40 and max(map(len, text.splitlines())) <= 150
    for words in (
        "Exit codes",
        "130 interrupted",
        "joblib",
        "objective: inlet, margin, width",
        "cars=10000",
        "frame=paper",
    ):
        assert words in text
    assert text.count("  cfjax train ") == 5 and "_kind" not in text
    known = {key.strip("`") for key, *_ in keys_of(Config)}
    known |= {key.strip("`") for heading, owner in GROUPED.items() for key, *_ in keys_of(owner, f"{heading}.")}
    assert not {key for key in known if f"{key}=" not in text}

    assert train("+path=tube", "path.curvature=0.5", "--help", "-m", "seed=1,2") == 0
    text = capfd.readouterr().out
    assert "path.curvature=0.5  path.acceleration=0.0" in text and "seed=0" in text
    (tmp_path / "mine" / "path").mkdir(parents=True)
    (tmp_path / "mine" / "path" / "bend.yaml").write_text(
        "defaults: [/path_kind@_here_: circle]\nname: bend\nradius: 7\n"
    )
    assert train("--config-dir", "mine", "+path=bend", "--help") == 0
    assert "path: bend, circle" in (text := capfd.readouterr().out) and "path.radius=7" in text
    assert train("--help", "path.sped=3") == 2
    assert capfd.readouterr().err.splitlines() == [
        "error: path.sped: no such key; expected one of name, kind, speed; did you mean speed?"
    ]


def _sweep(tmp_path: Path) -> list[dict[str, str]]:
    (table,) = tmp_path.glob("multirun/*/table.csv")
    with table.open() as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_sweep_ends_with_a_table(
    train: Callable[..., int], quick: None, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    speeds = "path.speed=1.5708,3.1416,6.2832"
    assert train("-m", "+path=circle", speeds, "method=pf,tt", "template=paper") == 0  # every job ran to a verdict
    rows = _sweep(tmp_path)
    assert [row["overrides"] for row in rows][:2] == [
        "+path=circle path.speed=1.5708 method=pf template=paper",
        "+path=circle path.speed=1.5708 method=tt template=paper",
    ]
    assert {row["verdict"] for row in rows} == {"inconclusive"}
    assert {row["certified"] for row in rows} == {""}
    assert float(rows[0]["falsified"]) == 1 / 3
    paper = [(row["paper"], row["agreement"]) for row in rows]
    assert paper == [
        ("found", "differs"),
        ("found", "differs"),
        ("found", "differs"),
        ("not found", "agrees"),
        ("", ""),
        ("", ""),
    ]
    out = capfd.readouterr().out
    assert out.splitlines()[-1].startswith("sweep: ")
    assert "not found" in out


def test_sweep_over_templates(train: Callable[..., int], quick: None, tmp_path: Path) -> None:
    assert train("-m", "+path=circle", "template=contracting,paper") == 0
    rows = _sweep(tmp_path)
    assert [row["template"] for row in rows] == ["contracting", "paper"]
    # the paper speaks of its own template only
    assert [(row["paper"], row["agreement"]) for row in rows] == [("found", ""), ("found", "differs")]


def test_second_sweep_into_the_same_folder_is_refused(
    train: Callable[..., int], quick: None, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert train("-m", "+path=circle", "method=pf,tt", "hydra.sweep.dir=sw") == 0
    before = (tmp_path / "sw" / "table.csv").read_bytes()
    capfd.readouterr()
    assert train("-m", "+path=straight", "method=tt,pf", "hydra.sweep.dir=sw") == 2
    assert capfd.readouterr().err == "error: hydra.sweep.dir: expected an empty folder, but sw already holds a sweep\n"
    assert (tmp_path / "sw" / "table.csv").read_bytes() == before


def test_sweep_survives_bad_input_of_one_job(
    train: Callable[..., int], quick: None, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert train("-m", "+path=circle", "path.radius=1.5,0.1") == 2
    good, bad = _sweep(tmp_path)
    assert (good["verdict"], bad["verdict"]) == ("inconclusive", "bad input")
    assert "needs steering angle 73.61°, limit 45° (w = tan = 3.4)" in bad["message"]
    assert bad["path"] == "circle"


def test_sweep_survives_a_crash(
    train: Callable[..., int],
    quick: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    whole = cfjax.synthesis.search

    def breaks_at_two(problem: Problem, *rest: object) -> object:
        if problem.path.segments[0].point(0.0).speed == 2.0:
            raise RuntimeError("out of luck")
        return whole(problem, *rest)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(cfjax.synthesis, "search", breaks_at_two)
    assert train("-m", "+path=circle", "path.speed=2,3") == 1
    crashed, good = _sweep(tmp_path)
    assert (crashed["verdict"], crashed["message"], good["verdict"]) == ("crashed", "out of luck", "inconclusive")
    assert "Traceback" in capfd.readouterr().err


SLEEPER = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it from the start
import cfjax.synthesis, cfjax.train
cfjax.synthesis.search = lambda *_: (print("asleep", flush=True), time.sleep(100))
sys.argv = ["train", "+path=circle", "hydra.run.dir=here"]
sys.exit(cfjax.train.main())
"""


def test_interrupt_of_a_real_process(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(Path(cfjax.train.__file__).parents[1])}
    process = subprocess.Popen(
        [sys.executable, "-c", SLEEPER],
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == "asleep\n"
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=60)
    assert (process.returncode, _without_stages(error)) == (130, ["interrupted"])
    assert {entry.name for entry in (tmp_path / "here").iterdir()} == {".hydra", ".lock"}


def test_the_verdict_is_told_before_pictures_are_drawn(
    train: Callable[..., int], quick: None, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cfjax.report.plot.save_picture", lambda *_: print("drawn"))
    train("+path=circle", "hydra.run.dir=here")
    said = capfd.readouterr().out
    places = [said.find(words) for words in (": circle, path following (PF)", "drawn", "seconds: ", "run: ")]
    assert places[0] > -1 and places == sorted(places)
    assert said.count(": circle, path following (PF)") == 1


def test_summary_says_whether_the_objective_was_reached(hand_made: Callable[..., Result]) -> None:
    problem = problem_of(preset("circle"))
    certified = hand_made(problem, margin=0.3, verdict=Verdict.CERTIFIED)
    assert "objective" not in certified.describe()
    said = certified.describe(Objective("width", 0.4))
    assert "objective.margin: 0.4 1/s was not reached; this is the largest margin that was found" in said
    said = certified.describe(Objective("inlet", 0.2))
    assert "inlet alpha 0.5 rad; funnel's half-widths alpha 0.4" in said


def test_who_has_no_proof_is_told_what_helps(hand_made: Callable[..., Result]) -> None:
    problem = problem_of(preset("circle"))
    page = "docs/not-certified.md"
    assert page in hand_made(problem).describe()
    assert page not in hand_made(problem, margin=0.3, verdict=Verdict.CERTIFIED).describe()
    assert (Path(__file__).parents[2] / page).exists()


def test_an_unproven_tube_is_written_and_read(
    train: Callable[..., int], quick: None, capfd: pytest.CaptureFixture[str]
) -> None:
    assert train("+path=tube") == 1
    folder = Path(capfd.readouterr().out.splitlines()[-1].removeprefix("run: "))
    assert not (folder / "reference.csv").exists() and not (folder / "certificate.json").exists()
    (segment,) = json.loads((folder / "result.json").read_text())["segments"]
    assert segment["duration"] is None and segment["margin_per_metre"] is None
    assert segment["contraction"] == {"level": 0.9, "metres": None}
    again = read_run(folder)
    assert again.segments[0].funnel.duration == float("inf")
    assert again.margin_certified is None


def test_inlet_that_was_enlarged_is_read_back(tmp_path: Path, hand_made: Callable[..., Result]) -> None:
    config = preset("circle", ["objective=inlet", "objective.margin=0.1"])
    problem = problem_of(config)
    wide = replace(problem, inlet=ball(0.55))
    write_run(hand_made(wide), tmp_path / "run", yaml_of(config))
    assert read_run(tmp_path / "run").problem == wide
