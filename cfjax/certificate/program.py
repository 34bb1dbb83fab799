"""From a claim on a funnel to its proof: the semidefinite program, and its solution made exact."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from flint import fmpq, fmpq_mpoly
from jaxtyping import Float

from cfcheck.exact.enclosure import TooLarge
from cfcheck.kernel.program import CellProof, FunnelProgram
from cfjax.certificate.rounding import dyadic, round_gram
from cfjax.solver import REFERENCE, Program, Solution, Solver, Status, solver_named
from cfjax.solver.program import dense


PADDINGS = (1e-7, 1e-6, 1e-5, 1e-4)  # of the largest Gram entry; tried in this order until the proof holds
LARGEST = 2.0**63  # of a solution's numbers: larger ones could not be written
MARGIN_BITS = 40  # of the margins that the document claims: rounded down


def coefficients(polynomial: fmpq_mpoly, order: int) -> Float[np.ndarray, " r"]:
    """Of all monomials up to the order."""
    # of whole numbers: correctly rounded however long
    terms = {tuple(map(int, e)): int(c.p) / int(c.q) for e, c in polynomial.to_dict().items()}
    return dense(terms, polynomial.context().nvars(), order)


def program_of(claim: FunnelProgram, cell: object) -> Program:
    """What a solver is asked about a cell."""
    degrees = claim.degrees_of(cell)
    order = 2 * max(degrees)
    target, drop, *constraints = (
        coefficients(polynomial, order)
        for polynomial in (claim.target(cell), claim.weight(cell), *claim.constraints(cell))
    )
    return Program(len(claim.states), degrees, target, drop, np.array(constraints).reshape(-1, len(target)))


def solved(solver: Solver, programs: Sequence[Program]) -> list[Solution]:
    """What a solver says of each program; whatever stops it is an answer that it failed."""
    try:
        found = solver.solve(programs)
        if len(found) == len(programs):
            return list(found)
        message = f"{len(found)} answers for {len(programs)} programs"
    except Exception as error:
        message = f"{type(error).__name__}: {error}".splitlines()[0]
    return [Solution.failed(solver.name, message)] * len(programs)


class CellResult(NamedTuple):
    """What the exact replay made of a solution: no proof, or one with its margin."""

    solution: Solution
    proof: CellProof | None
    margin: fmpq

    @property
    def is_good(self) -> bool:
        """Whether there is nothing that another solver could mend: of a bound the margin may well be negative."""
        lost_by_rounding = self.solution.margin > 0 >= self.margin
        return self.proof is not None and self.solution.status is Status.OPTIMAL and not lost_by_rounding


def prove(claim: FunnelProgram, cell: object, program: Program, solution: Solution) -> CellResult:
    """The exact proof that a solution hints at; where there is none, or a poor one, the reference solver's.

    Raises:
        TooLarge: it asks for more than the checker takes.
    """
    budget = claim.domain.budget
    left = budget.left
    first = _exact_proof(claim, cell, solution)
    if first.is_good or solution.solver == REFERENCE:
        return first
    budget.left = left  # one of the two will be in the file
    (other,) = solved(solver_named(REFERENCE), [program])
    second = _exact_proof(claim, cell, other)
    if second.proof is None:
        return second if solution.status is Status.FAILED else first
    return second if first.proof is None or second.margin > first.margin else first


def _is_usable(claim: FunnelProgram, cell: object, solution: Solution) -> bool:
    """Whether the exact replay may be asked about it."""
    sizes = [(len(basis), len(basis)) for basis in claim.bases_of(cell)]
    return (
        solution.status is not Status.FAILED
        and solution.grams is not None
        and abs(solution.margin) < LARGEST
        and [np.shape(gram) for gram in solution.grams] == sizes
        and all((np.abs(gram) < LARGEST).all() for gram in solution.grams)
    )


def _exact_proof(claim: FunnelProgram, cell: object, solution: Solution) -> CellResult:
    """The first padding with which the exact replay accepts a solution as rounded."""
    if not _is_usable(claim, cell, solution):
        return CellResult(solution, None, fmpq(0))
    assert solution.grams is not None
    for padding in PADDINGS:
        grams = tuple(round_gram(gram, padding) for gram in solution.grams)
        proof = CellProof(cell, dyadic(solution.margin, MARGIN_BITS), grams)
        budget = claim.domain.budget
        left = budget.left
        try:
            return CellResult(solution, proof, claim.proven_margin(proof))
        except TooLarge:  # the checker takes no more, whoever's hints they are
            raise
        except ValueError:  # not positive definite yet; the checker will not see this attempt, nor pay for it
            budget.left = left
    return CellResult(solution, None, fmpq(0))
