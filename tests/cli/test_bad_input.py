"""Bad input through the command: one clear line, exit code 2, nothing written."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from cfjax.conf import preset_names


Command = Callable[..., subprocess.CompletedProcess[str]]
CASES = [
    ([], f"path: expected +path=NAME with one of {', '.join(preset_names())}, got none"),
    (
        ["path.radius=2"],
        "path: expected +path=NAME with one of circle, straight, straight_long, straight_restricted, tube",
    ),
    (["+path=nope"], "path: expected one of circle, straight, straight_long, straight_restricted, tube, got nope"),
    (["path=circle"], "To append to your default list use +path=circle"),
    (["+path=circle", "path=null"], "Config group override must be a string"),
    (["+path=circle", "+path=straight"], "Multiple values for path"),
    (["+path=circle,straight"], "To sweep over it, add --multirun"),
    (["+path=circle", "path.speed=nan"], "path.speed: expected a positive finite number, got nan"),
    (["+path=circle", "path.speed=inf"], "path.speed: expected a positive finite number, got inf"),
    (["+path=straight", "path.speed=1e308"], "got 1e+308 m/s"),
    (["+path=circle", "path.speed=1e-320"], "got path.radius=1.5, path.speed=1e-320, path.laps=1.0"),
    (["+path=circle", "path.speed=1e-320", "path.radius=1e20"], "path.speed=1e-320"),  # turns at 0 rad/s
    (["+path=straight", "path.speed=1e-320"], "got path.length=4.0, path.speed=1e-320"),
    (["+path=circle", "path.speed=fast"], "path.speed: Value 'fast' of type 'str' could not be converted to Float"),
    (["+path=circle", "path.speed=true"], "path.speed: Value 'True' of type 'bool' could not be converted to Float"),
    (["+path=circle", "path.speed=["], "no viable alternative"),
    (["+path=circle", "path.radius=-1"], "path.radius: expected a positive finite number, got -1.0"),
    (["+path=circle", "path.radius=0.1"], "needs w = 3.4, but the vehicle's w lies in [-1, 1]"),
    (["+path=circle", "path.laps=0"], "path.laps: expected a positive finite number, got 0.0"),
    (["+path=straight", "path.length=-2"], "path.length: expected a positive finite number, got -2.0"),
    (["+path=tube", "path.speed=[2,1]"], "path.speed: expected an interval of finite numbers, the lower one first"),
    (["+path=tube", "path.speed=[-1,2]"], "path.speed: expected an interval above zero, got [-1, 2]"),
    (["+path=tube", "path.speed=0"], "path.speed: expected an interval above zero, got [0, 0]"),
    (["+path=tube", "path.speed=fast"], "path.speed: expected a number or an interval [lower, upper], got fast"),
    (["+path=tube", "path.curvature=[1,2,3]"], "path.curvature: expected a number or an interval [lower, upper]"),
    (["+path=tube", "path.curvature=nan"], "path.curvature: expected a finite number that is not negative, got nan"),
    (["+path=tube", "path.curvature=3"], "path.curvature: expected at most 2.941 1/m either way, which is what this"),
    (["+path=tube", "path.curvature=[0,3]", "vehicle.wheelbase=0.5"], "path.curvature: expected at most 2 1/m"),
    (["+path=tube", "path.acceleration=[-5,1]"], "path.acceleration: -5 m/s² needs thrust = -5, but the vehicle's"),
    (["+path=tube", "sets.goal=0.4"], "sets.goal: expected more than sets.inlet, 0.4, in alpha"),
    (["+path=tube", "path.radius=1"], "path.radius: no such key; expected one of name, kind, speed, curvature"),
    (["+path=tube", "objective=wide"], "objective: expected one of inlet, margin, width, got wide"),
    (["+path=tube", "objective=width"], "objective.margin: expected a positive number (1/s) with objective=width"),
    (["+path=tube", "objective.margin=1"], "objective.margin: expected none with objective=margin, which seeks"),
    (["+path=tube", "beta_inner=0.95"], "beta_inner: expected a number above 0 and at most beta_lower = 0.9, got 0.95"),
    (["+path=circle", "path.radiu=3"], "path.radiu: no such key; expected one of name, kind, radius, speed, laps"),
    (["+path=circle", "+path.radiu=3"], "path.radiu: no such key; expected one of name, kind, radius, speed, laps"),
    (["+path=circle", "++path.radiu=3"], "path.radiu: no such key"),
    (["+path=circle", "path.kind=straight"], "path.kind: expected the preset's own, got straight"),
    (["+path=circle", "colour=red"], "colour: no such key"),
    (["+path=circle", "+colour=red"], "colour: no such key; expected one of path, vehicle, sets"),
    (["+path=circle", "+sets.outlet=1"], "sets.outlet: no such key; expected one of inlet, goal, safe"),
    (["+path=circle", "sets.inlet=wide"], "sets.inlet: expected a number or a list of 4 numbers, got wide"),
    (["+path=circle", "sets.inlet=[1,2]"], "sets.inlet: expected 4 numbers, one per state (alpha, x, y, v), got 2"),
    (["+path=circle", "sets.inlet=null"], "sets.inlet: expected a number or a list of 4 numbers, got None"),
    (["+path=circle", "sets.goal=-1"], "sets.goal: expected positive finite numbers, got -1"),
    (["+path=circle", "sets.inlet=2"], "sets.inlet: reaches 2.0 in alpha, but sets.safe, around it, ends at 1.0"),
    (["+path=circle", "~sets"], "expected a value for sets, got none"),
    (["+path=circle", "~cars"], "expected a value for cars, got none"),
    (["+path=circle", "~sets.safe"], "sets.safe: SetsConfig (DictConfig) does not support deletion"),
    (["+path=circle", "sets=null"], "field 'sets' is not Optional"),
    (["+path=circle", "vehicle=truck"], "vehicle: expected one of parkour, got truck"),
    (["+path=circle", "vehicle.wheelbase=0"], "vehicle.wheelbase: expected a positive finite number, got 0.0"),
    (["+path=circle", "+vehicle.wheels=4"], "vehicle.wheels: no such key"),
    (["+path=circle", "method=both"], "method: expected one of pf, tt, got both"),
    (["+path=circle", "template=cubic"], "template: expected one of contracting, paper, got cubic"),
    (["+path=circle", "learner=psychic"], "learner: expected gradient"),
    (["+path=circle", "beta_lower=1"], "beta_lower: expected a number of at least 0.05 and below 1, got 1.0"),
    (["+path=circle", "beta_lower=nan"], "beta_lower: expected a number of at least 0.05 and below 1, got nan"),
    (["+path=circle", "timing=[1]"], "timing: expected two numbers, lower and upper, got [1.0]"),
    (["+path=circle", "timing=[1.5,2]"], "timing: expected 0 < lower <= 1 <= upper, got [1.5, 2.0]"),
    (["+path=circle", "timing=[2,0.5]"], "an interval needs finite ends, lower first; got [2.0, 0.5]"),
    (["+path=circle", "seed=1.5"], "seed: Value '1.5' of type 'float' could not be converted to Integer"),
    (["+path=circle", "restarts=0"], "restarts: expected a whole number of at least 1, got 0"),
    (["+path=circle", "cars=-1"], "cars: expected a whole number of at least 0, got -1"),
    (["+path=circle", "logger=paper"], "logger: expected one of none, wandb, got paper"),
    (["+path=circle", "wandb.mode=on"], "wandb.mode: expected one of offline, online, disabled, got on"),
    (["+path=circle", "--method", "tt"], "expected key=value or a flag of --help, got --method"),
    (["+path=circle", "hydra.run.dir=/dev/null/run"], "hydra.run.dir: cannot make /dev/null/run (Not a directory)"),
    (["-m", "+path=circle", "path.speed=1,fast"], "path.speed: Value 'fast' of type 'str'"),
    (
        ["-m", "+path=circle,nope"],
        "path: expected one of circle, straight, straight_long, straight_restricted, tube, got nope",
    ),
]


@pytest.mark.parametrize(("arguments", "message"), CASES, ids=[" ".join(case[0]) or "nothing" for case in CASES])
def test_one_line_and_exit_code_2(
    arguments: list[str],
    message: str,
    train: Callable[..., int],
    quick: None,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    assert train(*arguments) == 2
    error = capfd.readouterr().err
    assert error.count("\n") == 1
    assert error.startswith("error: ")
    assert message in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["+path=circle", "+path.radiu=3"], "no such key"), (["+path=circle", "path.radius=0.1"], "needs w = 3.4")],
)
def test_through_the_real_command(arguments: list[str], message: str, command: Command, tmp_path: Path) -> None:
    done = command(*arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert message in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_list_of_paths_is_the_presets() -> None:
    assert preset_names() == ["circle", "straight", "straight_long", "straight_restricted", "tube"]
