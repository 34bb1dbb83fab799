"""The falsifier: the worst point of every condition.

(a), (b), (c) have closed-form worst points. For (d) a batch of particles descends the margin (`cfjax.falsifier.duel`),
part of them held on the ridges where inputs have no authority: the lowest margins sit there, and plain sampling misses
them by factors of two and more.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from cfjax.falsifier.duel import Outcome, Particles, Schedule, duel, ridge_coordinates, spawn
from cfjax.funnel import Funnel, Template
from cfjax.funnel.conditions import Instance, Unit, instance_of, shell_points
from cfjax.problem import Problem, Segment, Tube, Vehicle


SEARCH = Schedule(steps=400)
GROUPS, GROUP_SIZE = 4, 128  # the shapes of the learner's duel: the same compiled program


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


class Hunt(NamedTuple):
    """Particles at the (local) worst points of each candidate's condition (d), and the margins there, 1/s."""

    particles: Particles
    margins: Float[np.ndarray, "r k"]


def margin_scale(
    vehicle: Vehicle,
    template: Template,
    instance: Instance,
    factor: Float[np.ndarray, "r n n"],
    change: Float[np.ndarray, " r"],
    particles: Particles,
) -> Float[np.ndarray, " r"]:
    """Spread of each candidate's margin over random points of its shell, 1/s: the unit of a search's tolerances."""
    still = SEARCH._replace(steps=0)
    return duel(vehicle, template, instance, still, np.ones(len(factor)), factor, change, particles).margins.std(axis=1)


def hunt(
    vehicle: Vehicle,
    template: Template,
    instance: Instance,
    factor: Float[np.ndarray, "r n n"],
    change: Float[np.ndarray, " r"],
    rng: np.random.Generator,
    schedule: Schedule = SEARCH,
    count: int = GROUP_SIZE,
) -> Hunt:
    """Search each candidate's shell from fresh random particles."""
    particles = spawn(rng, len(factor), count, ridge_coordinates(vehicle, instance))
    scale = margin_scale(vehicle, template, instance, factor, change, particles)
    found: Outcome = duel(vehicle, template, instance, schedule, scale, factor, change, particles)
    # a particle that met NaN says nothing; a candidate of which none says anything has no margin at all
    lost = np.isnan(found.margins)
    return Hunt(found.particles, np.where(lost, np.where(lost.all(axis=1), -np.inf, np.inf)[:, None], found.margins))


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

    (d) is searched `rounds` times by 512 particles each; of a tube, at all its extreme references.
    """
    instance = instance_of(problem, segment, funnel.template, funnel.beta_lower, funnel.beta_inner, unit)
    inverse = np.linalg.inv(funnel.shape)
    inlet, goal = np.array(problem.inlet.half_axes), np.array(problem.goal.half_axes)
    end, last = funnel.end_level, 0.0 if isinstance(segment, Tube) else segment.duration
    widest_at = 0.0 if end <= 1 else last
    points: list[WorstPoint] = []

    def note(condition: str, slack: float, theta: float, x: np.ndarray) -> None:
        points.append(WorstPoint(condition, float(slack), theta, tuple(float(value) for value in x)))

    values, vectors = np.linalg.eigh(funnel.shape * np.outer(inlet, inlet))  # q on the boundary of I
    note("a", 1 - values[-1], 0.0, inlet * vectors[:, -1])
    values, vectors = np.linalg.eigh(funnel.shape * np.outer(goal, goal))
    note("b", values[0] / end - 1, last, goal * vectors[:, 0])
    safe = np.asarray(instance.safe)
    face = int(np.argmin(safe**2 / np.diag(inverse)))
    slack = safe[face] ** 2 / inverse[face, face] / max(1.0, end) - 1
    note("c", slack, widest_at, safe[face] * inverse[:, face] / inverse[face, face])

    factor = np.repeat(np.linalg.cholesky(inverse)[None], GROUPS, axis=0)
    change = np.full(GROUPS, funnel.rate * float(instance.duration))
    rng = np.random.default_rng(seed)
    found = [hunt(problem.vehicle, funnel.template, instance, factor, change, rng) for _ in range(rounds)]
    margins = np.concatenate([hunted.margins.ravel() for hunted in found])
    rows = np.concatenate([hunted.particles.points.reshape(-1, problem.dimension + 1) for hunted in found])
    worst = rows[np.argmin(margins)][None]
    w, s = jnp.asarray(worst[:, :-1]), jnp.asarray(worst[:, -1])
    x, q, _ = shell_points(funnel.template, instance, jnp.asarray(factor[0]), funnel.rate, w, s)
    theta = _theta_in_shell(funnel, last, float(q[0]))
    note("d", margins.min(), theta, np.asarray(x[0]))
    return tuple(points)


def _theta_in_shell(funnel: Funnel, duration: float, q: float) -> float:
    """A θ at which a deviation of form q lies in the shell and the demand on it is the largest."""
    grid = np.linspace(0.0, duration, 4001)
    values = np.asarray(funnel.template.value(funnel.rate, grid, q))
    inside = (values >= funnel.inner - 1e-9) & (values <= 1 + 1e-9)
    fading = np.minimum(1.0, values / funnel.beta_lower)
    demand = np.where(inside, fading / np.asarray(funnel.template.scale(funnel.rate, grid)), -np.inf)
    return float(grid[int(np.argmax(demand))])
