import math
import random
from decimal import ROUND_CEILING, ROUND_FLOOR
from fractions import Fraction

import numpy as np
import pytest
from flint import fmpq

from cfcheck.exact import rational as check_rational
from cfcheck.exact.rational import (
    about,
    decimal_text,
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


def test_a_rounded_factor_never_says_what_elimination_denies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gram matrices as they are written: of low rank, padded a little, or moved just out of the cone; also spoiled."""
    rng = np.random.default_rng(0)
    decided = {True: 0, False: 0}
    for size in (1, 3, 15, 35):
        for _ in range(25):
            half = rng.normal(size=(size, rng.integers(1, size + 1)))
            matrix = half @ half.T
            padding = rng.choice([1e-5, 1e-7, 1e-9, -1e-9, -1e-7]) * np.abs(matrix).max()
            bits = int(rng.integers(20, 60))
            padded = matrix + padding * np.eye(size)
            whole = [[round(float(padded[max(i, j), min(i, j)]) * 2**bits) for j in range(size)] for i in range(size)]
            answer = check_rational._is_dominated(whole)
            decided[answer] += 1
            if answer:
                assert check_rational._has_positive_minors(whole)
    assert min(decided.values()) > 20
    # without a factor a matrix has to be dominant itself, and strictly
    monkeypatch.setattr(check_rational, "_cholesky", lambda rows: [[0.0] * len(row) for row in rows])
    assert check_rational._is_dominated([[2**60 + 1, 2**60], [2**60, 2**60 + 1]])
    assert not check_rational._is_dominated([[2**60, 2**60], [2**60, 2**60]])
    # a factor of somebody else's is no proof: of a matrix with the eigenvalues 1.6, 1.6 and -0.2, in units of 5 · 2^60
    not_definite = [[5 * 2**60 if i == j else -3 * 2**60 for j in range(3)] for i in range(3)]
    assert not check_rational._has_positive_minors(not_definite)
    for size in (0.0, 1.0, 2.0**40, 2.0**47, 2.0**52):
        lower = [[*[0.0] * i, size] for i in range(3)]
        monkeypatch.setattr(check_rational, "_cholesky", lambda _, own=lower: own)
        assert not check_rational._is_dominated(not_definite)


def test_numbers_of_any_length_are_decided() -> None:
    for scale in (fmpq(1, 2**2000), fmpq(1), fmpq(2**2000), fmpq(3**900, 7**900)):
        assert is_positive_definite([[2 * scale, scale], [scale, 2 * scale]])
        assert not is_positive_definite([[scale, 2 * scale], [2 * scale, scale]])
        assert not is_positive_definite([[scale, fmpq(0)], [fmpq(0), fmpq(0)]])
    assert is_positive_definite([[fmpq(2**3000), fmpq(0)], [fmpq(0), fmpq(1)]])  # of very unequal sizes
    assert not is_positive_definite([[fmpq(1), fmpq(10**400)], [fmpq(10**400), fmpq(1)]])
