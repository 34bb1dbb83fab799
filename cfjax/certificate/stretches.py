"""Condition (d) along one segment or tube: stretches of θ, proven cell by cell.

A stretch is proven for bounds of curvature, speed and acceleration that hold along it, at the levels that the funnel
has there. The longer it is, the more is asked, and the fewer programs there are to solve: as few as reach a target are
planned (`cfjax.certificate.plan`), and one that falls short of it is halved.
"""

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import comb
from typing import Any, NamedTuple

import numpy as np
from flint import fmpq

from cfjax.certificate.fit import DEGREES, SPARING, enclose
from cfjax.certificate.plan import CELLS, plan
from cfjax.certificate.program import MARGIN_BITS, Proven, program_of, prove, solved
from cfjax.certificate.rounding import GRAM_BITS, round_rate, round_shape, round_whitening
from cfjax.certificate.trace import dynamics_of
from cfjax.certificate.writing import write_stretch
from cfjax.check.bounds import Bounds, Extreme, Range, place_of
from cfjax.check.decrease import Cell, SteadyDecrease
from cfjax.check.document import FunnelClaim, SegmentClaim
from cfjax.check.enclosure import LARGEST_EFFORT, Enclosure, TooLarge, UnaryEnclosure
from cfjax.check.graph import Graph
from cfjax.check.hints import MOST_MONOMIALS, CellKey
from cfjax.check.level import LEVELS, Level
from cfjax.check.piece import Piece, between
from cfjax.check.program import Matrix
from cfjax.check.proof import extremes_of, signs_text
from cfjax.check.rational import decimal_text, rational
from cfjax.check.reader import Broken
from cfjax.check.structure import has_tube_structure
from cfjax.check.symbolic import symbolic
from cfjax.falsifier import Suspect
from cfjax.funnel import Funnel
from cfjax.problem import Path, Problem, Segment, Tube
from cfjax.solver import Program, Solution, Solver, Status
from cfjax.verdict import Verdict


SUSPECT_CELLS = 4  # the worst ones, of which the learner hears

MOST_STRETCHES, MOST_HALVINGS = 20, 3  # of a segment; of a stretch that was planned for
SPARE = 1.01  # by which a planned stretch is to be better than needed: the proof shows a little less
SAMPLES = 256  # of a stretch, in which bounds are looked for
BOUND_BITS = 20  # of these bounds
SLACKS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)  # relative, by which they are wider than the samples

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class RoundedFunnel:
    """A funnel whose numbers are short rationals and floating-point numbers at once."""

    funnel: Funnel
    level: Level
    shape: Matrix
    beta_lower: fmpq
    beta_inner: fmpq

    def claim(self, margin: fmpq = fmpq(0), margin_per_metre: fmpq | None = None) -> FunnelClaim:
        """What a file says of it; with a margin of 0 all but its margin."""
        return FunnelClaim(self.level, self.shape, self.beta_lower, self.beta_inner, margin, margin_per_metre)


def round_funnel(funnel: Funnel, segment: Segment | Tube) -> RoundedFunnel:
    """C and rate moved by about a part in 1e9; the duration is the segment's."""
    shape, rate = round_shape(funnel.shape), round_rate(funnel.rate)
    same = replace(
        funnel,
        shape=np.array([[float(entry) for entry in row] for row in shape]),
        rate=float(rate),
        duration=segment.duration,
    )
    level = LEVELS[funnel.template.name](rate)
    return RoundedFunnel(same, level, shape, rational(float(funnel.beta_lower)), rational(float(funnel.inner)))


class NotProven(Exception):
    """Ends a certification with a verdict; where, if in one place: θ from and to (s), along the whole path.

    It is `final` where the reason is no matter of this funnel: another one would meet it too.
    """

    def __init__(
        self,
        verdict: Verdict,
        message: str,
        suspects: Sequence[Suspect] = (),
        place: tuple[float, float] | None = None,
        final: bool = False,
    ) -> None:
        super().__init__(message)
        self.final = final
        self.verdict = verdict
        self.suspects = tuple(suspects)
        self.place = place


def place_on(path: Path, index: int, begin: float, end: float) -> tuple[float, float]:
    """θ from begin to end (s) of one of the path's segments, counted along the whole path."""
    since = sum(segment.duration for segment in path.segments[:index])
    return since + begin, since + end


@dataclass(frozen=True)
class Stretch:
    """θ from begin to end (s), and bounds of the reference that hold there; both ends are 0 for a tube."""

    begin: fmpq
    end: fmpq
    bounds: Bounds

    @property
    def name(self) -> str:
        """Which stretch is spoken of; nothing for a tube."""
        return f"theta from {float(self.begin):.4g} to {float(self.end):.4g} s, " if self.end else ""


@dataclass(frozen=True)
class StretchProof:
    """A proven stretch; margins in 1/s, per metre in 1/m."""

    stretch: Stretch
    degrees: tuple[int, ...]
    margin: fmpq
    margin_per_metre: fmpq
    numerical: float  # optimum of the sums-of-squares programs
    hints: dict[str, Any]
    suspects: tuple[Suspect, ...]
    solvers: tuple[str, ...]  # whose hints they were


def bounded(pieces: Sequence[Piece], begin: fmpq, end: fmpq, is_smooth: bool = False) -> Stretch:
    """The stretch of a segment's pieces with bounds that are proven to hold; of the curvature's rate if it is smooth.

    Raises:
        ValueError: where none are found: the speed is not positive, say.
    """
    parts = between(pieces, begin, end)
    first = parts[0]
    if all(part.is_constant and part.speed == first.speed and part.turn_rate == first.turn_rate for part in parts):
        kappa, v, zero = first.turn_rate[0] / first.speed[0], first.speed[0], fmpq(0)
        return Stretch(begin, end, Bounds((kappa, kappa), (v, v), (zero, zero)))
    profiles = [_sampled(part) for part in parts]
    speed, turn, slope, turn_slope = (np.concatenate(each) for each in zip(*profiles, strict=True))
    if not speed.min() > 0:
        raise ValueError(
            f"the reference does not move forwards between theta = {float(begin):.4g} and {float(end):.4g} s"
        )
    level = (first.speed[0], first.speed[0]), (fmpq(0), fmpq(0))
    for slack in SLACKS:
        moving = level if _is_constant(parts) else (_around(speed, slack), _around(slope, slack))
        changing = _around((turn_slope - turn / speed * slope) / speed, slack) if is_smooth else None
        bounds = Bounds(_around(turn / speed, slack), *moving, changing)
        if bounds.speed[0] > 0 and all(part.inside(bounds) for part in parts):
            return Stretch(begin, end, bounds)
    raise ValueError(f"no bounds are proven between theta = {float(begin):.4g} and {float(end):.4g} s")


def _is_constant(parts: Sequence[Piece]) -> bool:
    """Whether the speed is one and the same number."""
    return all(part.speed == parts[0].speed for part in parts) and len(parts[0].speed) == 1


def _sampled(part: Piece) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Speed, turning rate, acceleration and the turning rate's slope along a piece."""
    t = np.linspace(0.0, float(part.duration), SAMPLES)
    turn, speed = (np.polynomial.Polynomial([float(c) for c in cs]) for cs in (part.turn_rate, part.speed))
    return speed(t), turn(t), speed.deriv()(t) + 0 * t, turn.deriv()(t) + 0 * t


def _around(values: np.ndarray, slack: float) -> Range:
    spare = slack * (1 + float(np.abs(values).max()))
    low, high = math.ldexp(float(values.min()) - spare, BOUND_BITS), math.ldexp(float(values.max()) + spare, BOUND_BITS)
    return fmpq(math.floor(low), 2**BOUND_BITS), fmpq(math.ceil(high), 2**BOUND_BITS)


# --- one stretch


def decreases_on(
    problem: Problem, rounded: RoundedFunnel, graph: Graph, stretch: Stretch, degrees: tuple[int, ...] = ()
) -> list[SteadyDecrease]:
    """What has to be shown for (d), one for each extreme reference, with proven enclosures on the funnel's range.

    `degrees` of the Gram matrices are the least that do unless given.

    Raises:
        TooLarge: Gram matrices, or polynomials, would be larger than a checker reads.
        ValueError: where the question cannot be put: the shell reaches the reference, a pole lies in the funnel.
        Broken: the vehicle's dynamics are not of the form in which a few references speak for all.
    """
    names, states = ("u0", *problem.vehicle.input_names), problem.vehicle.state_names
    box = {
        name: (rational(float(limits.lower)), rational(float(limits.upper)))
        for name, limits in zip(names, problem.inputs, strict=True)
    }
    pieces = rounded.level.shell((stretch.begin, stretch.end), rounded.beta_lower, rounded.beta_inner)
    dynamics = symbolic(graph, states, tuple(box))
    extremes = extremes_of(dynamics, states, box, rounded.shape, stretch.bounds)
    peak = max(piece.upper for piece in pieces)
    question = SteadyDecrease(
        graph=graph,
        states=states,
        extreme=extremes[0],
        inputs=box,
        shape=rounded.shape,
        whitening=round_whitening(rounded.funnel.shape / float(peak)),
        pieces=tuple(pieces),
        enclosures={},
        degrees=(),
    )
    standard = _posed(question, extremes, DEGREES)
    if "inv" in graph.functions_of(states).values():  # V' is multiplied by it: cosines give that degree back
        sparing = _posed(question, extremes, SPARING)
        standard = min(standard, sparing, key=lambda questions: questions[0].degrees[0])
    needed = standard[0].degrees
    if degrees and needed[0] > degrees[0]:
        raise TooLarge(f"V' of degree {2 * needed[0]}, where the stretches before have one of {2 * degrees[0]}")
    degrees = degrees or needed
    _require_readable(len(states), degrees, sum(1 for _ in question.cells()))
    return [replace(each, degrees=degrees) for each in standard]


def _posed(question: SteadyDecrease, extremes: Sequence[Extreme], functions: Mapping[str, int]) -> list[SteadyDecrease]:
    """The question at each of the references, functions being polynomials of these degrees."""
    enclosures: dict[int, UnaryEnclosure] = {}

    def fit_here(node: int, function: str, argument: Enclosure) -> UnaryEnclosure:
        enclosures[node] = enclose(function, argument, functions)
        return enclosures[node]

    # functions are of the state alone wherever there is more than one reference: one enclosure fits all
    replace(question).rates({name: lower for name, (lower, _) in question.inputs.items()}, fit_here)
    questions = [replace(question, extreme=extreme, enclosures=enclosures) for extreme in extremes]
    degrees = max(_gram_degrees(each) for each in questions)
    return [replace(each, degrees=degrees) for each in questions]


def _require_readable(states: int, degrees: tuple[int, ...], cells: int) -> None:
    """That a checker takes Gram matrices so large, of so many cells of a reference: before a monomial is written down.

    Raises:
        TooLarge: says what would be too large.
    """
    rows = [comb(states + degree, degree) for degree in degrees]
    size = f"V' of degree {2 * degrees[0]} in {states} states takes"
    if max(rows) > MOST_MONOMIALS:
        raise TooLarge(f"{size} Gram matrices of {max(rows)} rows, and a checker reads at most {MOST_MONOMIALS}")
    # of their definiteness alone (`proven_margin`)
    effort = cells * sum(count**3 * (1 + count * GRAM_BITS // 2048) for count in rows)
    if effort > LARGEST_EFFORT:
        raise TooLarge(
            f"{size} {cells} times {len(rows)} Gram matrices of up to {max(rows)} rows: {effort / 1e6:.0f} million "
            f"products at least, and a checker does at most {LARGEST_EFFORT / 1e6:.0f} million"
        )


def _gram_degrees(question: SteadyDecrease) -> tuple[int, ...]:
    """Degrees of the monomials: the least for which both sides of the identity can have the same degree.

    An authority of a high degree is cut, for its Gram matrix to have more than a constant.
    """
    sides = (side for cell in question.cells() for side in (question.target(cell), question.drop(cell)))
    order = -(-max(int(side.total_degree()) for side in sides) // 2)
    slopes = [
        max(int(question.authority(piece, name).total_degree()) for piece in question.pieces)
        for name in question.free_inputs
    ]
    least = min(1, order - 1)
    return (order, *(max(least, (2 * order - degree) // 2) for degree in slopes), order - 1, order - 1)


def entries_of(questions: Sequence[SteadyDecrease]) -> int:
    """Entries of the Gram matrices that a stretch takes in a certificate."""
    cells = sum(1 for question in questions for _ in question.cells())
    return cells * sum(len(z) * (len(z) + 1) // 2 for z in questions[0].bases)


class _TooLittle(Exception):
    """A cell of a stretch that may be cut proves less than the target."""


class Means(NamedTuple):
    """By what proofs are found: a solver, a clock (s: `plan`, `sos`, `exact`), and who hears of every cell."""

    solver: Solver
    clock: dict[str, float]
    progress: Progress | None = None


class Prover:
    """Proves the stretches of one segment or tube; `room`: entries of Gram matrices that the file can still hold."""

    def __init__(
        self,
        problem: Problem,
        rounded: RoundedFunnel,
        graph: Graph,
        kind: int,
        room: int,
        means: Means,
    ) -> None:
        self.problem, self.rounded, self.graph, self.kind = problem, rounded, graph, kind
        self.solver, self.clock, self.progress = means
        self.degrees: tuple[int, ...] = ()
        self.is_smooth = not has_tube_structure(dynamics_of(problem.vehicle))
        self.room = room
        self.entries = 0  # of one stretch
        self.cells_done = self.cells_begun = 0

    def along(self, segment: SegmentClaim | Bounds, target: float) -> list[StretchProof]:
        """Stretches that cover the segment, as many as the target (1/s) needs; with target 0 a single one.

        The falsifier plans them. One that proves less than it was planned for is halved, as long as that can help.

        Raises:
            NotProven: a stretch that is not cut any further proves nothing.
        """
        if isinstance(segment, Bounds):
            return [self.prove(Stretch(fmpq(0), fmpq(0), segment), 0.0)]
        pieces, duration = segment.pieces, segment.duration
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
        segment = self.problem.path.distinct[self.kind]
        if not target or isinstance(segment, Tube) or segment.is_steady:
            return (CELLS,), target
        started = time.perf_counter()
        with contextlib.suppress(ValueError):  # the whole segment may be too much to ask about; its size is known then
            whole = bounded(pieces, fmpq(0), duration, self.is_smooth)
            self._count(decreases_on(self.problem, self.rounded, self.graph, whole))
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

    def _can_gain(self, stretch: Stretch) -> bool:
        """Whether shorter stretches could prove more: not where nothing changes along it."""
        return not (stretch.bounds.is_single and self.rounded.level.rate == 0)

    def prove(self, stretch: Stretch, target: float) -> StretchProof:
        """All cells of a stretch.

        Raises:
            _TooLittle: at the first cell that proves less than the target.
            NotProven: with target 0, at the first cell that proves nothing.
        """
        questions = self._exactly(
            lambda: decreases_on(self.problem, self.rounded, self.graph, stretch, self.degrees), stretch.name
        )
        self.degrees = questions[0].degrees
        places = [(index, cell) for index, question in enumerate(questions) for cell in question.cells()]
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
            written.append((_key(index, cell), found.proof.margin, found.proof.grams))
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
            hints=write_stretch(stretch.end, stretch.bounds, questions[0], written),
            suspects=self._suspects(stretch, questions[0], used),
            solvers=tuple(sorted({solution.solver for solution in used})),
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
        self, stretch: Stretch, question: SteadyDecrease, cell: Cell, program: Program, solution: Solution
    ) -> Proven:
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
        stretch: Stretch,
        questions: list[SteadyDecrease],
        index: int,
        cell: Cell,
        found: Proven,
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
            self._suspects(stretch, questions[index], used),
        )

    def _suspects(self, stretch: Stretch, decrease: SteadyDecrease, used: list[Solution]) -> tuple[Suspect, ...]:
        """Deviations near which the worst cells are decided: ± the principal axis of the dual's second moments."""
        whitening = np.array([[float(entry) for entry in row] for row in decrease.whitening])
        theta = float(stretch.begin + stretch.end) / 2
        points = []
        for solution in sorted(used, key=lambda s: s.margin)[:SUSPECT_CELLS]:
            if solution.second_moments is not None and np.isfinite(solution.second_moments).all():
                values, vectors = np.linalg.eigh(solution.second_moments)
                x = whitening @ vectors[:, -1] * math.sqrt(max(values[-1], 0.0))
                points += [tuple(float(entry) for entry in side) for side in (x, -x)]
        return tuple(Suspect(self.kind, theta, point) for point in points)


def _key(index: int, cell: Cell) -> CellKey:
    return index, cell.piece, cell.signs


def _not_possible(error: ValueError, place: str) -> Exception:
    """A claim about the vehicle that is not true is no matter of this funnel: it goes on as it is."""
    if isinstance(error, Broken):
        return error
    return NotProven(Verdict.INCONCLUSIVE, f"not proven: {place}{error}", final=isinstance(error, TooLarge))


def _rounded_down(value: fmpq) -> fmpq:
    return fmpq(math.floor(value * 2**MARGIN_BITS), 2**MARGIN_BITS)


def _named(stretch: Stretch, questions: list[SteadyDecrease], index: int, cell: Cell) -> str:
    place = place_of([question.extreme for question in questions], index)
    return f"{stretch.name}{place}piece {cell.piece}, signs {signs_text(cell.signs)}"
