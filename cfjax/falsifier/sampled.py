"""Inputs that are held for longer than is proven: how soon a car leaves the funnel then. Found, not proven.

A law that looks one hold ahead may take any of its inputs that is good (`cfjax.funnel.sampled`). The adversary picks
the deviation, and one of these; what it finds lies above every period that is proven.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.coerce import instance, number, whole
from cfjax.errors import InputError
from cfjax.falsifier.falsifier import require_question
from cfjax.falsifier.held import KEPT, NARROWER, ROUNDS
from cfjax.funnel import Funnel, Template
from cfjax.funnel.sampled import Holds, look_ahead
from cfjax.problem import Problem, ReferencePoint, Segment, Vehicle, deviation_rate
from cfjax.problem.runge_kutta import runge_kutta


TRIALS = 2**13  # deviations, drawn anew around the worst ones in each round
STEPS = 128  # of the horizon, by RK4: V is looked at after each
ROUNDING = 1e-12  # of V


def first_escape_of_holds(
    problem: Problem,
    segment: Segment,
    funnel: Funnel,
    numbers: Holds,
    horizon: float,
    seed: int = 0,
    trials: int = TRIALS,
) -> float:
    """The shortest time (s) found in which a good input, held for it, leads out of V ≤ 1; infinite above the horizon.

    Raises:
        InputError: for a segment whose reference changes.
    """
    require_question(problem, segment, funnel)
    instance("numbers", numbers, Holds)
    horizon, seed, trials = (
        number("horizon", horizon, "s", above=0),
        whole("seed", seed, 0),
        whole("trials", trials, KEPT),
    )
    if not segment.is_steady:
        raise InputError("segment: expected one turning rate and speed")
    rng = np.random.default_rng(seed)
    unit = np.linalg.inv(np.linalg.cholesky(funnel.shape)).T
    point = segment.point(0.0)
    leaving = partial(_leaving, problem.vehicle, funnel.template, numbers, point, horizon / STEPS)

    def draw(size: int) -> tuple[np.ndarray, np.ndarray]:
        """θ as a share, and directions times √V: half of them from V = 1."""
        y = rng.normal(size=(size, problem.dimension))
        y /= np.linalg.norm(y, axis=1, keepdims=True)
        y *= np.sqrt(np.where(rng.uniform(size=size) < 0.5, 1.0, rng.uniform(0.5, 1.0, size=size)))[:, None]
        return rng.uniform(size=size), y

    theta, y = draw(trials)
    best = np.inf
    for round_ in range(ROUNDS):
        where = theta * funnel.duration
        x = (y @ unit.T) * np.sqrt(np.asarray(funnel.template.level(funnel.rate, where)))[:, None]
        times = np.asarray(leaving(jnp.asarray(where), jnp.asarray(x)))
        best = min(best, float(times.min()))
        worst = np.argsort(times)[:KEPT]
        if not np.isfinite(times[worst[0]]):
            theta, y = draw(trials)
            continue
        near = worst[rng.integers(np.isfinite(times[worst]).sum(), size=trials)]
        width = 0.3 * NARROWER**round_
        theta = np.clip(theta[near] + width * rng.normal(size=trials), 0, 1)
        y = y[near] + width * rng.normal(size=y[near].shape)
        y /= np.maximum(1.0, np.linalg.norm(y, axis=1, keepdims=True))
    return best


@partial(jax.jit, static_argnums=(0, 1))
def _leaving(
    vehicle: Vehicle,
    template: Template,
    numbers: Holds,
    reference: ReferencePoint,
    step: Float[Array, ""],
    theta: Float[Array, " k"],
    x: Float[Array, "k n"],
) -> Float[Array, " k"]:
    """When V is first seen above 1 (s) under one of the good inputs, each held all the time; else infinite."""

    def value(z: Array) -> Array:
        return template.value(numbers.rate, z[0], z[1:] @ numbers.shape @ z[1:])

    def held(z: Array, inputs: Array) -> Array:
        def motion(at: Array) -> Array:
            return jnp.stack([inputs[0], *deviation_rate(vehicle, tuple(at[1:]), tuple(inputs), reference)])

        def move(at: Array, _: None) -> tuple[Array, Array]:
            at = runge_kutta(motion, at, step)
            return at, value(at)

        _, values = jax.lax.scan(move, z, None, length=STEPS)
        return jnp.where(values > 1 + ROUNDING, jnp.arange(1, STEPS + 1) * step, jnp.inf).min()

    def of(theta: Array, x: Array) -> Array:
        good = look_ahead(vehicle, template, numbers, reference, theta, x).good
        z = jnp.concatenate([theta[None], x])
        times = jax.vmap(partial(held, z))(jnp.asarray(numbers.choices))
        return jnp.where(good, times, jnp.inf).min()

    return jax.vmap(of)(theta, x)
