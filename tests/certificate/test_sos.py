"""Manufactured problems for the numerical half; rounding."""

import numpy as np
import pytest
from flint import fmpq, fmpq_mpoly_ctx

from cfjax.certificate.rounding import dyadic, round_gram, round_rate, round_shape, round_whitening
from cfjax.certificate.sos import coefficients, product_matrix, solve
from cfjax.check.document import unpack_triangle
from cfjax.check.program import monomials, quadratic_form
from cfjax.check.rational import is_positive_definite


RING = fmpq_mpoly_ctx.get(["y0", "y1"], "degrevlex")


def test_the_least_value_of_a_polynomial_is_found() -> None:
    """min of (y0 − 1)² + (y0 y1 + 2)² − 3 is −3; on the disc |y|² ≤ 1 of y0 it is −1."""
    y0, y1 = RING.gens()
    one = RING.constant(1)
    polynomial = (y0 - 1) ** 2 + (y0 * y1 + 2) ** 2 - 3
    free = solve(polynomial, one, [], [monomials(2, 2)])
    assert free.status == "optimal"
    assert free.margin == pytest.approx(-3, abs=1e-5)
    disc = solve(y0, one, [1 - y0**2 - y1**2], [monomials(2, 1), monomials(2, 0)])
    assert disc.margin == pytest.approx(-1, abs=1e-6)
    assert disc.grams is not None
    identity = y0 + fmpq(round(-disc.margin * 10**9), 10**9)
    for gram, factor, degree in zip(disc.grams, (one, 1 - y0**2 - y1**2), (1, 0), strict=True):
        entries = [[fmpq(round(v * 10**9), 10**9) for v in row] for row in gram]
        identity -= factor * quadratic_form(RING, entries, monomials(2, degree))
    assert max(map(abs, coefficients(identity).values()), default=0.0) < 1e-6


def test_what_has_no_bound_gives_no_answer() -> None:
    y0, _ = RING.gens()
    assert solve(y0, RING.constant(1), [], [monomials(2, 1)]).grams is None


def test_product_matrix_multiplies() -> None:
    rng = np.random.default_rng(0)
    basis, rows = monomials(2, 1), {e: k for k, e in enumerate(monomials(2, 4))}
    factor = {(0, 0): 2.0, (1, 0): -1.5, (1, 1): 0.25}
    gram = rng.normal(size=(3, 3))
    gram = gram + gram.T
    vector = product_matrix(factor, basis, rows) @ gram.flatten(order="F")
    for y in rng.normal(size=(5, 2)):
        z = np.array([1, *y])
        value = sum(c * np.prod(y ** np.array(e)) for e, c in factor.items()) * (z @ gram @ z)
        assert vector @ [np.prod(y ** np.array(e)) for e in rows] == pytest.approx(value)


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
        exponent, lower = round_gram(gram, 1e-7)
        entries = unpack_triangle([fmpq(entry, 2**exponent) for entry in lower], 4)
        assert is_positive_definite(entries)
        np.testing.assert_allclose([[float(e) for e in row] for row in entries], gram, atol=2e-7)
    assert float(round_rate(-0.123456789)) == pytest.approx(-0.123456789, rel=1e-9)
    assert round_rate(0.0) == 0
    assert dyadic(0.3, 2) == fmpq(1, 4)
