"""From floating-point numbers to short rationals."""

import numpy as np
import pytest
from flint import fmpq

from cfcheck.exact.definite import is_positive_definite, symmetric
from cfjax.certificate.rounding import dyadic, round_gram, round_rate, round_shape, round_whitening


def test_rounding_stays_near_and_is_exact_in_floats() -> None:
    rng = np.random.default_rng(1)
    for scale in (1e-4, 1.0, 1e4):
        half = rng.normal(size=(4, 4))
        shape = scale * (half @ half.T + np.eye(4))
        rounded = np.array([[float(entry) for entry in row] for row in round_shape(shape)])
        assert np.abs(rounded - shape).max() <= 1e-9 * np.linalg.eigvalsh(shape)[0]
        assert all(
            fmpq(*float(e).as_integer_ratio()) == x
            for e, x in zip(rounded.flat, (entry for row in round_shape(shape) for entry in row), strict=True)
        )
        whitening = np.array([[float(w) for w in row] for row in round_whitening(shape)])
        np.testing.assert_allclose(whitening @ shape @ whitening, np.eye(4), atol=1e-3)
        gram = shape / np.linalg.norm(shape)
        rounded_gram = round_gram(gram, 1e-7)
        entries = symmetric([fmpq(entry, 2**rounded_gram.exponent) for entry in rounded_gram.lower])
        assert is_positive_definite(entries)
        assert rounded_gram.whole == [[entry * 2**rounded_gram.exponent for entry in row] for row in entries]
        np.testing.assert_allclose([[float(e) for e in row] for row in entries], gram, atol=2e-7)
    assert float(round_rate(-0.123456789)) == pytest.approx(-0.123456789, rel=1e-9)
    assert round_rate(0.0) == 0
    assert dyadic(0.3, 2) == fmpq(1, 4)
