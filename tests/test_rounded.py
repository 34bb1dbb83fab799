"""Rounding for people: what is shown claims no more than what is proven."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from cfjax.rounded import MILLI, rounded_down, rounded_up, written


@pytest.mark.parametrize("digits", [2, 3, 4])
@pytest.mark.parametrize("power", [0, MILLI])
def test_a_bound_stays_one(digits: int, power: int) -> None:
    rng = np.random.default_rng(0)
    values = np.exp(rng.uniform(-12, 12, 500)) * rng.choice([-1.0, 1.0], 500)
    for value in [*map(float, values), 0.001577441402603147, 0.99999, 9.9996e-4, 0.0, 1e6]:
        below, above = (Fraction(how(value, digits, power)) for how in (rounded_down, rounded_up))
        exact = Fraction(value) * 10**power
        assert below <= exact <= above
        assert above - below <= abs(exact) * Fraction(10) ** (1 - digits)  # one unit of the last digit


def test_texts() -> None:
    assert rounded_down(0.001577441402603147, 3, MILLI) == "1.57"  # to nearest it would be 1.58
    assert rounded_down(0.99999) == "0.9999" and rounded_up(0.99999) == "1"
    assert rounded_down(0.3) == "0.2999"  # the float is a little less than three tenths
    assert rounded_down(written(0.3)) == rounded_up(written(0.3)) == "0.3"
    assert rounded_up(0.9) == "0.9001" and rounded_up(written(0.9)) == "0.9"
    assert rounded_up(Decimal("31.41592653589793")) == "31.42"
    assert rounded_down(None) == rounded_down(float("nan")) == "–"
    assert rounded_down(float("inf")) == "inf"
