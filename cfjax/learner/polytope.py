"""The polytope learner: funnels by elimination of coefficients, from counterexamples and demonstrations.

As in Ravanbakhsh and Sankaranarayanan (`cfjax.learner.localise`). V is linear in its coefficients, so a condition at
one point with one input is a half-space of them. The falsifier finds points (θ, x) at which a candidate fails; a
demonstrator says what input it would give there; from then on V̇ along that input has to fall there:

    ∇V · f(x, u) + ∂V/∂θ u0 ≤ −ε                 `paper`: linear in C and c0
    ∇V · f(x, u) + ∂V/∂θ u0 ≤ −ε V/β̲             `contracting`: linear in C, for one rate k at a time; and `paper`
                                                 with an inner level

The candidate fails with its best input, so it fails with the demonstrated one: every answer cuts it off. (The second
line asks for ε where V = β̲ and for ε/β̲ where V = 1, the falsifier only for ε: it accepts a little more. So where no
candidate is left, it was the larger demand that left none, and the message says so.)

**What is lost.** Condition (d) says: for each point *of a funnel's own shell* there is *some* input. Here each
candidate has to decrease at each witness, though only the shell of the candidate that failed there is known to hold it,
and along the one input that was demonstrated, though another may be better for it. A funnel may exist that does
neither. So where no ball of radius δ is left, this is what was shown: **no δ-robust candidate is compatible with these
demonstrations**; with another demonstrator, one may be.

(a), (b), (c) are half-spaces at their worst points too (`cfjax.learner.coefficients`). Beside an obstacle any
separating half-plane of the plane will do, and at a place where a candidate reaches over all of a fan, it is the one
that is best for this candidate by which all others are judged from then on: a choice like a demonstrated input, and
counted as one (`Run.half_planes`). How far a funnel reaches along its normal is convex in M = C/ρ(θ), so the cut is its
tangent at the candidate: every funnel that keeps to this half-plane at this place satisfies it.

**Revised demonstrations.** With `revise` inputs are no longer given once for all: after every candidate those of all
witnesses are chosen anew, in turns with the centre of the largest ball that is left. At that centre each witness takes
the input, of its present one and a grid of the box with its vertices, whose half-space lies farthest away, so the ball
only grows. (The vertex along which V falls fastest leaves the most slack, but its half-space is steep: less room, not
more; and near a ridge neighbouring witnesses would take opposite vertices.) This gives back the second half of the
freedom, and it costs the bound: half-spaces are taken back, the polytopes are not nested, and an end without a funnel
shows nothing.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from cfjax.errors import InputError
from cfjax.falsifier.duel import Schedule
from cfjax.falsifier.falsifier import GROUPS, SEARCH, falsify, hunt
from cfjax.funnel import Funnel, Template
from cfjax.funnel.conditions import CLEAR, chain_excess, shell_points
from cfjax.funnel.instance import Chain, Instance, Unit, chain_of
from cfjax.funnel.template import Paper
from cfjax.learner.centre import Polytope, largest_ball
from cfjax.learner.coefficients import GAP, Coordinates
from cfjax.learner.gradient import Learned
from cfjax.learner.localise import Ending, Localised, Reply, Undecided, localise
from cfjax.options import Elimination
from cfjax.problem import Problem, ReferencePoint, Vehicle, affine_deviation


# rate · duration, where the template's rate is not a coefficient; below zero the funnel grows, where it may
CHANGES = (0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, -0.3, -1.0)
QUICK = SEARCH._replace(steps=200)  # for candidates that are likely to fail
ACCEPTING = 4  # thorough hunts without a find, by which a candidate is accepted
DISTANT = 0.2  # between witnesses of a batch, in dual coordinates
CLIMB = 1.05  # margin asked for next over the one found
REVISIONS, WORTH = 30, 1e-4  # of all inputs in a row, at most; and by how much the ball has to grow each time
LEVELS = (-1.0, -0.5, 0.0, 0.5, 1.0)  # of each input, tried in a revision
ZERO = 1e-9  # authority, relative to the largest, below which an input has none
BLOCK = 64  # points of one compiled evaluation


Demonstrate = Callable[[Float[np.ndarray, " k"], Float[np.ndarray, "k n"]], Float[np.ndarray, "k m"]]


class Witnesses(NamedTuple):
    """Points at which candidates failed (d), with what was demonstrated there."""

    theta: Float[np.ndarray, " k"]  # s
    x: Float[np.ndarray, "k n"]  # deviations
    inputs: Float[np.ndarray, "k m"]  # (u0, u)
    drift: Float[np.ndarray, "k n"]  # of the deviation: ẋ = drift + columns · inputs
    columns: Float[np.ndarray, "k n m"]

    def and_(self, other: "Witnesses") -> "Witnesses":
        return Witnesses(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


@dataclass(frozen=True)
class Run:
    """One search: all there is for `paper`, one rate of `contracting`."""

    change: float | None  # rate · duration; None where it is a coefficient
    message: str
    funnel: Funnel | None
    margin: float  # 1/s, falsified; −∞ without a funnel
    asked: float  # 1/s, the last margin asked for
    search: Localised
    bounded: bool  # whether `search.bound` is a bound for this kind of search, or only a limit
    witnesses: Witnesses
    half_planes: int  # that were chosen beside obstacles

    @property
    def demonstrations(self) -> int:
        return len(self.witnesses.theta)

    @property
    def candidates(self) -> int:
        return len(self.search.history)

    def figures(self) -> dict[str, float | int | str | None]:
        """For result.json."""
        bound = self.search.bound
        return {
            "change": self.change,
            "candidates": self.candidates,
            "cuts": self.search.cuts,
            "bound": bound if self.bounded else None,
            "limit": bound,
            "demonstrations": self.demonstrations,
            "half_planes": self.half_planes,
            "asked": self.asked,
            "margin": None if self.funnel is None else self.margin,
            "ending": self.search.ending.value,
        }


@dataclass(frozen=True)
class PolytopeLearned:
    """What the polytope learner found, or what it has shown."""

    learned: Learned | None  # as of the gradient learner
    message: str
    runs: tuple[Run, ...]

    @property
    def funnels(self) -> tuple[Funnel, ...] | None:
        return self.learned.funnels if self.learned else None

    @property
    def iterations(self) -> int:
        """Candidates of all runs."""
        return sum(run.candidates for run in self.runs)


def learn_polytope(
    problem: Problem,
    template: Template,
    how: Elimination = Elimination(),
    *,
    beta_lower: float = 0.9,
    beta_inner: float | None = None,
    demonstrate: Demonstrate | None = None,
    changes: Sequence[float] = CHANGES,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> PolytopeLearned:
    """A funnel of margin at least `how.margin` (ε, 1/s), by elimination; or what was shown in looking for it.

    `demonstrate` maps θ (k,), s, and deviations (k, n) to inputs (u0, u) of shape (k, 1 + m) within the box; where
    demonstrations are revised it may be left out. Each candidate is answered by at most `how.batch` witnesses of (d).
    With `how.climb` the search does not end at the first funnel: more margin than it has is asked for, all earlier
    demonstrations are held to it, and the best funnel comes back when no room is left. `changes` are the values of
    rate · duration that are tried with a template that is not linear in its rate; without `climb` the first that leads
    to a funnel is the last.

    Raises:
        InputError: for a tube or a chain of several distinct segments, a reference that touches an obstacle, and
            demonstrations that are no inputs.
    """
    chain = _chain(problem, template, beta_lower, beta_inner)
    if demonstrate is None and not how.revise:
        raise InputError("polytope.demonstrations: expected revised where no demonstrator is given")
    lowest, highest = (float(bound[0]) for bound in chain.funnels.change_bounds)
    asked = [None] if isinstance(template, Paper) else [c for c in changes if lowest <= c <= highest]
    runs: list[Run] = []
    roomless: list[float | None] = []
    for k, change in enumerate(asked):
        coordinates = Coordinates.of(template, chain, beta_lower, beta_inner, change)
        if coordinates is None:
            roomless.append(change)
            continue
        best = max((run.margin for run in runs), default=-math.inf)
        margin = max(how.margin, best) if how.climb else how.margin  # a later rate has to pass the best so far
        task = _Task(problem, template, chain, coordinates, demonstrate, how, margin, seed)
        report = None if progress is None else (lambda done, of, k=k: progress(k * of + done, len(asked) * of))
        search = localise(
            coordinates.lower,
            coordinates.upper,
            task,
            delta=how.delta,
            centre=how.centre,
            known=coordinates.known(),
            progress=report,
        )
        runs.append(task.run(search))
        if runs[-1].funnel is not None and not how.climb:
            break
    found = max(reversed(runs), key=lambda run: run.margin, default=None)
    if found is not None and found.funnel is not None:
        return PolytopeLearned(_learned(problem, chain, found, runs, seed), found.message, tuple(runs))
    said = list(dict.fromkeys(run.message for run in runs))
    if roomless:
        said.append(f"(a)–(c) leave no room{_at(roomless)}")
    if not isinstance(template, Paper):
        said.append("no other rates were tried")
    return PolytopeLearned(None, "; ".join(said), tuple(runs))


def _chain(problem: Problem, template: Template, beta_lower: float, beta_inner: float | None) -> Chain:
    """The numbers of the one funnel whose coefficients are looked for."""
    if problem.path.tube:
        raise InputError("learner=polytope: expected a path, got a tube")
    if len(problem.path.distinct) > 1:
        raise InputError(
            f"learner=polytope: expected one distinct segment, got {len(problem.path.distinct)}: its coefficients are "
            "those of one funnel"
        )
    chain = chain_of(problem, template, beta_lower, beta_inner, Unit.SECOND)
    gap = np.asarray(chain.funnels.clearance.gap)[0]
    if len(gap) and not gap.max(axis=1).min() > CLEAR * (1 + GAP):
        theta = float(chain.funnels.clearance.theta[0][gap.max(axis=1).argmin()])
        raise InputError(
            f"obstacles: expected more than {CLEAR:g} m between them and the body on the reference itself, got "
            f"{gap.max(axis=1).min():.3g} m at θ = {theta:.3g} s"
        )
    return chain


def _at(changes: Sequence[float | None]) -> str:
    """Which rates a message speaks of."""
    told = [f"{change:.3g}/T" for change in changes if change is not None]
    return f" at rate {', '.join(told)}" if told else ""


def _learned(problem: Problem, chain: Chain, found: Run, runs: Sequence[Run], seed: int) -> Learned:
    funnel = found.funnel
    assert funnel is not None
    factor = np.linalg.cholesky(np.linalg.inv(funnel.shape))[None]
    excess = chain_excess(funnel.template, chain, jnp.asarray(factor), jnp.asarray([funnel.rate]))
    points = falsify(problem, problem.path.distinct[0], funnel, seed=seed + 1)
    margin = min(found.margin, next(point.slack for point in points if point.condition == "d"))
    return Learned(
        funnels=(funnel,),
        margin=margin,
        excess=float(excess.max()),
        margins=(margin,),
        steps=sum(run.candidates for run in runs),
    )


@dataclass
class _Task:
    """The oracle: is this candidate a funnel of the margin asked for? Keeps the witnesses and the best funnel."""

    problem: Problem
    template: Template
    chain: Chain
    coordinates: Coordinates
    demonstrate: Demonstrate | None
    how: Elimination
    asked: float  # 1/s, at present
    seed: int
    witnesses: Witnesses = field(init=False)
    contained: Polytope = field(init=False)  # half-spaces of (a), (b), (c)
    best: tuple[float, Funnel | None] = (-math.inf, None)
    outgrown: int = 0  # funnels that were found and asked for more
    half_planes: int = 0  # that were chosen beside obstacles

    def __post_init__(self) -> None:
        n, m, r = self.problem.dimension, len(self.problem.inputs), len(self.coordinates.lower)
        shapes = ((0,), (0, n), (0, m), (0, n), (0, n, m))
        self.witnesses = Witnesses(*(np.zeros(shape) for shape in shapes))
        self.contained = Polytope(np.zeros((0, r)), np.zeros(0))
        self.rng = np.random.default_rng(self.seed)
        self.instance: Instance = jax.tree.map(lambda values: values[0], self.chain.funnels)
        self.middle = np.asarray(self.instance.input_middle)
        self.half = np.asarray(self.instance.input_half)

    def __call__(self, c: Float[np.ndarray, " r"]) -> Reply:
        cuts = self.coordinates.broken(c)
        if not len(cuts):
            cuts = self._near_obstacles(c)
            self.half_planes += len(cuts)
        if len(cuts):
            self.contained = self.contained.cut(cuts)
            return Reply(cuts)
        funnel = self.coordinates.funnel(c)
        margin, hunted = self._hunt(funnel)
        if margin >= self.asked:
            if margin > self.best[0]:
                self.best = margin, funnel
            if not self.how.climb:
                return Reply(Polytope(np.zeros((0, len(c))), np.zeros(0)))
            self.asked, self.outgrown = CLIMB * margin, self.outgrown + 1
        theta, x = self._worst(funnel, hunted)
        if not len(theta):
            raise Undecided("falsifier: no margin, and no point at which there is none")
        new = self._demonstrated(theta, x, c)
        self.witnesses = self.witnesses.and_(new)
        if self.how.revise:
            return Reply(self._revised(), afresh=True)
        if self.outgrown:  # all demonstrations are held to the new margin
            return Reply(self.contained.cut(self._falling(self.witnesses)), afresh=True)
        return Reply(self._falling(new))

    def run(self, search: Localised) -> Run:
        """The whole search in one object, with a message that says no more than was shown."""
        margin, funnel = self.best
        return Run(
            self.coordinates.change,
            self._message(search),
            funnel,
            margin,
            self.asked,
            search,
            self.how.centre == "mve" and not self.how.revise,
            self.witnesses,
            self.half_planes,
        )

    def _message(self, search: Localised) -> str:
        margin, funnel = self.best
        at = _at([self.coordinates.change])
        found = (
            "" if funnel is None else f"a funnel of margin {margin:.4g} 1/s{at} after {len(search.history)} candidates"
        )
        if search.ending is Ending.FOUND:
            return found
        wanted = f"margin {self.asked:.4g} 1/s{self._where()}"
        if search.ending is Ending.SOLVER:
            shown = f"the search for {wanted} failed numerically after {search.cuts} cuts; nothing is shown"
        elif search.ending is Ending.LIMIT:
            shown = f"the search for {wanted} ended after {search.cuts} cuts, its limit; nothing is shown"
        elif self.how.revise:
            shown = (
                f"the search for {wanted} ended after {search.cuts} candidates without room for a ball of "
                f"{self.how.delta:g}; demonstrations were revised, so nothing is shown"
            )
        else:
            planes = f" and {self.half_planes} half-planes beside obstacles" if self.half_planes else ""
            most = f"at most {search.bound}" if self.how.centre == "mve" else f"limit {search.bound}, no bound"
            shown = (
                f"no {self.how.delta:g}-robust candidate of {wanted} is compatible with these "
                f"{len(self.witnesses.theta)} demonstrations{planes} ({search.cuts} cuts, {most})"
            )
        return f"{found}; {shown}" if found else shown

    def _where(self) -> str:
        """What a margin that was asked for means: on which levels, and at which rates."""
        found = self.coordinates
        levels = ""
        if found.change is not None or found.beta_inner is not None:
            levels = f" (at V = {found.beta_lower:g}, {self.asked / found.beta_lower:.4g} 1/s at V = 1)"
        if found.change is not None:
            return f"{levels}{_at([found.change])}"
        return f"{levels} with c0 T from {found.lower[-1]:.3g} to {found.upper[-1]:.3g}"

    def _hunt(self, funnel: Funnel) -> tuple[float, "_Hunted"]:
        """The least margin found, and all that was found: quickly, and if nothing falls short, thoroughly."""
        factor = np.linalg.cholesky(np.linalg.inv(funnel.shape))
        found: list[_Hunted] = []
        least = math.inf
        for schedule in (QUICK, *(SEARCH,) * ACCEPTING):
            found.append(self._particles(funnel, factor, schedule))
            least = min(least, float(found[-1].margins.min()))
            if not least >= self.asked:
                break
        return least, _Hunted(*(np.concatenate(each) for each in zip(*found, strict=True)))

    def _particles(self, funnel: Funnel, factor: Float[np.ndarray, "n n"], schedule: Schedule) -> "_Hunted":
        factors = np.repeat(factor[None, None], GROUPS, axis=0)
        change = np.full((GROUPS, 1), funnel.rate * funnel.duration)
        found = hunt(self.problem.vehicle, self.template, self.chain, factors, change, self.rng, schedule)
        points = found.particles.points.reshape(-1, self.problem.dimension + 1)
        return _Hunted(points, found.particles.station.ravel(), found.margins.ravel())

    def _worst(self, funnel: Funnel, hunted: "_Hunted") -> tuple[Float[np.ndarray, " b"], Float[np.ndarray, "b n"]]:
        """The worst, mutually distant points below what is asked: θ and x."""
        points, station, margins = hunted
        kept: list[int] = []
        for j in np.argsort(margins):
            if len(kept) == self.how.batch or not margins[j] < self.asked:
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
        told = np.isfinite(x).all(axis=1) & (np.arange(len(at)) < len(kept))
        begin, end = np.asarray(self.instance.begin)[station[at]], np.asarray(self.instance.end)[station[at]]
        full = np.array([self._full_at(funnel.rate, value) for value in q.tolist()])
        return np.clip(full, begin, end)[told], x[told]

    def _full_at(self, rate: float, q: float) -> float:
        """Where V = 1 for a deviation with form q: the demand is the largest there, or at the nearest θ there is."""
        return float(self.template.reaching(rate, q, 1.0)) if rate else 0.0

    def _demonstrated(
        self, theta: Float[np.ndarray, " k"], x: Float[np.ndarray, "k n"], c: Float[np.ndarray, " r"]
    ) -> Witnesses:
        drift, columns = dynamics(self.problem, theta, x)
        empty = Witnesses(theta, x, np.repeat(self.middle[None], len(theta), axis=0), drift, columns)
        if self.demonstrate is None:
            return empty._replace(inputs=self._best(empty, c))
        inputs = np.asarray(self.demonstrate(theta, x), float)
        if not np.isfinite(inputs).all():
            raise InputError(f"demonstrator: expected finite inputs, got {np.sum(~np.isfinite(inputs))} that are not")
        if inputs.shape != empty.inputs.shape or not (np.abs(inputs - self.middle) <= self.half * (1 + 1e-9)).all():
            raise InputError(
                f"demonstrator: expected inputs within the problem's box, of shape {empty.inputs.shape}, got shape "
                f"{inputs.shape}"
            )
        return empty._replace(inputs=np.clip(inputs, self.middle - self.half, self.middle + self.half))

    def _best(self, witnesses: Witnesses, c: Float[np.ndarray, " r"]) -> Float[np.ndarray, "k m"]:
        rate = self.coordinates.change_of(c) / self.coordinates.duration
        shape = self.coordinates.shape(c)
        return _vertices(self.template, rate, shape, witnesses.x, witnesses.columns, self.middle, self.half)

    def _lines(self, witnesses: Witnesses) -> tuple[Float[np.ndarray, "k p r"], Float[np.ndarray, " k"]]:
        """V̇ at witnesses as half-spaces that are affine in the input: rows · c ≤ offset, Σ rows_j (1, u0, u)_j."""
        found, (theta, x, _, drift, columns) = self.coordinates, witnesses
        form = found.form(x)
        rows = np.stack([2 * found.form(x, way) for way in (drift, *np.moveaxis(columns, -1, 0))], axis=1)
        faded = self.asked / found.beta_lower
        if found.change is not None:
            rows[:, 1] += found.change / found.duration * form
            rows[:, 0] += faded * form
            return rows, np.zeros(len(x))
        rows[:, 1] += found.last(np.full(len(x), 1 / found.duration))
        if found.beta_inner is None:
            return rows, np.full(len(x), -self.asked)
        rows[:, 0] += faded * (form + found.last(theta / found.duration))
        return rows, np.zeros(len(x))

    def _falling(self, witnesses: Witnesses) -> Polytope:
        """V̇ along the demonstrated inputs: q̇ + timing u0 ≤ −ε demand."""
        rows, offsets = self._lines(witnesses)
        return Polytope(np.einsum("kj,kjr->kr", _with_one(witnesses.inputs), rows), offsets)

    def _revised(self) -> Polytope:
        """All inputs chosen anew, for the candidate that they leave the largest ball, in turns: the ball only grows."""
        start = Polytope.box(self.coordinates.lower, self.coordinates.upper).cut(self.coordinates.known())
        hard, largest = start.cut(self.contained), -math.inf
        rows, offsets = self._lines(self.witnesses)
        inputs = self.witnesses.inputs
        for _ in range(REVISIONS):
            soft = Polytope(np.einsum("kj,kjr->kr", _with_one(inputs), rows), offsets)
            point, radius = largest_ball(hard.cut(soft))
            if not radius > largest + WORTH:
                break
            largest, self.witnesses = radius, self.witnesses._replace(inputs=inputs)
            inputs = self._roomiest(inputs, rows, offsets, point)
        return self.contained.cut(self._falling(self.witnesses))

    def _roomiest(
        self,
        inputs: Float[np.ndarray, "k m"],
        rows: Float[np.ndarray, "k p r"],
        offsets: Float[np.ndarray, " k"],
        c: Float[np.ndarray, " r"],
    ) -> Float[np.ndarray, "k m"]:
        """The input at each witness whose half-space lies farthest from c: of the present one and those of a grid."""
        levels = [LEVELS if half else (0.0,) for half in self.half]
        grid = self.middle + self.half * np.array(list(itertools.product(*levels)))
        tried = np.concatenate([inputs[:, None], np.repeat(grid[None], len(inputs), axis=0)], axis=1)
        weights = _with_one(tried)
        size = np.einsum("kgi,kir,kjr,kgj->kg", weights, rows, rows, weights, optimize=True)
        slack = offsets[:, None] - np.einsum("kgj,kj->kg", weights, rows @ c)
        best = (slack / np.sqrt(np.maximum(size, 1e-300))).argmax(axis=1)
        return tried[np.arange(len(inputs)), best]

    def _near_obstacles(self, c: Float[np.ndarray, " r"]) -> Polytope:
        """Where the funnel reaches over all half-planes of an obstacle's fan: it has to keep to the best of them.

        Along n the footprint's disc comes as far as reach(M) = √(mᵀM⁻¹m) + swing (M⁻¹)_αα with M = C/ρ(θ), convex in M:
        reach(M) ≤ gap implies reach(M_c) + ∇reach(M_c) · (M − M_c) ≤ gap, a half-space of (C, ρ). At c it is broken by
        as much as c reaches too far.
        """
        theta, gap, reach, swing = map(np.asarray, self.instance.clearance)
        if not len(theta):
            return Polytope(np.zeros((0, len(c))), np.zeros(0))
        level = np.asarray(self.template.level(self.coordinates.change_of(c) / self.coordinates.duration, theta))
        inverse = np.linalg.inv(self.coordinates.shape(c))
        wide = np.sqrt(level[:, None] * np.einsum("pdi,ij,pdj->pd", reach, inverse, reach))
        turned = swing * level * inverse[0, 0]
        free = gap - CLEAR * (1 + GAP)
        left = free - wide - turned[:, None]
        normal = left.argmax(axis=1)
        rows = np.arange(len(theta))
        worst = np.array([p for p in np.argsort(left[rows, normal]) if left[p, normal[p]] <= 0][: self.how.batch], int)
        chosen = normal[worst]
        wide, turned = wide[worst, chosen], turned[worst]
        # ∇√(mᵀM⁻¹m) = −y yᵀ / 2√(mᵀM⁻¹m) with y = M⁻¹m, and ∇(M⁻¹)_αα = −z zᵀ with z = M⁻¹e_α
        y = level[worst, None] * (reach[worst, chosen] @ inverse)
        z = level[worst, None] * inverse[:1]
        falls = self.coordinates.form(y) / (2 * wide[:, None]) + swing[worst, None] * self.coordinates.form(z)
        return self.coordinates.cone(falls, 1.5 * wide + 2 * turned - free[worst, chosen], theta[worst])


class _Hunted(NamedTuple):
    """Particles of the falsifier, as `cfjax.falsifier.falsifier.Hunt` has them, of one candidate."""

    points: Float[np.ndarray, "k d"]
    station: Int[np.ndarray, " k"]
    margins: Float[np.ndarray, " k"]  # 1/s


def _with_one(inputs: Float[np.ndarray, "*batch m"]) -> Float[np.ndarray, "*batch p"]:
    return np.concatenate([np.ones((*inputs.shape[:-1], 1)), inputs], axis=-1)


def dynamics(
    problem: Problem, theta: Float[np.ndarray, " k"], x: Float[np.ndarray, "k n"]
) -> tuple[Float[np.ndarray, "k n"], Float[np.ndarray, "k n m"]]:
    """Drift and input columns of the deviations x at θ, on the path's first segment."""
    segment = problem.path.curve[0]
    points = np.array([segment.point(float(place)) for place in theta], float).reshape(-1, 4)
    blocks = max(1, -(-len(x) // BLOCK))
    where = np.minimum(np.arange(blocks * BLOCK), max(len(x) - 1, 0))
    parts = [
        _batched(problem.vehicle)(jnp.asarray(x[i]), ReferencePoint(*jnp.asarray(points[i].T)))
        for i in (np.split(where, blocks) if len(x) else [])
    ]
    size, count = problem.dimension, len(problem.inputs)
    drift = np.concatenate([np.zeros((0, size)), *(np.asarray(part[0]) for part in parts)])
    columns = np.concatenate([np.zeros((0, size, count)), *(np.asarray(part[1]) for part in parts)])
    return drift[: len(x)], columns[: len(x)]


@lru_cache
def _batched(vehicle: Vehicle):
    return jax.jit(jax.vmap(lambda x, reference: affine_deviation(vehicle, x, reference)))


def best_vertices(
    problem: Problem,
    template: Template,
    rate: float,
    shape: Float[np.ndarray, "n n"],
    theta: Float[np.ndarray, " k"],
    x: Float[np.ndarray, "k n"],
) -> Float[np.ndarray, "k m"]:
    """The vertices of the input box (u0, u) along which V = `template` with C = shape falls fastest, in closed form.

    An input without authority stays in the middle of its interval.
    """
    middle = np.array([interval.middle for interval in problem.inputs])
    half = np.array([interval.half for interval in problem.inputs])
    return _vertices(template, rate, shape, x, dynamics(problem, theta, x)[1], middle, half)


def _vertices(
    template: Template,
    rate: float,
    shape: Float[np.ndarray, "n n"],
    x: Float[np.ndarray, "k n"],
    columns: Float[np.ndarray, "k n m"],
    middle: Float[np.ndarray, " m"],
    half: Float[np.ndarray, " m"],
) -> Float[np.ndarray, "k m"]:
    slopes = 2 * x @ shape
    authority = np.einsum("ki,kij->kj", slopes, columns)
    authority[:, 0] += np.asarray(template.timing(rate, np.einsum("ki,ij,kj->k", x, shape, x)))
    largest = np.einsum("ki,kij->kj", np.abs(slopes), np.abs(columns)) + 1e-300
    return middle - half * np.where(np.abs(authority) > ZERO * largest, np.sign(authority), 0.0)
