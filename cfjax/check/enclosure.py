"""Polynomials with a remainder: the arithmetic in which sin and cos become polynomials without an error unpaid.

An `Enclosure` of f on the ball {|y|² ≤ r²} is a polynomial p(y) and a rational ε with |f(y) − p(y)| ≤ ε there. Sums and
products carry ε along with proven bounds on the polynomials; a function of one variable is replaced by a polynomial on
a proven range of its argument (`UnaryEnclosure`), whose bound arb balls establish.
"""

from dataclasses import dataclass, field
from functools import lru_cache

from flint import arb, arb_series, fmpq, fmpq_mpoly, fmpq_mpoly_ctx, fmpq_poly

from cfjax.check.rational import bits, sqrt_upper, upper_bound


SUBINTERVALS = 256  # of the range on which a remainder is bounded; 256 bounds it to about one part in a hundred
SERIES_ORDER = 8  # Taylor terms on each: the last one is evaluated on the whole subinterval
LARGEST_EFFORT = 30_000_000  # products of coefficients; the circle's proof takes about a million
LARGEST_DEGREE = 40
LONGEST_COEFFICIENT = 20_000  # bits


@dataclass(frozen=True)
class UnaryEnclosure:
    """|f(t) − Σ coefficients_k t^k| ≤ bound for lower ≤ t ≤ upper, f one of `UNARY_FUNCTIONS`.

    Raises:
        ValueError: where arb does not confirm the bound; an object of this class is a proven statement.
    """

    function: str
    coefficients: tuple[fmpq, ...]
    lower: fmpq
    upper: fmpq
    bound: fmpq

    def __post_init__(self) -> None:
        if proven_bound(self.function, self.coefficients, self.lower, self.upper) > self.bound:
            raise ValueError(f"the remainder of {self.function} is larger than its enclosure claims")


@lru_cache(maxsize=256)  # the certifier asks for a bound, and once more for the object that states it
def proven_bound(function: str, coefficients: tuple[fmpq, ...], lower: fmpq, upper: fmpq) -> fmpq:
    """A rational that is at least max |f(t) − Σ coefficients_k t^k| over lower ≤ t ≤ upper.

    Taylor series on subintervals, Lagrange's remainder with the last coefficient taken over the whole subinterval.

    Raises:
        ValueError: where f has a pole in the range, or is not a function of `UNARY_FUNCTIONS`.
    """
    polynomial = fmpq_poly(list(coefficients))
    half = (upper - lower) / (2 * SUBINTERVALS)
    worst = arb(0)
    for middle, over_interval in _subintervals(function, lower, upper):
        at_middle = _taylor(function, arb(middle))
        shifted = polynomial(fmpq_poly([middle, 1]))
        total = arb(0)
        for order in range(max(SERIES_ORDER, shifted.degree() + 1)):
            taylor = at_middle[order] if order < SERIES_ORDER - 1 else over_interval[-1]
            if order >= SERIES_ORDER:
                taylor = arb(0)
            total += abs(taylor - arb(shifted[order])) * arb(half) ** order
        worst = worst.max(total)
    return upper_bound(worst)


@lru_cache(maxsize=256)
def proven_slope(function: str, lower: fmpq, upper: fmpq) -> fmpq:
    """A rational that is at least max |f'(t)| over lower ≤ t ≤ upper."""
    worst = arb(0)
    for _, over_interval in _subintervals(function, lower, upper):
        worst = worst.max(abs(over_interval[1]))
    return upper_bound(worst)


def _subintervals(function: str, lower: fmpq, upper: fmpq) -> list[tuple[fmpq, list[arb]]]:
    """Middles of equal subintervals, with the Taylor coefficients of f as balls over each of them."""
    if not lower < upper:
        raise ValueError(f"expected a range of {function} with its lower end first, got [{lower}, {upper}]")
    half = (upper - lower) / (2 * SUBINTERVALS)
    middles = [lower + half * (2 * k + 1) for k in range(SUBINTERVALS)]
    return [(middle, _taylor(function, arb(arb(middle), arb(half)))) for middle in middles]


def _taylor(function: str, at: arb) -> list[arb]:
    """Taylor coefficients 0 … SERIES_ORDER − 1 of f about every number in the ball."""
    if function == "inv":  # 1/t = Σ (−1)^k t₀^{−k−1} (t − t₀)^k; a ball that holds 0 comes out as not finite
        result = [(-1) ** k / at ** (k + 1) for k in range(SERIES_ORDER)]
    else:
        series = arb_series([at, 1], prec=SERIES_ORDER)
        value = {"sin": series.sin, "cos": series.cos, "tan": series.tan}[function]()
        result = [value[order] for order in range(SERIES_ORDER)]
    if not all(term.is_finite() for term in result):
        raise ValueError(f"{function} has a pole in the range of its argument, or too close to it")
    return result


class Budget:
    """How much polynomial arithmetic a proof may ask for: a file must not make the checker hang.

    Counted in products of coefficients, long ones counted more, so that the answer is the same on every machine.
    """

    def __init__(self, limit: int = LARGEST_EFFORT) -> None:
        self.left = limit

    def spend(self, effort: int) -> None:
        """Raises ValueError when the budget is spent."""
        self.left -= effort
        if self.left < 0:
            raise ValueError("the proof asks for more arithmetic than the checker takes")


@dataclass(frozen=True)
class Domain:
    """The ball {|y|² ≤ radius_squared} in the variables of a polynomial ring over the rationals."""

    ring: fmpq_mpoly_ctx
    radius_squared: fmpq
    budget: Budget = field(default_factory=Budget, compare=False, repr=False)

    def constant(self, value: fmpq) -> "Enclosure":
        return Enclosure(self, self.ring.constant(value), fmpq(0))

    def exact(self, polynomial: fmpq_mpoly) -> "Enclosure":
        return Enclosure(self, polynomial, fmpq(0))

    def product(self, first: fmpq_mpoly, second: fmpq_mpoly) -> fmpq_mpoly:
        """first · second, paid for out of the budget.

        Raises:
            ValueError: where the product would be larger than any proof needs.
        """
        if not len(first) or not len(second):
            return self.ring.constant(0)
        length = sum(max(map(bits, factor.coeffs())) for factor in (first, second))
        if first.total_degree() + second.total_degree() > LARGEST_DEGREE or length > LONGEST_COEFFICIENT:
            raise ValueError("a polynomial of the proof grows beyond what the checker takes")
        self.budget.spend(len(first) * len(second) * (1 + length // 512))
        return first * second

    def bound(self, polynomial: fmpq_mpoly) -> fmpq:
        """A rational that is at least max |polynomial| over the ball: Cauchy–Schwarz on each homogeneous part."""
        self.budget.spend(4 * len(polynomial))
        by_degree: dict[int, fmpq] = {}
        for monomial, coefficient in polynomial.to_dict().items():
            degree = sum(monomial)
            by_degree[degree] = by_degree.get(degree, fmpq(0)) + _cauchy_schwarz(coefficient, monomial)
        return sum(
            (sqrt_upper(squares * self.radius_squared**degree) for degree, squares in by_degree.items()), fmpq(0)
        )


def _cauchy_schwarz(coefficient: fmpq, monomial: tuple[int, ...]) -> fmpq:
    """coefficient² over the multinomial number: (Σ c_m y^m)² ≤ (Σ c_m²/multinomial_m) |y|^{2d} at degree d."""
    multinomial, placed = 1, 0
    for exponent in monomial:
        for k in range(1, int(exponent) + 1):
            placed += 1
            multinomial = multinomial * placed // k
    return coefficient * coefficient / multinomial


@dataclass(frozen=True)
class Enclosure:
    """|f − polynomial| ≤ remainder on the domain."""

    domain: Domain
    polynomial: fmpq_mpoly
    remainder: fmpq

    def __add__(self, other: "Enclosure") -> "Enclosure":
        return Enclosure(self.domain, self.polynomial + other.polynomial, self.remainder + other.remainder)

    def __sub__(self, other: "Enclosure") -> "Enclosure":
        return Enclosure(self.domain, self.polynomial - other.polynomial, self.remainder + other.remainder)

    def __neg__(self) -> "Enclosure":
        return Enclosure(self.domain, -self.polynomial, self.remainder)

    def __mul__(self, other: "Enclosure") -> "Enclosure":
        remainder = self.remainder * other.remainder
        if other.remainder:
            remainder += self.domain.bound(self.polynomial) * other.remainder
        if self.remainder:
            remainder += self.domain.bound(other.polynomial) * self.remainder
        # rounded up to arb's precision, or the number would grow longer with every operation
        remainder = upper_bound(arb(remainder)) if remainder else remainder
        return Enclosure(self.domain, self.domain.product(self.polynomial, other.polynomial), remainder)

    def range(self) -> tuple[fmpq, fmpq]:
        """Rationals between which f and the polynomial stay on the domain."""
        centre = fmpq(self.polynomial[(0,) * self.domain.ring.nvars()])
        reach = self.domain.bound(self.polynomial - centre) + self.remainder
        return centre - reach, centre + reach

    def apply(self, unary: UnaryEnclosure) -> "Enclosure":
        """The function of this enclosure.

        Raises:
            ValueError: where this enclosure reaches beyond the range on which the unary one holds.
        """
        lower, upper = self.range()
        if not unary.lower <= lower <= upper <= unary.upper:
            raise ValueError(
                f"the argument of {unary.function} reaches from {float(lower):.6g} to {float(upper):.6g}, "
                f"its enclosure only from {float(unary.lower):.6g} to {float(unary.upper):.6g}"
            )
        result = self.domain.ring.constant(0)
        for coefficient in reversed(unary.coefficients):
            result = self.domain.product(result, self.polynomial) + coefficient
        # between p and f lies at most the argument's remainder, along which the function changes by its slope
        spread = fmpq(0)
        if self.remainder:
            spread = proven_slope(unary.function, unary.lower, unary.upper) * self.remainder
        return Enclosure(self.domain, result, unary.bound + spread)
