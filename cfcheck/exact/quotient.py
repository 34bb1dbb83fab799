"""Quotients of enclosures: the arithmetic in which rates with divisions stay polynomials.

If a rate divides by D, and D > 0 on the whole domain, V̇ ≤ −λ is the same as D V̇ ≤ −λ D. So no polynomial has to
approximate 1/D: a `Quotient` keeps numerator and denominator, sums have a common denominator, and the proof is about
the numerator. D > 0 is proven before anything is divided by D.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import prod
from typing import NamedTuple

from flint import fmpq

from cfcheck.exact.enclosure import LARGEST_DEGREE, TOO_LARGE, Domain, Enclosure, TooLarge, UnaryEnclosure


FACTOR_EFFORT = 64  # of a factor, whatever it is multiplied with


@dataclass(frozen=True)
class Divisor:
    """A function that is at least `least` > 0 on the domain; it is `given`, or −`given` where that is negative.

    `inverse` encloses 1/`given`.
    """

    given: Enclosure
    is_negative: bool
    least: fmpq
    inverse: UnaryEnclosure

    @cached_property
    def value(self) -> Enclosure:
        return -self.given if self.is_negative else self.given

    @cached_property
    def one_over(self) -> Enclosure:
        """1/value as a polynomial with remainder."""
        found = self.given.apply(self.inverse)
        return -found if self.is_negative else found


class Power(NamedTuple):
    """A divisor to a power of at least one."""

    divisor: Divisor
    exponent: int


@dataclass(frozen=True)
class Quotient:
    """numerator / Π divisor^exponent. Divisors go by the node of the graph that divides by them.

    So quotients are of one evaluation of a graph: in another one a node may divide by something else.
    """

    numerator: Enclosure
    powers: Mapping[int, Power] = field(default_factory=dict)

    @property
    def _domain(self) -> Domain:
        return self.numerator.domain

    def __add__(self, other: "Quotient") -> "Quotient":
        common = self._common(other)
        return Quotient(self._over(common) + other._over(common), common)

    def __sub__(self, other: "Quotient") -> "Quotient":
        return self + -other

    def __neg__(self) -> "Quotient":
        return Quotient(-self.numerator, self.powers)

    def __mul__(self, other: "Quotient") -> "Quotient":
        powers = dict(self.powers)
        for node, power in other.powers.items():
            exponent = power.exponent + (powers[node].exponent if node in powers else 0)
            if exponent > LARGEST_DEGREE:  # with numerator 0 nothing else would stop it
                raise TooLarge(TOO_LARGE)
            powers[node] = Power(power.divisor, exponent)
        return Quotient(self.numerator * other.numerator, powers)

    def _common(self, other: "Quotient") -> dict[int, Power]:
        """The least powers that hold those of both."""
        common = dict(self.powers)
        for node, power in other.powers.items():
            if node not in common or common[node].exponent < power.exponent:
                common[node] = power
        return common

    def _over(self, powers: Mapping[int, Power]) -> Enclosure:
        """The numerator over these, which hold its own."""
        found = self.numerator
        for node, (divisor, exponent) in powers.items():
            own = self.powers[node].exponent if node in self.powers else 0
            for _ in range(exponent - own):
                found.domain.budget.spend(FACTOR_EFFORT)  # products with 0 take time too
                found = found * divisor.value
        return found

    @property
    def denominator(self) -> Enclosure:
        """Π divisor^exponent, above zero."""
        return Quotient(self._domain.constant(fmpq(1)))._over(self.powers)

    @property
    def least_denominator(self) -> fmpq:
        """A rational above zero that is at most the denominator everywhere."""
        return prod((divisor.least**exponent for divisor, exponent in self.powers.values()), start=fmpq(1))

    def enclosed(self) -> Enclosure:
        """The same as a polynomial with remainder."""
        found = self.numerator
        for divisor, exponent in self.powers.values():
            for _ in range(exponent):
                found = found * divisor.one_over
        return found

    def reduced(self) -> "Quotient":
        """Without divisors whose polynomials divide the numerator's.

        Remainders are left out, so the result encloses nothing; it only defines where cells are cut.
        """
        polynomial, powers = self.numerator.polynomial, dict(self.powers)
        for node, (divisor, exponent) in self.powers.items():
            left = exponent
            while left and (whole := self._domain.divided(polynomial, divisor.value.polynomial)) is not None:
                polynomial, left = whole, left - 1
            powers[node] = Power(divisor, left)
        return Quotient(
            self._domain.exact(polynomial), {node: power for node, power in powers.items() if power.exponent}
        )


UnaryOf = Callable[[int, str, Enclosure], UnaryEnclosure]  # of a node that applies a named function to an argument


def applied(node: int, function: str, argument: Quotient, unary_of: UnaryOf) -> Quotient:
    """A function of a quotient, by the node's enclosure; 1/D with a D that is not constant stays a division.

    Raises:
        ValueError: the argument leaves the range of the node's enclosure, or a divisor may be zero.
    """
    given = argument.enclosed()
    unary = unary_of(node, function, given)
    if function != "inv" or given.polynomial.is_constant():
        return Quotient(given.apply(unary))
    lower, upper = given.range_within(unary)
    if not (lower > 0 or upper < 0):
        raise ValueError("a rate is divided by what may be zero in the funnel")
    divisor = Divisor(given, upper < 0, lower if lower > 0 else -upper, unary)
    one = given.domain.constant(fmpq(-1 if divisor.is_negative else 1))
    return Quotient(one, {node: Power(divisor, 1)})
