"""Signs of polynomials on an interval, at the very edge of what is true and against the roots."""

import itertools
import random

import pytest
from flint import fmpq, fmpq_poly

from cfcheck.exact.polynomial import bernstein, is_nonnegative
from tests.by_hand import ONE, ZERO


def test_bernstein_coefficients_enclose_and_meet_the_ends() -> None:
    rng = random.Random(0)
    for _ in range(50):
        coefficients = [fmpq(rng.randint(-9, 9), rng.randint(1, 9)) for _ in range(rng.randint(1, 6))]
        length = fmpq(rng.randint(1, 9), rng.randint(1, 9))
        values = [fmpq_poly(coefficients)(length * fmpq(k, 20)) for k in range(21)]
        for more in (0, 4):  # zeros of higher powers change the coefficients, not what they enclose
            control = bernstein([*coefficients, *[ZERO] * more], length)
            assert len(control) == len(coefficients) + more
            assert control[0] == values[0] and control[-1] == values[-1]
            assert min(control) <= min(values) and max(values) <= max(control)


@pytest.mark.parametrize(
    "coefficients",
    [
        fmpq_poly([fmpq(-1, 2), 0, 1]) ** 2,  # touches zero at an irrational place
        fmpq_poly([fmpq(-1, 3), 1]) ** 2 * fmpq_poly([fmpq(-2, 3), 1]) ** 2,
        fmpq_poly([0, 1]) * fmpq_poly([1, -1]),  # zero at both ends
        fmpq_poly([0, 0, 1]) * fmpq_poly([fmpq(-1, 3), 1]) ** 4 * fmpq_poly([1, -1]) ** 3,
    ],
)
def test_a_polynomial_that_touches_zero_is_told_from_one_below(coefficients: fmpq_poly) -> None:
    assert is_nonnegative(coefficients.coeffs(), ONE)
    assert not is_nonnegative((coefficients - fmpq(1, 10**40)).coeffs(), ONE)
    assert not is_nonnegative((-coefficients).coeffs(), ONE)
    assert not is_nonnegative((coefficients * fmpq_poly([fmpq(-1, 5), 1])).coeffs(), ONE)


def test_zero_is_nonnegative() -> None:
    assert is_nonnegative([ZERO, ZERO], ONE)
    assert is_nonnegative([ZERO], ONE)


def test_signs_agree_with_the_roots() -> None:
    rng = random.Random(1)
    seen = {True: 0, False: 0}
    for _ in range(400):
        length = fmpq(rng.randint(1, 5), rng.randint(1, 5))
        roots = [fmpq(rng.randint(-4, 12), 8) * length for _ in range(rng.randint(0, 3))]
        polynomial = fmpq_poly([rng.choice((-1, 1, 2))]) * fmpq_poly([fmpq(rng.randint(1, 3)), 0, 1])
        for root in roots:
            polynomial *= fmpq_poly([-root, 1]) ** rng.choice((1, 1, 2))
        # between all roots and the ends there is a point
        marks = sorted({ZERO, length, *(root for root in roots if 0 < root < length)})
        probes = [*marks, *((a + b) / 2 for a, b in itertools.pairwise(marks))]
        expected = all(polynomial(probe) >= 0 for probe in probes)
        assert is_nonnegative(polynomial.coeffs(), length) == expected
        seen[expected] += 1
    assert min(seen.values()) > 50
