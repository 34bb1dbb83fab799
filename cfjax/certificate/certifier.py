"""The certifier: a numerical proof of a path's funnels made exact, stretch by stretch, and put into a document.

Every cell of a stretch's shell (`cfcheck.kernel.decrease`) is one semidefinite program. Its solution is a hint: padded,
rounded to short rationals and replayed in exact arithmetic, which alone decides what margin it proves. What the solver
calls its answer matters only for what is tried: a rounded solution that the exact replay accepts is a proof whoever
made it.
"""

import itertools
import json
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from flint import fmpq

from cfcheck import Outcome, check_document
from cfcheck.claims.assumptions import require_supported
from cfcheck.claims.document import Claims, LegClaim
from cfcheck.claims.hints import MOST_GRAM_ENTRIES
from cfcheck.claims.problem import ProblemClaim, read_problem
from cfcheck.claims.proof import prove_sets
from cfcheck.exact.graph import Graph
from cfcheck.exact.rational import float_below
from cfcheck.exact.symbolic import symbolic
from cfcheck.kernel.legs import Joint, from_zero, gaps
from cfcheck.path.bounds import Bounds
from cfcheck.path.piece import Piece
from cfcheck.reader import Broken, Unreadable
from cfjax.certificate.clearance import NotClear, find_clearance
from cfjax.certificate.joints import widest_ratio
from cfjax.certificate.prover import Means, NotProven, Progress, Prover, StretchProof, place_on
from cfjax.certificate.rounding import RoundedFunnel, round_funnel
from cfjax.certificate.trace import trace_deviation
from cfjax.certificate.writing import dump, seal, write_decrease, write_funnel, write_problem
from cfjax.coerce import function, instances, number, objects, whole
from cfjax.errors import InputError
from cfjax.exact import exact_course, write_clearance
from cfjax.falsifier import Counterexample
from cfjax.funnel import Funnel
from cfjax.funnel.funnel import require_fit
from cfjax.problem import Path, Problem
from cfjax.result import StretchMargin
from cfjax.solver import DEFAULT, Solver, solver_named
from cfjax.verdict import Verdict


@dataclass(frozen=True)
class Certification:
    """Verdict and message (one line); what was certified, for each distinct segment: margins λ in 1/s; times in s.

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
    stretches: tuple[tuple[StretchMargin, ...], ...] = ()  # what is proven along θ
    seconds: dict[str, float] = field(default_factory=dict)  # plan, sos, exact
    counterexamples: tuple[Counterexample, ...] = ()  # deviations that limit the proof, by the duals: for a learner
    failed_at: tuple[float, float] | None = None  # θ along the whole path (s), where one place ended it
    solvers: tuple[str, ...] = ()  # whose hints the proof was made from
    final: bool = False  # what ended it would end the certification of any other funnel too


class Statement(NamedTuple):
    """What is asked: the vehicle's graph, the part of the document that says it, and that as the checker reads it.

    `legs` are the segments of a path, with a funnel for each distinct one.
    """

    graph: Graph
    written: dict[str, Any]
    claim: ProblemClaim
    legs: tuple[LegClaim, ...]

    def pieces(self, kind: int) -> tuple[Piece, ...]:
        """What the first leg with this funnel has of the path, θ from 0 (s)."""
        assert not isinstance(self.claim.course, Bounds)
        leg = next(leg for leg in self.legs if leg.funnel == kind)
        return from_zero(self.claim.course.reference.pieces[leg.begin : leg.end])


def statement_of(problem: Problem) -> Statement:
    """The question that certificates of the problem answer; no funnel is needed to know whether one can.

    Raises:
        InputError: it has no proof of this kind, whatever the funnels: a vehicle with an operation that has no exact
            arithmetic, or one whose reference may not vary as the path does; more than the checker reads.
    """
    objects(problem=(problem, Problem))
    graph = trace_deviation(problem.vehicle)
    written = write_problem(problem, graph)
    try:
        claim = read_problem(written)
        require_supported(claim, symbolic(claim.vehicle.graph, claim.vehicle.states, tuple(claim.inputs)))
    except Broken as error:
        raise InputError(str(error)) from None
    except Unreadable as error:
        raise InputError(f"no checker would read this question: {error}") from None
    return Statement(graph, written, claim, legs_of(problem.path))


def legs_of(path: Path) -> tuple[LegClaim, ...]:
    """A leg for each segment, whose funnel is that of its kind; none for every path within bounds."""
    if path.tube:
        return ()
    counts = Counter(piece.segment for piece in exact_course(path).pieces)
    ends = [0, *itertools.accumulate(counts[index] for index in range(len(path.kinds)))]
    return tuple(map(LegClaim, ends, ends[1:], path.kinds))


def certify(
    problem: Problem,
    funnels: Sequence[Funnel],
    *,
    target: float = 0.0,
    progress: Progress | None = None,
    workers: int = 1,
    solver: str | Solver = DEFAULT,
) -> Certification:
    """Prove the rounded funnels, one for each distinct segment of the path, with the largest margins λ that are shown.

    A segment is cut into as many stretches as the `target` (1/s) needs; with target 0 it is one.
    `progress(stage, done, of)` hears of every cell; the `solver` of that name (`cfjax.solver.SOLVERS`) solves cells,
    `workers` of them side by side.

    Raises:
        InputError: the question has no proof of this kind: see `statement_of`; or the vehicle's dynamics are not of the
            form in which a few references speak for all.
    """
    objects(problem=(problem, Problem))
    distinct, funnels = problem.path.distinct, instances("funnels", funnels, Funnel)
    target, workers = number("target", target, "1/s", least=0), whole("workers", workers, 1)
    function("progress", progress)
    if len(funnels) != len(distinct):
        raise InputError(f"certify: expected {len(distinct)} funnels, one per distinct segment, got {len(funnels)}")
    require_fit(problem, funnels)
    started = time.perf_counter()
    statement = statement_of(problem)
    _, question, claim, legs = statement
    clock = {"plan": 0.0, "sos": 0.0, "exact": time.perf_counter() - started}
    rounded = [round_funnel(funnel, segment) for funnel, segment in zip(funnels, distinct, strict=True)]
    kept = tuple(funnel.funnel for funnel in rounded)
    found: list[list[StretchProof]] = []
    try:
        started = time.perf_counter()
        ratios, clearance = _prove_sets(problem, statement, rounded)
        clock["exact"] += time.perf_counter() - started
        room = MOST_GRAM_ENTRIES
        means = Means(solver_named(solver, workers), clock, progress)
        provers = []
        for kind, funnel in enumerate(rounded):
            prover = Prover(problem, funnel, claim, kind, room, means)
            course = claim.course
            is_placed = not isinstance(course, Bounds)
            found.append(prover.along(statement.pieces(kind), target) if is_placed else prover.everywhere(course))
            provers.append(prover)
            room -= prover.entries * len(found[-1])
    except Broken as error:  # a claim about the vehicle that is not true: no funnel of this kind can be proven
        raise InputError(str(error)) from None
    except NotProven as failure:
        return Certification(
            failure.verdict,
            str(failure),
            funnels=kept,
            seconds=clock,
            counterexamples=failure.counterexamples,
            failed_at=failure.place,
            final=failure.final,
        )
    started = time.perf_counter()
    margins = [min(proof.margin for proof in proofs) for proofs in found]
    per_metre = [None if legs else min(proof.margin_per_metre for proof in proofs) for proofs in found]
    claimed = zip(rounded, margins, per_metre, strict=True)
    document = seal(
        "funnel",
        question,
        [write_funnel(funnel.claim(margin, along)) for funnel, margin, along in claimed],
        {
            "decrease": [
                write_decrease(
                    proofs[0].degrees, prover.question.mirror, [proof.hints for proof in proofs], proofs[0].law_degree
                )
                for prover, proofs in zip(provers, found, strict=True)
            ],
            "clearance": clearance,
        },
        legs,
        ratios,
    )
    # what is replayed is what the file will say: through its text, not through the objects that made it
    report = check_document(json.loads(dump(document)))
    clock["exact"] += time.perf_counter() - started
    proven = report.outcome is Outcome.PROVEN
    every = [proof for proofs in found for proof in proofs]
    return Certification(
        Verdict.CERTIFIED if proven else Verdict.INCONCLUSIVE,
        report.message if proven else f"the checker does not accept the certificate: {report.message}",
        funnels=kept,
        document=document if proven else None,
        margins=tuple(map(float_below, margins)) if proven else None,
        margins_per_metre=tuple(None if margin is None else float_below(margin) for margin in per_metre),
        numerical_margins=tuple(min(proof.numerical for proof in proofs) for proofs in found),
        stretches=tuple(tuple(map(_stretch_margin, proofs)) if legs else () for proofs in found),
        seconds=clock,
        counterexamples=tuple(point for proof in every for point in proof.counterexamples),
        solvers=tuple(sorted({name for proof in every for name in proof.solvers})),
        final=not proven,  # every cell was proven: it is the document that is none
    )


def _stretch_margin(proof: StretchProof) -> StretchMargin:
    return StretchMargin(float(proof.stretch.begin), float(proof.stretch.end), float_below(proof.margin))


def _prove_sets(
    problem: Problem, statement: Statement, rounded: Sequence[RoundedFunnel]
) -> tuple[tuple[fmpq, ...], list]:
    """(a), (b), (c) and the joints, as the checker will look at them: ratios, and half-planes as they are written.

    Raises:
        NotProven: what does not hold.
    """

    def fail(reason: str, place: tuple[float, float] | None = None) -> NotProven:
        return NotProven(Verdict.INCONCLUSIVE, f"not proven: {reason}", place=place)

    claim, course = statement.claim, statement.claim.course
    funnels = tuple(funnel.claim() for funnel in rounded)
    claims = Claims(claim, funnels, (claim.car,) * len(funnels), statement.legs, ())
    try:
        prove_sets(claims, fmpq(1))
    except Broken as error:
        raise fail(str(error)) from None
    if isinstance(course, Bounds):
        return (), []
    ratios = []
    for before, after, gap in gaps(claims.legs, course.closed):
        ratio = widest_ratio(before.funnel.shape, after.funnel.shape)
        if ratio is None or not Joint(before, after, gap, ratio).is_entered(fmpq(1)):
            where = f"from segment {before.index} to segment {after.index}"
            reason = f"{where}: the end of the funnel does not lie inside the start of the next"
            end = problem.path.segments[before.index].duration
            raise fail(reason, place_on(problem.path, before.index, end, end))
        ratios.append(ratio)
    try:
        return tuple(ratios), write_clearance(find_clearance(claim.surroundings, claims.legs))
    except NotClear as error:
        place = place_on(problem.path, error.leg, error.theta, error.theta)
        raise fail(f"condition (c), segment {error.leg}, {error}", place) from None
