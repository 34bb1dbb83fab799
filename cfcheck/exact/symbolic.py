"""Dynamics as polynomials in states, inputs, reference and the functions applied: what structure shows by itself.

Evaluated so, a vehicle's graph can be compared with another statement of it (`cfcheck.vehicle.model`) and searched for
properties that hold whatever the numbers are (`cfcheck.vehicle.structure`).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from flint import arb, fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from cfcheck.exact.enclosure import Budget, Domain, Enclosure
from cfcheck.exact.graph import Graph
from cfcheck.exact.rational import Range, bits, lower_bound, sqrt_lower, sqrt_upper, upper_bound
from cfcheck.reader import Broken


class Derivative(NamedTuple):
    """f′(t), from f(t) and from another function of t, where it takes one."""

    of: Callable[[Enclosure, Enclosure], Enclosure]
    other: str = ""


DERIVATIVES = {
    "sin": Derivative(lambda _, cos: cos, "cos"),
    "cos": Derivative(lambda _, sin: -sin, "sin"),
    "tan": Derivative(lambda tan, _: tan * tan + tan.domain.constant(fmpq(1))),
    "inv": Derivative(lambda inv, _: -(inv * inv)),
    "sqrt": Derivative(lambda sqrt, inv: sqrt * inv * inv.domain.constant(fmpq(1, 2)), "inv"),
}
STRUCTURE_EFFORT = 8_000_000  # in products of coefficients, as a proof's: to look at dynamics takes far less
LONGEST_RANGE = 1024  # bits of what a quantity is between
REFERENCE = ("turn_rate", "speed", "turn_rate_slope", "speed_slope")


@dataclass(frozen=True)
class Symbolic:
    """Rates of the deviation as polynomials; `names[k]` is the k-th generator of the ring.

    Names are those of the graph (`alpha`, `input:w`, `reference:speed`); a function of something is one more symbol,
    `functions` gives its name and its argument by the index of the generator.
    """

    domain: Domain
    names: tuple[str, ...]
    functions: dict[int, tuple[str, fmpq_mpoly]]
    rates: tuple[fmpq_mpoly, ...]

    @property
    def symbols(self) -> dict[str, fmpq_mpoly]:
        return dict(zip(self.names, self.domain.ring.gens(), strict=False))

    def of(self, function: str, argument: str) -> fmpq_mpoly:
        """The symbol that stands for a function of a named quantity.

        Raises:
            Broken: the dynamics do not apply it. (Nothing may stand for it: zero would match dynamics that lack it.)
        """
        for index, (name, value) in self.functions.items():
            if name == function and value == self.symbols[argument]:
                return self.domain.ring.gens()[index]
        raise Broken(f"vehicle: the dynamics in the file apply no {function} to {argument}")

    def depends_on(self, name: str) -> bool:
        """Whether a state, input or reference stands in the rates, or in a function's argument."""
        index = self.names.index(name)
        looked_at = (*self.rates, *(argument for _, argument in self.functions.values()))
        return any(int(exponents[index]) for polynomial in looked_at for exponents in polynomial.to_dict())

    def derivative(self, polynomial: fmpq_mpoly, name: str) -> fmpq_mpoly:
        """∂/∂(a state, input or reference), through the functions."""
        slopes = self._slopes.setdefault(name, {})
        for index in self._functions_in(polynomial):
            if index not in slopes:
                slopes[index] = self._slope(index, name)
        return self._through(polynomial, name)

    @cached_property
    def _slopes(self) -> dict[str, dict[int, fmpq_mpoly]]:
        """By name, ∂/∂name of functions' symbols.

        They are kept: by the chain rule anew each time, nested functions would cost twice as much with every level.
        """
        return {}

    def _functions_in(self, polynomial: fmpq_mpoly) -> list[int]:
        """Those in it, and in their arguments, which come earlier; innermost first."""
        found: set[int] = set()
        looked_at = [polynomial]
        while looked_at:
            new = set(self._used(looked_at.pop())) - found
            found |= new
            looked_at += [self.functions[index][1] for index in new]
        return sorted(found)

    def _used(self, polynomial: fmpq_mpoly) -> list[int]:
        """The functions whose symbols stand in a polynomial itself."""
        self.domain.budget.spend(len(polynomial))
        degrees = polynomial.degrees()
        return [index for index in self.functions if degrees[index] > 0]  # of zero they are −1

    def _slope(self, index: int, name: str) -> fmpq_mpoly:
        function, argument = self.functions[index]
        inner = self._through(argument, name)
        if not len(inner):
            return inner
        derivative, generators = DERIVATIVES[function], self.domain.ring.gens()
        others = (k for k, value in self.functions.items() if value == (derivative.other, argument))
        value, other = (self.domain.exact(generators[k]) for k in (index, next(others, index)))
        return self.domain.product(inner, derivative.of(value, other).polynomial)

    def _through(self, polynomial: fmpq_mpoly, name: str) -> fmpq_mpoly:
        """∂polynomial/∂name by the slopes of the functions in it, which are known."""
        total = polynomial.derivative(self.names.index(name))
        for index in self._used(polynomial):
            slope = self._slopes[name][index]
            if len(slope):
                total = self.domain.sum(total, self.domain.product(polynomial.derivative(index), slope))
        return total

    def size(self, polynomial: fmpq_mpoly, ranges: Mapping[str, Range]) -> fmpq:
        """A rational that is at least |polynomial| where every named quantity is in its range: term by term.

        Raises:
            ValueError: it divides by what cannot be told from zero, or a tangent's argument reaches a right angle.
        """
        self.domain.budget.spend(16 * len(polynomial))
        total = fmpq(0)
        for powers, coefficient in _terms(polynomial):
            term = abs(coefficient)
            for index, power in powers:
                term = _short((fmpq(0), term * self._largest(index, ranges) ** power))[1] if term else term
            total += term
        return total

    def _largest(self, index: int, ranges: Mapping[str, Range]) -> fmpq:
        """A rational that is at least the size of a generator."""
        function, argument = self.functions.get(index, ("", None))
        if argument is None:
            return max(map(abs, ranges[self.names[index]]))
        if function in ("sin", "cos"):
            return fmpq(1)
        if function == "sqrt":
            return sqrt_upper(self.size(argument, ranges))
        if function == "tan" and 2 * arb(widest := self.size(argument, ranges)) < arb.pi():
            return upper_bound(arb(widest).tan())
        if function == "inv":
            lower, upper = self._range(argument, ranges)
            if lower > 0 or upper < 0:
                return 1 / min(abs(lower), abs(upper))
        raise ValueError(f"no bound is known of {function}")

    def _range(self, polynomial: fmpq_mpoly, ranges: Mapping[str, Range]) -> Range:
        """Rationals between which the polynomial is."""
        self.domain.budget.spend(64 * len(polynomial))
        total = fmpq(0), fmpq(0)
        for powers, coefficient in _terms(polynomial):
            term = coefficient, coefficient
            for index, power in powers:
                term = _short(_product(term, _power(self._range_of(index, ranges), power)))
            total = _short((total[0] + term[0], total[1] + term[1]))
        return total

    def _range_of(self, index: int, ranges: Mapping[str, Range]) -> Range:
        """Rationals between which a generator is."""
        if index < len(self.names):
            return ranges[self.names[index]]
        function, argument = self.functions[index]
        largest = self._largest(index, ranges)
        if function not in ("sqrt", "inv"):
            return -largest, largest
        lower, upper = self._range(argument, ranges)
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


def symbolic(graph: Graph, states: tuple[str, ...], inputs: tuple[str, ...]) -> Symbolic:
    """The graph in polynomials, exactly; functions of equal arguments are one symbol.

    There are symbols for all functions that are in derivatives too.

    Raises:
        ValueError: where a polynomial grows beyond what the checker takes, or a name is unknown.
    """
    names = (*states, *(f"input:{label}" for label in inputs), *(f"reference:{label}" for label in REFERENCE))
    ring = fmpq_mpoly_ctx.get([f"z{k}" for k in range(len(names) + 2 * len(graph.functions()))], "degrevlex")
    domain = Domain(ring, fmpq(1), Budget(STRUCTURE_EFFORT))  # every polynomial here is exact: the ball bounds nothing
    generators = ring.gens()
    functions: dict[int, tuple[str, fmpq_mpoly]] = {}

    def symbol(function: str, argument: fmpq_mpoly) -> fmpq_mpoly:
        for index, known in functions.items():
            if known == (function, argument):
                return generators[index]
        functions[len(names) + len(functions)] = function, argument
        return generators[len(names) + len(functions) - 1]

    def apply(_: int, function: str, argument: Enclosure) -> Enclosure:
        return domain.exact(symbol(function, argument.polynomial))

    values = {label: domain.exact(generator) for label, generator in zip(names, generators, strict=False)}
    rates = tuple(value.polynomial for value in graph.evaluate(values, domain.constant, apply))
    for function, argument in list(functions.values()):
        if other := DERIVATIVES[function].other:
            symbol(other, argument)
    return Symbolic(domain, names, functions, rates)
