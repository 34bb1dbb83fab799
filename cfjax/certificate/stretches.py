"""Stretches of θ: bounds of the reference that hold along one, and what has to be shown there for condition (d).

The question is put at the levels that the funnel has on the stretch. `cfjax.certificate.prover` answers it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import comb

import numpy as np
from flint import fmpq

from cfcheck.claims.hints import MOST_MONOMIALS
from cfcheck.claims.problem import ProblemClaim
from cfcheck.claims.proof import Question
from cfcheck.exact.enclosure import LARGEST_EFFORT, Enclosure, TooLarge, UnaryEnclosure
from cfcheck.exact.rational import Range
from cfcheck.kernel.decrease import SteadyDecrease, by_boundary
from cfcheck.kernel.law import DEGREES as LAW_DEGREES
from cfcheck.path.bounds import Bounds, Extreme
from cfcheck.path.piece import Piece, between
from cfcheck.vehicle.symbolic import symbolic
from cfjax.certificate.fit import CLOSE, DEGREES, SPARING, enclose
from cfjax.certificate.mirror import mirrored
from cfjax.certificate.rounding import GRAM_BITS, RoundedFunnel, round_whitening


MOST_ROWS = 70  # of the Gram matrices of a law that is no polynomial: four states with V' of degree eight
FEW_STATES = 2  # with so many a function's polynomial may have a high degree, and hold on a wide range
SAMPLES = 256  # of a stretch, in which bounds are looked for
BOUND_BITS = 20  # of these bounds
SLACKS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)  # relative, by which they are wider than the samples


@dataclass(frozen=True)
class ThetaInterval:
    """θ from begin to end (s), and bounds of the reference that hold there; both ends are 0 for an invariant funnel."""

    begin: fmpq
    end: fmpq
    bounds: Bounds

    @property
    def name(self) -> str:
        """Which stretch is spoken of; nothing where it is all there is."""
        return f"theta from {float(self.begin):.4g} to {float(self.end):.4g} s, " if self.end else ""


def bounded(pieces: Sequence[Piece], begin: fmpq, end: fmpq, is_smooth: bool = False) -> ThetaInterval:
    """The stretch of a segment's pieces with bounds that are proven to hold; of the curvature's rate if it is smooth.

    Raises:
        ValueError: where none are found: the speed is not positive, say.
    """
    parts = between(pieces, begin, end)
    first = parts[0]
    if all(part.is_constant and part.speed == first.speed and part.turn_rate == first.turn_rate for part in parts):
        kappa, v, zero = first.turn_rate[0] / first.speed[0], first.speed[0], fmpq(0)
        return ThetaInterval(begin, end, Bounds((kappa, kappa), (v, v), (zero, zero)))
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
            return ThetaInterval(begin, end, bounds)
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


def question_of(claim: ProblemClaim, rounded: RoundedFunnel) -> Question:
    """Condition (d) of a funnel for the problem's vehicle."""
    car = claim.car
    dynamics = symbolic(car.vehicle.graph, car.vehicle.states, tuple(car.inputs))
    return mirrored(Question(car, dynamics, rounded.claim()))


def decreases_on(
    question: Question, rounded: RoundedFunnel, stretch: ThetaInterval, degrees: tuple[int, ...] = ()
) -> list[SteadyDecrease]:
    """What has to be shown for (d), one for each extreme reference, with proven enclosures on the funnel's range.

    `degrees` of the Gram matrices are the least that do unless given.

    Raises:
        TooLarge: Gram matrices, or polynomials, would be larger than a checker reads.
        ValueError: where the question cannot be put: the shell reaches the reference, a pole lies in the funnel.
        Broken: the vehicle's dynamics are not of the form in which a few references speak for all.
    """
    vehicle = question.model.vehicle
    pieces = rounded.level.shell((stretch.begin, stretch.end), rounded.beta_lower, rounded.beta_inner)
    extremes = question.extremes(stretch.bounds)
    peak = max(piece.upper for piece in pieces)
    decrease = SteadyDecrease(
        graph=vehicle.graph,
        states=vehicle.states,
        extreme=extremes[0],
        inputs=question.model.inputs,
        shape=rounded.shape,
        whitening=round_whitening(rounded.funnel.shape / float(peak)),
        pieces=tuple(pieces),
        enclosures={},
        degrees=(),
        law=question.model.law,
    )
    standard = _least(decrease, extremes) if decrease.law is None else _of_law(decrease, extremes)
    needed = standard[0].degrees
    if degrees and needed[0] > degrees[0]:
        raise TooLarge(f"V' of degree {2 * needed[0]}, where the stretches before have one of {2 * degrees[0]}")
    degrees = degrees or needed
    posed = [replace(each, degrees=degrees) for each in standard]
    _require_readable(posed[0])
    return posed


def _least(question: SteadyDecrease, extremes: Sequence[Extreme]) -> list[SteadyDecrease]:
    """The question with Gram matrices as small as can be; with two states, with close polynomials."""
    if len(question.states) <= FEW_STATES:
        return _posed(question, extremes, CLOSE)
    standard = _posed(question, extremes, DEGREES)
    # V' is multiplied by what it is divided by: cosines give that degree back
    if "inv" in question.graph.functions_of(question.states).values():
        sparing = _posed(question, extremes, SPARING)
        standard = min(standard, sparing, key=lambda questions: questions[0].degrees[0])
    return standard


def _of_law(question: SteadyDecrease, extremes: Sequence[Extreme]) -> list[SteadyDecrease]:
    """The question with the closest polynomials for which Gram matrices are not too large, if there are such.

    Where a law saturates, what its polynomials leave over costs more than larger matrices do.
    """
    choices = product((DEGREES, SPARING), sorted(LAW_DEGREES, reverse=True))
    posed = [_posed(replace(question, law_degree=most), extremes, functions) for functions, most in choices]
    states = len(question.states)
    fitting = [each for each in posed if comb(states + each[0].degrees[0], states) <= MOST_ROWS]
    return fitting[0] if fitting else min(posed, key=lambda questions: questions[0].degrees[0])


def _posed(question: SteadyDecrease, extremes: Sequence[Extreme], functions: Mapping[str, int]) -> list[SteadyDecrease]:
    """The question at each of the references, functions being polynomials of these degrees."""
    enclosures: dict[int, UnaryEnclosure] = {}

    def fit_here(node: int, function: str, argument: Enclosure) -> UnaryEnclosure:
        enclosures[node] = enclose(function, argument, functions)
        return enclosures[node]

    # functions are of the state alone wherever there is more than one reference: one enclosure fits all
    fitted = replace(question)
    fitted.law_values(fit_here)
    fitted.rates({name: fitted.number(lower) for name, (lower, _) in question.inputs.items()}, fit_here)
    questions = [replace(question, extreme=extreme, enclosures=enclosures) for extreme in extremes]
    degrees = max(_gram_degrees(each) for each in questions)
    return [replace(each, degrees=degrees) for each in questions]


def _require_readable(question: SteadyDecrease) -> None:
    """That a checker takes Gram matrices so large, of all cells of a reference: before a monomial is written down.

    Raises:
        TooLarge: says what would be too large.
    """
    states, degrees = len(question.states), question.degrees
    rows = [comb(states + degree, degree) for degree in degrees]
    size = f"V' of degree {2 * degrees[0]} in {states} states takes"
    if max(rows) > MOST_MONOMIALS:
        raise TooLarge(f"{size} Gram matrices of {max(rows)} rows, and a checker reads at most {MOST_MONOMIALS}")
    # of their definiteness alone (`proven_margin`)
    cells = [by_boundary(rows, cell.signs) for cell in question.cells()]
    effort = sum(count**3 * (1 + count * GRAM_BITS // 2048) for own in cells for count in own)
    if effort > LARGEST_EFFORT:
        raise TooLarge(
            f"{size} {len(cells)} times {len(rows)} Gram matrices of up to {max(rows)} rows: {effort / 1e6:.0f} "
            f"million products at least, and a checker does at most {LARGEST_EFFORT / 1e6:.0f} million"
        )


def _gram_degrees(question: SteadyDecrease) -> tuple[int, ...]:
    """Degrees of the monomials: the least for which both sides of the identity can have the same degree.

    An authority of a high degree is cut, for its Gram matrix to have more than a constant.
    """
    sides = (side for cell in question.cells() for side in (question.target(cell), question.weight(cell)))
    order = -(-max(int(side.total_degree()) for side in sides) // 2)
    slopes = [_side_degree(question, name) for name in question.signed_inputs]
    least = min(1, order - 1)
    return (order, *(max(least, (2 * order - degree) // 2) for degree in slopes), order - 1, order - 1)


def _side_degree(question: SteadyDecrease, name: str) -> int:
    """Of the polynomials whose signs tell an input's cells apart, before they are cut."""
    if name in question.limited:
        own = question.limited[name]
        return max(int(own.whole(end).total_degree()) for end in (own.lower, own.upper))
    return max(int(question.authority(piece, name).total_degree()) for piece in question.pieces)


def entries_of(questions: Sequence[SteadyDecrease]) -> int:
    """Entries of the Gram matrices that a stretch takes in a certificate."""
    rows = [comb(len(questions[0].states) + degree, degree) for degree in questions[0].degrees]
    cells = (by_boundary(rows, cell.signs) for question in questions for cell in question.cells())
    return sum(count * (count + 1) // 2 for own in cells for count in own)
