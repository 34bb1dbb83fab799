"""Polynomials in parameters whose coefficients are enclosures: evaluated once, they are known at every vertex of a box.

What `cfcheck.robustness.hold` bounds is of a low degree in inputs and reference. Its coefficients are polynomials in
the deviation; at given parameters it is a combination of them, one product of a vector and a matrix of whole numbers.
"""

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from math import lcm, prod
from operator import mul

from flint import fmpq, fmpq_mat, fmpq_mpoly, fmpz, fmpz_mat

from cfcheck.exact.enclosure import (
    LARGEST_DEGREE,
    LONGEST_COEFFICIENT,
    NO_REMAINDER,
    TOO_LARGE,
    Budget,
    Domain,
    Enclosure,
    Remainder,
    TooLarge,
    multinomial_of,
)
from cfcheck.exact.rational import bits, sqrt_upper


TERM_EFFORT = 64  # of each enclosure in a sum or a product, beside what its polynomial costs
REMAINDERS = len(NO_REMAINDER)

Powers = tuple[str, ...]  # parameters that are multiplied, sorted; one stands there as often as its power says
Point = Mapping[str, fmpq]  # parameters by their names


@dataclass(frozen=True)
class Parametric:
    """Σ E_m Π m over the products m of parameters in `terms`, each with an enclosure E_m that is free of them."""

    domain: Domain
    terms: Mapping[Powers, Enclosure]

    @classmethod
    def free(cls, value: Enclosure) -> "Parametric":
        """What does not depend on a parameter."""
        return cls(value.domain, {(): value} if _says_something(value) else {})

    @classmethod
    def parameter(cls, domain: Domain, name: str) -> "Parametric":
        """A parameter itself."""
        return cls(domain, {(name,): domain.constant(fmpq(1))})

    def __add__(self, other: "Parametric") -> "Parametric":
        return self._sum_of((*self.terms.items(), *other.terms.items()))

    def __neg__(self) -> "Parametric":
        return self._sum_of((powers, -value) for powers, value in self.terms.items())

    def __sub__(self, other: "Parametric") -> "Parametric":
        return self + -other

    def __mul__(self, other: "Parametric") -> "Parametric":
        pairs = product(self.terms.items(), other.terms.items())
        return self._sum_of((first + second, one * two) for (first, one), (second, two) in pairs)

    def renamed(self, names: Mapping[str, str]) -> "Parametric":
        """The same of other parameters, for those that have another name."""
        return self._sum_of((tuple(names.get(name, name) for name in m), value) for m, value in self.terms.items())

    def _sum_of(self, each: Iterable[tuple[Powers, Enclosure]]) -> "Parametric":
        """Σ value Π powers, paid for out of the budget: an enclosure costs something where its polynomial is zero too.

        Raises:
            TooLarge: the budget is spent, or a power is higher than any proof needs.
        """
        total: dict[Powers, Enclosure] = {}
        for parameters, value in each:
            self.domain.budget.spend(TERM_EFFORT)
            if len(parameters) > LARGEST_DEGREE:
                raise TooLarge(TOO_LARGE)
            powers = tuple(sorted(parameters))
            total[powers] = total[powers] + value if powers in total else value
        return Parametric(self.domain, {powers: value for powers, value in total.items() if _says_something(value)})

    @property
    def constant(self) -> Enclosure:
        """What is free of parameters.

        Raises:
            ValueError: where something else is there too.
        """
        if self.terms.keys() - {()}:
            raise ValueError("a function is applied to what depends on a parameter that varies")
        return self.terms.get((), self.domain.constant(fmpq(0)))

    def at(self, point: Point) -> "Combination":
        """The combination of the enclosures that the parameters ask for, paid for out of the budget.

        Raises:
            TooLarge: where numbers would be longer than any proof needs.
        """
        return self._table.at(point)

    @cached_property
    def _table(self) -> "_Table":
        return _Table(self.domain, self.terms)


def _says_something(value: Enclosure) -> bool:
    """Whether it is not exactly zero."""
    return bool(len(value.polynomial)) or any(value.remainder)


class _Table:
    """Coefficients as a matrix of whole numbers over a common denominator: a row for each product of parameters."""

    def __init__(self, domain: Domain, terms: Mapping[Powers, Enclosure]) -> None:
        self.domain, self.powers = domain, tuple(terms)
        self.remainders = tuple(value.remainder for value in terms.values())
        polynomials = [value.polynomial for value in terms.values()]
        by_term = [dict(zip(own.monoms(), own.coeffs(), strict=True)) for own in polynomials]
        found = dict.fromkeys(monomial for own in by_term for monomial in own)
        self.monomials = sorted(found, key=lambda monomial: multinomial_of(monomial)[0])  # by degree
        degrees, multinomials = ([own[k] for own in map(multinomial_of, self.monomials)] for k in (0, 1))
        self.ends = [bisect_right(degrees, degree) for degree in range(-1, max(degrees, default=-1) + 1)]
        self.whole = lcm(*multinomials)
        self.shares = [fmpz(self.whole // multinomial) for multinomial in multinomials]
        self.denominator = _common_denominator(domain.budget, [value for own in by_term for value in own.values()])
        domain.budget.spend(16 * len(by_term) * len(self.monomials) * (1 + self.denominator.bit_length() // 512))
        whole = [{m: value.p * (self.denominator // value.q) for m, value in own.items()} for own in by_term]
        entries = [own.get(monomial, 0) for own in whole for monomial in self.monomials]
        self.matrix = fmpz_mat(len(whole), len(self.monomials), entries)
        self.longest = max((entry.height_bits() for entry in (*self.matrix.entries(), self.denominator)), default=0)

    def at(self, point: Point) -> "Combination":
        weights = [prod((point[name] for name in powers), start=fmpq(1)) for powers in self.powers]
        length = self.longest + sum(map(bits, weights))  # of weights without a common denominator
        if length > LONGEST_COEFFICIENT:
            raise TooLarge(TOO_LARGE)
        self.domain.budget.spend((len(weights) + 16) * (len(self.monomials) + REMAINDERS) * (1 + length // 512))
        row, denominator = fmpq_mat(1, len(weights), weights).numer_denom()
        first, second, third = (
            sum((abs(weight) * own[k] for weight, own in zip(weights, self.remainders, strict=True)), fmpq(0))
            for k in range(REMAINDERS)
        )
        numerators = (row * self.matrix).entries()
        return Combination(self, numerators, denominator * self.denominator, (first, second, third))


def _common_denominator(budget: Budget, values: Sequence[fmpq]) -> fmpz:
    """The least common multiple of the denominators; they are few different ones, or the proof is too large."""
    common = fmpz(1)
    for value in values:
        if common % value.q != 0:
            common = common.lcm(value.q)
            length = common.bit_length()
            if length > LONGEST_COEFFICIENT:
                raise TooLarge(TOO_LARGE)
            budget.spend(1 + length // 512)
    return common


@dataclass(frozen=True)
class Combination:
    """An enclosure by the coefficients of its polynomial: whole numbers over a denominator, in the table's order."""

    table: _Table
    numerators: Sequence[fmpz]
    denominator: fmpz
    remainder: Remainder

    def polynomial(self, degree: int) -> fmpq_mpoly:
        """The terms up to the degree."""
        table = self.table
        end = table.ends[min(degree + 1, len(table.ends) - 1)]
        terms = zip(table.monomials[:end], self.numerators, strict=False)
        return table.domain.ring.from_dict({m: fmpq(value, self.denominator) for m, value in terms if value})

    @property
    def enclosure(self) -> Enclosure:
        return Enclosure(self.table.domain, self.polynomial(LARGEST_DEGREE), self.remainder)

    @property
    def largest_remainder(self) -> fmpq:
        """As that of an `Enclosure`."""
        return sum((size * self.table.domain.radius**k for k, size in enumerate(self.remainder)), fmpq(0))

    def sizes(self, above: int = -1) -> list[fmpq]:
        """As `Domain.sizes`, of the terms above a degree."""
        table = self.table
        squares = list(map(mul, map(mul, self.numerators, self.numerators), table.shares))
        common = table.whole * self.denominator**2
        each = enumerate(pairwise(table.ends))
        return [sqrt_upper(fmpq(sum(squares[a:b], fmpz(0)), common)) if d > above else fmpq(0) for d, (a, b) in each]
