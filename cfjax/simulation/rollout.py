"""Closed loop on the model: many cars at once under the min-norm law, fixed-step RK4."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.control import MinNormLaw, min_norm_input, min_norm_law
from cfjax.funnel import Funnel, Template
from cfjax.problem import Ellipsoid, Problem, ReferencePoint, Segment, Vehicle, deviation_rate
from cfjax.result import ClosedLoop, Rollouts


STEPS_PER_SEGMENT = 400  # of reference time; u0 ≥ 1/2 takes at most twice as many
RK4_NODES, RK4_WEIGHTS = (0.0, 0.5, 0.5, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6)
RECORDED = 24  # cars, at least
MOST_ROWS = 4000  # of a record; slower cars are recorded up to there
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


class Cars(NamedTuple):
    """State of many closed loops: reference time θ, deviation, the clock and the largest V so far; arrays of k."""

    theta: Array
    x: tuple[Array, ...]  # one array per state
    clock: Array
    largest_value: Array
    worst_safe: Array  # max over time of |x_i| / s_i


class Loop(NamedTuple):
    """What a closed loop needs beside vehicle and template, as a pytree."""

    law: MinNormLaw
    duration: Array
    safe: Array  # half-widths of S, inf where there is none
    step: Array  # s of the clock; may be one per car


class Stretch(NamedTuple):
    """The reference along one step, as profiles at its start: they go on along θ with their slopes."""

    actual: ReferencePoint  # what the deviation is measured from
    seen: ReferencePoint  # what the law is told


def _along(reference: ReferencePoint, since: Array) -> ReferencePoint:
    """The profile `since` (s of θ) later."""
    omega, v, omega_slope, v_slope, since = jnp.broadcast_arrays(*reference, since)
    return ReferencePoint(omega + omega_slope * since, v + v_slope * since, omega_slope, v_slope)


def _value(template: Template, loop: Loop, theta: Array, x: tuple[Array, ...]) -> Array:
    each = range(len(x))
    form = sum((loop.law.shape[i, j] * x[i] * x[j] for i in each for j in each), jnp.zeros_like(theta))
    return jnp.asarray(template.value(loop.law.rate, theta, form))


def _safe_share(loop: Loop, x: tuple[Array, ...]) -> Array:
    return jnp.max(jnp.stack([jnp.abs(x[i]) / loop.safe[i] for i in range(len(x))]), axis=0)


def _start(template: Template, loop: Loop, starts: Float[Array, "k n"]) -> Cars:
    zero, x = jnp.zeros(starts.shape[0]), tuple(starts.T)
    return Cars(zero, x, zero, _value(template, loop, zero, x), _safe_share(loop, x))


def _advance(vehicle: Vehicle, template: Template, loop: Loop, stretch: Stretch, cars: Cars) -> Cars:
    """One RK4 step; a car that passes θ = T is put where it crossed, a car that has arrived stays."""

    def rate(z: tuple[Array, ...]) -> tuple[Array, ...]:
        theta, *x = z
        actual, seen = (_along(reference, theta - cars.theta) for reference in stretch)
        inputs = min_norm_input(vehicle, template, loop.law, seen, theta, x)
        return inputs[0], *deviation_rate(vehicle, x, inputs, actual)

    def moved(h: Array, k: tuple[Array, ...]) -> tuple[Array, ...]:
        return tuple(a + h * b for a, b in zip(z, k, strict=True))

    def stage(carry: tuple, coefficients: tuple[Array, Array]) -> tuple[tuple, None]:
        k, mean = carry
        node, weight = coefficients
        k = rate(moved(node * loop.step, k))
        return (k, tuple(a + weight * b for a, b in zip(mean, k, strict=True))), None

    # a loop over the four stages, not four copies: compiling the law once takes a quarter of the time
    z = (cars.theta, *cars.x)
    rest = tuple(jnp.zeros_like(a) for a in z)
    (_, mean), _ = jax.lax.scan(stage, (rest, rest), (jnp.array(RK4_NODES), jnp.array(RK4_WEIGHTS)))
    # θ never goes back, so the share of the step until θ = T is well defined; the chord is O(h²) off
    share = jnp.clip((loop.duration - cars.theta) / (loop.step * mean[0]), 0.0, 1.0)
    theta, *x = moved(share * loop.step, mean)
    x = tuple(x)
    arrived = cars.theta >= loop.duration
    value = _value(template, loop, theta, x)
    return Cars(
        theta=theta,
        x=x,
        clock=cars.clock + share * loop.step,
        largest_value=jnp.where(arrived, cars.largest_value, jnp.maximum(cars.largest_value, value)),
        worst_safe=jnp.maximum(cars.worst_safe, _safe_share(loop, x)),
    )


@partial(jax.jit, static_argnames=("vehicle", "template", "limit", "stride"))
def drive(
    vehicle: Vehicle,
    template: Template,
    loop: Loop,
    stretch: Stretch,
    starts: Float[Array, "k n"],
    limit: int,
    stride: int,
) -> tuple[Cars, Cars]:
    """All cars, driven until each has arrived, at most `limit` steps.

    Returns their final states, and the states of every `stride`-th car before each step: leading axis time, rows after
    the last arrival repeat it.
    """

    def running(carry: tuple[Array, Cars, Cars]) -> Array:
        return (carry[0] < limit) & jnp.any(carry[1].theta < loop.duration)

    def step(carry: tuple[Array, Cars, Cars]) -> tuple[Array, Cars, Cars]:
        count, cars, history = carry
        history = jax.tree.map(lambda past, now: past.at[count].set(now[::stride], mode="drop"), history, cars)
        return count + 1, _advance(vehicle, template, loop, stretch, cars), history

    cars = _start(template, loop, starts)
    rows = min(limit + 1, MOST_ROWS)
    empty = jax.tree.map(lambda now: jnp.zeros((rows, *now[::stride].shape)), cars)
    count, cars, history = jax.lax.while_loop(running, step, (jnp.zeros((), int), cars, empty))
    after = jnp.arange(rows)[:, None] >= count
    return cars, jax.tree.map(lambda past, now: jnp.where(after, now[None, ::stride], past), history, cars)


def _loop(problem: Problem, funnel: Funnel, law: MinNormLaw, step: float) -> Loop:
    safe = problem.safe.half_widths if problem.safe else (np.inf,) * problem.dimension
    return Loop(law, jnp.asarray(funnel.duration, float), jnp.array(safe), jnp.asarray(step, float))


def _steady(segment: Segment) -> Stretch:
    """The same all along, and known."""
    point = ReferencePoint(*(jnp.asarray(value, float) for value in segment.point(0.0)))
    return Stretch(point, point)


def drive_cars(
    problem: Problem, segment: Segment, funnel: Funnel, margin: float, *, cars: int, seed: int = 0
) -> tuple[ClosedLoop, Rollouts]:
    """Drive `cars` cars from random deviations of I at θ = 0 under the law of the margin (1/s).

    Returns what went wrong and when they arrived, and the recorded way of a few of them.
    """
    law = min_norm_law(problem, funnel, margin)
    loop = _loop(problem, funnel, law, segment.duration / STEPS_PER_SEGMENT)
    starts = sample_starts(jax.random.key(seed), problem.inlet, cars)
    limit = int(np.ceil(STEPS_PER_SEGMENT / problem.timing.lower)) + 2  # u0 of tracking is 1: sooner
    stride = max(1, cars // RECORDED)
    driven = drive(problem.vehicle, funnel.template, loop, _steady(segment), starts, limit, stride)
    end, history = jax.block_until_ready(driven)
    goal = np.stack(end.x, axis=-1) / np.array(problem.goal.half_axes)
    arrived = np.asarray(end.theta) >= segment.duration * (1 - ROUNDING)
    largest, clock = np.asarray(end.largest_value), np.asarray(end.clock)
    summary = ClosedLoop(
        cars=cars,
        left_funnel=int((~(largest <= 1 + ROUNDING)).sum()),
        left_safe=int((~(np.asarray(end.worst_safe) <= 1 + ROUNDING)).sum()),
        missed_goal=int((~(arrived & ((goal**2).sum(axis=1) < 1))).sum()),
        largest_value=float(largest.max()),
        arrival=(float(clock.min()), float(clock.max())),
    )
    theta, x = np.asarray(history.theta), np.stack(history.x, axis=-1)
    return summary, Rollouts(np.asarray(history.clock), theta, x, funnel.value(theta, x))
