"""Closed loops: integration order, counting, and what goes wrong on purpose."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.control import min_norm_law
from cfjax.funnel import Contracting, Funnel
from cfjax.problem import Box, Ellipsoid, Method, Problem, ball, circle
from cfjax.simulation import drive_cars
from cfjax.simulation.rollout import _advance, _loop, _start, _steady, sample_starts


PROBLEM = Problem(circle(), safe=Box((1.0, 1.0, 1.0, 3.0)))
SEGMENT = PROBLEM.path.segments[0]
# a quadratic form that the law can bring down (no proof needed here): found by hand from a linear design
SHAPE = np.array([[1.6, -1.2, 0.0, 0.0], [-1.2, 2.6, 0.0, 0.0], [0.0, 0.0, 2.2, 0.3], [0.0, 0.0, 0.3, 1.5]])
FUNNEL = Funnel(Contracting(), SHAPE, 0.05, SEGMENT.duration)


def test_starts_fill_the_inlet() -> None:
    inlet = Ellipsoid((0.5, 0.2, 0.3, 1.0))
    x = np.asarray(sample_starts(jax.random.key(0), inlet, 4000))
    radius = np.sqrt(np.einsum("ki,ij,kj->k", x, inlet.shape, x))
    np.testing.assert_allclose(radius[:2000], 1.0, atol=1e-12)
    assert (radius[2000:] <= 1).all()
    # uniform in the volume: the share inside radius r is r^4
    assert (radius[2000:] < 0.8).mean() == pytest.approx(0.8**4, abs=0.04)


def test_integration_is_of_fourth_order() -> None:
    nothing = jnp.asarray(-1e6)  # is asked for: no kinks in the law
    law = min_norm_law(PROBLEM, FUNNEL, 0.5)._replace(decrease=nothing, decrease_per_metre=nothing)
    loop = _loop(PROBLEM, FUNNEL, law, 0.1)
    start = jnp.array([[0.2, 0.3, -0.2, 0.4]])
    advance = jax.jit(partial(_advance, PROBLEM.vehicle, FUNNEL.template))

    def end(steps: int) -> np.ndarray:
        cars = _start(FUNNEL.template, loop, start)
        for _ in range(steps):
            cars = advance(loop._replace(step=jnp.asarray(0.4 / steps)), _steady(SEGMENT), cars)
        return np.array([cars.theta, *cars.x])

    steps = np.array([5, 10, 20])
    errors = [np.abs(end(int(n)) - end(320)).max() for n in steps]
    slope = np.polyfit(np.log(0.4 / steps), np.log(errors), 1)[0]
    assert 3.5 < slope < 5.0


def test_cars_arrive_and_are_counted() -> None:
    summary, rollouts = drive_cars(PROBLEM, SEGMENT, FUNNEL, 0.3, cars=200)
    assert summary.cars == 200
    slow, fast = SEGMENT.duration / 0.5, SEGMENT.duration / 2.0
    assert fast - 1e-9 <= summary.arrival[0] <= summary.arrival[1] <= slow + 1e-9
    assert rollouts.theta.shape[1] == 25
    assert (rollouts.theta[-1] == SEGMENT.duration).all()
    assert (np.diff(rollouts.theta, axis=0) >= 0).all()
    np.testing.assert_allclose(rollouts.value, FUNNEL.value(rollouts.theta, rollouts.x))
    assert rollouts.value.max() <= summary.largest_value + 1e-12


def test_tracking_arrives_by_the_clock() -> None:
    problem = Problem(circle(), method=Method.TT)
    summary, _ = drive_cars(problem, SEGMENT, FUNNEL, 0.3, cars=50)
    np.testing.assert_allclose(summary.arrival, SEGMENT.duration, atol=1e-9)


def test_failures_are_counted() -> None:
    """Sets that nothing can satisfy: every car is counted as a failure, none is lost."""
    tight = Problem(circle(), safe=Box((0.501, 0.501, 0.501, 0.501)), goal=ball(1e-9))
    summary, _ = drive_cars(tight, SEGMENT, FUNNEL, 0.3, cars=100)
    assert summary.missed_goal == 100
    assert summary.left_safe > 0
    wide = Funnel(Contracting(), 8 * SHAPE, 0.05, SEGMENT.duration)  # I sticks far out of this funnel
    assert drive_cars(PROBLEM, SEGMENT, wide, 0.3, cars=100)[0].left_funnel > 20
