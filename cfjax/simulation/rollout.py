"""Closed loop on the model: many cars at once under the min-norm law, fixed-step RK4."""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.control import MinNormLaw, min_norm_input, min_norm_law
from cfjax.funnel import Funnel, Template
from cfjax.problem import Ellipsoid, Problem, Segment, Vehicle, affine_deviation
from cfjax.result import ClosedLoop


STEPS_PER_SEGMENT = 400  # of reference time; u0 ≥ 1/2 takes at most twice as many
ROUNDING = 1e-9  # of V at a car that starts on the boundary of a set


def sample_starts(key: Array, inlet: Ellipsoid, count: int) -> Float[Array, "count n"]:
    """Random deviations of I: one half uniform in the volume, the other on the boundary."""
    axes = jnp.array(inlet.half_axes)
    key_direction, key_radius = jax.random.split(key)
    direction = jax.random.normal(key_direction, (count, len(inlet.half_axes)))
    direction = direction / jnp.linalg.norm(direction, axis=1, keepdims=True)
    radius = jax.random.uniform(key_radius, (count, 1)) ** (1 / len(inlet.half_axes))
    radius = jnp.where(jnp.arange(count)[:, None] < count // 2, 1.0, radius)
    return direction * radius * axes[None, :]


class Car(NamedTuple):
    """State of one closed loop: reference time θ, deviation, the clock and the largest V so far."""

    theta: Array
    x: Array
    clock: Array
    largest_value: Array
    worst_safe: Array  # max over time of |x_i| / s_i


class Loop(NamedTuple):
    """What a closed loop needs beside vehicle and template, as a pytree."""

    law: MinNormLaw
    duration: Array
    safe: Array  # half-widths of S, inf where there is none
    step: Array  # s of the clock


def _advance(vehicle: Vehicle, template: Template, loop: Loop, car: Car) -> Car:
    """One RK4 step; a car that passes θ = T is put where it crossed, a car that has arrived stays."""

    def rate(z: Array) -> Array:
        theta, x = z[0], z[1:]
        inputs = min_norm_input(vehicle, template, loop.law, theta, x)
        drift, columns = affine_deviation(vehicle, x, loop.law.reference)
        return jnp.concatenate([inputs[:1], drift + columns @ inputs])

    z, h = jnp.concatenate([car.theta[None], car.x]), loop.step
    k1 = rate(z)
    k2 = rate(z + 0.5 * h * k1)
    k3 = rate(z + 0.5 * h * k2)
    k4 = rate(z + h * k3)
    moved = (k1 + 2 * k2 + 2 * k3 + k4) / 6
    # θ never goes back, so the share of the step until θ = T is well defined; the chord is O(h²) off
    share = jnp.clip((loop.duration - car.theta) / (h * moved[0]), 0.0, 1.0)
    z = z + share * h * moved
    x = z[1:]
    value = template.value(loop.law.rate, z[0], x @ loop.law.shape @ x)
    arrived = car.theta >= loop.duration
    return Car(
        theta=z[0],
        x=x,
        clock=car.clock + share * h,
        largest_value=jnp.where(arrived, car.largest_value, jnp.maximum(car.largest_value, value)),
        worst_safe=jnp.maximum(car.worst_safe, jnp.max(jnp.abs(x) / loop.safe)),
    )


def _start(template: Template, loop: Loop, x: Array) -> Car:
    zero = jnp.zeros(())
    value = template.value(loop.law.rate, zero, x @ loop.law.shape @ x)
    return Car(zero, x, zero, jnp.asarray(value), jnp.max(jnp.abs(x) / loop.safe))


@partial(jax.jit, static_argnames=("vehicle", "template"))
def drive(vehicle: Vehicle, template: Template, loop: Loop, starts: Float[Array, "k n"], limit: Array) -> Car:
    """Final state of all cars: driven until each has arrived, at most `limit` steps."""
    cars = jax.vmap(partial(_start, template, loop))(starts)
    advance = jax.vmap(partial(_advance, vehicle, template, loop))

    def running(carry: tuple[Array, Car]) -> Array:
        return (carry[0] < limit) & jnp.any(carry[1].theta < loop.duration)

    return jax.lax.while_loop(running, lambda c: (c[0] + 1, advance(c[1])), (jnp.zeros((), int), cars))[1]


@partial(jax.jit, static_argnames=("vehicle", "template", "steps"))
def record(vehicle: Vehicle, template: Template, loop: Loop, starts: Float[Array, "k n"], steps: int) -> Car:
    """States of a few cars at every step, leading axis time."""
    cars = jax.vmap(partial(_start, template, loop))(starts)
    advance = jax.vmap(partial(_advance, vehicle, template, loop))
    _, history = jax.lax.scan(lambda c, _: (advance(c), c), cars, None, length=steps)
    return history


@dataclass(frozen=True)
class Rollouts:
    """Recorded cars: clock and θ (s), deviations, and V; axes (time, car[, state]). Arrived cars stay at θ = T."""

    clock: Float[np.ndarray, "t k"]
    theta: Float[np.ndarray, "t k"]
    x: Float[np.ndarray, "t k n"]
    value: Float[np.ndarray, "t k"]


def _loop(problem: Problem, segment: Segment, funnel: Funnel, margin: float) -> Loop:
    safe = problem.safe.half_widths if problem.safe else (np.inf,) * problem.dimension
    return Loop(
        law=min_norm_law(problem, segment, funnel, margin),
        duration=jnp.asarray(segment.duration, float),
        safe=jnp.array(safe),
        step=jnp.asarray(segment.duration / STEPS_PER_SEGMENT, float),
    )


def drive_cars(
    problem: Problem, segment: Segment, funnel: Funnel, margin: float, *, cars: int, seed: int = 0
) -> ClosedLoop:
    """Drive `cars` cars from random deviations of I at θ = 0 under the law of the margin (1/s); count what went wrong."""
    loop = _loop(problem, segment, funnel, margin)
    starts = sample_starts(jax.random.key(seed), problem.inlet, cars)
    limit = int(np.ceil(STEPS_PER_SEGMENT / problem.inputs[0].lower)) + 2
    end = jax.block_until_ready(drive(problem.vehicle, funnel.template, loop, starts, jnp.asarray(limit)))
    goal = np.asarray(end.x) / np.array(problem.goal.half_axes)
    arrived = np.asarray(end.theta) >= segment.duration * (1 - ROUNDING)
    largest = np.asarray(end.largest_value)
    clock = np.asarray(end.clock)
    return ClosedLoop(
        cars=cars,
        left_funnel=int((~(largest <= 1 + ROUNDING)).sum()),
        left_safe=int((~(np.asarray(end.worst_safe) <= 1 + ROUNDING)).sum()),
        missed_goal=int((~(arrived & ((goal**2).sum(axis=1) < 1))).sum()),
        largest_value=float(largest.max()),
        arrival=(float(clock.min()), float(clock.max())),
    )


def record_cars(
    problem: Problem, segment: Segment, funnel: Funnel, margin: float, *, cars: int, seed: int = 1
) -> Rollouts:
    """Record a few cars from random deviations of I, for pictures."""
    loop = _loop(problem, segment, funnel, margin)
    starts = sample_starts(jax.random.key(seed), problem.inlet, cars)
    steps = int(np.ceil(STEPS_PER_SEGMENT / problem.inputs[0].lower)) + 2
    history = record(problem.vehicle, funnel.template, loop, starts, steps)
    theta, x = np.asarray(history.theta), np.asarray(history.x)
    return Rollouts(np.asarray(history.clock), theta, x, funnel.value(theta, x))
