"""The falsifier: the worst point of every condition.

(a), (b), (c) have closed-form worst points. For (d) a batch of particles descends the margin
(`cfjax.falsifier.minimax`), part of them held on the ridges where inputs have no authority: the lowest margins sit
there, and plain sampling misses them by factors of two and more.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from cfjax.coerce import choice, instances, objects, refuse, whole
from cfjax.falsifier.minimax import MinimaxResult, Particles, Schedule, minimax, ridge_coordinates, spawn
from cfjax.funnel import Funnel, Template
from cfjax.funnel.conditions import containment_points, shell_points
from cfjax.funnel.funnel import require_fit
from cfjax.funnel.instance import Chain, Span, Unit, chain_of, instance_of
from cfjax.problem import Path, Problem, Segment, Tube, Vehicle
from cfjax.traced import traced


SEARCH = Schedule(steps=400)
GROUPS = 4  # the shapes of the learner's search: the same compiled program
GROUP_SIZE, PER_STATION = 128, 4  # particles of a funnel: at least, and at each station
PER_STRETCH = 96  # particles of a stretch that is looked at alone


def group_size(chain: Chain) -> int:
    """How many particles hunt each funnel of a candidate."""
    return max(GROUP_SIZE, PER_STATION * chain.funnels.begin.shape[1])


@dataclass(frozen=True)
class WorstPoint:
    """Where a condition is closest to failing, or fails.

    `slack` is positive where the condition holds: for (d) the margin λ in 1/s (or the
    unit asked for), else dimensionless: 1 − V for (a), and
    for (b) and (c) by how much q exceeds the funnel's level ρ, relative to ρ.
    """

    condition: str  # "a", "b", "c" or "d"
    slack: float
    theta: float  # s
    x: tuple[float, ...]  # deviation, in the units of the states


class Counterexample(NamedTuple):
    """A deviation that candidates are to hold against: of a path's distinct segment, at θ (s)."""

    segment: int
    theta: float
    x: tuple[float, ...]


class Hunt(NamedTuple):
    """Particles at the (local) worst points of each candidate's condition (d), and the margins there, 1/s."""

    particles: Particles
    margins: Float[np.ndarray, "r f k"]


def margin_scale(
    vehicle: Vehicle,
    template: Template,
    chain: Chain,
    factor: Float[np.ndarray, "r f n n"],
    change: Float[np.ndarray, "r f"],
    particles: Particles,
) -> Float[np.ndarray, " r"]:
    """Spread of each candidate's margin over random points of its shell, 1/s: the unit of a search's tolerances."""
    still = SEARCH._replace(steps=0)
    return minimax(vehicle, template, chain, still, np.ones(len(factor)), factor, change, particles).margins.std((1, 2))


def hunt(
    vehicle: Vehicle,
    template: Template,
    chain: Chain,
    factor: Float[np.ndarray, "r f n n"],
    change: Float[np.ndarray, "r f"],
    rng: np.random.Generator,
    schedule: Schedule = SEARCH,
) -> Hunt:
    """Search each candidate's shells from fresh random particles."""
    return _searched(vehicle, template, chain, factor, change, schedule, _fresh(vehicle, chain, change, rng))


def _fresh(vehicle: Vehicle, chain: Chain, change: Float[np.ndarray, "r f"], rng: np.random.Generator) -> Particles:
    stations = chain.funnels.begin.shape[1]
    return spawn(rng, (*change.shape, group_size(chain)), ridge_coordinates(vehicle, chain), stations)


def _searched(
    vehicle: Vehicle,
    template: Template,
    chain: Chain,
    factor: Float[np.ndarray, "r f n n"],
    change: Float[np.ndarray, "r f"],
    schedule: Schedule,
    particles: Particles,
) -> Hunt:
    scale = margin_scale(vehicle, template, chain, factor, change, particles)
    found: MinimaxResult = minimax(vehicle, template, chain, schedule, scale, factor, change, particles)
    return Hunt(found.particles, _without_nan(found.margins))


def _without_nan(margins: Float[np.ndarray, "r f k"]) -> Float[np.ndarray, "r f k"]:
    """A particle that met NaN says nothing; a candidate of which none says anything has no margin at all."""
    lost = np.isnan(margins)
    return np.where(lost, np.where(lost.all(axis=(1, 2), keepdims=True), -np.inf, np.inf), margins)


def require_question(problem: Problem, segment: Segment | Tube, funnel: Funnel) -> None:
    """Raises InputError unless the segment is one of the problem's path, and the funnel is of its states."""
    objects(problem=(problem, Problem), funnel=(funnel, Funnel))
    if not any(isinstance(segment, type(own)) and segment == own for own in problem.path.distinct):
        refuse("segment", "one of problem.path.distinct", segment)
    require_fit(problem, [funnel])


def falsify(
    problem: Problem,
    segment: Segment | Tube,
    funnel: Funnel,
    *,
    seed: int = 0,
    rounds: int = 4,
    unit: Unit = Unit.SECOND,
) -> tuple[WorstPoint, ...]:
    """The worst point that was found of each of (a), (b), (c), (d); the first three are exact up to rounding.

    (d) is searched `rounds` times by at least 512 particles; of a tube, at all its extreme references, along a segment
    that varies, at its stations.
    """
    require_question(problem, segment, funnel)
    seed, rounds = whole("seed", seed, 0), whole("rounds", rounds, 1)
    unit = choice("unit", unit, Unit)
    alone = replace(problem, path=Path(problem.path.name, (segment,)))  # its sets are told apart below
    chain = chain_of(alone, funnel.template, funnel.beta_lower, funnel.beta_inner, unit)
    here = instance_of(problem, segment, funnel.template, funnel.beta_lower, funnel.beta_inner)
    last = segment.last_theta
    points = [
        WorstPoint(condition, float(slack), theta, tuple(float(value) for value in x))
        for condition, slack, theta, x in containment_points(here, funnel, last)
    ]

    factor = np.repeat(np.linalg.cholesky(np.linalg.inv(funnel.shape))[None, None], GROUPS, axis=0)
    change = np.full((GROUPS, 1), funnel.rate * float(here.duration))
    rng = np.random.default_rng(seed)
    search = partial(_searched, problem.driven, funnel.template, chain, factor, change, SEARCH)
    with ThreadPoolExecutor(rounds) as pool:  # XLA runs a search on one core
        found = list(pool.map(search, [_fresh(problem.driven, chain, change, rng) for _ in range(rounds)]))
    margins = np.concatenate([hunted.margins.ravel() for hunted in found])
    rows = np.concatenate([hunted.particles.points.reshape(-1, problem.dimension + 1) for hunted in found])
    stations = np.concatenate([hunted.particles.station.ravel() for hunted in found])
    worst = [int(np.argmin(margins))]
    w, s, station = rows[worst, :-1], rows[worst, -1], stations[worst]
    x, q, _ = traced(shell_points, funnel.template)(here, factor[0, 0], funnel.rate, w, s, station)
    begin, until = float(here.begin[stations[worst[0]]]), float(here.end[stations[worst[0]]])
    theta = _theta_in_shell(funnel, begin, min(until, last), float(np.asarray(q)[0]))
    points.append(WorstPoint("d", float(margins.min()), theta, tuple(float(value) for value in np.asarray(x)[0])))
    return tuple(points)


def stretch_margins(
    problem: Problem, segment: Segment, funnel: Funnel, stretches: Sequence[Span], *, seed: int = 0
) -> Float[np.ndarray, " s"]:
    """The margin of (d) on each stretch of a segment, as set of references, that its particles found: λ in 1/s.

    What a proof of the stretch can show at most, and nearly what it does show. One program for every call with as many
    stretches.
    """
    require_question(problem, segment, funnel)
    stretches, seed = instances("stretches", stretches, Span), whole("seed", seed, 0)
    levels = funnel.beta_lower, funnel.beta_inner
    instance = instance_of(problem, segment, funnel.template, *levels, stretches=stretches)
    chain = Chain(jax.tree.map(lambda values: np.asarray(values)[None], instance), np.zeros((0, 2), int))
    factor = np.linalg.cholesky(np.linalg.inv(funnel.shape))[None, None]
    change = np.full((1, 1), funnel.rate * segment.duration)
    rng = np.random.default_rng(seed)
    particles = spawn(
        rng, (1, 1, PER_STRETCH * len(stretches)), ridge_coordinates(problem.driven, chain), len(stretches)
    )
    scale = margin_scale(problem.driven, funnel.template, chain, factor, change, particles)
    found = minimax(problem.driven, funnel.template, chain, SEARCH, scale, factor, change, particles)
    of_stretch = found.particles.station[0, 0][None] == np.arange(len(stretches))[:, None]
    margins = [_without_nan(found.margins[:, :, own]).min() for own in of_stretch]
    return np.array(margins)


def _theta_in_shell(funnel: Funnel, begin: float, end: float, q: float) -> float:
    """A θ at which a deviation of form q lies in the shell and the demand on it is the largest."""
    grid = np.linspace(begin, end, 4001)
    values = np.asarray(funnel.template.value(funnel.rate, grid, q))
    inside = (values >= funnel.inner - 1e-9) & (values <= 1 + 1e-9)
    fading = np.minimum(1.0, values / funnel.beta_lower)
    demand = np.where(inside, fading / np.asarray(funnel.template.scale(funnel.rate, grid)), -np.inf)
    return float(grid[int(np.argmax(demand))])
