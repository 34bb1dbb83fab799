"""Exact numbers: rationals, rational bounds of real constants, and definiteness of rational matrices."""

import math
from collections.abc import Sequence
from fractions import Fraction

from flint import arb, ctx, fmpq, fmpq_mat


LARGEST_EXPONENT = 64
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
    """Rationals below and above e^value, for |value| ≤ 64: a funnel that shrinks by more than e^64 is refused."""
    if abs(value) > LARGEST_EXPONENT:
        raise ValueError(f"expected an exponent of at most {LARGEST_EXPONENT} in absolute value")
    ball = arb(value).exp()
    return lower_bound(ball), upper_bound(ball)


def pi_lower() -> fmpq:
    """A rational that is at most π, and by less than 1e-30."""
    return lower_bound(arb.pi())


def pi_upper() -> fmpq:
    """A rational that is at least π, and by less than 1e-30."""
    return upper_bound(arb.pi())


def bits(value: fmpq) -> int:
    """How long a rational is: bits of the longer one of numerator and denominator."""
    return max(int(value.p).bit_length(), int(value.q).bit_length())


def decimal_down(value: fmpq, digits: int = 6) -> str:
    """The decimal with that many significant digits that is at most the (positive) rational."""
    exact = Fraction(int(value.p), int(value.q))
    if exact <= 0:
        raise ValueError(f"expected a positive number, got {value}")
    places = digits - 1
    while exact * 10**places >= 10**digits and places > 0:
        places -= 1
    while exact * 10**places < 10 ** (digits - 1):
        places += 1
    whole = exact.numerator * 10**places // exact.denominator
    text = str(whole).rjust(places + 1, "0")
    return f"{text[:-places]}.{text[-places:]}" if places else text


def float_below(value: fmpq) -> float:
    """The largest floating-point number that is at most the rational."""
    exact = Fraction(int(value.p), int(value.q))
    nearest = float(exact)
    return math.nextafter(nearest, -math.inf) if Fraction(nearest) > exact else nearest


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
