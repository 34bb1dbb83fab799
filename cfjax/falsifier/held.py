"""Inputs that are held: how soon a car can leave the funnel after a law has chosen them. Found, not proven.

A law that inherits a certificate may choose any input of the box with V̇ ≤ −λ' on the shell, and any at all inside it.
The adversary picks state and input; what it finds lies above every control period that is proven.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.funnel import Funnel, Template
from cfjax.problem import Path, Problem, Segment, Vehicle, deviation_rate
from cfjax.problem.course import Pieces, point_at, profiles_of


STEPS = 64  # of the horizon, by RK4; between two of them V counts as linear
TRIALS = 2**17  # pairs of state and input, drawn anew around the worst ones in each round
ROUNDS, NARROWER, KEPT = 6, 0.5, 64


def first_escape(
    problem: Problem, segment: Segment, funnel: Funnel, decrease: float, horizon: float, seed: int = 0
) -> float:
    """The shortest time (s) found in which inputs held for it lead from V ≤ 1 out of it; infinite if above the horizon.

    The law is one that reaches V̇ ≤ −decrease (1/s) on the shell.
    """
    rng = np.random.default_rng(seed)
    lower, upper = (np.array([getattr(box, end) for box in problem.inputs]) for end in ("lower", "upper"))
    last = funnel.duration - upper[0] * horizon  # θ that stays on the segment
    unit = np.linalg.inv(np.linalg.cholesky(funnel.shape)).T
    profiles = jax.tree.map(jnp.asarray, profiles_of(Path("segment", (segment,))))
    numbers = jnp.array([funnel.rate, funnel.beta_lower, decrease])

    def draw(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """θ as a share, directions times √V, inputs as shares: corners of the box for most."""
        y = rng.normal(size=(size, problem.dimension))
        y /= np.linalg.norm(y, axis=1, keepdims=True)
        y *= np.sqrt(np.where(rng.uniform(size=size) < 0.5, 1.0, rng.uniform(0.5, 1.0, size=size)))[:, None]
        shares = rng.uniform(size=(size, len(lower)))
        return rng.uniform(size=size), y, np.where(rng.uniform(size=(size, 1)) < 0.75, np.round(shares), shares)

    theta, y, shares = draw(TRIALS)
    best = np.inf
    for round_ in range(ROUNDS):
        level = funnel.template.level(funnel.rate, last * theta)
        x = (y @ unit.T) * np.sqrt(np.asarray(level))[:, None]
        z, u = np.column_stack([last * theta, x]), lower + shares * (upper - lower)
        found = _leaving(
            problem.vehicle, funnel.template, profiles, jnp.asarray(funnel.shape), numbers, z.T, u.T, horizon
        )
        times = np.asarray(found)
        best = min(best, float(times.min()))
        worst = np.argsort(times)[:KEPT]
        if not np.isfinite(times[worst[0]]):
            theta, y, shares = draw(TRIALS)
            continue
        near = worst[rng.integers(np.isfinite(times[worst]).sum(), size=TRIALS)]
        width = 0.3 * NARROWER**round_
        theta = np.clip(theta[near] + width * rng.normal(size=TRIALS), 0, 1)
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
    numbers: Float[Array, " 3"],
    z: Float[Array, "1+n k"],
    u: Float[Array, "m k"],
    horizon: Float[Array, ""],
) -> Float[Array, " k"]:
    """When V passes 1 (s); infinite where it does not, or where the law may not choose this input."""
    rate, beta_lower, decrease = numbers
    step = horizon / STEPS

    def value(z: Array) -> Array:
        return template.value(rate, z[0], jnp.einsum("ik,ij,jk->k", z[1:], shape, z[1:]))

    def motion(z: Array) -> Array:
        rates = deviation_rate(vehicle, tuple(z[1:]), tuple(u), point_at(profiles, profiles.find(z[0]), z[0]))
        return jnp.stack(jnp.broadcast_arrays(u[0], *rates))

    def move(at: Array, _: None) -> tuple[Array, Array]:
        k1 = motion(at)
        k2 = motion(at + step / 2 * k1)
        k3 = motion(at + step / 2 * k2)
        at = at + step / 6 * (k1 + 2 * k2 + 2 * k3 + motion(at + step * k3))
        return at, value(at)

    start, rising = jax.jvp(value, (z,), (motion(z),))
    allowed = (start <= 1) & ((start < beta_lower) | (rising <= -decrease))
    _, values = jax.lax.scan(move, z, None, length=STEPS)
    before = jnp.concatenate([start[None], values[:-1]])
    share = jnp.clip((1 - before) / jnp.where(values > before, values - before, 1.0), 0.0, 1.0)
    times = jnp.where(values > 1, (jnp.arange(STEPS)[:, None] + share) * step, jnp.inf)
    return jnp.where(allowed, times.min(axis=0), jnp.inf)
