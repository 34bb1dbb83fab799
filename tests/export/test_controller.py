"""The C controller against the law in JAX; and what it answers where there is no answer."""

import dataclasses
import json
import math
import os
import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import cfjax.problem
import cfjax.simulation.rollout as rollout
from cfjax.conf import preset, problem_of, yaml_of
from cfjax.control import MinNorm, leg_numbers, locate
from cfjax.errors import InputError
from cfjax.export import sources_of, write_controller
from cfjax.export.__main__ import main
from cfjax.export.compiled import BAD_INPUT, OK, OUTSIDE, PAST_END, CompiledController, compile_controller, compiler
from cfjax.funnel import Funnel, template_named
from cfjax.problem import (
    Interval,
    Method,
    Pose,
    Problem,
    Profile,
    ReferencePoint,
    Segment,
    Tube,
    Twist,
    Vehicle,
    circle,
    deviation_rate,
    oval,
    straight,
    to_deviation,
    to_state,
    tube,
)
from cfjax.problem.course import point_at, poses_of, profiles_of
from cfjax.report.run_folder import write_run
from cfjax.result import Result, SegmentResult
from cfjax.simulation import drive_cars
from cfjax.verdict import Verdict
from tests.certificate.test_trace import SteeredBicycle


# a newcomer may have no C compiler; where everything has to hold (.ci/run brings one) its absence fails the tests
pytestmark = pytest.mark.skipif(
    compiler() is None and not os.environ.get("CI"), reason="no C compiler: set CC or install cc"
)

STATES = 100_000
AGREEMENT = 1e-9  # of the inputs' half-widths
SHAPE = np.array([[1.6, -1.2, 0.0, 0.0], [-1.2, 2.6, 0.0, 0.0], [0.0, 0.0, 2.2, 0.3], [0.0, 0.0, 0.3, 1.5]])
MIXED = cfjax.problem.Path(  # open; ω_r jumps inside the segment and at its end, v_r has breaks of its own
    "mixed",
    (
        Segment(
            Profile((0.0, 0.7, 2.0), ((0.0, 0.5), (-0.4, 0.2, 0.3))),
            Profile((0.0, 1.1, 2.0), ((1.0, 0.0, 0.4), (1.484, -0.2))),
            Pose(0.3, 1.0, -2.0),
        ),
        Segment(Profile.constant(1.2, 1.0), Profile.constant(1.304, 1.0), Pose(0.9935, 0.3, -0.2)),
    ),
)


def certified(problem: Problem, template: str = "contracting", shape: np.ndarray = SHAPE, rate: float = 0.05) -> Result:
    """A result that looks certified, with funnels that nobody proved: one for each segment, of different margins."""
    segments = tuple(
        SegmentResult(Funnel(template_named(template), shape * (1 + 0.1 * i), rate, s.duration), 0.4, 0.3 + 0.1 * i)
        for i, s in enumerate(problem.path.curve)
    )
    return Result(Verdict.CERTIFIED, "made by hand", problem, segments, document={"hash": "sha256:made-by-hand"})


AHEAD = Tube(Interval(-0.1, 0.7), Interval(1.0, 1.0), Interval(-0.2, 0.3))


def held_by_tubes(problem: Problem, ahead: Tube | None = AHEAD) -> Result:
    """The same, held by tubes that do not end where segments do; with bounds of the path, or none, as once."""
    duration = sum(segment.duration for segment in problem.path.curve)
    bounds = Tube(curvature=Interval(-2.0, 2.0), speed=Interval(1.0, 2.0), acceleration=Interval(-1.0, 1.0))
    spans = ((0.0, 0.4 * duration), (0.4 * duration, duration))
    segments = tuple(
        SegmentResult(
            Funnel(template_named("contracting"), SHAPE * (1 + i), 0.0, np.inf, 0.9, 0.05),
            0.4,
            0.2,
            margin_per_metre=0.3,
            reference=bounds,
            span=span,
            along=ahead,
        )
        for i, span in enumerate(spans)
    )
    return Result(Verdict.CERTIFIED, "made by hand", problem, segments, document={"hash": "sha256:made-by-hand"})


STEERED_SHAPE = np.diag([1.6, 2.6, 2.2, 1.5, 0.7]) + 0.1
CASES: dict[str, Callable[[], Result]] = {
    "circle": lambda: certified(Problem(circle())),
    "oval, paper, tt": lambda: certified(Problem(oval(), method=Method.TT), "paper"),
    "mixed": lambda: certified(Problem(MIXED)),
    "mixed, growing": lambda: certified(Problem(MIXED), rate=-0.05),
    "tubes": lambda: held_by_tubes(Problem(oval())),
    "tubes, told": lambda: held_by_tubes(Problem(oval()), None),
    "steered": lambda: certified(
        Problem(
            straight(),
            vehicle=SteeredBicycle(),
            inlet=cfjax.problem.ball(0.5, 5),
            goal=cfjax.problem.ball(0.5, 5),
        ),
        shape=STEERED_SHAPE,
    ),
}


def built(result: Result, folder: Path, frame: str = "paper") -> CompiledController:
    write_controller(result, folder, frame)
    vehicle = result.problem.vehicle
    inputs = len(vehicle.input_names) + 1
    return CompiledController(compile_controller(folder), result.problem.dimension, inputs, len(vehicle.command_names))


@pytest.fixture(scope="module")
def controller_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Result, CompiledController]]:
    made: dict[str, tuple[Result, CompiledController]] = {}

    def make(case: str) -> tuple[Result, CompiledController]:
        if case not in made:
            result = CASES[case]()
            made[case] = result, built(result, tmp_path_factory.mktemp("controller"))
        made[case][1].reset()
        return made[case]

    return make


ControllerOf = Callable[[str], tuple[Result, CompiledController]]


def places(result: Result, count: int, reach: float = 1.1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """θ, leg and deviation of random places: V up to reach², on all legs."""
    rng = np.random.default_rng(3)
    ends = np.array([leg.end for leg in result.legs])
    theta = rng.uniform(0, ends[-1], count)
    leg = np.searchsorted(ends, theta, side="right")
    x = rng.normal(size=(count, result.problem.dimension))
    for i, each in enumerate(result.legs):
        x[leg == i] /= np.sqrt(each.funnel.form(x[leg == i]))[:, None]
    return theta, leg, x * rng.uniform(0, reach, count)[:, None]


def by_jax(result: Result, theta: np.ndarray, leg: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and V of the law in JAX."""
    problem, profiles = result.problem, profiles_of(result.problem.path)
    inputs, value = np.zeros((len(theta), len(problem.inputs))), np.zeros(len(theta))
    begin = 0.0
    for i, each in enumerate(result.legs):
        own = leg == i
        at, states = jnp.asarray(theta[own]), tuple(jnp.asarray(column) for column in x[own].T)
        numbers = leg_numbers(problem, each)
        point = ReferencePoint(*(jnp.broadcast_to(f, at.shape) for f in point_at(profiles, profiles.find(at), at)))
        found = MinNorm()(problem.vehicle, each.funnel.template, numbers, point, at - begin, states)
        inputs[own] = np.stack([np.broadcast_to(v, at.shape) for v in found], axis=1)
        value[own] = np.asarray(each.funnel.template.value(each.funnel.rate, at - begin, each.funnel.form(x[own])))
        begin = float(each.end)
    return inputs, value


def half_widths(problem: Problem) -> np.ndarray:
    return np.array([box.half or 1.0 for box in problem.inputs])


@pytest.mark.parametrize("case", CASES)
def test_the_law_is_the_law(controller_of: ControllerOf, case: str) -> None:
    result, controller = controller_of(case)
    theta, leg, x = places(result, STATES)
    inputs, value = by_jax(result, theta, leg, x)
    statuses, found = controller.inputs_of_many(theta, leg.tolist(), x)
    status = np.array(statuses)
    assert (np.abs(found - inputs) / half_widths(result.problem)).max() < AGREEMENT
    clear = np.abs(value - 1) > 1e-12
    np.testing.assert_array_equal(status[clear], np.where(value > 1, OUTSIDE, OK)[clear])
    assert {OK, OUTSIDE} == set(status)
    some = range(0, STATES, 100)
    own = [controller.value(float(theta[i]), int(leg[i]), x[i]) for i in some]
    np.testing.assert_allclose(own, value[some], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("case", ["circle", "mixed", "tubes", "steered"])
def test_a_step_from_the_inertial_frame(controller_of: ControllerOf, case: str) -> None:
    """State in, physical command out; the heading may have turned any number of times."""
    result, controller = controller_of(case)
    problem, count, dt = result.problem, 2000, 1e-3
    profiles, poses = profiles_of(problem.path), poses_of(problem.path, problem.side_slip)
    theta, leg, x = places(result, count)
    at = jnp.asarray(theta)
    point, pose = point_at(profiles, profiles.find(at), at), tuple(p for p, _ in poses.at(poses.find(at), at))
    turned = (jnp.asarray(x[:, 0] + 2 * np.pi * (np.arange(count) % 7 - 3)), *map(jnp.asarray, x[:, 1:].T))
    state = np.stack([np.broadcast_to(s, count) for s in to_state(problem.vehicle, turned, pose, point)], axis=1)
    again = np.stack([np.broadcast_to(s, count) for s in to_deviation(problem.vehicle, tuple(state.T), pose, point)], 1)
    inputs, _ = by_jax(result, theta, leg, again)
    expected = np.stack([np.asarray(c) for c in problem.vehicle.command(tuple(inputs[:, 1:].T))], axis=1)
    for i in range(count):  # at random θ: the hints are of no use
        controller.memory.theta, controller.memory.leg, controller.memory.lap = theta[i], int(leg[i]), 0
        status, command = controller.step(np.ascontiguousarray(state[i]), dt)
        assert status in (OK, OUTSIDE)
        np.testing.assert_allclose(command, expected[i], rtol=1e-8, atol=1e-8)
        reached = theta[i] + inputs[i, 0] * dt
        end = result.legs[-1].end
        assert controller.memory.theta == pytest.approx(reached % end if problem.path.closed else reached, abs=1e-9)
    if problem.vehicle.name == "kinematic_bicycle":
        np.testing.assert_allclose(expected[:, 0], np.arctan(inputs[:, 1]))


@pytest.mark.parametrize("case", ["circle", "oval, paper, tt", "mixed", "tubes"])
def test_it_finds_the_car_as_locate_does(controller_of: ControllerOf, case: str) -> None:
    result, controller = controller_of(case)
    rng = np.random.default_rng(8)
    states = rng.uniform([-9, -2.5, -2.5, 0], [9, 2.5, 2.5, 3], size=(60, 4))
    found = locate(result.problem, result.legs, states)
    for i, state in enumerate(states):
        status = controller.start(np.ascontiguousarray(state))
        assert status == (OK if found.inside[i] else OUTSIDE)
        assert controller.memory.value == pytest.approx(found.value[i], rel=1e-9)
        apart = abs(controller.memory.theta - found.theta[i])
        end = result.legs[-1].end
        assert min(apart, abs(apart - end) if result.problem.path.closed else apart) < 1e-5 * end
        assert controller.memory.lap == 0


def driven(
    controller: CompiledController, vehicle: Vehicle, state: np.ndarray, dt: float, laps: int
) -> list[np.ndarray]:
    """States at which each lap begins, of a car with held inputs; RK4 in the inertial frame."""

    def rate(z: np.ndarray, steering: float, thrust: float) -> np.ndarray:
        turn = z[3] / vehicle.wheelbase * np.tan(steering)
        return np.array([turn, -z[3] * np.sin(z[0]), z[3] * np.cos(z[0]), thrust])

    controller.reset()
    begins, legs = [], []
    while len(begins) < laps:
        lap = controller.memory.lap
        status, command = controller.step(state, dt)
        assert status == OK
        a = rate(state, *command)
        b = rate(state + dt / 2 * a, *command)
        c = rate(state + dt / 2 * b, *command)
        state = state + dt / 6 * (a + 2 * b + 2 * c + rate(state + dt * c, *command))
        legs.append(controller.memory.leg)
        if controller.memory.lap > lap:
            begins.append(state)
    assert set(legs) == {0, 1}
    return begins


def test_a_lap_with_a_change_of_legs(controller_of: ControllerOf, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the simulation drives it, up to the length of a step; the second lap begins where the first one ended."""
    result, controller = controller_of("tubes")
    problem = result.problem
    x = (0.1, 0.15, -0.1, 0.1)
    monkeypatch.setattr(rollout, "sample_starts", lambda key, inlet, count: jnp.array([x]))
    _, ways = drive_cars(problem, result.legs, cars=1)
    expected = ways.x[-1, 0]
    first = problem.path.curve[0]
    pose = tuple(first.start)
    state = np.array([float(s) for s in to_state(problem.vehicle, x, pose, first.point(0.0))])
    errors = []
    for dt in (4e-3, 2e-3):
        one, two = driven(controller, problem.vehicle, state, dt, 2)
        errors.append(np.abs(controller.deviation(0.0, one) - expected).max())
        assert np.abs(controller.deviation(0.0, two)).max() < 0.05
        assert one[0] - state[0] == pytest.approx(2 * np.pi, abs=0.3)  # and nothing jumped
    assert errors[1] < 5e-3 and errors[1] < errors[0]


def test_past_the_end_it_goes_straight_on(controller_of: ControllerOf) -> None:
    result, controller = controller_of("mixed")
    end, last = result.legs[-1].end, result.problem.path.curve[-1]
    alpha, x, y = last.poses(np.array([last.duration]))[0]
    speed = last.point(last.duration).speed
    beyond = np.array([alpha, x - 0.7 * speed * np.sin(alpha), y + 0.7 * speed * np.cos(alpha), speed])
    np.testing.assert_allclose(controller.deviation(end + 0.7, beyond), 0.0, atol=1e-8)
    controller.memory.theta, controller.memory.leg = end + 0.7, 1
    status, command = controller.step(beyond, 1e-2)
    assert status == PAST_END
    np.testing.assert_allclose(command, 0.0, atol=1e-6)
    assert controller.memory.theta == pytest.approx(end + 0.71)
    assert controller.step(beyond + np.array([0, 5.0, 0, 0]), 1e-2)[0] == OUTSIDE
    assert controller.inputs(1e300, 1, np.zeros(4))[0] == BAD_INPUT


def test_headings_wrap(controller_of: ControllerOf) -> None:
    _, controller = controller_of("circle")
    for turn in (-np.pi, -3.0, 0.0, 1.0, 3.1, np.pi, 5.0, 400.0):
        found = controller.deviation(0.0, np.array([turn, 1.5, 0.0, np.pi / 2]))[0]
        assert -np.pi <= found <= np.pi
        assert np.cos(found) == pytest.approx(np.cos(turn)) and np.sin(found) == pytest.approx(np.sin(turn), abs=1e-12)


# --- no answer


GOOD = np.array([0.05, 1.5, 0.1, 1.5])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300, -2e6, 5e-324])
@pytest.mark.parametrize("entry", range(4))
def test_bad_states_have_a_safe_answer(controller_of: ControllerOf, entry: int, bad: float) -> None:
    _, controller = controller_of("circle")
    controller.start(GOOD)
    _, before = controller.step(GOOD, 1e-3)
    theta, state = controller.memory.theta, GOOD.copy()
    state[entry] = bad
    status, command = controller.step(state, 1e-3)
    if abs(bad) < 1:  # a denormal number is a number
        assert status in (OK, OUTSIDE)
        return
    assert status == BAD_INPUT
    assert controller.memory.theta == theta
    np.testing.assert_array_equal(command, [before[0], -4.0])
    assert controller.step(GOOD, 1e-3)[0] == OK  # and goes on


def test_blind_it_brakes_to_a_standstill(controller_of: ControllerOf) -> None:
    _, controller = controller_of("circle")
    _, before = controller.step(GOOD, 1e-3)
    speed, blind = GOOD[3], np.full(4, np.nan)
    for _ in range(100):
        status, command = controller.step(blind, 0.01)
        assert status == BAD_INPUT and command[0] == before[0]
        speed += 0.01 * command[1]
    assert speed == pytest.approx(0.0, abs=1e-12) and command[1] == 0.0


@pytest.mark.parametrize("dt", [np.nan, np.inf, -1e-3, 2.0])
def test_bad_steps(controller_of: ControllerOf, dt: float) -> None:
    _, controller = controller_of("circle")
    status, command = controller.step(GOOD, dt)
    assert status == BAD_INPUT and command[1] == -4.0


@pytest.mark.parametrize(("theta", "leg"), [(np.nan, 0), (np.inf, 0), (-1.0, 0), (7.0, 0), (1.0, -1), (1.0, 1)])
def test_a_memory_that_is_none(controller_of: ControllerOf, theta: float, leg: int) -> None:
    _, controller = controller_of("circle")
    assert controller.inputs(theta, leg, np.zeros(4))[0] == BAD_INPUT
    assert controller.value(theta, leg, np.zeros(4)) == -1.0
    controller.memory.theta, controller.memory.leg = theta, leg
    status, command = controller.step(GOOD, 1e-3)
    assert status == BAD_INPUT and np.isfinite(command).all()
    controller.memory.theta, controller.memory.leg = 0.0, 0
    controller.memory.piece, controller.memory.cell = -7, 10**6  # hints are but hints
    assert controller.step(GOOD, 1e-3)[0] == OK


TORTURE = """
#include "cfjax_controller.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
int main(void)
{
    static const double strange[] = {0.0, 1e308, -1e308, 1e-320, 1e6, -1e6, 1e7, 3.14159265358979, 1.5};
    cf_controller controller;
    double state[CF_STATES], command[CF_COMMANDS], inputs[CF_INPUTS], deviation[CF_STATES];
    long step, bad = 0;
    int i;
    memset(&controller, 0, sizeof controller);
    srand(1);
    for (step = 0; step < 200000; step++) {
        double dt = step % 13 ? 0.01 : strange[rand() % 9];
        if (step % 1009 == 0)
            memset(&controller, step % 3 ? 0xff : 0x7f, sizeof controller);
        if (step % 1013 == 0)
            cf_reset(&controller);
        for (i = 0; i < CF_STATES; i++) {
            int kind = rand() % 20;
            state[i] = kind < 2 ? strange[rand() % 9] : kind == 2 ? NAN : kind == 3 ? -INFINITY
                : 4.0 * rand() / RAND_MAX - 2.0;
        }
        if (step % 5003 == 0)
            cf_start(&controller, state);
        if (cf_step(&controller, state, dt, command) == CF_BAD_INPUT)
            bad++;
        for (i = 0; i < CF_COMMANDS; i++)
            if (!isfinite(command[i]))
                return 1;
        cf_inputs(20.0 * rand() / RAND_MAX - 5.0, rand() % (CF_LEGS + 2) - 1, state, inputs);
        for (i = 0; i < CF_INPUTS; i++)
            if (!isfinite(inputs[i]))
                return 2;
        cf_deviation(state[0], state, deviation);
    }
    cf_reset(NULL);
    if (cf_start(NULL, state) != CF_BAD_INPUT || cf_start(&controller, NULL) != CF_BAD_INPUT
        || cf_step(NULL, state, 0.01, command) != CF_BAD_INPUT
        || cf_step(&controller, NULL, 0.01, command) != CF_BAD_INPUT
        || cf_step(&controller, state, 0.01, NULL) != CF_BAD_INPUT || cf_inputs(0.0, 0, NULL, inputs) != CF_BAD_INPUT)
        return 3;
    return bad > 0 && bad < step ? 0 : 4;
}
"""


@pytest.mark.parametrize("case", ["oval, paper, tt", "mixed", "tubes", "steered"])
def test_sanitizers_find_nothing(case: str, tmp_path: Path) -> None:
    write_controller(CASES[case](), tmp_path)
    (tmp_path / "torture.c").write_text(TORTURE)
    kinds = "address,undefined,float-divide-by-zero,float-cast-overflow"
    flags = (f"-fsanitize={kinds}", "-fno-sanitize-recover=all", "-g")
    program = compile_controller(tmp_path, *flags, main=tmp_path / "torture.c")
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


# --- the command


def test_the_command_writes_beside_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = preset("circle")
    result = certified(problem_of(config))
    write_run(result.replace(verdict=Verdict.INCONCLUSIVE), tmp_path, yaml_of(config))
    assert main([str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "error: export: expected a certified run, got one that is inconclusive"
    assert not (tmp_path / "controller").exists()

    data = json.loads((tmp_path / "result.json").read_text())
    data["verdict"], data["segments"][0]["margin_certified"] = "certified", 0.3125
    (tmp_path / "result.json").write_text(json.dumps(data))
    (tmp_path / "certificate.json").write_text('{"hash": "sha256:abc"}')
    assert main([str(tmp_path)]) == 0
    written = capsys.readouterr().out.split()
    assert written == [str(tmp_path / "controller" / name) for name in ("cfjax_controller.h", "cfjax_controller.c")]
    text = Path(written[0]).read_text()
    for fact in ("sha256:abc", "circle", "0.3125 1/s", "rad", "steering angle", "V <= 1"):
        assert fact in text
    controller = CompiledController(compile_controller(tmp_path / "controller"), 4, 3, 2)
    assert controller.start(GOOD) == OK
    assert main([str(tmp_path), "--output", str(tmp_path / "a=b,c")]) == 0
    assert (tmp_path / "a=b,c" / "cfjax_controller.c").read_text() == Path(written[1]).read_text()
    capsys.readouterr()
    assert main([str(tmp_path), "--ros2", "--frame", "paper"]) == 2
    assert capsys.readouterr().err.startswith("error: --frame: expected none beside --ros2")
    (tmp_path / "config.yaml").write_text(yaml_of(dataclasses.replace(config, frame="ros")))  # as the run was asked for
    assert main([str(tmp_path)]) == 0 and "#define CF_ROS 1" in Path(written[0]).read_text()
    assert main([str(tmp_path), "--frame", "paper"]) == 0 and "#define CF_ROS 0" in Path(written[0]).read_text()
    capsys.readouterr()
    assert main([str(tmp_path), "--output", str(tmp_path / "result.json")]) == 2
    assert capsys.readouterr().err.startswith("error: --output: cannot write to ")
    assert main([str(tmp_path / "nowhere")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ") and "nowhere" in line


def test_a_tube_alone_has_no_path(hand_made: Callable[..., Result]) -> None:
    result = hand_made(Problem(tube(), goal=cfjax.problem.ball(0.9)), verdict=Verdict.CERTIFIED, document={})
    with pytest.raises(InputError, match="expected segments, got a tube"):
        sources_of(result)


def test_files_of_two_exports_do_not_compile(tmp_path: Path) -> None:
    result = CASES["circle"]()
    write_controller(result, tmp_path)
    other = sources_of(dataclasses.replace(result, document={"hash": "sha256:other"}))
    (tmp_path / "cfjax_controller.h").write_text(other.header)
    with pytest.raises(RuntimeError, match="header and source are of two exports"):
        compile_controller(tmp_path)


@pytest.mark.parametrize(
    ("case", "goal", "says"),
    [
        ("circle", 0.5, "Yes: G lies in I"),
        ("circle", 0.6, "Yes: the last funnel is the first one"),
        ("tubes", 0.6, "No: G does not lie in I"),
        ("mixed", 0.5, "No: the path is open"),
    ],
)
def test_the_header_says_what_is_proven_of_the_next_lap(case: str, goal: float, says: str) -> None:
    result = CASES[case]()
    problem = dataclasses.replace(result.problem, goal=cfjax.problem.ball(goal))
    assert f"Lap after lap: {says}" in sources_of(result.replace(problem=problem)).header


@dataclasses.dataclass(frozen=True)
class Slider(Vehicle):
    """No internal states at all: turn rate and both velocities are inputs, and one of them is there twice."""

    name = "slider */ of μ"
    internal_names = ()
    input_names = ("turn", "lateral", "forward", "more")

    @property
    def input_box(self) -> tuple[Interval, ...]:
        return tuple(Interval(-4.0, 4.0) for _ in self.input_names)

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        turn, lateral, forward, more = inputs
        return Twist(turn=turn, lateral=lateral, forward=forward + 2.0 * more)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        return ()

    def reference(self, turn_rate: object, speed: object) -> tuple[Twist, tuple]:
        return Twist(turn=turn_rate, lateral=0.0, forward=speed), ()


def test_a_vehicle_without_internal_states(tmp_path: Path) -> None:
    """Its command is its inputs; the safe answer holds them; the feed-forward leaves the second of a pair alone."""
    three = cfjax.problem.ball(0.5, 3)
    result = certified(Problem(circle(), three, three, vehicle=Slider()), shape=np.diag([1.6, 2.6, 2.2]))
    controller = built(result, tmp_path)
    theta, leg, x = places(result, 2000)
    inputs, _ = by_jax(result, theta, leg, x)
    _, found = controller.inputs_of_many(theta, leg.tolist(), x)
    assert (np.abs(found - inputs) / half_widths(result.problem)).max() < AGREEMENT
    _, command = controller.step(np.array([0.1, 1.5, 0.1]), 1e-3)
    np.testing.assert_array_equal(command, controller.memory.inputs[1:])
    status, again = controller.step(np.full(3, np.nan), 1e-3)
    assert status == BAD_INPUT
    np.testing.assert_array_equal(again, command)


def test_operations_that_c_has_not_are_refused_by_name() -> None:
    class Rounded(Slider):
        def command(self, inputs: tuple) -> tuple:
            return tuple(jnp.round(value) for value in inputs)

    three = cfjax.problem.ball(0.5, 3)
    result = certified(Problem(circle(), three, three, vehicle=Rounded()), shape=np.diag([1.6, 2.6, 2.2]))
    with pytest.raises(InputError, match="no C for the operation 'round'"):
        sources_of(result)


def test_what_the_source_may_not_do() -> None:
    """No memory from the heap, nothing that changes outside the caller's struct, no library but C's."""
    for make in CASES.values():
        header, source = sources_of(make())
        assert not re.search(r"\b(malloc|calloc|realloc|free|printf|goto)\b", source)
        assert set(re.findall(r"#include\s+(\S+)", source)) == {
            '"cfjax_controller.h"',
            "<float.h>",
            "<math.h>",
            "<stddef.h>",
        }
        assert not re.search(r"^static (?!const|\w+ \w+\(|\w+ \*?\w+\()", source, re.MULTILINE)
        assert max(map(len, header.splitlines())) <= 120


def test_the_rate_that_the_test_integrates_is_the_vehicle() -> None:
    """`driven` writes the bicycle a second time, in the inertial frame: held against the one definition."""
    problem = Problem(straight())
    x, inputs = (0.2, 0.0, 0.0, 0.3), (1.0, 0.4, 1.5)
    rates = deviation_rate(problem.vehicle, x, inputs, ReferencePoint(0.0, 1.0))
    expected = (1.3 / 0.34 * 0.4, -1.3 * np.sin(0.2), 1.3 * np.cos(0.2) - 1.0, 1.5)
    np.testing.assert_allclose([float(rate) for rate in rates], expected)


def test_poses_of_ros_go_in_and_out(controller_of: ControllerOf) -> None:
    result, controller = controller_of("circle")
    for x, y, yaw in np.random.default_rng(0).uniform(-3, 3, (20, 3)):
        state = controller.from_ros(x, y, yaw)
        np.testing.assert_allclose(state[:3], cfjax.problem.pose_from_ros((x, y, yaw)), rtol=0, atol=1e-15)
        assert np.isnan(state[3:]).all()  # the speed is not the pose's
        np.testing.assert_allclose(controller.to_ros(state), (x, y, yaw), rtol=0, atol=1e-15)
    start = result.problem.path.curve[0].start
    state = controller.from_ros(*cfjax.problem.pose_to_ros(start))
    state[3] = math.pi / 2  # m/s, the reference's
    assert controller.start(state) == OK
    assert controller.memory.value == pytest.approx(0.0, abs=1e-12)


def test_states_in_the_frame_of_ros(tmp_path: Path, controller_of: ControllerOf) -> None:
    """Yaw in place of the heading: the same place, V and commands; and poses of ROS go in and out as they are."""
    result, controller = controller_of("circle")
    (tmp_path / "ros").mkdir()
    ros = built(result, tmp_path / "ros", "ros")
    text = (tmp_path / "ros" / "cfjax_controller.h").read_text()
    assert "yaw (rad, 0 looks along +x, counter-clockwise)" in text and "+y, counter" not in text
    turned = np.array([math.pi / 2, 0.0, 0.0, 0.0])
    for state in GOOD + np.random.default_rng(0).uniform(-0.2, 0.2, (10, 4)):
        assert ros.start(state + turned) == controller.start(state)
        for dt in (0.005, 0.02):
            status, command = controller.step(state, dt)
            own_status, own = ros.step(state + turned, dt)
            assert own_status == status
            np.testing.assert_allclose(own, command, rtol=0, atol=1e-9)
        assert ros.memory.value == pytest.approx(controller.memory.value, abs=1e-12)
    pose = (0.3, -1.2, 2.5)
    assert ros.from_ros(*pose)[:3].tolist() == [2.5, 0.3, -1.2] and tuple(ros.to_ros(ros.from_ros(*pose))) == pose
