"""Polynomials with a remainder: the arithmetic in which sin and cos become polynomials without an error unpaid.

An `Enclosure` of f on the ball {|y|² ≤ r²} is a polynomial p(y) and a rational ε with |f(y) − p(y)| ≤ ε there. Sums and
products carry ε along with proven bounds on the polynomials; a function of one variable is replaced by a polynomial on
a proven range of its argument (`UnaryEnclosure`), whose bound `proven_bound` establishes with arb balls.
"""

from dataclasses import dataclass

from flint import arb, arb_series, fmpq, fmpq_mpoly, fmpq_mpoly_ctx, fmpq_poly

from cfjax.check.rational import sqrt_upper, upper_bound


SUBINTERVALS = 256  # of the range on which a remainder is bounded; 256 bounds it to about one part in a hundred
SERIES_ORDER = 8  # Taylor terms on each: the last one is evaluated on the whole subinterval


@dataclass(frozen=True)
class UnaryEnclosure:
    """|f(t) − Σ coefficients_k t^k| ≤ bound for |t| ≤ radius, f = sin or cos."""

    function: str
    coefficients: tuple[fmpq, ...]
    radius: fmpq
    bound: fmpq

    def is_proven(self) -> bool:
        """Whether arb confirms the bound."""
        return self.radius > 0 and proven_bound(self.function, self.coefficients, self.radius) <= self.bound


def proven_bound(function: str, coefficients: tuple[fmpq, ...], radius: fmpq) -> fmpq:
    """A rational that is at least max |f(t) − Σ coefficients_k t^k| over |t| ≤ radius.

    Taylor series on subintervals, Lagrange's remainder with the last coefficient taken over the whole subinterval.
    """
    half = radius / SUBINTERVALS
    polynomial = fmpq_poly(list(coefficients))
    worst = arb(0)
    for k in range(SUBINTERVALS):
        middle = -radius + half * (2 * k + 1)
        at_middle = _taylor(function, arb(middle))
        over_interval = _taylor(function, arb(arb(middle), arb(half)))
        shifted = polynomial(fmpq_poly([middle, 1]))
        total = arb(0)
        for order in range(max(SERIES_ORDER, shifted.degree() + 1)):
            taylor = at_middle[order] if order < SERIES_ORDER - 1 else over_interval[order]
            if order >= SERIES_ORDER:
                taylor = arb(0)
            total += abs(taylor - arb(shifted[order])) * arb(half) ** order
        worst = worst.max(total)
    return upper_bound(worst)


def _taylor(function: str, at: arb) -> list[arb]:
    series = arb_series([at, 1], prec=SERIES_ORDER)
    result = series.sin() if function == "sin" else series.cos()
    return [result[order] for order in range(SERIES_ORDER)]


@dataclass(frozen=True)
class Domain:
    """The ball {|y|² ≤ radius_squared} in the variables of a polynomial ring over the rationals."""

    ring: fmpq_mpoly_ctx
    radius_squared: fmpq

    def constant(self, value: fmpq) -> "Enclosure":
        return Enclosure(self, self.ring.constant(value), fmpq(0))

    def exact(self, polynomial: fmpq_mpoly) -> "Enclosure":
        return Enclosure(self, polynomial, fmpq(0))

    def bound(self, polynomial: fmpq_mpoly) -> fmpq:
        """A rational that is at least max |polynomial| over the ball: Cauchy–Schwarz on each homogeneous part."""
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
        return Enclosure(self.domain, self.polynomial * other.polynomial, remainder)

    def magnitude(self) -> fmpq:
        """A rational that is at least max |f| over the domain."""
        return self.domain.bound(self.polynomial) + self.remainder

    def apply(self, unary: UnaryEnclosure) -> "Enclosure":
        """The function of this enclosure; the caller has the unary enclosure proven.

        Raises:
            ValueError: where this enclosure reaches beyond the range on which the unary one holds.
        """
        if self.magnitude() > unary.radius:
            raise ValueError(
                f"the argument of {unary.function} reaches {float(self.magnitude()):.6g}, "
                f"its enclosure only {float(unary.radius):.6g}"
            )
        # sin and cos change by at most the change of their argument, so the argument's own remainder adds once
        result, power = self.domain.ring.constant(0), self.domain.ring.constant(1)
        for coefficient in unary.coefficients:
            result += coefficient * power
            power *= self.polynomial
        return Enclosure(self.domain, result, unary.bound + self.remainder)
