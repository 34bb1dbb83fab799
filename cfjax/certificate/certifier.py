"""The certifier: a numerical proof of condition (d) made exact, cell by cell, and put into a document.

Every cell of the shell (`cfjax.check.decrease`) is one semidefinite program. Its solution is a hint: padded, rounded to
short rationals and replayed in exact arithmetic, which alone decides what margin it proves. What the solver calls its
answer matters only for what is tried: a rounded solution that the exact replay accepts is a proof whoever made it.
"""

import json
import math
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from flint import fmpq, fmpq_mpoly

from cfjax.certificate.fit import enclose
from cfjax.certificate.rounding import dyadic, round_gram, round_rate, round_shape, round_whitening
from cfjax.certificate.sos import SosSolution, solve
from cfjax.certificate.trace import trace_deviation
from cfjax.certificate.writing import Gram, dump, seal, write_funnel, write_problem, write_steady_proof
from cfjax.check import Outcome, check_document
from cfjax.check.containment import broken_containments
from cfjax.check.decrease import Cell, CellProof, Exponents, Extreme, Matrix, SteadyDecrease, steady_pieces
from cfjax.check.document import SegmentClaim, unpack_triangle
from cfjax.check.enclosure import Enclosure, UnaryEnclosure
from cfjax.check.graph import Graph
from cfjax.check.rational import decimal_text, float_below, rational
from cfjax.check.reader import Broken
from cfjax.check.symbolic import symbolic
from cfjax.check.tube import TubeClaim, is_mirrored, place_of, require_tube_structure
from cfjax.errors import InputError
from cfjax.funnel import Funnel
from cfjax.problem import Problem, Segment, Tube
from cfjax.verdict import Verdict


PADDINGS = (1e-7, 1e-6, 1e-5, 1e-4)  # of the largest Gram entry; tried in this order until the proof holds
SUSPECT_CELLS = 4  # the worst ones, of which the learner hears
MARGIN_BITS = 40  # of the margin that the document claims: rounded down
USABLE = ("optimal",)
HINT_ONLY = ("optimal_inaccurate",)  # Clarabel's AlmostSolved: no solution, but the exact replay may like it

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Certification:
    """Verdict and message (one line); what was certified, with margins λ in 1/s per segment and times in s.

    CERTIFIED means that the exact checker accepted the document. Whoever writes it to disk has the file checked again
    (`cfjax.check.check_file`) before saying so to anybody.
    """

    verdict: Verdict
    message: str
    funnels: tuple[Funnel, ...] = ()  # as rounded: these, not those given, are what the document is about
    document: dict[str, Any] | None = None
    margins: tuple[float, ...] | None = None  # not above the exact rationals in the document
    margins_per_metre: tuple[float | None, ...] = ()  # of tubes, likewise; None for segments
    numerical_margins: tuple[float, ...] = ()  # optimum of the sums-of-squares programs
    seconds: dict[str, float] = field(default_factory=dict)  # sos, exact
    suspects: tuple[tuple[float, ...], ...] = ()  # deviations that limit the proof, by the duals: for a learner


class _NotProven(Exception):
    """Ends a certification with a verdict."""

    def __init__(
        self, verdict: Verdict, message: str, numerical: float = math.nan, suspects: tuple[tuple[float, ...], ...] = ()
    ) -> None:
        super().__init__(message)
        self.verdict = verdict
        self.numerical = numerical
        self.suspects = suspects


def certify(
    problem: Problem, funnels: Sequence[Funnel], *, progress: Progress | None = None, workers: int = 1
) -> Certification:
    """Prove conditions (a)–(d) for the rounded funnels, one per segment, with the largest margin λ that can be shown.

    `progress(stage, done, of)` hears of every cell; `workers` threads solve cells side by side.

    Raises:
        InputError: the question has no proof of this kind: a segment that is not steady, a chain, a vehicle with an
            operation that has no exact arithmetic.
    """
    segments = problem.path.segments
    if len(funnels) != len(segments):
        raise InputError(f"certify: expected {len(segments)} funnels, one per segment, got {len(funnels)}")
    if len(segments) > 1:
        raise InputError(f"certify: expected one segment, got {len(segments)}; no proof links chains of segments yet")
    for index, segment in enumerate(segments):
        if not segment.is_steady:
            raise InputError(
                f"certify: expected segments of constant turning rate and speed, segment {index} changes along theta"
            )
    graph = trace_deviation(problem.vehicle)
    clock = {"sos": 0.0, "exact": 0.0}
    rounded = [round_funnel(funnel, segment) for funnel, segment in zip(funnels, segments, strict=True)]
    found: list[_SegmentProof] = []
    try:
        for funnel, segment in zip(rounded, segments, strict=True):
            found.append(_certify_segment(problem, segment, funnel, graph, progress, workers, clock))
    except _NotProven as failure:
        return Certification(
            failure.verdict,
            str(failure),
            funnels=tuple(funnel.funnel for funnel in rounded),
            numerical_margins=() if math.isnan(failure.numerical) else (failure.numerical,),
            seconds=clock,
            suspects=failure.suspects,
        )
    started = time.perf_counter()
    document = seal(
        "funnel",
        write_problem(problem, graph),
        [funnel.write(proof.margin, proof.margin_per_metre) for funnel, proof in zip(rounded, found, strict=True)],
        [proof.hints for proof in found],
    )
    # what is replayed is what the file will say: through its text, not through the objects that made it
    report = check_document(json.loads(dump(document)))
    clock["exact"] += time.perf_counter() - started
    proven = report.outcome is Outcome.PROVEN
    hinted = sum(proof.hinted for proof in found)
    note = f" ({hinted} cells from inaccurate solutions: the exact replay does not mind)" if hinted else ""
    return Certification(
        Verdict.CERTIFIED if proven else Verdict.INCONCLUSIVE,
        report.message + note if proven else f"the checker does not accept the certificate: {report.message}",
        funnels=tuple(funnel.funnel for funnel in rounded),
        document=document if proven else None,
        margins=tuple(float_below(proof.margin) for proof in found) if proven else None,
        margins_per_metre=tuple(
            None if proof.margin_per_metre is None else float_below(proof.margin_per_metre) for proof in found
        ),
        numerical_margins=tuple(proof.numerical for proof in found),
        seconds=clock,
        suspects=tuple(point for proof in found for point in proof.suspects),
    )


@dataclass(frozen=True)
class RoundedFunnel:
    """A funnel whose numbers are short rationals and floating-point numbers at once."""

    funnel: Funnel
    shape: Matrix
    rate: fmpq
    beta_lower: fmpq
    beta_inner: fmpq
    duration: fmpq  # zero for a tube: θ is nowhere in its proof

    def write(self, margin: fmpq, margin_per_metre: fmpq | None) -> dict[str, Any]:
        levels = self.beta_lower, self.beta_inner
        return write_funnel(self.funnel.template.name, self.shape, self.rate, levels, margin, margin_per_metre)


def round_funnel(funnel: Funnel, segment: Segment | Tube) -> RoundedFunnel:
    """C and rate moved by about a part in 1e9; the duration is the segment's."""
    shape, rate = round_shape(funnel.shape), round_rate(funnel.rate)
    duration = fmpq(0) if isinstance(segment, Tube) else rational(float(segment.duration))
    same = replace(
        funnel,
        shape=np.array([[float(entry) for entry in row] for row in shape]),
        rate=float(rate),
        duration=segment.duration,
    )
    beta_lower, beta_inner = rational(float(funnel.beta_lower)), rational(float(funnel.inner))
    return RoundedFunnel(same, shape, rate, beta_lower, beta_inner, duration)


@dataclass(frozen=True)
class _SegmentProof:
    margin: fmpq
    margin_per_metre: fmpq | None
    numerical: float
    hints: dict[str, Any]
    suspects: tuple[tuple[float, ...], ...]
    hinted: int  # cells whose solution was only a hint


def steady_decreases(
    problem: Problem, segment: Segment | Tube, rounded: RoundedFunnel, graph: Graph
) -> list[SteadyDecrease]:
    """What has to be shown for (d), one for each extreme reference, with proven enclosures on the funnel's range.

    Raises:
        ValueError: where the question cannot be put: the shell reaches the reference, a pole lies in the funnel.
        Broken: the vehicle's dynamics are not of the form that tubes need.
    """
    names = ("u0", *problem.vehicle.input_names)
    box = {
        name: (rational(float(limits.lower)), rational(float(limits.upper)))
        for name, limits in zip(names, problem.inputs, strict=True)
    }
    name, rate = rounded.funnel.template.name, rounded.rate
    pieces = steady_pieces(name, rate, rounded.duration, rounded.beta_lower, rounded.beta_inner)
    extremes = _extremes(problem, segment, rounded, graph, box)
    question = SteadyDecrease(
        graph=graph,
        states=problem.vehicle.state_names,
        extreme=extremes[0],
        inputs=box,
        shape=rounded.shape,
        whitening=round_whitening(rounded.funnel.shape),
        pieces=tuple(pieces),
        enclosures={},
        degrees=(),
    )
    enclosures: dict[int, UnaryEnclosure] = {}

    def fit_here(node: int, function: str, argument: Enclosure) -> Enclosure:
        enclosures[node] = enclose(function, argument)
        return argument.apply(enclosures[node])

    # functions are of the state alone wherever there is more than one reference: one enclosure fits all
    question.rates({name: lower for name, (lower, _) in box.items()}, fit_here)
    questions = [replace(question, extreme=extreme, enclosures=enclosures) for extreme in extremes]
    degrees = max(_gram_degrees(question) for question in questions)
    return [replace(question, degrees=degrees) for question in questions]


def _extremes(
    problem: Problem,
    segment: Segment | Tube,
    rounded: RoundedFunnel,
    graph: Graph,
    box: dict[str, tuple[fmpq, fmpq]],
) -> list[Extreme]:
    if isinstance(segment, Segment):
        point = segment.point(0.0)
        return SegmentClaim(rounded.duration, rational(float(point.turn_rate)), rational(float(point.speed))).extremes()
    dynamics = symbolic(graph, problem.vehicle.state_names, tuple(box))
    require_tube_structure(dynamics)
    bounds = (
        (rational(float(interval.lower)), rational(float(interval.upper)))
        for interval in (segment.curvature, segment.speed, segment.acceleration)
    )
    claim = TubeClaim(*bounds)
    return claim.extremes(is_mirrored(dynamics, problem.vehicle.state_names, box, rounded.shape, claim))


def _gram_degrees(question: SteadyDecrease) -> tuple[int, ...]:
    """Degrees of the monomials: the least for which both sides of the identity can have the same degree."""
    cells = list(question.cells())
    constraints = zip(*(question.constraints(cell) for cell in cells), strict=True)
    limits = [max(int(g.total_degree()) for g in column) for column in constraints]
    order = -(-max([int(question.target(cell).total_degree()) for cell in cells] + limits) // 2)
    return (order, *((2 * order - limit) // 2 for limit in limits))


def _certify_segment(
    problem: Problem,
    segment: Segment | Tube,
    rounded: RoundedFunnel,
    graph: Graph,
    progress: Progress | None,
    workers: int,
    clock: dict[str, float],
) -> _SegmentProof:
    started = time.perf_counter()
    try:
        broken = _broken_containments(problem, rounded)
        if broken:
            raise _NotProven(Verdict.INCONCLUSIVE, f"not proven: {'; '.join(broken)}")
        questions = steady_decreases(problem, segment, rounded, graph)
        places = [(index, cell) for index, question in enumerate(questions) for cell in question.cells()]
        programs = [_program(questions[index], cell) for index, cell in places]
    except Broken as error:  # a claim about the vehicle that is not true: no funnel of this kind can be proven
        raise InputError(str(error)) from None
    except ValueError as error:
        raise _NotProven(Verdict.INCONCLUSIVE, f"not proven: {error}") from None
    clock["exact"] += time.perf_counter() - started

    written, margins, per_metre, solved = [], [], [], []
    for done, ((index, cell), solution) in enumerate(zip(places, _solutions(programs, workers), strict=True)):
        decrease = questions[index]
        clock["sos"] += solution.seconds
        solved.append(solution)
        numerical = min(answer.margin for answer in solved)
        if solution.status not in USABLE + HINT_ONLY or not _is_finite(solution):
            message = f"the solver gave no answer for {_named(questions, index, cell)}: {solution.status}"
            raise _NotProven(Verdict.SOLVER_FAILED, message)
        started = time.perf_counter()
        proof, grams, proven = _exact_proof(decrease, cell, solution)
        clock["exact"] += time.perf_counter() - started
        if proof is None or not proven > 0:
            verdict = Verdict.INCONCLUSIVE if solution.status in USABLE else Verdict.SOLVER_FAILED
            shown = f"only {decimal_text(proven)} is proven" if proof else "its rounding is not proven"
            raise _NotProven(
                verdict,
                f"condition (d), {_named(questions, index, cell)}: margin {solution.margin:.6g} ({solution.status}), "
                f"{shown}",
                numerical,
                _suspects(decrease, solved),
            )
        written.append(((index, cell.piece, cell.signs), proof.margin, grams))
        margins.append(proven)
        per_metre.append(proven / decrease.extreme.profile["speed"])
        if progress:
            progress("certify", done + 1, len(places))
    margin, margin_per_metre = (
        fmpq(math.floor(min(found) * 2**MARGIN_BITS), 2**MARGIN_BITS) for found in (margins, per_metre)
    )
    if not min(margin, margin_per_metre) > 0:
        raise _NotProven(
            Verdict.INCONCLUSIVE, f"condition (d): margin {decimal_text(min(margins))} is too small to state"
        )
    return _SegmentProof(
        margin=margin,
        margin_per_metre=margin_per_metre if isinstance(segment, Tube) else None,
        numerical=min(solution.margin for solution in solved),
        hints=write_steady_proof(questions[0], written),
        suspects=_suspects(questions[0], solved),
        hinted=sum(solution.status in HINT_ONLY for solution in solved),
    )


def _is_finite(solution: SosSolution) -> bool:
    return (
        solution.grams is not None
        and math.isfinite(solution.margin)
        and all(np.isfinite(gram).all() for gram in solution.grams)
    )


def _suspects(decrease: SteadyDecrease, solved: list[SosSolution]) -> tuple[tuple[float, ...], ...]:
    """Deviations near which the worst cells are decided: ± the principal axis of the dual's second moments."""
    whitening = np.array([[float(entry) for entry in row] for row in decrease.whitening])
    points = []
    for solution in sorted(solved, key=lambda s: s.margin)[:SUSPECT_CELLS]:
        if solution.second_moments is not None and np.isfinite(solution.second_moments).all():
            values, vectors = np.linalg.eigh(solution.second_moments)
            x = whitening @ vectors[:, -1] * math.sqrt(max(values[-1], 0.0))
            points += [tuple(x), tuple(-x)]
    return tuple(tuple(float(entry) for entry in point) for point in points)


def _broken_containments(problem: Problem, rounded: RoundedFunnel) -> list[str]:
    def exact(values: Sequence[float]) -> list[fmpq]:
        return [rational(float(value)) for value in values]

    return broken_containments(
        problem.vehicle.state_names,
        rounded.shape,
        rounded.funnel.template.name,
        rounded.rate,
        rounded.duration,
        exact(problem.inlet.half_axes),
        exact(problem.goal.half_axes),
        exact(problem.safe.half_widths) if problem.safe else None,
    )


_Program = tuple[fmpq_mpoly, fmpq_mpoly, list[fmpq_mpoly], tuple[tuple[Exponents, ...], ...]]


def _program(decrease: SteadyDecrease, cell: Cell) -> _Program:
    """What `solve` is asked about a cell. Made in one thread: only the solver works beside others."""
    drop = decrease.drop(decrease.pieces[cell.piece])
    return decrease.target(cell), drop, decrease.constraints(cell), decrease.bases


def _solutions(programs: list[_Program], workers: int) -> Iterator[SosSolution]:
    """Numerical solutions in the order of the programs."""
    if workers <= 1:
        yield from (solve(*program) for program in programs)
        return
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(lambda program: solve(*program), programs)


def _exact_proof(
    decrease: SteadyDecrease, cell: Cell, solution: SosSolution
) -> tuple[CellProof | None, list[Gram], fmpq]:
    """The first padding with which the exact replay accepts the rounded solution, and the margin it then proves."""
    assert solution.grams is not None
    for padding in PADDINGS:
        grams = [round_gram(gram, padding) for gram in solution.grams]
        matrices = tuple(
            unpack_triangle([fmpq(entry, 2**exponent) for entry in lower], len(basis))
            for (exponent, lower), basis in zip(grams, decrease.bases, strict=True)
        )
        proof = CellProof(cell, dyadic(solution.margin, MARGIN_BITS), matrices)
        budget = decrease.domain.budget
        left = budget.left
        try:
            return proof, grams, decrease.proven_margin(proof)
        except ValueError:  # not positive definite yet; the checker will not see this attempt, nor pay for it
            budget.left = left
    return None, [], fmpq(0)


def _named(questions: list[SteadyDecrease], index: int, cell: Cell) -> str:
    place = place_of([question.extreme for question in questions], index)
    return f"{place}piece {cell.piece}, signs ({''.join('+' if sign > 0 else '-' for sign in cell.signs)})"
