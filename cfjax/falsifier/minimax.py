"""The minimax search: candidates and the particles that hunt their worst points, in one compiled program.

A candidate is a chain of funnels, one for each distinct segment of the path: factors L (C⁻¹ = L Lᵀ) and changes
(rate · duration). Each funnel has its own particles, points of the shell in the dual coordinates of
`cfjax.funnel.conditions`, each at its station. In every step

- each particle moves down the margin of condition (d) by a normalised step, |b_i| rounded off over the same length;
- the candidate moves, by Adam, up the soft minimum of all its particles' margins less exact-penalty hinges of (a)–(c)
  and of the links from funnel to funnel. The
  step is relative to the present ellipsoid, L ← L (I − lr A) with A lower triangular: units and shapes do not matter.

Steps, rounding and temperature shrink geometrically. With a learning rate of zero the candidates stand still and the
same program is the falsifier. All numbers of the problem and of the schedule are traced, so it compiles once per
vehicle and template whatever the path, the sets and PF or TT; it draws no random numbers, for a generator would be
most of its compile time.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from cfjax.funnel import Template
from cfjax.funnel.conditions import chain_excess, decrease_margins
from cfjax.funnel.instance import Chain, Instance
from cfjax.problem import ReferencePoint, Vehicle, affine_deviation
from cfjax.problem.feedback import Steered
from cfjax.problem.traced_vehicle import traced_vehicle
from cfjax.problem.vehicle import Scalar
from cfjax.traced import traced


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
    """Points of the shell: rows (w, s), masks with 0 where a coordinate is held on its ridge, and their stations."""

    points: np.ndarray  # (candidates, funnels, particles, n + 1)
    free: np.ndarray
    station: np.ndarray  # (candidates, funnels, particles)


class MinimaxResult(NamedTuple):
    """After a search: candidates, particles and the margins (1/s) at the particles, exact |b_i|."""

    factor: Float[np.ndarray, "r f n n"]
    change: Float[np.ndarray, "r f"]
    particles: Particles
    margins: Float[np.ndarray, "r f k"]


def spawn(
    rng: np.random.Generator, shape: tuple[int, int, int], ridges: Float[np.ndarray, " n"], stations: int
) -> Particles:
    """Random particles, `shape` = (candidates, funnels, particles), evenly over the stations.

    Each coordinate that is a ridge (1 in `ridges`) is held at zero by a share of them.
    """
    size = len(ridges)
    free = np.ones((*shape, size + 1))
    held = rng.uniform(size=(*shape, size)) < RIDGE_SHARE * ridges
    held[held.all(axis=-1)] = False
    free[..., :size][held] = 0.0
    points = np.concatenate([rng.normal(size=(*shape, size)), rng.uniform(size=(*shape, 1))], axis=-1)
    points *= free
    points[..., :size] /= np.linalg.norm(points[..., :size], axis=-1, keepdims=True)
    return Particles(points, free, np.broadcast_to(np.arange(shape[-1]) % stations, shape).copy())


def minimax(
    vehicle: Vehicle,
    template: Template,
    chain: Chain,
    schedule: Schedule,
    scale: Float[np.ndarray, " r"],
    factor: Float[np.ndarray, "r f n n"],
    change: Float[np.ndarray, "r f"],
    particles: Particles,
) -> MinimaxResult:
    """Run the schedule for all candidates at once; `scale` is the spread of each one's margins, 1/s."""
    numbers = jax.tree.map(lambda value: np.asarray(value, float), schedule)._replace(steps=np.int64(schedule.steps))
    moved = traced(_run, traced_vehicle(vehicle), template)(chain, numbers, scale, factor, change, *particles)
    factor, change, points, margins = map(np.asarray, moved)
    return MinimaxResult(factor, change, particles._replace(points=points), margins)


def _normalised(points: Array) -> Array:
    w = points[..., :-1]
    return jnp.concatenate([w / jnp.linalg.norm(w, axis=-1, keepdims=True), jnp.clip(points[..., -1:], 0, 1)], axis=-1)


def _run(
    vehicle: Vehicle,
    template: Template,
    chain: Chain,
    schedule: Schedule,
    scale: Array,
    factor: Array,
    change: Array,
    points: Array,
    free: Array,
    station: Array,
) -> tuple[Array, Array, Array, Array]:
    _, funnels, size, _ = factor.shape
    lower = np.tril_indices(size)
    duration = jnp.asarray(chain.funnels.duration)
    lowest, highest = chain.funnels.change_bounds

    def triangle(delta: Array) -> Array:
        filled = jnp.zeros((funnels, size, size)).at[:, lower[0], lower[1]].set(delta[:, :-1])
        return filled * chain.funnels.coupling

    def margins(factor: Array, change: Array, points: Array, station: Array, smoothing: Array | float) -> Array:
        def of_funnel(instance: Instance, factor: Array, rate: Array, points: Array, station: Array) -> Array:
            w, s = points[:, :-1], points[:, -1]
            return decrease_margins(vehicle, template, instance, factor, rate, w, s, station, smoothing)

        return jax.vmap(of_funnel)(chain.funnels, factor, change / duration, points, station)

    def loss(
        delta: Array, points: Array, station: Array, scale: Array, factor: Array, change: Array, now: "_Now"
    ) -> Array:
        factor, change = factor + factor @ triangle(delta), change + delta[:, -1]
        at = margins(factor, change, _normalised(points), station, ROUNDING * now.step * scale) / scale
        hinge = jax.nn.relu(chain_excess(template, chain, factor, change / duration) + SLACK)
        # one gradient serves both players: a particle's own weight is positive and cancels when its step is normalised
        weight = jax.lax.stop_gradient(jax.nn.softmax(-at / now.temperature, axis=(0, 1)) + 1e-14)
        return -jnp.sum(weight * at) + PENALTY * (jnp.sum(hinge) + 10 * jnp.sum(hinge**2))

    def moved(now: "_Now", scale: Array, free: Array, station: Array, carry: tuple) -> tuple:
        """One step of one candidate and its particles."""
        factor, change, adam, points = carry
        zero = jnp.zeros((funnels, len(lower[0]) + 1))
        gradient, down = jax.grad(loss, (0, 1))(zero, points, station, scale, factor, change, now)
        down = down * free
        points = _normalised(points + now.step * down / (jnp.linalg.norm(down, axis=-1, keepdims=True) + 1e-200))
        direction, adam = ADAM.update(gradient, adam)
        move = now.learning_rate * jnp.asarray(direction)
        change = jnp.where(now.learning_rate > 0, jnp.clip(change - move[:, -1], lowest, highest), change)
        return factor - factor @ triangle(move), change, adam, points

    def body(i: Array, carry: tuple) -> tuple:
        # candidates side by side in each step: a loop for each of them would be traced three times over
        return jax.vmap(partial(moved, _now(schedule, i)))(scale, free, station, carry)

    adam = jax.vmap(ADAM.init)(jnp.zeros((len(factor), funnels, len(lower[0]) + 1)))
    factor, change, _, points = jax.lax.fori_loop(0, schedule.steps, body, (factor, change, adam, points))
    return factor, change, points, jax.vmap(partial(margins, smoothing=0.0))(factor, change, points, station)


class _Now(NamedTuple):
    """The schedule's numbers at one step."""

    learning_rate: Array
    temperature: Array
    step: Array


def _now(schedule: Schedule, i: Array) -> _Now:
    def at(pair: tuple[Scalar, Scalar]) -> Array:
        first, last = pair
        ratio = jnp.where(first > 0, last / jnp.where(first > 0, first, 1.0), 1.0)
        return first * ratio ** (i / schedule.steps)

    warming = jnp.minimum(1.0, i / 20)
    return _Now(at(schedule.learning_rate) * warming, at(schedule.temperature), at(schedule.step))


def _columns(vehicle: Vehicle, x: Float[Array, "k n"], reference: ReferencePoint) -> Float[Array, "k n m"]:
    return jax.vmap(lambda one: affine_deviation(vehicle, one, reference)[1])(x)


def ridge_coordinates(vehicle: Vehicle, chain: Chain) -> Float[np.ndarray, " n"]:
    """Which coordinates of the covector decide alone about an input's authority: 1 for each, else 0.

    An input attacks one state alone if its column of the dynamics has one entry that is not zero, wherever one looks.
    Inputs that a law gives are no choice, so that nothing is decided there.
    """
    unit = np.asarray(chain.funnels.inlet)[0]
    probes = np.random.default_rng(0).normal(size=(8, len(unit))) * unit[None, :]
    columns = traced(_columns, traced_vehicle(vehicle))(
        probes, jax.tree.map(lambda values: values.flat[0], chain.funnels.nominal)
    )
    ridges = np.zeros(len(unit))
    if isinstance(vehicle, Steered):
        return ridges
    for column in np.abs(np.asarray(columns)).max(axis=0).T[1:]:  # the timing input attacks every state
        if np.count_nonzero(column > 1e-12) == 1:
            ridges[int(np.argmax(column))] = 1.0
    return ridges
