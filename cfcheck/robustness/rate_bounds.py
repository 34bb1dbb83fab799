"""Bounds over one certified funnel while inputs are held: on V̇, V̈ and what errors do to them, proven from hints.

`cfcheck.robustness.amounts` says what follows from them, and what the letters mean. A funnel that changes with θ has
its bounds stretch by stretch, for what the reference does there on every leg of it. Curvature and acceleration that
jump inside a leg, where V̇ jumps by J in all, take J out of λ'.

**Invariant funnels.** Where a funnel holds along any path within bounds, curvature and acceleration may jump at any
time, and as often. So λ' is asked of the law at every one of them: ∇V·f(x, u, r') ≤ −λ' for all r' of the speed at hand
(`cfjax.control.any_path_numbers`; f is affine in what differs). How fast this can rise for an r' of fixed curvature and
acceleration, beside whatever the path does meanwhile, M bounds (`cfcheck.robustness.hold`), and V̇ is its value at the
r' of the moment: the inequalities hold as they are, without J. M grows with the square of the speed and λ' = max(λ, μ
v) with its first power, so the speeds are cut into **bands**. While what was measured is in use the speed may leave its
band, by no more than its acceleration takes it in HORIZON seconds: the bounds hold for such speeds too, and no amount
of time is longer.

What all funnels of a certificate give together says `cfcheck.robustness.descent`.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from flint import fmpq

from cfcheck.claims.proof import Question, prove_enclosures
from cfcheck.exact.enclosure import LARGEST_EFFORT, Budget
from cfcheck.exact.polynomial import Coefficients, bernstein, derivative, evaluate
from cfcheck.exact.rational import Range, sqrt_upper
from cfcheck.kernel.funnel import FunnelClaim
from cfcheck.kernel.legs import Leg, different
from cfcheck.kernel.program import CellProof, Gram
from cfcheck.path.bounds import Bounds
from cfcheck.path.piece import Piece, between
from cfcheck.reader import Broken
from cfcheck.robustness.amounts import MOST, SHARE, Rates, dot
from cfcheck.robustness.hold import FROZEN, ORDERS, REFERENCE, TIMING, HeldCell, HeldMotion, derivatives_of, frozen_name
from cfcheck.robustness.hold_hints import DEGREES, MOST_VERTICES, HeldStretch, PieceHints
from cfcheck.robustness.spare import Terms, require_affine
from cfcheck.vehicle.structure import SPEED, SPEED_SLOPE, TURN_RATE, TURN_RATE_SLOPE, require_tube_structure


HORIZON = fmpq(1, 20)  # s


def bands_of(bounds: Bounds, hints: Sequence[HeldStretch]) -> tuple[Range, ...]:
    """The bands of speed (m/s) that the hints are for.

    Raises:
        Broken: they do not cover the speeds of the bounds, one after another.
    """
    ends = [stretch.end for stretch in hints]
    begins = [bounds.speed[0], *ends[:-1]]
    if ends[-1] != bounds.speed[1] or any(low >= high for low, high in zip(begins, ends, strict=True) if len(ends) > 1):
        raise Broken("robustness: the bands of speed do not follow each other up to the highest")
    return tuple(zip(begins, ends, strict=True))


def rates_along(question: Question, legs: Sequence[Leg], hints: Sequence[HeldStretch], effort: Budget) -> Rates:
    """Bounds over a funnel that changes with θ, for all of its legs, from hints for every stretch of it.

    Raises:
        Broken, ValueError: says what is not proven.
    """
    funnel, duration = question.funnel, legs[0].duration
    found: list[_Sizes] = []
    begin = fmpq(0)
    for stretch in hints:
        if not begin < stretch.end <= duration:
            raise Broken("robustness: the stretches do not follow each other along the leg")
        found += _prove_levels(question, motions(question, legs, (begin, stretch.end), effort), stretch.pieces, effort)
        begin = stretch.end
    if begin != duration:
        raise Broken("robustness: the stretches do not end where the leg does")
    jumps = (
        sum((_jump(one, other, found) for one, other in itertools.pairwise(leg.pieces)), fmpq(0))
        for leg in different(legs)
    )
    return _rates_of(funnel, found, SHARE * funnel.margin - max(jumps))


def rates_within(question: Question, bounds: Bounds, band: Range, hints: Sequence[PieceHints], effort: Budget) -> Rates:
    """Bounds over an invariant funnel, along paths within bounds, for what is measured at a speed of the band (m/s).

    Raises:
        Broken, ValueError: says what is not proven.
    """
    require_tube_structure(question.dynamics)
    funnel = question.funnel
    found = _prove_levels(question, motions_within(question, bounds, band), hints, effort)
    assert funnel.margin_per_metre is not None  # of an invariant funnel, as is proven
    decrease = SHARE * max(funnel.margin, funnel.margin_per_metre * band[0])
    return replace(_rates_of(funnel, found, decrease), horizon=MOST if bounds.acceleration == (0, 0) else HORIZON)


def _rates_of(funnel: FunnelClaim, found: "Sequence[_Sizes]", decrease: fmpq) -> Rates:
    """The largest of the bounds on all ranges of levels."""
    states = range(len(found[0].slopes))
    least, peak = min(sizes.least_weight for sizes in found), max(sizes.level for sizes in found)
    widest, scale = funnel.level.deviation_scale(least, peak)
    norms = tuple(sqrt_upper(scale * funnel.shape[i][i]) for i in states)
    slopes = tuple(max(sizes.slopes[i] for sizes in found) for i in states)
    speeds = tuple(max(sizes.speeds[i] for sizes in found) for i in states)
    return Rates(
        rise=max(sizes.rise for sizes in found),
        bend=max(sizes.bend for sizes in found),
        slopes=slopes,
        gradient=tuple(2 * widest * norm for norm in norms),
        norms=norms,
        widest=widest,
        staleness=dot(slopes, speeds) + max(sizes.stir for sizes in found),
        decrease=decrease,
        inner=funnel.beta_lower,
    )


class _Sizes(NamedTuple):
    """What is proven on one range of levels of a stretch."""

    level: fmpq  # the largest q
    least_weight: fmpq  # at most every 1/σ
    rise: fmpq  # V̇
    bend: fmpq  # V̈
    slopes: tuple[fmpq, ...]  # |∂V̇/∂x_i|
    speeds: tuple[fmpq, ...]  # |ẋ_i|
    stir: fmpq  # |∂V̇/∂θ u0|, by V's own rate and by the reference's
    terms: Terms

    def gain(self, name: str) -> fmpq:
        """|∂V̇/∂(parameter of the reference)|."""
        return self.terms.gain(name) / self.least_weight


class References(NamedTuple):
    """Those beside which a car moves while inputs are held; by the graph's names."""

    box: Mapping[str, Range]  # of what the dynamics see
    slopes: Mapping[str, fmpq]  # bounds of |dr/dθ|
    frozen: Mapping[str, Range] = {}  # what V̇ is looked at, where that is another
    mirrored: str = ""  # one end of this one speaks for both


def motions(
    question: Question, legs: Sequence[Leg], span: Range, effort: Budget | None = None
) -> list[tuple[HeldMotion, Terms]]:
    """What has to be bounded on a stretch of θ: for each range of levels, without hints yet."""
    parts = [part for leg in different(legs) for part in between(leg.pieces, *span, effort)]
    return _motions(question, reference_box(parts), span)


def motions_within(question: Question, bounds: Bounds, band: Range) -> list[tuple[HeldMotion, Terms]]:
    """The same along paths within bounds, for what is measured at a speed of the band (m/s)."""
    steepest = max(map(abs, bounds.acceleration))
    change = steepest * question.model.inputs["u0"][1] * HORIZON
    speed = max(bounds.speed[0], band[0] - change), min(bounds.speed[1], band[1] + change)
    turns = [kappa * v for kappa in bounds.curvature for v in speed]
    box = {TURN_RATE: (min(turns), max(turns)), SPEED: speed, SPEED_SLOPE: bounds.acceleration}
    box[TURN_RATE_SLOPE] = (fmpq(0), fmpq(0))  # no vehicle with such a funnel depends on it
    slopes = {TURN_RATE: max(map(abs, bounds.curvature)) * steepest, SPEED: steepest}  # of what is looked at
    jumping = (TURN_RATE, bounds.curvature), (SPEED_SLOPE, bounds.acceleration)
    frozen = {frozen_name(name): box[name] for name, (lower, upper) in jumping if lower < upper}
    # V'' at a vertex is that of the mirrored car at the mirrored one
    mirrored = TURN_RATE if question.is_mirrored(bounds) else ""
    return _motions(question, References(box, slopes, frozen, mirrored), (fmpq(0), fmpq(0)))


def _motions(question: Question, references: References, span: Range) -> list[tuple[HeldMotion, Terms]]:
    model, dynamics, funnel = question.model, question.dynamics, question.funnel
    box, slopes, frozen, mirrored = references
    states = model.vehicle.states
    parameters = {f"input:{name}": limits for name, limits in model.inputs.items()}
    for name, (lower, upper) in box.items():  # what the dynamics do not depend on may have any value
        parameters[name] = (lower, upper if dynamics.depends_on(name) else lower)
    slopes = {name: bound for name, bound in slopes.items() if dynamics.depends_on(name)}
    require_affine(dynamics, parameters)
    parameters |= {name: ends for name, ends in frozen.items() if dynamics.depends_on(name.replace(FROZEN, REFERENCE))}
    found = []
    for piece in funnel.level.inside(span):
        terms = Terms(dynamics, states, parameters, slopes, funnel.shape, piece)
        motion = HeldMotion(
            graph=model.vehicle.graph,
            states=states,
            parameters=parameters,
            spare=terms.spare,
            shape=funnel.shape,
            whitening=[],
            piece=piece,
            enclosures={},
            derivatives={},
            degrees=(DEGREES[0], *([DEGREES[1]] * (2 if piece.lower > 0 else 1))),
            mirrored=mirrored,
        )
        found.append((motion, terms))
    return found


def _prove_levels(
    question: Question, motions: Sequence[tuple[HeldMotion, Terms]], hints: Sequence[PieceHints], effort: Budget
) -> list[_Sizes]:
    if len(motions) != len(hints):
        raise Broken(f"robustness: expected hints for {len(motions)} ranges of levels, got {len(hints)}")
    vehicle, found = question.model.vehicle, []
    for (motion, terms), own in zip(motions, hints, strict=True):
        enclosures = prove_enclosures(own.enclosures, vehicle.graph.functions(), effort)
        slopes = derivatives_of(vehicle.graph, vehicle.states)
        derivatives = prove_enclosures(own.derivatives, slopes, effort)
        hinted = replace(motion, whitening=own.whitening, enclosures=enclosures, derivatives=derivatives)
        found.append(_prove_sizes(hinted, terms, own.cells, effort))
    return found


def _prove_sizes(
    motion: HeldMotion, terms: Terms, cells: Mapping[tuple[int, int], tuple[fmpq, tuple[Gram, ...]]], effort: Budget
) -> _Sizes:
    if len(motion.vertices) > MOST_VERTICES:
        raise Broken(f"robustness: the parameters have more than {MOST_VERTICES} vertices")
    if cells.keys() != {(cell.order, cell.vertex) for cell in motion.cells()}:
        raise Broken(f"robustness: the bounds have to cover {len(motion.vertices)} vertices, V' and V'' at each")
    margins: dict[int, fmpq] = dict.fromkeys(ORDERS, fmpq(0))
    slopes = [fmpq(0)] * len(motion.states)
    speeds = [fmpq(0)] * len(motion.states)
    swiftness = fmpq(0)
    for vertex in range(len(motion.vertices)):
        motion.domain.budget.left = LARGEST_EFFORT  # each vertex has it to itself; all of a file's share another one
        orders = motion.orders(vertex)
        for order in orders:
            margin, grams = cells[order, vertex]
            shown = motion.proven_margin(CellProof(HeldCell(order, vertex), margin, grams))
            margins[order] = max(margins[order], -shown)
        if ORDERS[0] in orders:  # other vertices differ from such a one by what V' is looked at alone
            slopes = [max(pair) for pair in zip(slopes, motion.steepness(vertex), strict=True)]
            speeds = [max(pair) for pair in zip(speeds, motion.speeds(vertex), strict=True)]
            swiftness = max(swiftness, motion.swiftness(vertex))
        effort.spend(LARGEST_EFFORT - motion.domain.budget.left)
    piece = motion.piece
    own = abs(piece.timing.slope) * motion.parameters[TIMING][1] * swiftness
    return _Sizes(
        level=piece.upper,
        least_weight=piece.least_weight,
        rise=margins[1],
        bend=margins[2],
        slopes=tuple(slopes),
        speeds=tuple(speeds),
        stir=own + terms.wander / piece.least_weight,
        terms=terms,
    )


def reference_box(parts: Sequence[Piece]) -> References:
    """What the dynamics see of the pieces, and how fast it changes: by Bernstein."""
    box: dict[str, Range] = {}
    slopes: dict[str, fmpq] = {}
    for part in parts:
        for name, values in _profile(part).items():
            control, change = bernstein(values, part.duration), bernstein(derivative(values), part.duration)
            lower, upper = box.get(name, (control[0], control[0]))
            box[name] = min(lower, *control), max(upper, *control)
            slopes[name] = max(slopes.get(name, fmpq(0)), *map(abs, change))
    return References(box, slopes)


def _profile(part: Piece) -> dict[str, Coefficients]:
    """What the dynamics see, by the graph's names, as polynomials."""
    turn, speed = part.turn_rate, part.speed
    return {TURN_RATE: turn, SPEED: speed, TURN_RATE_SLOPE: derivative(turn), SPEED_SLOPE: derivative(speed)}


def _jump(before: Piece, after: Piece, found: Sequence[_Sizes]) -> fmpq:
    """By how much V̇ jumps where one piece follows another one.

    Where the turning rate jumps, what V̇ gains with it and with acceleration depends on states and inputs alone
    (`cfcheck.vehicle.structure`): it is bounded whatever else of the reference is to either side of the joint. Else
    acceleration and the turning rate's slope jump: one after the other, each at what the other one is on one of the two
    sides.
    """
    ends = {name: evaluate(values, before.duration) for name, values in _profile(before).items()}
    starts = {name: values[0] for name, values in _profile(after).items()}
    apart = {name: abs(starts[name] - ends[name]) for name in found[0].terms.slopes}
    return sum((gap * max(sizes.gain(name) for sizes in found) for name, gap in apart.items() if gap), fmpq(0))
