"""Condition (d) in exact arithmetic: what has to be shown for one vertex of the input box, and how Gram matrices do.

On a steady segment, with x = W y for a rational whitening W ≈ C^{−1/2} and q = xᵀ C x, the claim "some input gives
V̇ ≤ −λ on the shell" reads (`cfjax.funnel.template`)

    for every y with q ∈ [q_lo, q_hi] there is an input u with   F_u(y) := −(q̇ + timing(q) u0) ≥ λ drop(q).

Along a tube it has to hold at several references (`cfjax.check.tube`), for some of them with the same input at the same
y: these share the s_i below, which are then those of their nominal reference.

The shell is cut at the q where `drop` has its kink, and each piece into the cells of one sign pattern of the
polynomials s_i ≈ ∂(V̇)/∂(input i): whatever the s_i are, their sign cells cover the shell, and on each the proof speaks
of one vertex u of the input box. On a cell

    p_u − ε − λ drop = z₀ᵀ Q₀ z₀ + Σ_i (± s_i) zᵀ Q_i z + (q − q_lo) zᵀ Q_lo z + (q_hi − q) zᵀ Q_hi z + r

where |F_u − p_u| ≤ ε(y) is the enclosure of sin and cos, every Q is positive definite and r, what rounding left over,
is a polynomial. On a ball that holds the funnel |r| ≤ bound, so F_u ≥ λ drop − bound ≥ (λ − bound / least drop) drop.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

from flint import arb, fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from cfjax.check.enclosure import Domain, Enclosure, UnaryEnclosure
from cfjax.check.graph import Graph
from cfjax.check.rational import bits, exp_bounds, is_positive_definite, sqrt_upper, upper_bound


Matrix = Sequence[Sequence[fmpq]]
Exponents = tuple[int, ...]
ApplyFunction = Callable[[int, str, Enclosure], Enclosure]
RADIUS_SLACK = fmpq(1, 1024)  # the ball in y is this much larger than the funnel: W is only nearly C^{−1/2}


@dataclass(frozen=True)
class LevelPiece:
    """A range of q = xᵀ C x and, on it, timing(q) and drop(q) as affine functions (constant, slope)."""

    lower: fmpq
    upper: fmpq
    timing: tuple[fmpq, fmpq]
    drop: tuple[fmpq, fmpq]

    @property
    def least_drop(self) -> fmpq:
        constant, slope = self.drop
        return min(constant + slope * self.lower, constant + slope * self.upper)


def level_bounds(template: str, rate: fmpq, theta: fmpq) -> tuple[fmpq, fmpq]:
    """Rationals below and above ρ(θ), the level of the funnel at θ."""
    if template == "paper":
        return 1 - rate * theta, 1 - rate * theta
    if template == "contracting":
        return exp_bounds(-rate * theta)
    raise ValueError(f"unknown template {template!r}")


class Extreme(NamedTuple):
    """One reference that has to be proven, and the one at which the signs of its cells are read; by profile names."""

    nominal: Mapping[str, fmpq]
    profile: Mapping[str, fmpq]


def level_pieces(
    template: str, rate: fmpq, stretch: tuple[fmpq, fmpq], beta_lower: fmpq, beta_inner: fmpq
) -> list[LevelPiece]:
    """The shell β_in ≤ V ≤ 1 on a stretch of θ, θ itself eliminated: ranges of q that cover it; β_in ≤ β̲.

    Raises:
        ValueError: where the shell would hold the reference itself (q = 0).
    """
    (first_low, first_high), (last_low, last_high) = (level_bounds(template, rate, theta) for theta in stretch)
    zero, one = fmpq(0), fmpq(1)
    peak = max(first_high, last_high)
    if template == "paper":
        change = 1 - min(first_low, last_low)
        start, kink = beta_inner - change, beta_lower - change
        timing, rising, flat = (rate, zero), (change / beta_lower, 1 / beta_lower), (one, zero)
    else:
        start, kink = beta_inner * min(first_low, last_low), beta_lower * peak
        timing, rising, flat = (zero, rate), (zero, 1 / beta_lower), (peak, zero)
    pieces = [LevelPiece(kink, peak, timing, flat)]
    if start < kink:
        pieces.insert(0, LevelPiece(start, kink, timing, rising))
    if pieces[0].lower <= 0:
        raise ValueError("the shell reaches the reference: c0 T has to stay below the shell's inner level")
    return pieces


def contraction_way(beta_lower: fmpq, beta_inner: fmpq) -> fmpq:
    """By how much λ t has to grow until V ≤ 1 has become V ≤ β_in: a rational that is at least that.

    V̇ ≤ −λ down to β̲, then V̇ ≤ −λ V/β̲: 1 − β̲ + β̲ ln(β̲/β_in).
    """
    return 1 - beta_lower + beta_lower * upper_bound(arb(beta_lower / beta_inner).log())


@dataclass(frozen=True)
class Cell:
    """One sign pattern on one range of q: the signs of the s_i (in the order of the free inputs) and the vertex u."""

    piece: int
    signs: tuple[int, ...]
    vertex: tuple[fmpq, ...]


@dataclass(frozen=True)
class CellProof:
    """Margin and Gram matrices for one cell: Q₀ first, then one per sign, then q_lo and q_hi."""

    cell: Cell
    margin: fmpq
    grams: tuple[Matrix, ...]


@dataclass(frozen=True)
class SteadyDecrease:
    """Condition (d) at one reference that does not depend on θ; everything is rational.

    `extreme` gives the reference's constants by the graph's input names, `inputs` the box by input name (u0 first),
    `enclosures` one `UnaryEnclosure` per node of the graph that applies a function.
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

    @cached_property
    def ring(self) -> fmpq_mpoly_ctx:
        return fmpq_mpoly_ctx.get([f"y{k}" for k in range(len(self.states))], "degrevlex")

    @cached_property
    def bases(self) -> tuple[tuple[Exponents, ...], ...]:
        """Exponents of the monomials z of each Gram matrix."""
        return tuple(monomials(len(self.states), degree) for degree in self.degrees)

    @cached_property
    def deviations(self) -> list[fmpq_mpoly]:
        """x = W y."""
        y = self.ring.gens()
        return [sum((w * yk for w, yk in zip(row, y, strict=True)), self.ring.constant(0)) for row in self.whitening]

    @cached_property
    def covector(self) -> list[fmpq_mpoly]:
        """∇q = 2 C x."""
        return [
            sum((2 * c * x for c, x in zip(row, self.deviations, strict=True)), self.ring.constant(0))
            for row in self.shape
        ]

    @cached_property
    def form(self) -> fmpq_mpoly:
        """q = xᵀ C x as a polynomial in y."""
        half = fmpq(1, 2)
        pairs = zip(self.deviations, self.covector, strict=True)
        return sum((half * x * g for x, g in pairs), self.ring.constant(0))

    @cached_property
    def peak(self) -> fmpq:
        """The largest level of the funnel on the stretch."""
        return max(piece.upper for piece in self.pieces)

    @cached_property
    def domain(self) -> Domain:
        """The ball |y|² ≤ 1 + slack, which holds {q ≤ peak}: proven, for W is only nearly (C/peak)^{−1/2}."""
        radius_squared = 1 + RADIUS_SLACK
        size = len(self.states)
        w, c = self.whitening, self.shape
        scaled = [
            [
                sum((w[k][i] * c[k][m] * w[m][j] for k in range(size) for m in range(size)), fmpq(0)) * radius_squared
                - (self.peak if i == j else 0)
                for j in range(size)
            ]
            for i in range(size)
        ]
        if not is_positive_definite(scaled):
            raise ValueError("the whitening is not close enough to (C/peak)^{-1/2}, or C is not positive definite")
        return Domain(self.ring, radius_squared)

    def rates(
        self, inputs: Mapping[str, fmpq], function: ApplyFunction, profile: Mapping[str, fmpq] | None = None
    ) -> list[Enclosure]:
        """The deviation's rate ẋ at constant inputs; `function(node, name, argument)` encloses a function's value."""
        profile = self.extreme.profile if profile is None else profile
        values = {name: self.domain.exact(x) for name, x in zip(self.states, self.deviations, strict=True)}
        values |= {f"reference:{name}": self.domain.constant(value) for name, value in profile.items()}
        values |= {f"input:{name}": self.domain.constant(value) for name, value in inputs.items()}
        return self.graph.evaluate(values, self.domain.constant, function)

    def form_rate(self, inputs: Mapping[str, fmpq], profile: Mapping[str, fmpq]) -> Enclosure:
        """q̇ = ∇q · f(x, u) at constant inputs."""
        rates = self.rates(inputs, lambda node, _, argument: argument.apply(self.enclosures[node]), profile)
        total = self.domain.constant(fmpq(0))
        for gradient, rate in zip(self.covector, rates, strict=True):
            total = total + self.domain.exact(gradient) * rate
        return total

    @cached_property
    def free_inputs(self) -> tuple[str, ...]:
        """Inputs with room to move; u0 of trajectory tracking has none."""
        return tuple(name for name, (lower, upper) in self.inputs.items() if lower < upper)

    @cached_property
    def form_rates(self) -> dict[tuple[fmpq, ...], Enclosure]:
        """q̇ at every vertex of the input box."""
        corners = product(*(sorted({lower, upper}) for lower, upper in self.inputs.values()))
        profile = self.extreme.profile
        return {corner: self.form_rate(dict(zip(self.inputs, corner, strict=True)), profile) for corner in corners}

    def cells(self) -> Iterator[Cell]:
        """All sign patterns on all pieces, each with its best vertex: the lower end where s_i ≥ 0, else the upper."""
        for piece in range(len(self.pieces)):
            for signs in product((1, -1), repeat=len(self.free_inputs)):
                sign = dict(zip(self.free_inputs, signs, strict=True))
                vertex = tuple(
                    upper if sign.get(name, 1) < 0 else lower for name, (lower, upper) in self.inputs.items()
                )
                yield Cell(piece, signs, vertex)

    def timing(self, piece: LevelPiece) -> fmpq_mpoly:
        return piece.timing[0] + piece.timing[1] * self.form

    def drop(self, piece: LevelPiece) -> fmpq_mpoly:
        return piece.drop[0] + piece.drop[1] * self.form

    def target(self, cell: Cell) -> fmpq_mpoly:
        """p_u − ε(y): a polynomial that is nowhere on the ball above F_u."""
        rate = self.form_rates[cell.vertex]
        u0 = dict(zip(self.inputs, cell.vertex, strict=True))["u0"]
        piece = self.pieces[cell.piece]
        # closest at the inner edge, where remainders weigh most against the drop: |y|² is nearly q/peak
        remainder = rate.remainder_polynomial(sqrt_upper(piece.lower / self.peak))
        demand = self.domain.sum(rate.polynomial, self.timing(piece) * u0)
        return self.domain.negative(self.domain.sum(demand, remainder))

    @cached_property
    def slopes(self) -> dict[str, fmpq_mpoly]:
        """∂q̇/∂(input i) for each free input at the nominal reference, as the proof has it."""
        found = {}
        nominal, profile = self.extreme

        def form_rate(corner: Mapping[str, fmpq]) -> fmpq_mpoly:
            if nominal == profile:
                return self.form_rates[tuple(corner.values())].polynomial
            return self.form_rate(corner, nominal).polynomial

        for name in self.free_inputs:
            lower, upper = self.inputs[name]
            bottom = {label: low for label, (low, _) in self.inputs.items()}
            ends = (form_rate(bottom | {name: end}) for end in (lower, upper))
            low, high = (self.domain.product(end, self.ring.constant(1 / (upper - lower))) for end in ends)
            found[name] = self.domain.sum(high, self.domain.negative(low))
        return found

    def constraints(self, cell: Cell) -> list[fmpq_mpoly]:
        """Polynomials that are not negative on the cell: ± s_i, q − q_lo, q_hi − q."""
        piece = self.pieces[cell.piece]
        found = []
        for name, sign in zip(self.free_inputs, cell.signs, strict=True):
            slope = self.slopes[name]
            if name == "u0":
                slope = self.domain.sum(slope, self.timing(piece))
            found.append(slope if sign > 0 else self.domain.negative(slope))
        return [*found, self.form - piece.lower, piece.upper - self.form]

    def proven_margin(self, proof: CellProof) -> fmpq:
        """The λ that the proof shows on its cell: its margin less what the leftover r costs.

        On the cell the identity gives F_u ≥ margin · drop − |r|, and |r| ≤ bound ≤ (bound / least drop) · drop.

        Raises:
            ValueError: names what is not as it has to be.
        """
        cell, piece = proof.cell, self.pieces[proof.cell.piece]
        left = self.domain.sum(self.target(cell), -proof.margin * self.drop(piece))
        factors = [self.ring.constant(1), *self.constraints(cell)]
        if len(proof.grams) != len(factors) or len(self.degrees) != len(factors):
            raise ValueError(f"expected {len(factors)} Gram matrices, got {len(proof.grams)}")
        for index, (factor, gram, basis) in enumerate(zip(factors, proof.grams, self.bases, strict=True)):
            if len(gram) != len(basis):
                raise ValueError(f"Gram matrix {index} has {len(gram)} rows, expected {len(basis)}")
            longest = max(
                bits(entry) for i, row in enumerate(gram) for entry in row[: i + 1]
            )  # the elimination's numbers grow row by row
            self.domain.budget.spend(len(basis) ** 3 * (1 + len(basis) * longest // 2048))
            if not is_positive_definite(gram):
                raise ValueError(f"Gram matrix {index} is not positive definite")
            square = self.domain.product(factor, quadratic_form(self.ring, gram, basis))
            left = self.domain.sum(left, self.domain.negative(square))
        return proof.margin - self.domain.bound(left) / piece.least_drop


def monomials(variables: int, degree: int) -> tuple[Exponents, ...]:
    """Exponents of all monomials up to the degree: by degree, then descending in the first variable, and so on."""
    every = (e for e in product(range(degree + 1), repeat=variables) if sum(e) <= degree)
    return tuple(sorted(every, key=lambda e: (sum(e), tuple(-k for k in e))))


def quadratic_form(ring: fmpq_mpoly_ctx, gram: Matrix, basis: Sequence[Exponents]) -> fmpq_mpoly:
    """zᵀ Q z for the monomials z with the exponents in `basis`."""
    terms: dict[Exponents, fmpq] = {}
    for i, first in enumerate(basis):
        for j in range(i + 1):
            exponents = tuple(a + b for a, b in zip(first, basis[j], strict=True))
            value = gram[i][j] if i == j else 2 * gram[i][j]
            terms[exponents] = terms.get(exponents, fmpq(0)) + value
    return ring.from_dict(terms)
