"""Where a piece leaves a tube by most, told from what it exceeds by next to nothing."""

import math

import pytest
from flint import fmpq, fmpq_poly

from cfjax.tubes.violation import violations
from tests.by_hand import TINY, bounds, piece


def test_a_spike_between_the_samples_is_found() -> None:
    # at 0, 1/2 and 1 exactly on the bound, above it between the first two by 5e-14
    spike = fmpq_poly([0, 1]) * fmpq_poly([fmpq(-1, 2), 1]) * fmpq_poly([-1, 1]) * TINY
    for sign in (1, -1):
        coefficients = tuple((1 + sign * spike).coeffs())
        (violation,) = violations(piece(coefficients, (1,)), bounds())
        assert violation.quantity == "curvature"
        assert 4 * TINY / 100 < violation.excess < TINY / 10
        assert float(violation.theta) == pytest.approx(0.5 - sign * math.sqrt(1 / 12), abs=1e-9)
