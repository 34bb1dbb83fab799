"""Whether a symmetric matrix is positive definite, decided exactly.

A factor L that floating-point numbers suggest is rounded to whole numbers: where Q − L Lᵀ is strictly diagonally
dominant with a positive diagonal, Q is positive definite, whatever L is. Where this fails, the characteristic
polynomial decides: its roots are real, as the matrix is symmetric, and all of them are positive exactly if its
coefficients alternate in sign, none being zero (Descartes).
"""

import math
from collections.abc import Sequence
from operator import mul
from typing import TypeVar

from flint import fmpq_mat, fmpz_mat

from cfcheck.exact.rational import Matrix


Entry = TypeVar("Entry")

FACTOR_BITS = 96  # of the largest entry of a matrix whose factor is rounded to whole numbers
RESERVE = 2.0**-26  # of the largest diagonal entry: what rounding a factor may take; hints are padded by more


def exact_matrix(rows: Matrix) -> fmpq_mat:
    """The matrix with these rows."""
    return fmpq_mat([list(row) for row in rows])


def symmetric(lower: Sequence[Entry]) -> list[list[Entry]]:
    """The rows of the symmetric matrix whose lower triangle, row by row, is the sequence."""
    size = (math.isqrt(8 * len(lower) + 1) - 1) // 2
    triangle = [lower[k * (k + 1) // 2 : (k + 1) * (k + 2) // 2] for k in range(size)]
    return [[*row, *(below[k] for below in triangle[k + 1 :])] for k, row in enumerate(triangle)]


def is_positive_definite(matrix: Matrix | fmpq_mat) -> bool:
    """Whether a rational matrix is symmetric and positive definite.

    Raises:
        ValueError: the matrix is not square.
    """
    exact = matrix if isinstance(matrix, fmpq_mat) else exact_matrix(matrix)
    if exact.nrows() != exact.ncols():
        raise ValueError("expected a square matrix")
    if exact != exact.transpose():
        return False
    numerator, _ = exact.numer_denom()
    return is_positive_definite_whole([list(map(int, row)) for row in numerator.tolist()])


def is_positive_definite_whole(matrix: Sequence[Sequence[int]]) -> bool:
    """The same of a symmetric matrix of whole numbers."""
    return _is_dominated(matrix) or _has_positive_roots(matrix)


def _is_dominated(matrix: Sequence[Sequence[int]]) -> bool:
    """Whether the matrix less some L Lᵀ is strictly diagonally dominant, its diagonal positive: one L is tried.

    Row by row by Σ_j |r_ij| ≤ √(n−1) √(Σ_j r_ij²) over the entries beside the diagonal: squares are summed in C.
    """
    size = len(matrix)
    largest = max((row[k] for k, row in enumerate(matrix)), default=0)
    if largest <= 0 or any(max(row) > largest or min(row) < -largest for row in matrix):
        return False
    shift = FACTOR_BITS - largest.bit_length()  # 2^shift times the matrix has FACTOR_BITS bits
    lower = _cholesky([_scaled(row[: k + 1], shift) for k, row in enumerate(matrix)])
    if lower is None:
        return False
    factor = fmpz_mat([[*map(round, row), *[0] * (size - len(row))] for row in lower])
    # L is that of 2^shift times the matrix
    left = fmpz_mat(matrix) * 2 ** max(shift, 0) - factor * factor.transpose() * 2 ** max(-shift, 0)
    squares = left * left  # the diagonal holds the sums of the squares of the rows, as the matrix is symmetric
    return all(left[k, k] > 0 and left[k, k] ** 2 > (size - 1) * (squares[k, k] - left[k, k] ** 2) for k in range(size))


def _scaled(row: Sequence[int], shift: int) -> list[float]:
    """The entries times 2^shift, as floating-point numbers; none of them has more than FACTOR_BITS bits."""
    if shift < 0:
        return [float(entry >> -shift) for entry in row]
    unit = 2.0**shift
    return [entry * unit for entry in row]


def _cholesky(rows: list[list[float]]) -> list[list[float]] | None:
    """Rows of a triangle L with L Lᵀ ≈ matrix − RESERVE · its largest diagonal entry · 1; None where there is none.

    The rows of the matrix and of L end on the diagonal.
    """
    reserve = RESERVE * max(row[-1] for row in rows)
    lower: list[list[float]] = []
    for row in rows:
        own: list[float] = []
        for entry, other in zip(row, lower, strict=False):
            own.append((entry - sum(map(mul, own, other))) / other[-1])
        pivot = row[-1] - reserve - sum(map(mul, own, own))
        if not pivot > 0:
            return None
        lower.append([*own, math.sqrt(pivot)])
    return lower


def _has_positive_roots(matrix: Sequence[Sequence[int]]) -> bool:
    """Whether all roots of the characteristic polynomial of a symmetric matrix are positive."""
    descending = reversed(fmpz_mat(matrix).charpoly().coeffs())
    return all(coefficient * (-1) ** k > 0 for k, coefficient in enumerate(descending))
