"""One car of the sampled loop at one instant: it measures, decides, is moved, and is looked at.

V is taken at the true state, whatever the controller believes. While a command is held θ runs evenly, so that the
instant at which it reaches the end is known.
"""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from cfjax.plants import Sensor
from cfjax.simulation.clearance import ObstacleArrays, clearance
from cfjax.simulation.controller import Controller
from cfjax.simulation.loop import ROUNDING
from cfjax.simulation.track import Track


AT_LIMIT = 1e-6  # of a command's range: closer to its end it is saturated
ARRIVED = 1e-12  # relative: rounding


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


def look_at(world: World, car: CarState, duration: Array) -> CarState:
    """Where the car is now, `duration` s after it was last looked at."""
    track = world.track
    place = track.at(car.theta)
    x = track.deviation(place, car.state)
    value = track.value(place, x)
    apart = car.clearance
    if world.around is not None:
        pose = tuple(entry[None] for entry in place.pose)
        apart = jnp.minimum(apart, clearance(world.around, pose, tuple(x[:, None]))[0])
    outside = (safe_share(track, x) > 1 + ROUNDING) | (apart < -ROUNDING)
    return car._replace(
        left_safe_at=jnp.where(outside, jnp.minimum(car.left_safe_at, car.clock), car.left_safe_at),
        been_inside=car.been_inside | (value <= 1),
        left_funnel=car.left_funnel | (car.been_inside & ~(value <= 1 + ROUNDING)),
        largest_value=jnp.maximum(car.largest_value, value),
        largest_lateral=jnp.maximum(car.largest_lateral, jnp.abs(x[1])),
        squared_lateral=car.squared_lateral + duration * x[1] ** 2,
        clearance=apart,
    )


def safe_share(track: Track, x: Array) -> Array:
    return jnp.max(jnp.abs(x) / track.safe)


@eqx.filter_jit
def put(world: World, states: Array, theta: Array, remembered: int) -> CarState:
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
        return look_at(world, car, zero)

    return jax.vmap(one)(states, theta)


def decide(world: World, car: CarState, key: PRNGKeyArray) -> tuple[CarState, Held]:
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


def moved_on(
    world: World, car: CarState, held: Held, state: Array, since: Array, spent: Array, left: Array
) -> CarState:
    """The car after `spent` s that began `since` s into the hold; `left`: it was stopped where it left S."""
    finite = jnp.all(jnp.isfinite(state)) & jnp.all(jnp.isfinite(held.command)) & jnp.isfinite(held.pace)
    spent = jnp.where(finite, spent, 0.0)
    theta = jnp.where(finite, held.begin + held.pace * (since + spent), car.theta)
    moved = car._replace(state=jnp.where(finite, state, car.state), clock=car.clock + spent, theta=theta)
    moved = look_at(world, moved._replace(finite=car.finite & finite), spent)
    moved = moved._replace(
        left_safe_at=jnp.where(left, jnp.minimum(moved.left_safe_at, moved.clock), moved.left_safe_at)
    )
    ended = (moved.left_safe_at > 0) & (moved.left_safe_at < jnp.inf)
    moved = moved._replace(active=moved.finite & ~(world.stops & ended))
    return _chosen(car.active, moved, car)


def finish(world: World, car: CarState) -> CarState:
    """Whether it goes on after this hold; its end was cut to where θ arrives, but for rounding."""
    arrived = car.theta >= world.track.end * (1 - ARRIVED)
    return car._replace(active=car.active & ~arrived & (car.clock < world.limit * (1 - ARRIVED)))


def _chosen(which: Array, one: Any, other: Any) -> Any:
    return jax.tree.map(partial(jnp.where, which), one, other)


def recorded_sample(world: World, car: CarState, held: Held) -> ControlSample:
    x, value = deviation_at(world.track, car.theta, car.state)
    return ControlSample(car.clock, car.theta, car.state, held.measured, x, value, held.command)


def deviation_at(track: Track, theta: Array, state: Array) -> tuple[Array, Array]:
    """The deviation, and V."""
    place = track.at(theta)
    x = track.deviation(place, state)
    return x, track.value(place, x)
