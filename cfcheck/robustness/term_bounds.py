"""Derivatives of a vehicle's rates as polynomials in symbols, and bounds of such polynomials, term by term."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

from flint import arb, fmpq, fmpq_mpoly

from cfcheck.exact.rational import Range, bits, lower_bound, sqrt_lower, sqrt_upper, upper_bound
from cfcheck.exact.symbolic import DERIVATIVES, Symbolic


LONGEST_RANGE = 1024  # bits of the ends of an interval


class Slopes:
    """Derivatives by a state, input or reference, through the functions.

    The derivatives of functions' symbols are kept: computed anew each time, nested functions would cost twice as much
    with every level.
    """

    def __init__(self, dynamics: Symbolic) -> None:
        self.dynamics = dynamics
        self._known: dict[tuple[int, str], fmpq_mpoly] = {}

    def derivative(self, polynomial: fmpq_mpoly, name: str) -> fmpq_mpoly:
        """∂polynomial/∂name."""
        dynamics, domain = self.dynamics, self.dynamics.domain
        domain.budget.spend(len(polynomial))
        total, degrees = polynomial.derivative(dynamics.names.index(name)), polynomial.degrees()
        for index in dynamics.functions:
            if degrees[index] > 0 and len(slope := self._slope(index, name)):
                total = domain.sum(total, domain.product(polynomial.derivative(index), slope))
        return total

    def _slope(self, index: int, name: str) -> fmpq_mpoly:
        """∂/∂name of the function that the generator with this number stands for."""
        if (index, name) not in self._known:
            dynamics, (function, argument) = self.dynamics, self.dynamics.functions[index]
            derivative, generators = DERIVATIVES[function], dynamics.domain.ring.gens()
            others = (k for k, value in dynamics.functions.items() if value == (derivative.other, argument))
            value, other = (dynamics.domain.exact(generators[k]) for k in (index, next(others, index)))
            slope = self.derivative(argument, name)
            if len(slope):
                slope = dynamics.domain.product(slope, derivative.of(value, other).polynomial)
            self._known[index, name] = slope
        return self._known[index, name]


@lru_cache(maxsize=128)
def slopes_of(dynamics: Symbolic) -> Slopes:
    """The derivatives that are known of these dynamics."""
    return Slopes(dynamics)


@dataclass(frozen=True)
class TermBounds:
    """Bounds of polynomials in the symbols of `dynamics`, where every named quantity is in its range."""

    dynamics: Symbolic
    ranges: Mapping[str, Range]

    def size(self, polynomial: fmpq_mpoly) -> fmpq:
        """A rational that is at least |polynomial|.

        Raises:
            ValueError: it divides by what may be zero, or a tangent's argument reaches a right angle.
        """
        self.dynamics.domain.budget.spend(16 * len(polynomial))
        total = fmpq(0)
        for powers, coefficient in _terms(polynomial):
            term = abs(coefficient)
            for index, power in powers:
                term = _short((fmpq(0), term * self._largest(index) ** power))[1] if term else term
            total += term
        return total

    def _largest(self, index: int) -> fmpq:
        """A rational that is at least the size of a generator."""
        function, argument = self.dynamics.functions.get(index, ("", None))
        if argument is None:
            return max(map(abs, self.ranges[self.dynamics.names[index]]))
        if function in ("sin", "cos"):
            return fmpq(1)
        if function == "sqrt":
            return sqrt_upper(self.size(argument))
        if function == "tan" and 2 * arb(widest := self.size(argument)) < arb.pi():
            return upper_bound(arb(widest).tan())
        if function == "inv":
            lower, upper = self._range(argument)
            if lower > 0 or upper < 0:
                return 1 / min(abs(lower), abs(upper))
        raise ValueError(f"no bound is known of {function}")

    def _range(self, polynomial: fmpq_mpoly) -> Range:
        """Rationals between which the polynomial is."""
        self.dynamics.domain.budget.spend(64 * len(polynomial))
        total = fmpq(0), fmpq(0)
        for powers, coefficient in _terms(polynomial):
            term = coefficient, coefficient
            for index, power in powers:
                term = _short(_product(term, _power(self._range_of(index), power)))
            total = _short((total[0] + term[0], total[1] + term[1]))
        return total

    def _range_of(self, index: int) -> Range:
        """Rationals between which a generator is."""
        if index < len(self.dynamics.names):
            return self.ranges[self.dynamics.names[index]]
        function, argument = self.dynamics.functions[index]
        largest = self._largest(index)
        if function not in ("sqrt", "inv"):
            return -largest, largest
        lower, upper = self._range(argument)
        if function == "inv":
            return 1 / upper, 1 / lower
        return sqrt_lower(max(lower, fmpq(0))), largest


def _terms(polynomial: fmpq_mpoly) -> Iterator[tuple[list[tuple[int, int]], fmpq]]:
    """The generators of each term, with their powers, and its coefficient."""
    for exponents, coefficient in polynomial.to_dict().items():
        yield [(index, power) for index, power in enumerate(map(int, exponents)) if power], fmpq(coefficient)


def _short(values: Range) -> Range:
    """The same, rounded outwards where its numbers are long: nested functions would make them longer without end."""
    lower, upper = values
    if max(bits(lower), bits(upper)) <= LONGEST_RANGE:
        return values
    return lower_bound(arb(lower)), upper_bound(arb(upper))


def _product(first: Range, second: Range) -> Range:
    ends = [one * other for one in first for other in second]
    return min(ends), max(ends)


def _power(values: Range, power: int) -> Range:
    lower, upper = values
    ends = sorted((lower**power, upper**power))
    return (fmpq(0) if lower < 0 < upper and power % 2 == 0 else ends[0]), ends[1]
