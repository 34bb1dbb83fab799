"""The gradient learner: maximise the margin λ of condition (d) subject to (a), (b), (c).

A few random candidates are annealed together with the particles that hunt them (`cfjax.falsifier.minimax`), in rounds:
anneal, hunt every candidate afresh, let the worst and mutually distant points of both pools be the next particles. What
leaves is moved strictly inside (a)–(c) and falsified once more.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from cfjax.coerce import number, objects, whole
from cfjax.falsifier.falsifier import GROUPS, SEARCH, Counterexample, falsify, group_size, hunt, margin_scale
from cfjax.falsifier.minimax import Particles, Schedule, minimax, ridge_coordinates, spawn
from cfjax.funnel import Funnel, Template
from cfjax.funnel.conditions import chain_excess, dual_coordinates
from cfjax.funnel.instance import Chain, Instance, Unit, chain_of
from cfjax.funnel.levels import inner_level
from cfjax.problem import Method, Problem
from cfjax.traced import traced


LEARN = Schedule(steps=1500, learning_rate=(0.06, 6e-4), temperature=(0.1, 7e-4), step=(0.1, 1e-3))
PROBE = Schedule(steps=200, step=(0.3, 1e-3))  # between rounds
ROUNDS = 3
FIRST_STEPS = (0.05, 0.05, 0.025)  # of the particles at the start of each round, at least
KEPT_SHARE, KEPT_DISTANCE = 0.75, 0.03  # of the particles that go on to the next round
NEAR_STATIONS = 16  # of all stations: so far apart along θ, particles are distant
GAP = 1e-6  # relative, by which (a)–(c) hold in the end
CENTRES = (0.5, 0.25, 0.1, 0.03, 0.75, 0.9)  # shares, in logarithms, of the way from I outwards


Funnels = tuple[Funnel, ...]  # of the distinct segments of a path, in order


@dataclass(frozen=True)
class Learned:
    """The best funnels found, one for each distinct segment; `margin` is falsified (1/s), the least of them.

    `excess` of (a)–(c) and of the links between funnels is below zero where they hold.
    """

    funnels: Funnels
    margin: float
    excess: float
    margins: tuple[float, ...]  # balanced, of all candidates, best first: their spread tells how sure the optimum is
    steps: int

    @property
    def funnel(self) -> Funnel:
        """That of the first segment: all there is where every segment is alike."""
        return self.funnels[0]


def learn(
    problem: Problem,
    template: Template,
    *,
    beta_lower: float = 0.9,
    beta_inner: float | None = None,
    candidates: int = 4,
    seed: int = 0,
    warm: Funnels | None = None,
    counterexamples: Sequence[Counterexample] = (),
    tracking: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> Learned | None:
    """The funnels of the largest falsified margin along the whole path; None where no candidate satisfies (a)–(c).

    The funnels of a chain are learned together: each one's end lies in the start of the next. Path following starts
    from the solution of trajectory tracking too (unless `tracking` is false), so that it is never behind it. `warm` are
    funnels to start from, `counterexamples` are points that the particles of every candidate start from.
    """
    objects(problem=(problem, Problem), template=(template, Template))
    beta_lower = number("beta_lower", beta_lower, above=0, below=1)
    beta_inner = inner_level(beta_inner, beta_lower)
    candidates, seed = whole("candidates", candidates, 1), whole("seed", seed, 0)
    report = progress or (lambda done, of: None)
    tracking = tracking and problem.method is Method.PF and (problem.law is None or problem.law.keeps_time)
    passes = ROUNDS * (2 if tracking else 1)
    report(0, passes)
    anneal = _Annealing(template, beta_lower, beta_inner, candidates, seed)
    first = [funnels for funnels in (warm,) if funnels is not None]
    steps = 0
    if tracking:
        tracked = anneal(replace(problem, method=Method.TT), report=lambda done: report(done, passes))
        if tracked.chains:
            first.append(tracked.chains[int(np.argmax(tracked.quick))])
        steps += tracked.steps
    found = anneal(problem, first, counterexamples, report=lambda done: report(passes - ROUNDS + done, passes))
    if not found.chains:
        return None
    return replace(_best(problem, found, seed), steps=steps + found.steps)


class _Annealed(NamedTuple):
    """Candidates that satisfy (a)–(c), with their margins after a quick search (balanced)."""

    chain: Chain
    chains: list[Funnels]
    quick: list[float]
    steps: int


@dataclass(frozen=True)
class _Annealing:
    """Candidates and particles annealed together, in rounds, and moved inside (a)–(c)."""

    template: Template
    beta_lower: float
    beta_inner: float | None
    candidates: int
    seed: int

    def __call__(
        self,
        problem: Problem,
        first: Sequence[Funnels] = (),
        counterexamples: Sequence[Counterexample] = (),
        *,
        report: Callable[[int], None],
    ) -> _Annealed:
        """Candidates start from the funnels in `first`, then at random; counterexamples are points of the first one."""
        template, candidates = self.template, self.candidates
        chain = chain_of(problem, template, self.beta_lower, self.beta_inner, Unit.BALANCED)
        rng = np.random.default_rng(self.seed)
        factor, change = _starts(rng, candidates, chain, template)
        for k, funnels in enumerate(first[:candidates]):
            factor[k], rates = _unknowns(funnels)
            change[k] = rates * np.asarray(chain.funnels.duration)
        ridges = ridge_coordinates(problem.driven, chain)
        shape, stations = (*change.shape, group_size(chain)), chain.funnels.begin.shape[1]
        particles = spawn(rng, shape, ridges, stations)
        scale = margin_scale(problem.driven, template, chain, factor, change, particles)
        if counterexamples and first:
            particles = _include(particles, chain, first[0], counterexamples)

        for k in range(ROUNDS):
            part = LEARN.part(k, ROUNDS, FIRST_STEPS[k])
            outcome = minimax(problem.driven, template, chain, part, scale, factor, change, particles)
            factor, change, particles = outcome.factor, outcome.change, outcome.particles
            if k < ROUNDS - 1:
                found = hunt(problem.driven, template, chain, factor, change, rng, PROBE)
                pools = (particles, found.particles)
                particles = _merge(rng, pools, (outcome.margins, found.margins), ridges, stations)
            report(k + 1)

        inside = _Inside(problem, template, chain, self.beta_inner)
        moved = (inside(factor[i], change[i]) for i in range(candidates))
        chains = [funnels for funnels in moved if funnels]
        # the starts compete too: annealing may lose what they had (never so far, but PF ≥ TT must not hang on it)
        chains += [funnels for funnels in first if _excess_of(chain, funnels) < 0]
        quick = _quick_margins(problem, template, chain, chains, rng)
        return _Annealed(chain, chains, quick, LEARN.steps // ROUNDS * ROUNDS)


def _unknowns(funnels: Funnels) -> tuple[Float[np.ndarray, "f n n"], Float[np.ndarray, " f"]]:
    """Factors L with C⁻¹ = L Lᵀ, and rates."""
    factors = np.stack([np.linalg.cholesky(np.linalg.inv(funnel.shape)) for funnel in funnels])
    return factors, np.array([funnel.rate for funnel in funnels])


def _starts(
    rng: np.random.Generator, count: int, chain: Chain, template: Template
) -> tuple[Float[np.ndarray, "r f n n"], Float[np.ndarray, "r f"]]:
    """Random candidates: axes log-uniform between I and what G and S allow at the end, mildly rotated.

    All funnels of a candidate start alike, as if each had to lead from I to G.
    """
    first: Instance = jax.tree.map(lambda values: values[0], chain.funnels)
    size, funnels = len(first.inlet), len(chain.funnels.duration)
    low, high = (float(bound) for bound in first.change_bounds)
    change = np.clip(template.first_change(rng.uniform(size=count)), low, high)
    end = np.asarray(template.level(change, 1.0))[:, None]
    wide = np.maximum(np.minimum(first.goal / np.sqrt(end), first.safe) / first.inlet, 1.05)
    turn, _ = np.linalg.qr(np.eye(size) + 0.3 * rng.normal(size=(count, size, size)))
    axes = turn * (wide ** rng.uniform(0.05, 0.95, (count, size)))[:, None, :]
    factor = np.asarray(first.inlet)[:, None] * np.linalg.cholesky(axes @ axes.transpose(0, 2, 1))
    factor = factor * np.asarray(first.coupling)
    return np.repeat(factor[:, None], funnels, axis=1), np.repeat(change[:, None], funnels, axis=1)


def _include(particles: Particles, chain: Chain, warm: Funnels, counterexamples: Sequence[Counterexample]) -> Particles:
    """Put given points, free to move, in the place of the first particles of every candidate."""
    points, free, station = (values.copy() for values in particles)
    for index, funnel in enumerate(warm):
        own = [counterexample for counterexample in counterexamples if counterexample.segment == index][
            : points.shape[2]
        ]
        if not own:
            continue
        instance = jax.tree.map(lambda values, index=index: values[index], chain.funnels)
        at = np.array([int(np.argmin(np.abs(instance.begin - each.theta))) for each in own])
        w, s = dual_coordinates(instance, funnel, np.array([each.x for each in own]), at)
        points[:, index, : len(own)] = np.concatenate([w, s[:, None]], axis=1)
        free[:, index, : len(own)] = 1.0
        station[:, index, : len(own)] = at
    return Particles(points, free, station)


def _merge(
    rng: np.random.Generator,
    pools: tuple[Particles, ...],
    margins: tuple[np.ndarray, ...],
    ridges: np.ndarray,
    stations: int,
) -> Particles:
    """For each funnel of each candidate the worst, mutually distant points of the pools; the others fresh."""
    shape = margins[0].shape
    points, free, station = spawn(rng, shape, ridges, stations)
    for i in np.ndindex(*shape[:2]):
        order = np.argsort(np.concatenate([m[i] for m in margins]))
        pool = np.concatenate([p.points[i] for p in pools])[order]
        masks = np.concatenate([p.free[i] for p in pools])[order]
        places = np.concatenate([p.station[i] for p in pools])[order]
        near = np.linalg.norm(pool[:, None] - pool[None], axis=-1) < KEPT_DISTANCE
        near &= np.abs(places[:, None] - places[None]) <= stations // NEAR_STATIONS
        dropped, kept = np.zeros(len(order), bool), []
        for j in range(len(order)):
            if not dropped[j] and len(kept) < int(KEPT_SHARE * shape[2]):
                kept.append(j)
                dropped |= near[j]
        points[i][: len(kept)], free[i][: len(kept)], station[i][: len(kept)] = pool[kept], masks[kept], places[kept]
    return Particles(points, free, station)


def _excess(template: Template, chain: Chain, inverses: Float[np.ndarray, "f n n"], rates: np.ndarray) -> float:
    """Largest relative excess of (a), (b), (c) and the links, for C⁻¹ and rates: below zero where they hold."""
    return float(np.asarray(traced(chain_excess, template)(chain, np.linalg.cholesky(inverses), rates)).max())


def _excess_of(chain: Chain, funnels: Funnels) -> float:
    factors, rates = _unknowns(funnels)
    return _excess(funnels[0].template, chain, factors @ factors.transpose(0, 2, 1), rates)


@dataclass(frozen=True)
class _Inside:
    """Candidates moved strictly inside (a)–(c) and the links at the same rates; None where there is no room.

    For given rates the conditions on C⁻¹ are convex (linear matrix inequalities, and half-planes with one normal), so
    the least blend with ellipsoids that are well inside all of them is found by bisection.
    """

    problem: Problem
    template: Template
    chain: Chain
    beta_inner: float | None

    def __call__(self, factor: Float[np.ndarray, "f n n"], change: Float[np.ndarray, " f"]) -> Funnels | None:
        if not (np.isfinite(factor).all() and np.isfinite(change).all()):
            return None
        numbers = self.chain.funnels
        change = np.clip(change, *numbers.change_bounds)
        rates = change / np.asarray(numbers.duration)
        inverses = factor @ factor.transpose(0, 2, 1)
        share = 0.0
        if self._broken(inverses, rates):
            centre = self._centre(rates)
            if centre is None:
                return None
            bottom, share = 0.0, 1.0
            for _ in range(40):
                middle = 0.5 * (bottom + share)
                good = not self._broken((1 - middle) * inverses + middle * centre, rates)
                bottom, share = (bottom, middle) if good else (middle, share)
            inverses = (1 - share) * inverses + share * centre
        shapes = np.linalg.inv(inverses)
        beta_lower = float(np.asarray(numbers.beta_lower)[0])
        return tuple(
            Funnel(self.template, 0.5 * (shape + shape.T), rate, segment.duration, beta_lower, self.beta_inner)
            for shape, rate, segment in zip(shapes, map(float, rates), self.problem.path.distinct, strict=True)
        )

    def _broken(self, inverses: Float[np.ndarray, "f n n"], rates: np.ndarray) -> bool:
        return _excess(self.template, self.chain, inverses, rates) > -GAP

    def _centre(self, rates: Float[np.ndarray, " f"]) -> Float[np.ndarray, "f n n"] | None:
        """Ellipsoids strictly inside: one and the same for all, between I and what G and S allow at these rates."""
        numbers = self.chain.funnels
        inlet, goal, safe = (np.asarray(values)[0] for values in (numbers.inlet, numbers.goal, numbers.safe))
        levels = np.array([self.template.level(rate, t) for rate, t in zip(rates, numbers.duration, strict=True)])
        ending = np.asarray(numbers.ends) > 0
        end = float((levels[ending] if ending.any() else levels).max())
        if not end > 0:
            return None
        outer = np.minimum(goal**2 / end, safe**2 / max(levels.max(), 1.0))
        for share in CENTRES:
            centre = np.diag(outer**share * (inlet**2) ** (1 - share))
            found = np.repeat(centre[None], len(rates), axis=0)
            if not self._broken(found, rates):
                return found
        return None


def _quick_margins(
    problem: Problem, template: Template, chain: Chain, candidates: list[Funnels], rng: np.random.Generator
) -> list[float]:
    """Falsified margins of all candidates, one hunt each, in groups of the falsifier's own shape."""
    margins: list[float] = []
    for k in range(0, len(candidates), GROUPS):
        some = candidates[k : k + GROUPS]
        padded = some + some[-1:] * (GROUPS - len(some))
        factor, rates = (np.stack(each) for each in zip(*map(_unknowns, padded), strict=True))
        found = hunt(problem.driven, template, chain, factor, rates * np.asarray(chain.funnels.duration), rng, SEARCH)
        margins += list(found.margins.min(axis=(1, 2)))[: len(some)]
    return margins


def _best(problem: Problem, found: _Annealed, seed: int) -> Learned:
    """The candidate of the largest margin after a thorough search; one that loses by it gives way to the next."""

    def falsified(funnels: Funnels, unit: Unit) -> float:
        found = [
            point.slack
            for segment, funnel in zip(problem.path.distinct, funnels, strict=True)
            for point in falsify(problem, segment, funnel, seed=seed + 1, unit=unit)
            if point.condition == "d"
        ]
        return min(found)

    chain, candidates = found.chain, found.chains
    margins = np.array(found.quick)
    searched = np.zeros(len(candidates), bool)
    best = int(margins.argmax())
    while not searched[best]:
        margins[best], searched[best] = min(margins[best], falsified(candidates[best], Unit.BALANCED)), True
        best = int(margins.argmax())
    # balanced margins are margins in 1/s where there is one speed
    several = bool(np.ptp(np.asarray(chain.funnels.unit)) > 0)
    return Learned(
        funnels=candidates[best],
        margin=falsified(candidates[best], Unit.SECOND) if several else float(margins[best]),
        excess=_excess_of(chain, candidates[best]),
        margins=tuple(float(m) for m in sorted(margins, reverse=True)),
        steps=0,
    )
