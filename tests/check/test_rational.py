import math
import random
from decimal import ROUND_CEILING, ROUND_FLOOR
from fractions import Fraction

import pytest
from flint import fmpq

from cfcheck.exact.rational import (
    about,
    decimal_text,
    exp_bounds,
    float_below,
    pi_lower,
    pi_upper,
    rational,
    sqrt_upper,
)


def exact(value: fmpq) -> Fraction:
    return Fraction(int(value.p), int(value.q))


def test_a_float_means_its_shortest_decimal() -> None:
    assert rational(0.34) == fmpq(17, 50)
    assert rational(-1e-7) == fmpq(-1, 10**7)
    assert rational(3) == 3
    with pytest.raises(ValueError, match="nan"):
        rational(float("nan"))


def test_bounds_enclose_what_they_bound() -> None:
    for k in (-40, -3, 0, 1, 17, 63):
        low, high = exp_bounds(fmpq(k, 7))
        assert low <= high
        assert float(low) == pytest.approx(math.exp(k / 7), rel=1e-15)
        # e^(a+b) = e^a e^b holds only if both bounds are on their sides
        assert low * exp_bounds(fmpq(-k, 7))[0] <= 1 <= high * exp_bounds(fmpq(-k, 7))[1]
    for k in range(1, 200):
        assert fmpq(k, 7) <= sqrt_upper(fmpq(k, 7)) ** 2 <= fmpq(k, 7) * (1 + fmpq(1, 10**30))
    assert sqrt_upper(fmpq(0)) == 0
    # 355/113 and 103993/33102 are convergents of π above and below it
    assert fmpq(103993, 33102) < pi_lower() < pi_upper() < fmpq(355, 113)


def test_huge_exponents_are_refused() -> None:
    for exponent in (fmpq(65), fmpq(-(10**300))):
        with pytest.raises(ValueError, match="exponent"):
            exp_bounds(exponent)


def test_decimals_are_rounded_as_told() -> None:
    rng = random.Random(0)
    for _ in range(500):
        value = fmpq(rng.randint(1, 10**12), rng.randint(1, 10**12))
        for number in (value, -value):
            below, above = (Fraction(decimal_text(number, way)) for way in (ROUND_FLOOR, ROUND_CEILING))
            assert below <= exact(number) <= above
            assert above - below < Fraction(1, 10**4) * exact(value)
        assert Fraction(float_below(value)) <= exact(value) < Fraction(math.nextafter(float_below(value), math.inf))
    assert decimal_text(fmpq(2, 3), ROUND_FLOOR) == "0.666666"
    assert decimal_text(fmpq(2, 3)) == decimal_text(fmpq(2, 3), ROUND_CEILING) == "0.666667"
    assert about(fmpq(-2, 3)) == "about -0.666667"


def test_short_decimals_are_printed_as_they_are() -> None:
    for text in ("0", "0.34", "-4", "1234567891", "6.283185307179586", "0.30000000000000004", "10000"):
        value = rational(text)
        assert about(value) == decimal_text(value, ROUND_FLOOR) == decimal_text(value, ROUND_CEILING) == text


def test_numbers_of_any_size_are_printed() -> None:
    assert about(fmpq(10**400)) == "1e+400"
    assert about(fmpq(1, 10**400)) == "1e-400"
    assert about(fmpq(10**5000 + 1, 3)) == "about 3.33333e+4999"
    assert decimal_text(fmpq(1, 3 * 10**9), ROUND_FLOOR) == "3.33333e-10"
