"""Dynamics as polynomials in states, inputs, reference and the functions applied: what structure shows by itself.

Evaluated so, a vehicle's graph can be compared with another statement of it (`cfcheck.vehicle.model`) and searched for
properties that hold whatever the numbers are (`cfcheck.vehicle.structure`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from flint import fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from cfcheck.exact.enclosure import Budget, Domain, Enclosure
from cfcheck.exact.graph import Graph
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
REFERENCE = ("turn_rate", "speed", "turn_rate_slope", "speed_slope")


@dataclass(frozen=True, eq=False)
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
