"""The package of ROS 2: its node, as it is, around a simulated car; against stand-ins for rclcpp and the messages."""

import dataclasses
import json
import math
import os
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
import yaml

import cfjax.problem
from cfjax.conf import preset, problem_of, yaml_of
from cfjax.errors import InputError
from cfjax.export import write_package
from cfjax.export.__main__ import main
from cfjax.export.compiled import OK, WARNINGS, CompiledController, compile_controller, compiler
from cfjax.export.ros2 import NEAR
from cfjax.problem import Problem, circle
from cfjax.report.plane import Plane
from cfjax.report.run_folder import write_run
from cfjax.result import Absorbed, Result, Robustness
from cfjax.verdict import Verdict
from tests.export.test_controller import CASES, SHAPE, Slider, by_jax, certified


CXX = shutil.which(os.environ.get("CXX", "c++"))
pytestmark = pytest.mark.skipif(
    (compiler() is None or CXX is None) and not os.environ.get("CI"), reason="no compiler: set CC and CXX"
)

HERE = Path(__file__).parent / "ros2"
PACKAGES = ("ackermann_msgs", "diagnostic_msgs", "nav_msgs", "visualization_msgs")  # of messages
FINE, WARNING, ERROR = range(3)  # of diagnostic_msgs/DiagnosticStatus
INSIDE = "inside the funnel, and stays there up to the end of the path"
HOUR = 3600.0
CAR = {"x": 1.5, "y": 0.05, "yaw": math.pi / 2 + 0.05, "speed": 1.5}  # on the circle
CALM = {"age": 0.0, "frame_id": "map", "silent_from": HOUR, "silent_until": HOUR, "moved_at": HOUR, "moved_by": 30.0}


def absorbing(result: Result, period: float) -> Result:
    """The same, as if this control period were proven."""
    amounts = Absorbed(period, (0.0,) * 4, (0.0,) * 4, 0.0)
    return result.replace(robustness=Robustness(amounts, 1.0, amounts, 1.0))


class Step(NamedTuple):
    """A line of `world.cpp`."""

    time: float
    x: float
    y: float
    yaw: float
    speed: float
    steering: float
    told_speed: float
    acceleration: float
    level: int
    value: float
    guaranteed: bool
    message: str

    @classmethod
    def of(cls, line: str) -> "Step":
        *numbers, level, value, guaranteed, message = line.split(maxsplit=11)
        return cls(*map(float, numbers), int(level), float(value), guaranteed == "yes", message)


class Drive(NamedTuple):
    """What happened, step by step, the markers at its end (outlines by name), and what the node complained of."""

    steps: list[Step]
    markers: dict[str, list[np.ndarray]]
    complaints: str


@dataclasses.dataclass(frozen=True)
class Built:
    """A package and its node, with the parameters of the package."""

    folder: Path
    node: Path

    @property
    def parameters(self) -> dict[str, object]:
        return yaml.safe_load((self.folder / "config" / "parameters.yaml").read_text())["/**"]["ros__parameters"]

    def run(self, **changes: object) -> subprocess.CompletedProcess[str]:
        world = {**self.parameters, "diagnostics_period": 0.0, "wheelbase": 0.34, **CAR, **CALM, **changes}
        line = [str(self.node), *(f"{name}={value}" for name, value in world.items())]
        return subprocess.run(line, capture_output=True, text=True, check=False)

    def drive(self, seconds: float, **changes: object) -> Drive:
        period = float(str(changes.get("period", self.parameters["period"])))
        done = self.run(steps=round(seconds / period), **changes)
        assert done.returncode == 0, done.stderr
        lines = done.stdout.splitlines()
        steps = [Step.of(line) for line in lines if not line.startswith("marker")]
        points: dict[tuple[str, str], list[tuple[float, float]]] = {}
        for line in lines[len(steps) :]:
            _, number, frame, name, x, y = line.split()
            assert frame == "map"
            points.setdefault((name, number), []).append((float(x), float(y)))
        markers: dict[str, list[np.ndarray]] = {}
        for (name, _), outline in points.items():
            markers.setdefault(name, []).append(np.array(outline))
        return Drive(steps, markers, done.stderr)


def compiled(folder: Path) -> Path:
    """The node of the package, with the world around it; warnings are errors, and so is what sanitizers find."""
    assert CXX is not None
    sanitizers = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    includes = ["-I", str(folder / "include"), "-I", str(HERE)]
    source, node = folder / "controller.o", folder / "follower"
    c = [str(compiler()), *WARNINGS, *sanitizers, *includes, "-c", str(folder / "src" / "cfjax_controller.c")]
    warnings = ["-std=c++17", "-Wall", "-Wextra", "-pedantic", "-Werror"]
    sources = [str(folder / "src" / "node.cpp"), str(HERE / "world.cpp"), str(source)]
    for command in ([*c, "-o", str(source)], [CXX, *warnings, *sanitizers, *includes, *sources, "-o", str(node)]):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
    return node


Package = Callable[[str], Built]


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Package:
    """The package of a case of the controller's tests; on closed paths as if 2.05 ms were a proven control period."""
    made: dict[str, Built] = {}

    def make(case: str) -> Built:
        if case not in made:
            folder = tmp_path_factory.mktemp("package")
            result = CASES[case]()
            write_package(absorbing(result, 0.00205) if result.problem.path.closed else result, folder)
            made[case] = Built(folder, compiled(folder))
        return made[case]

    return make


# --- it drives


def on_path(result: Result) -> tuple[cfjax.problem.RosPose, float]:
    """The pose in ROS and the speed (m/s) of the car that begins exactly on the path."""
    first = result.problem.path.curve[0]
    return cfjax.problem.pose_to_ros(first.start), float(first.point(0.0).speed)


def controller_in(built: Built, folder: Path) -> CompiledController:
    """The controller of the package, from Python."""
    for name in ("include/cfjax_controller.h", "src/cfjax_controller.c"):
        shutil.copy(built.folder / name, folder)
    return CompiledController(compile_controller(folder), 4, 3, 2)


@pytest.mark.parametrize("case", ["circle", "tubes"])
def test_the_node_drives_by_the_law(package: Package, case: str, tmp_path: Path) -> None:
    """More than a lap: the commands are those of the controller in C, and of the law in JAX, for what was measured."""
    result, built = CASES[case](), package(case)
    pose, speed = on_path(result)
    steps = built.drive(1.2 * result.legs[-1].end, x=pose.x + 0.1, y=pose.y, yaw=pose.yaw + 0.05, speed=speed).steps
    controller, places, told = controller_in(built, tmp_path), [], []
    for index, step in enumerate(steps):
        state = controller.from_ros(step.x, step.y, step.yaw)
        state[3] = step.speed
        if index == 0:
            controller.start(state)
        theta, leg = controller.memory.theta, controller.memory.leg
        places.append((theta, leg, *controller.deviation(theta, state)))
        status, command = controller.step(state, 0.002)
        assert status == OK
        assert step.value == pytest.approx(controller.memory.value, abs=1e-6)
        told.append(command)
    assert controller.memory.lap == 1
    found = np.array([(step.steering, (step.told_speed - step.speed) / 0.1) for step in steps])
    np.testing.assert_allclose(found, told, rtol=0, atol=1e-5)  # messages hold floats of 24 bits
    sizes = [step.acceleration for step in steps]
    np.testing.assert_allclose(sizes, np.abs(np.array(told)[:, 1]), rtol=0, atol=1e-6)
    theta, leg, *x = np.array(places).T
    inputs, _ = by_jax(result, theta, leg.astype(int), np.stack(x, axis=1))
    expected = np.stack([np.arctan(inputs[:, 1]), inputs[:, 2]], axis=1)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)
    assert all(step.level == FINE and step.guaranteed and step.message == INSIDE for step in steps)


def test_odometry_of_another_point_of_the_body(package: Package) -> None:
    """Its base link is ahead of the rear axle: nothing else changes."""
    own, other = (package("circle").drive(1.0, rear_axle=ahead).steps[-1] for ahead in (0.0, -0.17))
    np.testing.assert_allclose(other[1:8], own[1:8], rtol=0, atol=1e-6)


def test_the_funnel_is_a_marker(package: Package) -> None:
    plane, markers = Plane(CASES["circle"]()), package("circle").drive(0.01).markers
    assert set(markers) == {"path", "funnel"}
    drawn = shapely.MultiLineString(markers["funnel"])
    assert shapely.hausdorff_distance(drawn, shapely.boundary(plane.funnel)) < 2 * NEAR
    (path,) = markers["path"]
    np.testing.assert_allclose(path, plane.line, atol=1e-6)


# --- it stops


def test_without_odometry_it_brakes_and_says_so(package: Package) -> None:
    """The last steering stays; the car goes on when odometry comes again."""
    steps = package("circle").drive(2.5, silent_from=0.5, silent_until=1.5).steps
    before, at_rest, again = (next(s for s in steps if s.time >= time) for time in (0.49, 1.49, 2.4))
    assert before.level == FINE and before.told_speed > 1
    silent = [step for step in steps if 0.5 <= step.time < 1.5]
    held = [step for step in silent if step.level == FINE]
    assert {step.guaranteed for step in held} == {False}
    assert "from before this step" in held[0].message
    assert len(held) == pytest.approx(0.1 / 0.002, abs=1)  # longest_silence
    stops = silent[len(held) :]
    assert {step.level for step in stops} == {ERROR} and {step.told_speed for step in stops} == {0.0}
    assert all("too old" in step.message and math.isnan(step.value) for step in stops)
    assert len({step.steering for step in stops}) == 1 and stops[0].steering == held[-1].steering
    assert stops[0].acceleration == 4.0
    assert at_rest.speed == pytest.approx(0.0, abs=1e-6)
    assert again.told_speed > 0 and again.level in (FINE, WARNING)


def test_after_a_stop_it_looks_for_the_car(package: Package) -> None:
    """Somebody has put it back while there was no odometry."""
    silence = {"silent_from": 1.0, "silent_until": 1.5}
    steps = package("circle").drive(2.0, **silence, moved_at=1.5, moved_by=0.0).steps
    again = next(step for step in steps if step.time >= 1.5)
    assert again == steps[0]._replace(time=again.time) and again.message == INSIDE


@pytest.mark.parametrize("age", [0.2, -0.2])
def test_stamps_that_do_not_fit_the_clock(package: Package, age: float) -> None:
    steps = package("circle").drive(0.1, age=age).steps
    assert {(step.level, step.told_speed) for step in steps} == {(ERROR, 0.0)}


@pytest.mark.parametrize("changes", [{"frame_id": "odom"}, {"silent_from": 0.0}], ids=["another frame", "none"])
def test_it_waits_for_odometry_in_its_frame(package: Package, changes: dict[str, object]) -> None:
    done = package("circle").drive(0.1, **changes)
    assert {(s.level, s.told_speed, s.steering) for s in done.steps} == {(ERROR, 0.0, 0.0)}
    assert "no odometry in the frame of the path yet" in done.steps[0].message
    assert ("expected odometry in the frame map, got odom" in done.complaints) == ("frame_id" in changes)


@pytest.mark.parametrize("changes", [{"x": math.nan}, {"speed": math.inf}, {"yaw": math.nan}, {"y": 1e9}])
def test_odometry_that_is_none(package: Package, changes: dict[str, object]) -> None:
    (step,) = package("circle").drive(0.002, **changes).steps
    assert (step.level, step.told_speed) == (ERROR, 0.0)
    assert "no measurement" in step.message


def test_outside_is_said_and_far_outside_it_stops(package: Package) -> None:
    near = package("circle").drive(0.002, x=2.4).steps[0]
    assert near.level == WARNING and 1 < near.value < 4 and not near.guaranteed
    assert near.message == "outside the funnel: nothing is guaranteed" and near.told_speed != 0
    steps = package("circle").drive(1.5, moved_at=0.5).steps
    far = [step for step in steps if step.time >= 0.5]
    assert {(step.level, step.told_speed) for step in far} == {(ERROR, 0.0)}
    assert all("too far outside" in step.message and step.value > 4 for step in far)
    assert len({step.steering for step in far}) == 1 and far[-1].speed == pytest.approx(0.0, abs=1e-6)


def test_at_the_end_of_an_open_path_it_stops(package: Package) -> None:
    """And stays there, though odometry goes away and comes again."""
    result = CASES["mixed"]()
    (pose, speed), end = on_path(result), float(result.legs[-1].end)
    silence = {"silent_from": end + 1.5, "silent_until": end + 2}
    steps = package("mixed").drive(end + 3, x=pose.x, y=pose.y, yaw=pose.yaw, speed=speed, **silence).steps
    stops = [step for step in steps if "the path has ended" in step.message]
    assert stops == steps[-len(stops) :]
    assert stops[0].time == pytest.approx(end, abs=0.5)  # the timing is an input of the law
    assert {(step.level, step.told_speed) for step in stops} == {(ERROR, 0.0)}
    assert stops[-1].speed == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({}, INSIDE),
        ({"period": 0.003}, "steps take longer than the proven control period"),
        ({"age": 0.001}, "the odometry is from before this step"),
    ],
)
def test_what_is_guaranteed(package: Package, changes: dict[str, object], says: str) -> None:
    steps = package("circle").drive(0.1, **changes).steps
    assert all(says in step.message and step.level == FINE for step in steps)
    assert {step.guaranteed for step in steps} == {says == INSIDE}


def test_nothing_is_guaranteed_where_no_period_is_proven(package: Package) -> None:
    result, built = CASES["mixed"](), package("mixed")
    assert built.parameters["period"] == 0.01
    pose, speed = on_path(result)
    steps = built.drive(0.1, x=pose.x, y=pose.y, yaw=pose.yaw, speed=speed).steps
    assert all("no control period is proven" in step.message and not step.guaranteed for step in steps)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"period": 0.0}, "period: expected s"),
        ({"period": 2.0}, "period: expected s"),
        ({"longest_silence": math.nan}, "longest_silence: expected s"),
        ({"stop_beyond": 0.5}, "stop_beyond: expected a value of V"),
        ({"rear_axle": math.inf}, "rear_axle: expected m"),
        ({"speed_horizon": 0.001}, "speed_horizon: expected s, at least the period"),
    ],
)
def test_parameters_are_checked(package: Package, changes: dict[str, object], says: str) -> None:
    done = package("circle").run(steps=1, **changes)
    assert done.returncode == 2
    assert done.stderr.startswith(says) and not done.stdout


# --- the package


def test_the_files_agree_with_each_other(package: Package) -> None:
    built = package("circle")
    folder = built.folder
    manifest = ElementTree.parse(folder / "package.xml").getroot()
    name = manifest.findtext("name")
    assert manifest.get("format") == "3" and manifest.findtext("export/build_type") == "ament_cmake"
    for needed in ("version", "description", "maintainer", "license"):
        assert manifest.findtext(needed)
    lists, node = ((folder / each).read_text() for each in ("CMakeLists.txt", "src/node.cpp"))
    depends = {each.text for each in manifest.findall("depend")}
    included = set(re.findall(r'#include "(\w+)/', node))
    assert depends == included == {"rclcpp", *PACKAGES}
    assert set(re.findall(r"find_package\((\w+) REQUIRED\)", lists)) == depends | {"ament_cmake"}
    assert f"project({name} " in lists
    launched = ElementTree.parse(folder / "launch" / "follow.launch.xml").getroot().find("node")
    assert launched is not None and launched.get("pkg") == name and f"add_executable({launched.get('exec')} " in lists
    topics = {each.get("from") for each in launched.findall("remap")}
    assert topics == set(re.findall(r'(?:create_\w+)<\w+>\(\s*"(\w+)"', node))
    assert set(built.parameters) == set(re.findall(r'declare_parameter<[\w:]+>\("(\w+)"\)', node))


def test_cmake_builds_and_installs_it(package: Package, tmp_path: Path) -> None:
    """With stand-ins for the packages of ROS that CMake looks for."""
    cmake = shutil.which("cmake")
    if cmake is None and not os.environ.get("CI"):
        pytest.skip("no cmake")
    folder, build, installed = package("circle").folder, tmp_path / "build", tmp_path / "installed"
    for name in ("rclcpp", *PACKAGES):
        source = f"target_sources({name}::{name} INTERFACE {HERE / 'world.cpp'})" if name == "rclcpp" else ""
        (tmp_path / f"{name}Config.cmake").write_text(
            f"add_library({name}::{name} INTERFACE IMPORTED)\n{source}\n"
            f"target_include_directories({name}::{name} INTERFACE {HERE})\nset({name}_TARGETS {name}::{name})\n"
        )
    (tmp_path / "ament_cmakeConfig.cmake").write_text("macro(ament_package)\nendmacro()\n")
    found = [f"-D{name}_DIR={tmp_path}" for name in ("ament_cmake", "rclcpp", *PACKAGES)]
    flags = [f"-DCMAKE_{each}_FLAGS=-Werror" for each in ("C", "CXX")]
    flags += ["-DCMAKE_BUILD_TYPE=Release", f"-DCMAKE_INSTALL_PREFIX={installed}"]
    configure, make = ["-S", str(folder), "-B", str(build)], ["--build", str(build), "--target", "install"]
    for command in ([*configure, *found, *flags], make):
        done = subprocess.run([str(cmake), *command], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    share = installed / "share" / "cfjax_follower"
    assert (share / "launch" / "follow.launch.xml").exists() and (share / "config" / "parameters.yaml").exists()
    node = Built(folder, installed / "lib" / "cfjax_follower" / "follower")
    assert node.drive(0.1).steps == package("circle").drive(0.1).steps


def test_the_command_writes_a_package(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = preset("circle")
    result = certified(problem_of(config))
    write_run(result.replace(verdict=Verdict.INCONCLUSIVE), tmp_path, yaml_of(config))
    assert main([str(tmp_path), "--ros2"]) == 2
    assert "expected a certified run" in capsys.readouterr().err and not (tmp_path / "ros2").exists()

    data = json.loads((tmp_path / "result.json").read_text())
    (tmp_path / "result.json").write_text(json.dumps(data | {"verdict": "certified"}))
    (tmp_path / "certificate.json").write_text('{"hash": "sha256:abc"}')
    assert main([str(tmp_path), "--ros2"]) == 0
    written = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert all(path.is_relative_to(tmp_path / "ros2") and path.exists() for path in written)
    assert {path for path in (tmp_path / "ros2").rglob("*") if path.is_file()} == set(written)
    assert "has not been run on this package" in " ".join((tmp_path / "ros2" / "README.md").read_text().split())
    assert not (tmp_path / "controller").exists()


def test_other_vehicles_are_refused(tmp_path: Path) -> None:
    three = cfjax.problem.ball(0.5, 3)
    slider = certified(Problem(circle(), three, three, vehicle=Slider()), shape=SHAPE[:3, :3])
    with pytest.raises(InputError, match=r"export --ros2: expected a run of the kinematic bicycle, .* one of slider"):
        write_package(slider, tmp_path / "ros2")
    with pytest.raises(InputError, match=r"export --ros2: expected .* got one of"):
        write_package(CASES["steered"](), tmp_path / "ros2")
    assert not (tmp_path / "ros2").exists()
