"""The plants of the sampled loop, from one control instant to the next, for all cars at once.

Differential equations are integrated by diffrax, Tsitouras' fifth order, with constant steps or, with a `tolerance`,
adaptive ones; leaving S is an event there. Simulators of other people (`HostPlant`) are stepped.
"""

from functools import partial
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Float, Int, PRNGKeyArray

from cfjax.plants import HostPlant, Plant, Scene
from cfjax.simulation.sampled_car import (
    CarState,
    ControlSample,
    Held,
    World,
    decide,
    finish,
    moved_on,
    recorded_sample,
    safe_share,
)


CHUNK = 128  # control periods between two looks at whether anybody is still driving
MOST_SOLVER_STEPS = 10_000  # per hold
EVENT = 1e-10  # s, relative and absolute: of the instant at which a car leaves S


class Integrator(eqx.Module):
    """A plant and how it is integrated: the length of a step (s), and the tolerance of adaptive ones."""

    plant: Plant
    step: Array
    tolerance: Array | None


def _hold(
    world: World, by: Integrator, z: Array, car: CarState, held: Held, draw: Array, span: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """The plant's state after a part of a hold, from `span[0]` to `span[1]` s of it; NaN where there is none.

    With the time that this took, and whether it ended because the car left S.
    """

    def scene(time: Array, z: Array) -> tuple[Array, Scene]:
        place = world.track.at(held.begin + held.pace * time)
        x = world.track.deviation(place, by.plant.observe(z))
        return x, Scene(place.pose[0], world.track.gradient(place, x))

    def true_rate(time: Any, z: Array) -> Array:
        return by.plant.rate(z, held.command, draw, scene(time, z)[1])

    def rate(time: Any, z: Array, _: None) -> Array:
        # around a rate that is no number adaptive steps would shrink for ever: the plant stays, and is found there
        slope = true_rate(time, z)
        return jnp.where(jnp.all(jnp.isfinite(slope)), slope, 0.0)

    def outside(t: Any, y: Array, args: None, **_: Any) -> Array:
        # a car that began outside is not stopped
        return jnp.where(car.left_safe_at > 0, safe_share(world.track, scene(t, y)[0]) - 1, -1.0)

    found = diffrax.diffeqsolve(
        diffrax.ODETerm(rate),
        diffrax.Tsit5(),
        *span,
        dt0=jnp.minimum(by.step, jnp.maximum(span[1] - span[0], 1e-12)),
        y0=z,
        saveat=diffrax.SaveAt(t1=True),
        stepsize_controller=diffrax.ConstantStepSize()
        if by.tolerance is None
        else diffrax.PIDController(rtol=by.tolerance, atol=by.tolerance),
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
    world: World, by: Integrator, cars: CarState, z: Array, keys: Array, first: Array, shown: Array
) -> tuple[CarState, Array, ControlSample]:
    """CHUNK control periods of all cars, from the period `first` on."""

    def period(carry: tuple[CarState, Array], number: Array) -> tuple[tuple[CarState, Array], ControlSample]:
        def one(car: CarState, z: Array, key: PRNGKeyArray) -> tuple[CarState, Array, ControlSample]:
            key_plant, key_sensor = jax.random.split(key)
            car, held = decide(world, car, jax.random.fold_in(key_sensor, number))
            record = recorded_sample(world, car, held)
            draw = by.plant.draw(key_plant, car.clock)
            for look in range(world.looks):
                since = held.duration * (look / world.looks)
                span = since, jnp.where(car.active, held.duration * ((look + 1) / world.looks), since)
                after, spent, left = _hold(world, by, z, car, held, draw, span)
                moved = moved_on(world, car, held, by.plant.observe(after), since, spent, left)
                car, z = moved, jnp.where(moved.active, after, z)
            return finish(world, car), z, record

        cars, z, record = jax.vmap(one)(*carry, keys)
        return (cars, z), jax.tree.map(lambda now: now[shown], record)

    (cars, z), history = jax.lax.scan(period, (cars, z), first + jnp.arange(CHUNK))
    return cars, z, history


def integrate(
    world: World, by: Integrator, cars: CarState, keys: Array, states: Array, shown: Int[np.ndarray, " r"]
) -> tuple[CarState, list[ControlSample]]:
    """The cars at the ends of their drives, and samples of those whose numbers are `shown`, a chunk after another."""
    z = jax.vmap(by.plant.start)(states)
    history: list[ControlSample] = []
    while bool(jnp.any(cars.active)):
        first = jnp.asarray(CHUNK * len(history))
        cars, z, record = _chunk(world, by, cars, z, keys, first, jnp.asarray(shown))
        history.append(jax.tree.map(np.asarray, record))
    return cars, history


@eqx.filter_jit
def _decide_all(world: World, cars: CarState, keys: Array, number: Array) -> tuple[CarState, Held, ControlSample]:
    def one(car: CarState, key: PRNGKeyArray) -> tuple[CarState, Held, ControlSample]:
        _, key_sensor = jax.random.split(key)
        car, held = decide(world, car, jax.random.fold_in(key_sensor, number))
        return car, held, recorded_sample(world, car, held)

    return jax.vmap(one)(cars, keys)


@eqx.filter_jit
def _moved_all(world: World, cars: CarState, held: Held, states: Array, look: Array) -> CarState:
    def one(car: CarState, held: Held, state: Array) -> CarState:
        part = held.duration / world.looks
        return moved_on(world, car, held, state, look * part, part, jnp.zeros((), bool))

    return jax.vmap(one)(cars, held, states)


@eqx.filter_jit
def _finish_all(world: World, cars: CarState) -> CarState:
    return jax.vmap(partial(finish, world))(cars)


def step_others(
    world: World,
    plant: HostPlant,
    cars: CarState,
    keys: Array,
    states: Float[np.ndarray, "k n"],
    shown: Int[np.ndarray, " r"],
) -> tuple[CarState, list[ControlSample]]:
    """As `integrate`, with a simulator that takes one car at a time."""
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
