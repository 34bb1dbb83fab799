"""Sums of squares as a semidefinite program: the numerical half of the proof.

Find the largest λ and positive semidefinite Q with

    target − λ drop = z₀ᵀ Q₀ z₀ + Σ_k g_k zᵀ Q_k z        (polynomials in y, coefficients compared one by one)

in CVXPY with Clarabel. What comes back is a hint for the exact half (`cfjax.check.decrease`), never a proof.
"""

import threading
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import cvxpy as cp
import numpy as np
import scipy.sparse as sp
from flint import fmpq_mpoly
from jaxtyping import Float

from cfjax.check.program import Exponents, monomials


_CVXPY = threading.Lock()  # it numbers its variables by a counter that threads may not share


@dataclass(frozen=True)
class SosSolution:
    """What the solver said: `status` is CVXPY's; margin and Gram matrices (or None) are numerical hints."""

    status: str
    margin: float
    grams: tuple[Float[np.ndarray, "_ _"], ...] | None
    seconds: float
    second_moments: Float[np.ndarray, "v v"] | None = None  # of the points that limit λ, from the dual


def coefficients(polynomial: fmpq_mpoly) -> dict[Exponents, float]:
    """Floating-point coefficients by exponents."""
    return {
        tuple(int(k) for k in e): int(c.p) / int(c.q)  # of whole numbers: correctly rounded however long
        for e, c in polynomial.to_dict().items()
    }


def product_matrix(
    factor: dict[Exponents, float], basis: tuple[Exponents, ...], rows: dict[Exponents, int]
) -> sp.csr_matrix:
    """The matrix A with A vec(Q) = coefficients of factor · zᵀ Q z; row order as in `rows`."""
    size = len(basis)
    at, column, value = [], [], []
    for i, first in enumerate(basis):
        for j, second in enumerate(basis):
            for shift, weight in factor.items():
                at.append(rows[tuple(a + b + c for a, b, c in zip(first, second, shift, strict=True))])
                column.append(i + size * j)
                value.append(weight)
    return sp.csr_matrix((value, (at, column)), shape=(len(rows), size * size))


def solve(
    target: fmpq_mpoly,
    drop: fmpq_mpoly,
    constraints: Sequence[fmpq_mpoly],
    bases: Sequence[tuple[Exponents, ...]],
) -> SosSolution:
    """Maximise λ. `bases[0]` belongs to the free square z₀, the others to the constraints in order."""
    started = time.perf_counter()
    variables, degree = len(bases[0][0]), 2 * max(map(sum, bases[0]))
    rows = {e: k for k, e in enumerate(monomials(variables, degree))}
    goal, fall = np.zeros(len(rows)), np.zeros(len(rows))
    for vector, polynomial in ((goal, target), (fall, drop)):
        for e, c in coefficients(polynomial).items():
            vector[rows[e]] = c
    factors = [{(0,) * variables: 1.0}]
    scales = [1.0]
    for constraint in constraints:
        table = coefficients(constraint)
        scales.append(max(map(abs, table.values())))
        factors.append({e: c / scales[-1] for e, c in table.items()})
    scale = np.abs(goal).max()
    with _CVXPY:
        margin = cp.Variable()
        grams = [cp.Variable((len(basis), len(basis)), PSD=True) for basis in bases]
        total = fall * margin
        for factor, basis, gram in zip(factors, bases, grams, strict=True):
            total = total + product_matrix(factor, basis, rows) @ cp.vec(gram, order="F")
        identity = total == goal / scale
        problem = cp.Problem(cp.Maximize(margin), [identity])
        data, chain, inverse = problem.get_problem_data(cp.CLARABEL, solver_opts={})
        assert chain is not None
    try:
        answer = chain.solve_via_data(problem, data)  # Clarabel alone: other threads go on
        with _CVXPY, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # "may be inaccurate": the status says so
            problem.unpack_results(answer, chain, inverse)
    except cp.SolverError as error:
        return SosSolution(f"error: {error}", float("nan"), None, time.perf_counter() - started)
    seconds = time.perf_counter() - started
    found = [gram.value for gram in grams if gram.value is not None]
    if margin.value is None or len(found) < len(grams):
        return SosSolution(str(problem.status), float("nan"), None, seconds)
    values = tuple(0.5 * (gram + gram.T) * scale / s for gram, s in zip(found, scales, strict=True))
    second = _second_moments(identity.dual_value, rows, variables)
    return SosSolution(str(problem.status), float(margin.value * scale), values, seconds, second)


def _second_moments(
    dual: Float[np.ndarray, " rows"] | None, rows: dict[Exponents, int], variables: int
) -> Float[np.ndarray, "v v"] | None:
    """E[y yᵀ] under the measure that the dual solution stands for: it lives on the points that limit λ."""
    if dual is None or not abs(mass := dual[rows[(0,) * variables]]) > 0:
        return None
    units = np.eye(variables, dtype=int)
    return np.array([[dual[rows[tuple(int(k) for k in a + b)]] / mass for b in units] for a in units])
