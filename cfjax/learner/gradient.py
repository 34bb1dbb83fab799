"""The gradient learner: maximise the margin λ of condition (d) subject to (a), (b), (c).

A few random candidates are annealed together with the particles that hunt them (`cfjax.falsifier.duel`), in rounds:
anneal, hunt every candidate afresh, let the worst and mutually distant points of both pools be the next particles. What
leaves is moved strictly inside (a)–(c) and falsified once more.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from cfjax.falsifier.duel import Particles, Schedule, duel, ridge_coordinates, spawn
from cfjax.falsifier.falsifier import GROUP_SIZE, GROUPS, SEARCH, falsify, hunt, margin_scale
from cfjax.funnel import Funnel, Template
from cfjax.funnel.conditions import Instance, Unit, dual_coordinates, instance_of
from cfjax.problem import Method, Problem, Segment, Tube


LEARN = Schedule(steps=1500, learning_rate=(0.06, 6e-4), temperature=(0.1, 7e-4), step=(0.1, 1e-3))
PROBE = Schedule(steps=200, step=(0.3, 1e-3))  # between rounds
ROUNDS = 3
FIRST_STEPS = (0.05, 0.05, 0.025)  # of the particles at the start of each round, at least
KEPT_SHARE, KEPT_DISTANCE = 0.75, 0.03  # of the particles that go on to the next round
GAP = 1e-6  # relative, by which (a)–(c) hold in the end


@dataclass(frozen=True)
class Learned:
    """The best funnel found; `margin` is falsified (1/s), `excess` of (a)–(c) is below zero where they hold."""

    funnel: Funnel
    margin: float
    excess: float
    margins: tuple[float, ...]  # balanced, of all candidates, best first: their spread tells how sure the optimum is
    steps: int


def learn(
    problem: Problem,
    segment: Segment | Tube,
    template: Template,
    *,
    beta_lower: float = 0.9,
    beta_inner: float | None = None,
    candidates: int = 4,
    seed: int = 0,
    warm: Funnel | None = None,
    counterexamples: Float[np.ndarray, "k n"] | None = None,
    tracking: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> Learned | None:
    """The funnel of the largest falsified margin; None where no candidate satisfies (a)–(c).

    Path following starts from the solution of trajectory tracking too (unless `tracking` is false), so that it is never
    behind it. `warm` is a funnel to start from, `counterexamples` are deviations x that the particles of every
    candidate start from.
    """
    instance = instance_of(problem, segment, template, beta_lower, beta_inner, Unit.BALANCED)
    rng = np.random.default_rng(seed)
    first = [funnel for funnel in (warm,) if funnel is not None]
    steps = 0
    report = progress or (lambda done, of: None)
    tracking = tracking and problem.method is Method.PF
    passes = ROUNDS * (2 if tracking else 1)
    if tracking:
        tracked = learn(
            replace(problem, method=Method.TT),
            segment,
            template,
            beta_lower=beta_lower,
            beta_inner=beta_inner,
            candidates=candidates,
            seed=seed,
            progress=lambda done, of: report(done, passes),
        )
        if tracked is not None:
            first.append(tracked.funnel)
            steps += tracked.steps

    factor, change = _starts(rng, candidates, instance, template)
    for k, funnel in enumerate(first[:candidates]):
        factor[k], change[k] = np.linalg.cholesky(np.linalg.inv(funnel.shape)), funnel.rate * float(instance.duration)
    ridges = ridge_coordinates(problem.vehicle, instance)
    particles = spawn(rng, candidates, GROUP_SIZE, ridges)
    scale = margin_scale(problem.vehicle, template, instance, factor, change, particles)
    if counterexamples is not None and warm is not None:
        particles = _include(particles, *dual_coordinates(instance, warm, counterexamples))

    for k in range(ROUNDS):
        part = LEARN.part(k, ROUNDS, FIRST_STEPS[k])
        outcome = duel(problem.vehicle, template, instance, part, scale, factor, change, particles)
        factor, change, particles = outcome.factor, outcome.change, outcome.particles
        steps += part.steps
        if k < ROUNDS - 1:
            found = hunt(problem.vehicle, template, instance, factor, change, rng, PROBE)
            pools = (particles, found.particles)
            particles = _merge(rng, pools, (outcome.margins, found.margins), ridges)
        report(passes - ROUNDS + k + 1, passes)

    moved = (_inside(template, instance, segment, beta_inner, factor[i], change[i]) for i in range(candidates))
    funnels = [funnel for funnel in moved if funnel]
    # the starts compete too: annealing may lose what they had (never so far, but PF ≥ TT must not hang on it)
    funnels += [funnel for funnel in first if _excess_of(instance, funnel) < 0]
    if not funnels:
        return None
    quick = _quick_margins(problem, template, instance, funnels, rng)
    return replace(_best(problem, segment, funnels, quick, seed), steps=steps)


def _starts(
    rng: np.random.Generator, count: int, instance: Instance, template: Template
) -> tuple[Float[np.ndarray, "r n n"], Float[np.ndarray, " r"]]:
    """Random candidates: axes log-uniform between I and what G and S allow at the end, mildly rotated."""
    size = len(instance.inlet)
    low, high = (float(bound) for bound in instance.change_bounds)
    change = np.clip(template.first_change(rng.uniform(size=count)), low, high)
    end = np.asarray(template.level(change, 1.0))[:, None]
    wide = np.maximum(np.minimum(instance.goal / np.sqrt(end), instance.safe) / instance.inlet, 1.05)
    turn, _ = np.linalg.qr(np.eye(size) + 0.3 * rng.normal(size=(count, size, size)))
    axes = turn * (wide ** rng.uniform(0.05, 0.95, (count, size)))[:, None, :]
    factor = np.asarray(instance.inlet)[:, None] * np.linalg.cholesky(axes @ axes.transpose(0, 2, 1))
    return factor * np.asarray(instance.coupling), change


def _include(particles: Particles, w: np.ndarray, s: np.ndarray) -> Particles:
    """Put given points, free to move, in the place of the first particles of every candidate."""
    count = min(len(w), particles.points.shape[1])
    points, free = particles.points.copy(), particles.free.copy()
    points[:, :count] = np.concatenate([w, s[:, None]], axis=1)[:count]
    free[:, :count] = 1.0
    return Particles(points, free)


def _merge(
    rng: np.random.Generator, pools: tuple[Particles, ...], margins: tuple[np.ndarray, ...], ridges: np.ndarray
) -> Particles:
    """For each candidate the worst, mutually distant points of the pools; the others fresh."""
    candidates, count = margins[0].shape
    points, free = spawn(rng, candidates, count, ridges)
    for i in range(candidates):
        order = np.argsort(np.concatenate([m[i] for m in margins]))
        pool = np.concatenate([p.points[i] for p in pools])[order]
        masks = np.concatenate([p.free[i] for p in pools])[order]
        near = np.linalg.norm(pool[:, None] - pool[None], axis=-1) < KEPT_DISTANCE
        dropped, kept = np.zeros(len(order), bool), []
        for j in range(len(order)):
            if not dropped[j] and len(kept) < int(KEPT_SHARE * count):
                kept.append(j)
                dropped |= near[j]
        points[i, : len(kept)], free[i, : len(kept)] = pool[kept], masks[kept]
    return Particles(points, free)


def _excess(instance: Instance, inverse: Float[np.ndarray, "n n"], end: float) -> float:
    """Largest relative excess of (a), (b), (c) for C⁻¹ and ρ(T): below zero where they hold."""

    def spectrum(axes: np.ndarray) -> np.ndarray:
        return np.linalg.eigvalsh(inverse / np.outer(axes, axes))

    box = (np.diag(inverse) / np.asarray(instance.safe) ** 2).max() * max(end, 1.0)
    return float(
        max(1 - spectrum(np.asarray(instance.inlet))[0], spectrum(np.asarray(instance.goal))[-1] * end - 1, box - 1)
    )


def _excess_of(instance: Instance, funnel: Funnel) -> float:
    return _excess(instance, np.linalg.inv(funnel.shape), funnel.end_level)


def _inside(
    template: Template,
    instance: Instance,
    segment: Segment | Tube,
    beta_inner: float | None,
    factor: Float[np.ndarray, "n n"],
    change: float,
) -> Funnel | None:
    """The candidate moved strictly inside (a)–(c) at the same rate; None where there is no room.

    For a given rate the conditions are linear matrix inequalities in C⁻¹, so the least blend with an ellipsoid that is
    well inside all of them is found by bisection.
    """
    if not (np.isfinite(factor).all() and np.isfinite(change)):
        return None
    low, high = (float(bound) for bound in instance.change_bounds)
    change = float(np.clip(change, low, high))
    duration = float(instance.duration)
    end = float(template.level(change, 1.0))
    inverse = factor @ factor.T
    outer = np.minimum(np.asarray(instance.goal) ** 2 / end, np.asarray(instance.safe) ** 2 / max(end, 1.0))
    centre = np.diag(np.sqrt(outer) * np.asarray(instance.inlet))
    if _excess(instance, centre, end) > -GAP:
        return None
    share = 0.0
    if _excess(instance, inverse, end) > -GAP:
        bottom, share = 0.0, 1.0
        for _ in range(40):
            middle = 0.5 * (bottom + share)
            good = _excess(instance, (1 - middle) * inverse + middle * centre, end) <= -GAP
            bottom, share = (bottom, middle) if good else (middle, share)
    shape = np.linalg.inv((1 - share) * inverse + share * centre)
    beta_lower = float(instance.beta_lower)
    return Funnel(template, 0.5 * (shape + shape.T), change / duration, segment.duration, beta_lower, beta_inner)


def _quick_margins(
    problem: Problem, template: Template, instance: Instance, funnels: list[Funnel], rng: np.random.Generator
) -> list[float]:
    """Falsified margins of all candidates, one hunt each, in groups of the falsifier's own shape."""
    margins: list[float] = []
    for k in range(0, len(funnels), GROUPS):
        some = funnels[k : k + GROUPS]
        padded = some + some[-1:] * (GROUPS - len(some))
        factor = np.stack([np.linalg.cholesky(np.linalg.inv(funnel.shape)) for funnel in padded])
        change = np.array([funnel.rate * float(instance.duration) for funnel in padded])
        found = hunt(problem.vehicle, template, instance, factor, change, rng, SEARCH)
        margins += list(found.margins.min(axis=1))[: len(some)]
    return margins


def _best(problem: Problem, segment: Segment | Tube, funnels: list[Funnel], quick: list[float], seed: int) -> Learned:
    """The candidate of the largest margin after a thorough search; one that loses by it gives way to the next."""

    def falsified(funnel: Funnel, unit: Unit) -> float:
        points = falsify(problem, segment, funnel, seed=seed + 1, unit=unit)
        return next(point.slack for point in points if point.condition == "d")

    instance = instance_of(problem, segment, funnels[0].template, funnels[0].beta_lower)
    margins = np.array(quick)
    searched = np.zeros(len(funnels), bool)
    best = int(margins.argmax())
    while not searched[best]:
        margins[best], searched[best] = min(margins[best], falsified(funnels[best], Unit.BALANCED)), True
        best = int(margins.argmax())
    # balanced margins are margins in 1/s where there is one speed
    several = isinstance(segment, Tube) and segment.speed.half > 0
    return Learned(
        funnel=funnels[best],
        margin=falsified(funnels[best], Unit.SECOND) if several else float(margins[best]),
        excess=_excess_of(instance, funnels[best]),
        margins=tuple(float(m) for m in sorted(margins, reverse=True)),
        steps=0,
    )
