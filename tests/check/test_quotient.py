"""Rates with divisions: quotients against exact values, and denominators that may be zero."""

import random

import pytest
from flint import arb, fmpq, fmpq_mpoly_ctx

from cfjax.certificate.fit import enclose, fit
from cfjax.check.enclosure import Domain, Enclosure, UnaryEnclosure, proven_bound
from cfjax.check.quotient import Quotient, applied


@pytest.fixture
def domain() -> Domain:
    return Domain(fmpq_mpoly_ctx.get(["y0", "y1"], "degrevlex"), fmpq(1))


def fitted(_: int, function: str, argument: Enclosure) -> UnaryEnclosure:
    return enclose(function, argument)


def one_over(node: int, argument: Quotient) -> Quotient:
    return applied(node, "inv", argument, fitted)


def points(count: int) -> list[tuple[fmpq, fmpq]]:
    rng = random.Random(7)
    return [(fmpq(rng.randint(-700, 700), 1000), fmpq(rng.randint(-700, 700), 1000)) for _ in range(count)]


def test_divisions_by_polynomials_are_exact(domain: Domain) -> None:
    """a/(2 + b) + b/(a − 3) − (a/(2 + b)) (b/(2 + b)), the second denominator below zero: nothing is lost."""
    a, b = (Quotient(domain.exact(y)) for y in domain.ring.gens())
    two, three = (Quotient(domain.constant(fmpq(k))) for k in (2, 3))
    first, second = one_over(0, two + b), one_over(1, a - three)
    found = a * first + b * second - (a * first) * (b * first)
    below = found.denominator
    assert not any((*found.numerator.remainder, *below.remainder))
    assert found.least_denominator == 2  # (2 − 1)² (3 − 1)
    for x, y in points(50):
        truth = x / (2 + y) + y / (x - 3) - x * y / (2 + y) ** 2
        assert found.numerator.polynomial(x, y) / below.polynomial(x, y) == truth
        assert below.polynomial(x, y) >= found.least_denominator


def test_what_divides_the_numerator_is_divided_out(domain: Domain) -> None:
    a, b = (Quotient(domain.exact(y)) for y in domain.ring.gens())
    below = Quotient(domain.constant(fmpq(2))) + b
    by = one_over(0, below)
    once = (a * below * by * by).reduced()
    assert [power.exponent for power in once.powers.values()] == [1]
    assert once.numerator.polynomial == a.numerator.polynomial
    whole = (a * by - b * by + (b - a) * by + a).reduced()
    assert (whole.powers, whole.numerator.polynomial) == ({}, a.numerator.polynomial)
    left = (a * by).reduced()
    assert (left.powers, left.numerator.polynomial) == ((a * by).powers, a.numerator.polynomial)


def test_quotients_within_functions_and_with_remainders_are_enclosed(domain: Domain) -> None:
    """sin(a/(2 + b)) / (1 + cos(a)) + 1/(1 + b/(3 + a)) − 1/√3."""
    a, b = (Quotient(domain.exact(y)) for y in domain.ring.gens())
    one, two, three = (Quotient(domain.constant(fmpq(k))) for k in (1, 2, 3))
    sine = applied(1, "sin", a * one_over(0, two + b), fitted)
    third = one_over(3, one + applied(2, "cos", a, fitted))
    root = applied(6, "sqrt", three, fitted)
    found = sine * third + one_over(5, one + b * one_over(4, three + a)) - one_over(7, root)
    assert set(found.powers) == {3, 5}  # what is a number is divided by at once
    above, below, least = found.numerator, found.denominator, found.least_denominator
    assert 0 < below.largest_remainder < fmpq(1, 10) and fmpq(1, 3) < least
    whole = found.enclosed()
    for x, y in points(100):
        s, t = arb(x), arb(y)
        divisor = (1 + s.cos()) * (1 + t / (3 + s))
        truth = (s / (2 + t)).sin() / (1 + s.cos()) + 1 / (1 + t / (3 + s)) - 1 / arb(3).sqrt()
        assert abs(divisor - arb(below.polynomial(x, y))) <= arb(below.largest_remainder)
        assert divisor >= arb(least)
        assert abs(truth * divisor - arb(above.polynomial(x, y))) <= arb(above.largest_remainder)
        assert abs(truth - arb(whole.polynomial(x, y))) <= arb(whole.largest_remainder)


def test_a_function_of_a_number_is_one_whatever_the_hint_is(domain: Domain) -> None:
    poor = UnaryEnclosure("sqrt", (fmpq(1),), fmpq(1), fmpq(4), fmpq(2))
    found = domain.constant(fmpq(2)).apply(poor)
    assert found.polynomial.is_constant() and 0 < found.largest_remainder < fmpq(1, 2**100)
    middle, spread = fmpq(found.polynomial.coeffs()[0]), found.largest_remainder
    assert (middle - spread) ** 2 <= 2 <= (middle + spread) ** 2
    nearly = Enclosure(domain, domain.ring.constant(2), (fmpq(1, 1000), fmpq(0), fmpq(1, 1000)))
    wider = nearly.apply(poor)
    middle, spread = fmpq(wider.polynomial.coeffs()[0]), wider.largest_remainder
    assert spread < fmpq(1, 1000) and middle - spread > 1
    assert (middle - spread) ** 2 <= fmpq(1998, 1000) < fmpq(2002, 1000) <= (middle + spread) ** 2
    for number, remainder in ((0, 0), (1, 2), (-1, 0)):
        odd = Enclosure(domain, domain.ring.constant(number), (fmpq(remainder), fmpq(0), fmpq(0)))
        with pytest.raises(ValueError, match="not smooth"):
            odd.apply(poor)
    with pytest.raises(ValueError, match="pole"):
        domain.constant(fmpq(0)).apply(UnaryEnclosure("inv", (fmpq(1),), fmpq(1), fmpq(4), fmpq(2)))


@pytest.mark.parametrize("constant", [fmpq(0), fmpq(1, 2), fmpq(999, 1000), fmpq(1), fmpq(-1)])
def test_a_denominator_that_may_be_zero_is_refused(domain: Domain, constant: fmpq) -> None:
    """constant + a has a zero inside the ball, or on its edge: no hint hides it."""
    below = Quotient(domain.exact(domain.ring.gens()[0] + constant))
    with pytest.raises(ValueError, match="pole"):
        one_over(0, below)
    for low, high in ((fmpq(1, 100), fmpq(3)), (fmpq(-3), fmpq(-1, 100))):
        coefficients = fit("inv", low, high)
        hint = UnaryEnclosure("inv", coefficients, low, high, proven_bound("inv", coefficients, low, high))
        with pytest.raises(ValueError, match="the argument of inv reaches from"):
            applied(0, "inv", below, lambda *_, hint=hint: hint)
        # were the hint not asked about its range, the sign is
        forged = object.__new__(UnaryEnclosure)
        values = {"function": "inv", "coefficients": coefficients, "lower": fmpq(-9), "upper": fmpq(9), "bound": fmpq(9)}
        for name, value in values.items():
            object.__setattr__(forged, name, value)
        with pytest.raises(ValueError, match="divided by what may be zero"):
            applied(0, "inv", below, lambda *_, forged=forged: forged)


def test_a_remainder_that_reaches_zero_is_refused(domain: Domain) -> None:
    """The polynomial stays above 1/10, what it stands for may not."""
    close = Enclosure(domain, domain.ring.gens()[0] + fmpq(11, 10), (fmpq(0), fmpq(1, 10), fmpq(0)))
    with pytest.raises(ValueError, match="pole"):
        one_over(0, Quotient(close))
    assert one_over(0, Quotient(Enclosure(domain, close.polynomial, (fmpq(1, 20), fmpq(0), fmpq(0))))).powers
