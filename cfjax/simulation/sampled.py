"""The sampled loop: a controller that measures every h seconds and holds its command, a plant, a sensor between them.

V is taken at the true state, whatever the controller believes. While a command is held θ runs evenly, so that the
instant at which it reaches the end is known, and the plant is integrated up to there and no further. Differential
equations are integrated by diffrax, Tsitouras' fifth order, with constant steps or, with a `tolerance`, adaptive ones;
leaving S is an event there. Simulators of other people are stepped.

A car is looked at when a command ends, and `looks` − 1 times in between. A car whose state is not finite has failed and
is driven no further; it stops no other.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray
from numpy.typing import ArrayLike

from cfjax.control import locate
from cfjax.errors import InputError
from cfjax.funnel import Leg
from cfjax.plants import HostPlant, Plant, Scene, Sensor, perfect
from cfjax.problem import Problem
from cfjax.simulation.clearance import ObstacleArrays, clearance, surroundings
from cfjax.simulation.controller import Controller
from cfjax.simulation.loop import RECORDED, ROUNDING
from cfjax.simulation.track import Track, track_of


CHUNK = 128  # control periods between two looks at whether anybody is still driving
MOST_PERIODS = 200_000  # of a drive: what is recorded has to fit into memory
AT_LIMIT = 1e-6  # of a command's range: closer to its end it is saturated
SLACK = 1.05  # of the time that the slowest timing takes: for controllers that time themselves
ARRIVED = 1e-12  # relative: rounding
MOST_SOLVER_STEPS = 10_000  # per hold
EVENT = 1e-10  # s, relative and absolute: of the instant at which a car leaves S


class CarState(NamedTuple):
    """One car on its way; the loop holds arrays of k of everything."""

    memory: Any  # the controller's
    sensor: Any
    state: Float[Array, " n"]  # as it is
    clock: Float[Array, ""]  # s
    theta: Float[Array, ""]  # s
    active: Bool[Array, ""]
    finite: Bool[Array, ""]
    left_safe_at: Float[Array, ""]  # s; infinite where it has not
    been_inside: Bool[Array, ""]
    left_funnel: Bool[Array, ""]
    largest_value: Float[Array, ""]
    largest_lateral: Float[Array, ""]  # |x_R|, m
    squared_lateral: Float[Array, ""]  # ∫ x_R² dt, m² s
    saturated: Float[Array, " m"]  # s, for each entry of the command
    clearance: Float[Array, ""]  # m, the least so far


class Held(NamedTuple):
    """A command, and how θ runs while it is held; one car's."""

    command: Float[Array, " m"]
    measured: Float[Array, " n"]
    begin: Float[Array, ""]  # θ, s
    pace: Float[Array, ""]  # dθ/dt
    duration: Float[Array, ""]  # s: h, or less where the car arrives


class ControlSample(NamedTuple):
    """Arrays: of one car at a control instant, with the command that it then holds."""

    clock: Any
    theta: Any
    state: Any
    measured: Any
    deviation: Any
    value: Any
    command: Any


class World(eqx.Module):
    """All that the cars have in common."""

    track: Track
    controller: Controller
    sensor: Sensor
    period: Float[Array, ""]
    lower: Float[Array, " m"]  # of the command
    upper: Float[Array, " m"]
    around: ObstacleArrays | None
    limit: Float[Array, ""]  # s
    stops: bool = eqx.field(static=True)  # where it leaves S
    boxed: bool = eqx.field(static=True)
    looks: int = eqx.field(static=True)


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
    cars = _put(world, starts, origin, remembered)
    start_value = np.asarray(cars.largest_value)
    shown = np.unique(np.linspace(0, count - 1, min(recorded, count)).astype(int))
    if isinstance(plant, HostPlant):
        cars, history = _step_others(world, plant, cars, keys, states, shown)
    else:
        # from one period to the next, and one diffrax solve for each look
        step = period / looks / max(1, math.ceil(period / looks / plant.longest_step - 1e-9))
        cars, history = _integrate(world, plant, cars, keys, starts, shown, step, tolerance)
    return _summary(world, states, np.array(begins), start_value, cars, history, shown)


def command_limits(problem: Problem) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Ends of the physical command, rad and m/s² for a bicycle: its actuators clip there whatever they are told."""
    box = problem.inputs[1:]
    ends = [
        np.array([float(entry) for entry in problem.vehicle.command(corner)])
        for corner in (tuple(side.lower for side in box), tuple(side.upper for side in box))
    ]
    return np.minimum(*ends), np.maximum(*ends)


# --- one car, one instant


def _look(world: World, car: CarState, duration: Array) -> CarState:
    """Where the car is now, `duration` s after it was last looked at."""
    track = world.track
    place = track.at(car.theta)
    x = track.deviation(place, car.state)
    value = track.value(place, x)
    apart = car.clearance
    if world.around is not None:
        pose = tuple(entry[None] for entry in place.pose)
        apart = jnp.minimum(apart, clearance(world.around, pose, tuple(x[:, None]))[0])
    outside = (_safe_share(track, x) > 1 + ROUNDING) | (apart < -ROUNDING)
    return car._replace(
        left_safe_at=jnp.where(outside, jnp.minimum(car.left_safe_at, car.clock), car.left_safe_at),
        been_inside=car.been_inside | (value <= 1),
        left_funnel=car.left_funnel | (car.been_inside & ~(value <= 1 + ROUNDING)),
        largest_value=jnp.maximum(car.largest_value, value),
        largest_lateral=jnp.maximum(car.largest_lateral, jnp.abs(x[1])),
        squared_lateral=car.squared_lateral + duration * x[1] ** 2,
        clearance=apart,
    )


def _safe_share(track: Track, x: Array) -> Array:
    return jnp.max(jnp.abs(x) / track.safe)


@eqx.filter_jit
def _put(world: World, states: Array, theta: Array, remembered: int) -> CarState:
    """The cars at their starts."""

    def one(state: Array, begin: Array) -> CarState:
        zero, no = jnp.zeros(()), jnp.zeros((), bool)
        car = CarState(
            memory=world.controller.start(state, begin),
            sensor=world.sensor.start(state, remembered),
            state=state,
            clock=zero,
            theta=begin,
            active=begin < world.track.end,
            finite=~no,
            left_safe_at=jnp.asarray(jnp.inf),
            been_inside=no,
            left_funnel=no,
            largest_value=jnp.asarray(-jnp.inf),
            largest_lateral=zero,
            squared_lateral=zero,
            saturated=jnp.zeros(world.lower.shape),
            clearance=jnp.asarray(jnp.inf),
        )
        return _look(world, car, zero)

    return jax.vmap(one)(states, theta)


def _decide(world: World, car: CarState, key: PRNGKeyArray) -> tuple[CarState, Held]:
    """Measure, act, and see how long the command is held."""
    seen, sensor = world.sensor.measure(key, car.state, car.sensor, car.clock, world.period)
    begin = world.controller.theta(car.memory)
    commanded, memory = world.controller.act(seen, car.memory, car.clock)
    command = jnp.clip(commanded, world.lower, world.upper)
    pace = (world.controller.theta(memory) - begin) / world.period
    left = (world.track.end - begin) / jnp.where(pace > 0, pace, 1.0)
    duration = jnp.where(pace > 0, jnp.clip(left, 0.0, world.period), world.period)
    duration = jnp.where(car.active, duration, 0.0)
    room = AT_LIMIT * (world.upper - world.lower)
    at_limit = (command <= world.lower + room) | (command >= world.upper - room)
    after = car._replace(memory=memory, sensor=sensor, saturated=car.saturated + at_limit * duration)
    return _chosen(car.active, after, car), Held(command, seen.state, begin, pace, duration)


def _moved(world: World, car: CarState, held: Held, state: Array, since: Array, spent: Array, left: Array) -> CarState:
    """The car after `spent` s that began `since` s into the hold; `left`: it was stopped where it left S."""
    finite = jnp.all(jnp.isfinite(state)) & jnp.all(jnp.isfinite(held.command)) & jnp.isfinite(held.pace)
    spent = jnp.where(finite, spent, 0.0)
    theta = jnp.where(finite, held.begin + held.pace * (since + spent), car.theta)
    moved = car._replace(state=jnp.where(finite, state, car.state), clock=car.clock + spent, theta=theta)
    moved = _look(world, moved._replace(finite=car.finite & finite), spent)
    moved = moved._replace(
        left_safe_at=jnp.where(left, jnp.minimum(moved.left_safe_at, moved.clock), moved.left_safe_at)
    )
    ended = (moved.left_safe_at > 0) & (moved.left_safe_at < jnp.inf)
    moved = moved._replace(active=moved.finite & ~(world.stops & ended))
    return _chosen(car.active, moved, car)


def _finish(world: World, car: CarState) -> CarState:
    """Whether it goes on after this hold; its end was cut to where θ arrives, but for rounding."""
    arrived = car.theta >= world.track.end * (1 - ARRIVED)
    return car._replace(active=car.active & ~arrived & (car.clock < world.limit * (1 - ARRIVED)))


def _chosen(which: Array, one: Any, other: Any) -> Any:
    return jax.tree.map(partial(jnp.where, which), one, other)


def _recorded(world: World, car: CarState, held: Held) -> ControlSample:
    x, value = _deviation(world.track, car.theta, car.state)
    return ControlSample(car.clock, car.theta, car.state, held.measured, x, value, held.command)


def _deviation(track: Track, theta: Array, state: Array) -> tuple[Array, Array]:
    """The deviation, and V."""
    place = track.at(theta)
    x = track.deviation(place, state)
    return x, track.value(place, x)


# --- differential equations


def _hold(
    world: World,
    plant: Plant,
    z: Array,
    car: CarState,
    held: Held,
    draw: Array,
    span: tuple[Array, Array],
    step: Array,
    tolerance: Array | None,
) -> tuple[Array, Array, Array]:
    """The plant's state after a part of a hold, from `span[0]` to `span[1]` s of it; NaN where there is none.

    With the time that this took, and whether it ended because the car left S.
    """

    def scene(time: Array, z: Array) -> tuple[Array, Scene]:
        place = world.track.at(held.begin + held.pace * time)
        x = world.track.deviation(place, plant.observe(z))
        return x, Scene(place.pose[0], world.track.gradient(place, x))

    def true_rate(time: Any, z: Array) -> Array:
        return plant.rate(z, held.command, draw, scene(time, z)[1])

    def rate(time: Any, z: Array, _: None) -> Array:
        # around a rate that is no number adaptive steps would shrink for ever: the plant stays, and is found there
        slope = true_rate(time, z)
        return jnp.where(jnp.all(jnp.isfinite(slope)), slope, 0.0)

    def outside(t: Any, y: Array, args: None, **_: Any) -> Array:
        # a car that began outside is not stopped
        return jnp.where(car.left_safe_at > 0, _safe_share(world.track, scene(t, y)[0]) - 1, -1.0)

    found = diffrax.diffeqsolve(
        diffrax.ODETerm(rate),
        diffrax.Tsit5(),
        *span,
        dt0=jnp.minimum(step, jnp.maximum(span[1] - span[0], 1e-12)),
        y0=z,
        saveat=diffrax.SaveAt(t1=True),
        stepsize_controller=diffrax.ConstantStepSize()
        if tolerance is None
        else diffrax.PIDController(rtol=tolerance, atol=tolerance),
        event=diffrax.Event(outside, optimistix.Newton(EVENT, EVENT), direction=True)
        if world.boxed and world.stops
        else None,
        max_steps=MOST_SOLVER_STEPS,
        adjoint=diffrax.ForwardMode(),
        throw=False,  # what became of a car is seen from its state
    )
    assert found.ys is not None and found.ts is not None
    after, until, left = found.ys[-1], found.ts[-1], diffrax.is_event(found.result)
    solved = (diffrax.is_successful(found.result) | left) & jnp.all(jnp.isfinite(true_rate(until, after)))
    return jnp.where(solved, after, jnp.nan), until - span[0], left & solved


@eqx.filter_jit
def _chunk(
    world: World,
    plant: Plant,
    cars: CarState,
    z: Array,
    keys: Array,
    first: Array,
    shown: Array,
    step: Array,
    tolerance: Array | None,
) -> tuple[CarState, Array, ControlSample]:
    """CHUNK control periods of all cars, from the period `first` on."""

    def period(carry: tuple[CarState, Array], number: Array) -> tuple[tuple[CarState, Array], ControlSample]:
        def one(car: CarState, z: Array, key: PRNGKeyArray) -> tuple[CarState, Array, ControlSample]:
            key_plant, key_sensor = jax.random.split(key)
            car, held = _decide(world, car, jax.random.fold_in(key_sensor, number))
            record = _recorded(world, car, held)
            draw = plant.draw(key_plant, car.clock)
            for look in range(world.looks):
                since = held.duration * (look / world.looks)
                span = since, jnp.where(car.active, held.duration * ((look + 1) / world.looks), since)
                after, spent, left = _hold(world, plant, z, car, held, draw, span, step, tolerance)
                moved = _moved(world, car, held, plant.observe(after), since, spent, left)
                car, z = moved, jnp.where(moved.active, after, z)
            return _finish(world, car), z, record

        cars, z, record = jax.vmap(one)(*carry, keys)
        return (cars, z), jax.tree.map(lambda now: now[shown], record)

    (cars, z), history = jax.lax.scan(period, (cars, z), first + jnp.arange(CHUNK))
    return cars, z, history


def _integrate(
    world: World,
    plant: Plant,
    cars: CarState,
    keys: Array,
    states: Array,
    shown: Int[np.ndarray, " r"],
    step: float,
    tolerance: float | None,
) -> tuple[CarState, list[ControlSample]]:
    z = jax.vmap(plant.start)(states)
    numbers = jnp.asarray(step, float), None if tolerance is None else jnp.asarray(tolerance, float)
    history: list[ControlSample] = []
    while bool(jnp.any(cars.active)):
        first = jnp.asarray(CHUNK * len(history))
        cars, z, record = _chunk(world, plant, cars, z, keys, first, jnp.asarray(shown), *numbers)
        history.append(jax.tree.map(np.asarray, record))
    return cars, history


# --- simulators of other people


@eqx.filter_jit
def _decide_all(world: World, cars: CarState, keys: Array, number: Array) -> tuple[CarState, Held, ControlSample]:
    def one(car: CarState, key: PRNGKeyArray) -> tuple[CarState, Held, ControlSample]:
        _, key_sensor = jax.random.split(key)
        car, held = _decide(world, car, jax.random.fold_in(key_sensor, number))
        return car, held, _recorded(world, car, held)

    return jax.vmap(one)(cars, keys)


@eqx.filter_jit
def _moved_all(world: World, cars: CarState, held: Held, states: Array, look: Array) -> CarState:
    def one(car: CarState, held: Held, state: Array) -> CarState:
        part = held.duration / world.looks
        return _moved(world, car, held, state, look * part, part, jnp.zeros((), bool))

    return jax.vmap(one)(cars, held, states)


@eqx.filter_jit
def _finish_all(world: World, cars: CarState) -> CarState:
    return jax.vmap(partial(_finish, world))(cars)


@eqx.filter_jit
def _final(track: Track, theta: Array, states: Array) -> tuple[Array, Array]:
    return jax.vmap(partial(_deviation, track))(theta, states)


def _step_others(
    world: World,
    plant: HostPlant,
    cars: CarState,
    keys: Array,
    states: Float[np.ndarray, "k n"],
    shown: Int[np.ndarray, " r"],
) -> tuple[CarState, list[ControlSample]]:
    own = plant.start(states)
    history: list[ControlSample] = []
    while bool(jnp.any(cars.active)):
        cars, held, record = _decide_all(world, cars, keys, jnp.asarray(len(history)))
        history.append(jax.tree.map(lambda now: np.asarray(now)[shown][None], record))
        commands, durations = np.asarray(held.command), np.asarray(held.duration)
        for look in range(world.looks):
            active, seen = np.asarray(cars.active), np.array(cars.state)
            for car in np.flatnonzero(active):
                try:
                    own[car] = plant.hold(own[car], commands[car], float(durations[car]) / world.looks)
                    seen[car] = plant.observe(own[car])
                except Exception:  # whatever a simulator of others raises ends that car
                    seen[car] = np.nan
            cars = _moved_all(world, cars, held, jnp.asarray(seen), jnp.asarray(look))
        cars = _finish_all(world, cars)
    return cars, history


# --- all together


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
