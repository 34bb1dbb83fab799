"""Dynamics as polynomials in states, inputs, reference and the functions applied: what structure shows by itself.

Evaluated so, a vehicle's graph can be compared with another statement of it (`cfjax.check.vehicle`) and searched for
properties that hold whatever the numbers are (`cfjax.check.tube`).
"""

from dataclasses import dataclass

from flint import fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from cfjax.check.enclosure import Domain, Enclosure
from cfjax.check.graph import Graph
from cfjax.check.reader import Broken


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


def symbolic(graph: Graph, states: tuple[str, ...], inputs: tuple[str, ...]) -> Symbolic:
    """The graph in polynomials, exactly; functions of equal arguments are one symbol.

    Raises:
        ValueError: where a polynomial grows beyond what the checker takes, or a name is unknown.
    """
    names = (*states, *(f"input:{label}" for label in inputs), *(f"reference:{label}" for label in REFERENCE))
    ring = fmpq_mpoly_ctx.get([f"z{k}" for k in range(len(names) + len(graph.functions()))], "degrevlex")
    domain = Domain(ring, fmpq(1))  # every polynomial here is exact: the ball bounds nothing
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
