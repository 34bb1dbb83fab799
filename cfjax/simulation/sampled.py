"""The sampled loop: a controller that measures every h seconds and holds its command, a plant, a sensor between them.

The plant is integrated up to the instant at which θ reaches the end, and no further. A car is looked at when a command
ends, and `looks` − 1 times in between. A car whose state is not finite has failed and is driven no further; it stops no
other.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import ArrayLike

from cfjax.control import locate
from cfjax.errors import InputError
from cfjax.funnel import Leg
from cfjax.plants import HostPlant, Plant, Sensor, perfect
from cfjax.problem import Problem
from cfjax.simulation.clearance import surroundings
from cfjax.simulation.controller import Controller
from cfjax.simulation.loop import RECORDED
from cfjax.simulation.sampled_car import CarState, ControlSample, World, deviation_at, put
from cfjax.simulation.sampled_plant import Integrator, integrate, step_others
from cfjax.simulation.track import Track, track_of


MOST_PERIODS = 200_000  # of a drive: what is recorded has to fit into memory
SLACK = 1.05  # of the time that the slowest timing takes: for controllers that time themselves


@dataclass(frozen=True)
class Samples:
    """Recorded cars at control instants; axes (time, car[, entry]). A car that is done stays as it is."""

    clock: Float[np.ndarray, "t k"]  # s
    theta: Float[np.ndarray, "t k"]  # s, along the whole path, over all laps
    state: Float[np.ndarray, "t k n"]
    measured: Float[np.ndarray, "t k n"]
    deviation: Float[np.ndarray, "t k n"]
    value: Float[np.ndarray, "t k"]
    command: Float[np.ndarray, "t k m"]
    cars: Int[np.ndarray, " k"]  # their numbers


@dataclass(frozen=True)
class SampledLoop:
    """What became of k cars; times in s, lengths in m."""

    starts: Float[np.ndarray, "k n"]  # states in the world frame
    theta: Float[np.ndarray, " k"]  # where they started
    start_value: Float[np.ndarray, " k"]  # V there
    arrived: Bool[np.ndarray, " k"]  # θ reached the end
    in_goal: Bool[np.ndarray, " k"]  # and the car was inside G then
    time: Float[np.ndarray, " k"]  # of the arrival, or of whatever ended the drive
    largest_value: Float[np.ndarray, " k"]
    left_funnel: Bool[np.ndarray, " k"]  # V > 1 after it was at most 1
    left_safe: Bool[np.ndarray, " k"]  # out of S's box, or into an obstacle
    left_safe_at: Float[np.ndarray, " k"]  # infinite where it did not
    failed: Bool[np.ndarray, " k"]  # a state that is not finite
    largest_lateral: Float[np.ndarray, " k"]  # |x_R|: across the reference
    rms_lateral: Float[np.ndarray, " k"]
    saturation: Float[np.ndarray, "k m"]  # share of the time, for each entry of the command
    clearance: Float[np.ndarray, " k"]  # least distance between body and obstacles; infinite where there are none
    samples: Samples

    @property
    def success(self) -> Bool[np.ndarray, " k"]:
        """Arrived, in G, without leaving S; what happened to V is not asked."""
        return self.arrived & self.in_goal & ~self.left_safe & ~self.failed


def drive_sampled(
    problem: Problem,
    legs: Sequence[Leg],
    controller: Controller,
    plant: Plant | HostPlant,
    states: ArrayLike,
    *,
    period: float,
    sensor: Sensor | None = None,
    theta: ArrayLike | None = None,
    laps: int = 1,
    seed: int = 0,
    limit: float | None = None,
    stop: bool = True,
    looks: int = 1,
    tolerance: float | None = None,
    recorded: int = RECORDED,
) -> SampledLoop:
    """Drive cars from states (α, x, y, ξ…; world frame, rad and m) to the end of the path, all at once.

    Args:
        legs: the funnels in which the cars are measured, `Result.legs`.
        controller: of one car, for the same `period` (s).
        sensor: the true state where none is given.
        theta: where along the path each starts (s); None: where V is smallest, as `cfjax.control.locate` finds it, and
            on a path that closes no more than half a lap before or after its start.
        laps: of a path that closes.
        seed: of noise and disturbance; each car has its own.
        limit: s, after which a car that has not arrived is given up; None: as long as the slowest timing takes.
        stop: whether leaving S ends a car's drive, where it began inside.
        looks: at V, S and obstacles per period.
        tolerance: relative and absolute, of adaptive steps; None: constant steps, no longer than the plant's longest.
        recorded: cars of which samples are kept.

    Raises:
        InputError: for a path that is none, states of another shape or that are not finite, a period that is not
            positive.
    """
    if not 0 < period < math.inf:
        raise InputError(f"period: expected a positive number of seconds, got {period:g}")
    if looks < 1:
        raise InputError(f"looks: expected at least one per period, got {looks}")
    track = track_of(problem, legs, laps)
    states = np.asarray(states, float)
    found = locate(problem, legs, states).theta  # which looks at their shape too
    if problem.path.closed:  # within half a lap before the line a car has yet to cross it
        found = np.where(found > 0.5 * float(track.duration), found - float(track.duration), found)
    count = len(states)
    begins = np.broadcast_to(found if theta is None else np.asarray(theta, float), (count,))
    slowest = float(track.end) - float(begins.min())
    limit = SLACK * max(slowest, 0.0) / problem.inputs[0].lower + 2 * period if limit is None else limit
    if not limit <= MOST_PERIODS * period:
        raise InputError(
            f"period: expected at least {limit / MOST_PERIODS:.3g} s for a drive of {limit:.4g} s, got {period:g}"
        )
    sensor = perfect(problem.dimension) if sensor is None else sensor
    lower, upper = command_limits(problem)
    world = World(
        track=track,
        controller=controller,
        sensor=sensor,
        period=jnp.asarray(period, float),
        lower=jnp.asarray(lower),
        upper=jnp.asarray(upper),
        around=surroundings(problem.obstacles, problem.footprint) if problem.obstacles else None,
        limit=jnp.asarray(limit, float),
        stops=stop,
        boxed=problem.safe is not None,
        looks=looks,
    )
    keys = jax.vmap(partial(jax.random.fold_in, jax.random.key(seed)))(jnp.arange(count))
    remembered = sensor.remembered(period)
    starts, origin = jnp.asarray(states), jnp.asarray(begins)
    cars = put(world, starts, origin, remembered)
    start_value = np.asarray(cars.largest_value)
    shown = np.unique(np.linspace(0, count - 1, min(recorded, count)).astype(int))
    if isinstance(plant, HostPlant):
        cars, history = step_others(world, plant, cars, keys, states, shown)
    else:
        # from one period to the next, and one diffrax solve for each look
        step = period / looks / max(1, math.ceil(period / looks / plant.longest_step - 1e-9))
        by = Integrator(plant, jnp.asarray(step), None if tolerance is None else jnp.asarray(tolerance, float))
        cars, history = integrate(world, by, cars, keys, starts, shown)
    return _summary(world, states, np.array(begins), start_value, cars, history, shown)


def command_limits(problem: Problem) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Ends of the physical command, rad and m/s² for a bicycle: its actuators clip there whatever they are told."""
    box = problem.inputs[1:]
    ends = [
        np.array([float(entry) for entry in problem.vehicle.command(corner)])
        for corner in (tuple(side.lower for side in box), tuple(side.upper for side in box))
    ]
    return np.minimum(*ends), np.maximum(*ends)


@eqx.filter_jit
def _final(track: Track, theta: Array, states: Array) -> tuple[Array, Array]:
    return jax.vmap(partial(deviation_at, track))(theta, states)


def _summary(
    world: World,
    states: Float[np.ndarray, "k n"],
    begins: Float[np.ndarray, " k"],
    start_value: Float[np.ndarray, " k"],
    cars: CarState,
    history: list[ControlSample],
    shown: Int[np.ndarray, " r"],
) -> SampledLoop:
    end, theta = np.asarray(cars.clock), np.asarray(cars.theta)
    deviation, value = map(np.asarray, _final(world.track, cars.theta, cars.state))
    finite = np.asarray(cars.finite)
    left = np.asarray(cars.left_safe_at)
    ended = world.stops & (left > 0) & np.isfinite(left)
    arrived = finite & (theta >= float(world.track.end) * (1 - 1e-9)) & ~ended
    state = np.asarray(cars.state)
    last = ControlSample(end, theta, state, state, deviation, value, np.zeros(cars.saturated.shape))
    every = jax.tree.map(
        lambda *parts: np.concatenate(parts), *history, jax.tree.map(lambda now: now[shown][None], last)
    )
    every.command[-1] = every.command[max(len(every.command) - 2, 0)]
    # a chunk goes on after the last car is done
    used = 1 + int(np.argmax((every.clock >= every.clock[-1:]).all(axis=1)))
    kept = ControlSample(*(values[:used] for values in every))
    time = np.where(end > 0, end, 1.0)
    with np.errstate(over="ignore"):  # a car that fails may have been very far away
        in_goal = arrived & (((deviation / np.asarray(world.track.goal)) ** 2).sum(axis=1) < 1)
    return SampledLoop(
        starts=states,
        theta=begins,
        start_value=start_value,
        arrived=arrived,
        in_goal=in_goal,
        time=end,
        largest_value=np.asarray(cars.largest_value),
        left_funnel=np.asarray(cars.left_funnel),
        left_safe=np.isfinite(left),
        left_safe_at=left,
        failed=~finite,
        largest_lateral=np.asarray(cars.largest_lateral),
        rms_lateral=np.sqrt(np.asarray(cars.squared_lateral) / time),
        saturation=np.minimum(np.asarray(cars.saturated) / time[:, None], 1.0),  # an event may cut a hold short
        clearance=np.asarray(cars.clearance),
        samples=Samples(**kept._asdict(), cars=shown),
    )
