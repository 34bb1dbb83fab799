"""The duel: candidates and the particles that hunt their worst points, in one compiled program.

A candidate is a factor L (C⁻¹ = L Lᵀ) and a change (rate · duration). Each has its own particles, points of the shell
in the dual coordinates of `cfjax.funnel.conditions`. In every step

- each particle moves down the margin of condition (d) by a normalised step, |b_i| rounded off over the same length;
- the candidate moves, by Adam, up the soft minimum of its particles' margins less exact-penalty hinges of (a)–(c). The
  step is relative to the present ellipsoid, L ← L (I − lr A) with A lower triangular: units and shapes do not matter.

Steps, rounding and temperature shrink geometrically. With a learning rate of zero the candidates stand still and the
same program is the falsifier. All numbers of the problem and of the schedule are traced, so it compiles once per
vehicle and template whatever the path, the sets and PF or TT; it draws no random numbers, for a generator would be
most of its compile time.
"""

from functools import lru_cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from cfjax.funnel import Template
from cfjax.funnel.conditions import Instance, containment_excess, decrease_margins
from cfjax.problem import ReferencePoint, Vehicle, affine_deviation
from cfjax.problem.vehicle import Scalar


ROUNDING = 0.1  # of |b_i|, per particle step and scale of the margin
PENALTY = 0.5  # of a hinge of (a)–(c), in units of the scale: much larger and the hinges' kicks stall Adam
SLACK = 1e-4  # relative, to which the hinges keep off
ADAM = optax.scale_by_adam(b1=0.9, b2=0.99, eps=1e-12)
RIDGE_SHARE = 0.6  # of the particles that are held on each ridge


class Schedule(NamedTuple):
    """Pairs (first, last) of geometric sequences over `steps`."""

    steps: int
    learning_rate: tuple[float, float] = (0.0, 0.0)
    temperature: tuple[float, float] = (1.0, 1.0)  # of the soft minimum, in units of the scale
    step: tuple[float, float] = (0.3, 1e-5)  # of the particles, on the unit sphere

    def part(self, k: int, of: int, least_first_step: float) -> "Schedule":
        """The k-th of `of` equal parts, whose particles start with wide enough steps to reach new worst points."""

        def cut(pair: tuple[float, float]) -> tuple[float, float]:
            first, last = pair
            return tuple(first * (last / first) ** (j / of) for j in (k, k + 1)) if first else pair

        first, last = cut(self.step)
        return Schedule(
            self.steps // of,
            cut(self.learning_rate),
            cut(self.temperature),
            (max(first, least_first_step), last),
        )


class Particles(NamedTuple):
    """Points of the shell: rows (w, s) and masks with 0 where a coordinate is held on its ridge."""

    points: np.ndarray  # (candidates, particles, n + 1)
    free: np.ndarray


class Outcome(NamedTuple):
    """After a duel: candidates, particles and the margins (1/s) at the particles, exact |b_i|."""

    factor: Float[np.ndarray, "r n n"]
    change: Float[np.ndarray, " r"]
    particles: Particles
    margins: Float[np.ndarray, "r k"]


def spawn(rng: np.random.Generator, candidates: int, count: int, ridges: Float[np.ndarray, " n"]) -> Particles:
    """Random particles; each coordinate that is a ridge (1 in `ridges`) is held at zero by a share of them."""
    size = len(ridges)
    free = np.ones((candidates, count, size + 1))
    held = rng.uniform(size=(candidates, count, size)) < RIDGE_SHARE * ridges
    held[held.all(axis=-1)] = False
    free[..., :size][held] = 0.0
    points = np.concatenate(
        [rng.normal(size=(candidates, count, size)), rng.uniform(size=(candidates, count, 1))], axis=-1
    )
    points *= free
    points[..., :size] /= np.linalg.norm(points[..., :size], axis=-1, keepdims=True)
    return Particles(points, free)


def duel(
    vehicle: Vehicle,
    template: Template,
    instance: Instance,
    schedule: Schedule,
    scale: Float[np.ndarray, " r"],
    factor: Float[np.ndarray, "r n n"],
    change: Float[np.ndarray, " r"],
    particles: Particles,
) -> Outcome:
    """Run the schedule for all candidates at once; `scale` is the spread of each one's margins, 1/s."""
    traced = jax.tree.map(lambda value: np.asarray(value, float), schedule)._replace(steps=np.int64(schedule.steps))
    program = _program(vehicle, template)
    moved = program(instance, traced, scale, factor, change, particles.points, particles.free)
    factor, change, points, margins = map(np.asarray, moved)
    return Outcome(factor, change, Particles(points, particles.free), margins)


@lru_cache
def _program(vehicle: Vehicle, template: Template):
    return jax.jit(jax.vmap(partial(_run, vehicle, template), in_axes=(None, None, 0, 0, 0, 0, 0)))


def _normalised(points: Array) -> Array:
    w = points[:, :-1]
    return jnp.concatenate([w / jnp.linalg.norm(w, axis=1, keepdims=True), jnp.clip(points[:, -1:], 0, 1)], axis=1)


def _run(
    vehicle: Vehicle,
    template: Template,
    instance: Instance,
    schedule: Schedule,
    scale: Array,
    factor: Array,
    change: Array,
    points: Array,
    free: Array,
) -> tuple[Array, Array, Array, Array]:
    size = factor.shape[0]
    lower = np.tril_indices(size)

    def triangle(delta: Array) -> Array:
        return jnp.zeros((size, size)).at[lower].set(delta[:-1]) * instance.coupling

    def margins(factor: Array, change: Array, points: Array, smoothing: Array | float) -> Array:
        rate = change / instance.duration
        return decrease_margins(vehicle, template, instance, factor, rate, points[:, :-1], points[:, -1], smoothing)

    def loss(delta: Array, points: Array, factor: Array, change: Array, temperature: Array, smoothing: Array) -> Array:
        factor, change = factor + factor @ triangle(delta), change + delta[-1]
        at = margins(factor, change, _normalised(points), smoothing) / scale
        hinge = jax.nn.relu(containment_excess(template, instance, factor, change / instance.duration) + SLACK)
        # one gradient serves both players: a particle's own weight is positive and cancels when its step is normalised
        weight = jax.lax.stop_gradient(jax.nn.softmax(-at / temperature) + 1e-14)
        return -jnp.sum(weight * at) + PENALTY * (jnp.sum(hinge) + 10 * jnp.sum(hinge**2))

    def now(pair: tuple[Scalar, Scalar], i: Array) -> Array:
        first, last = pair
        ratio = jnp.where(first > 0, last / jnp.where(first > 0, first, 1.0), 1.0)
        return first * ratio ** (i / schedule.steps)

    def body(i: Array, carry: tuple) -> tuple:
        factor, change, adam, points = carry
        temperature, step = now(schedule.temperature, i), now(schedule.step, i)
        learning_rate = now(schedule.learning_rate, i) * jnp.minimum(1.0, i / 20)
        zero = jnp.zeros(len(lower[0]) + 1)
        gradient, down = jax.grad(loss, (0, 1))(zero, points, factor, change, temperature, ROUNDING * step * scale)
        down = down * free
        points = _normalised(points + step * down / (jnp.linalg.norm(down, axis=1, keepdims=True) + 1e-200))
        direction, adam = ADAM.update(gradient, adam)
        move = learning_rate * jnp.asarray(direction)
        change = jnp.where(learning_rate > 0, jnp.clip(change - move[-1], *instance.change_bounds), change)
        return factor - factor @ triangle(move), change, adam, points

    start = (factor, change, ADAM.init(jnp.zeros(len(lower[0]) + 1)), points)
    factor, change, _, points = jax.lax.fori_loop(0, schedule.steps, body, start)
    return factor, change, points, margins(factor, change, points, 0.0)


@partial(jax.jit, static_argnames="vehicle")
def _columns(vehicle: Vehicle, x: Float[Array, "k n"], reference: ReferencePoint) -> Float[Array, "k n m"]:
    return jax.vmap(lambda one: affine_deviation(vehicle, one, reference)[1])(x)


def ridge_coordinates(vehicle: Vehicle, instance: Instance) -> Float[np.ndarray, " n"]:
    """Which coordinates of the covector decide alone about an input's authority: 1 for each, else 0.

    An input attacks one state alone if its column of the dynamics has one entry that is not zero, wherever one looks.
    """
    probes = np.random.default_rng(0).normal(size=(8, len(instance.inlet))) * np.asarray(instance.inlet)[None, :]
    columns = _columns(vehicle, jnp.asarray(probes), jax.tree.map(lambda values: values[0], instance.nominal))
    ridges = np.zeros(len(instance.inlet))
    for column in np.abs(np.asarray(columns)).max(axis=0).T[1:]:  # the timing input attacks every state
        if np.count_nonzero(column > 1e-12) == 1:
            ridges[int(np.argmax(column))] = 1.0
    return ridges
