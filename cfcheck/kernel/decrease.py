"""Condition (d) in exact arithmetic: what has to be shown for one vertex of the input box, and how Gram matrices do.

On a steady segment, with x = W y for a rational whitening W ≈ C^{−1/2} and q = xᵀ C x, the claim "some input gives
V̇ ≤ −λ on the shell" reads (`cfcheck.kernel.level`)

    for every y with q ∈ [q_lo, q_hi] there is an input u with   F_u(y) := −(q̇ + timing(q) u0) ≥ λ weight(q).

Within bounds it has to hold at several references (`cfcheck.path.bounds`), for some of them with the same input at the
same y: these share the s_i below, which are then those of their nominal reference.

The shell is cut at the q where `weight` has its kink, and each piece into the cells of one sign pattern of the
polynomials s_i ≈ ∂(V̇)/∂(input i): whatever the s_i are, their sign cells cover the shell, and on each the proof speaks
of one vertex u of the input box. (So they are cut at the degree for which there is room beside their Gram matrices.) On
a cell

    p_u − ε − λ weight = z₀ᵀ Q₀ z₀ + Σ_i (± s_i) zᵀ Q_i z + (q − q_lo) zᵀ Q_lo z + (q_hi − q) zᵀ Q_hi z + r

where |F_u − p_u| ≤ ε(y) is the enclosure of sin and cos. (A file states a bound e + e' |y|² of ε, which is taken in its
place: how anybody comes by ε is no matter then, as long as it is no more.) What the Gram matrices then prove,
`cfcheck.kernel.program` says.

Where a **law** is part of the question (`cfcheck.kernel.law`), its inputs are no choice: a cell says of each of them
whether it is at its lower limit, inside or at its upper one, and u stands there for what the law is on that cell, a
polynomial with remainder. What is left to choose is u0. The same arithmetic carries the remainder of u into ε.

Where the rates divide by something, F_u is a quotient with a denominator D > 0 (`cfcheck.exact.quotient`). Then p_u − ε
encloses D F_u, and p_D weight takes the place of the weight, p_D being the polynomial of D with |D − p_D| ≤ δ. The
identity shows D F_u ≥ λ p_D weight + r, so F_u ≥ λ (p_D/D) weight − |r|/D. A lower bound of D is known, and p_D/D
differs from 1 by at most δ/D.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

from flint import fmpq, fmpq_mpoly

from cfcheck.exact.enclosure import Enclosure, UnaryEnclosure, cut
from cfcheck.exact.graph import Graph
from cfcheck.exact.quotient import Quotient, UnaryOf, applied
from cfcheck.exact.rational import Matrix, dyadic, sqrt_upper
from cfcheck.kernel.law import INSIDE, READABLE, REGIMES, LawClaim, Limited
from cfcheck.kernel.level import LevelPiece
from cfcheck.kernel.program import CellProof, FunnelProgram
from cfcheck.path.bounds import Extreme


Remainder = tuple[fmpq, fmpq]  # e and e' of e + e' |y|²
Vertex = tuple[fmpq | int, ...]  # by input: a number, or the regime of a law


@dataclass(frozen=True)
class Cell:
    """One sign pattern on one range of q: the signs of the s_i (in the order of the inputs) and the vertex u.

    Of an input that a law gives, sign and entry of the vertex are its regime (`cfcheck.kernel.law`). `remainder` is the
    bound of ε that a file states; without one it is the least that is known.
    """

    piece: int
    signs: tuple[int, ...]
    vertex: Vertex
    remainder: Remainder | None = None


@dataclass(frozen=True)
class SteadyDecrease(FunnelProgram):
    """Condition (d) at one reference that does not depend on θ; everything is rational.

    `extreme` gives the reference's constants by the graph's input names, `inputs` the box by input name (u0 first),
    `enclosures` one `UnaryEnclosure` per node of the graph that applies a function; nodes of the law's graph are
    counted on after those of the vehicle's.
    """

    graph: Graph
    states: tuple[str, ...]
    extreme: Extreme
    inputs: Mapping[str, tuple[fmpq, fmpq]]
    shape: Matrix  # C
    whitening: Matrix  # W
    pieces: tuple[LevelPiece, ...]
    enclosures: Mapping[int, UnaryEnclosure]
    degrees: tuple[int, ...]  # of the monomials in the Gram matrices, in their order
    law: LawClaim | None = None
    law_degree: int | None = None  # of polynomials that stand for the law and for what it applies functions to

    @property
    def peak(self) -> fmpq:
        """The largest level of the funnel on the stretch."""
        return max(piece.upper for piece in self.pieces)

    def rates(
        self, inputs: Mapping[str, Quotient], unary_of: UnaryOf, profile: Mapping[str, fmpq] | None = None
    ) -> list[Quotient]:
        """The deviation's rate ẋ at these inputs; `unary_of` encloses the function that a node applies."""
        profile = self.extreme.profile if profile is None else profile
        values = self._states | {f"reference:{name}": self.number(value) for name, value in profile.items()}
        values |= {f"input:{name}": value for name, value in inputs.items()}
        return self.graph.evaluate(
            values, self.number, lambda node, name, argument: applied(node, name, argument, unary_of)
        )

    def law_values(self, unary_of: UnaryOf) -> dict[str, Quotient]:
        """What the law says before it is limited, by input; nothing without one."""
        if self.law is None:
            return {}
        values = self._states | {f"reference:{name}": self.number(self.extreme.profile[name]) for name in READABLE}
        since, most = len(self.graph.nodes), self.law_degree or 0

        def apply(node: int, name: str, argument: Quotient) -> Quotient:
            return applied(since + node, name, Quotient(argument.enclosed().cut(most)), unary_of)

        outputs = self.law.graph.evaluate(values, self.number, apply)
        own = [Quotient(output.numerator.cut(most), output.powers) for output in outputs]
        return dict(zip(list(self.inputs)[1:], own, strict=True))  # u0 comes first

    @property
    def _states(self) -> dict[str, Quotient]:
        return {name: Quotient(self.domain.exact(x)) for name, x in zip(self.states, self.deviations, strict=True)}

    def number(self, value: fmpq) -> Quotient:
        """A constant."""
        return Quotient(self.domain.constant(value))

    def _timing(self, piece: LevelPiece, share: fmpq) -> Quotient:
        """A share of what V changes by with θ, on a piece."""
        return Quotient(self.domain.exact(piece.timing.at(self.form) * share))

    def form_rate(self, vertex: Vertex, profile: Mapping[str, fmpq]) -> Quotient:
        """q̇ = ∇q · f(x, u) at constant inputs, and at those of a law on its cell."""
        inputs = {
            name: self.limited[name].value(int(entry)) if name in self.limited else self.number(fmpq(entry))
            for name, entry in zip(self.inputs, vertex, strict=True)
        }
        rates = self.rates(inputs, lambda node, *_: self.enclosures[node], profile)
        total = self.number(fmpq(0))
        for gradient, rate in zip(self.covector, rates, strict=True):
            total = total + Quotient(self.domain.exact(gradient)) * rate
        return total

    @cached_property
    def signed_inputs(self) -> tuple[str, ...]:
        """Inputs with room to move, for which cells have a sign; u0 of trajectory tracking has none."""
        return tuple(name for name, (lower, upper) in self.inputs.items() if lower < upper)

    @property
    def free_inputs(self) -> tuple[str, ...]:
        """Those of them that no law gives."""
        return tuple(name for name in self.signed_inputs if name == "u0" or self.law is None)

    @cached_property
    def limited(self) -> dict[str, Limited]:
        """Those of them that a law gives."""
        own = self.law_values(lambda node, *_: self.enclosures[node])
        return {
            name: Limited(k, *self.inputs[name], self._cut_at(name))
            for name, k in own.items()
            if name in self.signed_inputs
        }

    def _cut_at(self, name: str) -> int | None:
        """The degree up to which there is room beside an input's Gram matrix; None where it is not known yet."""
        index = 1 + self.signed_inputs.index(name)
        return 2 * (self.degrees[0] - self.degrees[index]) if index < len(self.degrees) else None

    def _entry(self, name: str, sign: int) -> fmpq | int:
        """Of the vertex: the lower end where the sign is +, else the upper one; of a law its regime."""
        lower, upper = self.inputs[name]
        return sign if name in self.limited else upper if sign < 0 else lower

    def _signs(self, name: str) -> tuple[int, ...]:
        return REGIMES if name in self.limited else (1, -1)

    @cached_property
    def form_rates(self) -> dict[Vertex, Quotient]:
        """q̇ at every vertex of the input box; under a law at every one of its regimes."""
        entries = (
            dict.fromkeys(self._entry(name, sign) for sign in self._signs(name))
            if name in self.signed_inputs
            else (self.inputs[name][0],)
            for name in self.inputs
        )
        return {vertex: self.form_rate(vertex, self.extreme.profile) for vertex in product(*entries)}

    def cells(self) -> Iterator[Cell]:
        """All sign patterns on all pieces, each with its best vertex: the lower end where s_i ≥ 0, else the upper."""
        for piece in range(len(self.pieces)):
            for signs in product(*map(self._signs, self.signed_inputs)):
                sign = dict(zip(self.signed_inputs, signs, strict=True))
                vertex = tuple(self._entry(name, sign.get(name, 1)) for name in self.inputs)
                yield Cell(piece, signs, vertex)

    def degrees_of(self, cell: Cell) -> tuple[int, ...]:
        """Of the monomials in its Gram matrices; inside a law's limits both of its boundaries have one."""
        return by_boundary(self.degrees, cell.signs)

    def weight(self, cell: Cell) -> fmpq_mpoly:
        weight, rate = self.pieces[cell.piece].weight.at(self.form), self.form_rates[cell.vertex]
        return self.domain.product(rate.denominator.polynomial, weight) if rate.powers else weight

    def least_weight(self, cell: Cell) -> fmpq:
        return self.pieces[cell.piece].least_weight * self.form_rates[cell.vertex].least_denominator

    def proven_margin(self, proof: CellProof) -> fmpq:
        """As of every program, less what the denominator's own remainder costs."""
        shown, rate = super().proven_margin(proof), self.form_rates[proof.cell.vertex]
        return shown - abs(proof.margin) * rate.denominator.largest_remainder / rate.least_denominator

    def target(self, cell: Cell) -> fmpq_mpoly:
        """p_u − ε(y): a polynomial that is nowhere on the ball above D F_u."""
        demand = self._demand(cell)
        constant, square = self.remainder(cell) if cell.remainder is None else self._stated(cell, cell.remainder)
        return self.domain.negative(self.domain.sum(demand.polynomial, self.norm_squared * square + constant))

    def _demand(self, cell: Cell) -> Enclosure:
        """q̇ + timing u0 at the cell's vertex, enclosed: times the denominator, where there is one."""
        u0 = fmpq(dict(zip(self.inputs, cell.vertex, strict=True))["u0"])
        return (self.form_rates[cell.vertex] + self._timing(self.pieces[cell.piece], u0)).numerator

    def remainder(self, cell: Cell) -> Remainder:
        """e and e' with ε ≤ e + e' |y|² on the ball, as this arithmetic finds them, a little rounded up."""
        # closest at the inner edge, where remainders weigh most against the weight: |y|² is nearly q/peak
        constant, square = self._demand(cell).remainder_bound(sqrt_upper(self.pieces[cell.piece].lower / self.peak))
        return dyadic(constant, up=True), dyadic(square, up=True)

    def _stated(self, cell: Cell, remainder: Remainder) -> Remainder:
        """The bound that a file states.

        Raises:
            ValueError: somewhere on the ball it is below the one that is known.
        """
        least = self.remainder(cell)
        for size in (fmpq(0), self.domain.radius_squared):  # both are affine in |y|²
            if remainder[0] + remainder[1] * size < least[0] + least[1] * size:
                raise ValueError("what the enclosures leave over is more than is stated")
        return remainder

    @cached_property
    def slopes(self) -> dict[str, Quotient]:
        """∂q̇/∂(input i) for each free input at the nominal reference, as the proof has it: without remainders."""
        found = {}
        nominal, profile = self.extreme

        def form_rate(corner: Mapping[str, fmpq | int]) -> Quotient:
            vertex = tuple(corner.values())
            rate = self.form_rates[vertex] if nominal == profile else self.form_rate(vertex, nominal)
            return Quotient(self.domain.exact(rate.numerator.polynomial), rate.powers)

        for name in self.free_inputs:
            lower, upper = self.inputs[name]
            bottom = {label: self._entry(label, 1) for label in self.inputs}
            ends = (form_rate(bottom | {name: end}) for end in (lower, upper))
            low, high = (end * self.number(1 / (upper - lower)) for end in ends)
            found[name] = (high - low).reduced()
        return found

    def authority(self, piece: LevelPiece, name: str) -> fmpq_mpoly:
        """∂(V̇)/∂(input) on a piece, before it is cut; where a denominator is left, times that."""
        slope = self.slopes[name]
        whole = slope + self._timing(piece, fmpq(1)) if name == "u0" else slope
        return whole.numerator.polynomial

    def constraints(self, cell: Cell) -> list[fmpq_mpoly]:
        """Polynomials that are not negative on the cell: ± s_i, or a law's boundaries, q − q_lo, q_hi − q."""
        piece = self.pieces[cell.piece]
        found = []
        for name, sign in zip(self.signed_inputs, cell.signs, strict=True):
            if name in self.limited:
                found += self.limited[name].constraints(sign)
                continue
            most = self._cut_at(name)
            slope = self.authority(piece, name)
            slope = slope if most is None else cut(slope, most)
            found.append(slope if sign > 0 else self.domain.negative(slope))
        return [*found, *self.edges(piece.lower, piece.upper)]


def by_boundary(values: Sequence[int], signs: Sequence[int]) -> tuple[int, ...]:
    """What there is for each Gram matrix of a stretch (Q₀, one for each sign, both ends of a piece), for one cell.

    Inside a law's limits both boundaries count.
    """
    first, *rest = values
    own = [value for value, sign in zip(rest, signs, strict=False) for _ in range(2 if sign == INSIDE else 1)]
    return (first, *own, *rest[len(signs) :])
