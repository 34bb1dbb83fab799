"""Dynamics as polynomials in states, inputs, reference and the functions applied: what structure shows by itself.

Evaluated so, a vehicle's graph can be compared with another statement of it (`cfjax.check.vehicle`) and searched for
properties that hold whatever the numbers are (`cfjax.check.structure`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import prod
from types import MappingProxyType

from flint import fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from cfjax.check.enclosure import Budget, Domain, Enclosure
from cfjax.check.graph import Graph
from cfjax.check.rational import sqrt_upper
from cfjax.check.reader import Broken


DERIVATIVES = {"sin": ("cos", 1), "cos": ("sin", -1)}  # of functions: another function, and its sign
STRUCTURE_EFFORT = 8_000_000  # in products of coefficients, as a proof's: to look at dynamics takes far less
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
        """∂/∂(a state, input or reference), through the functions sin and cos.

        Raises:
            ValueError: another function depends on it, or a derivative that no symbol stands for is needed.
        """
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
        other, sign = DERIVATIVES.get(function, (None, 0))
        symbol = next((k for k, value in self.functions.items() if value == (other, argument)), None)
        if symbol is None:
            raise ValueError(f"the dynamics apply {function}, but not its derivative to the same argument")
        slope = self.domain.product(inner, self.domain.ring.gens()[symbol])
        return slope if sign > 0 else self.domain.negative(slope)

    def _through(self, polynomial: fmpq_mpoly, name: str) -> fmpq_mpoly:
        """∂polynomial/∂name by the slopes of the functions in it, which are known."""
        total = polynomial.derivative(self.names.index(name))
        for index in self._used(polynomial):
            slope = self._slopes[name][index]
            if len(slope):
                total = self.domain.sum(total, self.domain.product(polynomial.derivative(index), slope))
        return total

    def size(
        self, polynomial: fmpq_mpoly, sizes: Mapping[str, fmpq], least: Mapping[str, fmpq] = MappingProxyType({})
    ) -> fmpq:
        """A rational that is at least |polynomial| where every named quantity is at most its size.

        |sin| and |cos| are at most 1, a square root is at most that of its argument's size; one over a product of
        quantities is bounded where there is a number above zero for each of them in `least`, below which it never is.

        Raises:
            ValueError: the polynomial has another function in it.
        """
        self.domain.budget.spend(16 * len(polynomial))
        total = fmpq(0)
        for exponents, coefficient in polynomial.to_dict().items():
            term = abs(fmpq(coefficient))
            for index, power in enumerate(map(int, exponents)):
                if not power:
                    continue
                if index < len(self.names):
                    term *= sizes[self.names[index]] ** power
                else:
                    term = term * self._largest(index, sizes, least) ** power if term else term
            total += term
        return total

    def _largest(self, index: int, sizes: Mapping[str, fmpq], least: Mapping[str, fmpq]) -> fmpq:
        """A rational that is at least the size of the function with this index."""
        function, argument = self.functions[index]
        if function == "sqrt":
            return sqrt_upper(self.size(argument, sizes, least))
        if function == "inv" and len(argument) == 1:
            ((exponents, coefficient),) = argument.to_dict().items()
            powers = {index: power for index, power in enumerate(map(int, exponents)) if power}
            if all(index < len(self.names) and least.get(self.names[index], 0) > 0 for index in powers):
                factors = (least[self.names[index]] ** power for index, power in powers.items())
                return 1 / prod(factors, start=abs(fmpq(coefficient)))
        if function not in DERIVATIVES:
            raise ValueError(f"no bound is known of {function}")
        return fmpq(1)


def symbolic(graph: Graph, states: tuple[str, ...], inputs: tuple[str, ...]) -> Symbolic:
    """The graph in polynomials, exactly; functions of equal arguments are one symbol.

    Raises:
        ValueError: where a polynomial grows beyond what the checker takes, or a name is unknown.
    """
    names = (*states, *(f"input:{label}" for label in inputs), *(f"reference:{label}" for label in REFERENCE))
    ring = fmpq_mpoly_ctx.get([f"z{k}" for k in range(len(names) + len(graph.functions()))], "degrevlex")
    domain = Domain(ring, fmpq(1), Budget(STRUCTURE_EFFORT))  # every polynomial here is exact: the ball bounds nothing
    generators = ring.gens()
    functions: dict[int, tuple[str, fmpq_mpoly]] = {}

    def apply(_: int, function: str, argument: Enclosure) -> Enclosure:
        for index, (name, value) in functions.items():
            if name == function and value == argument.polynomial:
                return domain.exact(generators[index])
        index = len(names) + len(functions)
        functions[index] = (function, argument.polynomial)
        return domain.exact(generators[index])

    values = {label: domain.exact(generator) for label, generator in zip(names, generators, strict=False)}
    rates = tuple(value.polynomial for value in graph.evaluate(values, domain.constant, apply))
    return Symbolic(domain, names, functions, rates)
