"""Every preset composes, builds its problem, and means what DESIGN promises."""

import inspect
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.special import ellipe, gamma

from cfjax.conf import config_of, options_of, preset, preset_folder, preset_names, problem_of, yaml_of
from cfjax.problem import (
    Disc,
    KinematicBicycle,
    Method,
    Polygon,
    Tube,
    ellipse,
    figure_eight,
    obstacle_path,
    oval,
    waypoints,
)
from cfjax.problem import slalom as slalom_curve
from tests.shapes import eight, racing_line, slalom


WAVES = {
    name: np.hypot(1, a * k) / k * ellipe((a * k) ** 2 / (1 + (a * k) ** 2))
    for name, a, k in (
        ("slalom", 0.5, np.pi / 2),
        ("obstacle", 0.4, np.pi / 1.5),
    )
}  # m, a quarter of each
OVAL = 8 * ellipe(3 / 4)  # m round
PAPER = (0.5,) * 4, (0.5,) * 4, (1, 1, 1, 3)
NO_BOX = (0.25,) * 4, (0.5,) * 4, None
TIGHT = (0.25,) * 4, (0.25,) * 4, None
RESTRICTED = (0.5, 0.5, 0.5, 0.25), (0.5, 0.5, 0.5, 0.25), (1, 1, 1, 0.5)
MEANT = {  # segments, duration s of all, first and last position m, speed m/s, I, G and S
    "straight": (1, 2.0, (-2, 0), (2, 0), 2.0, PAPER),
    "straight_long": (1, 4.0, (-4, 0), (4, 0), 2.0, PAPER),
    "straight_restricted": (1, 4.0, (-4, 0), (4, 0), 2.0, RESTRICTED),
    "circle": (1, 6.0, (1.5, 0), (1.5, 0), np.pi / 2, PAPER),
    "oval": (2, OVAL, (2, 0), (2, 0), 1.0, PAPER),
    "ellipse": (2, OVAL, (2, 0), (2, 0), 1.0, PAPER),
    "figure_eight": (2, 2 * gamma(1 / 4) ** 2 / np.sqrt(2 * np.pi), (0, 0), (0, 0), 1.0, PAPER),
    "slalom": (6, 12 * WAVES["slalom"], (0, 0), (12, 0), 1.0, PAPER),
    "obstacle": (1, 2 * WAVES["obstacle"], (-1.5, 0), (1.5, 0), 2.0, NO_BOX),
    "obstacle_tight": (1, 2 * WAVES["obstacle"], (-1.5, 0), (1.5, 0), 2.0, TIGHT),
}
SQUARE = Polygon(((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)))


def test_a_checkout_has_its_presets_beside_the_package() -> None:
    """Where they are in a wheel: test_wheel.py."""
    root = Path(__file__).resolve().parents[2]
    assert preset_folder() == root / "conf"
    assert not list((root / "cfjax").rglob("*.yaml"))


def test_presets_of_ones_own(command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path) -> None:
    preset_file = tmp_path / "mine" / "path" / "bend.yaml"
    preset_file.parent.mkdir(parents=True)
    preset_file.write_text("# @package _global_\ndefaults: [circle]\npath: {name: bend, radius: 4.0}\n")
    shown = command("--config-dir=mine", "+path=bend", "--cfg=job")
    config = config_of(shown.stdout)
    assert config == preset("circle", ["path.name=bend", "path.radius=4"])
    mistyped = command("--config-dir=mine", "+path=bent")
    assert mistyped.returncode == 2 and "path: expected one of bend, circle, ellipse" in mistyped.stderr


@pytest.fixture
def needed(write: Callable[..., Path]) -> Callable[[str], list[str]]:
    """What a preset cannot be without."""
    return lambda name: [f"path.file={write(slalom())}"] if name == "waypoints" else []


@pytest.mark.parametrize("name", [name for name in preset_names() if name not in ("tube", "waypoints", "plan")])
def test_preset_is_what_was_promised(name: str) -> None:
    config = preset(name)
    problem, options = problem_of(config), options_of(config)
    count, duration, first, last, speed, (inlet, goal, safe) = MEANT[name]
    assert len(problem.path.curve) == len(problem.path.segments) == count
    begin, end = problem.path.curve[0], problem.path.curve[-1]
    assert sum(segment.duration for segment in problem.path.curve) == pytest.approx(duration, rel=1e-9)
    assert begin.start[1:] == pytest.approx(first, abs=1e-9)
    np.testing.assert_allclose(end.poses(np.array([end.duration]))[0, 1:], last, atol=1e-9)
    assert begin.point(0.0).speed == pytest.approx(speed, rel=1e-15)
    assert problem.path.name == name
    assert (problem.inlet.half_axes, problem.goal.half_axes) == (inlet, goal)
    assert (problem.safe and problem.safe.half_widths) == safe
    assert problem.obstacles == ((SQUARE,) if "obstacle" in name else ())
    assert problem.footprint == ((0.25, 0.0),)
    assert problem.method is Method.PF
    assert (problem.timing.lower, problem.timing.upper) == (0.5, 2.0)
    assert problem.vehicle.wheelbase == 0.34  # pyright: ignore[reportAttributeAccessIssue]
    assert (options.template, options.beta_lower) == ("contracting", 0.9)


BUILDERS = {
    "oval": oval,
    "ellipse": ellipse,
    "figure_eight": figure_eight,
    "slalom": slalom_curve,
    "obstacle": obstacle_path,
    "obstacle_tight": obstacle_path,
    "waypoints": waypoints,
}


@pytest.mark.parametrize("name", BUILDERS)
def test_numbers_of_a_preset_are_the_defaults_of_its_curve(name: str, needed: Callable[[str], list[str]]) -> None:
    config = preset(name, needed(name)).path
    for given in (vars(config), vars(type(config)())):
        keys = {key: value for key, value in given.items() if key not in ("name", "kind", "file")}
        parameters = inspect.signature(BUILDERS[name]).parameters.values()
        assert keys == {each.name: each.default for each in parameters if each.name not in ("file", "vehicle")}


def test_numbers_are_keys_of_the_path() -> None:
    for name, overrides, expected in (
        ("oval", ["path.speed=1.5"], oval(1.5)),
        ("ellipse", ["path.a=3", "path.b=1.5", "path.speed=2", "path.segments=3"], ellipse(3.0, 1.5, 2.0, 3)),
        ("ellipse", ["path.laps=2"], ellipse(laps=2)),
        ("figure_eight", ["path.size=3", "path.speed=1.5"], figure_eight(3.0, 1.5)),
        (
            "slalom",
            ["path.length=9", "path.amplitude=0.3", "path.periods=2", "path.speed=1.5"],
            slalom_curve(9.0, 0.3, 2, 1.5),
        ),
        ("obstacle", ["path.speed=1.5"], obstacle_path(1.5)),
    ):
        assert problem_of(preset(name, overrides)).path == expected


@pytest.mark.parametrize(
    ("make", "closed", "overrides"),
    [
        (eight, True, ["path.smoothing=0.01", "path.acceleration=null"]),
        (slalom, False, ["path.closed=false", "path.lateral_acceleration=1.0", "path.reserve=0.4"]),
        (racing_line, True, ["path.speed=8.0", "path.segment_length=25.0", "path.acceleration=2.0"]),
    ],
)
def test_waypoints_with_every_key(
    make: Callable[[], np.ndarray], closed: bool, overrides: list[str], write: Callable[..., Path]
) -> None:
    file = write(make())
    problem = problem_of(preset("waypoints", [f"path.file={file}", *overrides, "vehicle.wheelbase=0.33"]))
    keys = {key.removeprefix("path."): yaml.safe_load(value) for key, value in (each.split("=") for each in overrides)}
    assert problem.path == waypoints(file, vehicle=KinematicBicycle(wheelbase=0.33), **keys)
    begin, end = problem.path.curve[0], problem.path.curve[-1]
    apart = end.poses(np.array([end.duration]))[0, 1:] - begin.start[1:]
    assert (np.abs(apart).max() < 1e-9) == closed
    assert (problem.inlet.half_axes, problem.goal.half_axes, problem.safe) == ((0.15,) * 4, (0.25,) * 4, None)


def test_points_on_a_line_are_a_straight_path(write: Callable[..., Path]) -> None:
    (segment,) = problem_of(preset("waypoints", [f"path.file={write(np.array([0, 1 + 1j, 2 + 2j]))}"])).path.curve
    assert segment.is_steady
    assert segment.point(0.0)[:2] == (0.0, 2.0)


def test_obstacles_and_footprint_are_what_was_given() -> None:
    shapes = "sets.obstacles=[{disc:[0,2,0.5]},{polygon:[[3,1],[4,1],[4,2]]}]"
    config = preset("straight", [shapes, "vehicle.footprint=[[0.2,0],[0.15,0.3]]"])
    problem = problem_of(config)
    assert problem.obstacles == (Disc(0.0, 2.0, 0.5), Polygon(((3.0, 1.0), (4.0, 1.0), (4.0, 2.0))))
    assert problem.footprint == ((0.2, 0.0), (0.15, 0.3))
    assert problem_of(config_of(yaml_of(config))) == problem
    assert problem_of(preset("obstacle", ["sets.obstacles=[]"])).obstacles == ()


def test_tube_is_what_was_promised() -> None:
    """A number or an interval of each; I is a ball of 0.4 and G one of 0.6."""
    given = ["path.speed=[1.8,2.2]", "path.curvature=[-1.8,1.5]", "path.acceleration=[-1,0.5]"]
    for overrides, bounds in (
        (["path.speed=2", "path.curvature=1.8"], ((2.0, 2.0), (-1.8, 1.8), (0.0, 0.0))),
        (given, ((1.8, 2.2), (-1.8, 1.5), (-1.0, 0.5))),
    ):
        problem = problem_of(preset("tube", overrides))
        (bound,) = problem.path.segments
        assert isinstance(bound, Tube)
        found = [(interval.lower, interval.upper) for interval in (bound.speed, bound.curvature, bound.acceleration)]
        assert tuple(found) == bounds
        assert (problem.inlet.half_axes, problem.goal.half_axes, problem.safe) == ((0.4,) * 4, (0.6,) * 4, None)
        assert bound.duration == np.inf


@pytest.mark.parametrize("name", [name for name in preset_names() if name != "plan"])  # which tests/planner has
def test_configuration_survives_its_file(name: str, needed: Callable[[str], list[str]]) -> None:
    sets = ["sets.inlet=0.2", "sets.goal=[0.4,0.4,0.4,0.3]", "sets.safe=null"]
    sets += needed(name)
    config = preset(name, ["path.speed=1.25", *sets, "method=tt", "seed=7", "objective=width", "objective.margin=0.5"])
    again = config_of(yaml_of(config))
    assert again == config
    assert problem_of(again) == problem_of(config)


def test_user_overrides_the_sets_of_a_preset() -> None:
    problem = problem_of(preset("circle", ["sets.inlet=0.3", "sets.goal=[0.4,0.4,0.4,0.3]", "sets.safe=null"]))
    assert problem.inlet.half_axes == (0.3,) * 4
    assert problem.goal.half_axes == (0.4, 0.4, 0.4, 0.3)
    assert problem.safe is None
