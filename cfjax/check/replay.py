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

from cfjax.check.containment import broken_containments
from cfjax.check.decrease import Cell, CellProof, SteadyDecrease, steady_pieces
from cfjax.check.document import (
    TEMPLATES,
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
    vehicle = _check_problem(problem)
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
        _check_decrease(problem, segment, funnel, hints)
    duration = sum((segment.duration for segment in problem.segments), fmpq(0))
    slowest, fastest = problem.inputs["u0"]
    margins = tuple(funnel.margin for funnel in certificate.funnels)
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


def _refuted(certificate: Certificate) -> Report:
    problem, witness = certificate.problem, certificate.witness
    assert witness is not None
    vehicle = _check_problem(problem)
    if certificate.funnels[0].margin < 0:
        raise Broken("margin: a candidate claims a margin that is not negative")
    shown = confirm_witness(problem, problem.segments[0], certificate.funnels[0], witness)
    at = ", ".join(f"{name} = {about(value)}" for name, value in zip(problem.vehicle.states, witness.x, strict=True))
    message = (
        f"REFUTED: {_funnels(certificate, ROUND_FLOOR)} with margin lambda = "
        f"{decimal_text(certificate.funnels[0].margin, ROUND_CEILING)} 1/s is no control funnel function for {vehicle} "
        f"along {_path(problem)}. {_sets(problem, ROUND_CEILING, ROUND_FLOOR)} Safe is {_safe(problem, ROUND_FLOOR)}. "
        f"Inputs {_inputs(problem, ROUND_CEILING, ROUND_FLOOR)}. "
        f"At theta = {about(witness.theta)} s, {at}: {shown}."
    )
    return Report(Outcome.REFUTED, message)


def _check_problem(problem: ProblemClaim) -> str:
    """The vehicle in words, after what the problem itself has to satisfy."""
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
    if check_known_vehicle(name, parameters, problem.vehicle.states, problem.inputs, problem.vehicle.graph):
        return described
    return f"{described}, a name unknown to this checker: its dynamics are those of the graph in the file,"


def _check_decrease(problem: ProblemClaim, segment: SegmentClaim, funnel: FunnelClaim, hints: SteadyHints) -> None:
    """Condition (d) with the claimed margin, cell by cell."""
    if not funnel.margin > 0:
        raise Broken("condition (d): the claimed margin is not positive")
    try:
        pieces = steady_pieces(funnel.template, funnel.rate, segment.duration, funnel.beta_lower)
        decrease = SteadyDecrease(
            graph=problem.vehicle.graph,
            states=problem.vehicle.states,
            profile=segment.profile,
            inputs=problem.inputs,
            shape=funnel.shape,
            whitening=hints.whitening,
            pieces=tuple(pieces),
            enclosures=_enclosures(problem, hints),
            degrees=hints.degrees,
        )
        cells = {(cell.piece, cell.signs): cell for cell in decrease.cells()}
    except ValueError as error:
        raise Broken(f"condition (d): {error}") from None
    if cells.keys() != hints.cells.keys():
        raise Broken(f"condition (d): the proof has to cover {len(cells)} cells, {_odd_cell(cells, hints)}")
    for key, (margin, grams) in hints.cells.items():
        place = f"condition (d), piece {key[0]}, signs {_signs(key[1])}"
        try:
            proven = decrease.proven_margin(CellProof(cells[key], margin, grams))
        except ValueError as error:
            raise Broken(f"{place}: {error}") from None
        if proven < funnel.margin:
            claimed, shown = decimal_text(funnel.margin, ROUND_CEILING), decimal_text(proven, ROUND_FLOOR)
            raise Broken(f"{place}: margin {claimed} claimed, {shown} proven")


def _enclosures(problem: ProblemClaim, hints: SteadyHints) -> dict[int, UnaryEnclosure]:
    """The enclosures of the file, proven; one for each node of the graph that applies a function, of that function."""
    named = {node: entry[0] for node, entry in hints.enclosures.items()}
    if named != problem.vehicle.graph.functions():
        raise ValueError("the enclosures are not those of the functions in the graph")
    return {node: UnaryEnclosure(*entry) for node, entry in hints.enclosures.items()}


def _odd_cell(cells: Mapping[tuple, Cell], hints: SteadyHints) -> str:
    missing = sorted(cells.keys() - hints.cells.keys())
    if missing:
        return f"but piece {missing[0][0]} with signs {_signs(missing[0][1])} is missing"
    return "but names others"


def _signs(signs: tuple[int, ...]) -> str:
    return "(" + "".join("+" if sign > 0 else "-" for sign in signs) + ")"


def _path(problem: ProblemClaim) -> str:
    segment = problem.segments[0]
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
    return (
        f"template {funnel.template}, {TEMPLATES[funnel.template]} {about(funnel.rate)} 1/s, "
        f"shell from {decimal_text(funnel.beta_lower, inner_edge)}"
    )
