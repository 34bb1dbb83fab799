"""Two ways to prove condition (d) along half of the oval: θ as a fifth variable, or ends of the curvature's interval.

    python experiments/theta_comparison.py [--pieces N] [--solver NAME]

The funnel is learned once. Then, numerically (sums of squares without their rounding): N pieces of θ, on each of which
the turning rate and the funnel's level are quadratics in θ, and θ is a variable of the polynomials; and, as the package
does it, one stretch over the whole half, proven at both ends of the curvature, where θ is eliminated. Prints the margin
(1/s) and the solver's seconds of both, one program after the other.
"""

import argparse
import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from flint import fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from cfcheck.kernel.decrease import SteadyDecrease
from cfcheck.path.bounds import Bounds
from cfjax import Interval, KinematicBicycle
from cfjax.certificate.certifier import statement_of
from cfjax.certificate.program import coefficients, program_of
from cfjax.certificate.rounding import dyadic, round_funnel
from cfjax.certificate.stretches import ThetaInterval, bounded, decreases_on, question_of
from cfjax.conf import preset, problem_of
from cfjax.exact import exact_course
from cfjax.funnel import template_named
from cfjax.learner import learn
from cfjax.solver import DEFAULT, SOLVERS, Program, Solution, solver_named


BITS = 40
RING = fmpq_mpoly_ctx.get([*(f"y{k}" for k in range(4)), "t"], "degrevlex")


def lifted(polynomial: fmpq_mpoly) -> fmpq_mpoly:
    """The same polynomial, of θ too."""
    return RING.from_dict({(*map(int, e), 0): c for e, c in polynomial.to_dict().items()})


def along(values: np.ndarray, t: np.ndarray) -> fmpq_mpoly:
    """The quadratic in t ∈ [−1, 1] nearest to the values."""
    coefficients = np.polynomial.Polynomial.fit(t, values, 2, domain=[-1, 1]).convert().coef
    return RING.from_dict({(0, 0, 0, 0, k): dyadic(float(c), BITS) for k, c in enumerate(coefficients)})


def with_theta(
    still: SteadyDecrease, turning: SteadyDecrease, omega: fmpq_mpoly, level: fmpq_mpoly
) -> Iterator[Program]:
    """Every sign cell of a piece: what is affine in the turning rate, between its values at 0 and 1 rad/s."""
    form, (t,) = lifted(still.form), RING.gens()[4:]
    beta = fmpq(9, 10)
    for cell, other in zip(still.cells(), turning.cells(), strict=True):
        if cell.piece:
            continue
        first, second = lifted(still.target(cell)), lifted(turning.target(other))
        target = first + omega * (second - first)
        signs = [
            lifted(a) + omega * (lifted(b) - lifted(a))
            for a, b in zip(still.constraints(cell)[:-2], turning.constraints(other)[:-2], strict=True)
        ]
        constraints = [*signs, form - beta * level, level - form, 1 - t * t]
        degree = max(int(target.total_degree()), *(int(g.total_degree()) for g in constraints))
        order = -(-degree // 2)
        degrees = (order, *((2 * order - int(g.total_degree())) // 2 for g in constraints))
        rows = [coefficients(polynomial, 2 * order) for polynomial in (target, level, *constraints)]
        yield Program(5, degrees, rows[0], rows[1], np.array(rows[2:]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pieces", type=int, default=8)
    parser.add_argument("--solver", choices=SOLVERS, default=DEFAULT)
    arguments = parser.parse_args()
    problem = problem_of(preset("oval"))
    assert isinstance(problem.vehicle, KinematicBicycle) and problem.timing == Interval(0.5, 2.0)
    learned = learn(problem, template_named("contracting"))
    assert learned is not None
    segment = problem.path.curve[0]
    rounded = round_funnel(learned.funnel, segment)
    asked = question_of(statement_of(problem).claim, rounded)
    print(f"falsified margin {learned.margin:.4f} 1/s")

    pieces = [piece for piece in exact_course(problem.path).pieces if piece.segment == 0]
    whole = bounded(pieces, fmpq(0), sum((piece.duration for piece in pieces), fmpq(0)))
    questions = decreases_on(asked, rounded, whole)
    solver = solver_named(arguments.solver)
    found = solver.solve([program_of(q, c) for q in questions for c in q.cells()])
    print(f"ends of the curvature, one stretch: {report(found)}")

    found = []
    for begin, end in itertools.pairwise(np.linspace(0.0, segment.duration, arguments.pieces + 1)):
        theta, t = np.linspace(begin, end, 65), np.linspace(-1.0, 1.0, 65)
        span = dyadic(float(begin), BITS), dyadic(float(end), BITS)

        def question(turn_rate: int, span: tuple[fmpq, fmpq] = span) -> SteadyDecrease:
            ends = (fmpq(turn_rate),) * 2, (fmpq(1),) * 2, (fmpq(0),) * 2
            return decreases_on(asked, rounded, ThetaInterval(*span, Bounds(*ends)))[0]

        still = question(0)
        turning = replace(question(1), enclosures=still.enclosures)
        level = along(np.asarray(learned.funnel.level(theta)), t)
        part = solver.solve(list(with_theta(still, turning, along(segment.turn_rate.polynomial(theta), t), level)))
        print(f"theta a variable, {begin:.2f} to {end:.2f} s: {report(part)}", flush=True)
        found += part
    print(f"theta a variable, {arguments.pieces} pieces: {report(found)}")


def report(solutions: list[Solution]) -> str:
    margin, seconds = min(s.margin for s in solutions), sum(s.seconds for s in solutions)
    status = ", ".join(sorted({str(s) for s in solutions}))
    return f"margin {margin:.4f} 1/s, {len(solutions)} programs, {seconds:.1f} s ({status})"


if __name__ == "__main__":
    main()
