"""Inputs of a finite set that are held: how fast V falls in truth, and what longer holds do. Found, not proven.

A law that looks one hold ahead may take any of its inputs that is good (`cfjax.funnel.sampled`). Beside what is proven
of it stand two figures of cars that are driven: how fast V falls at the worst deviation with the best of the inputs,
which is above every decrease that is proven; and how soon a car leaves the funnel whose good input, picked by an
adversary together with the deviation, is held on and on, which is above every period that is proven.
"""

from collections.abc import Callable
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
from cfjax.funnel.sampled import Holds, held_motion, look_ahead, value_of
from cfjax.problem import Problem, ReferencePoint, Segment, Vehicle
from cfjax.problem.runge_kutta import runge_kutta


TRIALS = 2**13  # deviations, drawn anew around the worst ones in each round
STEPS = 64  # of what is looked at, by RK4: V is seen after each
ROUNDING = 1e-12  # of V
INSIDE = 0.5  # V, from which a car that leaves may start


def slowest_fall(
    problem: Problem,
    segment: Segment,
    funnel: Funnel,
    numbers: Holds,
    hold: float,
    seed: int = 0,
    trials: int = TRIALS,
) -> float:
    """At the worst deviation found on the shell, how fast V falls (1/s) under the best of the inputs.

    It is held for `hold` seconds; what counts is the least of (V − V(s))/s on the way. Below zero V rises.

    Raises:
        InputError: for a segment whose reference changes.
    """
    hold = number("hold", hold, "s", above=0)
    of = _score(problem, segment, funnel, numbers, partial(_fall, hold=hold))
    return _least(of, problem, funnel, funnel.beta_lower, seed, trials)


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
    horizon = number("horizon", horizon, "s", above=0)
    of = _score(problem, segment, funnel, numbers, partial(_leaving, horizon=horizon))
    return _least(of, problem, funnel, INSIDE, seed, trials)


def first_escape_of_start(
    problem: Problem,
    segment: Segment,
    funnel: Funnel,
    numbers: Holds,
    *,
    level: float,
    horizon: float,
    start: int = 0,
    seed: int = 0,
    trials: int = TRIALS,
) -> float:
    """The shortest time (s) found in which a car from V ≤ `level` leaves V ≤ 1 while it holds the choice `start`.

    So long the first pose may be on its way, in truth. Infinite above the horizon.

    Raises:
        InputError: for a segment whose reference changes.
    """
    horizon, level = number("horizon", horizon, "s", above=0), number("level", level, above=0, most=1)
    held = numbers._replace(choices=numbers.choices[start : start + 1], left_out=numbers.left_out[start : start + 1])
    of = _score(problem, segment, funnel, held, partial(_leaving, horizon=horizon, any_choice=True))
    return _least(of, problem, funnel, INSIDE, seed, trials, level)


Score = Callable[[Float[Array, " k"], Float[Array, "k n"]], Array]  # of θ (s) and deviations


def _score(problem: Problem, segment: Segment, funnel: Funnel, numbers: Holds, of: Callable[..., Array]) -> Score:
    """A score of many deviations beside the segment's reference."""
    require_question(problem, segment, funnel)
    instance("numbers", numbers, Holds)
    if not segment.is_steady:
        raise InputError("segment: expected one turning rate and speed")
    one = partial(of, problem.vehicle, funnel.template, numbers, segment.point(0.0))
    return jax.jit(jax.vmap(one))


def _least(
    of: Score, problem: Problem, funnel: Funnel, inner: float, seed: int, trials: int, outer: float = 1.0
) -> float:
    """The least score found with V/`outer` from `inner` to 1: deviations are drawn anew around the best ones so far."""
    rng = np.random.default_rng(whole("seed", seed, 0))
    trials = whole("trials", trials, KEPT)
    unit = np.sqrt(outer) * np.linalg.inv(np.linalg.cholesky(funnel.shape)).T

    def drawn() -> tuple[np.ndarray, np.ndarray]:
        """θ as a share, and directions times √V: half of them from V = 1."""
        y = rng.normal(size=(trials, problem.dimension))
        level = np.where(rng.uniform(size=trials) < 0.5, 1.0, rng.uniform(inner, 1.0, size=trials))
        return rng.uniform(size=trials), y * (np.sqrt(level) / np.linalg.norm(y, axis=1))[:, None]

    theta, y = drawn()
    best = np.inf
    for round_ in range(ROUNDS):
        where = theta * funnel.duration
        x = (y @ unit.T) * np.sqrt(np.asarray(funnel.template.level(funnel.rate, where)))[:, None]
        scores = np.asarray(of(jnp.asarray(where), jnp.asarray(x)))
        best = min(best, float(scores.min()))
        worst = np.argsort(scores)[:KEPT]
        known = np.isfinite(scores[worst]).sum()
        if not known:
            theta, y = drawn()
            continue
        near = worst[rng.integers(known, size=trials)]
        width = 0.3 * NARROWER**round_
        theta = np.clip(theta[near] + width * rng.normal(size=trials), 0, 1)
        y = y[near] + width * rng.normal(size=y[near].shape)
        size = np.linalg.norm(y, axis=1)
        y *= (np.clip(size, np.sqrt(inner), 1.0) / size)[:, None]
    return best


def _fall(
    vehicle: Vehicle,
    template: Template,
    numbers: Holds,
    reference: ReferencePoint,
    theta: Float[Array, ""],
    x: Float[Array, " n"],
    *,
    hold: float,
) -> Float[Array, ""]:
    """How fast V falls under the best of the inputs (1/s)."""
    before, values = _values(vehicle, template, numbers, reference, theta, x, hold / STEPS)
    times = jnp.arange(1, STEPS + 1) * (hold / STEPS)
    return jax.vmap(lambda own: ((before - own) / times).min())(values).max()


def _leaving(
    vehicle: Vehicle,
    template: Template,
    numbers: Holds,
    reference: ReferencePoint,
    theta: Float[Array, ""],
    x: Float[Array, " n"],
    *,
    horizon: float,
    any_choice: bool = False,
) -> Float[Array, ""]:
    """When V is first seen above 1 (s) under one of the good inputs, or any, each held all the time; else infinite."""
    _, values = _values(vehicle, template, numbers, reference, theta, x, horizon / STEPS)
    times = jnp.arange(1, STEPS + 1) * (horizon / STEPS)
    first = jax.vmap(lambda own: jnp.where(own > 1 + ROUNDING, times, jnp.inf).min())(values)
    good = any_choice or look_ahead(vehicle, template, numbers, reference, theta, x).good
    return jnp.where(good, first, jnp.inf).min()


def _values(
    vehicle: Vehicle,
    template: Template,
    numbers: Holds,
    reference: ReferencePoint,
    theta: Float[Array, ""],
    x: Float[Array, " n"],
    step: float,
) -> tuple[Float[Array, ""], Float[Array, "c t"]]:
    """V now, and after each of STEPS steps (s) while each of the inputs is held."""
    start, value = jnp.concatenate([theta[None], x]), value_of(template, numbers)

    def held(inputs: Array) -> Array:
        motion = held_motion(vehicle, inputs, reference)

        def move(at: Array, _: None) -> tuple[Array, Array]:
            at = runge_kutta(motion, at, step)
            return at, value(at)

        return jax.lax.scan(move, start, None, length=STEPS)[1]

    return value(start), jax.vmap(held)(jnp.asarray(numbers.choices))
