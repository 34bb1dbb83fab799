"""The sampled loop: against the continuous one, under disturbance, delay and plants that break."""

import itertools
import math
from dataclasses import replace
from functools import lru_cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.control import locate
from cfjax.errors import InputError
from cfjax.funnel import Funnel, Leg, template_named
from cfjax.plants import Disturbed, Model, Scene, SlipX, sensor_named
from cfjax.problem import Box, Disc, FootprintDisc, KinematicBicycle, Problem, ball, circle
from cfjax.simulation.controller import Controller, Follower
from cfjax.simulation.rollout import drive_cars
from cfjax.simulation.sampled import SampledLoop, drive_sampled
from cfjax.simulation.starts import in_world, least_rates, random_starts, read_starts, worst_starts
from cfjax.simulation.track import Track, track_of


# one number of cars, one class of plant, 16 samples remembered: compiled once for nearly all, test_simulate too
PERIOD, CARS = 0.01, 16
SAFE = Box((1.0, 1.0, 1.0, 3.0))
# of a learned funnel
SHAPE = np.array(
    [
        [1.766, -1.243, 0.7253, 0.4586],
        [-1.243, 3.263, 0.5496, -0.1013],
        [0.7253, 0.5496, 3.294, 1.001],
        [0.4586, -0.1013, 1.001, 1.08],
    ]
)


@lru_cache
def lap(safe: Box | None = None) -> tuple[Problem, list[Leg], Track]:
    """The paper's circle with its funnel; without S, of which few tests speak and which takes long to compile."""
    problem = Problem(circle(), inlet=ball(0.4), safe=safe)
    duration = problem.path.curve[0].duration
    legs = [Leg(duration, Funnel(template_named("contracting"), SHAPE, 0.3005, duration), 2.61)]
    return problem, legs, track_of(problem, legs)


@lru_cache
def begins() -> np.ndarray:
    """Random states of I: the same ones wherever nobody asks for others."""
    problem, _, track = lap()
    return random_starts(problem, track, CARS)


def drive(
    plant=None, starts=None, *, period: float = PERIOD, noise: str = "none", safe=None, controller=None, **options
) -> SampledLoop:
    problem, legs, track = lap(safe)
    starts = begins() if starts is None else starts
    plant = Disturbed(problem.vehicle, np.zeros(4), "constant") if plant is None else plant
    options = {
        "period": period,
        "sensor": sensor_named(noise, problem.vehicle),
        "theta": np.zeros(len(starts)),
    } | options
    controller = Follower(track, period) if controller is None else controller
    return drive_sampled(problem, legs, controller, plant, starts, **options)


def test_short_periods_are_the_continuous_loop() -> None:
    """Same starts, same law: arrival and largest V agree to first order in the period."""
    problem, legs, _track = lap()
    _, rollouts = drive_cars(problem, legs, cars=CARS, seed=0)
    continuous = rollouts.clock[-1]
    apart = []
    for period in (0.04, 0.02, 0.01):
        loop = drive(period=period)
        assert loop.arrived.all() and loop.in_goal.all()
        apart.append(np.abs(loop.time - continuous).max())
    assert apart[-1] < 2e-3
    assert all(1.6 < before / after < 2.4 for before, after in itertools.pairwise(apart)), apart


def test_theta_runs_with_the_law_and_arrives_exactly() -> None:
    loop = drive()
    _, _, track = lap()
    np.testing.assert_allclose(loop.samples.theta[-1], float(track.end), rtol=1e-12)
    assert (np.diff(loop.samples.theta, axis=0) >= 0).all()
    assert np.ptp(loop.time) > 1e-3  # they arrive within periods, not at their ends
    assert (np.abs(loop.time / PERIOD - np.round(loop.time / PERIOD)) > 1e-3).any()


def disturbed(bound, kind, **options) -> SampledLoop:
    return drive(Disturbed(lap()[0].vehicle, bound, kind), **options)


def test_the_adversary_raises_v_more_than_chance() -> None:
    chance, hostile = (disturbed(np.full(4, 0.1), kind).samples.value for kind in ("random", "adversarial"))
    half = min(len(chance), len(hostile)) // 2
    assert (hostile[half] > 1.2 * chance[half]).all()


def test_no_disturbance_within_the_bounds_raises_v_faster_than_the_adversary() -> None:
    vehicle, bound = lap()[0].vehicle, jnp.array([0.3, 0.2, 0.5, 0.4])
    gradient, heading = jnp.array([0.4, -1.0, 0.2, -0.3]), jnp.asarray(0.7)
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[1, 0, 0, 0], [0, c, s, 0], [0, -s, c, 0], [0, 0, 0, 1]])  # into the reference's frame
    state, command, scene = jnp.array([0.1, 1.0, 2.0, 1.5]), jnp.array([0.1, 0.0]), Scene(heading, gradient)

    def pushed(plant) -> float:
        added = plant.rate(state, command, plant.draw(jax.random.key(0), jnp.zeros(())), scene)
        return float(gradient @ (turn @ (added - Model(vehicle).rate(state, command, jnp.zeros(0), scene))))

    assert pushed(Disturbed(vehicle, bound, "adversarial")) == pytest.approx(float(jnp.abs(gradient) @ bound))


def test_disturbance_acts_in_the_deviations_own_rates() -> None:
    """On top of the model's rate, for every deviation: by finite differences of the deviation along a short hold."""
    problem, _, track = lap()
    added, step, theta = jnp.array([0.3, -0.2, 0.5, 0.4]), 1e-6, jnp.asarray(1.3)
    plain, pushed = Model(problem.vehicle), Disturbed(problem.vehicle, added, "constant")
    place, later = track.at(theta), track.at(theta + step)
    scene = Scene(place.pose[0], jnp.zeros(4))
    state = in_world(track, jnp.array([[0.1, 0.2, -0.1, 0.3]]))[0]
    command, key = jnp.array([0.2, 0.5]), jax.random.key(0)
    x = [
        track.deviation(later, state + step * plant.rate(jnp.array(state), command, plant.draw(key, theta), scene))
        for plant in (plain, pushed)
    ]
    np.testing.assert_allclose((x[1] - x[0]) / step, added, atol=1e-5)


def test_random_disturbance_holds_as_long_as_it_says() -> None:
    plant = Disturbed(lap()[0].vehicle, np.ones(4), "random", 0.1)
    key = jax.random.key(1)
    drawn = np.stack([plant.draw(key, jnp.asarray(0.01 * k)) for k in range(40)])
    assert len(np.unique(drawn[:, 0])) == 4
    assert (np.abs(drawn) <= 1).all() and (np.diff(drawn[:10], axis=0) == 0).all()


def test_delay_makes_it_worse_and_seeds_repeat() -> None:
    prompt, late = drive(period=0.04), drive(period=0.04, noise="delay=0.55")  # as many periods to remember as others
    half = len(prompt.samples.value) // 2
    assert late.samples.value[half].mean() > 2 * prompt.samples.value[half].mean()
    noisy = [drive(noise="mocap,delay=0.1,jitter=0.01", seed=seed).time for seed in (3, 3, 4)]
    np.testing.assert_array_equal(noisy[0], noisy[1])
    assert (noisy[0] != noisy[2]).any()


def test_the_samples_show_what_was_measured() -> None:
    loop = drive(noise="delay=0.1")
    samples, back = loop.samples, round(0.1 / PERIOD)
    np.testing.assert_allclose(samples.measured[back:300], samples.state[: 300 - back], atol=1e-9)
    np.testing.assert_allclose(samples.measured[:back], np.broadcast_to(samples.state[:1], samples.state[:back].shape))


class Still(Controller):
    """Holds one command and believes that it goes as planned: what any other controller looks like."""

    command: jax.Array
    period: jax.Array

    def start(self, state, theta):
        return theta

    def act(self, measurement, memory, time):
        return self.command, memory + self.period

    def theta(self, memory):
        return memory


def steered(angle: float, starts=None) -> SampledLoop:
    """The model at a steering angle (rad) that is held, beside S, in adaptive steps."""
    problem, _, track = lap()
    starts = in_world(track, jnp.zeros((CARS, 4))) if starts is None else starts
    controller = Still(jnp.array([angle, 0.0]), jnp.asarray(PERIOD))
    return drive(Model(problem.vehicle), starts, safe=SAFE, tolerance=1e-9, controller=controller)


OWN = float(np.arctan(KinematicBicycle().wheelbase / 1.5))  # the circle's steering angle, rad


def test_leaving_s_ends_a_drive_where_it_happens() -> None:
    """Adaptive steps; without an end to the drive a car is seen outside a little later, within a period."""
    loop = steered(2.0, begins())
    assert loop.left_safe.all() and not loop.arrived.any()
    np.testing.assert_allclose(loop.time, loop.left_safe_at)
    assert (np.abs(loop.time / PERIOD - np.round(loop.time / PERIOD)) > 1e-3).any()
    at = np.abs(loop.samples.deviation[-1] / np.array(SAFE.half_widths)).max(axis=1)
    np.testing.assert_allclose(at, 1.0, atol=1e-7)  # at the instant, not at the end of the period


def test_a_start_outside_s_is_told_and_driven_on() -> None:
    _, _, track = lap()
    deviations = np.zeros((CARS, 4))
    deviations[:, 1] = np.where(np.arange(CARS) == 0, 1.1, 0.1)
    loop = steered(OWN, in_world(track, jnp.array(deviations)))
    np.testing.assert_array_equal(loop.left_safe, np.arange(CARS) == 0)
    assert loop.left_safe_at[0] == 0 and loop.arrived.all()


class Broken(Model):
    """Its rates are no numbers."""

    def rate(self, z, command, draw, scene):
        return jnp.full(4, jnp.nan)


def test_a_plant_that_breaks_ends_the_drive_and_nothing_else() -> None:
    loop = drive(Broken(lap()[0].vehicle))
    assert loop.failed.all() and not loop.arrived.any() and not loop.success.any()
    assert np.isfinite(loop.largest_value).all() and (loop.time == 0).all()


class Breaking(Model):
    """Beyond |y| = 0.6 m its rates are no numbers, or its speed grows to infinity in no time."""

    how: str = eqx.field(static=True, default="nan")

    def rate(self, z, command, draw, scene):
        own = super().rate(z, command, draw, scene)
        bad = jnp.full(4, jnp.nan) if self.how == "nan" else own.at[3].set(50 * z[3] ** 3)
        return jnp.where(jnp.abs(z[2]) > 0.6, bad, own)


@pytest.mark.parametrize(("how", "tolerance"), [("nan", 1e-6), ("explodes", None), ("explodes", 1e-6)])
def test_a_plant_that_breaks_on_the_way_has_failed(how: str, tolerance: float | None) -> None:
    loop = drive(Breaking(lap()[0].vehicle, how), tolerance=tolerance, stop=False)
    assert loop.failed.all() and not loop.success.any() and not loop.arrived.any()
    assert (loop.time < 2.0).all() and np.isfinite(loop.time).all()


def test_laps_go_on_and_cars_before_the_line_have_to_cross_it() -> None:
    problem, legs, track = lap()
    duration = float(track.duration)
    start = in_world(track, jnp.zeros((CARS, 4)))
    two = track_of(problem, legs, 2)
    calm = Disturbed(problem.vehicle, np.zeros(4), "constant")
    loop = drive_sampled(
        problem,
        legs,
        Follower(two, PERIOD),
        calm,
        start,
        period=PERIOD,
        laps=2,
        theta=np.zeros(CARS),
        sensor=sensor_named("none", problem.vehicle),
    )
    assert loop.arrived.all()
    np.testing.assert_allclose(loop.time, 2 * duration, rtol=1e-3)
    back = jax.vmap(track.at)(jnp.array([duration - 0.5]))
    behind = np.array([[*(float(entry[0]) for entry in back.pose), float(back.point.speed[0])]])
    found = drive(starts=np.repeat(behind, CARS, axis=0), theta=None)
    np.testing.assert_allclose(found.theta, -0.5, atol=1e-5)
    np.testing.assert_allclose(found.time, duration + 0.5, rtol=1e-3)


def test_theta_starts_where_v_is_smallest() -> None:
    problem, legs, _ = lap()
    loop = drive(theta=None)
    found = locate(problem, legs, begins())
    np.testing.assert_allclose(loop.start_value, found.value, rtol=1e-9)


def test_any_controller_drives_and_its_saturation_is_counted() -> None:
    loop = steered(OWN)
    assert loop.success.all() and loop.largest_lateral.max() < 1e-6
    np.testing.assert_array_equal(loop.saturation, 0.0)
    loop = steered(2.0)
    np.testing.assert_allclose(loop.saturation, [[1.0, 0.0]] * CARS)
    np.testing.assert_allclose(loop.samples.command[..., 0], np.pi / 4)


def test_numbers_of_plant_sensor_and_controller_compile_nothing(caplog: pytest.LogCaptureFixture) -> None:
    disturbed(np.full(4, 0.01), "random", noise="delay=0.02,heading=0.01")
    with jax.log_compiles(), caplog.at_level("WARNING"):
        disturbed(np.full(4, 0.02), "adversarial", noise="delay=0.015,heading=0.02")
    assert not [record for record in caplog.records if "_chunk" in record.getMessage()]


def test_the_worst_starts_lie_on_the_inlet_and_are_worse_than_chance() -> None:
    _, _, track = lap()
    worst = worst_starts(track, 20)
    direction = jax.random.normal(jax.random.key(5), (2000, 4))

    @eqx.filter_jit
    def looked_at(track: Track, states: jax.Array, direction: jax.Array) -> tuple[jax.Array, jax.Array]:
        """V of the states, and the least rates at them, then at deviations with V = 1 in these directions."""
        place = track.at(jnp.zeros(()))
        x = jax.vmap(lambda state: track.deviation(place, state))(states)
        chance = direction / jnp.sqrt(jax.vmap(lambda x: track.value(place, x))(direction))[:, None]
        return jax.vmap(lambda x: track.value(place, x))(x), least_rates(track, jnp.concatenate([x, chance]))

    value, rates = map(np.asarray, looked_at(track, jnp.array(worst), direction))
    np.testing.assert_allclose(value, 1.0, atol=1e-9)
    worst_rate, chance_rate = rates[:20], rates[20:]
    assert np.median(worst_rate) > chance_rate.max()  # a few end on a lower ridge
    assert worst_rate.min() > np.quantile(chance_rate, 0.99)


def test_cars_that_hit_an_obstacle_have_left_s() -> None:
    """Straight on where the path turns, into a disc: the body's disc touches it before the car's middle does."""
    obstacle = Disc(1.5, 1.5, 0.2)
    problem = replace(lap()[0], obstacles=(obstacle,), footprint=(FootprintDisc(0.25, 0.0),))
    _, legs, track = lap()
    on_path = in_world(track, jnp.zeros((CARS, 4)))
    controller = Still(jnp.array([0.0, 0.0]), jnp.asarray(PERIOD))
    plant = Disturbed(problem.vehicle, np.zeros(4), "constant")
    loop = drive_sampled(problem, legs, controller, plant, on_path, period=PERIOD, theta=np.zeros(CARS))
    assert loop.left_safe.all() and not loop.success.any()
    gap = obstacle.y - obstacle.radius - 0.25  # from where it starts to where the discs touch
    np.testing.assert_allclose(loop.left_safe_at, gap / on_path[0, 3], atol=PERIOD)
    np.testing.assert_array_equal(loop.time, loop.left_safe_at)  # it is driven no further
    assert (loop.clearance < 0).all() and (loop.clearance > -on_path[0, 3] * PERIOD).all()


def test_others_plants_are_stepped() -> None:
    pytest.importorskip("slipx")
    vehicle, track = lap()[0].vehicle, lap()[2]  # of nearly its size
    options = {"period": 0.02, "looks": 2}
    loop = drive(SlipX(vehicle), **options)
    assert loop.arrived.all() and not loop.failed.any()
    np.testing.assert_allclose(loop.time, float(track.end), rtol=0.25)

    class Broken(SlipX):
        def hold(self, own, command, duration):
            if own.pos.x < 1.0:
                raise RuntimeError("the simulator gave up")
            return super().hold(own, command, duration)

    loop = drive(Broken(vehicle), **options)
    assert loop.failed.all() and np.isfinite(loop.largest_value).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"period": 0.0}, "positive number of seconds"),
        ({"period": 1e-9}, "expected at least"),
        ({"looks": 0}, "at least one per period"),
    ],
)
def test_bad_questions_are_refused(options: dict, message: str) -> None:
    problem, legs, track = lap()
    given = {"period": PERIOD} | options
    with pytest.raises(InputError, match=message):
        drive_sampled(problem, legs, Follower(track, PERIOD), Model(problem.vehicle), begins(), **given)
    path = circle(laps=0.5)
    half = Leg(path.curve[0].duration, replace(legs[0].funnel, duration=path.curve[0].duration), 2.61)
    with pytest.raises(InputError, match="laps: expected 1 on the path circle, whose end does not meet"):
        track_of(Problem(path), [half], 2)


def test_starts_from_a_file(tmp_path) -> None:
    problem = lap()[0]
    file = tmp_path / "starts.csv"
    file.write_text("name, v,alpha,x,y\na,1.5,0.1,1.4,0\nb,1,0,1.5,0.2\n")
    np.testing.assert_array_equal(read_starts(problem, file), [[0.1, 1.4, 0, 1.5], [0, 1.5, 0.2, 1]])
    file.write_text(f"yaw,x,y,v\n{math.pi / 2},1.5,0,1\n0,1.4,0,1\n")  # as ROS counts it
    np.testing.assert_allclose(read_starts(problem, file), [[0, 1.5, 0, 1], [-math.pi / 2, 1.4, 0, 1]], atol=1e-15)
    for content, message in (
        ("alpha,x,y\n0,0,0\n", "v is missing"),
        ("heading,x,y,v\n0,0,0,1\n", "expected the columns alpha, x, y, v"),
        ("alpha,x,y,v\n0,0,0,fast\n", "row 2"),
        ("alpha,x,y,v\n0,0,0,inf\n", "row 2"),
        ("alpha,x,y,v\n", "at least one state"),
    ):
        file.write_text(content)
        with pytest.raises(InputError, match=message):
            read_starts(problem, file)
