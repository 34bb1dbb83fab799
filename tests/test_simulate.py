"""`python -m cfjax.simulate`: what it writes, and what it says to bad input."""

import csv
import json
import lzma
import math
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import cfjax.simulate as command
from cfjax.errors import InputError
from cfjax.problem import Frame, Interval, Problem, ball, circle, tube
from cfjax.report import run_folder
from cfjax.report.simulated import account_of_period
from cfjax.result import Absorbed, Robustness, Sampled
from cfjax.simulation import experiment
from cfjax.simulation.experiment import Setup, set_up
from cfjax.tubes.along import winding
from cfjax.verdict import Verdict


LIBRARY = "normal-gentle-slow.json.xz"


@pytest.fixture(autouse=True)
def runs_are_in_the_papers_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """The runs here are made by hand: no folder says so."""
    monkeypatch.setattr(run_folder, "read_frame", lambda folder: Frame.PAPER)


def test_it_writes_summary_cars_picture_and_animation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, hand_made
) -> None:
    run = hand_made(Problem(circle()), margin=0.3, verdict=Verdict.CERTIFIED)
    monkeypatch.setattr(run_folder, "read_run", lambda folder, vehicle: run)
    monkeypatch.setattr("cfjax.report.animation.FRAMES", 3)
    # as many cars, and the class of plant, as in tests/simulation/test_sampled.py: compiled once for both
    plant = ["--plant", "disturbed:x=0.001", "--n", "16"]
    arguments = [
        *plant,
        "--period",
        "0.1",
        "--noise",
        "mocap",
        "--frame",
        "ros",
        "--animate",
        "--out",
        str(tmp_path / "out"),
    ]
    assert command.main([str(tmp_path), *arguments]) == 0
    out = tmp_path / "out"
    assert capsys.readouterr().out.splitlines()[-1] == f"simulation: {out}"
    summary = json.loads((out / "summary.json").read_text())
    assert summary["cars"] == 16 and summary["question"]["noise"] == "mocap" and summary["period"] == 0.1
    assert summary["question"]["plant"] == "disturbed:x=0.001"
    with (out / "cars.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 16 and list(rows[0])[:5] == ["car", "yaw", "x", "y", "v"]
    # the circle begins in (1.5, 0), where it leads along +y; the file is one of starts, as it stands
    assert np.mean([float(row["yaw"]) for row in rows]) == pytest.approx(math.pi / 2, abs=0.3)
    again = set_up(Setup(tmp_path, starts=str(out / "cars.csv"), period=0.1), run, Frame.PAPER)
    np.testing.assert_allclose(again.starts[:, 0], [float(row["yaw"]) - math.pi / 2 for row in rows], atol=1e-15)
    with Image.open(out / "simulation.gif") as film, Image.open(out / "simulation.png") as picture:
        assert getattr(film, "n_frames", 1) > 1 and picture.width > 500

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(experiment, "drive_sampled", lambda *_, **__: interrupted())
    assert command.main([str(tmp_path), *arguments]) == 130


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--plant", "hovercraft"], "plant: expected one of model, disturbed"),
        (["--noise", "fog"], "noise: expected one of none, mocap, wifi"),
        (["--frame", "rosy"], "frame: expected one of paper, ros, got rosy; did you mean ros?"),
        (["--law", "pid"], "law: expected one of min_norm"),
        (["--n", "0"], "--n: expected at least one car"),
        (["--period", "-1"], "--period: expected seconds between 0 and"),
        (["--starts", "nowhere.csv"], "--starts: expected random, worst or a CSV file"),
        (["--path", "points.csv"], "--path: expected the run of a tube"),
        (["--laps", "0"], "laps: expected 1"),
        (["--plant", "commonroad"], "vehicle.wheelbase within 10 % of 2.579 m"),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
    hand_made,
) -> None:
    if arguments[1] == "commonroad":
        pytest.importorskip("vehiclemodels")
    run = hand_made(Problem(circle()), margin=0.3, verdict=Verdict.CERTIFIED)
    monkeypatch.setattr(run_folder, "read_run", lambda folder, vehicle: run)
    assert command.main([str(tmp_path), *arguments]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1


def test_no_run_an_uncertified_one_and_words_that_are_no_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, hand_made
) -> None:
    assert command.main([str(tmp_path / "nowhere")]) == 2
    with pytest.raises(SystemExit, match="2"):
        command.main([str(tmp_path), "--n", "many"])
    monkeypatch.setattr(run_folder, "read_run", lambda folder, vehicle: hand_made(Problem(circle())))
    assert command.main([str(tmp_path)]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 3 and "expected a certified run" in said[-1]


def test_a_missing_extra_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    from cfjax.errors import InputError
    from cfjax.plants import plant_named
    from cfjax.problem import KinematicBicycle

    monkeypatch.setitem(sys.modules, "slipx", None)
    with pytest.raises(InputError, match="pip install slipx"):
        plant_named("slipx", KinematicBicycle())


@pytest.mark.parametrize("given", [True, False])
def test_a_tube_is_driven_along_a_path_by_a_law_that_has_its_period(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hand_made, given: bool
) -> None:
    """Through the points of a file or along one of its own; the law asks for all that the tube holds."""
    bounds = tube(1.2, Interval(0.5, 4.0), 1.0)
    document = json.loads(lzma.decompress((resources.files("cfjax.tubes") / "library" / LIBRARY).read_bytes()))
    nothing = Absorbed(0.001, (0.1,) * 4, (0.1,) * 4, 0.001)
    run = hand_made(Problem(bounds, inlet=ball(0.15), goal=ball(0.25)), margin=0.4, verdict=Verdict.CERTIFIED)
    run = run.replace(document=document, robustness=Robustness(nothing, 0.9, nothing, 0.9))
    monkeypatch.setattr(run_folder, "read_run", lambda folder, vehicle: run)
    angle = np.linspace(0, 2 * np.pi, 60)
    points = tmp_path / "points.csv"
    np.savetxt(points, np.column_stack([3 * np.sin(angle), 3 - 3 * np.cos(angle)])[:-10], delimiter=",")
    starts = tmp_path / "starts.csv"
    starts.write_text("alpha,x,y,v\n-1.6,0,0,2\n-1.5,0.1,0,2\n-1.5,0,0.1,2\n")
    along = ["--path", str(points)] if given else []
    options = command.parser().parse_args([str(tmp_path), *along, "--starts", str(starts), "--n", "2"])
    driven = command.experiment_of(options)
    np.testing.assert_array_equal(driven.starts, [[-1.6, 0, 0, 2], [-1.5, 0.1, 0, 2]])
    assert driven.theta is None
    assert driven.result.robustness == run.robustness
    (leg,) = driven.result.legs
    assert leg.along == bounds.tube
    if given:
        ends = driven.problem.path.curve[-1]
        np.testing.assert_allclose(
            ends.poses(np.array([ends.duration]))[0, 1:], np.loadtxt(points, delimiter=",")[-1], atol=1e-3
        )
    else:
        assert driven.problem.path.name == "winding"


@pytest.mark.parametrize(
    ("plant", "noise", "law", "period", "said"),
    [
        ("model", "none", "min_norm", 0.001, "control period 1 ms: within the proven 1.577 ms"),
        ("model", "none", "min_norm", 0.005, "control period 5 ms: longer than the proven 1.577 ms"),
        ("model:wheelbase=0.4", "none", "min_norm", 0.001, "of this plant and noise nothing is proven"),
        ("disturbed:x=0.001", "none", "min_norm", 0.001, "of this plant and noise nothing is proven"),
        ("model", "delay=0.001", "min_norm", 0.001, "of this plant and noise nothing is proven"),
        ("model", "none", "sontag", 0.001, None),
    ],
)
def test_a_period_is_proven_of_the_model_under_a_law_that_inherits(
    plant: str,
    noise: str,
    law: str,
    period: float,
    said: str | None,
    tmp_path: Path,
    hand_made,
) -> None:
    absorbed = Absorbed(0.001577841402603147, (0.1,) * 4, (0.1,) * 4, 0.001)
    run = hand_made(Problem(circle()), margin=0.3, verdict=Verdict.CERTIFIED)
    run = run.replace(robustness=Robustness(absorbed, 0.9, absorbed, 0.9))
    starts = tmp_path / "starts.csv"
    starts.write_text("alpha,x,y,v\n0,1.5,0,1.5\n")
    setup = Setup(tmp_path, plant=plant, noise=noise, law=law, period=period, starts=str(starts))
    account = account_of_period(set_up(setup, run, Frame.PAPER))
    assert account is None if said is None else said in str(account)
    assert "within" not in str(account) or said == account


AHEAD = Sampled(0.05, 3, 0.5, ((0.5, -1.0, 0.0), (1.0, 0.2, 0.0), (2.0, 1.0, 4.0)), (1.0, 2.0, 3.0), 0.05, 0.8, 1)


@pytest.mark.parametrize(
    ("noise", "period", "said"),
    [
        ("none", None, "control period 50 ms: within the proven 50 ms"),
        ("none", 0.06, "control period 60 ms: longer than the proven 50 ms"),
        ("delay=0.05", 0.025, "control period 25 ms, delay 50 ms: within the proven 50 ms, 50 ms"),
        ("delay=0.1", 0.05, "control period 50 ms, delay 100 ms: longer than the proven 50 ms, 50 ms"),
        ("delay=0.04", 0.05, "of this plant and noise nothing is proven"),  # poses between two control instants
        ("delay=0.05,position=0.001", 0.05, "of this plant and noise nothing is proven"),
    ],
)
def test_a_law_that_looks_ahead_has_its_own_period_and_delay(
    noise: str, period: float | None, said: str, tmp_path: Path, hand_made
) -> None:
    absorbed = Absorbed(0.0015, (0.1,) * 4, (0.1,) * 4, 0.001)
    run = hand_made(Problem(circle()), margin=0.3, verdict=Verdict.CERTIFIED)
    run = run.replace(robustness=Robustness(absorbed, 0.9, absorbed, 0.9, (), AHEAD))
    setup = Setup(tmp_path, noise=noise, law="sampled", period=period, starts="worst", n=2)
    driven = set_up(setup, run, Frame.PAPER)
    assert driven.period == (0.05 if period is None else period)
    assert said in str(account_of_period(driven))


def test_without_a_proof_no_law_looks_ahead(tmp_path: Path, hand_made) -> None:
    run = hand_made(Problem(circle()), margin=0.3, verdict=Verdict.CERTIFIED)
    with pytest.raises(InputError, match="--law sampled: expected a run with period=…"):
        set_up(Setup(tmp_path, law="sampled"), run, Frame.PAPER)


def test_the_winding_path_reaches_nearly_both_ends_of_the_tube() -> None:
    bounds = tube(1.2, 2.0).tube
    assert bounds is not None
    (segment,) = winding(bounds).curve
    theta = np.linspace(0, segment.duration, 2001)
    curvature = segment.turn_rate.polynomial(theta) / 2.0
    assert 1.1 < curvature.max() <= 1.2 and -1.2 <= curvature.min() < -1.1
