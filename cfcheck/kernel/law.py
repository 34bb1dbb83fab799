"""A feedback law with saturation: u = clip(k, lower, upper), where its cells lie and what it is on each of them.

k is a quotient N/D with D > 0, known as polynomials with remainders: |N − p_N| ≤ ε_N, |D − p_D| ≤ ε_D, D ≥ d. At each
end of the limits the boundary is s = p_N − end p_D, cut at some degree; the terms cut off are at most c. Then

    |(N − end D) − s| ≤ ε = ε_N + |end| ε_D + c,

and, whatever the s are, the three cells cover everything:

    low     s_lower ≤ 0                    k − lower ≤ ε/D, so u is lower, or above it by at most ε/d
    inside  s_lower ≥ 0 and s_upper ≤ 0    |u D − p_N| ≤ max(ε_N, c + |end| ε_D) of both ends
    high    s_upper ≥ 0                    u is upper, or below it by at most ε/d

For the cell inside: where k lies within its limits, u D = N, which is p_N but for ε_N. Where k > upper, u D = upper D.
This is below N ≤ p_N + ε_N, and at least p_N − c − |upper| ε_D, for s_upper ≤ 0 there. Below lower it is likewise.
So near a boundary the statements of both cells hold, and nowhere is the sign of a polynomial taken for that of k.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from flint import fmpq, fmpq_mpoly

from cfcheck.exact.enclosure import Enclosure, Remainder, remainder_sum
from cfcheck.exact.graph import Graph
from cfcheck.exact.quotient import Quotient


LOW, INSIDE, HIGH = -1, 0, 1  # the sign of a cell: where the law lies with respect to the limits
REGIMES = LOW, INSIDE, HIGH
DEGREES = 3, 4  # of the polynomials that approximate a law; terms above are a remainder
READABLE = ("turn_rate", "speed", "speed_slope")  # of the reference: a law may depend on these and on the states


@dataclass(frozen=True)
class LawClaim:
    """The inputs beside u0 before they are limited: outputs of a graph over states and reference."""

    name: str
    graph: Graph


@dataclass(frozen=True)
class Limited:
    """One input of a law on a domain; boundaries are cut at `degree`, or not cut if it is None."""

    own: Quotient  # k
    lower: fmpq
    upper: fmpq
    degree: int | None = None

    @cached_property
    def denominator(self) -> Enclosure:
        """D."""
        return self.own.denominator

    def whole(self, end: fmpq) -> fmpq_mpoly:
        """p_N − end p_D, before it is cut."""
        domain, numerator = self.denominator.domain, self.own.numerator.polynomial
        return domain.sum(numerator, domain.product(self.denominator.polynomial, domain.ring.constant(-end)))

    def _cut(self, end: fmpq) -> Enclosure:
        """s at an end of the limits; its remainder is c."""
        whole = self.denominator.domain.exact(self.whole(end))
        return whole if self.degree is None else whole.cut(self.degree)

    def _beside(self, end: fmpq) -> Remainder:
        """c + |end| ε_D: the error of s without the numerator's own remainder."""
        of_denominator = self.denominator.domain.remainder_product((abs(end),), self.denominator.remainder)
        return remainder_sum(self._cut(end).remainder, of_denominator)

    def constraints(self, regime: int) -> list[fmpq_mpoly]:
        """Polynomials that are not negative on the cell."""
        above_lower, above_upper = (self._cut(end).polynomial for end in (self.lower, self.upper))
        negative = self.denominator.domain.negative
        if regime == INSIDE:
            return [above_lower, negative(above_upper)]
        return [negative(above_lower)] if regime == LOW else [above_upper]

    def value(self, regime: int) -> Quotient:
        """The law's input on the cell, enclosed."""
        domain, own = self.denominator.domain, self.own.numerator.remainder
        if regime == INSIDE:
            remainder = _largest(own, self._beside(self.lower), self._beside(self.upper))
            return Quotient(Enclosure(domain, self.own.numerator.polynomial, remainder), self.own.powers)
        end = self.lower if regime == LOW else self.upper
        beyond = remainder_sum(own, self._beside(end))
        remainder = domain.remainder_product((1 / self.own.least_denominator,), beyond)
        return Quotient(Enclosure(domain, domain.ring.constant(end), remainder))


def _largest(*remainders: Sequence[fmpq]) -> Remainder:
    """Coefficient by coefficient: nowhere below any of them."""
    constant, linear, square = (max(each) for each in zip(*remainders, strict=True))
    return constant, linear, square
