"""Cars on random paths: none leaves a tube that contracts, and where something is wrong they do."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.control import MinNorm, law_numbers, path_point
from cfjax.errors import InputError
from cfjax.funnel import TEMPLATES, Funnel
from cfjax.problem import Box, Interval, Problem, ball, circle, tube
from cfjax.simulation import drive_tube_cars
from cfjax.simulation.loop import advance, loop_of, start
from cfjax.simulation.tube import TubeBounds, _starts, drive_tube, going_on, step_length


PROBLEM = Problem(
    tube(1.8, Interval(1.0, 4.0), 1.0), inlet=ball(0.15), goal=ball(0.25), safe=Box((0.3, 0.25, 0.2, 0.2))
)
TUBE = PROBLEM.path.segments[0]
# from `learn(PROBLEM, TUBE, TEMPLATES["contracting"])`, rounded; `falsify` finds 0.957 for both margins down to V = 0.1
SHAPE = np.array([[23.48, -12.51, 0, 0], [-12.51, 36.95, 0, 0], [0, 0, 31.36, 11.3], [0, 0, 11.3, 31.87]])
FUNNEL = Funnel(TEMPLATES["contracting"], SHAPE, 0.0, np.inf, 0.9, 0.1)
MARGIN, PER_METRE = 0.95, 0.95  # 1/s, 1/m


def test_starts_are_on_the_tube_on_the_inlet_and_inside() -> None:
    x = np.asarray(_starts(jax.random.key(0), PROBLEM, FUNNEL, 900))
    value, radius = FUNNEL.form(x), np.linalg.norm(x, axis=1) / 0.15
    assert (value < 1).all()
    assert (value > 1 - 1e-9).sum() == 300
    assert 290 <= (np.abs(radius - 1) < 1e-9).sum() <= 310
    assert (radius < 1 - 1e-9).sum() > 250


@pytest.fixture(scope="module")
def driven():
    return drive_tube_cars(PROBLEM, FUNNEL, MARGIN, PER_METRE, cars=1200, seed=3, way=3.0)


def test_no_car_leaves_a_tube_that_contracts(driven) -> None:
    summary, rollouts = driven
    assert (summary.cars, summary.left_funnel, summary.left_safe, summary.missed_goal) == (1200, 0, 0, 0)
    assert 1 - 1e-9 < summary.largest_value <= 1 + 1e-9
    assert summary.arrival is None
    np.testing.assert_allclose(rollouts.value, FUNNEL.value(rollouts.theta, rollouts.x))
    # u0 in its interval: θ goes on at half to twice the clock's rate
    pace = np.diff(rollouts.theta, axis=0) / np.diff(rollouts.clock, axis=0)
    assert (pace > 0.5 - 1e-9).all() and (pace < 2 + 1e-9).all()


def test_cars_come_down_as_fast_as_the_law_says(driven) -> None:
    """dV/dt ≤ −0.95 λ min(1, V/β̲) at the least, so that every V follows a known curve by the clock."""
    _, rollouts = driven
    rate, beta, inner = 0.95 * MARGIN, FUNNEL.beta_lower, FUNNEL.inner
    linear = (1 - beta) / rate
    clock = rollouts.clock
    bound = np.where(clock < linear, 1 - rate * clock, beta * np.exp(-rate * (clock - linear) / beta))
    assert (rollouts.value <= np.maximum(bound, inner) + 1e-3).all()


def test_recorded_references_are_paths_within_bounds(driven) -> None:
    """From the poses alone: speed and curvature of the way that they describe."""
    _, rollouts = driven
    assert rollouts.reference is not None and rollouts.reference.shape == (*rollouts.theta.shape, 3)
    alpha, *position = np.moveaxis(rollouts.reference, -1, 0)
    way = np.hypot(*(np.diff(p, axis=0) for p in position))
    speed = way / np.diff(rollouts.theta, axis=0)
    curvature = np.diff(alpha, axis=0) / way
    assert 1 - 1e-4 < speed.min() < 1.2 and 3.8 < speed.max() < 4 + 1e-9
    acceleration = np.diff(speed, axis=0) / np.diff(rollouts.theta, axis=0)[1:]
    # between the middles of two steps of unlike length: the limit of 1 m/s² holds to the ratio of the lengths
    assert 0.9 < np.abs(acceleration).max() < 2.5
    assert 1.79 < np.abs(curvature).max() < 1.8 * (1 + 1e-4)
    jumps = np.abs(np.diff(curvature, axis=0))
    assert (jumps.max(axis=0) > 3.5).any() and (jumps.max(axis=0) < 0.5).any()  # bang-bang and smooth
    heading = -np.sin(alpha[:-1]) * np.diff(position[0], axis=0) + np.cos(alpha[:-1]) * np.diff(position[1], axis=0)
    assert (heading > 0.999 * way).all()


def test_steps_are_fine_enough() -> None:
    """The curvature jumps at every step; the same paths in steps sixteen times as fine give nearly the same V."""
    length, count, steps = step_length(PROBLEM, TUBE, FUNNEL), 300, 40
    rng = np.random.default_rng(0)
    kappas = rng.choice([TUBE.curvature.lower, TUBE.curvature.upper], size=(steps, count))
    speed = rng.choice([TUBE.speed.lower, TUBE.speed.upper], size=count)
    law = law_numbers(PROBLEM, FUNNEL, MARGIN, PER_METRE, TUBE.curvature)
    starts = _starts(jax.random.key(1), PROBLEM, FUNNEL, count)
    first = start(FUNNEL.template, loop_of(PROBLEM, law, 0.0), starts)

    @partial(jax.jit, static_argnames="pieces")
    def values(pieces: int):
        loop = loop_of(PROBLEM, law, 0.0)._replace(step=jnp.asarray(length / pieces / speed))

        def step(cars, kappa):
            point = path_point(kappa, speed)

            def forward(_, now):
                reference = going_on(point, point, now.theta)
                return advance(PROBLEM.vehicle, FUNNEL.template, MinNorm(), loop, reference, now)[0]

            cars = jax.lax.fori_loop(0, pieces, forward, cars)
            return cars, jnp.stack(cars.x, axis=-1)

        return jax.lax.scan(step, first, jnp.asarray(kappas))[1]

    coarse, fine = (FUNNEL.form(np.asarray(values(pieces))) for pieces in (1, 16))
    assert (np.abs(coarse - fine) / (1 - fine)).max() < 0.01
    assert np.median(np.abs(coarse - fine)) < 1e-6


@pytest.mark.slow
def test_sharper_turns_than_the_tube_allows_throw_cars_out() -> None:
    wild = dataclasses.replace(TUBE, curvature=Interval(-3.6, 3.6))  # the car's own is 1/0.34 m = 2.94 1/m
    law = law_numbers(PROBLEM, FUNNEL, MARGIN, PER_METRE, TUBE.curvature)
    intervals = wild.curvature, wild.speed, wild.acceleration
    bounds = TubeBounds(*((jnp.asarray(interval.lower), jnp.asarray(interval.upper)) for interval in intervals))
    starts = _starts(jax.random.key(1), PROBLEM, FUNNEL, 300)
    loop = loop_of(PROBLEM, law, step_length(PROBLEM, TUBE, FUNNEL))
    goal = jnp.array(PROBLEM.goal.half_axes)
    cars, _, _ = drive_tube(
        PROBLEM.vehicle, FUNNEL.template, loop, bounds, goal, starts, jax.random.key(2), steps=1000, stride=300
    )
    assert (np.asarray(cars.largest_value) > 1.01).sum() > 10


def test_a_tube_that_is_none_loses_cars() -> None:
    """A form that no law brings down: heading and lateral deviation are coupled with the wrong sign."""
    wrong = dataclasses.replace(FUNNEL, shape=SHAPE * (1 - 2 * (np.add.outer(np.arange(4), np.arange(4)) == 1)))
    summary, _ = drive_tube_cars(PROBLEM, wrong, MARGIN, PER_METRE, cars=300, way=1.0)
    assert summary.left_funnel > 30


def test_sets_that_are_left_are_counted() -> None:
    inflated = dataclasses.replace(FUNNEL, shape=4 * SHAPE)
    assert drive_tube_cars(PROBLEM, inflated, MARGIN, PER_METRE, cars=300, way=0.1)[0].left_funnel > 80  # I is larger
    wide = dataclasses.replace(FUNNEL, shape=SHAPE / 4)
    summary, _ = drive_tube_cars(PROBLEM, wide, MARGIN, PER_METRE, cars=300, way=0.1)
    assert summary.left_safe > 60 and summary.missed_goal > 60  # those that start on its boundary


def test_the_same_seed_drives_the_same_cars() -> None:
    first, second, other = (
        drive_tube_cars(PROBLEM, FUNNEL, MARGIN, PER_METRE, cars=50, seed=seed, way=0.2)[1] for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.x, second.x)
    assert np.abs(first.x - other.x).max() > 0.01


def test_what_cannot_be_driven_is_refused() -> None:
    with pytest.raises(InputError, match="expected a tube"):
        drive_tube_cars(Problem(circle()), FUNNEL, MARGIN, PER_METRE, cars=10)
    ever_faster = Problem(tube(1.0, Interval(1.0, 2.0), Interval(0.1, 1.0)), inlet=ball(0.15), goal=ball(0.25))
    with pytest.raises(InputError, match="around zero"):
        drive_tube_cars(ever_faster, FUNNEL, MARGIN, PER_METRE, cars=10)
