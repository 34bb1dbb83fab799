"""The replay: every claim of a certificate proven again from the file alone, in exact arithmetic.

A file that says "funnel" is answered with PROVEN only if, for the vehicle, path, sets and inputs that stand in it,
conditions (a), (b), (c) hold as matrix inequalities and (d) holds with the margin λ on every sign cell of every piece
of the shell. A file that says "refutation" is answered with REFUTED only if its witness violates a condition.

What is printed follows from what is proven: a number without a short decimal form is rounded so that the sentence says
less, or is said to be "about" its decimal where it only names what the file speaks of.
"""

from dataclasses import replace
from decimal import ROUND_CEILING, ROUND_FLOOR
from pathlib import Path

from flint import fmpq

from cfjax.check.bounds import Bounds, place_of
from cfjax.check.certified import LAW_SHARE
from cfjax.check.chain import CHAIN, check_chain, read_chain, vehicle_of
from cfjax.check.chain_robustness import prove_chain_robustness
from cfjax.check.containment import half_widths
from cfjax.check.decrease import contraction_way
from cfjax.check.document import Certificate, Course, FunnelClaim, ProblemClaim, read_certificate
from cfjax.check.held_hints import read_chain_hints, read_hints
from cfjax.check.meaning import described
from cfjax.check.proof import prove_funnels
from cfjax.check.rational import about, decimal_text
from cfjax.check.reader import Broken, Unreadable, read_json
from cfjax.check.refutation import confirm_witness, references_of
from cfjax.check.report import Outcome, Report
from cfjax.check.robustness import Robustness, prove_robustness
from cfjax.check.symbolic import Symbolic, symbolic
from cfjax.check.vehicle import check_known_vehicle


CERTIFICATE_NAME, ROBUSTNESS_NAME = "certificate.json", "robustness.json"
SHARE_TEXT = decimal_text(LAW_SHARE, ROUND_CEILING)
SHOWN = 4  # funnels whose rates are printed


def check_file(path: str | Path, skip_hash: bool = False) -> Report:
    """Replay the certificate at the path, or in the run's folder there; no exception for anything in the file.

    Of a folder, what the funnels absorb too, where hints for it lie beside the certificate.
    """
    where, hints = Path(path), None
    try:
        if where.is_dir():
            beside = where / ROBUSTNESS_NAME
            hints = read_json(beside) if beside.exists() else None
            where = where / CERTIFICATE_NAME
        document = read_json(where)
    except (Unreadable, OSError, ValueError) as error:  # ValueError: a path with a null character
        return Report(Outcome.UNREADABLE, _one_line(error))
    report = check_document(document, skip_hash)
    return report if hints is None else check_robustness(report, document, hints)


def check_robustness(report: Report, document: object, hints: object) -> Report:
    """A report with what the funnels of the proven certificate absorb, by the parsed hints."""
    if report.outcome is not Outcome.PROVEN:
        return report
    try:
        if not isinstance(document, dict):
            raise Broken("certificate: expected an object")
        shown = _along_chain if document.get("claim") == CHAIN else _of_funnels
        states, proven, law, meanwhile = shown(document, hints)
    except Unreadable as error:
        return Report(Outcome.UNREADABLE, f"{ROBUSTNESS_NAME}: {_one_line(error)}")
    except (ValueError, ArithmeticError) as error:
        return Report(Outcome.BROKEN, f"{ROBUSTNESS_NAME}: {_one_line(error)}")
    except (MemoryError, RecursionError) as error:
        return Report(Outcome.UNREADABLE, f"{ROBUSTNESS_NAME}: too large for this checker ({type(error).__name__})")
    message = f"{report.message} {_absorbed(states, proven, law, meanwhile)}"
    return replace(report, message=message, robustness=proven)


def _of_funnels(document: dict, hints: object) -> tuple[tuple[str, ...], Robustness, str, str]:
    """States, what the funnels absorb, under which law, and what is meanwhile."""
    certificate = read_certificate(document, skip_hash=True)
    problem = certificate.problem
    read = read_hints(hints, str(document["hash"]), len(certificate.funnels), len(problem.vehicle.states))
    dynamics = symbolic(problem.vehicle.graph, problem.vehicle.states, tuple(problem.inputs))
    proven = prove_robustness(certificate, dynamics, read)
    law, meanwhile = f"A law whose inputs reach V' <= -{SHARE_TEXT} lambda in the shell", ""
    if proven.bands:
        law += (
            f" and V' <= -{SHARE_TEXT} v_r times the margin per metre, for every curvature and acceleration of the "
            "tube at once,"
        )
        by_speed = ", ".join(
            f"{decimal_text(own.period, ROUND_FLOOR)} s up to {about(upper)} m/s"
            for (_, upper), own in zip(proven.bands, proven.by_speed, strict=True)
        )
        meanwhile = f" (chosen at a speed of the path: {by_speed}), whatever curvature and acceleration do meanwhile"
    return problem.vehicle.states, proven, law, meanwhile


def _along_chain(document: dict, hints: object) -> tuple[tuple[str, ...], Robustness, str, str]:
    """The same along a path that tubes hold."""
    claim = read_chain(document, skip_hash=True)
    states = vehicle_of(claim)[0].states
    read = read_chain_hints(hints, str(document["hash"]), len(claim.tubes), len(states))
    proven, held = prove_chain_robustness(claim, read)
    told = "; ".join(
        f"tube {index}: lambda = {decimal_text(own.told.margin, ROUND_FLOOR)} 1/s, "
        f"{decimal_text(own.told.margin_per_metre, ROUND_FLOOR)} per metre, shell from "
        f"{decimal_text(own.told.shell, ROUND_CEILING)}, inner {decimal_text(own.told.inner, ROUND_CEILING)}, "
        f"curvature in {_interval(own.bounds.curvature, ROUND_FLOOR, ROUND_CEILING)} 1/m, acceleration in "
        f"{_interval(own.bounds.acceleration, ROUND_FLOOR, ROUND_CEILING)} m/s^2"
        for index, own in enumerate(held)
    )
    law = (
        f"A law whose inputs reach V' <= -{SHARE_TEXT} times the larger of lambda and v_r times the margin per metre, "
        "below the shell times V over its level, down to the inner one, for every curvature and acceleration of the "
        f"bounds at once ({told}),"
    )
    end = " and end in G" if claim.sets else "" if claim.closed else ", V at the end being another than above"
    return states, proven, law, f", whatever the path does meanwhile, and stay in the tubes{end}"


def _absorbed(states: tuple[str, ...], proven: Robustness, law: str, meanwhile: str) -> str:
    """What the funnels absorb, in a sentence; every amount rounded down."""

    def each(amounts: tuple[fmpq, ...]) -> str:
        named = zip(states, amounts, strict=True)
        return ", ".join(f"{name} {decimal_text(amount, ROUND_FLOOR)}" for name, amount in named)

    alone, joint = proven.alone, proven.joint
    return (
        f"{law} may hold them for {decimal_text(alone.period, ROUND_FLOOR)} s{meanwhile}; or, chosen at every moment, "
        f"they absorb in one state a rate that is off by ({each(alone.disturbance)}) a second; or a measured one that "
        f"is off by ({each(alone.pose_error)}), from starts in V <= {decimal_text(proven.pose_level, ROUND_FLOOR)}; "
        f"or, once it has come, what was measured {decimal_text(alone.delay, ROUND_FLOOR)} s ago, theta with it. "
        f"All at once, in every state: held for {decimal_text(joint.period, ROUND_FLOOR)} s, "
        f"({each(joint.disturbance)}) a second, ({each(joint.pose_error)}), "
        f"{decimal_text(joint.delay, ROUND_FLOOR)} s ago, from starts in V <= "
        f"{decimal_text(proven.joint_level, ROUND_FLOOR)}."
    )


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
    problem, funnels = certificate.problem, certificate.funnels
    vehicle, dynamics = _check_problem(problem)
    prove_funnels(certificate, dynamics)
    course = problem.course
    if isinstance(course, Bounds):
        funnel = funnels[0]
        assert funnel.margin_per_metre is not None  # `prove_funnels` asked for it
        way = problem.inputs["u0"][1] * contraction_way(funnel.beta_lower, funnel.beta_inner) / funnel.margin_per_metre
        message = _tube_message(problem, funnel, course, vehicle, way)
        return Report(
            Outcome.PROVEN, message, (funnel.margin,), margin_per_metre=funnel.margin_per_metre, contraction=way
        )
    margins = tuple(funnels[kind].margin for kind in course.kinds)
    duration = course.reference.duration
    slowest, fastest = problem.inputs["u0"]
    arrival = duration / fastest, duration / slowest
    time = f"{decimal_text(arrival[0], ROUND_FLOOR)} to {decimal_text(arrival[1], ROUND_CEILING)} s"
    again = ", and from there lap after lap for ever" if course.closed else ""
    message = (
        f"PROVEN: a control funnel function for {vehicle} along {_path(problem, course)}. "
        f"{_sets(problem, ROUND_FLOOR, ROUND_CEILING)} From every start in I at theta = 0, inputs "
        f"{_inputs(problem, ROUND_FLOOR, ROUND_CEILING)} suffice to keep the car in the funnel V <= 1 "
        f"({_funnels(certificate, ROUND_CEILING)}), inside {_safe(problem, ROUND_CEILING)}, until it arrives in G "
        f"after {time}{again}; "
        f"V decreases there with margin lambda = {decimal_text(min(margins), ROUND_FLOOR)} 1/s or more."
    )
    return Report(Outcome.PROVEN, message, margins, arrival)


def _tube_message(problem: ProblemClaim, funnel: FunnelClaim, tube: Bounds, vehicle: str, way: fmpq) -> str:
    """`way` is the length of path after which V ≤ 1 has become V ≤ β_in."""
    widths = ", ".join(decimal_text(width, ROUND_CEILING) for width in half_widths(funnel.shape))
    per_metre = fmpq(0) if funnel.margin_per_metre is None else funnel.margin_per_metre
    kept = "" if problem.goal is None else "inside G and "
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
        f"(shell from {decimal_text(funnel.beta_lower, ROUND_CEILING)}, half-widths ({widths})), {kept}inside "
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
    if any(funnel.margin < 0 for funnel in certificate.funnels):
        raise Broken("margin: a candidate claims a margin that is not negative")
    funnel = certificate.funnels[witness.funnel]
    shown = confirm_witness(problem, funnel, witness)
    segment = problem.distinct[witness.funnel]
    place = place_of(references_of(segment, witness.theta), witness.reference) if witness.condition == "d" else ""
    at = ", ".join(f"{name} = {about(value)}" for name, value in zip(problem.vehicle.states, witness.x, strict=True))
    message = (
        f"REFUTED: {_funnels(certificate, ROUND_FLOOR)} with margin lambda = "
        f"{decimal_text(funnel.margin, ROUND_CEILING)} 1/s is no control funnel function for {vehicle} "
        f"along {_path(problem, problem.course)}. {_sets(problem, ROUND_CEILING, ROUND_FLOOR)} "
        f"Safe is {_safe(problem, ROUND_FLOOR)}. "
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
    dynamics = symbolic(problem.vehicle.graph, problem.vehicle.states, tuple(problem.inputs))
    check_known_vehicle(
        problem.vehicle.name, problem.vehicle.parameters, problem.vehicle.states, problem.inputs, dynamics
    )
    course = problem.course
    is_lap = isinstance(course, Course) and course.closed
    rests = problem.is_steady and not is_lap and not problem.obstacles
    return described(problem.vehicle, dynamics, rests), dynamics


def _path(problem: ProblemClaim, course: Course | Bounds) -> str:
    """What a segment's funnel is about, or what a refuted tube's is: rounded so that a refutation says less."""
    if isinstance(course, Bounds):
        bounds = (course.speed, course.curvature, course.acceleration)
        speed, curvature, acceleration = (_interval(ends, ROUND_FLOOR, ROUND_CEILING) for ends in bounds)
        return (
            f"every path with speed in {speed} m/s, curvature in {curvature} 1/m, acceleration in {acceleration} m/s^2"
        )
    named = f'the path "{problem.path}"'
    pieces = course.reference.pieces
    if len(pieces) == 1 and pieces[0].is_constant:
        turning, moving = (about(coefficients[0]) for coefficients in (pieces[0].turn_rate, pieces[0].speed))
        return (
            f"{named} (turning rate {turning} rad/s, speed {moving} m/s, theta from 0 to {about(pieces[0].duration)} s)"
        )
    count = len(course.segments)
    segments = f"{count} segments, " if count > 1 else ""
    return (
        f"{named}, whose {len(pieces)} pieces stand in the file ({segments}{about(course.reference.length)} m, theta "
        f"from 0 to {about(course.reference.duration)} s)"
    )


def _numbers(values: tuple[fmpq, ...], rounding: str) -> str:
    return ", ".join(decimal_text(value, rounding) for value in values)


def _sets(problem: ProblemClaim, inlet: str, goal: str) -> str:
    """The half-axes, rounded as told."""
    ends = "no G is asked" if problem.goal is None else f"G ({_numbers(problem.goal, goal)})"
    return (
        f"Deviations ({', '.join(problem.vehicle.states)}): I has half-axes ({_numbers(problem.inlet, inlet)}), {ends}."
    )


def _safe(problem: ProblemClaim, rounding: str) -> str:
    whole = "the whole plane (no S)"
    box = whole if problem.safe is None else f"S with half-widths ({_numbers(problem.safe, rounding)})"
    if not problem.obstacles:
        return box
    discs = " and ".join(
        f"radius {decimal_text(disc.radius, ROUND_FLOOR)} m at offset {about(disc.offset)} m"
        for disc in problem.footprint
    )
    clear = f"clear of {len(problem.obstacles)} obstacles that stand in the file, by a footprint of {discs}"
    return clear if problem.safe is None else f"{box}, {clear}"


def _inputs(problem: ProblemClaim, lower: str, upper: str) -> str:
    return ", ".join(
        f"{name} in [{decimal_text(low, lower)}, {decimal_text(high, upper)}]"
        for name, (low, high) in problem.inputs.items()
    )


def _funnels(certificate: Certificate, inner_edge: str) -> str:
    funnels = certificate.funnels
    shell = f"shell from {decimal_text(max(funnel.beta_lower for funnel in funnels), inner_edge)}"
    if isinstance(certificate.problem.course, Bounds):
        return shell
    level = funnels[0].level
    rates = ", ".join(about(funnel.level.rate) for funnel in funnels[:SHOWN])
    more = ", ..." if len(funnels) > SHOWN else ""
    return f"template {level.name}, {level.rate_name} {rates}{more} 1/s, {shell}"
