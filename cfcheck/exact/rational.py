"""Exact numbers: rationals, rational bounds of real numbers, and their decimals."""

import math
from collections.abc import Sequence
from decimal import ROUND_HALF_EVEN, Context, Decimal, Inexact
from fractions import Fraction

from flint import arb, ctx, fmpq


Range = tuple[fmpq, fmpq]  # lower and upper bound
Matrix = Sequence[Sequence[fmpq]]

DYADIC = 80  # bits behind the point of numbers that are rounded to be short
LARGEST_EXPONENT = 64
PRECISION_BITS = 128  # of the arb balls that bound π, exponentials and square roots
LONGEST_DYADIC = 2**16  # bits of what a ball may become: its exponent is a number of any size
EXACT_DIGITS = 17  # a decimal that is exact is printed in full up to this length, any float's shortest form among them
ROUNDED_DIGITS = 6

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
    """The rational itself where its decimal is short, else six significant digits.

    `rounding` is one of `decimal.ROUND_…`: `ROUND_FLOOR` gives a decimal that is at most the rational, `ROUND_CEILING`
    one that is at least the rational. The rational may be of any size.
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
