"""Polynomials with a proven remainder: the arithmetic that replaces sin, cos and other functions by polynomials.

An `Enclosure` of f on the ball {|y| ≤ r} is a polynomial p(y) and rationals ε₀, ε₁, ε₂ ≥ 0 with

    |f(y) − p(y)| ≤ ε₀ + ε₁ |y| + ε₂ |y|²      on the ball.

Errors that vanish at the centre go into ε₁ and ε₂, and cost little if the funnel is narrow. Sums and products propagate
the ε. A function of one variable is replaced by a polynomial on a range of its argument (`UnaryEnclosure`);
arb balls prove the bound of the error there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

from flint import arb, arb_series, fmpq, fmpq_mpoly, fmpq_mpoly_ctx, fmpq_poly, fmpz

from cfcheck.exact.rational import bits, decimal_text, sqrt_upper, upper_bound


SUBINTERVALS = 256  # of the range on which a remainder is bounded; 256 bounds it to about one part in a hundred
SERIES_ORDER = 8  # Taylor terms on each: the last one is evaluated on the whole subinterval
LARGEST_EFFORT = 32_000_000  # products of coefficients; a circle's proof takes about a million, with six states twenty
LARGEST_DEGREE = 40
LONGEST_COEFFICIENT = 20_000  # bits
MOST_TERMS = 20_000  # of a polynomial; the circle's have less than a thousand
LONGEST_UNARY_NUMBER = 256  # bits of the numbers in a `UnaryEnclosure`, which is proven on every subinterval
SMALLEST_REMAINDER = fmpq(1, 2**4096)  # smaller ones are replaced by it, so that none grows longer and longer
LARGEST_REMAINDER = fmpq(2**LONGEST_COEFFICIENT)

Remainder = tuple[fmpq, fmpq, fmpq]  # ε₀, ε₁, ε₂
NO_REMAINDER: Remainder = (fmpq(0), fmpq(0), fmpq(0))

TOO_LARGE = "a polynomial of the proof grows beyond what the checker takes"


class TooLarge(ValueError):
    """A proof that is larger than the checker takes, whatever its numbers are."""


@dataclass(frozen=True)
class UnaryEnclosure:
    """|f(t) − Σ coefficients_k t^k| ≤ bound for lower ≤ t ≤ upper; f is one of `UNARY_FUNCTIONS`.

    Raises:
        ValueError: arb does not confirm the bound. So every object of this class is a proven statement.
    """

    function: str
    coefficients: tuple[fmpq, ...]
    lower: fmpq
    upper: fmpq
    bound: fmpq

    def __post_init__(self) -> None:
        if max(map(bits, (*self.coefficients, self.lower, self.upper, self.bound))) > LONGEST_UNARY_NUMBER:
            raise ValueError(f"the enclosure of {self.function} has a number of more than {LONGEST_UNARY_NUMBER} bits")
        if proven_bound(self.function, self.coefficients, self.lower, self.upper) > self.bound:
            raise ValueError(f"the remainder of {self.function} is larger than its enclosure claims")


@lru_cache(maxsize=256)  # the certifier asks for a bound, and once more for the object that states it
def proven_bound(function: str, coefficients: tuple[fmpq, ...], lower: fmpq, upper: fmpq) -> fmpq:
    """A rational that is at least max |f(t) − Σ coefficients_k t^k| over lower ≤ t ≤ upper.

    On each subinterval by a Taylor series about its middle; the last coefficient is a ball over the whole subinterval.

    Raises:
        ValueError: f has a pole in the range, or the range reaches 0 for the square root.
    """
    polynomial = fmpq_poly(list(coefficients))
    half = (upper - lower) / (2 * SUBINTERVALS)
    worst = arb(0)
    for middle, over_interval in _subintervals(function, lower, upper):
        shifted = polynomial(fmpq_poly([middle, 1]))
        taylor = [*_taylor(function, arb(middle))[:-1], over_interval[-1]]
        taylor += [arb(0)] * (shifted.degree() + 1 - SERIES_ORDER)
        terms = (abs(ball - arb(shifted[k])) * arb(half) ** k for k, ball in enumerate(taylor))
        worst = worst.max(sum(terms, arb(0)))
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
        value = {"sin": series.sin, "cos": series.cos, "tan": series.tan, "sqrt": series.sqrt}[function]()
        result = [value[order] for order in range(SERIES_ORDER)]
    if not all(term.is_finite() for term in result):
        what = "is not smooth" if function == "sqrt" else "has a pole"
        raise ValueError(f"{function} {what} in the range of its argument, or too close to it")
    return result


class Budget:
    """How much polynomial arithmetic a file may cause, so that no file makes the checker hang.

    It counts products of coefficients, long ones more, so that the answer is the same on every machine.
    """

    def __init__(self, limit: int = LARGEST_EFFORT) -> None:
        self.left = limit

    def spend(self, effort: int) -> None:
        """Raises ValueError when the budget is spent."""
        self.left -= effort
        if self.left < 0:
            raise TooLarge("the proof asks for more arithmetic than the checker takes")


@dataclass(frozen=True)
class Domain:
    """The ball {|y|² ≤ radius_squared} in the variables of a polynomial ring over the rationals."""

    ring: fmpq_mpoly_ctx
    radius_squared: fmpq
    budget: Budget = field(default_factory=Budget, compare=False, repr=False)

    def constant(self, value: fmpq) -> "Enclosure":
        return Enclosure(self, self.ring.constant(value))

    def exact(self, polynomial: fmpq_mpoly) -> "Enclosure":
        return Enclosure(self, polynomial)

    def product(self, first: fmpq_mpoly, second: fmpq_mpoly) -> fmpq_mpoly:
        """first · second, paid for out of the budget.

        Raises:
            TooLarge: the product is larger than any proof needs.
        """
        if not len(first) or not len(second):
            return self.ring.constant(0)
        length = self._length(first) + self._length(second)
        if first.total_degree() + second.total_degree() > LARGEST_DEGREE or length > LONGEST_COEFFICIENT:
            raise TooLarge(TOO_LARGE)
        self.budget.spend(len(first) * len(second) * (1 + length // 512))
        result = first * second
        if len(result) > MOST_TERMS:
            raise TooLarge(TOO_LARGE)
        return result

    def sum(self, first: fmpq_mpoly, second: fmpq_mpoly) -> fmpq_mpoly:
        """first + second, paid for out of the budget."""
        length = self._length(first) + self._length(second)  # of coefficients without a common denominator
        if len(first) + len(second) > MOST_TERMS or length > LONGEST_COEFFICIENT:
            raise TooLarge(TOO_LARGE)
        self.budget.spend((len(first) + len(second)) * (1 + length // 512))
        return first + second

    def negative(self, polynomial: fmpq_mpoly) -> fmpq_mpoly:
        """−polynomial, paid for out of the budget."""
        self.budget.spend(len(polynomial) * (1 + self._length(polynomial) // 512))
        return -polynomial

    def divided(self, polynomial: fmpq_mpoly, divisor: fmpq_mpoly) -> fmpq_mpoly | None:
        """polynomial / divisor, paid for as a product; None if the division leaves a rest."""
        whole, rest = self._divmod(polynomial, divisor)
        return None if rest else whole

    def rest(self, polynomial: fmpq_mpoly, divisor: fmpq_mpoly) -> fmpq_mpoly:
        """The rest of the division, paid for as a product: it equals the polynomial wherever the divisor is zero."""
        return self._divmod(polynomial, divisor)[1]

    def _divmod(self, polynomial: fmpq_mpoly, divisor: fmpq_mpoly) -> tuple[fmpq_mpoly, fmpq_mpoly]:
        length = self._length(polynomial) + self._length(divisor)
        self.budget.spend(len(polynomial) * len(divisor) * (1 + length // 512))
        return divmod(polynomial, divisor)

    def _length(self, polynomial: fmpq_mpoly) -> int:
        """Bits of the longest coefficient: a look at each of them."""
        self.budget.spend(4 * len(polynomial))
        return max(map(fmpq.height_bits, polynomial.coeffs()), default=0)

    def sizes(self, polynomial: fmpq_mpoly) -> list[fmpq]:
        """Rationals c_d with |polynomial(y)| ≤ Σ c_d |y|^d: Cauchy–Schwarz on each homogeneous part.

        Computed in balls: the coefficients may be long, the bounds are short.
        """
        self.budget.spend(16 * len(polynomial))
        squares: dict[int, arb] = {}
        zero = arb(0)
        for monomial, coefficient in zip(polynomial.monoms(), polynomial.coeffs(), strict=True):
            degree, multinomial = multinomial_of(monomial)
            ball = arb(coefficient)
            squares[degree] = squares.get(degree, zero) + ball * ball / multinomial
        return [upper_bound(squares.get(degree, zero).sqrt()) for degree in range(max(squares, default=0) + 1)]

    def bound(self, polynomial: fmpq_mpoly) -> fmpq:
        """A rational that is at least max |polynomial| over the ball."""
        return sum((size * self.radius**degree for degree, size in enumerate(self.sizes(polynomial))), fmpq(0))

    @cached_property
    def radius(self) -> fmpq:
        """A rational that is at least r."""
        return sqrt_upper(self.radius_squared)

    def remainder_product(self, first: Sequence[fmpq], second: Sequence[fmpq]) -> Remainder:
        """A bound of (Σ a_k |y|^k)(Σ b_k |y|^k) for a_k, b_k ≥ 0, by |y|^k ≤ r^{k−2} |y|² for k > 2.

        Raises:
            TooLarge: the remainder is so large that it says nothing.
        """
        result = [fmpq(0), fmpq(0), fmpq(0)]
        for i, a in enumerate(first):
            for j, b in enumerate(second):
                if a and b:
                    result[min(i + j, 2)] += a * b * self.radius ** max(i + j - 2, 0)
        zeroth, linear, square = map(_short_remainder, result)
        return zeroth, linear, square


def remainder_sum(first: Remainder, second: Remainder) -> Remainder:
    """The bound of a sum of two functions with these bounds."""
    return first[0] + second[0], first[1] + second[1], first[2] + second[2]


def _short_remainder(value: fmpq) -> fmpq:
    """Rounded up to arb's precision, or remainders would grow longer with every operation."""
    if value > LARGEST_REMAINDER:
        raise TooLarge(TOO_LARGE)
    return upper_bound(arb(max(value, SMALLEST_REMAINDER))) if value else value


@lru_cache(maxsize=2**14)
def multinomial_of(monomial: tuple[fmpz, ...]) -> tuple[int, int]:
    """Degree d and multinomial: (Σ c_m y^m)² ≤ (Σ c_m²/multinomial_m) |y|^{2d} for homogeneous polynomials."""
    multinomial, placed = 1, 0
    for exponent in map(int, monomial):
        for k in range(1, exponent + 1):
            placed += 1
            multinomial = multinomial * placed // k
    return placed, multinomial


@dataclass(frozen=True)
class Enclosure:
    """|f − polynomial| ≤ ε₀ + ε₁ |y| + ε₂ |y|² on the domain, (ε₀, ε₁, ε₂) the remainder."""

    domain: Domain
    polynomial: fmpq_mpoly
    remainder: Remainder = NO_REMAINDER

    def __add__(self, other: "Enclosure") -> "Enclosure":
        total = self.domain.sum(self.polynomial, other.polynomial)
        return Enclosure(self.domain, total, remainder_sum(self.remainder, other.remainder))

    def __sub__(self, other: "Enclosure") -> "Enclosure":
        return self + -other

    def __neg__(self) -> "Enclosure":
        return Enclosure(self.domain, self.domain.negative(self.polynomial), self.remainder)

    def __mul__(self, other: "Enclosure") -> "Enclosure":
        remainder = self.domain.remainder_product(self.remainder, other.remainder)
        for one, two in ((self, other), (other, self)):
            if any(two.remainder):
                remainder = remainder_sum(remainder, self.domain.remainder_product(one.sizes, two.remainder))
        return Enclosure(self.domain, self.domain.product(self.polynomial, other.polynomial), remainder)

    def cut(self, degree: int) -> "Enclosure":
        """The same function by a polynomial of at most this degree; the other terms go into the remainder."""
        kept = cut(self.polynomial, degree)
        if kept == self.polynomial:
            return self
        left_out = self.domain.sizes(self.domain.sum(self.polynomial, self.domain.negative(kept)))
        beside = self.domain.remainder_product(left_out, (fmpq(1),))
        return Enclosure(self.domain, kept, remainder_sum(self.remainder, beside))

    @cached_property
    def sizes(self) -> list[fmpq]:
        """`Domain.sizes` of the polynomial."""
        return self.domain.sizes(self.polynomial)

    @property
    def largest_remainder(self) -> fmpq:
        """A rational that is at least max |f − polynomial| over the domain."""
        return sum((size * self.domain.radius**k for k, size in enumerate(self.remainder)), fmpq(0))

    def remainder_bound(self, radius: fmpq) -> tuple[fmpq, fmpq]:
        """e, e' with e + e' |y|² nowhere below the remainder: |y| ≤ (|y|²/h + h)/2, closest at |y| = h = `radius`."""
        constant, linear, square = self.remainder
        return constant + linear * radius / 2, square + linear / (2 * radius)

    def range(self) -> tuple[fmpq, fmpq]:
        """Rationals between which f and the polynomial stay on the domain."""
        centre = fmpq(self.polynomial[(0,) * self.domain.ring.nvars()])
        reach = self.domain.bound(self.polynomial - centre) + self.largest_remainder
        return centre - reach, centre + reach

    def range_within(self, unary: UnaryEnclosure) -> tuple[fmpq, fmpq]:
        """The range, if the enclosure of a function covers it.

        Raises:
            ValueError: it does not.
        """
        lower, upper = self.range()
        if not unary.lower <= lower <= upper <= unary.upper:
            raise ValueError(
                f"the argument of {unary.function} reaches from {decimal_text(lower)} to {decimal_text(upper)}, "
                f"its enclosure only from {decimal_text(unary.lower)} to {decimal_text(unary.upper)}"
            )
        return lower, upper

    def _number(self, function: str) -> "Enclosure":
        """The function of this enclosure if its polynomial is constant: arb evaluates it on a ball."""
        value, spread = fmpq(self.polynomial[(0,) * self.domain.ring.nvars()]), self.largest_remainder
        if function == "inv" and value and not spread:  # 1/rational is rational
            return self.domain.constant(1 / value)
        ball = _taylor(function, arb(arb(value), arb(spread)))[0]
        middle = upper_bound(ball.mid())
        remainder = upper_bound(abs(ball - arb(middle))), fmpq(0), fmpq(0)
        return Enclosure(self.domain, self.domain.ring.constant(middle), remainder)

    def apply(self, unary: UnaryEnclosure) -> "Enclosure":
        """The function of this enclosure.

        Raises:
            ValueError: this enclosure reaches beyond the range of the unary one.
        """
        if self.polynomial.is_constant():
            return self._number(unary.function)
        self.range_within(unary)
        result = self.domain.ring.constant(0)
        for coefficient in reversed(unary.coefficients):
            result = self.domain.product(result, self.polynomial) + coefficient
        remainder: Remainder = (unary.bound, fmpq(0), fmpq(0))
        if any(self.remainder):  # mean value theorem between p and f
            slope = proven_slope(unary.function, unary.lower, unary.upper)
            remainder = remainder_sum(remainder, self.domain.remainder_product((slope,), self.remainder))
        return Enclosure(self.domain, result, remainder)


def cut(polynomial: fmpq_mpoly, degree: int) -> fmpq_mpoly:
    """The terms up to the degree."""
    if polynomial.total_degree() <= degree:
        return polynomial
    terms = polynomial.to_dict().items()
    return polynomial.context().from_dict({e: c for e, c in terms if sum(map(int, e)) <= degree})
