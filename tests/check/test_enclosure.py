"""Remainders are held against 200-bit balls at random rational points and at the ends of the range."""

import random

import pytest
from flint import arb, ctx, fmpq, fmpq_mpoly_ctx, fmpq_poly

from cfcheck.exact.enclosure import Budget, Domain, Enclosure, UnaryEnclosure, proven_bound, proven_slope
from cfjax.certificate.fit import enclose, fit


RANGES = {
    "sin": [(-1, 1), (-3, 3), (fmpq(1, 3), 2), (-7, -5)],
    "cos": [(-1, 1), (-3, 3), (fmpq(1, 3), 2), (-7, -5)],
    "tan": [(-1, 1), (fmpq(-3, 2), fmpq(3, 2)), (2, 4)],
    "sqrt": [(fmpq(1, 2), 3), (fmpq(1, 50), fmpq(1, 10)), (2, 5)],
    "inv": [(fmpq(1, 2), 3), (-5, -1), (fmpq(1, 5), 1)],
}
CASES = [(function, fmpq(low), fmpq(high)) for function, ranges in RANGES.items() for low, high in ranges]


def value(function: str, t: fmpq) -> arb:
    named = {"sin": arb.sin, "cos": arb.cos, "tan": arb.tan, "sqrt": arb.sqrt, "inv": lambda ball: 1 / ball}
    return named[function](arb(t))


@pytest.fixture
def two_hundred_bits() -> object:
    before, ctx.prec = ctx.prec, 200
    yield
    ctx.prec = before


@pytest.mark.parametrize(("function", "low", "high"), CASES)
def test_remainders_hold_at_random_points_and_ends(
    function: str, low: fmpq, high: fmpq, two_hundred_bits: None
) -> None:
    coefficients = fit(function, low, high)
    bound = proven_bound(function, coefficients, low, high)
    slope = proven_slope(function, low, high)
    polynomial = fmpq_poly(list(coefficients))
    rng = random.Random(f"{function}{low}")
    points = [low, high, *(low + (high - low) * fmpq(rng.randint(0, 10**12), 10**12) for _ in range(400))]
    worst = fmpq(0)
    for t in points:
        error = abs(value(function, t) - arb(polynomial(t)))
        assert error <= arb(bound)
        worst = max(worst, fmpq(int(float(error) * 10**12), 10**12))
        step = (high - low) / 1000
        if t + step <= high:
            assert abs(value(function, t + step) - value(function, t)) <= arb(slope * step)
    assert float(bound) <= 1.1 * float(worst) + 1e-9, "the bound is far from sharp"


@pytest.mark.parametrize(
    ("function", "low", "high"),
    [("tan", 1, 2), ("tan", -2, 2), ("tan", fmpq(3, 2), fmpq(8, 5)), ("inv", -1, 1), ("inv", 0, 1), ("inv", -1, 0)],
)
def test_poles_are_refused(function: str, low: int, high: int) -> None:
    with pytest.raises(ValueError, match="pole"):
        proven_bound(function, (fmpq(0), fmpq(1)), fmpq(low), fmpq(high))


@pytest.mark.parametrize("low", [fmpq(-1), fmpq(-1, 10**9), fmpq(0)])
def test_the_end_of_the_square_root_is_refused(low: fmpq) -> None:
    with pytest.raises(ValueError, match="not smooth"):
        proven_bound("sqrt", (fmpq(0), fmpq(1)), low, fmpq(1))
    with pytest.raises(ValueError, match="may not be positive"):
        fit("sqrt", low, fmpq(1))


def test_an_enclosure_that_claims_too_much_does_not_exist() -> None:
    low, high = fmpq(-1), fmpq(1)
    coefficients = fit("sin", low, high)
    bound = proven_bound("sin", coefficients, low, high)
    UnaryEnclosure("sin", coefficients, low, high, bound)
    for claim in ((coefficients, low, high, bound * fmpq(999, 1000)), (coefficients, low, 2 * high, bound)):
        with pytest.raises(ValueError, match="remainder"):
            UnaryEnclosure("sin", *claim)
    with pytest.raises(ValueError, match="lower end first"):
        UnaryEnclosure("sin", coefficients, high, low, bound)


@pytest.fixture
def domain() -> Domain:
    return Domain(fmpq_mpoly_ctx.get(["y0", "y1", "y2"], "degrevlex"), fmpq(5, 4))


def points(domain: Domain, count: int) -> list[list[fmpq]]:
    """Random rational points of the ball, some of them next to its boundary."""
    rng = random.Random(5)
    found = []
    while len(found) < count:
        y = [fmpq(rng.randint(-1000, 1000), 890) for _ in range(3)]
        squares = sum((yk * yk for yk in y), fmpq(0))
        if squares > domain.radius_squared:
            y = [yk * fmpq(9, 10) / max(1, round(float(squares) ** 0.5 + 0.5)) for yk in y]
        found.append(y)
    return found


def test_polynomial_bounds_hold_on_the_ball(domain: Domain) -> None:
    rng = random.Random(3)
    for _ in range(30):
        polynomial = domain.ring.from_dict(
            {tuple(rng.randint(0, 3) for _ in range(3)): fmpq(rng.randint(-9, 9), 4) for _ in range(6)}
        )
        bound = domain.bound(polynomial)
        assert all(abs(polynomial(*y)) <= bound for y in points(domain, 60))


def test_arithmetic_encloses_the_composed_function(domain: Domain, two_hundred_bits: None) -> None:
    """sin(a) cos(b) − tan(c) / (3 + sin(a) b) with nested functions: the polynomial stays within the remainder."""
    a, b, c = (domain.exact(y * fmpq(3, 5)) for y in domain.ring.gens())

    def apply(function: str, argument: Enclosure) -> Enclosure:
        return argument.apply(enclose(function, argument))

    sine = apply("sin", a)
    result = sine * apply("cos", b) - apply("tan", c) * apply("inv", domain.constant(fmpq(3)) + sine * b)
    assert 0 < result.largest_remainder < fmpq(1, 4)
    size = domain.radius
    constant, square = result.remainder_bound(size)
    assert constant + square * size**2 <= result.largest_remainder * (1 + fmpq(1, 10**20))
    for y in points(domain, 200):
        at, bt, ct = (arb(yk * fmpq(3, 5)) for yk in y)
        truth = at.sin() * bt.cos() - ct.tan() / (3 + at.sin() * bt)
        error = abs(truth - arb(result.polynomial(*y)))
        assert error <= arb(result.largest_remainder)
        norm_squared = sum((yk * yk for yk in y), fmpq(0))
        for constant, square in map(result.remainder_bound, (fmpq(1, 10), fmpq(1), fmpq(3))):
            assert error <= arb(constant + square * norm_squared)


def test_a_range_that_is_exceeded_is_refused(domain: Domain) -> None:
    coefficients = fit("sin", fmpq(-1), fmpq(1))
    unary = UnaryEnclosure("sin", coefficients, fmpq(-1), fmpq(1), fmpq(1, 10))
    with pytest.raises(ValueError, match="reaches"):
        domain.exact(domain.ring.gens()[0]).apply(unary)  # the ball is larger than 1


def test_arithmetic_has_a_budget(domain: Domain) -> None:
    def squared(value: Enclosure) -> Enclosure:
        for _ in range(40):
            value = value * value
        return value

    def bounded(poor: Domain) -> None:
        for _ in range(40):
            poor.bound(poor.ring.gens()[0])

    with pytest.raises(ValueError, match="grows beyond"):
        squared(domain.exact(sum(domain.ring.gens()) + 1))
    with pytest.raises(ValueError, match="grows beyond"):
        squared(domain.constant(fmpq(7, 3)))
    with pytest.raises(ValueError, match="more arithmetic"):
        bounded(Domain(domain.ring, domain.radius_squared, Budget(100)))
