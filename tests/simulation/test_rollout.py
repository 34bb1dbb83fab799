"""Closed loops along paths: accuracy, legs, counting, and what goes wrong on purpose."""

import dataclasses
import itertools
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import cfjax.simulation.rollout as rollout
from cfjax.control import MinNorm, law_numbers
from cfjax.errors import InputError
from cfjax.funnel import Contracting, Funnel, Leg, Paper
from cfjax.problem import (
    Box,
    Disc,
    Ellipsoid,
    FootprintDisc,
    Method,
    Path,
    Pose,
    Problem,
    Profile,
    ReferencePoint,
    Segment,
    ball,
    circle,
    ellipse,
    figure_eight,
    obstacle_path,
    oval,
    slalom,
    straight,
    tube,
)
from cfjax.problem.course import profiles_of
from cfjax.simulation import drive_cars
from cfjax.simulation.loop import advance, loop_of, sample_starts, start
from cfjax.simulation.rollout import drive
from cfjax.traced import traced


PROBLEM = Problem(circle(), safe=Box((1.0, 1.0, 1.0, 3.0)))
SEGMENT = PROBLEM.path.segments[0]
# a quadratic form that the law can bring down (no proof needed here): found by hand from a linear design
SHAPE = np.array([[1.6, -1.2, 0.0, 0.0], [-1.2, 2.6, 0.0, 0.0], [0.0, 0.0, 2.2, 0.3], [0.0, 0.0, 0.3, 1.5]])
FUNNEL = Funnel(Contracting(), SHAPE, 0.05, SEGMENT.duration)
LEG = Leg(SEGMENT.duration, FUNNEL, 0.3)
MIXED = Path(  # ω_r jumps inside the segment and at its end, v_r goes up and down again with breaks of its own
    "mixed",
    (
        Segment(
            Profile((0.0, 0.7, 2.0), ((0.0, 0.5), (-0.4, 0.2, 0.3))),
            Profile((0.0, 1.1, 2.0), ((1.0, 0.0, 0.4), (1.484, -0.2))),
            Pose(0.3, 1.0, -2.0),
        ),
        Segment(Profile.constant(1.2, 1.0), Profile.constant(1.304, 1.0), Pose(0.0, 0.0, 0.0)),
    ),
)


def legs_along(path: Path, shape: np.ndarray = SHAPE, rate: float = 0.05, margin: float = 0.3) -> list[Leg]:
    """A leg per segment, all with one form."""
    ends = itertools.accumulate(segment.duration for segment in path.curve)
    return [
        Leg(end, Funnel(Contracting(), shape, rate, segment.duration), margin)
        for end, segment in zip(ends, path.curve, strict=True)
    ]


def ways(problem: Problem, legs: list[Leg], starts: np.ndarray, finer: int = 1):
    """Final states and record of all cars that start there, in steps so many times as fine."""
    profiles = profiles_of(problem.path)
    table = rollout.table_of(problem, legs, profiles)
    table = table._replace(loop=table.loop._replace(step=table.loop.step / finer))
    template = legs[0].funnel.template
    program = traced(drive, problem.vehicle, template, MinNorm(), 1001, 1)
    return program(table, profiles, None, jnp.asarray(starts), 100_000, 100)


def started_at(monkeypatch: pytest.MonkeyPatch, *starts: tuple[float, ...]) -> None:
    """All cars start with these deviations, in turns."""
    monkeypatch.setattr(
        rollout, "sample_starts", lambda key, inlet, count: jnp.array([starts[i % len(starts)] for i in range(count)])
    )


def test_starts_fill_the_inlet() -> None:
    inlet = Ellipsoid((0.5, 0.2, 0.3, 1.0))
    x = np.asarray(sample_starts(jax.random.key(0), inlet, 4000))
    radius = np.sqrt(np.einsum("ki,ij,kj->k", x, inlet.shape, x))
    np.testing.assert_allclose(radius[:2000], 1.0, atol=1e-12)
    assert (radius[2000:] <= 1).all()
    # uniform in the volume: the share inside radius r is r^4
    assert (radius[2000:] < 0.8).mean() == pytest.approx(0.8**4, abs=0.04)


# --- integration


def smooth_loop(end: float, step: float):
    """Nothing is asked for: no kinks in the law. One step, and where a car starts."""
    nothing = jnp.asarray(-1e6)
    law = law_numbers(PROBLEM, FUNNEL, 0.5)._replace(decrease=nothing, decrease_per_metre=nothing)
    loop = loop_of(PROBLEM, law, step, 0.0, end)

    def reference(theta: jax.Array) -> tuple[ReferencePoint, ReferencePoint]:
        """A speed that changes, so that the reference moves the deviation too."""
        return (ReferencePoint(1 + theta, 1.5 + theta**2, jnp.ones_like(theta), 2 * theta),) * 2

    step_once = jax.jit(partial(advance, PROBLEM.vehicle, FUNNEL.template, MinNorm(), reference=reference))
    return loop, step_once, start(FUNNEL.template, loop, jnp.array([[0.2, 0.3, -0.2, 0.4]]))


def test_integration_is_of_fourth_order() -> None:
    def end(steps: int) -> np.ndarray:
        loop, advance, cars = smooth_loop(np.inf, 0.4 / steps)
        for _ in range(steps):
            cars, _ = advance(loop=loop, cars=cars)
        return np.array([cars.theta, *cars.x])

    steps = np.array([5, 10, 20])
    errors = [np.abs(end(int(n)) - end(320)).max() for n in steps]
    slope = np.polyfit(np.log(0.4 / steps), np.log(errors), 1)[0]
    assert 3.5 < slope < 5.0


def test_a_car_that_passes_the_end_is_where_it_crossed() -> None:
    """The same end, met in the middle of a step and by small steps; the error is that of dense output, h⁴ in a step."""

    def end(step: float) -> np.ndarray:
        loop, advance, cars = smooth_loop(0.1, step)
        while cars.theta[0] < 0.1:
            cars, _ = advance(loop=loop, cars=cars)
        stays, _ = advance(loop=loop, cars=cars)
        assert cars.theta[0] == 0.1
        np.testing.assert_array_equal([*cars.x, cars.clock], [*stays.x, stays.clock])
        return np.array([cars.clock, *cars.x])

    exact = end(1e-4)
    steps = np.array([0.16, 0.08, 0.04]) * 1.31  # none divides the way to the end
    errors = [np.abs(end(h) - exact).max() for h in steps]
    assert errors[0] < 1e-3 and errors[2] < errors[0] / 30


@pytest.mark.parametrize("narrow", [1.0, 0.1])
@pytest.mark.parametrize("path", [circle(), oval(), obstacle_path(), MIXED], ids=lambda path: path.name)
def test_steps_are_fine_enough(path: Path, narrow: float) -> None:
    """Eight times finer steps lead to the same place, to a small part of the funnel however narrow it is."""
    problem = Problem(path, inlet=ball(0.5 * narrow))
    legs = legs_along(path, SHAPE / narrow**2)
    starts = np.asarray(sample_starts(jax.random.key(1), problem.inlet, 100))
    coarse, fine = (ways(problem, legs, starts, finer)[0].cars for finer in (1, 8))
    assert np.abs(np.stack(coarse.x) - np.stack(fine.x)).max() < 1e-4 * narrow
    assert np.abs(coarse.clock - fine.clock).max() < 1e-4 * narrow
    assert np.abs(coarse.largest_value - fine.largest_value).max() < 1e-4


@pytest.mark.parametrize("path", [oval(), obstacle_path(), figure_eight()], ids=lambda path: path.name)
def test_a_car_in_the_plane_takes_the_same_way(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One car in the inertial frame with the same law, by an adaptive integrator; the deviation from poses alone."""
    problem = Problem(path, inlet=ball(0.3))
    legs = legs_along(path)
    x0 = np.array([0.15, -0.1, 0.12, 0.2])
    started_at(monkeypatch, tuple(x0))
    _, recorded = drive_cars(problem, legs, cars=1)

    begins = np.array([0.0, *(leg.end for leg in legs)])
    splines = []
    for segment in path.curve:
        grid = np.linspace(0.0, segment.duration, 4001)
        splines.append(CubicSpline(grid, segment.poses(grid)))

    @partial(jax.jit, static_argnums=0)
    def law(leg: int, point: ReferencePoint, theta: float, x: tuple) -> tuple:
        own = law_numbers(problem, legs[leg].funnel, legs[leg].margin)
        return MinNorm()(problem.vehicle, legs[leg].funnel.template, own, point, theta, x)

    def deviation(leg: int, state: np.ndarray) -> tuple[tuple[float, ...], ReferencePoint, float]:
        alpha, x, y, v, theta = state
        local = float(theta - begins[leg])
        point = path.curve[leg].point(local)
        alpha_r, x_r, y_r = splines[leg](local)
        c, s = np.cos(alpha_r), np.sin(alpha_r)
        dx, dy = x - x_r, y - y_r
        return (float(alpha - alpha_r), float(c * dx + s * dy), float(c * dy - s * dx), v - point.speed), point, local

    def rate(leg: int, _: float, state: np.ndarray) -> list[float]:
        own, point, local = deviation(leg, state)
        u0, w, thrust = (float(u) for u in law(leg, point, local, own))
        v = state[3]
        return [v / 0.34 * w, -v * np.sin(state[0]), v * np.cos(state[0]), thrust, u0]

    first, point = path.curve[0].start, path.curve[0].point(0.0)
    c, s = np.cos(first.alpha), np.sin(first.alpha)
    place = (first.x + c * x0[1] - s * x0[2], first.y + s * x0[1] + c * x0[2])
    state, clock, worst = np.array([first.alpha + x0[0], *place, point.speed + x0[3], 0.0]), 0.0, 0.0
    for leg in range(len(legs)):

        def arrives(_: float, state: np.ndarray, end: float = begins[leg + 1]) -> float:
            return state[4] - end

        arrives.terminal = True
        found = solve_ivp(
            partial(rate, leg), (clock, 100.0), state, rtol=1e-8, atol=1e-10, events=arrives, dense_output=True
        )
        here = (recorded.clock[:, 0] >= clock) & (recorded.clock[:, 0] < found.t[-1])
        for row in np.flatnonzero(here)[::20]:
            x, *_ = deviation(leg, found.sol(recorded.clock[row, 0]))
            worst = max(worst, np.abs(np.array(x) - recorded.x[row, 0]).max())
        clock, state = found.t[-1], found.y[:, -1]
    assert worst < 1e-4
    assert recorded.clock[-1, 0] == pytest.approx(clock, abs=1e-4)
    np.testing.assert_allclose(deviation(len(legs) - 1, state)[0], recorded.x[-1, 0], atol=1e-4)


CURVES = [circle(), oval(), figure_eight(), obstacle_path(), slalom(), MIXED]


@pytest.mark.parametrize("path", CURVES, ids=lambda path: path.name)
def test_a_car_on_the_reference_stays_there(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started_at(monkeypatch, (0.0, 0.0, 0.0, 0.0))
    summary, recorded = drive_cars(Problem(path), legs_along(path), cars=2)
    duration = sum(segment.duration for segment in path.curve)
    np.testing.assert_allclose(summary.arrival, duration, atol=1e-6)
    assert (recorded.theta[-1] == pytest.approx(duration, abs=1e-12)) and (np.diff(recorded.theta, axis=0) >= 0).all()
    assert summary.largest_value < 1e-8
    assert (summary.left_funnel, summary.left_safe, summary.missed_goal) == (0, 0, 0)


def test_work_grows_with_length() -> None:
    """Laps of a short path take as many steps each as one alone would, but for the least number."""

    def limit(laps: int) -> float:
        path = ellipse(laps=laps)
        table = rollout.table_of(Problem(path), legs_along(path), profiles_of(path))
        return float(((table.loop.end - table.loop.begin) / table.loop.step).sum())

    assert limit(1) >= rollout.STEPS and limit(8) == pytest.approx(4 * limit(2))


# --- legs


@pytest.mark.parametrize("path", [oval(), MIXED], ids=lambda path: path.name)
def test_v_is_measured_in_the_funnel_of_the_leg(path: Path) -> None:
    first, second = legs_along(path)
    second = second._replace(funnel=dataclasses.replace(second.funnel, shape=1.7 * SHAPE, rate=0.1))
    problem = Problem(path, inlet=ball(0.3))
    summary, recorded = drive_cars(problem, [first, second], cars=100)
    later = recorded.theta >= first.end
    assert (later.any(axis=0).all() and not later.all(axis=1).any()) or later[-1].all()
    wanted = np.where(
        later,
        second.funnel.value(recorded.theta - first.end, recorded.x),
        first.funnel.value(recorded.theta, recorded.x),
    )
    np.testing.assert_allclose(recorded.value, wanted, atol=1e-12)
    assert (recorded.theta == first.end).any(axis=0).all()  # every car is put on the end of its leg
    assert recorded.value.max() <= summary.largest_value + 1e-12
    assert summary.left_funnel == 0


def test_entering_a_funnel_outside_it_counts() -> None:
    """The second funnel is far too narrow at its begin, and law and time have nothing to do with it."""
    path = oval()
    first, second = legs_along(path)
    narrow = second._replace(funnel=dataclasses.replace(second.funnel, shape=1e4 * SHAPE))
    summary, _ = drive_cars(Problem(path), [first, narrow], cars=50)
    assert summary.left_funnel > 40 and summary.largest_value > 2
    assert drive_cars(Problem(path), [first, second], cars=50)[0].left_funnel == 0


def test_a_boundary_between_equal_funnels_changes_nothing() -> None:
    held = Funnel(Contracting(), SHAPE, 0.0, np.inf)
    path = oval()
    problem, duration = Problem(path), sum(segment.duration for segment in path.curve)
    whole = [Leg(duration, held, 0.3, 0.2)]
    cut = [Leg(end, held, 0.3, 0.2) for end in (0.4, 1.23456, path.curve[0].duration, 7.0, duration)]
    starts = np.asarray(sample_starts(jax.random.key(2), problem.inlet, 60))
    one, many = (ways(problem, legs, starts)[0].cars for legs in (whole, cut))
    assert np.abs(np.stack(one.x) - np.stack(many.x)).max() < 1e-5
    assert np.abs(one.clock - many.clock).max() < 1e-5
    assert np.abs(one.largest_value - many.largest_value).max() < 1e-9


def test_the_margin_per_metre_counts() -> None:
    """V comes down as μ v_r says where that is more than λ."""
    held = Funnel(Contracting(), SHAPE, 0.0, np.inf, 0.9, 0.1)
    problem = Problem(straight(4.0, 2.0), inlet=ball(0.4))
    slow, fast = (
        drive_cars(problem, [Leg(2.0, held, 0.05, per_metre)], cars=50)[1].value[-1].max() for per_metre in (0.0, 0.5)
    )
    assert fast < 0.5 * slow


def test_legs_that_do_not_fit_are_refused() -> None:
    def refused(legs: list[Leg], match: str, problem: Problem = PROBLEM) -> None:
        with pytest.raises(InputError, match=match):
            drive_cars(problem, legs, cars=3)

    refused([], "expected increasing ends")
    refused([LEG._replace(end=5.0)], r"theta = 6 s where the path ends, got \[5.0\]")
    refused([LEG._replace(end=3.0), LEG._replace(end=3.0), LEG], "expected increasing ends")
    refused([LEG._replace(end=3.0), LEG], "expected a funnel of 3 s for leg 0, got one of 6 s")
    first, second = legs_along(oval())
    other = second._replace(funnel=dataclasses.replace(second.funnel, template=Paper()))
    refused([first, other], "one template, got contracting and paper", Problem(oval()))
    held = second._replace(funnel=Funnel(Paper(), SHAPE, 0.0, np.inf))
    assert drive_cars(Problem(oval()), [first, held], cars=3)[0].missed_goal == 0
    wide = Problem(tube(0.5), inlet=ball(0.1), goal=ball(0.3))
    refused([LEG], "expected one with a margin per metre", wide)


# --- counting


def test_cars_arrive_and_are_counted() -> None:
    summary, rollouts = drive_cars(PROBLEM, [LEG], cars=200)
    assert (summary.cars, summary.left_funnel, summary.left_safe, summary.missed_goal) == (200, 0, 0, 0)
    slow, fast = SEGMENT.duration / 0.5, SEGMENT.duration / 2.0
    assert fast - 1e-9 <= summary.arrival[0] <= summary.arrival[1] <= slow + 1e-9
    assert rollouts.theta.shape[1] == 25
    assert (rollouts.theta[-1] == SEGMENT.duration).all()
    assert (np.diff(rollouts.theta, axis=0) >= 0).all()
    np.testing.assert_allclose(rollouts.value, FUNNEL.value(rollouts.theta, rollouts.x))
    assert rollouts.value.max() <= summary.largest_value + 1e-12


def test_inputs_are_recorded_as_the_law_takes_them() -> None:
    """At every recorded state, the last one too, in which the cars have arrived."""
    _, cars = drive_cars(PROBLEM, [LEG], cars=48)
    numbers, point = law_numbers(PROBLEM, FUNNEL, LEG.margin), SEGMENT.point(0.0)
    for row in (0, len(cars.clock) // 2, -1):
        for car in (0, 7, 23):
            state = (float(cars.theta[row, car]), [float(value) for value in cars.x[row, car]])
            wanted = MinNorm()(PROBLEM.vehicle, FUNNEL.template, numbers, point, *state)
            np.testing.assert_allclose(cars.inputs[row, car], [float(value) for value in wanted], atol=1e-9)
    assert (cars.theta[-1] == LEG.end).all() and np.ptp(cars.inputs[:, 0, 0]) > 0


def test_cars_in_two_shares_go_as_in_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Many cars are driven on two cores: the same cars, the same ends."""
    two, _ = drive_cars(PROBLEM, [LEG], cars=rollout.SHARED)
    monkeypatch.setattr(rollout, "SHARED", rollout.SHARED + 1)
    one, _ = drive_cars(PROBLEM, [LEG], cars=1000)
    assert (two.cars, two.left_funnel, two.missed_goal) == (one.cars, one.left_funnel, one.missed_goal)
    assert two.largest_value == pytest.approx(one.largest_value, abs=1e-12)
    np.testing.assert_allclose(two.arrival, one.arrival, atol=1e-12)


def test_a_long_way_is_recorded_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    _, every = drive_cars(PROBLEM, [LEG], cars=30)
    monkeypatch.setattr(rollout, "MOST_ROWS", 100)
    _, some = drive_cars(PROBLEM, [LEG], cars=30)
    assert some.theta.shape[0] <= 101 < every.theta.shape[0]
    step = np.flatnonzero(np.isclose(every.theta[:, 0], some.theta[1, 0], atol=1e-12))[0]
    np.testing.assert_allclose(some.x[:20], every.x[: 20 * step : step], atol=1e-12)
    np.testing.assert_allclose(some.x[-1], every.x[-1], atol=1e-12)


@pytest.mark.parametrize("path", [circle(), oval()], ids=lambda path: path.name)
def test_tracking_arrives_by_the_clock(path: Path) -> None:
    summary, _ = drive_cars(Problem(path, method=Method.TT), legs_along(path), cars=50)
    np.testing.assert_allclose(summary.arrival, sum(segment.duration for segment in path.curve), atol=1e-9)


def test_failures_are_counted() -> None:
    """Sets that nothing can satisfy: every car is counted as a failure, none is lost."""
    tight = Problem(circle(), safe=Box((0.501, 0.501, 0.501, 0.501)), goal=ball(1e-9))
    summary, _ = drive_cars(tight, [LEG], cars=100)
    assert summary.missed_goal == 100
    assert summary.left_safe > 0
    wide = LEG._replace(funnel=Funnel(Contracting(), 8 * SHAPE, 0.05, SEGMENT.duration))  # I sticks far out of it
    assert drive_cars(PROBLEM, [wide], cars=100)[0].left_funnel > 20


@pytest.mark.parametrize("path", [circle(), oval()], ids=lambda path: path.name)
def test_a_car_that_is_lost_has_failed(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started_at(monkeypatch, (float("nan"), 0.0, 0.0, 0.0), (0.1, 0.0, 0.0, 0.0))
    far = Disc(30.0, 0.0, 1.0)
    summary, _ = drive_cars(Problem(path, obstacles=(far,)), legs_along(path), cars=10)
    assert (summary.left_funnel, summary.left_safe, summary.missed_goal) == (5, 5, 5)
    assert np.isfinite(summary.arrival).all()  # of those that arrived
    started_at(monkeypatch, (float("nan"),) * 4)
    assert drive_cars(Problem(path), legs_along(path), cars=10)[0].arrival is None


def test_cars_that_hit_an_obstacle_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A disc beside a straight line: the nearest body passes it at 0.1 m, or does not."""
    path = straight(4.0, 2.0)  # along +x, which is forward; the deviation's x is to the right
    body = (FootprintDisc(0.2, 0.0),)
    beside = Problem(path, obstacles=(Disc(0.0, -1.0, 0.5),), footprint=body)
    legs = legs_along(path, margin=0.05)
    started_at(monkeypatch, (0.0, 0.0, 0.0, 0.0))
    assert drive_cars(beside, legs, cars=10)[0].left_safe == 0
    started_at(monkeypatch, (0.0, 0.0, 0.0, 0.0), (0.0, 0.45, 0.0, 0.0), (0.0, -0.45, 0.0, 0.0))
    summary, recorded = drive_cars(beside, legs, cars=12)
    assert summary.left_safe == 4
    assert (summary.left_funnel, summary.missed_goal) == (0, 0)
    nearest = recorded.x[np.abs(recorded.theta[:, 1] - 1.0).argmin(), 1, 1]
    assert 0.3 < nearest < 0.45  # at the obstacle it was this far to the right


def test_a_disc_ahead_of_the_axle_is_part_of_the_body(monkeypatch: pytest.MonkeyPatch) -> None:
    """The obstacle lies behind the path's end: only what sticks out in front reaches it."""
    path = straight(4.0, 2.0)
    started_at(monkeypatch, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.3, 0.0))
    behind = Problem(
        path, obstacles=(Disc(3.2, 0.0, 0.5),), footprint=(FootprintDisc(0.2, 0.0), FootprintDisc(0.2, 0.4))
    )
    # at the end the front is 0.1 m from it; a car ahead of the reference by more touches it
    held = [Leg(2.0, Funnel(Contracting(), SHAPE, 0.0, np.inf), 0.001)]
    summary, recorded = drive_cars(behind, held, cars=10)
    assert recorded.x[-1, 1, 2] > 0.11
    assert summary.left_safe == 5
    axle = dataclasses.replace(behind, footprint=(FootprintDisc(0.2, 0.0),))
    assert drive_cars(axle, held, cars=10)[0].left_safe == 0
