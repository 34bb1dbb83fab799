"""From a claim on a funnel to its proof: the semidefinite program, and its solution made exact."""

import math

import numpy as np
from flint import fmpq, fmpq_mpoly

from cfjax.certificate.rounding import dyadic, round_gram
from cfjax.certificate.sos import SosSolution
from cfjax.certificate.writing import Gram
from cfjax.check.document import unpack_triangle
from cfjax.check.program import CellProof, Exponents, FunnelProgram


PADDINGS = (1e-7, 1e-6, 1e-5, 1e-4)  # of the largest Gram entry; tried in this order until the proof holds
MARGIN_BITS = 40  # of the margins that the document claims: rounded down
USABLE = ("optimal",)
HINT_ONLY = ("optimal_inaccurate",)  # Clarabel's AlmostSolved: no solution, but the exact replay may like it

Question = tuple[fmpq_mpoly, fmpq_mpoly, list[fmpq_mpoly], tuple[tuple[Exponents, ...], ...]]


def program_of(claim: FunnelProgram, cell: object) -> Question:
    """What `solve` is asked about a cell. Made in one thread: only the solver works beside others."""
    return claim.target(cell), claim.drop(cell), claim.constraints(cell), claim.bases


def is_usable(solution: SosSolution) -> bool:
    """Whether the exact replay may be asked about it."""
    return (
        solution.status in USABLE + HINT_ONLY
        and solution.grams is not None
        and math.isfinite(solution.margin)
        and all(np.isfinite(gram).all() for gram in solution.grams)
    )


def exact_proof(claim: FunnelProgram, cell: object, solution: SosSolution) -> tuple[CellProof | None, list[Gram], fmpq]:
    """The first padding with which the exact replay accepts a usable solution as rounded, and the margin it proves."""
    assert solution.grams is not None
    for padding in PADDINGS:
        grams = [round_gram(gram, padding) for gram in solution.grams]
        matrices = tuple(
            unpack_triangle([fmpq(entry, 2**exponent) for entry in lower], len(basis))
            for (exponent, lower), basis in zip(grams, claim.bases, strict=True)
        )
        proof = CellProof(cell, dyadic(solution.margin, MARGIN_BITS), matrices)
        budget = claim.domain.budget
        left = budget.left
        try:
            return proof, grams, claim.proven_margin(proof)
        except ValueError:  # not positive definite yet; the checker will not see this attempt, nor pay for it
            budget.left = left
    return None, [], fmpq(0)
