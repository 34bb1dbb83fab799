"""Exact numbers: rationals, rational bounds of real constants, and definiteness of rational matrices."""

from collections.abc import Sequence
from fractions import Fraction

from flint import arb, ctx, fmpq, fmpq_mat


PRECISION_BITS = 128  # of the arb balls that bound π, exponentials and square roots

ctx.prec = PRECISION_BITS


def rational(value: "float | int | str | fmpq") -> fmpq:
    """The rational that a number's shortest decimal form writes: 0.34 is 17/50, not its binary neighbour."""
    if isinstance(value, fmpq):
        return value
    exact = Fraction(repr(float(value)) if isinstance(value, float) else value)
    return fmpq(exact.numerator, exact.denominator)


def _dyadic(ball: arb) -> fmpq:
    mantissa, exponent = ball.man_exp()
    scale = fmpq(2) ** int(exponent)
    return fmpq(int(mantissa)) * scale


def upper_bound(ball: arb) -> fmpq:
    """A rational that is at least every number in the ball."""
    return _dyadic(ball.upper())


def lower_bound(ball: arb) -> fmpq:
    """A rational that is at most every number in the ball."""
    return _dyadic(ball.lower())


def sqrt_upper(value: fmpq) -> fmpq:
    """A rational that is at least √value, for value ≥ 0."""
    if value < 0:
        raise ValueError(f"expected a number that is not negative, got {value}")
    return upper_bound(arb(value).sqrt()) if value else fmpq(0)


def exp_bounds(value: fmpq) -> tuple[fmpq, fmpq]:
    """Rationals below and above e^value."""
    ball = arb(value).exp()
    return lower_bound(ball), upper_bound(ball)


def is_positive_definite(matrix: Sequence[Sequence[fmpq]]) -> bool:
    """Whether a symmetric rational matrix is positive definite, decided exactly by the pivots of LDLᵀ.

    The elimination is fraction-free (Bareiss) on the matrix cleared of denominators: its diagonal holds the leading
    principal minors, all of which are positive exactly for a positive definite matrix (Sylvester).
    """
    size = len(matrix)
    if any(len(row) != size for row in matrix):
        raise ValueError("expected a square matrix")
    if any(matrix[i][j] != matrix[j][i] for i in range(size) for j in range(i)):
        return False
    numerator, _ = fmpq_mat([list(row) for row in matrix]).numer_denom()
    rows = [[numerator[i, j] for j in range(size)] for i in range(size)]
    previous = 1
    for k in range(size):
        pivot = rows[k][k]
        if pivot <= 0:
            return False
        for i in range(k + 1, size):  # upper triangle only
            for j in range(i, size):
                rows[i][j] = (rows[i][j] * pivot - rows[k][i] * rows[k][j]) // previous
        previous = pivot
    return True
