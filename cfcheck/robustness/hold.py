"""What V does while inputs are held: how fast it can rise, and how fast its rate can, anywhere in a funnel.

A car in V ≤ 1 holds inputs u, any of the box, while θ and its deviation x move on beside a reference r(θ). On a stretch

    V̇ = ∂V/∂θ u0 + ∇V·f(x, u, r),        V̈ = dV̇/dt along that motion.

With σ(θ) = e^{kθ} for V = e^{kθ} xᵀCx, and 1 for the other template, both are σ(θ) times a function of x, u and r. They
stay below B wherever that function stays below B/σ(θ), and 1/σ(θ) ≥ max(q, ρ) for q = xᵀCx, ρ the least level of the
stretch: θ is eliminated. (B is not negative.)

The dynamics are affine in each input, and in the reference's turning rate and its slope, speed and acceleration one by
one. V̇ is so too, and its largest value is at a vertex of the box of these **parameters**. V̈ is quadratic in each of
them, and at most `spare` above its values at the vertices; `cfcheck.robustness.spare` says how much that is.

Where the reference may jump at any time, as in a tube, V̇ at a reference r' that stays is looked at while the car moves
beside any other, r: d/dt (∇V·f(x, u, r')) = 2 f(r)ᵀ C f(r') + ∇V·(∂f(r')/∂x) f(r). Turning rate and acceleration of r'
are parameters of their own then (`frozen:…`), and it is affine in each of the four.

Both are polynomials in the parameters whose coefficients are computed once (`cfcheck.robustness.parametric`).
That B is a bound at a vertex is shown by sums of squares (`cfcheck.kernel.program`), with q_lo ≤ q ≤ q_hi as
constraints.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

from flint import fmpq, fmpq_mpoly

from cfcheck.exact.enclosure import Enclosure, UnaryEnclosure
from cfcheck.exact.graph import Graph
from cfcheck.exact.rational import Matrix, Range, sqrt_upper
from cfcheck.exact.symbolic import DERIVATIVES
from cfcheck.kernel.level import LevelPiece
from cfcheck.kernel.program import FunnelProgram
from cfcheck.robustness.parametric import Combination, Parametric, Point


ApplyFunction = Callable[[int, str, Enclosure], Enclosure]
TIMING = "input:u0"
REFERENCE, FROZEN = (
    "reference:",
    "frozen:",
)  # r, and r' where it is another
ORDERS = (1, 2)  # V̇, V̈


def frozen_name(name: str) -> str:
    """The parameter that stands for a reference's where V̇ is looked at."""
    return name.replace(REFERENCE, FROZEN)


def derivatives_of(graph: Graph, states: Sequence[str]) -> dict[int, str]:
    """The nodes that apply a function to what changes with the states, and whose derivative takes another function."""
    others = {node: DERIVATIVES[function].other for node, function in graph.functions_of(states).items()}
    return {node: other for node, other in others.items() if other}


class HeldCell(NamedTuple):
    """The `order`-th derivative of V at one vertex of the parameters' box, by its number."""

    order: int
    vertex: int


class Differentiated:
    """A value and its slopes by several variables; enough of arithmetic to evaluate a graph."""

    def __init__(self, value: Parametric, slopes: Mapping[int, Parametric]) -> None:
        self.value, self.slopes = value, slopes  # by the number of the variable; those that are not there are zero

    def __add__(self, other: "Differentiated") -> "Differentiated":
        return Differentiated(self.value + other.value, _sum(self.slopes, other.slopes))

    def __sub__(self, other: "Differentiated") -> "Differentiated":
        return self + -other

    def __neg__(self) -> "Differentiated":
        return Differentiated(-self.value, {index: -slope for index, slope in self.slopes.items()})

    def __mul__(self, other: "Differentiated") -> "Differentiated":
        return Differentiated(self.value * other.value, _sum(self.times(other.value), other.times(self.value)))

    def times(self, factor: Parametric) -> dict[int, Parametric]:
        """The slopes times a factor."""
        return {index: slope * factor for index, slope in self.slopes.items()}


def _sum(first: Mapping[int, Parametric], second: Mapping[int, Parametric]) -> dict[int, Parametric]:
    total = dict(first)
    for index, slope in second.items():
        total[index] = total[index] + slope if index in total else slope
    return total


@dataclass(frozen=True)
class HeldMotion(FunnelProgram):
    """V̇ and V̈ with parameters held, on one range of levels; what is proven is −B as a margin.

    `parameters` is the box by the graph's names (`input:…`, `reference:…`); `spare` is what V̈/σ may be above its
    largest value at a vertex (`cfcheck.robustness.spare`).
    Of the parameter `mirrored`, where one is named, the upper end speaks for the lower one.
    `enclosures` has an entry for each node of the graph that applies a function, `derivatives` one for the function
    that its derivative takes beside it (`derivatives_of`).
    """

    graph: Graph
    states: tuple[str, ...]
    parameters: Mapping[str, Range]
    spare: fmpq
    shape: Matrix  # C
    whitening: Matrix  # W ≈ (C/q_hi)^{−1/2}
    piece: LevelPiece
    enclosures: Mapping[int, UnaryEnclosure]
    derivatives: Mapping[int, UnaryEnclosure]
    degrees: tuple[int, ...]
    mirrored: str = ""

    @property
    def peak(self) -> fmpq:
        return self.piece.upper

    @cached_property
    def varying(self) -> tuple[str, ...]:
        return tuple(name for name, (lower, upper) in self.parameters.items() if lower < upper)

    @cached_property
    def vertices(self) -> tuple[dict[str, fmpq], ...]:
        """All parameters at each vertex of their box, or of the half of it that speaks for the other one."""
        fixed = {name: lower for name, (lower, _) in self.parameters.items()}
        ends = ((name, self.parameters[name]) for name in self.varying)
        corners = product(*(limits[1:] if name == self.mirrored else limits for name, limits in ends))
        return tuple(fixed | dict(zip(self.varying, corner, strict=True)) for corner in corners)

    def cells(self) -> Iterator[HeldCell]:
        for vertex in range(len(self.vertices)):
            for order in self.orders(vertex):
                yield HeldCell(order, vertex)

    def orders(self, vertex: int) -> tuple[int, ...]:
        """What is bounded there: of V̇ nothing new where it is looked at beside another reference."""
        at = self.vertices[vertex]
        return ORDERS if self.frozen(at) == at else ORDERS[1:]

    @staticmethod
    def frozen(at: Point) -> Point:
        """The parameters at which V̇ is looked at."""
        return {name: at.get(frozen_name(name), value) for name, value in at.items()}

    # --- the motion, in parameters

    def rates(self, at: Point, function: ApplyFunction) -> list[Enclosure]:
        """ẋ = f(x, u, r) at given parameters; `function(node, name, argument)` encloses a function's value."""
        values = {name: self.domain.exact(x) for name, x in zip(self.states, self.deviations, strict=True)}
        values |= {name: self.domain.constant(value) for name, value in at.items()}
        return self.graph.evaluate(values, self.domain.constant, function)

    @cached_property
    def _duals(self) -> list[Differentiated]:
        """ẋ with ∂ẋ/∂x."""
        values = {name: Differentiated(self._parameter(name), {}) for name in self.parameters}
        for index, (name, x) in enumerate(zip(self.states, self.deviations, strict=True)):
            values[name] = Differentiated(self._exact(x), {index: self._exact(self.ring.constant(1))})
        return self.graph.evaluate(
            values, lambda value: Differentiated(self._exact(self.ring.constant(value)), {}), self._apply
        )

    def _exact(self, polynomial: fmpq_mpoly) -> Parametric:
        return Parametric.free(self.domain.exact(polynomial))

    def _parameter(self, name: str) -> Parametric:
        lower, upper = self.parameters[name]
        return Parametric.parameter(self.domain, name) if lower < upper else self._exact(self.ring.constant(lower))

    def _apply(self, node: int, function: str, argument: Differentiated) -> Differentiated:
        value = argument.value.constant.apply(self.enclosures[node])
        if not argument.slopes:
            return Differentiated(Parametric.free(value), {})
        derivative = DERIVATIVES[function]
        other = argument.value.constant.apply(self.derivatives[node]) if derivative.other else value
        return Differentiated(Parametric.free(value), argument.times(Parametric.free(derivative.of(value, other))))

    @cached_property
    def moved(self) -> list[Parametric]:
        """ẋ."""
        return [dual.value for dual in self._duals]

    @cached_property
    def _timing(self) -> Parametric:
        """k u0: how fast V/σ changes by σ alone, over V/σ, where V has a rate of its own."""
        return self._exact(self.ring.constant(self.piece.timing.slope)) * self._parameter(TIMING)

    @cached_property
    def uphill(self) -> Parametric:
        """q̇."""
        each = zip(self.covector, self.moved, strict=True)
        return self._total(self._exact(gradient) * rate for gradient, rate in each)

    @cached_property
    def first(self) -> Parametric:
        """V̇/σ."""
        timing = self._exact(self.piece.timing.at(self.form)) * self._parameter(TIMING)
        return self.uphill + timing

    @cached_property
    def slopes(self) -> list[Parametric]:
        """∂(V̇/σ)/∂x."""
        nothing = Parametric(self.domain, {})
        found = []
        for i, (row, gradient) in enumerate(zip(self.shape, self.covector, strict=True)):
            bend = (self._exact(self.ring.constant(2 * c)) * rate for c, rate in zip(row, self.moved, strict=True))
            steered = (
                self._exact(each) * dual.slopes.get(i, nothing)
                for each, dual in zip(self.covector, self._duals, strict=True)
            )
            found.append(self._total(steered) + self._total(bend) + self._timing * self._exact(gradient))
        return found

    @cached_property
    def second(self) -> Parametric:
        """V̈/σ beside references that stay as they are: k u0 (q̇ + k u0 q) + ẋ·∂(V̇/σ)/∂x."""
        frozen = {name: frozen_name(name) for name in self.parameters if frozen_name(name) in self.parameters}
        along = (rate * slope.renamed(frozen) for rate, slope in zip(self.moved, self.slopes, strict=True))
        return self._total(along) + self._timing * (self.uphill + self._timing * self._exact(self.form))

    def _total(self, each: Iterable[Parametric]) -> Parametric:
        return sum(each, Parametric(self.domain, {}))

    # --- sizes, at a vertex, by its number

    def steepness(self, vertex: int) -> list[fmpq]:
        """|∂V̇/∂x_i| over V ≤ 1, at most; term by term."""
        return [self._weighted(slope.at(self.vertices[vertex])) for slope in self.slopes]

    def swiftness(self, vertex: int) -> fmpq:
        """|V̇| over this range of levels, at most; term by term."""
        return self._weighted(self.first.at(self.vertices[vertex]))

    def speeds(self, vertex: int) -> list[fmpq]:
        """|ẋ_i| over this range of levels, at most; term by term."""
        return [sum(self._powers(rate.at(self.vertices[vertex])), fmpq(0)) for rate in self.moved]

    def _powers(self, value: Combination) -> list[fmpq]:
        """Rationals c_d with |value| ≤ Σ c_d (q/q_hi)^{d/2}: |y|² ≤ r² q/q_hi, as `domain` has proven."""
        sizes = value.sizes()
        sizes += [fmpq(0)] * (len(value.remainder) - len(sizes))
        for degree, size in enumerate(value.remainder):
            sizes[degree] += size
        return [size * self.domain.radius**degree for degree, size in enumerate(sizes)]

    def _weighted(self, value: Combination) -> fmpq:
        """σ |value| over this range of levels, at most: σ ≤ 1/weight."""
        powers, piece = self._powers(value), self.piece
        if not piece.weight.slope:
            return sum(powers, fmpq(0)) / piece.weight.constant
        # weight = q: (q/q_hi)^{d/2}/q is largest at q_hi from d = 2 on, at q_lo before
        ratio = sqrt_upper(piece.lower / piece.upper)
        inner = sum((c * ratio**degree for degree, c in enumerate(powers[:2])), fmpq(0))
        return inner / piece.lower + sum(powers[2:], fmpq(0)) / piece.upper

    # --- claims

    @cached_property
    def _targets(self) -> dict[HeldCell, fmpq_mpoly]:
        return {}

    def target(self, cell: HeldCell) -> fmpq_mpoly:
        """−V̇/σ or −V̈/σ, less all that its polynomial leaves out."""
        if cell not in self._targets:
            self._targets[cell] = self._target(cell)
        return self._targets[cell]

    def _target(self, cell: HeldCell) -> fmpq_mpoly:
        rate = (self.first if cell.order == 1 else self.second).at(self.vertices[cell.vertex])
        most = 2 * self.degrees[0]  # what the squares can match; the rest is bounded
        powers = (size * self.domain.radius**degree for degree, size in enumerate(rate.sizes(above=most)))
        left_out = rate.largest_remainder + sum(powers, fmpq(0))
        left_out += self.spare if cell.order == 2 else 0
        return self.domain.negative(rate.polynomial(most)) - left_out

    def weight(self, cell: HeldCell) -> fmpq_mpoly:
        return self.piece.weight.at(self.form)

    def least_weight(self, cell: HeldCell) -> fmpq:
        return self.piece.least_weight

    def constraints(self, cell: HeldCell) -> list[fmpq_mpoly]:
        return self.edges(self.piece.lower, self.piece.upper)
