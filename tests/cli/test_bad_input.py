"""Bad input through the command: one clear line, exit code 2, nothing written."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from cfjax.conf import preset_names


Command = Callable[..., subprocess.CompletedProcess[str]]
NAMES = (
    "circle, ellipse, figure_eight, obstacle, obstacle_tight, oval, plan, slalom, straight, straight_long, "
    "straight_restricted, tube, waypoints"
)
HIT = " m, comes within 0 m of obstacle 0; expected more than the vehicle's radius there, 0.25 m"
OBSTACLES = (
    "sets.obstacles: expected entries {disc: [x, y, radius]}, {polygon: [[x, y], ...]} or {wall: [[x, y], ...]}, got "
)
CASES = [
    (["path.radius=2"], "path.radius: no such key; expected one of name, kind, speed"),  # of the oval
    (["path.speed=0"], "path.speed: expected a positive finite number (m/s), got 0.0"),
    (["path.speed=1e308"], "path.speed: expected m/s, at most 400, got 1e+308"),
    (["+path=nope"], f"path: expected one of {NAMES}, got nope"),
    (["~path"], "expected key=value, without ~ or @ and without blanks around =, got ~path"),
    (["+path=ellipse", "path.a=-1"], "path.a: expected a positive finite number (m), got -1.0"),
    (["+path=ellipse", "path.b=0.1"], "needs steering angle 89.16°, limit 45° (w = tan = 68) (radius there: 0.005 m)"),
    (["+path=ellipse", "path.a=1e200"], "path.a: expected m, at most 1e+08, got 1e+200"),
    (["+path=ellipse", "path.segments=0"], "path.segments: expected a whole number from 1 to 1000, got 0"),
    (["+path=ellipse", "path.laps=1.5"], "path.laps: expected a whole number, got 1.5"),
    (["+path=figure_eight", "path.size=0"], "path.size: expected a positive finite number (m), got 0.0"),
    (["+path=figure_eight", "path.size=0.9"], "needs steering angle 45.25°, limit 45° (w = tan = 1.009)"),
    (["+path=slalom", "path.length=1e-200"], "path.length: expected m, at least 1e-06, got 1e-200"),
    (["+path=slalom", "path.periods=9"], "needs steering angle -46.6°, limit -45° (w = tan = -1.057)"),
    (["+path=obstacle", "path.speed=-1"], "path.speed: expected a positive finite number (m/s), got -1.0"),
    (["+path=obstacle", "path.radius=1"], "path.radius: no such key; expected one of name, kind, speed"),
    (["sets.obstacles=[{disc:[0,1,0.2]}]"], "path: segment 0 at theta = 2.228 s, (0.1937, 0.9953)" + HIT),
    (["+path=straight", "sets.obstacles=[{polygon:[[1,-1],[1,1],[1.5,0]]}]"], "path: segment 0 at theta = 1.5 s, (1, "),
    (
        ["+path=obstacle", "vehicle.footprint=[[0.25,0],[0.9,0]]"],
        "expected more than the vehicle's radius there, 0.9 m",
    ),
    (["+path=tube", "sets.obstacles=[{disc:[0,0,1]}]"], "sets.obstacles: expected none for a tube, which has no place"),
    (["sets.obstacles=5"], "sets.obstacles: expected a list, empty for none, got 5"),
    (["sets.obstacles=null"], "sets.obstacles: expected a list, empty for none, got null"),
    (["sets.obstacles={disc:[0,0,1]}"], "sets.obstacles: expected a list, like [{disc: [x, y, radius]}], got {disc"),
    (["sets.obstacles=[[0,0,1]]"], OBSTACLES + "[0, 0, 1]"),
    (["sets.obstacles=[{}]"], OBSTACLES + "{}"),
    (["sets.obstacles=[{disk:[0,0,1]}]"], OBSTACLES + "{disk: [0, 0, 1]}"),
    (["sets.obstacles=[{disc:[0,0]}]"], OBSTACLES + "{disc: [0, 0]}"),
    (["sets.obstacles=[{disc:[0,zero,1]}]"], OBSTACLES + "{disc: [0, zero, 1]}"),
    (["sets.obstacles=[{disc:[0,0,1],polygon:[]}]"], OBSTACLES + "{disc: [0, 0, 1], polygon: []}"),
    (["sets.obstacles=[{polygon:[[0,0],[1,0],1]}]"], OBSTACLES + "{polygon: [[0, 0], [1, 0], 1]}"),
    (["sets.obstacles=[{polygon:square}]"], OBSTACLES + "{polygon: square}"),
    (
        ["sets.obstacles=[{disc:[0,0,-1]}]"],
        "sets.obstacles: expected a disc with a finite centre and a positive radius",
    ),
    (["sets.obstacles=[{disc:[0,nan,1]}]"], "sets.obstacles: expected a disc with a finite centre and a positive rad"),
    (["sets.obstacles=[{polygon:[[0,0],[1,0]]}]"], "sets.obstacles: expected a polygon with at least 3 corners [x, y]"),
    (["sets.obstacles=[{polygon:[[0,0],[1,0],[2,0]]}]"], "sets.obstacles: expected a polygon, its corners in order"),
    (
        ["sets.obstacles=[{polygon:[[0,0],[1,1],[1,0],[0,1]]}]"],
        "sets.obstacles: expected a polygon, its corners in order, got [[0.0, 0.0], [1.0, 1.0]",
    ),
    (
        ["sets.obstacles=[{disc:[1e308,0,1]}]"],
        "sets.obstacles: expected numbers of at most 1e+08 m, got [1e+308, 0.0, 1.0]",
    ),
    (["sets.obstacles=[{polygon:[[0,1e9],[1,0],[2,0]]}]"], "sets.obstacles: expected numbers of at most 1e+08 m, got"),
    (
        ["+path=circle", "path.radius=1e200", "sets.obstacles=[{disc:[1,0,1]}]"],
        "path.radius: expected m, at most 1e+08",
    ),
    (["sets.safe=[1,1,1,null]"], "sets.safe: expected 4 numbers, a large one, such as 100, where there is no limit, "),
    (["vehicle.footprint=[[1e308,0]]"], "vehicle.footprint: expected numbers of at most 1e+08 m, got"),
    (["vehicle.footprint=0.25"], "vehicle.footprint: expected a list of discs [radius, offset], got 0.25"),
    (["vehicle.footprint=[0.25,0]"], "vehicle.footprint: expected a list of discs [radius, offset], got [0.25, 0]"),
    (["vehicle.footprint=[]"], "vehicle.footprint: expected at least one disc"),
    (
        ["vehicle.footprint=[[-0.25,0]]"],
        "vehicle.footprint: expected discs [radius, offset] in m, no radius below zero",
    ),
    (["+path=waypoints"], "expected a value for path.file, got none"),
    (["+path=waypoints", "path.file=null"], "path.file: expected a text, got null"),
    (["+path=waypoints", "path.file=none.csv"], "none.csv: expected a CSV file of waypoints, there is no such file"),
    (["+path=waypoints", "path.file=."], "expected a CSV file of waypoints, got a folder"),
    (["+path=circle", "path=null"], "path: expected the name of a preset, got null"),
    (["+path=circle", "+path=straight"], "path: expected one of its presets, got circle and straight"),
    (
        ["+path=circle,straight"],
        "path: expected the name of a preset, got circle,straight; with -m",
    ),
    (["+path=circle", "path.speed=nan"], "path.speed: expected a positive finite number (m/s), got nan"),
    (["+path=circle", "path.speed=inf"], "path.speed: expected a positive finite number (m/s), got inf"),
    (["+path=straight", "path.speed=1e308"], "path.speed: expected m/s, at most 400, got 1e+308"),
    (["+path=circle", "path.speed=1e-320"], "path.speed: expected m/s, at least 1e-06, got 9.99989e-321"),
    (["+path=circle", "path.speed=1e-320", "path.radius=1e20"], "path.radius: expected m, at most 1e+08, got 1e+20"),
    (["+path=straight", "path.speed=1e-320"], "path.speed: expected m/s, at least 1e-06, got 9.99989e-321"),
    (["+path=circle", "path.speed=fast"], "path.speed: expected a number, got fast"),
    (["+path=circle", "path.speed=true"], "path.speed: expected a number, got true"),
    (["+path=circle", "path.speed=["], "path.speed: expected a number, got ["),
    (["+path=circle", "path.radius=-1"], "path.radius: expected a positive finite number (m), got -1.0"),
    (["+path=circle", "path.radius=0.1"], "needs steering angle 73.61°, limit 45° (w = tan = 3.4)"),
    (["+path=circle", "path.laps=0"], "path.laps: expected a positive finite number, got 0.0"),
    (["+path=straight", "path.length=-2"], "path.length: expected a positive finite number (m), got -2.0"),
    (["+path=tube", "path.speed=[2,1]"], "path.speed: expected an interval of finite numbers, the lower one first"),
    (["+path=tube", "path.speed=[-1,2]"], "path.speed: expected an interval above zero, got [-1, 2]"),
    (["+path=tube", "path.speed=0"], "path.speed: expected an interval above zero, got [0, 0]"),
    (
        ["+path=tube", "path.speed=fast"],
        "path.speed: expected a number or an interval [lower, upper] (m/s), got fast",
    ),
    (["+path=tube", "path.curvature=[1,2,3]"], "path.curvature: expected a number or an interval [lower, upper]"),
    (["+path=tube", "path.curvature=nan"], "path.curvature: expected a finite number of at least 0 (1/m), got nan"),
    (["+path=tube", "path.curvature=3"], "path.curvature: expected at most 2.941 1/m either way, which is what this"),
    (["+path=tube", "path.curvature=[0,3]", "vehicle.wheelbase=0.5"], "path.curvature: expected at most 2 1/m"),
    (["+path=tube", "path.acceleration=[-5,1]"], "path.acceleration: -5 m/s² needs thrust = -5, but the vehicle's"),
    (["+path=tube", "sets.goal=0.4"], "sets.goal: expected more than sets.inlet, 0.4, in alpha"),
    (["+path=tube", "path.radius=1"], "path.radius: no such key; expected one of name, kind, speed, curvature"),
    (["+path=straight", "law=lineal"], "law: expected one of linear, none, pure_pursuit, stanley, got lineal; did you"),
    (["+path=straight", "law=linear", "law.gain=[[1,2]]"], "law.gain: expected an array of shape 2 × 4, got 1 × 2"),
    (["+path=oval", "law=linear"], "law=linear: expected a path that is one straight line or one circle"),
    (
        ["+path=straight", "law=stanley", "method=tt"],
        "method: expected pf with law=stanley, which keeps no time",
    ),
    (["+path=straight", "law=stanley", "law.gain=[[1]]"], "law.gain: expected a finite number (1/s)"),
    (
        ["+path=straight", "law=linear", "certificate=tube"],
        "certificate: expected auto or segment with a law",
    ),
    (["+path=straight", "law=linear", "learner=polytope"], "law: expected none with learner=polytope"),
    (["+path=straight", "law=linear", "period=0.02"], "period: expected none with a law"),
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
    (
        ["+path=circle", "sets.inlet=wide"],
        "sets.inlet: expected a number or 4 numbers, one per state (alpha, x, y, v), got wide",
    ),
    (
        ["+path=circle", "sets.inlet=[1,2]"],
        "sets.inlet: expected a number or 4 numbers, one per state (alpha, x, y, v), got [1, 2]",
    ),
    (
        ["+path=circle", "sets.inlet=null"],
        "sets.inlet: expected a number or 4 numbers, one per state (alpha, x, y, v), got null",
    ),
    (["+path=circle", "sets.goal=-1"], "sets.goal: expected a positive finite number, got -1"),
    (["+path=circle", "sets.goal=null"], "sets.goal: expected a number or half-axes for a path, which ends, got null"),
    (["+path=circle", "sets.inlet=2"], "sets.inlet: reaches 2.0 in alpha, but sets.safe, around it, ends at 1.0"),
    (["+path=circle", "~sets"], "expected key=value, without ~ or @"),
    (["+path=circle", "sets=null"], "sets: expected a value for one of its keys, like sets.inlet, got null"),
    (["+path=circle", "vehicle=truck"], "vehicle: expected one of custom, parkour, got truck"),
    (["+path=circle", "vehicle.wheelbase=330"], "vehicle.wheelbase: expected m, from 0.005 to 25, got 330; 330 mm are"),
    (["+path=circle", "vehicle.max_tan_steering=25"], "got 25, an angle of 87.7 degrees; 25 degrees have the tangent"),
    (
        ["+path=circle", "vehicle.max_thrust=5000"],
        "vehicle.max_thrust: expected m/s², at most 100, got 5000: no force in",
    ),
    (["+path=circle", "sets.inlet=[30,0.5,0.5,0.5]"], "got 30.0; 30 degrees are 0.5236 rad"),
    (["+path=circle", "vehicle.wheelbase=0"], "vehicle.wheelbase: expected a positive finite number (m), got 0.0"),
    (["+path=circle", "+vehicle.wheels=4"], "vehicle.wheels: no such key"),
    (["+path=circle", "method=both"], "method: expected one of pf, tt, got both"),
    (["+path=circle", "template=cubic"], "template: expected one of contracting, paper, got cubic"),
    (["+path=circle", "proof.memory=0"], "proof.memory: expected a number above 0 and at most 1e+09 (GB), got 0.0"),
    (["+path=circle", "proof.hours=-1"], "proof.hours: expected a positive finite number (h), got -1.0"),
    (["+path=circle", "learner=psychic"], "learner: expected one of gradient, polytope, got psychic"),
    (["+path=circle", "learner=polytope", "objective=width", "objective.margin=1"], "objective: expected margin with"),
    (["+path=circle", "learner=polytope", "polytope.margin=0"], "polytope.margin: expected a positive finite number"),
    (["+path=circle", "learner=polytope", "polytope.centre=left"], "polytope.centre: expected one of mve, analytic, c"),
    (["+path=circle", "learner=polytope", "polytope.batch=0"], "polytope.batch: expected a whole number of at least 1"),
    (["+path=circle", "learner=polytope", "polytope.delta=1"], "polytope.delta: expected a number between 0 and 1"),
    (["+path=circle", "polytope.demonstrations=none"], "polytope.demonstrations: expected one of mpc, revised, got n"),
    (["+path=figure_eight", "learner=polytope"], "learner=polytope: expected one distinct segment, got 2"),
    (["+path=oval", "template=paper", "certificate=tube"], "template: expected contracting with certificate=tube, got"),
    (["+path=oval", "certificate=tube", "learner=polytope"], "certificate: expected auto or segment with learner=pol"),
    (["+path=tube", "learner=polytope"], "learner=polytope: expected a path, got a tube"),
    (["+path=circle", "beta_lower=1"], "beta_lower: expected a number of at least 0.05 and below 1, got 1.0"),
    (["+path=circle", "beta_lower=nan"], "beta_lower: expected a number of at least 0.05 and below 1, got nan"),
    (["+path=circle", "timing=[1]"], "timing: expected an interval [lower, upper], got [1.0]"),
    (["+path=circle", "timing=[1.5,2]"], "timing: expected 0 < lower <= 1 <= upper, got [1.5, 2.0]"),
    (
        ["+path=circle", "timing=[2,0.5]"],
        "timing: expected an interval of finite numbers, the lower one first, got [2.0, 0.5]",
    ),
    (["+path=circle", "seed=1.5"], "seed: expected a whole number, got 1.5"),
    (["+path=circle", "seed=4294967296"], "seed: expected a whole number of at most 4294967295, got 4294967296"),
    (["+path=circle", "restarts=0"], "restarts: expected a whole number of at least 1, got 0"),
    (["+path=circle", "cars=-1"], "cars: expected a whole number of at least 0, got -1"),
    (["+path=circle", "frame=rose"], "frame: expected one of paper, ros, got rose; did you mean ros?"),
    (["+path=circle", "logger=paper"], "logger: expected one of none, wandb, got paper"),
    (["+path=circle", "wandb.mode=on"], "wandb.mode: expected one of offline, online, disabled, got on"),
    (["+path=circle", "--method", "tt"], "expected key=value or a flag of --help, got --method"),
    (["+path=circle", "hydra.run.dir=/dev/null/run"], "hydra.run.dir: cannot write to /dev/null/run (Not a d"),
    (["-m", "+path=circle", "path.speed=1,fast"], "path.speed: expected a number, got fast"),
    (["-m", "+path=circle,nope"], f"path: expected one of {NAMES}, got nope"),
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
    [(["+path=circle", "+path.radiu=3"], "no such key"), (["+path=circle", "path.radius=0.1"], "(w = tan = 3.4)")],
)
def test_through_the_real_command(arguments: list[str], message: str, command: Command, tmp_path: Path) -> None:
    done = command(*arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert message in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_list_of_paths_is_the_presets() -> None:
    assert ", ".join(preset_names()) == NAMES


ROW = "path.file: {file}, row "
FILES = [
    ("", [], "path.file: {file}: expected at least two points, one x,y a row; the file is empty"),
    ("1,2\n", [], ROW + "1: expected at least two points, got one"),
    ("1,2\n1,2\n1,2\n", [], "path.file: {file}: expected points that differ, all 3 are x = 1 m, y = 2 m"),
    ("x,y\n0,0\n1,nan\n2,0\n", [], ROW + "3: expected a finite number for y, got nan"),
    ("0,0\n1,0\ntwo,0\n", [], ROW + "3: expected a number for x, got 'two'"),
    (
        "0,0\n1,0\n2,0\n2.2,0.2\n2,0.4\n1,0.4\n0,0.4\n",  # a hairpin
        [],
        "path.file: {file}, row 4: after 2.366 m, at x = 2.",
    ),
    ("0,0\n1,0\n2,0\n1,0\n0.5,0\n", [], "(a cusp); expected a way that is driven forwards"),
    (
        "0,0\n1,1\n2,0\n",  # a bend that this car does not steer
        ["vehicle.wheelbase=2"],
        "expected a radius of at least 2.5 m, 38.7°, which is what path.reserve=0.2 leaves",
    ),
    (
        "0,0\n4,0\n8,0\n",  # driven at 2 m/s
        ["sets.obstacles=[{disc:[6,0.1,0.2]}]"],
        "path: segment 0 at theta = 2.92 s, (5.84, ",
    ),
    (
        "0,0\n1e300,0\n1e300,1e300\n",
        [],
        "path.file: {file}: expected points in m, between 0.001 and 100000 m along them",
    ),
    (
        "0,0\n4,0\n8,1\n",
        ["path.segment_length=1e-5"],
        "path.segment_length: expected at least 0.000814 m for a path of",
    ),
    ("0,0\n4,0\n", ["path.speed=0"], "path.speed: expected a positive finite number (m/s), got 0.0"),
    ("0,0\n4,0\n", ["path.reserve=1"], "path.reserve: expected a number of at least 0 and below 1, got 1.0"),
    ("0,0\n4,0\n", ["path.closed=true"], "expected at least three different points of a closed path, got 2"),
    ("0,0\n4,0\n", ["path.closed=maybe"], "path.closed: expected true or false or null, got maybe"),
    ("0,0,1\n4,0,1\n", ["path.columns=[x,y]"], "path.columns: expected a name for each of 3 columns, got x, y"),
    ("0,0\n4,0\n", ["path.columns=[a,b]"], "path.columns: expected a name for x and one for y, got a, b"),
    (
        "0,0,0\n4,0,2\n",
        [],
        "row 1: expected a positive speed, got 0, where a car cannot be steered; path.least_speed=1 dri",
    ),
    (
        "0,0\n4,0\n",
        ["path.least_speed=3", "path.speed=2"],
        "path.least_speed: expected at most path.speed, 2.0 m/s, got",
    ),
    (
        "0,0\n4,0\n",
        ["path.smooth=1"],
        "path.smooth: no such key; expected one of name, kind, file, columns, closed, speed",
    ),
]


@pytest.mark.parametrize(("text", "overrides", "message"), FILES)
def test_a_bad_file_gets_one_line_and_exit_code_2(
    text: str,
    overrides: list[str],
    message: str,
    train: Callable[..., int],
    quick: None,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    file = tmp_path / "points.csv"
    file.write_text(text)
    assert train("+path=waypoints", "path.file=points.csv", *overrides) == 2
    error = capfd.readouterr().err
    assert error.count("\n") == 1
    assert error.startswith("error: ")
    assert message.format(file=file) in error
    assert list(tmp_path.iterdir()) == [file]
