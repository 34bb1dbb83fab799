"""What a file claims of its funnels, proven: sets, joints, clearance of obstacles, and decrease along every leg.

Condition (d) is proven stretch by stretch. A stretch is a range of θ with bounds of curvature, speed and acceleration
(`cfcheck.path.bounds`) that hold along it on every leg of the funnel, and the levels that the funnel has there; θ is
eliminated on it, and the extreme references of its bounds speak for every place. A funnel that does not change with θ
has one stretch without an end: it holds along legs of any length, or along every path within its bounds. It is proven
for the car that its `Model` is, in the units of that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_CEILING, ROUND_FLOOR

from flint import fmpq

from cfcheck.claims.assumptions import require_supported
from cfcheck.claims.document import Certificate, Claims
from cfcheck.claims.hints import CellKey, DecreaseHints, EnclosureHints, StretchHints
from cfcheck.claims.problem import ProblemClaim
from cfcheck.clearance.surroundings import prove_surroundings
from cfcheck.exact.enclosure import LARGEST_EFFORT, Budget, UnaryEnclosure
from cfcheck.exact.rational import Range, about, bits, decimal_text
from cfcheck.exact.symbolic import Symbolic, symbolic
from cfcheck.kernel.containment import broken_containments
from cfcheck.kernel.decrease import SteadyDecrease
from cfcheck.kernel.funnel import FunnelClaim, Model
from cfcheck.kernel.legs import Leg, different, prove_joints
from cfcheck.kernel.program import CellProof
from cfcheck.path.bounds import Bounds, Extreme, place_of
from cfcheck.path.piece import between, turning_jumps
from cfcheck.reader import Broken
from cfcheck.vehicle.model import check_known_vehicle
from cfcheck.vehicle.structure import is_mirror, require_affine_reference, require_tube_structure


MOST_EFFORT = 16 * LARGEST_EFFORT  # of a whole file; a circle's proof takes a million, a stretch of a curve two
ENCLOSURE_EFFORT = 384  # for each bit of the numbers in an enclosure of a function, proven once more on each stretch
Enclosures = dict[int, UnaryEnclosure]  # by node of the graph


@dataclass(frozen=True)
class Question:
    """Condition (d) of a funnel, in the units of the car that it is proven for.

    `dynamics` are those of that car, in symbols; `mirror` are signs under which all of it is its own mirror image.
    """

    model: Model
    dynamics: Symbolic
    funnel: FunnelClaim
    mirror: tuple[int, ...] | None = None

    def extremes(self, bounds: Bounds) -> list[Extreme]:
        """The references at which (d) has to be proven for all within the bounds.

        Raises:
            Broken: the vehicle's dynamics are not of the form in which a few speak for all.
        """
        if bounds.is_single:
            return bounds.extremes()
        if self.model.law is not None:
            raise Broken("law: it is proven where curvature and speed do not change; on this path they do")
        if bounds.curvature_rate is not None:
            require_affine_reference(self.dynamics)
            return bounds.extremes()
        require_tube_structure(self.dynamics)
        return bounds.extremes(self.is_mirrored(bounds))

    def is_mirrored(self, bounds: Bounds) -> bool:
        """Whether references with the upper end of the curvature speak for those with the lower end."""
        return self.mirror is not None and bounds.curvature[0] == -bounds.curvature[1]


def dynamics_of(model: Model) -> Symbolic:
    """Those of a car, in symbols, after what they and its inputs have to satisfy.

    Raises:
        Broken: says what is not so.
    """
    for name, (lower, upper) in model.inputs.items():
        if lower > upper:
            raise Broken(f"inputs: the lower limit of {name} is above the upper one")
    slowest, fastest = model.inputs["u0"]
    if not 0 < slowest <= 1 <= fastest:
        raise Broken("inputs: the timing input needs 0 < lower <= 1 <= upper")
    dynamics = symbolic(model.vehicle.graph, model.vehicle.states, tuple(model.inputs))
    check_known_vehicle(model.vehicle, model.inputs, dynamics)
    return dynamics


def prove_funnels(certificate: Certificate, dynamics: Symbolic) -> fmpq:
    """Everything that a file with claim `funnel` states: at the end of its path V is at most the number returned.

    `dynamics` are those of the vehicle that drives.

    Raises:
        Broken, ValueError: says what is not proven.
    """
    claims, hints = certificate.claims, certificate.hints
    problem, legs = claims.problem, claims.legs
    require_supported(problem, dynamics)
    finish = legs[-1].end_level(problem.fastest) if legs else fmpq(1)
    prove_sets(claims, finish)
    effort = Budget(MOST_EFFORT)
    questions = [question_of(claims, index, own.mirror, dynamics) for index, own in enumerate(hints)]
    if isinstance(problem.course, Bounds):
        _require_everywhere(problem, problem.course, questions[0].model, hints[0])
    else:
        for index, (question, own) in enumerate(zip(questions, hints, strict=True)):
            _require_same_length(claims.legs_of(index), own)
            for leg in different(claims.legs_of(index)):
                _check_leg(leg, question, own, effort)
        prove_joints(legs, problem.course.closed, claims.ratios, problem.fastest)
        if not problem.surroundings.is_empty:  # else nobody asks where the path lies
            prove_surroundings(problem.surroundings, legs, certificate.clearance)
    for index, (question, own) in enumerate(zip(questions, hints, strict=True)):
        try:
            _prove_decrease(question, own, effort)
        except Broken as error:
            raise Broken(f"{of_funnel(index, claims)}{error}") from None
    return finish


def question_of(claims: Claims, index: int, mirror: tuple[int, ...] | None, dynamics: Symbolic) -> Question:
    """Condition (d) of the funnel with this number; `dynamics` are those of the vehicle that drives.

    Raises:
        Broken: it is proven for a car that is not similar to that one.
    """
    problem, model = claims.problem, claims.models[index]
    if model is not problem.car:
        try:
            dynamics = dynamics_of(model)
            model.require_similar(problem.vehicle, problem.inputs)
        except Broken as error:
            raise Broken(f"{of_funnel(index, claims)}{error}") from None
    return Question(model, dynamics, claims.funnels[index], mirror)


def of_funnel(index: int, claims: Claims) -> str:
    """Which funnel is spoken of; nothing where there is but one."""
    return f"funnel {index}: " if len(claims.funnels) > 1 else ""


# --- sets


def prove_sets(claims: Claims, finish: fmpq) -> None:
    """(a), (b) and (c): I in the first funnel, every one in S, and {V ≤ finish} of the last one in G.

    Raises:
        Broken: says what is not so.
    """
    problem = claims.problem
    for index, funnel in enumerate(claims.driven):
        is_first, is_last = index == claims.first, index == claims.last
        legs = claims.legs_of(index)  # of equal duration, where the funnel changes with θ
        end = funnel.level.form_bounds(finish if is_last else fmpq(1), legs[0].duration if legs else fmpq(0))
        sets = problem.sets(is_first=is_first, is_last=is_last)
        if broken := broken_containments(problem.vehicle.states, funnel.shape, end, sets):
            raise Broken(of_funnel(index, claims) + "; ".join(broken))


# --- decrease


def _require_everywhere(problem: ProblemClaim, bounds: Bounds, model: Model, hints: DecreaseHints) -> None:
    """That the proof is one for every path within the bounds, which has no place."""
    if not problem.surroundings.is_empty:
        raise Broken("condition (c): what has no place clears no obstacle")
    if hints.duration is not None or not bounds.lies_in(model.as_driven(hints.stretches[0].bounds)):
        raise Broken("condition (d): the bounds of the proof are not those of every path that is meant")


def _require_same_length(legs: Sequence[Leg], hints: DecreaseHints) -> None:
    for leg in legs:
        if hints.duration is not None and leg.duration != hints.duration:
            raise Broken(f"leg {leg.index}: the stretches of the proof do not end where the leg does")


def _check_leg(leg: Leg, question: Question, hints: DecreaseHints, effort: Budget) -> None:
    """That the bounds of the proof hold along a leg, as the car that drives has them."""
    if turning_jumps(leg.pieces):  # from piece to piece, where no stretch sees it: the deviation must not
        require_tube_structure(question.dynamics)
    begin = fmpq(0)
    for stretch in hints.stretches:
        end = leg.duration if stretch.end is None else stretch.end
        bounds = question.model.as_driven(stretch.bounds)
        if not all(piece.inside(bounds, effort) for piece in between(leg.pieces, begin, end, effort)):
            raise Broken(
                f"leg {leg.index}: between theta = {about(begin)} and {about(end)} s the reference leaves the bounds "
                "of the proof"
            )
        begin = end


def _prove_decrease(question: Question, hints: DecreaseHints, effort: Budget) -> None:
    """Condition (d) with the claimed margins: stretch by stretch, reference by reference, cell by cell."""
    model, funnel = question.model, question.funnel
    per_metre, is_invariant = funnel.margin_per_metre, hints.duration is None
    if not funnel.margin > 0 or (per_metre is not None and not per_metre > 0):
        raise Broken("condition (d): the claimed margin is not positive")
    if (per_metre is not None) != is_invariant or (is_invariant and funnel.level.rate != 0):
        raise Broken("condition (d): rate 0, a margin per metre and a proof without an end go together")
    if question.mirror is not None and not is_mirror(
        question.dynamics, model.vehicle.states, model.inputs, funnel.shape, question.mirror
    ):
        raise Broken("condition (d): under the signs stated vehicle, funnel and inputs are not their own mirror images")
    if (model.law is None) != (hints.law_degree is None):
        raise Broken("condition (d): a law and the degree of the polynomials that stand for it go together")
    begin = fmpq(0)
    for stretch in hints.stretches:
        end = fmpq(0) if stretch.end is None else stretch.end
        if not (is_invariant or begin < end):
            raise Broken("condition (d): the stretches of the proof do not follow each other")
        _prove_stretch(question, (begin, end), hints, stretch, effort)
        begin = end


def _prove_stretch(question: Question, span: Range, shared: DecreaseHints, hints: StretchHints, effort: Budget) -> None:
    model, funnel = question.model, question.funnel
    extremes = question.extremes(hints.bounds)
    where = "condition (d)" if span == (0, 0) else f"condition (d), theta from {about(span[0])} to {about(span[1])} s"
    try:
        pieces = funnel.level.shell(span, funnel.beta_lower, funnel.beta_inner)
        enclosures = prove_enclosures(hints.enclosures, model.functions, effort)
        decreases = [
            SteadyDecrease(
                graph=model.vehicle.graph,
                states=model.vehicle.states,
                extreme=extreme,
                inputs=model.inputs,
                shape=funnel.shape,
                whitening=hints.whitening,
                pieces=tuple(pieces),
                enclosures=enclosures,
                degrees=shared.degrees,
                law=model.law,
                law_degree=shared.law_degree,
            )
            for extreme in extremes
        ]
        cells = {
            (index, cell.piece, cell.signs): (decrease, cell)
            for index, decrease in enumerate(decreases)
            for cell in decrease.cells()
        }
    except ValueError as error:
        raise Broken(f"{where}: {error}") from None
    if cells.keys() != hints.cells.keys():
        raise Broken(f"{where}: the proof has to cover {len(cells)} cells, {_odd_cell(cells, hints, extremes)}")
    per_metre = funnel.margin_per_metre
    for key, (margin, remainder, grams) in hints.cells.items():
        place = f"{where}, {_named(key, extremes)}"
        decrease, cell = cells[key]
        try:
            proven = decrease.proven_margin(CellProof(replace(cell, remainder=remainder), margin, grams))
        except ValueError as error:
            raise Broken(f"{place}: {error}") from None
        # affine in the speed between its ends, as V' is (`cfcheck.vehicle.structure`)
        claims = [(funnel.margin, fmpq(1), "1/s")]
        if per_metre is not None:
            claims.append((per_metre, decrease.extreme.profile["speed"], "1/m"))
        for claimed, unit, name in claims:
            if proven < claimed * unit:
                least, shown = decimal_text(claimed, ROUND_CEILING), decimal_text(proven / unit, ROUND_FLOOR)
                raise Broken(f"{place}: margin {least} {name} claimed, {shown} {name} proven")
    # each reference has a budget to itself; all of a file's share another one
    effort.spend(sum(LARGEST_EFFORT - decrease.domain.budget.left for decrease in decreases))


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
    return "(" + "".join("-0+"[1 + sign] for sign in signs) + ")"
