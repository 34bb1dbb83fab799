"""Polynomials in parameters with enclosures as coefficients, against the same arithmetic at given parameters."""

from math import comb

import pytest
from flint import fmpq, fmpq_mpoly_ctx

from cfcheck.exact.enclosure import Domain, Enclosure, TooLarge
from cfcheck.robustness.parametric import Parametric


RING = fmpq_mpoly_ctx.get(["y0", "y1"], "degrevlex")
DOMAIN = Domain(RING, fmpq(1))
Y, Z = RING.gens()
POINTS = ({"a": fmpq(-2, 3), "b": fmpq(5)}, {"a": fmpq(0), "b": fmpq(1, 7)})


def test_a_combination_is_the_same_arithmetic_at_given_parameters() -> None:
    rough = Enclosure(DOMAIN, Y * Z + Y / 3, (fmpq(1, 100), fmpq(0), fmpq(1, 50)))
    exact = DOMAIN.exact(Z**3 - 2 * Y + 1)
    a, b = (Parametric.parameter(DOMAIN, name) for name in "ab")
    found = (a * Parametric.free(rough) - Parametric.free(exact)) * (b + a) + Parametric.free(rough)
    for point in POINTS:
        p, q = (DOMAIN.constant(point[name]) for name in "ab")
        wanted = (p * rough - exact) * (q + p) + rough
        combined = found.at(point)
        assert combined.enclosure.polynomial == wanted.polynomial
        assert combined.largest_remainder >= wanted.largest_remainder * (1 - fmpq(1, 10**30))
        sizes = DOMAIN.sizes(wanted.polynomial)
        for own, other in zip(combined.sizes(), sizes, strict=False):
            assert float(own) == pytest.approx(float(other), rel=1e-30)
        assert combined.sizes(above=1)[:2] == [0, 0]
        other = found.renamed({"a": "b", "b": "a"}).at({"a": point["b"], "b": point["a"]})
        assert other.enclosure.polynomial == wanted.polynomial


def test_what_depends_on_a_parameter_is_no_constant() -> None:
    a = Parametric.parameter(DOMAIN, "a")
    assert (a - a).constant.polynomial == 0
    with pytest.raises(ValueError, match="parameter that varies"):
        _ = a.constant


def test_parameters_that_become_one_are_added() -> None:
    a, b = (Parametric.parameter(DOMAIN, name) for name in "ab")
    assert (a + b + b).renamed({"a": "b"}).at({"b": fmpq(5)}).polynomial(0) == 15


def test_what_says_nothing_but_a_remainder_is_paid_for() -> None:
    """x - x for an x with a remainder: a polynomial that is zero, whose powers have more and more terms."""
    domain = Domain(RING, fmpq(1))
    rough = Parametric.free(Enclosure(domain, RING.constant(0), (fmpq(1, 10**8), fmpq(0), fmpq(0))))
    powers = sum((Parametric.parameter(domain, name) * rough for name in "abcdefgh"), Parametric(domain, {}))
    powers = powers * powers
    spent = domain.budget.left
    powers = powers * powers
    assert len(powers.terms) == comb(4 + 7, 7)
    assert spent - domain.budget.left >= 36**2
    left = domain.budget.left
    powers.at(dict.fromkeys("abcdefgh", fmpq(1)))
    assert left - domain.budget.left >= len(powers.terms)
    for grow in (lambda: powers * powers, lambda: powers + powers, lambda: -powers, lambda: powers.renamed({})):
        domain.budget.left = 10_000  # less than any of them takes
        with pytest.raises(TooLarge):
            grow()


def test_powers_of_a_parameter_end_somewhere() -> None:
    power = Parametric.parameter(DOMAIN, "a")
    for _ in range(5):
        power = power * power  # up to a^32
    assert power.at({"a": fmpq(2)}).polynomial(0) == 2**32
    with pytest.raises(TooLarge):
        _ = power * power


def test_numbers_that_grow_too_long_are_refused() -> None:
    a = Parametric.parameter(DOMAIN, "a")
    a.at({"a": fmpq(1, 3**12_000)})
    with pytest.raises(TooLarge):
        a.at({"a": fmpq(1, 3**13_000)})
    each = zip("abc", (3**5_000, 5**3_500, 7**3_000), strict=True)
    apart = [Parametric.parameter(DOMAIN, n) * Parametric.free(DOMAIN.constant(fmpq(1, long))) for n, long in each]
    point = dict.fromkeys("abc", fmpq(1))
    assert (apart[0] + apart[1]).at(point).polynomial(0) == fmpq(1, 3**5_000) + fmpq(1, 5**3_500)
    with pytest.raises(TooLarge):  # of the three together
        sum(apart, Parametric(DOMAIN, {})).at(point)
