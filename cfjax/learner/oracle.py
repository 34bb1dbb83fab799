"""The oracle of the polytope learner: is this candidate a funnel of the margin asked for?

It looks at (a), (b), (c) first, in closed form; a candidate that satisfies them goes to the falsifier. The worst points
that are found become witnesses, each with a demonstrated input.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from cfjax.falsifier.falsifier import GROUPS, SEARCH, hunt
from cfjax.falsifier.minimax import Schedule
from cfjax.funnel import Funnel, Template
from cfjax.funnel.conditions import shell_points
from cfjax.funnel.instance import Chain, Instance
from cfjax.learner.centre import Polytope
from cfjax.learner.clearance_cuts import clearance_cuts
from cfjax.learner.coefficients import Coordinates
from cfjax.learner.demonstrations import Demonstrate, demonstrated, vertices
from cfjax.learner.elimination import Elimination
from cfjax.learner.localise import GivenUp, Localised, Reply, Undecided
from cfjax.learner.revision import revised
from cfjax.learner.run import EliminationRun
from cfjax.learner.witnesses import Witnesses, dynamics, falling
from cfjax.problem import Problem


QUICK = SEARCH._replace(steps=200)  # for candidates that are likely to fail
ACCEPTING = 4  # thorough hunts without a find, by which a candidate is accepted
DISTANT = 0.2  # between witnesses of a batch, in dual coordinates
CLIMB = 1.05  # margin asked for next over the one found
PATIENCE = 25  # candidates in a row without a funnel, after which demonstrations are not revised any more


class Hunted(NamedTuple):
    """Particles of the falsifier, as `cfjax.falsifier.falsifier.Hunt` has them, of one candidate."""

    points: Float[np.ndarray, "k d"]
    station: Int[np.ndarray, " k"]
    margins: Float[np.ndarray, " k"]  # 1/s


@dataclass
class FunnelOracle:
    """Answers candidates c of one search (`cfjax.learner.localise`); keeps the witnesses and the best funnel."""

    problem: Problem
    template: Template
    chain: Chain
    coordinates: Coordinates
    demonstrate: Demonstrate | None
    how: Elimination
    target: float  # 1/s, at present
    seed: int
    witnesses: Witnesses = field(init=False)
    contained: Polytope = field(init=False)  # half-spaces of (a), (b), (c)
    best: tuple[float, Funnel | None] = (-math.inf, None)
    outgrown: int = 0  # funnels that were found and asked for more
    idle: int = 0  # candidates since then
    half_planes: int = 0  # that were chosen beside obstacles

    def __post_init__(self) -> None:
        self.witnesses = Witnesses.none(self.problem)
        self.contained = self._nothing()
        self.rng = np.random.default_rng(self.seed)
        self.instance: Instance = jax.tree.map(lambda values: values[0], self.chain.funnels)

    def __call__(self, c: Float[np.ndarray, " r"]) -> Reply:
        self.idle += 1
        if self.how.revise and self.idle > PATIENCE:
            raise GivenUp
        cuts = self.coordinates.broken(c)
        if not len(cuts):
            cuts = clearance_cuts(self.coordinates, self.instance.clearance, c, self.how.batch)
            self.half_planes += len(cuts)
        if len(cuts):
            self.contained = self.contained.cut(cuts)
            return Reply(cuts)
        funnel = self.coordinates.funnel(c)
        margin, hunted = self._hunt(funnel)
        if margin >= self.target:
            if margin > self.best[0]:
                self.best = margin, funnel
            if not self.how.climb:
                return Reply(self._nothing())
            self.target, self.outgrown, self.idle = CLIMB * margin, self.outgrown + 1, 0
        theta, x = self._worst(funnel, hunted)
        if not len(theta):
            raise Undecided("falsifier: no margin, and no point at which there is none")
        new = self._witnesses(funnel, theta, x)
        self.witnesses = self.witnesses.and_(new)
        if self.how.revise:
            self.witnesses = revised(self.problem, self.coordinates, self.witnesses, self.target, self.contained)
        if self.how.revise or self.outgrown:  # all demonstrations are new, or are held to a new margin
            return Reply(self.contained.cut(falling(self.coordinates, self.witnesses, self.target)), afresh=True)
        return Reply(falling(self.coordinates, new, self.target))

    def run(self, search: Localised) -> EliminationRun:
        """The whole search in one object."""
        margin, funnel = self.best
        return EliminationRun(
            self.how, self.coordinates, search, funnel, margin, self.target, self.witnesses, self.half_planes
        )

    def _nothing(self) -> Polytope:
        return Polytope(np.zeros((0, len(self.coordinates.lower))), np.zeros(0))

    def _hunt(self, funnel: Funnel) -> tuple[float, Hunted]:
        """The least margin found, and all that was found: quickly, and if nothing falls short, thoroughly."""
        factor = np.linalg.cholesky(np.linalg.inv(funnel.shape))
        found: list[Hunted] = []
        least = math.inf
        for schedule in (QUICK, *(SEARCH,) * ACCEPTING):
            found.append(self._particles(funnel, factor, schedule))
            least = min(least, float(found[-1].margins.min()))
            if not least >= self.target:
                break
        return least, Hunted(*(np.concatenate(each) for each in zip(*found, strict=True)))

    def _particles(self, funnel: Funnel, factor: Float[np.ndarray, "n n"], schedule: Schedule) -> Hunted:
        factors = np.repeat(factor[None, None], GROUPS, axis=0)
        change = np.full((GROUPS, 1), funnel.rate * funnel.duration)
        found = hunt(self.problem.driven, self.template, self.chain, factors, change, self.rng, schedule)
        points = found.particles.points.reshape(-1, self.problem.dimension + 1)
        return Hunted(points, found.particles.station.ravel(), found.margins.ravel())

    def _worst(self, funnel: Funnel, hunted: Hunted) -> tuple[Float[np.ndarray, " b"], Float[np.ndarray, "b n"]]:
        """The worst, mutually distant points below what is asked: θ and x."""
        points, station, margins = hunted
        kept: list[int] = []
        for j in np.argsort(margins):
            if len(kept) == self.how.batch or not margins[j] < self.target:
                break
            if not np.isfinite(points[j]).all():
                continue
            apart = np.linalg.norm(points[kept] - points[j], axis=1) + np.abs(station[kept] - station[j]) / 8
            if not kept or apart.min() > DISTANT:
                kept.append(int(j))
        if not kept:
            return np.zeros(0), np.zeros((0, self.problem.dimension))
        at = np.array((kept * self.how.batch)[: self.how.batch])  # always as many: one compiled program
        factor = jnp.asarray(np.linalg.cholesky(np.linalg.inv(funnel.shape)))
        w, s = jnp.asarray(points[at, :-1]), jnp.asarray(points[at, -1])
        x, q, _ = map(
            np.asarray, shell_points(self.template, self.instance, factor, funnel.rate, w, s, jnp.asarray(station[at]))
        )
        finite = np.isfinite(x).all(axis=1) & (np.arange(len(at)) < len(kept))
        begin, end = np.asarray(self.instance.begin)[station[at]], np.asarray(self.instance.end)[station[at]]
        full = np.array([self._full_at(funnel.rate, value) for value in q.tolist()])
        return np.clip(full, begin, end)[finite], x[finite]

    def _full_at(self, rate: float, q: float) -> float:
        """Where V = 1 for a deviation with form q: the demand is the largest there, or at the nearest θ there is."""
        return float(self.template.reaching(rate, q, 1.0)) if rate else 0.0

    def _witnesses(self, funnel: Funnel, theta: Float[np.ndarray, " k"], x: Float[np.ndarray, "k n"]) -> Witnesses:
        drift, columns = dynamics(self.problem, theta, x)
        if self.demonstrate is None:
            inputs = vertices(self.problem, self.template, funnel.rate, funnel.shape, x, columns)
        else:
            inputs = demonstrated(self.problem, self.demonstrate, theta, x)
        level = np.asarray(self.template.value(funnel.rate, theta, np.einsum("ki,ij,kj->k", x, funnel.shape, x)))
        return Witnesses(theta, x, level, inputs, drift, columns)
