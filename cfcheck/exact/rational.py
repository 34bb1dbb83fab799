"""Exact numbers: rationals, rational bounds of real constants, and definiteness of rational matrices."""

import math
from collections.abc import Sequence
from decimal import ROUND_HALF_EVEN, Context, Decimal, Inexact
from fractions import Fraction
from operator import mul

from flint import arb, ctx, fmpq, fmpq_mat, fmpz, fmpz_mat


Range = tuple[fmpq, fmpq]  # lower and upper bound
Matrix = Sequence[Sequence[fmpq]]

DYADIC = 80  # bits behind the point of numbers that are rounded to be short
LARGEST_EXPONENT = 64
PRECISION_BITS = 128  # of the arb balls that bound π, exponentials and square roots
LONGEST_DYADIC = 2**16  # bits of what a ball may become: its exponent is a number of any size
EXACT_DIGITS = 17  # a decimal that is exact is printed in full up to this length, any float's shortest form among them
ROUNDED_DIGITS = 6
FACTOR_BITS = 96  # of the largest entry of a matrix whose factor is rounded to whole numbers
RESERVE = 2.0**-26  # of the largest diagonal entry: what rounding a factor may take; hints are padded by more

ctx.prec = PRECISION_BITS


def rational(value: "float | int | str | fmpq") -> fmpq:
    """The rational that a number's shortest decimal form writes: 0.34 is 17/50, not its binary neighbour."""
    if isinstance(value, fmpq):
        return value
    if isinstance(value, float) and "." in (text := repr(float(value))) and "e" not in text:  # ten times as fast
        whole, _, places = text.partition(".")
        return fmpq(int(whole + places), 10 ** len(places))
    exact = Fraction(repr(float(value)) if isinstance(value, float) else value)
    return fmpq(exact.numerator, exact.denominator)


def _dyadic(ball: arb) -> fmpq:
    mantissa, power = ball.man_exp()
    exponent = int(power)
    if abs(exponent) > LONGEST_DYADIC:
        raise ValueError("a bound is too large or too small a number for this checker")
    return fmpq(mantissa << exponent) if exponent >= 0 else fmpq(mantissa, 1 << -exponent)


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


def sqrt_lower(value: fmpq) -> fmpq:
    """A rational that is at most √value, for value ≥ 0."""
    return value / sqrt_upper(value) if value else fmpq(0)


def dyadic(value: fmpq, up: bool) -> fmpq:
    """A short rational that is at least the value, or at most: whole 2^-DYADIC."""
    scaled = value * 2**DYADIC
    return fmpq(scaled.ceil() if up else scaled.floor(), 2**DYADIC)


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
    return value.height_bits()


def decimal_text(value: fmpq, rounding: str = ROUND_HALF_EVEN) -> str:
    """The rational itself where its decimal is short, else six significant digits, rounded as told (`decimal.ROUND_…`).

    For a number of any size; `ROUND_FLOOR` gives a decimal that is at most the rational, `ROUND_CEILING` at least.
    """
    above, below = Decimal(int(value.p)), Decimal(int(value.q))
    exact = Context(prec=EXACT_DIGITS)
    result = exact.divide(above, below)
    if exact.flags[Inexact]:
        result = Context(prec=ROUNDED_DIGITS, rounding=rounding).divide(above, below)
    else:
        result = exact.normalize(result)
    return f"{result:f}" if -ROUNDED_DIGITS <= result.adjusted() < EXACT_DIGITS else f"{result:e}"


def about(value: fmpq) -> str:
    """The rational as a decimal that says so where it is rounded."""
    text = decimal_text(value)
    exact = Fraction(text) == Fraction(int(value.p), int(value.q))
    return text if exact else f"about {text}"


def float_below(value: fmpq) -> float:
    """The largest floating-point number that is at most the rational."""
    exact = Fraction(int(value.p), int(value.q))
    nearest = float(exact)
    return math.nextafter(nearest, -math.inf) if Fraction(nearest) > exact else nearest


def is_positive_definite(matrix: Sequence[Sequence[fmpq]]) -> bool:
    """Whether a symmetric rational matrix is positive definite, decided exactly.

    A factor L that floating-point numbers suggest is rounded to whole numbers: where Q − L Lᵀ is strictly diagonally
    dominant with a positive diagonal, Q is positive definite, whatever L is. Where it is not, elimination decides.
    """
    size = len(matrix)
    if any(len(row) != size for row in matrix):
        raise ValueError("expected a square matrix")
    if any(matrix[i][j] != matrix[j][i] for i in range(size) for j in range(i)):
        return False
    numerator, _ = fmpq_mat([list(row) for row in matrix]).numer_denom()
    return is_positive_definite_whole([list(map(int, row)) for row in numerator.tolist()])


def is_positive_definite_whole(matrix: Sequence[Sequence[int]]) -> bool:
    """The same of a symmetric matrix of whole numbers."""
    return _is_dominated(matrix) or _has_positive_minors(matrix)


def _is_dominated(matrix: Sequence[Sequence[int]]) -> bool:
    """Whether the matrix less some L Lᵀ is strictly diagonally dominant, its diagonal positive: one L is tried.

    Row by row by Σ_j |r_ij| ≤ √(n−1) √(Σ_j r_ij²) over what is beside the diagonal: squares are summed in C.
    """
    size = len(matrix)
    largest = max((row[k] for k, row in enumerate(matrix)), default=0)
    if largest <= 0 or any(max(row) > largest or min(row) < -largest for row in matrix):
        return False
    shift = FACTOR_BITS - largest.bit_length()  # so that the largest entry of the matrix has as many bits
    lower = _cholesky([_scaled(row[: k + 1], shift) for k, row in enumerate(matrix)])
    if lower is None:
        return False
    factor = fmpz_mat([[*map(round, row), *[0] * (size - len(row))] for row in lower])
    # L is that of 2^shift times the matrix
    left = fmpz_mat(matrix) * 2 ** max(shift, 0) - factor * factor.transpose() * 2 ** max(-shift, 0)
    squares = left * left  # on its diagonal, as the matrix is symmetric: the squares of a row
    return all(left[k, k] > 0 and left[k, k] ** 2 > (size - 1) * (squares[k, k] - left[k, k] ** 2) for k in range(size))


def _scaled(row: Sequence[int], shift: int) -> list[float]:
    """As floating-point numbers, each times 2^shift: none has more than FACTOR_BITS bits then."""
    if shift < 0:
        return [float(entry >> -shift) for entry in row]
    unit = 2.0**shift
    return [entry * unit for entry in row]


def _cholesky(rows: list[list[float]]) -> list[list[float]] | None:
    """Rows of a triangle L with L Lᵀ ≈ matrix − RESERVE · its largest diagonal entry · 1; None where there is none.

    Of the matrix and of L, each row ends on the diagonal.
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


def _has_positive_minors(matrix: Sequence[Sequence[int]]) -> bool:
    """By the pivots of LDLᵀ.

    The elimination is fraction-free (Bareiss): its diagonal holds the leading principal minors, all of which are
    positive exactly for a positive definite matrix (Sylvester).
    """
    size = len(matrix)
    rows = [list(map(fmpz, row)) for row in matrix]
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
