"""The replay: every claim of a certificate proven again from the file alone, in exact arithmetic.

A file that says "funnel" is answered with PROVEN only if, for the vehicle, path, sets and inputs that stand in it,
conditions (a), (b), (c) hold as matrix inequalities and (d) holds with the margin λ on every sign cell of every piece
of the shell. A file that says "refutation" is answered with REFUTED only if its witness violates a condition.
"""

from dataclasses import replace
from pathlib import Path

from cfjax.check.amounts import BoundsOver, Stated, verified
from cfjax.check.chain import CHAIN, prove_between_sets, read_chain, vehicle_of
from cfjax.check.chain_robustness import bounds_along
from cfjax.check.document import Certificate, Course, ProblemClaim, Witness, read_certificate
from cfjax.check.held_hints import read_chain_robustness, read_robustness
from cfjax.check.meaning import Assumptions, assumptions_of
from cfjax.check.proof import prove_funnels
from cfjax.check.proven import ProvenChain, ProvenFunnels, ProvenTube, Refuted
from cfjax.check.reader import Broken, Unreadable, read_json
from cfjax.check.refutation import confirm_witness, references_of
from cfjax.check.report import Outcome, Report
from cfjax.check.robustness import bounds_over
from cfjax.check.sampled import prove_holds
from cfjax.check.symbolic import Symbolic, symbolic
from cfjax.check.vehicle import check_known_vehicle


CERTIFICATE_NAME, ROBUSTNESS_NAME = "certificate.json", "robustness.json"


def check_file(path: str | Path, skip_hash: bool = False) -> Report:
    """Replay the certificate at the path, or in the run's folder there; no exception for anything in the file.

    Of a folder, what the funnels absorb too, where a file that says so lies beside the certificate.
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
    """A report with what the funnels of the proven certificate absorb, as the parsed file states it."""
    if report.outcome is not Outcome.PROVEN:
        return report
    try:
        if not isinstance(document, dict):
            raise Broken("certificate: expected an object")
        return replace(report, robustness=verified(*stated_and_proven(document, hints)))
    except Unreadable as error:
        return Report(Outcome.UNREADABLE, f"{ROBUSTNESS_NAME}: {_one_line(error)}")
    except (ValueError, ArithmeticError) as error:
        return Report(Outcome.BROKEN, f"{ROBUSTNESS_NAME}: {_one_line(error)}")
    except (MemoryError, RecursionError) as error:
        return Report(Outcome.UNREADABLE, f"{ROBUSTNESS_NAME}: too large for this checker ({type(error).__name__})")


def stated_and_proven(document: dict, hints: object) -> tuple[Stated, BoundsOver]:
    """What a robustness file states about a proven certificate, and the bounds that its hints prove.

    Raises:
        Unreadable, Broken, ValueError: says what is not as it has to be.
    """
    return _along_chain(document, hints) if document.get("claim") == CHAIN else _of_funnels(document, hints)


def _of_funnels(document: dict, hints: object) -> tuple[Stated, BoundsOver]:
    certificate = read_certificate(document, skip_hash=True)
    problem = certificate.problem
    file = read_robustness(hints, str(document["hash"]), len(certificate.funnels), len(problem.vehicle.states))
    dynamics = symbolic(problem.vehicle.graph, problem.vehicle.states, tuple(problem.inputs))
    if file.sampled:
        prove_holds(certificate, dynamics, *file.sampled)
    bounds = bounds_over(certificate, dynamics, file.hints, file.entries)
    return file.stated, replace(bounds, sampled=file.sampled[0]) if file.sampled else bounds


def _along_chain(document: dict, hints: object) -> tuple[Stated, BoundsOver]:
    claim = read_chain(document, skip_hash=True)
    states = vehicle_of(claim)[0].states
    file = read_chain_robustness(hints, str(document["hash"]), len(claim.tubes), len(states))
    return file.stated, bounds_along(claim, file.hints)[0]


def check_document(document: object, skip_hash: bool = False) -> Report:
    """Replay a certificate that is parsed already (lists, dicts, strings, ints)."""
    try:
        if isinstance(document, dict) and document.get("claim") == CHAIN:
            return Report(Outcome.PROVEN, shown=_chain(document, skip_hash))
        certificate = read_certificate(document, skip_hash)
        if certificate.witness:
            return Report(Outcome.REFUTED, shown=_refuted(certificate, certificate.witness))
        return Report(Outcome.PROVEN, shown=_proven(certificate))
    except Unreadable as error:
        return Report(Outcome.UNREADABLE, _one_line(error))
    except (ValueError, ArithmeticError) as error:  # Broken, or a step of the proof that cannot be done
        return Report(Outcome.BROKEN, _one_line(error))
    except (MemoryError, RecursionError) as error:
        return Report(Outcome.UNREADABLE, f"too large for this checker ({type(error).__name__})")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _chain(document: dict, skip_hash: bool) -> ProvenChain:
    claim = read_chain(document, skip_hash)
    runs, links, finish = prove_between_sets(claim)
    for index, (certificate, *_) in enumerate(claim.tubes):  # what takes longest comes last
        report = check_document(certificate)
        if report.outcome is not Outcome.PROVEN:
            raise Broken(f"tube {index}: {report.message}")
    vehicle, dynamics = vehicle_of(claim)
    return ProvenChain(claim, vehicle, assumptions_of(vehicle, dynamics), runs, len(links), finish)


def _proven(certificate: Certificate) -> ProvenFunnels | ProvenTube:
    problem, funnels = certificate.problem, certificate.funnels
    assumptions, dynamics = _check_problem(problem)
    prove_funnels(certificate, dynamics)
    course = problem.course
    if isinstance(course, Course):
        return ProvenFunnels(problem, course, funnels, assumptions)
    per_metre = funnels[0].margin_per_metre
    assert per_metre is not None  # `prove_funnels` asked for it
    return ProvenTube(problem, course, funnels[0], per_metre, assumptions)


def _refuted(certificate: Certificate, witness: Witness) -> Refuted:
    problem, funnels = certificate.problem, certificate.funnels
    assumptions, _ = _check_problem(problem)
    if any(funnel.margin < 0 for funnel in funnels):
        raise Broken("margin: a candidate claims a margin that is not negative")
    violation = confirm_witness(problem, funnels[witness.funnel], witness)
    extremes = references_of(problem.distinct[witness.funnel], witness.theta)
    return Refuted(problem, funnels, witness, violation, tuple(extremes), assumptions)


def _check_problem(problem: ProblemClaim) -> tuple[Assumptions | None, Symbolic]:
    """What is assumed of the vehicle and its dynamics in symbols, after what the problem itself has to satisfy."""
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
    rests = problem.is_steady and not is_lap and not problem.surroundings.obstacles
    return assumptions_of(problem.vehicle, dynamics, rests), dynamics
