"""The replay: every claim of a certificate proven again from the file alone, in exact arithmetic.

A file that says "funnel" is answered with PROVEN only if, for the vehicle, path, sets and inputs that stand in it,
conditions (a), (b), (c) hold as matrix inequalities and (d) holds with the margin λ on every sign cell of every piece
of the shell. A file that says "refutation" is answered with REFUTED only if its witness violates a condition.

What is printed follows from what is proven: a number without a short decimal form is rounded so that the sentence says
less, or is said to be "about" its decimal where it only names what the file speaks of.
"""

from collections.abc import Mapping
from decimal import ROUND_CEILING, ROUND_FLOOR
from pathlib import Path

from flint import fmpq

from cfjax.check.chain import CHAIN, check_chain
from cfjax.check.containment import broken_containments, half_widths
from cfjax.check.decrease import CellProof, Extreme, SteadyDecrease, contraction_way, steady_pieces
from cfjax.check.document import (
    TEMPLATES,
    CellKey,
    Certificate,
    FunnelClaim,
    ProblemClaim,
    SegmentClaim,
    SteadyHints,
    read_certificate,
)
from cfjax.check.enclosure import UnaryEnclosure
from cfjax.check.rational import about, decimal_text
from cfjax.check.reader import Broken, Unreadable, read_json
from cfjax.check.refutation import confirm_witness
from cfjax.check.report import Outcome, Report
from cfjax.check.symbolic import Symbolic, symbolic
from cfjax.check.tube import TubeClaim, is_mirrored, place_of, require_tube_structure
from cfjax.check.vehicle import check_known_vehicle


CERTIFICATE_NAME = "certificate.json"


def check_file(path: str | Path, skip_hash: bool = False) -> Report:
    """Replay the certificate at the path, or in the run's folder there; no exception for anything in the file."""
    where = Path(path)
    try:
        if where.is_dir():
            where = where / CERTIFICATE_NAME
        document = read_json(where)
    except (Unreadable, OSError, ValueError) as error:  # ValueError: a path with a null character
        return Report(Outcome.UNREADABLE, _one_line(error))
    return check_document(document, skip_hash)


def check_document(document: object, skip_hash: bool = False) -> Report:
    """Replay a certificate that is parsed already (lists, dicts, strings, ints)."""
    try:
        if isinstance(document, dict) and document.get("claim") == CHAIN:
            return check_chain(document, skip_hash, check_document)
        certificate = read_certificate(document, skip_hash)
        return _refuted(certificate) if certificate.witness else _proven(certificate)
    except Unreadable as error:
        return Report(Outcome.UNREADABLE, _one_line(error))
    except (ValueError, ArithmeticError) as error:  # Broken, or a step of the proof that cannot be done
        return Report(Outcome.BROKEN, _one_line(error))
    except (MemoryError, RecursionError) as error:
        return Report(Outcome.UNREADABLE, f"too large for this checker ({type(error).__name__})")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _proven(certificate: Certificate) -> Report:
    problem = certificate.problem
    vehicle, dynamics = _check_problem(problem)
    for segment, funnel, hints in zip(problem.segments, certificate.funnels, certificate.hints, strict=True):
        broken = broken_containments(
            problem.vehicle.states,
            funnel.shape,
            funnel.template,
            funnel.rate,
            segment.duration,
            problem.inlet,
            problem.goal,
            problem.safe,
        )
        if broken:
            raise Broken("; ".join(broken))
        _check_decrease(problem, dynamics, segment, funnel, hints)
    margins = tuple(funnel.margin for funnel in certificate.funnels)
    first = problem.segments[0]
    if isinstance(first, TubeClaim):
        funnel = certificate.funnels[0]
        assert funnel.margin_per_metre is not None  # `_extremes` asked for it
        way = problem.inputs["u0"][1] * contraction_way(funnel.beta_lower, funnel.beta_inner) / funnel.margin_per_metre
        message = _tube_message(problem, funnel, first, vehicle, way)
        return Report(Outcome.PROVEN, message, margins, margin_per_metre=funnel.margin_per_metre, contraction=way)
    duration = sum((segment.duration for segment in problem.segments), fmpq(0))
    slowest, fastest = problem.inputs["u0"]
    arrival = duration / fastest, duration / slowest
    message = (
        f"PROVEN: a control funnel function for {vehicle} along {_path(problem)}. "
        f"{_sets(problem, ROUND_FLOOR, ROUND_CEILING)} From every start in I at theta = 0, inputs "
        f"{_inputs(problem, ROUND_FLOOR, ROUND_CEILING)} suffice to keep the car in the funnel V <= 1 "
        f"({_funnels(certificate, ROUND_CEILING)}), inside {_safe(problem, ROUND_CEILING)}, until it arrives in G "
        f"after {decimal_text(arrival[0], ROUND_FLOOR)} to {decimal_text(arrival[1], ROUND_CEILING)} s; "
        f"V decreases there with margin lambda = {decimal_text(min(margins), ROUND_FLOOR)} 1/s or more."
    )
    return Report(Outcome.PROVEN, message, margins, arrival)


def _tube_message(problem: ProblemClaim, funnel: FunnelClaim, tube: TubeClaim, vehicle: str, way: fmpq) -> str:
    """`way` is the length of path after which V ≤ 1 has become V ≤ β_in."""
    widths = ", ".join(decimal_text(width, ROUND_CEILING) for width in half_widths(funnel.shape))
    per_metre = fmpq(0) if funnel.margin_per_metre is None else funnel.margin_per_metre
    comes_down = (
        f" Inputs that do so bring a car from V = 1 inside V <= {decimal_text(funnel.beta_inner, ROUND_CEILING)} "
        f"within {decimal_text(way, ROUND_CEILING)} m of the path."
    )
    return (
        f"PROVEN: one control funnel function for {vehicle} along every path whose pose and heading are continuous, "
        f"whose speed is continuous in {_interval(tube.speed)} m/s, whose curvature, which may jump, lies in "
        f"{_interval(tube.curvature)} 1/m and whose acceleration dv/dtheta lies in "
        f"{_interval(tube.acceleration)} m/s^2. "
        f"{_sets(problem, ROUND_FLOOR, ROUND_CEILING)} From every start in I, anywhere along the path, inputs "
        f"{_inputs(problem, ROUND_FLOOR, ROUND_CEILING)} suffice to keep the car in the tube V <= 1 "
        f"(shell from {decimal_text(funnel.beta_lower, ROUND_CEILING)}, half-widths ({widths})), inside G and inside "
        f"{_safe(problem, ROUND_CEILING)}, for ever; "
        f"V decreases there with margin lambda = {decimal_text(funnel.margin, ROUND_FLOOR)} 1/s and "
        f"{decimal_text(per_metre, ROUND_FLOOR)} per metre of the reference at u0 = 1, or more." + comes_down
    )


def _interval(bounds: tuple[fmpq, fmpq], lower: str = ROUND_CEILING, upper: str = ROUND_FLOOR) -> str:
    """Of a tube: printed no wider than it is; of a refuted one, told so, no narrower."""
    return f"[{decimal_text(bounds[0], lower)}, {decimal_text(bounds[1], upper)}]"


def _refuted(certificate: Certificate) -> Report:
    problem, witness = certificate.problem, certificate.witness
    assert witness is not None
    vehicle, _ = _check_problem(problem)
    if certificate.funnels[0].margin < 0:
        raise Broken("margin: a candidate claims a margin that is not negative")
    shown = confirm_witness(problem, problem.segments[0], certificate.funnels[0], witness)
    place = place_of(problem.segments[0].extremes(), witness.reference) if witness.condition == "d" else ""
    at = ", ".join(f"{name} = {about(value)}" for name, value in zip(problem.vehicle.states, witness.x, strict=True))
    message = (
        f"REFUTED: {_funnels(certificate, ROUND_FLOOR)} with margin lambda = "
        f"{decimal_text(certificate.funnels[0].margin, ROUND_CEILING)} 1/s is no control funnel function for {vehicle} "
        f"along {_path(problem)}. {_sets(problem, ROUND_CEILING, ROUND_FLOOR)} Safe is {_safe(problem, ROUND_FLOOR)}. "
        f"Inputs {_inputs(problem, ROUND_CEILING, ROUND_FLOOR)}. "
        f"At {place}theta = {about(witness.theta)} s, {at}: {shown}."
    )
    return Report(Outcome.REFUTED, message)


def _check_problem(problem: ProblemClaim) -> tuple[str, Symbolic]:
    """The vehicle in words and its dynamics in symbols, after what the problem itself has to satisfy."""
    for name, (lower, upper) in problem.inputs.items():
        if lower > upper:
            raise Broken(f"inputs: the lower limit of {name} is above the upper one")
    slowest, fastest = problem.inputs["u0"]
    if not 0 < slowest <= 1 <= fastest:
        raise Broken("inputs: the timing input needs 0 < lower <= 1 <= upper")
    if problem.method == "tt" and slowest != fastest:
        raise Broken("method: trajectory tracking (tt) has u0 = 1")
    name, parameters = problem.vehicle.name, problem.vehicle.parameters
    values = ", ".join(f"{label} {about(value)}" for label, value in parameters.items())
    described = f'the vehicle "{name}" ({values})' if values else f'the vehicle "{name}"'
    dynamics = symbolic(problem.vehicle.graph, problem.vehicle.states, tuple(problem.inputs))
    if check_known_vehicle(name, parameters, problem.vehicle.states, problem.inputs, dynamics):
        return described, dynamics
    unknown = f"{described}, a name unknown to this checker: its dynamics are those of the graph in the file,"
    return unknown, dynamics


def _check_decrease(
    problem: ProblemClaim,
    dynamics: Symbolic,
    segment: SegmentClaim | TubeClaim,
    funnel: FunnelClaim,
    hints: SteadyHints,
) -> None:
    """Condition (d) with the claimed margins, reference by reference, cell by cell."""
    per_metre = funnel.margin_per_metre
    if not funnel.margin > 0 or (per_metre is not None and not per_metre > 0):
        raise Broken("condition (d): the claimed margin is not positive")
    extremes = _extremes(problem, dynamics, segment, funnel)
    try:
        pieces = steady_pieces(funnel.template, funnel.rate, segment.duration, funnel.beta_lower, funnel.beta_inner)
        enclosures = _enclosures(problem, hints)
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
                degrees=hints.degrees,
            )
            for extreme in extremes
        ]
        cells = {
            (index, cell.piece, cell.signs): (question, cell)
            for index, question in enumerate(questions)
            for cell in question.cells()
        }
    except ValueError as error:
        raise Broken(f"condition (d): {error}") from None
    if cells.keys() != hints.cells.keys():
        raise Broken(f"condition (d): the proof has to cover {len(cells)} cells, {_odd_cell(cells, hints, extremes)}")
    for key, (margin, grams) in hints.cells.items():
        place = f"condition (d), {_named(key, extremes)}"
        question, cell = cells[key]
        try:
            proven = question.proven_margin(CellProof(cell, margin, grams))
        except ValueError as error:
            raise Broken(f"{place}: {error}") from None
        # affine in the speed between its ends, as V' is (`cfjax.check.tube`)
        claims = [(funnel.margin, fmpq(1), "1/s")]
        if per_metre is not None:
            claims.append((per_metre, question.extreme.profile["speed"], "1/m"))
        for claimed, unit, name in claims:
            if proven < claimed * unit:
                least, shown = decimal_text(claimed, ROUND_CEILING), decimal_text(proven / unit, ROUND_FLOOR)
                raise Broken(f"{place}: margin {least} {name} claimed, {shown} {name} proven")


def _extremes(
    problem: ProblemClaim, dynamics: Symbolic, segment: SegmentClaim | TubeClaim, funnel: FunnelClaim
) -> list[Extreme]:
    """The references at which (d) has to be proven."""
    if isinstance(segment, SegmentClaim):
        if funnel.margin_per_metre is not None:
            raise Broken("condition (d): a margin per metre is claimed for a segment, expected null")
        return segment.extremes()
    if funnel.rate != 0 or funnel.margin_per_metre is None:
        raise Broken("condition (d): the V of a tube has rate 0 and a margin per metre")
    require_tube_structure(dynamics)
    return segment.extremes(is_mirrored(dynamics, problem.vehicle.states, problem.inputs, funnel.shape, segment))


def _enclosures(problem: ProblemClaim, hints: SteadyHints) -> dict[int, UnaryEnclosure]:
    """The enclosures of the file, proven; one for each node of the graph that applies a function, of that function."""
    named = {node: entry[0] for node, entry in hints.enclosures.items()}
    if named != problem.vehicle.graph.functions():
        raise ValueError("the enclosures are not those of the functions in the graph")
    return {node: UnaryEnclosure(*entry) for node, entry in hints.enclosures.items()}


def _odd_cell(cells: Mapping[CellKey, object], hints: SteadyHints, extremes: list[Extreme]) -> str:
    missing = sorted(cells.keys() - hints.cells.keys())
    return f"but {_named(missing[0], extremes)} is missing" if missing else "but names others"


def _named(key: CellKey, extremes: list[Extreme]) -> str:
    reference, piece, signs = key
    return f"{place_of(extremes, reference)}piece {piece}, signs {_signs(signs)}"


def _signs(signs: tuple[int, ...]) -> str:
    return "(" + "".join("+" if sign > 0 else "-" for sign in signs) + ")"


def _path(problem: ProblemClaim) -> str:
    """What a segment's funnel is about, or what a refuted tube's is: rounded so that a refutation says less."""
    segment = problem.segments[0]
    if isinstance(segment, TubeClaim):
        bounds = (segment.speed, segment.curvature, segment.acceleration)
        speed, curvature, acceleration = (_interval(ends, ROUND_FLOOR, ROUND_CEILING) for ends in bounds)
        return (
            f"every path with speed in {speed} m/s, curvature in {curvature} 1/m, acceleration in {acceleration} m/s^2"
        )
    return (
        f'the path "{problem.path}" (turning rate {about(segment.turn_rate)} rad/s, speed {about(segment.speed)} m/s, '
        f"theta from 0 to {about(segment.duration)} s)"
    )


def _numbers(values: tuple[fmpq, ...], rounding: str) -> str:
    return ", ".join(decimal_text(value, rounding) for value in values)


def _sets(problem: ProblemClaim, inlet: str, goal: str) -> str:
    """The half-axes, rounded as told."""
    return (
        f"Deviations ({', '.join(problem.vehicle.states)}): I has half-axes ({_numbers(problem.inlet, inlet)}), "
        f"G ({_numbers(problem.goal, goal)})."
    )


def _safe(problem: ProblemClaim, rounding: str) -> str:
    if problem.safe is None:
        return "the whole plane (no S)"
    return f"S with half-widths ({_numbers(problem.safe, rounding)})"


def _inputs(problem: ProblemClaim, lower: str, upper: str) -> str:
    return ", ".join(
        f"{name} in [{decimal_text(low, lower)}, {decimal_text(high, upper)}]"
        for name, (low, high) in problem.inputs.items()
    )


def _funnels(certificate: Certificate, inner_edge: str) -> str:
    funnel = certificate.funnels[0]
    if isinstance(certificate.problem.segments[0], TubeClaim):
        return f"shell from {decimal_text(funnel.beta_lower, inner_edge)}"
    return (
        f"template {funnel.template}, {TEMPLATES[funnel.template]} {about(funnel.rate)} 1/s, "
        f"shell from {decimal_text(funnel.beta_lower, inner_edge)}"
    )
