import math
import random
from fractions import Fraction

import numpy as np
import pytest
from flint import fmpq

from cfjax.check.rational import (
    decimal_down,
    exp_bounds,
    float_below,
    is_positive_definite,
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


def test_decimals_are_rounded_down() -> None:
    rng = random.Random(0)
    for _ in range(500):
        value = fmpq(rng.randint(1, 10**12), rng.randint(1, 10**12))
        shown = Fraction(decimal_down(value))
        assert 0 <= exact(value) - shown < Fraction(1, 10**4) * exact(value)
        assert Fraction(float_below(value)) <= exact(value) < Fraction(math.nextafter(float_below(value), math.inf))
    assert decimal_down(fmpq(2, 3)) == "0.666666"
    assert decimal_down(fmpq(1234567891, 1)) == "1234567891"


def test_definiteness_agrees_with_eigenvalues() -> None:
    rng = np.random.default_rng(0)
    seen = {True: 0, False: 0}
    for _ in range(300):
        size = int(rng.integers(1, 8))
        root = rng.integers(-4, 5, size=(size, size + 1))
        matrix = root @ root.T + int(rng.integers(-6, 3)) * np.eye(size, dtype=int)
        least = np.linalg.eigvalsh(matrix.astype(float)).min()
        if abs(least) < 1e-9:
            continue
        answer = is_positive_definite([[fmpq(int(entry), 7) for entry in row] for row in matrix])
        assert answer == (least > 0)
        seen[answer] += 1
    assert min(seen.values()) > 30


def test_definiteness_is_decided_exactly() -> None:
    tiny = fmpq(1, 10**40)
    assert is_positive_definite([[fmpq(1), fmpq(1)], [fmpq(1), 1 + tiny]])
    assert not is_positive_definite([[fmpq(1), fmpq(1)], [fmpq(1), fmpq(1)]])
    assert not is_positive_definite([[fmpq(1), fmpq(1)], [fmpq(1), 1 - tiny]])
    assert not is_positive_definite([[fmpq(2), fmpq(1)], [fmpq(0), fmpq(2)]])  # not symmetric
    with pytest.raises(ValueError, match="square"):
        is_positive_definite([[fmpq(1), fmpq(0)]])
