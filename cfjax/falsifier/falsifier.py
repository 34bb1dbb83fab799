"""The falsifier: the worst point of every condition.

(a), (b), (c) have closed-form worst points. For (d) a batch of searchers descends the margin in dual coordinates
(`cfjax.funnel.conditions`), |b_i| rounded off less and less, part of them held on the ridges where inputs have no
authority: the lowest margins sit there, and plain sampling misses them by factors of two and more.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.funnel import Funnel, Template
from cfjax.funnel.conditions import Instance, decrease_margin, instance_of, shell_point
from cfjax.problem import Problem, Segment, Vehicle, affine_deviation


FIRST_STEP, LAST_STEP = 0.3, 3e-5  # of the descent, as parts of the unit sphere of covectors
ROUNDING = 0.1  # smoothing of |b_i| relative to step and scale: the kink is as wide as the step


class Searchers(NamedTuple):
    """Points in dual coordinates: `w` (unit covectors), `s` (fraction of the range of q); `free` 0 holds a coordinate."""

    w: Float[Array, "k n"]
    s: Float[Array, " k"]
    free: Float[Array, "k n"]


def start_searchers(key: Array, count: int, ridges: Float[Array, " n"]) -> Searchers:
    """Random searchers; each coordinate that is a ridge (1 in `ridges`) is held at zero by half of them."""
    key_w, key_s, key_free = jax.random.split(key, 3)
    size = ridges.shape[0]
    held = jax.random.bernoulli(key_free, 0.5, (count, size)) * ridges[None, :]
    w = jax.random.normal(key_w, (count, size)) * (1 - held)
    s = jax.random.uniform(key_s, (count,))
    return _normalised(Searchers(w, s, 1 - held))


def _normalised(searchers: Searchers) -> Searchers:
    w = searchers.w / jnp.linalg.norm(searchers.w, axis=1, keepdims=True)
    return searchers._replace(w=w, s=jnp.clip(searchers.s, 0.0, 1.0))


def margins_at(
    vehicle: Vehicle,
    template: Template,
    instance: Instance,
    factor: Float[Array, "n n"],
    rate: Array,
    searchers: Searchers,
    smoothing: Array | float = 0.0,
) -> Float[Array, " k"]:
    """The margin of condition (d), 1/s, at each searcher."""

    def one(w: Array, s: Array) -> Array:
        point = shell_point(template, instance, factor, rate, w, s)
        return decrease_margin(vehicle, template, instance, rate, point, smoothing)

    return jax.vmap(one)(searchers.w, searchers.s)


def descend(
    vehicle: Vehicle,
    template: Template,
    instance: Instance,
    factor: Float[Array, "n n"],
    rate: Array,
    searchers: Searchers,
    step: Array,
    scale: Array,
) -> Searchers:
    """One step of every searcher towards smaller margins; `step` on the unit sphere, `scale` of V̇ in 1/s."""

    def smooth(w: Array, s: Array) -> Array:
        w = w / jnp.sqrt(w @ w)
        point = shell_point(template, instance, factor, rate, w, s)
        return decrease_margin(vehicle, template, instance, rate, point, ROUNDING * step * scale)

    down_w, down_s = jax.vmap(jax.grad(smooth, argnums=(0, 1)))(searchers.w, searchers.s)
    down_w = down_w * searchers.free
    length = jnp.sqrt((down_w**2).sum(axis=1) + down_s**2) + 1e-30
    moved = searchers._replace(
        w=searchers.w - step * down_w / length[:, None], s=searchers.s - step * down_s / length
    )
    return _normalised(moved)


@partial(jax.jit, static_argnames=("vehicle", "template", "count", "steps"))
def search_shell(
    vehicle: Vehicle,
    template: Template,
    instance: Instance,
    factor: Float[Array, "n n"],
    rate: Array,
    ridges: Float[Array, " n"],
    key: Array,
    count: int,
    steps: int,
) -> tuple[Searchers, Float[Array, " k"]]:
    """Searchers at their (local) worst points of condition (d), and the margins there."""
    searchers = start_searchers(key, count, ridges)
    scale = jnp.std(margins_at(vehicle, template, instance, factor, rate, searchers))
    ratio = jnp.log(LAST_STEP / FIRST_STEP) / steps

    def body(k: int, searchers: Searchers) -> Searchers:
        return descend(vehicle, template, instance, factor, rate, searchers, FIRST_STEP * jnp.exp(ratio * k), scale)

    searchers = jax.lax.fori_loop(0, steps, body, searchers)
    return searchers, margins_at(vehicle, template, instance, factor, rate, searchers)


def ridge_coordinates(vehicle: Vehicle, instance: Instance) -> np.ndarray:
    """Which coordinates of the covector decide alone about an input's authority: 1 for each, else 0.

    An input attacks one state alone if its column of the dynamics has one entry that is not zero, wherever one looks.
    """
    size = len(vehicle.state_names)
    probes = np.random.default_rng(0).normal(size=(8, size)) * np.asarray(instance.inlet)[None, :]
    columns = np.abs(np.stack([np.asarray(affine_deviation(vehicle, jnp.asarray(x), instance.reference)[1]) for x in probes]))
    ridges = np.zeros(size)
    for column in columns.max(axis=0).T[1:]:  # the timing input attacks every state
        if np.count_nonzero(column) == 1:
            ridges[int(np.argmax(column))] = 1.0
    return ridges


@dataclass(frozen=True)
class WorstPoint:
    """Where a condition is closest to failing, or fails.

    `slack` is positive where the condition holds: for (d) the margin λ in 1/s, else dimensionless (1 − V, V − 1).
    """

    condition: str  # "a", "b", "c" or "d"
    slack: float
    theta: float  # s
    x: tuple[float, ...]  # deviation, in the units of the states


def falsify(
    problem: Problem, segment: Segment, funnel: Funnel, *, seed: int = 0, count: int = 1024, steps: int = 400
) -> tuple[WorstPoint, ...]:
    """The worst point that was found of each of (a), (b), (c), (d); the first three are exact up to rounding."""
    instance = instance_of(problem, segment, funnel.beta_lower)
    inverse = np.linalg.inv(funnel.shape)
    inlet, goal = np.array(problem.inlet.half_axes), np.array(problem.goal.half_axes)
    end = float(funnel.level(segment.duration))
    widest_at = 0.0 if end <= 1 else segment.duration
    widest = max(1.0, end)
    points: list[WorstPoint] = []

    def note(condition: str, slack: float, theta: float, x: np.ndarray) -> None:
        points.append(WorstPoint(condition, float(slack), theta, tuple(float(value) for value in x)))

    values, vectors = np.linalg.eigh(funnel.shape * np.outer(inlet, inlet))  # q on the boundary of I
    note("a", 1 - values[-1], 0.0, inlet * vectors[:, -1])
    values, vectors = np.linalg.eigh(funnel.shape * np.outer(goal, goal))
    note("b", values[0] / end - 1, segment.duration, goal * vectors[:, 0])
    safe = np.asarray(instance.safe)
    face = int(np.argmin(safe**2 / np.diag(inverse)))
    slack = safe[face] ** 2 / inverse[face, face] / widest - 1
    if np.isfinite(slack):
        note("c", slack, widest_at, safe[face] * inverse[:, face] / inverse[face, face])

    factor = jnp.asarray(np.linalg.cholesky(inverse))
    rate = jnp.asarray(funnel.rate, float)
    ridges = jnp.asarray(ridge_coordinates(problem.vehicle, instance))
    searchers, margins = search_shell(
        problem.vehicle, funnel.template, instance, factor, rate, ridges, jax.random.key(seed), count, steps
    )
    worst = int(jnp.nanargmin(margins))
    point = shell_point(funnel.template, instance, factor, rate, searchers.w[worst], searchers.s[worst])
    theta = _theta_in_shell(funnel, segment.duration, float(point.q))
    note("d", float(margins[worst]), theta, np.asarray(point.x))
    return tuple(points)


def _theta_in_shell(funnel: Funnel, duration: float, q: float) -> float:
    """A θ at which a deviation of form q lies in the shell and the demand on it is the largest."""
    grid = np.linspace(0.0, duration, 4001)
    values = np.asarray(funnel.template.value(funnel.rate, grid, q))
    inside = (values >= funnel.beta_lower - 1e-9) & (values <= 1 + 1e-9)
    demand = np.where(inside, 1 / np.asarray(funnel.template.scale(funnel.rate, grid)), -np.inf)
    return float(grid[int(np.argmax(demand))])
