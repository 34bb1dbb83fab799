"""A funnel's claims proven: containments, decrease along θ, links from segment to segment, clearance of obstacles.

Condition (d) is proven stretch by stretch. A stretch is a range of θ with bounds of curvature, speed and acceleration
(`cfjax.check.bounds`) that hold along it, and the levels that the funnel has there; θ is eliminated on it, and the
extreme references of its bounds speak for every place. A tube is one stretch, a steady segment one of a single
reference.

Segment i hands over to segment j where {V_i(T_i, ·) ≤ 1} lies in {V_j(0, ·) < 1}: C_i ≻ ρ_i(T_i)/(1 − δ)² C_j, where
the reference jumps by so little that √V_j changes by at most δ (in speed, and at the end of a lap in its pose).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR
from typing import Generic, TypeVar

from flint import fmpq, fmpq_mat

from cfjax.check.bounds import Bounds, Extreme, place_of
from cfjax.check.containment import broken_containments
from cfjax.check.decrease import SteadyDecrease
from cfjax.check.document import (
    Certificate,
    Course,
    FunnelClaim,
    ProblemClaim,
    SegmentClaim,
)
from cfjax.check.enclosure import LARGEST_EFFORT, Budget, UnaryEnclosure
from cfjax.check.hints import CellKey, DecreaseHints, EnclosureHints, StretchHints
from cfjax.check.meaning import require_meaning
from cfjax.check.piece import between, turning_jumps
from cfjax.check.program import CellProof
from cfjax.check.rational import about, bits, decimal_text, is_positive_definite
from cfjax.check.reader import Broken
from cfjax.check.reference import Gap, is_closed
from cfjax.check.structure import is_mirrored, require_affine_reference, require_tube_structure
from cfjax.check.surroundings import Span, prove_surroundings
from cfjax.check.symbolic import Symbolic


MOST_EFFORT = 8 * LARGEST_EFFORT  # of a whole file; a circle's proof takes a million, a stretch of a curve two
ENCLOSURE_EFFORT = 384  # for each bit of the numbers in an enclosure of a function, proven once more on each stretch
Enclosures = dict[int, UnaryEnclosure]  # by node of the graph
Along = TypeVar("Along", bound=SegmentClaim | Bounds, covariant=True)


@dataclass(frozen=True)
class LegClaim(Generic[Along]):
    """A funnel along a segment or, wherever it lies, within bounds: `along`, whatever course the problem has.

    `dynamics` are those of the problem's vehicle, put into symbols once.
    """

    problem: ProblemClaim
    dynamics: Symbolic
    along: Along
    funnel: FunnelClaim


def prove_funnels(certificate: Certificate, dynamics: Symbolic) -> None:
    """Everything that a file with claim `funnel` states of its funnels.

    Raises:
        Broken, ValueError: says what is not proven.
    """
    problem, funnels = certificate.problem, certificate.funnels
    course, kinds = problem.course, problem.kinds
    effort = Budget(MOST_EFFORT)
    require_meaning(problem, dynamics)
    for index, (segment, funnel) in enumerate(zip(problem.distinct, funnels, strict=True)):
        end = funnel.level.bounds(segment.duration)
        broken = broken_containments(problem.vehicle.states, funnel.shape, end, problem.asked(index))
        if broken:
            raise Broken(_of(index, kinds) + "; ".join(broken))
    if isinstance(course, Course):
        _prove_links(course, funnels)
        if problem.surroundings.obstacles:  # else nobody asks where the path lies
            prove_surroundings(problem.surroundings, spans_of(course, funnels), certificate.clearance)
    elif problem.surroundings.obstacles:
        raise Broken("condition (c): a tube has no place, so that it clears no obstacle")
    for index, (segment, funnel, hints) in enumerate(zip(problem.distinct, funnels, certificate.hints, strict=True)):
        try:
            _prove_decrease(LegClaim(problem, dynamics, segment, funnel), hints, effort)
        except Broken as error:
            raise Broken(f"{_of(index, kinds)}{error}") from None


def _of(index: int, kinds: Sequence[int]) -> str:
    """Which segment is spoken of; nothing where there is but one."""
    return f"segment {kinds.index(index)}: " if len(kinds) > 1 else ""


# --- links


def broken_link(first: FunnelClaim, duration: fmpq, second: FunnelClaim, gap: Gap) -> str:
    """Why a funnel's end is not inside another one's start, its reference jumping by the gap; nothing where it is."""
    if _jump(second, gap) >= 1:
        return "the reference jumps by more than the next funnel is wide"
    if not is_entered(first, duration, second, gap, fmpq(1)):
        return "the end of the funnel does not lie inside the start of the next"
    return ""


def is_entered(first: FunnelClaim, duration: fmpq, second: FunnelClaim, gap: Gap, root: fmpq) -> bool:
    """Whether a funnel's end lies in {√V < root} at another one's start, its reference jumping by the gap."""
    room = root - _jump(second, gap)
    if room <= 0:
        return False
    level = first.level.bounds(duration)[1] / room**2
    rows = zip(first.shape, second.shape, strict=True)
    return is_positive_definite([[a - level * b for a, b in zip(one, two, strict=True)] for one, two in rows])


def _jump(funnel: FunnelClaim, gap: Gap) -> fmpq:
    return gap.jump(funnel.shape, fmpq_mat([list(row) for row in funnel.shape]).inv())


def links(course: Course) -> Iterator[tuple[int, int, Gap]]:
    """Segments that follow each other, and how the reference jumps between them: closed at the end of a lap."""
    zero = fmpq(0)
    for index in range(len(course.segments) - 1):
        before, after = course.segments[index].pieces[-1], course.segments[index + 1].pieces[0]
        yield index, index + 1, Gap(zero, zero, zero, abs(before.end_speed - after.speed[0]))
    if course.closed:
        yield len(course.segments) - 1, 0, course.reference.gap


def _prove_links(course: Course, funnels: Sequence[FunnelClaim]) -> None:
    if course.closed and not is_closed(course.reference.gap):
        raise Broken("path: the end of the lap is not its start")
    for before, after, gap in links(course):
        first, second = (funnels[course.kinds[index]] for index in (before, after))
        if reason := broken_link(first, course.segments[before].duration, second, gap):
            raise Broken(f"chain, from segment {before} to segment {after}: {reason}")


def spans_of(course: Course, funnels: Sequence[FunnelClaim]) -> list[Span]:
    """Each segment with the funnel that holds along it."""
    each = zip(course.segments, course.kinds, course.reference.poses, strict=False)
    return [
        Span(f"segment {index}", segment.pieces, start, funnels[kind].shape, funnels[kind].level)
        for index, (segment, kind, start) in enumerate(each)
    ]


# --- decrease


def _prove_decrease(leg: LegClaim[SegmentClaim | Bounds], hints: DecreaseHints, effort: Budget) -> None:
    """Condition (d) with the claimed margins: stretch by stretch, reference by reference, cell by cell."""
    segment, funnel, per_metre = leg.along, leg.funnel, leg.funnel.margin_per_metre
    if not funnel.margin > 0 or (per_metre is not None and not per_metre > 0):
        raise Broken("condition (d): the claimed margin is not positive")
    if isinstance(segment, SegmentClaim) and per_metre is not None:
        raise Broken("condition (d): a margin per metre is claimed for a segment, expected null")
    if isinstance(segment, Bounds) and (funnel.level.rate != 0 or per_metre is None):
        raise Broken("condition (d): the V of a tube has rate 0 and a margin per metre")
    if isinstance(segment, SegmentClaim) and turning_jumps(segment.pieces):
        # from piece to piece, where no stretch sees it: the deviation must not
        require_tube_structure(leg.dynamics)
    begin = fmpq(0)
    for stretch in hints.stretches:
        _check_stretch(segment, begin, stretch)
        _prove_stretch(leg, (begin, stretch.end), hints.degrees, stretch, effort)
        begin = stretch.end
    if begin != segment.duration:
        raise Broken("condition (d): the stretches of the proof do not end where the segment does")


def _check_stretch(segment: SegmentClaim | Bounds, begin: fmpq, stretch: StretchHints) -> None:
    """Its bounds hold along it."""
    if isinstance(segment, Bounds):
        if stretch.end != 0 or stretch.bounds != segment:
            raise Broken("condition (d): a tube is one stretch with the tube's own bounds")
        return
    if not begin < stretch.end <= segment.duration:
        raise Broken("condition (d): the stretches of the proof do not follow each other along the segment")
    if not all(piece.inside(stretch.bounds) for piece in between(segment.pieces, begin, stretch.end)):
        raise Broken(
            f"condition (d): between theta = {about(begin)} and {about(stretch.end)} s the reference leaves the bounds "
            "of the proof"
        )


def extremes_of(
    dynamics: Symbolic,
    states: Sequence[str],
    inputs: Mapping[str, tuple[fmpq, fmpq]],
    shape: Sequence[Sequence[fmpq]],
    bounds: Bounds,
) -> list[Extreme]:
    """The references at which (d) has to be proven for all within the bounds.

    Raises:
        Broken: the vehicle's dynamics are not of the form in which a few speak for all.
    """
    if bounds.is_single:
        return bounds.extremes()
    if bounds.curvature_rate is not None:
        require_affine_reference(dynamics)
        return bounds.extremes()
    require_tube_structure(dynamics)
    return bounds.extremes(is_mirrored(dynamics, states, inputs, shape, bounds))


def _prove_stretch(
    leg: LegClaim[SegmentClaim | Bounds],
    span: tuple[fmpq, fmpq],
    degrees: tuple[int, ...],
    hints: StretchHints,
    effort: Budget,
) -> None:
    problem, funnel = leg.problem, leg.funnel
    extremes = extremes_of(leg.dynamics, problem.vehicle.states, problem.inputs, funnel.shape, hints.bounds)
    where = "condition (d)" if span == (0, 0) else f"condition (d), theta from {about(span[0])} to {about(span[1])} s"
    try:
        pieces = funnel.level.shell(span, funnel.beta_lower, funnel.beta_inner)
        enclosures = prove_enclosures(hints.enclosures, problem.vehicle.graph.functions(), effort)
        questions = [
            SteadyDecrease(
                graph=problem.vehicle.graph,
                states=problem.vehicle.states,
                extreme=extreme,
                inputs=problem.inputs,
                shape=funnel.shape,
                whitening=hints.whitening,
                pieces=tuple(pieces),
                enclosures=enclosures,
                degrees=degrees,
            )
            for extreme in extremes
        ]
        cells = {
            (index, cell.piece, cell.signs): (question, cell)
            for index, question in enumerate(questions)
            for cell in question.cells()
        }
    except ValueError as error:
        raise Broken(f"{where}: {error}") from None
    if cells.keys() != hints.cells.keys():
        raise Broken(f"{where}: the proof has to cover {len(cells)} cells, {_odd_cell(cells, hints, extremes)}")
    per_metre = funnel.margin_per_metre
    for key, (margin, grams) in hints.cells.items():
        place = f"{where}, {_named(key, extremes)}"
        question, cell = cells[key]
        try:
            proven = question.proven_margin(CellProof(cell, margin, grams))
        except ValueError as error:
            raise Broken(f"{place}: {error}") from None
        # affine in the speed between its ends, as V' is (`cfjax.check.structure`)
        claims = [(funnel.margin, fmpq(1), "1/s")]
        if per_metre is not None:
            claims.append((per_metre, question.extreme.profile["speed"], "1/m"))
        for claimed, unit, name in claims:
            if proven < claimed * unit:
                least, shown = decimal_text(claimed, ROUND_CEILING), decimal_text(proven / unit, ROUND_FLOOR)
                raise Broken(f"{place}: margin {least} {name} claimed, {shown} {name} proven")
    # each reference has a budget to itself; all of a file's share another one
    effort.spend(sum(LARGEST_EFFORT - question.domain.budget.left for question in questions))


def prove_enclosures(hints: EnclosureHints, functions: Mapping[int, str], effort: Budget) -> Enclosures:
    """The enclosures of the file, proven; one for each node of the graph that applies a function, of that function.

    Raises:
        ValueError: they are of other functions, or one does not hold.
    """
    if {node: entry[0] for node, entry in hints.items()} != functions:
        raise ValueError("the enclosures are not those of the functions in the graph")
    for _, coefficients, lower, upper, _ in hints.values():
        effort.spend(ENCLOSURE_EFFORT * sum(map(bits, (*coefficients, lower, upper))))
    return {node: UnaryEnclosure(*entry) for node, entry in hints.items()}


def _odd_cell(cells: Mapping[CellKey, object], hints: StretchHints, extremes: list[Extreme]) -> str:
    missing = sorted(cells.keys() - hints.cells.keys())
    return f"but {_named(missing[0], extremes)} is missing" if missing else "but names others"


def _named(key: CellKey, extremes: list[Extreme]) -> str:
    reference, piece, signs = key
    return f"{place_of(extremes, reference)}piece {piece}, signs {signs_text(signs)}"


def signs_text(signs: tuple[int, ...]) -> str:
    return "(" + "".join("+" if sign > 0 else "-" for sign in signs) + ")"
