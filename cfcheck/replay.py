"""The replay: every claim of a certificate proven again from the file alone, in exact arithmetic.

A file that says "funnel" is answered with PROVEN only if, for the vehicle, path, sets and inputs that stand in it,
conditions (a), (b), (c) and the joints hold as matrix inequalities and (d) holds with the margin λ on every sign cell
of every piece of the shell. A file that says "refutation" is answered with REFUTED only if its witness violates a
condition.

A file of another format holds an upper bound of the margin (`cfcheck.margin.upper_bound`), and is answered with BOUNDED
only if every leaf of its tree shows that no candidate is there.
"""

from dataclasses import replace
from pathlib import Path

from cfcheck.claims.assumptions import Assumptions, assumptions_of
from cfcheck.claims.document import Claims, Witness, read_certificate
from cfcheck.claims.problem import ProblemClaim
from cfcheck.claims.proof import dynamics_of, prove_funnels
from cfcheck.claims.proven import Bounded, Proven, Refuted
from cfcheck.claims.refutation import confirm_witness, references_of
from cfcheck.exact.symbolic import Symbolic
from cfcheck.margin.upper_bound_file import is_upper_bound, read_upper_bound
from cfcheck.reader import Broken, Unreadable, read_json
from cfcheck.report import Outcome, Report
from cfcheck.robustness.amounts import BoundsOver, Stated, verified
from cfcheck.robustness.descent import bounds_over
from cfcheck.robustness.hold_hints import read_robustness
from cfcheck.robustness.sampled import prove_holds


CERTIFICATE_NAME, ROBUSTNESS_NAME = "certificate.json", "robustness.json"
WITHOUT_PERIOD = "without-period"  # the folder, in that of a run, of what is proven where its period is not


def check_file(path: str | Path, skip_hash: bool = False) -> Report:
    """Replay the certificate at the path, or in the run's folder there; no exception for anything in the file.

    Of a folder, what the funnels absorb too, where a file that says so lies beside the certificate.
    """
    where, hints = Path(path), None
    try:
        if where.is_dir():
            beside = where / ROBUSTNESS_NAME
            hints = read_json(beside) if beside.exists() else None
            less, where = where / WITHOUT_PERIOD, where / CERTIFICATE_NAME
            if less.exists() and not where.exists():
                raise Unreadable(f"the period that this run asks for is not proven; what is proven without it: {less}")
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
        return replace(report, robustness=verified(*stated_and_proven(document, hints)))
    except Unreadable as error:
        return Report(Outcome.UNREADABLE, f"{ROBUSTNESS_NAME}: {_one_line(error)}")
    except (ValueError, ArithmeticError, LookupError) as error:
        return Report(Outcome.BROKEN, f"{ROBUSTNESS_NAME}: {_one_line(error)}")
    except (MemoryError, RecursionError) as error:
        return Report(Outcome.UNREADABLE, f"{ROBUSTNESS_NAME}: too large for this checker ({type(error).__name__})")


def stated_and_proven(document: object, hints: object) -> tuple[Stated, BoundsOver]:
    """What a robustness file states about a proven certificate, and the bounds that its hints prove.

    Raises:
        Unreadable, Broken, ValueError: says what is not as it has to be.
    """
    certificate = read_certificate(document, skip_hash=True)
    assert isinstance(document, dict)  # it was read
    file = read_robustness(hints, str(document["hash"]), certificate.claims)
    if file.sampled:
        prove_holds(certificate, *file.sampled)
    bounds = bounds_over(certificate, file.hints)
    return file.stated, replace(bounds, sampled=file.sampled[0]) if file.sampled else bounds


def check_document(document: object, skip_hash: bool = False) -> Report:
    """Replay a certificate that is parsed already (lists, dicts, strings, ints)."""
    try:
        if is_upper_bound(document):
            return Report(Outcome.BOUNDED, shown=_bounded(document, skip_hash))
        certificate = read_certificate(document, skip_hash)
        claims = certificate.claims
        assumptions, dynamics = _check_problem(claims.problem)
        if certificate.witness:
            shown = _refuted(claims, certificate.witness, assumptions)
            return Report(Outcome.REFUTED, shown=shown)
        return Report(Outcome.PROVEN, shown=Proven(claims, assumptions, prove_funnels(certificate, dynamics)))
    except Unreadable as error:
        return Report(Outcome.UNREADABLE, _one_line(error))
    except (ValueError, ArithmeticError, LookupError) as error:  # Broken, or a step of the proof that cannot be done
        return Report(Outcome.BROKEN, _one_line(error))
    except (MemoryError, RecursionError) as error:
        return Report(Outcome.UNREADABLE, f"too large for this checker ({type(error).__name__})")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _bounded(document: object, skip_hash: bool) -> Bounded:
    bound = read_upper_bound(document, skip_hash)
    assumptions, _ = _check_problem(bound.row.problem)
    bound.prove()
    return Bounded(bound.row.problem, assumptions, bound.row.beta_lower, bound.margin)


def _refuted(claims: Claims, witness: Witness, assumptions: Assumptions | None) -> Refuted:
    if any(funnel.margin < 0 for funnel in claims.funnels):
        raise Broken("margin: a candidate claims a margin that is not negative")
    violation = confirm_witness(claims, witness)
    extremes = references_of(claims, witness.leg, witness.theta)
    return Refuted(claims, witness, violation, tuple(extremes), assumptions)


def _check_problem(problem: ProblemClaim) -> tuple[Assumptions | None, Symbolic]:
    """What is assumed of the vehicle and its dynamics in symbols, after what the problem itself has to satisfy."""
    slowest, fastest = problem.inputs["u0"]
    if problem.method == "tt" and slowest != fastest:
        raise Broken("method: trajectory tracking (tt) has u0 = 1")
    dynamics = dynamics_of(problem.car)
    rests = problem.is_steady and not problem.is_lap and problem.surroundings.is_empty
    return assumptions_of(problem.vehicle, dynamics, rests), dynamics
