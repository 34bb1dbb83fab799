"""Inputs that are held: how soon a car can leave the funnel after a law has chosen them. Found, not proven.

A law that inherits a certificate may choose any input of the box with V̇ ≤ −λ' on the shell, and any at all inside it.
The adversary picks state and input, and in a tube the path; what it finds lies above every control period proven.
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.coerce import number, whole
from cfjax.falsifier.falsifier import require_question
from cfjax.funnel import Funnel, Template
from cfjax.problem import Path, Problem, ReferencePoint, Segment, Tube, Vehicle, deviation_rate
from cfjax.problem.course import Pieces, point_at, profiles_of
from cfjax.problem.input_box import InputBox
from cfjax.problem.runge_kutta import runge_kutta


STEPS = 64  # of the horizon, by RK4; between two of them V counts as linear
TRIALS = 2**17  # pairs of state and input, drawn anew around the worst ones in each round
ROUNDS, NARROWER, KEPT = 6, 0.5, 64


def first_escape(
    problem: Problem,
    segment: Segment | Tube,
    funnel: Funnel,
    decrease: float,
    horizon: float,
    seed: int = 0,
    decrease_per_metre: float = 0.0,
    trials: int = TRIALS,
) -> float:
    """The shortest time (s) found in which inputs held for it lead from V ≤ 1 out of it; infinite if above the horizon.

    The law is one that reaches V̇ ≤ −decrease (1/s) on the shell; in a tube V̇ ≤ −decrease_per_metre v_r as well, both
    for every curvature and acceleration, between whose ends the path jumps as is worst.
    """
    require_question(problem, segment, funnel)
    decrease, horizon = number("decrease", decrease, "1/s"), number("horizon", horizon, "s", above=0)
    decrease_per_metre = number("decrease_per_metre", decrease_per_metre, "1/m")
    seed, trials = whole("seed", seed, 0), whole("trials", trials, KEPT)
    rng = np.random.default_rng(seed)
    lower, upper = InputBox.of(problem.inputs)
    unit = np.linalg.inv(np.linalg.cholesky(funnel.shape)).T
    numbers = jnp.array([funnel.rate, funnel.beta_lower, decrease, decrease_per_metre])
    if isinstance(segment, Tube):
        place = segment.speed.lower, segment.speed.upper
        bounds = (segment.curvature, segment.speed, segment.acceleration)
        ends = jnp.array([[interval.lower, interval.upper] for interval in bounds])
        leaving = partial(_leaving_a_tube, problem.vehicle, funnel.template, ends)
    else:
        place = 0.0, funnel.duration - upper[0] * horizon  # θ that stays on the segment
        profiles = jax.tree.map(jnp.asarray, profiles_of(Path("segment", (segment,))))
        leaving = partial(_leaving, problem.vehicle, funnel.template, profiles)

    def draw(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """θ or the path's speed as a share, directions times √V, inputs as shares: corners of the box for most."""
        y = rng.normal(size=(size, problem.dimension))
        y /= np.linalg.norm(y, axis=1, keepdims=True)
        y *= np.sqrt(np.where(rng.uniform(size=size) < 0.5, 1.0, rng.uniform(0.5, 1.0, size=size)))[:, None]
        shares = rng.uniform(size=(size, len(lower)))
        return rng.uniform(size=size), y, np.where(rng.uniform(size=(size, 1)) < 0.75, np.round(shares), shares)

    theta, y, shares = draw(trials)
    best = np.inf
    for round_ in range(ROUNDS):
        where = place[0] + theta * (place[1] - place[0])
        level = funnel.template.level(funnel.rate, where)
        x = (y @ unit.T) * np.sqrt(np.asarray(level))[:, None]
        z, u = np.column_stack([where, x]), lower + shares * (upper - lower)
        times = np.asarray(leaving(jnp.asarray(funnel.shape), numbers, z.T, u.T, horizon))
        best = min(best, float(times.min()))
        worst = np.argsort(times)[:KEPT]
        if not np.isfinite(times[worst[0]]):
            theta, y, shares = draw(trials)
            continue
        near = worst[rng.integers(np.isfinite(times[worst]).sum(), size=trials)]
        width = 0.3 * NARROWER**round_
        theta = np.clip(theta[near] + width * rng.normal(size=trials), 0, 1)
        y = y[near] + width * rng.normal(size=y[near].shape)
        y /= np.maximum(1.0, np.linalg.norm(y, axis=1, keepdims=True))
        shares = np.clip(shares[near] + width * rng.normal(size=shares[near].shape), 0, 1)
    return best


@partial(jax.jit, static_argnums=(0, 1))
def _leaving(
    vehicle: Vehicle,
    template: Template,
    profiles: Pieces,
    shape: Float[Array, "n n"],
    numbers: Float[Array, " 4"],
    z: Float[Array, "1+n k"],
    u: Float[Array, "m k"],
    horizon: Float[Array, ""],
) -> Float[Array, " k"]:
    """When V passes 1 (s) from (θ, x) on; infinite where it does not, or where the law may not choose this input."""
    rate, beta_lower, decrease, _ = numbers

    def value(z: Array) -> Array:
        return template.value(rate, z[0], jnp.einsum("ik,ij,jk->k", z[1:], shape, z[1:]))

    def motion(z: Array) -> Array:
        rates = deviation_rate(vehicle, tuple(z[1:]), tuple(u), point_at(profiles, profiles.find(z[0]), z[0]))
        return jnp.stack(jnp.broadcast_arrays(u[0], *rates))

    start, rising = jax.jvp(value, (z,), (motion(z),))
    allowed = (start <= 1) & ((start < beta_lower) | (rising <= -decrease))
    return jnp.where(allowed, _first_exit(value, lambda _: motion, z, horizon / STEPS), jnp.inf)


@partial(jax.jit, static_argnums=(0, 1))
def _leaving_a_tube(
    vehicle: Vehicle,
    template: Template,
    bounds: Float[Array, "3 2"],
    shape: Float[Array, "n n"],
    numbers: Float[Array, " 4"],
    z: Float[Array, "1+n k"],
    u: Float[Array, "m k"],
    horizon: Float[Array, ""],
) -> Float[Array, " k"]:
    """The same from (v_r, x) on, where curvature and acceleration are in each step those at which V rises fastest."""
    _, beta_lower, decrease, per_metre = numbers
    curvatures, speeds, accelerations = bounds
    step = horizon / STEPS

    def value(z: Array) -> Array:
        return jnp.einsum("ik,ij,jk->k", z[1:], shape, z[1:])

    def beside(kappa: Array, a: Array) -> Callable[[Array], Array]:
        def motion(z: Array) -> Array:
            point = ReferencePoint(*jnp.broadcast_arrays(kappa * z[0], z[0], kappa * a, a))
            return jnp.stack(jnp.broadcast_arrays(a * u[0], *deviation_rate(vehicle, tuple(z[1:]), tuple(u), point)))

        return motion

    def rising(z: Array, kappa: Array, a: Array) -> Array:
        return jax.jvp(value, (z,), (beside(kappa, a)(z),))[1]

    def worst(z: Array) -> Callable[[Array], Array]:
        still = rising(z, curvatures[0], accelerations[0])
        kappa = jnp.where(rising(z, curvatures[1], accelerations[0]) > still, *curvatures[::-1])
        a = jnp.where(rising(z, curvatures[0], accelerations[1]) > still, *accelerations[::-1])
        reach = step * u[0]
        return beside(kappa, jnp.clip(a, (speeds[0] - z[0]) / reach, (speeds[1] - z[0]) / reach))

    start = value(z)
    highest = jnp.stack([rising(z, kappa, a) for kappa in curvatures for a in accelerations]).max(axis=0)
    required = jnp.maximum(decrease, per_metre * z[0])
    allowed = (start <= 1) & ((start < beta_lower) | (highest <= -required))
    return jnp.where(allowed, _first_exit(value, worst, z, step), jnp.inf)


def _first_exit(
    value: Callable[[Array], Array], motion_from: Callable[[Array], Callable[[Array], Array]], z: Array, step: Array
) -> Array:
    """When V passes 1 (s), within STEPS steps of RK4 along the motion that `motion_from` gives for each; else inf."""

    def move(at: Array, _: None) -> tuple[Array, Array]:
        at = runge_kutta(motion_from(at), at, step)
        return at, value(at)

    _, values = jax.lax.scan(move, z, None, length=STEPS)
    before = jnp.concatenate([value(z)[None], values[:-1]])
    share = jnp.clip((1 - before) / jnp.where(values > before, values - before, 1.0), 0.0, 1.0)
    return jnp.where(values > 1, (jnp.arange(STEPS)[:, None] + share) * step, jnp.inf).min(axis=0)
