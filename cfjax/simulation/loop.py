"""The closed loop of many cars at once: deviations under a law, one step of fixed-step RK4 at a time.

What a step does not know is where the reference comes from: along a path it is read at the car's θ
(`cfjax.problem.course`), in a tube it is made while the cars drive (`cfjax.simulation.tube`).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.control import Law, LawNumbers
from cfjax.funnel import Funnel, Template
from cfjax.problem import Ellipsoid, Problem, ReferencePoint, Vehicle, affine_along, deviation_rate
from cfjax.problem.input_box import InputBox
from cfjax.traced import traced


RK4_NODES = (0.0, 0.5, 0.5, 1.0)
# dense output of third order: up to the share s of a step the mean slope is Σ k_i (w_0i + w_1i s + w_2i s²)
RK4_WEIGHTS = ((1.0, 0.0, 0.0, 0.0), (-3 / 2, 1.0, 1.0, -1 / 2), (2 / 3, -2 / 3, -2 / 3, 2 / 3))
CROSSING = 3  # Newton steps to the share of a step at which θ reaches the end
ROUNDING = 1e-9  # of V at a car that starts on the boundary of a set
RECORDED = 24  # cars, at least
MOST_ROWS = 4000  # of a record


class Cars(NamedTuple):
    """State of many closed loops; arrays of k."""

    theta: Array  # reference time, s
    x: tuple[Array, ...]  # deviation, one array per state
    clock: Array  # s
    value: Array  # V of the funnel that the car is in
    largest_value: Array  # so far
    worst_safe: Array  # max over time of |x_i| / s_i


class Loop(NamedTuple):
    """What a closed loop needs beside vehicle and template, as a pytree.

    Any number in it may be an array of k instead, one per car; then the numbers' C has shape (n, n, k).
    """

    numbers: LawNumbers  # of the law, which is given beside it
    begin: Array | np.ndarray  # θ from which the funnel counts its own, s
    end: Array | np.ndarray  # θ up to which the loop is driven, s; inf where there is no end
    safe: Array | np.ndarray  # half-widths of S, inf where there is none
    step: Array | np.ndarray  # s of the clock


# what the deviation is measured from at θ, and what the law is told
Reference = Callable[[Array], tuple[ReferencePoint, ReferencePoint]]


def sample_starts(key: Array, inlet: Ellipsoid, count: int) -> Float[Array, "count n"]:
    """Random deviations of I: one half uniform in the volume, the other on the boundary."""
    return traced(_sampled, count)(jax.random.key_data(key), np.array(inlet.half_axes))


def _sampled(count: int, key: Array, axes: Float[Array, " n"]) -> Float[Array, "count n"]:
    key = jax.random.wrap_key_data(key)
    key_direction, key_radius = jax.random.split(key)
    direction = jax.random.normal(key_direction, (count, len(axes)))
    direction = direction / jnp.linalg.norm(direction, axis=1, keepdims=True)
    radius = jax.random.uniform(key_radius, (count, 1)) ** (1 / len(axes))
    radius = jnp.where(jnp.arange(count)[:, None] < count // 2, 1.0, radius)
    return direction * radius * axes[None, :]


def loop_of(problem: Problem, numbers: LawNumbers, step: float, begin: float = 0.0, end: float = np.inf) -> Loop:
    """The loop of one law from θ = begin to end (s), in steps of `step` (s, unless the caller scales them)."""
    safe = problem.safe.half_widths if problem.safe else (np.inf,) * problem.dimension
    return Loop(numbers, np.asarray(begin, float), np.asarray(end, float), np.array(safe), np.asarray(step, float))


def fastest(problem: Problem, funnel: Funnel, points: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, " k"]:
    """The largest |ẋ| on each reference itself over the corners of the input box, with |ẋ|² = ẋᵀCẋ: in 1/s.

    References are rows of a `ReferencePoint`.
    √V changes by at most so much per second there: it says how fine steps have to be, in parts of the funnel.
    """
    drift, columns = affine_along(problem.vehicle, points)
    rates = drift[:, None, :] + InputBox.of(problem.inputs).vertices @ np.swapaxes(columns, 1, 2)
    return np.sqrt(funnel.form(rates).max(axis=1))


def value(template: Template, loop: Loop, theta: Array, x: tuple[Array, ...]) -> Array:
    """V of the loop's funnel at θ (s) and the deviations x."""
    each = range(len(x))
    form = sum((loop.numbers.shape[i, j] * x[i] * x[j] for i in each for j in each), jnp.zeros_like(theta))
    return jnp.asarray(template.value(loop.numbers.rate, theta - loop.begin, form))


def _safe_share(loop: Loop, x: tuple[Array, ...]) -> Array:
    return jnp.max(jnp.stack([jnp.abs(x[i]) / loop.safe[i] for i in range(len(x))]), axis=0)


def start(template: Template, loop: Loop, starts: Float[Array, "k n"]) -> Cars:
    """Cars at θ = 0 with these deviations."""
    zero, x = jnp.zeros(starts.shape[0]), tuple(starts.T)
    first = value(template, loop, zero, x)
    return Cars(zero, x, zero, first, first, _safe_share(loop, x))


def enter(template: Template, loop: Loop, cars: Cars) -> Cars:
    """The same cars, measured in another funnel."""
    now = value(template, loop, cars.theta, cars.x)
    return cars._replace(value=now, largest_value=jnp.maximum(cars.largest_value, now))


def advance(
    vehicle: Vehicle, template: Template, law: Law, loop: Loop, reference: Reference, cars: Cars
) -> tuple[Cars, tuple[Array, ...]]:
    """One RK4 step, and the inputs (u0, *vehicle inputs) that the law takes where it begins.

    A car that passes the end is put where it crossed, one that is there stays.

    Where it crossed is known to third order in the step (dense output), so that ends on the way cost no accuracy.
    """

    def stage(k: tuple[Array, ...], node: Array) -> tuple[tuple[Array, ...], tuple]:
        theta, *x = (a + node * loop.step * b for a, b in zip(z, k, strict=True))
        actual, seen = reference(theta)
        inputs = tuple(
            jnp.broadcast_to(each, theta.shape)
            for each in law(vehicle, template, loop.numbers, seen, theta - loop.begin, x)
        )
        k = inputs[0], *deviation_rate(vehicle, x, inputs, actual)
        return k, (k, inputs)

    # a loop over the four stages, not four copies: compiling the law once takes a quarter of the time
    z = (cars.theta, *cars.x)
    _, (stages, inputs) = jax.lax.scan(stage, tuple(jnp.zeros_like(a) for a in z), jnp.array(RK4_NODES))

    def mean(ks: Array) -> list[Array]:
        """Of the slope up to a share of the step: coefficients of its powers."""
        return [sum((w * k for w, k in zip(row, ks, strict=True)), jnp.zeros_like(ks[0])) for row in RK4_WEIGHTS]

    def moved(share: Array | float, start: Array, mean: list[Array]) -> Array:
        return start + loop.step * share * (mean[0] + share * (mean[1] + share * mean[2]))

    # θ never goes back (u0 > 0), so the share of the step until the end is well defined
    pace, *paces = map(mean, stages)
    after = moved(1.0, cars.theta, pace)
    passes = after >= loop.end
    goal = jnp.minimum(loop.end, after)
    share = (goal - cars.theta) / (after - cars.theta)
    for _ in range(CROSSING):
        slope = loop.step * (pace[0] + share * (2 * pace[1] + 3 * share * pace[2]))
        share = share - (moved(share, cars.theta, pace) - goal) / slope
    share = jnp.where(passes, jnp.clip(share, 0.0, 1.0), 1.0)
    x = tuple(moved(share, *each) for each in zip(cars.x, paces, strict=True))
    moving = cars._replace(
        theta=jnp.where(passes, loop.end, after),
        x=x,
        clock=cars.clock + share * loop.step,
        worst_safe=jnp.maximum(cars.worst_safe, _safe_share(loop, x)),
    )
    return enter(template, loop, moving), tuple(each[0] for each in inputs)
