"""The main job as a user runs it: the real command, the files it leaves, and the checker on them."""

import csv
import itertools
import json
import re
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from cfjax.report.run_folder import read_run
from cfjax.verdict import Verdict
from tests.shapes import racing_line


Command = Callable[..., "subprocess.CompletedProcess[str]"]


def folder_of(run: "subprocess.CompletedProcess[str]", tmp_path: Path) -> Path:
    last = run.stdout.splitlines()[-1]
    assert last.startswith("run: ")
    return tmp_path / last.removeprefix("run: ")


def check(folder: Path) -> "subprocess.CompletedProcess[str]":
    line = [sys.executable, "-m", "cfjax.check", str(folder)]
    return subprocess.run(line, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    "path", ["circle", pytest.param("straight", marks=pytest.mark.slow)]
)  # the others' funnels: tests/rows
def test_every_steady_preset_ends_certified(command: Command, tmp_path: Path, path: str) -> None:
    run = command(f"+path={path}", "template=paper", "cars=200")
    assert run.returncode == 0, run.stderr
    folder = folder_of(run, tmp_path)
    result = json.loads((folder / "result.json").read_text())
    assert result["verdict"] == "certified"
    assert 0.97 * result["margin"]["falsified"] <= result["margin"]["certified"] <= result["margin"]["falsified"]
    (segment,) = result["segments"]
    assert {"duration", "C", "template", "c0", "beta", "beta_lower", "margin_certified"} <= segment.keys()
    assert (folder / "funnel.png").stat().st_size > 20_000
    assert "warning" not in run.stderr
    loop = result["closed_loop"]
    assert (loop["cars"], loop["left_funnel"], loop["left_safe"], loop["missed_goal"]) == (200, 0, 0, 0)
    assert result["inputs"] == {"u0": [0.5, 2.0], "w": [-1.0, 1.0], "thrust": [-4.0, 4.0]}
    assert result["seconds"].keys() >= {"learn", "certify", "total"}
    checked = check(folder)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    read = read_run(folder)
    assert read.verdict is Verdict.CERTIFIED and read.robustness is not None
    told = result["robustness"]
    assert 2e-4 < told["jointly"]["period"] < told["period"] == read.robustness.alone.period
    assert told["disturbance"].keys() == told["pose_error"].keys() == {"alpha", "x", "y", "v"}
    assert "control period: inputs are held for 0.00" in checked.stdout
    assert re.search(r"\n  control period  [\d.]+ ms \(control at \d+ Hz or faster\)\n", run.stdout)
    # the reference that is written is the one that the certificate speaks of
    document = json.loads((folder / "certificate.json").read_text())
    with (folder / "reference.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) >= 200 and float(rows[0]["theta"]) == 0.0
    assert float(rows[-1]["theta"]) == segment["duration"]
    assert document["funnels"][0]["margin"]
    assert np.isclose(float(rows[0]["v"]), result["margin"]["certified"] / result["margin_per_metre"])


@pytest.mark.slow
def test_nothing_found_is_inconclusive_and_leaves_no_certificate(command: Command, tmp_path: Path) -> None:
    run = command("+path=straight", "method=tt", "template=paper", "sets.goal=0.3", "rounds=1")
    assert run.returncode == 1, run.stderr
    folder = folder_of(run, tmp_path)
    result = json.loads((folder / "result.json").read_text())
    assert result["verdict"] == "inconclusive"
    assert result["margin"]["certified"] is None
    assert not (folder / "certificate.json").exists()
    assert check(folder).returncode == 2
    assert (folder / "funnel.png").exists()


@pytest.mark.slow
def test_thin_shell_has_a_tracking_funnel(command: Command, tmp_path: Path) -> None:
    run = command("+path=straight", "method=tt", "template=paper", "beta_lower=0.98", "cars=100", "logger=wandb")
    assert run.returncode == 0, run.stderr
    assert "warning" not in run.stderr
    result = json.loads((folder_of(run, tmp_path) / "result.json").read_text())
    assert list(folder_of(run, tmp_path).glob("**/*.wandb"))  # offline, in the run's own folder
    assert result["segments"][0]["beta_lower"] == 0.98
    assert result["inputs"]["u0"] == [1.0, 1.0]
    assert result["margin"]["certified"] > 0.06


@pytest.mark.slow
def test_a_tube_ends_certified(command: Command, tmp_path: Path) -> None:
    """One funnel for every path within bounds: the files say so, the checker too, and there is no reference.csv."""
    bounds = ["path.speed=[1,2]", "path.curvature=1.8", "sets.inlet=0.15", "sets.goal=0.25", "beta_inner=0.5"]
    run = command("+path=tube", *bounds, "method=tt", "cars=100")
    assert run.returncode == 0, run.stderr
    assert "warning" not in run.stderr
    folder = folder_of(run, tmp_path)
    result = json.loads((folder / "result.json").read_text())
    assert result["verdict"] == "certified"
    certified, falsified = result["margin"]["certified"], result["margin"]["falsified"]
    assert 0.97 * falsified <= certified <= falsified
    (segment,) = result["segments"]
    assert segment["duration"] is None
    assert segment["reference"] == {"speed": [1.0, 2.0], "curvature": [-1.8, 1.8], "acceleration": [0.0, 0.0]}
    assert (segment["rate"], segment["beta_inner"]) == (0.0, 0.5)
    assert result["margin_per_metre"] == segment["margin_per_metre"] <= certified <= 2 * result["margin_per_metre"]
    metres = (0.1 + 0.9 * np.log(0.9 / 0.5)) / segment["margin_per_metre"]  # u0 = 1
    assert segment["contraction"] == {"level": 0.5, "metres": pytest.approx(metres, rel=1e-9)}
    shape = np.array(segment["C"])
    for width, disturbance, exact, curvature in zip(
        segment["half_widths"].values(),
        segment["margin_as_disturbance"].values(),
        np.sqrt(np.diag(np.linalg.inv(shape))),
        np.diag(shape),
        strict=True,
    ):
        assert 0.15 < width < 0.25
        assert width == pytest.approx(exact, rel=1e-12)
        assert disturbance == pytest.approx(certified / 2 / np.sqrt(curvature), rel=1e-12)
    loop = result["closed_loop"]
    assert (loop["cars"], loop["left_funnel"], loop["left_safe"], loop["missed_goal"]) == (100, 0, 0, 0)
    assert loop["arrival"] is None
    assert not (folder / "reference.csv").exists()
    assert (folder / "funnel.png").stat().st_size > 50_000
    checked = check(folder)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    account = " ".join(checked.stdout.split())  # whose lines break anywhere
    assert "PROVEN: one control funnel function for every path within bounds" in account
    assert "curvature in [-1.8, 1.8] 1/m, which may jump" in account
    assert "from V = 1 inside V <= 0.5 within" in account
    assert "whatever curvature and acceleration do meanwhile" in account
    again = read_run(folder)
    assert again.robustness is not None and result["robustness"]["period"] == again.robustness.alone.period > 1e-4
    assert [band["speed"] for band in result["robustness"]["by_speed"]] == [[1.0, 2.0]]
    assert again.robustness.by_speed[0][2] == again.robustness.alone
    assert again.verdict is Verdict.CERTIFIED
    assert again.segments[0].margin_per_metre == segment["margin_per_metre"]
    assert again.segments[0].funnel.inner == 0.5


def test_a_racing_line_from_waypoints_is_held_by_a_tube_of_the_package(command: Command, tmp_path: Path) -> None:
    """A lap of more than 200 m, a car of another wheelbase: proven by what is there already."""
    line = racing_line()
    np.savetxt(tmp_path / "lap.csv", np.column_stack([line.real, line.imag]), delimiter=",")
    run = command("+path=waypoints", "path.file=lap.csv", "vehicle.wheelbase=0.33", "cars=50", "robustness=false")
    assert run.returncode == 0, run.stderr
    folder = folder_of(run, tmp_path)
    result = json.loads((folder / "result.json").read_text())
    assert (result["verdict"], result["closed"], result["margin"]["falsified"]) == ("certified", True, None)
    ends = [segment["theta"] for segment in result["segments"]]
    assert ends[0][0] == 0.0 and all(one[1] == other[0] for one, other in itertools.pairwise(ends))
    with (folder / "reference.csv").open() as file:
        rows = list(csv.DictReader(file))
    speeds = np.array([float(row["v"]) for row in rows])
    for segment in result["segments"]:
        assert segment["reference"]["speed"][0] <= speeds.min() and speeds.max() <= segment["reference"]["speed"][1]
    loop = result["closed_loop"]
    assert (loop["left_funnel"], loop["left_safe"], loop["missed_goal"]) == (0, 0, 0)
    checked = check(folder)
    assert checked.returncode == 0 and "lap after lap" in " ".join(checked.stdout.split())
    document = json.loads((folder / "certificate.json").read_text())
    assert sum(Fraction(p["duration"]) for p in document["problem"]["path"]["pieces"]) > 50
