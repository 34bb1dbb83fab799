"""Condition (d) of one funnel, proven stretch by stretch and cell by cell.

The longer a stretch is, the more has to be shown on it, and the fewer programs there are to solve: as few as reach a
target are planned (`cfjax.certificate.plan`), and one that falls short of it is halved.
"""

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from flint import fmpq

from cfcheck.claims.hints import CellHints, CellKey
from cfcheck.claims.problem import ProblemClaim
from cfcheck.claims.proof import signs_text
from cfcheck.exact.enclosure import TooLarge
from cfcheck.exact.rational import decimal_text, dyadic
from cfcheck.kernel.decrease import Cell, SteadyDecrease
from cfcheck.path.bounds import Bounds, place_of
from cfcheck.path.piece import Piece
from cfcheck.reader import Broken
from cfcheck.vehicle.structure import has_tube_structure
from cfjax.certificate.plan import CELLS, plan
from cfjax.certificate.program import MARGIN_BITS, CellResult, program_of, prove, solved
from cfjax.certificate.rounding import RoundedFunnel
from cfjax.certificate.stretches import ThetaInterval, bounded, decreases_on, entries_of, question_of
from cfjax.certificate.writing import write_stretch
from cfjax.falsifier import Counterexample
from cfjax.problem import Path, Problem
from cfjax.solver import Program, Solution, Solver, Status
from cfjax.verdict import Verdict


COUNTEREXAMPLE_CELLS = 4  # the worst ones, of which the learner hears
MOST_STRETCHES, MOST_HALVINGS = 20, 3  # of a segment; of a stretch that was planned for
ROOM = fmpq(1, 2**30)  # relative, of margins and remainders: for a checker that rounds otherwise
SPARE = 1.01  # by which a planned stretch is to be better than needed: the proof shows a little less

Progress = Callable[[str, int, int], None]


class NotProven(Exception):
    """Ends a certification with a verdict; where, if in one place: θ from and to (s), along the whole path.

    It is `final` where the reason is no matter of this funnel: another one would meet it too.
    """

    def __init__(
        self,
        verdict: Verdict,
        message: str,
        counterexamples: Sequence[Counterexample] = (),
        place: tuple[float, float] | None = None,
        final: bool = False,
    ) -> None:
        super().__init__(message)
        self.final = final
        self.verdict = verdict
        self.counterexamples = tuple(counterexamples)
        self.place = place


def place_on(path: Path, index: int, begin: float, end: float) -> tuple[float, float]:
    """θ from begin to end (s) of one of the path's segments, counted along the whole path."""
    since = sum(segment.duration for segment in path.segments[:index])
    return since + begin, since + end


@dataclass(frozen=True)
class StretchProof:
    """A proven stretch; margins in 1/s, per metre in 1/m."""

    stretch: ThetaInterval
    degrees: tuple[int, ...]
    margin: fmpq
    margin_per_metre: fmpq
    numerical: float  # optimum of the sums-of-squares programs
    hints: dict[str, Any]
    counterexamples: tuple[Counterexample, ...]
    solvers: tuple[str, ...]  # whose hints they were
    law_degree: int | None = None  # of the polynomials that stand for a law


class _TooLittle(Exception):
    """A cell of a stretch that may be cut proves less than the target."""


class Means(NamedTuple):
    """By what proofs are found: a solver, a clock (s: `plan`, `sos`, `exact`), and who hears of every cell."""

    solver: Solver
    clock: dict[str, float]
    progress: Progress | None = None


class Prover:
    """Proves the stretches of one funnel; `room`: entries of Gram matrices that the file can still hold."""

    def __init__(
        self,
        problem: Problem,
        rounded: RoundedFunnel,
        claim: ProblemClaim,
        kind: int,
        room: int,
        means: Means,
    ) -> None:
        self.problem, self.rounded, self.kind = problem, rounded, kind
        self.question = question_of(claim, rounded)
        self.solver, self.clock, self.progress = means
        self.degrees: tuple[int, ...] = ()
        self.is_smooth = not has_tube_structure(self.question.dynamics)
        self.room = room
        self.entries = 0  # of one stretch
        self.cells_done = self.cells_begun = 0

    def everywhere(self, bounds: Bounds) -> list[StretchProof]:
        """The one stretch of an invariant funnel, for every path within bounds.

        Raises:
            NotProven: it proves nothing.
        """
        return [self.prove(ThetaInterval(fmpq(0), fmpq(0), bounds), 0.0)]

    def along(self, pieces: Sequence[Piece], target: float) -> list[StretchProof]:
        """Stretches that cover a leg's pieces, as many as the target (1/s) needs; with target 0 a single one.

        The falsifier plans them. One that proves less than it was planned for is halved, as long as that can help.

        Raises:
            NotProven: a stretch that is not cut any further proves nothing.
        """
        duration = pieces[-1].theta + pieces[-1].duration
        ends, target = self._planned(pieces, duration, target)
        begins = (0, *ends[:-1])
        parts = [(fmpq(begin, CELLS), fmpq(end, CELLS), 0) for begin, end in zip(begins, ends, strict=True)]
        found: list[StretchProof] = []
        open_ = parts[::-1]
        while open_:
            first, last, halvings = open_.pop()
            begin, end = first * duration, last * duration
            with self._at(begin, end):
                stretch = self._exactly(lambda begin=begin, end=end: bounded(pieces, begin, end, self.is_smooth))
                room = len(found) + len(open_) + 2 <= self._most_stretches() and halvings < MOST_HALVINGS
                try:
                    found.append(self.prove(stretch, target if room and self._can_gain(stretch) else 0.0))
                except _TooLittle:
                    middle = (first + last) / 2
                    open_ += [(middle, last, halvings + 1), (first, middle, halvings + 1)]
        return found

    def _planned(self, pieces: Sequence[Piece], duration: fmpq, target: float) -> tuple[tuple[int, ...], float]:
        """Ends of stretches, in cells, and the margin (1/s) with which each is content."""
        path = self.problem.path
        segment = path.curve[path.kinds.index(self.kind)]
        if not target or segment.is_steady:
            return (CELLS,), target
        started = time.perf_counter()
        with contextlib.suppress(ValueError):  # the whole segment may be too much to ask about; its size is known then
            whole = bounded(pieces, fmpq(0), duration, self.is_smooth)
            self._count(decreases_on(self.question, self.rounded, whole))
        funnel, most = self.rounded.funnel, self._most_stretches()
        planned = plan(self.problem, segment, funnel, target, SPARE, most, self.is_smooth)
        self.clock["plan"] += time.perf_counter() - started
        return planned.ends, planned.target

    def _count(self, questions: Sequence[SteadyDecrease]) -> None:
        """How much of the file a stretch takes."""
        self.entries = max(self.entries, entries_of(questions))

    @contextlib.contextmanager
    def _at(self, begin: fmpq, end: fmpq) -> Iterator[None]:
        """What ends a certification in here says where: on the first of the path's segments that are equal to this."""
        try:
            yield
        except NotProven as failure:
            path = self.problem.path
            failure.place = place_on(path, path.kinds.index(self.kind), float(begin), float(end))
            raise

    def _most_stretches(self) -> int:
        """As many as are worth it, and no more than the file can hold beside one for each segment to come."""
        later = len(self.problem.path.distinct) - 1 - self.kind
        own = self.room // self.entries - later if self.entries else MOST_STRETCHES
        return max(1, min(MOST_STRETCHES, own))

    def _can_gain(self, stretch: ThetaInterval) -> bool:
        """Whether shorter stretches could prove more: not where nothing changes along it."""
        return not (stretch.bounds.is_single and self.rounded.level.rate == 0)

    def prove(self, stretch: ThetaInterval, target: float) -> StretchProof:
        """All cells of a stretch.

        Raises:
            _TooLittle: at the first cell that proves less than the target.
            NotProven: with target 0, at the first cell that proves nothing.
        """
        questions = self._exactly(
            lambda: decreases_on(self.question, self.rounded, stretch, self.degrees), stretch.name
        )
        self.degrees = questions[0].degrees
        places = [
            (index, _roomy(question, cell)) for index, question in enumerate(questions) for cell in question.cells()
        ]
        programs = self._exactly(lambda: [program_of(questions[index], cell) for index, cell in places], stretch.name)
        self.cells_begun += len(places)
        self._count(questions)

        started = time.perf_counter()
        solutions = solved(self.solver, programs)
        self.clock["sos"] += time.perf_counter() - started
        written, margins, per_metre, used = [], [], [], []
        for (index, cell), program, solution in zip(places, programs, solutions, strict=True):
            if target and solution.status is Status.OPTIMAL and solution.margin < target:
                raise _TooLittle
            question = questions[index]
            found = self._proven(stretch, question, cell, program, solution)
            used.append(found.solution)
            if found.proof is None or not found.margin > 0:
                raise self._not_proven(stretch, questions, index, cell, found, used)
            if target and not float(found.margin) >= target:
                raise _TooLittle
            assert cell.remainder is not None  # as it is stated
            written.append((_key(index, cell), CellHints(found.proof.margin, cell.remainder, found.proof.grams)))
            margins.append(found.margin)
            per_metre.append(found.margin / question.extreme.profile["speed"])
            self.cells_done += 1
            if self.progress:
                self.progress("certify", self.cells_done, self.cells_begun)
        margin, margin_per_metre = (_rounded_down(min(each)) for each in (margins, per_metre))
        if not min(margin, margin_per_metre) > 0:
            raise NotProven(
                Verdict.INCONCLUSIVE,
                f"condition (d), {stretch.name}margin {decimal_text(min(margins))} is too small to state",
            )
        return StretchProof(
            stretch=stretch,
            degrees=self.degrees,
            margin=margin,
            margin_per_metre=margin_per_metre,
            numerical=min(solution.margin for solution in used),
            hints=write_stretch(stretch.end or None, stretch.bounds, questions[0], written),
            counterexamples=self._counterexamples(stretch, questions[0], used),
            solvers=tuple(sorted({solution.solver for solution in used})),
            law_degree=questions[0].law_degree,
        )

    def _exactly(self, work: Callable[[], Any], place: str = "") -> Any:
        """Work in exact arithmetic, by the clock; what cannot be done ends the certification."""
        started = time.perf_counter()
        try:
            return work()
        except ValueError as error:
            raise _not_possible(error, place) from error
        finally:
            self.clock["exact"] += time.perf_counter() - started

    def _proven(
        self, stretch: ThetaInterval, question: SteadyDecrease, cell: Cell, program: Program, solution: Solution
    ) -> CellResult:
        """The exact proof of a cell, by the clock."""
        started = time.perf_counter()
        try:
            return prove(question, cell, program, solution)
        except TooLarge as error:  # whatever the hints are
            raise _not_possible(error, stretch.name) from error
        finally:
            self.clock["exact"] += time.perf_counter() - started

    def _not_proven(
        self,
        stretch: ThetaInterval,
        questions: list[SteadyDecrease],
        index: int,
        cell: Cell,
        found: CellResult,
        used: list[Solution],
    ) -> NotProven:
        named, solution = _named(stretch, questions, index, cell), found.solution
        if solution.status is Status.FAILED:
            return NotProven(Verdict.SOLVER_FAILED, f"the solver gave no answer for {named}: {solution}")
        verdict = Verdict.INCONCLUSIVE if solution.status is Status.OPTIMAL else Verdict.SOLVER_FAILED
        shown = f"only {decimal_text(found.margin)} is proven" if found.proof else "its rounding is not proven"
        return NotProven(
            verdict,
            f"condition (d), {named}: margin {solution.margin:.6g} ({solution}), {shown}",
            self._counterexamples(stretch, questions[index], used),
        )

    def _counterexamples(
        self, stretch: ThetaInterval, decrease: SteadyDecrease, used: list[Solution]
    ) -> tuple[Counterexample, ...]:
        """Deviations near which the worst cells are decided: ± the principal axis of the dual's second moments."""
        whitening = np.array([[float(entry) for entry in row] for row in decrease.whitening])
        theta = float(stretch.begin + stretch.end) / 2
        points = []
        for solution in sorted(used, key=lambda s: s.margin)[:COUNTEREXAMPLE_CELLS]:
            if solution.second_moments is not None and np.isfinite(solution.second_moments).all():
                values, vectors = np.linalg.eigh(solution.second_moments)
                x = whitening @ vectors[:, -1] * math.sqrt(max(values[-1], 0.0))
                points += [tuple(float(entry) for entry in side) for side in (x, -x)]
        return tuple(Counterexample(self.kind, theta, point) for point in points)


def _key(index: int, cell: Cell) -> CellKey:
    return index, cell.piece, cell.signs


def _not_possible(error: ValueError, place: str) -> Exception:
    """A claim about the vehicle that is not true is no matter of this funnel: it goes on as it is."""
    if isinstance(error, Broken):
        return error
    return NotProven(Verdict.INCONCLUSIVE, f"not proven: {place}{error}", final=isinstance(error, TooLarge))


def _roomy(question: SteadyDecrease, cell: Cell) -> Cell:
    """The cell with a bound of what enclosures leave over that other arithmetic reaches too."""
    constant, square = question.remainder(cell)
    return replace(cell, remainder=(dyadic(constant * (1 + ROOM), up=True), dyadic(square * (1 + ROOM), up=True)))


def _rounded_down(value: fmpq) -> fmpq:
    """A margin that other arithmetic proves too, if not quite as well."""
    return fmpq(math.floor(value * (1 - ROOM) * 2**MARGIN_BITS), 2**MARGIN_BITS)


def _named(stretch: ThetaInterval, questions: list[SteadyDecrease], index: int, cell: Cell) -> str:
    place = place_of([question.extreme for question in questions], index)
    return f"{stretch.name}{place}piece {cell.piece}, signs {signs_text(cell.signs)}"
