"""Regions of attraction of systems that are no vehicles: a graph of rates, an ellipse, and a certificate for it.

The certificate's format speaks of paths within bounds. The rates of such a system read nothing of a path, so one
reference (speed 1 m/s, curvature 0) stands for all, and an invariant funnel is a region that no trajectory needs to
leave.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from flint import fmpq
from jaxtyping import Float

from cfcheck.claims.hints import CellHints
from cfcheck.claims.problem import read_problem
from cfcheck.exact.rational import dyadic, rational
from cfcheck.path.bounds import Bounds
from cfjax import Contracting, Funnel
from cfjax.certificate.program import MARGIN_BITS, program_of, prove, solved
from cfjax.certificate.prover import ROOM
from cfjax.certificate.rounding import round_funnel
from cfjax.certificate.stretches import ThetaInterval, decreases_on, question_of
from cfjax.certificate.writing import seal, write_decrease, write_funnel, write_stretch
from cfjax.problem import Interval, Tube
from cfjax.solver import DEFAULT, solver_named


ANY = Tube(Interval(0.0, 0.0), Interval(1.0, 1.0))  # the one reference, of which nothing is read
PI_BELOW = fmpq(314159265358979, 10**14)


class NotShown(Exception):
    """A region for which no proof was found."""


@dataclass
class Rates:
    """A graph of rates, written node by node; every method returns the number of its node."""

    nodes: list[list] = field(default_factory=list)

    def __call__(self, operation: str, *arguments: Any) -> int:
        node = [operation, *arguments]
        if node not in self.nodes:
            self.nodes.append(node)
        return self.nodes.index(node)

    def number(self, value: str) -> int:
        return self("constant", str(rational(value)))


@dataclass(frozen=True)
class System:
    """ẋ = f(x, u), with inputs between limits that are decimals, as text."""

    name: str
    states: tuple[str, ...]
    rates: Rates
    outputs: tuple[int, ...]
    inputs: Mapping[str, tuple[str, str]]

    def statement(self) -> dict[str, Any]:
        """The question, as a certificate holds it: no sets, for the region itself is asked."""
        zero, one = ["0", "0"], ["1", "1"]
        return {
            "vehicle": {
                "name": self.name,
                "parameters": {},
                "states": list(self.states),
                "dynamics": {"nodes": self.rates.nodes, "outputs": list(self.outputs)},
            },
            "method": "tt",
            "inputs": [
                {"name": name, "lower": str(rational(low)), "upper": str(rational(high))}
                for name, (low, high) in {"u0": ("1", "1"), **self.inputs}.items()
            ],
            "path": {"name": "none", "bounds": {"curvature": zero, "speed": one, "acceleration": zero}},
            "sets": {"inlet": None, "goal": None, "safe": None, "obstacles": [], "footprint": []},
        }


def certificate(
    system: System, shape: Float[np.ndarray, "n n"], beta_lower: float, beta_inner: float
) -> dict[str, Any]:
    """A document that states {xᵀ C x ≤ 1} with the largest margin that was found; the checker decides whether it holds.

    Raises:
        NotShown: no margin above zero was found.
    """
    written = system.statement()
    claim = read_problem(written)
    rounded = round_funnel(Funnel(Contracting(), shape, 0.0, math.inf, beta_lower, beta_inner), ANY)
    question = question_of(claim, rounded)
    assert isinstance(claim.course, Bounds)
    stretch = ThetaInterval(fmpq(0), fmpq(0), claim.course)
    try:
        (decrease,) = decreases_on(question, rounded, stretch)
    except ValueError as error:
        raise NotShown(str(error)) from None
    cells = []
    for cell in decrease.cells():
        constant, square = (dyadic(bound * (1 + ROOM), up=True) for bound in decrease.remainder(cell))
        cells.append(replace(cell, remainder=(constant, square)))
    programs = [program_of(decrease, cell) for cell in cells]
    hints, margins = [], []
    for cell, program, solution in zip(cells, programs, solved(solver_named(DEFAULT, 2), programs), strict=True):
        found = prove(decrease, cell, program, solution)
        if found.proof is None or not found.margin > 0 or cell.remainder is None:
            raise NotShown(f"piece {cell.piece}, signs {cell.signs}: margin {solution.margin:.3g} by the solver")
        margins.append(found.margin)
        hints.append(((0, cell.piece, cell.signs), CellHints(found.proof.margin, cell.remainder, found.proof.grams)))
    margin = fmpq(math.floor(min(margins) * (1 - ROOM) * 2**MARGIN_BITS), 2**MARGIN_BITS)
    if not margin > 0:
        raise NotShown("the margin is too small to state")
    whole = write_stretch(None, stretch.bounds, decrease, hints)
    proofs = [write_decrease(decrease.degrees, question.mirror, [whole])]
    funnels = [write_funnel(rounded.claim(margin, margin))]
    return seal("funnel", written, funnels, {"decrease": proofs, "clearance": []})


def area_below(document: dict[str, Any]) -> float:
    """Area of the ellipse of a document with two states, π/√det C, rounded down from its exact C."""
    a, b, c = map(rational, document["funnels"][0]["shape"])
    square = PI_BELOW**2 / (a * c - b * b)
    return math.isqrt(math.floor(square * 10**8)) / 10**4
