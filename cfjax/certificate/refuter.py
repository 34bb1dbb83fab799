"""The refuter: a candidate that violates a condition, with a witness that anyone can evaluate.

The falsifier says where a condition fails, in floating point. Here the point becomes rational, is moved off the
boundary on which such points like to lie, and is shown to the checker; only what the checker confirms is a refutation.
"""

import json
from collections.abc import Iterator, Sequence

from flint import fmpq

from cfcheck import Outcome, check_document
from cfcheck.exact.rational import rational
from cfcheck.kernel.funnel import FunnelClaim
from cfcheck.kernel.level import LEVELS
from cfjax.certificate.certifier import Certification, legs_of
from cfjax.certificate.rounding import exact
from cfjax.certificate.trace import trace_deviation
from cfjax.certificate.writing import dump, seal, write_funnel, write_problem, write_witness
from cfjax.coerce import instances, number, objects
from cfjax.errors import InputError
from cfjax.falsifier import WorstPoint, falsify
from cfjax.funnel import Funnel
from cfjax.funnel.funnel import require_fit
from cfjax.problem import Problem
from cfjax.verdict import Verdict


NUDGES = (0.0, 1e-13, -1e-13, 1e-10, -1e-10, 1e-7, -1e-7, 1e-5, -1e-5)  # relative: into the set or out of it
DEPTHS = (1e-12, 1e-9, 1e-6, 1e-3, 0.5)  # into the range of θ at which a deviation lies in the shell
X_DIGITS = 15  # significant digits of a witness


def refute(
    problem: Problem, funnel: Funnel, margin: float = 0.0, points: Sequence[WorstPoint] | None = None
) -> Certification:
    """Prove that a candidate is no control funnel function with margin λ (1/s) on the problem's one segment.

    `points` are the falsifier's; without them it is asked. C and rate are taken as they are, bit by bit; β̲ and λ, which
    a configuration says, by their decimals.

    Returns:
        REFUTED with a document that the checker confirms, or INCONCLUSIVE: none of the points shows a violation.

    Raises:
        InputError: more than one segment, or a negative margin.
    """
    objects(problem=(problem, Problem), funnel=(funnel, Funnel))
    margin = number("margin", margin, "1/s", least=0)
    points = None if points is None else instances("points", points, WorstPoint)
    if len(problem.path.segments) != 1:
        raise InputError(f"refute: expected one segment, got {len(problem.path.segments)}")
    require_fit(problem, [funnel])
    segment = problem.path.segments[0]
    question, legs = write_problem(problem, trace_deviation(problem.vehicle)), legs_of(problem.path)
    size = funnel.dimension
    shape = [[exact(funnel.shape[max(i, j), min(i, j)]) for j in range(size)] for i in range(size)]
    candidate = FunnelClaim(
        level=LEVELS[funnel.template.name](exact(funnel.rate)),
        shape=shape,
        beta_lower=rational(float(funnel.beta_lower)),
        beta_inner=rational(float(funnel.inner)),
        margin=rational(float(margin)),
        margin_per_metre=None,
    )
    references = range(sum(map(len, segment.references())))
    for point in falsify(problem, segment, funnel) if points is None else points:
        for theta, x in _variants(funnel, segment.last_theta, point):
            for reference in references if point.condition == "d" else (0,):
                witness = write_witness(point.condition, 0, theta, reference, x)
                document = seal("refutation", question, [write_funnel(candidate)], witness, legs)
                report = check_document(json.loads(dump(document)))
                if report.outcome is Outcome.REFUTED:
                    return Certification(Verdict.REFUTED, report.message, funnels=(funnel,), document=document)
    return Certification(Verdict.INCONCLUSIVE, "no point was found at which a condition is violated", funnels=(funnel,))


def _variants(funnel: Funnel, duration: float, point: WorstPoint) -> Iterator[tuple[fmpq, list[fmpq]]]:
    """Rational neighbours of a point, nearest first."""
    end = rational(float(duration))
    for nudge in NUDGES:
        x = [float(f"{value * (1 + nudge):.{X_DIGITS}g}") for value in point.x]
        deviation = [rational(value) for value in x]
        if point.condition == "d":
            form = sum(x[i] * x[j] * float(funnel.shape[i, j]) for i in range(len(x)) for j in range(len(x)))
            thetas = [rational(theta) for theta in _thetas_in_shell(funnel, duration, form)]
        else:
            thetas = {"a": [fmpq(0)], "b": [end]}.get(point.condition, [rational(float(point.theta))])
        yield from ((min(max(theta, fmpq(0)), end), deviation) for theta in thetas)


def _thetas_in_shell(funnel: Funnel, duration: float, form: float) -> list[float]:
    """Some θ at which the deviation lies in the shell, the most demanding first: there V is just above β̲."""
    if form <= 0:
        return []
    if not funnel.rate:
        return [0.0]

    def reaching(level: float) -> float:
        """θ ∈ [0, T] at which V is nearest to the level."""
        return min(max(funnel.template.reaching(funnel.rate, form, level), 0.0), duration)

    inner, outer = reaching(funnel.beta_lower), reaching(1.0)
    return [inner + depth * (outer - inner) for depth in (0.0, *DEPTHS)]
