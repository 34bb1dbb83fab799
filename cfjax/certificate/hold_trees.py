"""Trees that cut a range of levels, so that on each leaf one input of a finite set is good for a whole hold.

They are grown on samples. Where one input does it for all samples of a node, sums of squares are asked; a node where
they show too little, or where no input does it alone, is cut where two of the inputs are equally good.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from flint import fmpq
from jaxtyping import Bool, Float, Int

from cfcheck.exact.enclosure import LARGEST_EFFORT
from cfcheck.kernel.program import CellProof
from cfcheck.robustness.ranges import DEGREES, FORK_DEGREE, HeldRange, HoldCell, Part, SampledClaim
from cfjax.certificate.program import coefficients, program_of, prove, solved
from cfjax.certificate.prover import NotProven
from cfjax.certificate.rounding import dyadic
from cfjax.certificate.writing import write_grams
from cfjax.solver import Program, Solution, Solver
from cfjax.solver.points import vandermonde
from cfjax.verdict import Verdict


POINTS, FEW = 30_000, 2_000  # samples of a range, and of a node that is looked at closely
DEEPEST = 16  # forks on the way to a leaf
OTHERS = 4  # inputs that are tried where a node cannot be cut
CANDIDATES = 6  # pairs of inputs, of which the cut where they are equal is looked at closely
FORK_BITS = 24

Points = Float[np.ndarray, "k n"]


def program_at(held: HeldRange, cell: HoldCell) -> Program:
    """What a solver is asked about a cell, with the effort that a checker has for one."""
    held.domain.budget.left = LARGEST_EFFORT
    return program_of(held, cell)


def write_proof(proof: CellProof) -> dict[str, Any]:
    """Margin and Gram matrices."""
    return {"margin": str(proof.margin), "grams": write_grams(proof.grams)}


@dataclass(frozen=True)
class ProvenLeaf:
    """A proven leaf; `spare` is what it shows beyond ρ, 1/s."""

    choice: int
    proofs: tuple[CellProof, ...]
    spare: fmpq

    def written(self) -> dict[str, Any]:
        return {"choice": self.choice, "proofs": list(map(write_proof, self.proofs))}


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
    leaf: ProvenLeaf | None = None
    sides: "tuple[_Node, ...]" = ()

    @property
    def worst(self) -> Float[np.ndarray, " u"]:
        """What is lacking at each input at its worst sample; without samples, of those around."""
        if not len(self.samples.points) and self.above:
            return self.above.worst
        return self.samples.excess.max(axis=0)

    def leaves(self) -> Iterator[ProvenLeaf]:
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


class TreeGrower:
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
    def leaves(self) -> list[ProvenLeaf]:
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

    def _tried(self, tried: Sequence[tuple[_Node, tuple[int, ...]]]) -> "list[_Tried]":
        """What sums of squares say of each node, with the best of the inputs that are named for it."""
        leaves = [self._cells(node, choice) for node, choices in tried for choice in choices]
        programs = [[program_at(self.held, cell) for cell in cells] for cells in leaves]
        solutions = iter(solved(self.solver, list(itertools.chain.from_iterable(programs))))
        found = []
        for cells, own in zip(leaves, programs, strict=True):
            hints = [next(solutions) for _ in own]
            shown = min(*(hint.margin for hint in hints[:-1]), hints[-1].margin - self.left_out[cells[0].choice])
            found.append(_Tried(cells, own, hints, shown))
        each = iter(found)
        return [max((next(each) for _ in choices), key=lambda one: one.shown) for _, choices in tried]

    def _proven(self, tried: "_Tried") -> ProvenLeaf:
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
        return ProvenLeaf(choice, tuple(proofs), min(spare))

    def _cells(self, node: _Node, choice: int) -> list[HoldCell]:
        """What has to be shown for a node to be a leaf of an input."""
        forks = tuple(self.held.fork(tuple(dyadic(value, FORK_BITS) for value in fork)) for fork in node.forks)
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
