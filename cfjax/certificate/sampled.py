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
from threadpoolctl import threadpool_limits

from cfjax.certificate.fit import FUNCTIONS, enclose
from cfjax.certificate.program import MARGIN_BITS, coefficients, program_of, prove, solved
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
    HoldCell,
    Inputs,
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
OTHERS = 4  # inputs that are tried where a node cannot be cut
CANDIDATES = 6  # pairs of inputs, of which the cut where they are equal is looked at closely
RATIO = 2.0  # of the ends of a range of q
CUT_BITS, FORK_BITS, LEVEL_BITS = 16, 24, 20
ORDER = 3
ENOUGH = 0.5  # of λ: what samples have to say of three levels, or there are more of them
SHARE = 0.5  # of what samples say: so much λ' is looked for. More of it takes more leaves

Points = Float[np.ndarray, "k n"]


def sampled_hints(leg: LegClaim[SegmentClaim], closed: bool, period: fmpq, solver: Solver) -> dict[str, Any]:
    """What is stated of holds up to the period (s), with hints; with three levels of each input, or more of one.

    Raises:
        NotProven: a part of the funnel for which nothing was found.
        Broken, ValueError: a vehicle, a V or a reference of a kind that is not looked at.
    """
    motion = _Motion.of(leg)
    try:
        return hints_with(leg, closed, period, motion.levels(), solver, least=ENOUGH * float(leg.funnel.margin))
    except NotProven:
        return hints_with(leg, closed, period, motion.levels(motion.strongest), solver)


def hints_with(
    leg: LegClaim[SegmentClaim],
    closed: bool,
    period: fmpq,
    levels: Sequence[Sequence[fmpq]],
    solver: Solver,
    order: int = ORDER,
    least: float = 0.0,
) -> dict[str, Any]:
    """The same with these levels of each input, and so many derivatives of V in the polynomial.

    Raises:
        NotProven: also where V falls at no more than `least` (1/s) at some sample.
    """
    with threadpool_limits(1, user_api="blas"):  # for arrays of this size threads only wait for each other
        choices: tuple[Inputs, ...] = tuple(itertools.product(*levels))
        nothing = (fmpq(0),) * len(choices)
        claim = SampledClaim(period, order, fmpq(1), choices, nothing, _cuts(leg, closed, period))
        return _stated(leg, closed, claim, solver, least)


def _stated(
    leg: LegClaim[SegmentClaim], closed: bool, claim: SampledClaim, solver: Solver, least: float
) -> dict[str, Any]:
    asked = [(_with_functions(held), parts) for held, parts in held_ranges(leg, closed, claim)]
    bends = [_bends(held, solver) for held, _ in asked]
    largest = (max(fmpq(0), *(-margin for margin, _ in each)) for each in zip(*bends, strict=True))
    claim = replace(claim, bends=tuple(fmpq(bound.ceil()) for bound in largest))
    growers = [[_Grower(held, part, claim, solver) for part in parts] for held, parts in asked]
    everywhere = list(itertools.chain.from_iterable(growers))
    shell = [grower for grower in everywhere if grower.part.is_shell]
    best = min(grower.best() for grower in shell)
    if not best > least:
        raise NotProven(
            Verdict.INCONCLUSIVE, f"sampled: V falls at no more than {best:.3g} 1/s, whichever input is held"
        )
    for grower in everywhere:
        grower.grow(SHARE * best if grower.part.is_shell else 0.0)
    decrease = min(leaf.spare for grower in shell for leaf in grower.leaves)
    return {
        "period": str(claim.period),
        "order": claim.order,
        "decrease": str(fmpq(floor(decrease * 2**MARGIN_BITS), 2**MARGIN_BITS)),
        "inputs": [[str(value) for value in choice] for choice in claim.choices],
        "bends": [str(bound) for bound in claim.bends],
        "cuts": [str(cut) for cut in claim.cuts],
        "ranges": [
            {
                "whitening": [[str(entry) for entry in row] for row in held.whitening],
                "enclosures": write_unary(held.enclosures),
                "bends": [_written(proof) for _, proof in own],
                "trees": [grower.written() for grower in each],
            }
            for (held, _), own, each in zip(asked, bends, growers, strict=True)
        ],
    }


def _written(proof: CellProof) -> dict[str, Any]:
    return {"margin": str(proof.margin), "grams": write_grams(proof.grams)}


class _Motion(NamedTuple):
    """On the reference: the inputs that keep a car there, and which one of the vehicle's moves V most."""

    box: tuple[tuple[fmpq, fmpq], ...]
    own: tuple[fmpq, ...]
    strongest: int

    @classmethod
    def of(cls, leg: LegClaim[SegmentClaim]) -> "_Motion":
        """From the rates at x = 0, which are affine in the inputs."""
        names, box = tuple(leg.problem.inputs), tuple(leg.problem.inputs.values())
        still = {f"reference:{name}": float(value) for name, value in leg.along.profile(fmpq(0)).items()}
        still |= dict.fromkeys(leg.problem.vehicle.states, 0.0)

        def rates(inputs: Float[np.ndarray, " m"]) -> Float[np.ndarray, " n"]:
            values = still | {f"input:{name}": value for name, value in zip(names, inputs, strict=True)}
            graph = leg.problem.vehicle.graph
            return np.array(graph.evaluate(values, float, lambda _, name, argument: FUNCTIONS[name](argument)))

        units = np.eye(len(names))
        effects = np.array([rates(unit) - rates(0 * unit) for unit in units])
        rest, *_ = np.linalg.lstsq(effects[1:].T, -rates(units[0]), rcond=None)
        shape = np.array([[float(entry) for entry in row] for row in leg.funnel.shape])
        widths = np.array([float(upper - lower) for lower, upper in box])
        moved = np.einsum("ij,jk,ik->i", effects, shape, effects) * widths**2
        own = [fmpq(1), *(dyadic(value, LEVEL_BITS) for value in rest)]
        clipped = (min(max(value, lower), upper) for value, (lower, upper) in zip(own, box, strict=True))
        return cls(box, tuple(clipped), 1 + int(moved[1:].argmax()))

    def levels(self, fine: int | None = None) -> list[list[fmpq]]:
        """Of each input both ends and the reference's own; of the one that is named what lies in the middle too."""
        found = [sorted({lower, own, upper}) for (lower, upper), own in zip(self.box, self.own, strict=True)]
        if fine is not None:
            found[fine] = sorted({*found[fine], *((one + other) / 2 for one, other in itertools.pairwise(found[fine]))})
        return found


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


def _program(held: HeldRange, cell: HoldCell) -> Program:
    held.domain.budget.left = LARGEST_EFFORT
    return program_of(held, cell)


# --- trees


@dataclass(frozen=True)
class _Leaf:
    """A proven leaf; `spare` is what it shows beyond ρ, 1/s."""

    choice: int
    proofs: tuple[CellProof, ...]
    spare: fmpq

    def written(self) -> dict[str, Any]:
        return {"choice": self.choice, "proofs": list(map(_written, self.proofs))}


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
    above: "_Node | None" = None
    forks: tuple[np.ndarray, ...] = ()
    leaf: _Leaf | None = None
    sides: "tuple[_Node, ...]" = ()

    @property
    def worst(self) -> Float[np.ndarray, " u"]:
        """What is lacking at each input at its worst sample; without samples, of those around."""
        if not len(self.samples.points) and self.above:
            return self.above.worst
        return self.samples.excess.max(axis=0)

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


class _Tried(NamedTuple):
    """A leaf, what was asked and answered, and what that shows beyond ρ, 1/s."""

    cells: list[HoldCell]
    programs: list[Program]
    solutions: list[Solution]
    shown: float


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
        self.near = _fitted(samples.powers, samples.last)  # B_{m−1} as if of a low degree

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
                choice = int(node.worst.argmin())
                if node.worst[choice] <= -target or not self._cut(node, 1.05 * target + 0.05):
                    ready.append((node, choice))
                else:
                    open_ += node.sides
            open_ = self._settled(ready, target)

    def _settled(self, ready: Sequence[tuple[_Node, int]], target: float) -> list[_Node]:
        """Leaves that are proven become so; what is left are the sides of nodes that had to be cut."""
        tried, left = self._tried([(node, (choice,)) for node, choice in ready]), []
        for (node, _), found in zip(ready, tried, strict=True):
            attainable = -float(node.samples.excess.min(axis=1).max(initial=-np.inf))
            if not found.shown > target:
                if self._cut(node, max(1.3 * target + 0.3, attainable)):
                    left += node.sides
                    continue
                (found,) = self._tried([(node, tuple(map(int, node.worst.argsort()[:OTHERS])))])
            node.leaf = self._proven(found)
        return left

    def _tried(self, asked: Sequence[tuple[_Node, tuple[int, ...]]]) -> "list[_Tried]":
        """What sums of squares say of each node, with the best of the inputs that are named for it."""
        leaves = [self._cells(node, choice) for node, choices in asked for choice in choices]
        programs = [[_program(self.held, cell) for cell in cells] for cells in leaves]
        solutions = iter(solved(self.solver, list(itertools.chain.from_iterable(programs))))
        found = []
        for cells, own in zip(leaves, programs, strict=True):
            hints = [next(solutions) for _ in own]
            shown = min(*(hint.margin for hint in hints[:-1]), hints[-1].margin - self.left_out[cells[0].choice])
            found.append(_Tried(cells, own, hints, shown))
        each = iter(found)
        return [max((next(each) for _ in choices), key=lambda one: one.shown) for _, choices in asked]

    def _proven(self, tried: "_Tried") -> _Leaf:
        choice, proofs, spare = tried.cells[0].choice, [], []
        for cell, program, solution in zip(tried.cells, tried.programs, tried.solutions, strict=True):
            self.held.domain.budget.left = LARGEST_EFFORT
            found = prove(self.held, cell, program, solution)
            if found.proof is None:
                raise NotProven(Verdict.SOLVER_FAILED, f"sampled: input {choice} is not proven: {solution}")
            proofs.append(found.proof)
            spare.append(found.margin - self.claim.left_out(choice) * (cell.value == self.claim.order - 1))
        if not (min(spare) > 0 if self.part.is_shell else min(spare) >= 0):
            raise NotProven(
                Verdict.INCONCLUSIVE,
                f"sampled: input {choice} shows {float(min(spare)):.3g} 1/s somewhere, no more",
            )
        return _Leaf(choice, tuple(proofs), min(spare))

    def _cells(self, node: _Node, choice: int) -> list[HoldCell]:
        """What has to be shown for a node to be a leaf of an input."""
        exact = (self.held.fork(tuple(dyadic(value, FORK_BITS) for value in fork)) for fork in node.forks)
        forks = tuple(exact)
        return [HoldCell(j, choice, self.part, forks) for j in range(self.claim.order)]

    def _cut(self, node: _Node, target: float) -> bool:
        """Into two sides, where that can be."""
        fork = self._fork(node.samples, target) if len(node.forks) < DEEPEST else None
        if fork is None:
            return False
        fork = np.round(fork / np.abs(fork).max() * 2**FORK_BITS) / 2**FORK_BITS
        above = node.samples.powers @ fork >= 0
        node.sides = tuple(
            _Node(node.samples.of(side), node, (*node.forks, sign * fork)) for side, sign in ((above, 1), (~above, -1))
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
            for fork in (apart[:, pair], _fitted(powers, difference, weights)):
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


def _fitted(
    powers: Float[np.ndarray, "k p"], values: Float[np.ndarray, "k ..."], weights: Float[np.ndarray, " k"] | float = 1.0
) -> Float[np.ndarray, "p ..."]:
    """Coefficients of the polynomial that is nearest to the values; where samples are few, of a small one."""
    weighted = (powers.T * weights) * weights
    return np.linalg.solve(weighted @ powers + 1e-9 * len(powers) * np.eye(powers.shape[1]), weighted @ values)


def _scores(above: Bool[np.ndarray, "k p"], lacking: Float[np.ndarray, "k u"]) -> Float[np.ndarray, " p"]:
    """What is lacking on both sides of each cut, each with its best input; infinite where a side is empty."""
    first = above.astype(np.float32).T @ lacking.astype(np.float32)
    second = lacking.sum(axis=0) - first
    is_empty = above.all(axis=0) | ~above.any(axis=0)
    return np.where(is_empty, np.inf, first.min(axis=1) + second.min(axis=1))
