"""Hints for sampled control: where which input of a finite set brings V down for a whole hold (`cfjax.check.sampled`).

Trees are grown on samples. Where one input does it for all samples of a node, sums of squares are asked; a node where
they show too little, or where no input does it alone, is cut where two of the inputs are equally good.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import floor, log2
from typing import Any, NamedTuple

import numpy as np
from flint import fmpq
from jaxtyping import Bool, Float, Int

from cfjax.certificate.fit import enclose
from cfjax.certificate.program import coefficients, program_of, prove, solved
from cfjax.certificate.prover import NotProven
from cfjax.certificate.rounding import dyadic, round_whitening
from cfjax.certificate.writing import write_grams, write_unary
from cfjax.check.document import SegmentClaim
from cfjax.check.enclosure import LARGEST_EFFORT, UnaryEnclosure
from cfjax.check.program import CellProof
from cfjax.check.proof import LegClaim
from cfjax.check.sampled import (
    DEGREES,
    FORK_DEGREE,
    HeldRange,
    Inputs,
    LeafProgram,
    Part,
    SampledClaim,
    held_ranges,
    span_of,
)
from cfjax.solver import Program, Solution, Solver
from cfjax.solver.points import vandermonde
from cfjax.verdict import Verdict


POINTS, FEW = 30_000, 2_000  # samples of a range, and of a node that is looked at closely
DEEPEST = 16  # forks on the way to a leaf
CANDIDATES = 6  # pairs of inputs, of which the cut where they are equal is looked at closely
RATIO = 2.0  # of the ends of a range of q
CUT_BITS, FORK_BITS, BEND_BITS = 16, 24, 0
SPARE = 1.001  # by which R_u is stated larger than found

Points = Float[np.ndarray, "k n"]


class Question(NamedTuple):
    """What is asked: the period (s), the order, levels of each input, and the share of what samples allow."""

    period: fmpq
    order: int
    levels: tuple[tuple[fmpq, ...], ...]
    share: float = 0.7


def three_levels(leg: LegClaim[SegmentClaim], own: Sequence[fmpq]) -> tuple[tuple[fmpq, ...], ...]:
    """Of each input both ends and the reference's own value, where it has room to move."""
    box = leg.problem.inputs.values()
    return tuple(tuple(sorted({lower, middle, upper})) for (lower, upper), middle in zip(box, own, strict=True))


def sampled_hints(leg: LegClaim[SegmentClaim], closed: bool, question: Question, solver: Solver) -> dict[str, Any]:
    """What is stated of holds up to the period, with hints; the largest decrease that is proven.

    Raises:
        NotProven: a part of the funnel for which nothing was found.
        Broken, ValueError: a vehicle, a V or a reference of a kind that is not looked at.
    """
    choices: tuple[Inputs, ...] = tuple(itertools.product(*question.levels))
    count = len(choices)
    cuts = _cuts(leg, closed, question.period)
    claim = SampledClaim(question.period, question.order, fmpq(1), choices, (fmpq(0),) * count, cuts)
    asked = [(_with_functions(held), parts) for held, parts in held_ranges(leg, closed, claim)]
    bends = [_bends(held, solver) for held, _ in asked]
    largest = (max(fmpq(0), *(-margin for margin, _ in each)) for each in zip(*bends, strict=True))
    claim = replace(claim, bends=tuple(fmpq((bound * 1001 / 1000).ceil()) for bound in largest))
    growers = [[_Grower(held, part, claim, solver) for part in parts] for held, parts in asked]
    everywhere = list(itertools.chain.from_iterable(growers))
    shell = [grower for grower in everywhere if grower.part.is_shell]
    target = question.share * min(grower.best() for grower in shell)
    if not target > 0:
        raise NotProven(Verdict.INCONCLUSIVE, f"sampled: V falls at no more than {target / question.share:.3g} 1/s")
    for grower in everywhere:
        grower.grow(target if grower.part.is_shell else 0.0)
    decrease = min(leaf.spare for grower in shell for leaf in grower.leaves)
    return {
        "period": str(claim.period),
        "order": claim.order,
        "decrease": str(fmpq(floor(decrease * 2**20), 2**20)),
        "inputs": [[str(value) for value in choice] for choice in choices],
        "bends": [str(bound) for bound in claim.bends],
        "cuts": [str(cut) for cut in cuts],
        "ranges": [
            {
                "whitening": [[str(entry) for entry in row] for row in held.whitening],
                "enclosures": write_unary(held.enclosures),
                "bends": [{"margin": str(proof.margin), "grams": write_grams(proof.grams)} for _, proof in own],
                "trees": [grower.written() for grower in each],
            }
            for (held, _), own, each in zip(asked, bends, growers, strict=True)
        ],
    }


def _cuts(leg: LegClaim[SegmentClaim], closed: bool, period: fmpq) -> tuple[fmpq, ...]:
    """Ranges of q whose ends are in the ratio RATIO, nearly."""
    least, peak = leg.funnel.level.extent(span_of(leg, closed, period))
    beta = leg.funnel.beta_lower
    count = max(1, round(log2(float(peak / least)) / log2(RATIO)))
    inner = (float(beta * least) * float(peak / least) ** (k / count) for k in range(1, count))
    return tuple(dyadic(value, CUT_BITS) for value in inner)


def _with_functions(held: HeldRange) -> HeldRange:
    """With a whitening, and with enclosures of the functions on its ball."""
    shape = np.array([[float(entry) for entry in row] for row in held.shape])
    held = replace(held, whitening=round_whitening(shape / float(held.peak)))
    enclosures: dict[int, UnaryEnclosure] = {}
    for number, (function, argument) in enumerate(held.dynamics.functions.values()):
        enclosures[number] = enclose(function, held.argument(argument))
    return replace(held, enclosures=enclosures)


def _bends(held: HeldRange, solver: Solver) -> list[tuple[fmpq, CellProof]]:
    """Of each input the margin −R_u that is proven on the range, and its proof."""
    cells = list(held.cells())
    programs = [_program(held, cell) for cell in cells]
    found = []
    for cell, program, solution in zip(cells, programs, solved(solver, programs), strict=True):
        held.domain.budget.left = LARGEST_EFFORT
        proven = prove(held, cell, program, solution)
        if proven.proof is None:
            raise NotProven(Verdict.SOLVER_FAILED, f"sampled: no bound of a derivative of V: {solution}")
        found.append((proven.margin, proven.proof))
    return found


def _program(claim: HeldRange | LeafProgram, cell: int) -> Program:
    claim.domain.budget.left = LARGEST_EFFORT
    return program_of(claim, cell)


# --- trees


@dataclass(frozen=True)
class _Leaf:
    """A proven leaf; `spare` is what it shows beyond ρ, 1/s."""

    choice: int
    proofs: tuple[CellProof, ...]
    spare: fmpq

    def written(self) -> dict[str, Any]:
        proofs = [{"margin": str(proof.margin), "grams": write_grams(proof.grams)} for proof in self.proofs]
        return {"choice": self.choice, "proofs": proofs}


class _Samples(NamedTuple):
    """Deviations, and at each input what is lacking there: by how many drops the worst B_j is too large, 1/s.

    `last` is B_{m−1} at each input: where two of these are equal a cut is made.
    """

    points: Points
    powers: Float[np.ndarray, "k p"]  # monomials up to FORK_DEGREE
    excess: Float[np.ndarray, "k u"]
    last: Float[np.ndarray, "k u"]

    def of(self, some: np.ndarray) -> "_Samples":
        """A part of them."""
        return _Samples(*(values[some] for values in self))

    def and_more(self, others: "_Samples") -> "_Samples":
        """All together."""
        return _Samples(*map(np.concatenate, zip(self, others, strict=True)))


@dataclass
class _Node:
    """Samples, and the forks on the way here: arrays of coefficients of polynomials that are not negative."""

    samples: _Samples
    forks: tuple[np.ndarray, ...] = ()
    leaf: _Leaf | None = None
    sides: "tuple[_Node, ...]" = ()

    def leaves(self) -> Iterator[_Leaf]:
        if self.leaf:
            yield self.leaf
        for side in self.sides:
            yield from side.leaves()

    def written(self) -> dict[str, Any]:
        if self.leaf:
            return self.leaf.written()
        above, below = self.sides
        fork = [str(dyadic(value, FORK_BITS)) for value in above.forks[-1]]
        return {"fork": fork, "above": above.written(), "below": below.written()}


class _Grower:
    """A tree for one part of a range."""

    def __init__(self, held: HeldRange, part: Part, claim: SampledClaim, solver: Solver) -> None:
        self.held, self.part, self.claim, self.solver = held, part, claim, solver
        numbers = range(len(claim.choices))
        order = 2 * DEGREES[0]
        held.domain.budget.left = LARGEST_EFFORT * len(numbers)
        self.table = np.array(
            [[coefficients(held.upper(j, u, order), order) for u in numbers] for j in range(claim.order)]
        )
        self.left_out = np.array([float(claim.left_out(u)) for u in numbers])
        self.form = coefficients(held.form, 2)
        self.rng = np.random.default_rng(0)
        self.root = _Node(self._drawn())
        samples = self.root.samples
        self.near = np.linalg.lstsq(samples.powers, samples.last, rcond=None)[0]  # B_{m−1} as if of a low degree

    @property
    def leaves(self) -> list[_Leaf]:
        return list(self.root.leaves())

    def written(self) -> dict[str, Any]:
        """As the checker reads it."""
        return self.root.written()

    def best(self) -> float:
        """What is left of the need, 1/s, at the worst sample with its best input."""
        return -float(self.root.samples.excess.min(axis=1).max())

    # --- samples

    def _drawn(self) -> _Samples:
        """A third of them on each end of the range."""
        y = self.rng.normal(size=(POINTS, len(self.held.states)))
        q = self.rng.uniform(*self._ends, POINTS)
        q[: POINTS // 3], q[POINTS // 3 : 2 * POINTS // 3] = self._ends
        return self._looked_at(self._at_level(y, q))

    @property
    def _ends(self) -> tuple[float, float]:
        return float(self.held.piece.lower), float(self.held.piece.upper)

    def _at_level(self, y: Points, q: Float[np.ndarray, " k"]) -> Points:
        return y * np.sqrt(q / (vandermonde(y, 2) @ self.form))[:, None]

    def _looked_at(self, points: Points) -> _Samples:
        powers = vandermonde(points, FORK_DEGREE)
        q = powers @ self.form
        slack, drop = (float(constant) + float(slope) * q for constant, slope in self.part[:2])
        values = vandermonde(points, 2 * DEGREES[0]) @ self.table.swapaxes(1, 2)  # B_j at each input
        excess = (values - slack[:, None]) / drop[:, None]
        excess[-1] += self.left_out
        return _Samples(points, powers, excess.max(axis=0), values[-1])

    def _closer(self, node: _Node) -> _Samples:
        """The node's samples, and where they are few more of them, near them."""
        points = node.samples.points
        if len(points) >= FEW or not len(points):
            return node.samples
        near = points[self.rng.integers(len(points), size=2 * FEW)]
        near = near + self.rng.normal(size=near.shape) * self.rng.choice([0.01, 0.03, 0.1], size=(len(near), 1))
        q = np.clip(vandermonde(near, 2) @ self.form, *self._ends)
        near = self._at_level(near, np.where(self.rng.random(len(q)) < 0.3, self.rng.choice(self._ends, len(q)), q))
        powers = vandermonde(near, FORK_DEGREE)
        inside = np.all([powers @ fork >= 0 for fork in node.forks], axis=0) if node.forks else np.ones(len(near), bool)
        return node.samples.and_more(self._looked_at(near[inside]))

    # --- growth

    def grow(self, target: float) -> None:
        """Until every leaf is proven with the target (1/s).

        Raises:
            NotProven: a leaf that is not cut any further shows nothing.
        """
        open_ = [self.root]
        while open_:
            ready: list[tuple[_Node, int]] = []
            while open_:
                node = open_.pop()
                node.samples = self._closer(node)
                worst = node.samples.excess.max(axis=0, initial=-np.inf)
                choice = int(worst.argmin())
                if worst[choice] <= -target or not self._cut(node, 1.05 * target + 0.05):
                    ready.append((node, choice))
                else:
                    open_ += node.sides
            open_ = self._settled(ready, target)
            print("   round", len(self.leaves), len(open_), flush=True)

    def _settled(self, ready: Sequence[tuple[_Node, int]], target: float) -> list[_Node]:
        """Leaves that are proven become so; what is left are the sides of nodes that had to be cut."""
        leaves = [LeafProgram(self.held, self.part, choice, self._exact(node.forks)) for node, choice in ready]
        cells = range(self.claim.order)
        programs = [_program(leaf, cell) for leaf in leaves for cell in cells]
        solutions = solved(self.solver, programs)
        size, left = len(cells), []
        for index, ((node, choice), program) in enumerate(zip(ready, leaves, strict=True)):
            own = slice(index * size, (index + 1) * size)
            rest = [0.0] * (size - 1) + [self.left_out[choice]]
            shown = min(s.margin - r for s, r in zip(solutions[own], rest, strict=True))
            attainable = -float(node.samples.excess.min(axis=1).max(initial=-np.inf))
            if not shown > target and self._cut(node, max(1.3 * target + 0.3, attainable)):
                left += node.sides
                continue
            node.leaf = self._proven(program, choice, programs[own], solutions[own])
        return left

    def _proven(
        self, leaf: LeafProgram, choice: int, programs: Sequence[Program], solutions: Sequence[Solution]
    ) -> _Leaf:
        proofs, spare = [], []
        for cell, (program, solution) in enumerate(zip(programs, solutions, strict=True)):
            self.held.domain.budget.left = LARGEST_EFFORT
            found = prove(leaf, cell, program, solution)
            if found.proof is None:
                raise NotProven(Verdict.SOLVER_FAILED, f"sampled: a leaf of input {choice} is not proven: {solution}")
            proofs.append(found.proof)
            spare.append(found.margin - self.claim.left_out(choice) * (cell == self.claim.order - 1))
        if not (min(spare) > 0 if self.part.is_shell else min(spare) >= 0):
            raise NotProven(
                Verdict.INCONCLUSIVE, f"sampled: a leaf of input {choice} shows {float(min(spare)):.3g} 1/s, no more"
            )
        return _Leaf(choice, tuple(proofs), min(spare))

    def _exact(self, forks: Sequence[np.ndarray]) -> tuple[Any, ...]:
        return tuple(self.held.fork(tuple(dyadic(value, FORK_BITS) for value in fork)) for fork in forks)

    def _cut(self, node: _Node, target: float) -> bool:
        """Into two sides, where that can be."""
        fork = self._fork(node.samples, target) if len(node.forks) < DEEPEST else None
        if fork is None:
            return False
        fork = np.round(fork / np.abs(fork).max() * 2**FORK_BITS) / 2**FORK_BITS
        above = node.samples.powers @ fork >= 0
        node.sides = tuple(
            _Node(node.samples.of(side), (*node.forks, sign * fork)) for side, sign in ((above, 1), (~above, -1))
        )
        return True

    def _fork(self, samples: _Samples, target: float) -> np.ndarray | None:
        """The cut between two inputs that leaves least to be wished on both sides, if each is held by one input."""
        samples = samples.of(self._telling(samples.excess))
        lacking, powers, last = np.maximum(samples.excess + target, 0), samples.powers, samples.last
        first, second = np.tril_indices(last.shape[1], -1)
        apart = self.near[:, first] - self.near[:, second]
        scores = _scores(powers @ apart >= 0, lacking)
        best: tuple[float, np.ndarray | None] = (np.inf, None)
        for pair in np.argsort(scores)[:CANDIDATES]:
            difference = last[:, first[pair]] - last[:, second[pair]]
            weights = np.exp(-((difference / (np.quantile(np.abs(difference), 0.3) + 1e-9)) ** 2)) + 1e-3
            fitted = np.linalg.lstsq(powers * weights[:, None], difference * weights, rcond=None)[0]
            for fork in (apart[:, pair], fitted):
                score = float(_scores((powers @ fork >= 0)[:, None], lacking)[0])
                if score < best[0]:
                    best = score, fork
        return best[1]

    def _telling(self, excess: Float[np.ndarray, "k u"]) -> Int[np.ndarray, " s"]:
        """Samples to choose a cut by: some at random, and those where most is lacking."""
        count = len(excess)
        if count <= 3 * FEW:
            return np.arange(count)
        worst = np.argsort(excess.min(axis=1))[-FEW:]
        return np.concatenate([self.rng.choice(count, 2 * FEW, replace=False), worst])


def _scores(above: Bool[np.ndarray, "k p"], lacking: Float[np.ndarray, "k u"]) -> Float[np.ndarray, " p"]:
    """What is lacking on both sides of each cut, each with its best input; infinite where a side is empty."""
    first = above.astype(np.float32).T @ lacking.astype(np.float32)
    second = lacking.sum(axis=0) - first
    is_empty = above.all(axis=0) | ~above.any(axis=0)
    return np.where(is_empty, np.inf, first.min(axis=1) + second.min(axis=1))
