"""The inequalities that holds have to satisfy on each range of q = xᵀ C x, and their polynomials.

θ is eliminated as in `cfcheck.kernel.level`: ranges of q cover the funnel, and weight(q) is at least e^{−kθ} wherever a
claim is made. Claims are those of `cfcheck.robustness.sampled`, divided by e^{kθ}.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import factorial
from types import MappingProxyType
from typing import NamedTuple

from flint import fmpq, fmpq_mpoly

from cfcheck.exact.enclosure import Enclosure, UnaryEnclosure
from cfcheck.exact.rational import Matrix, Range, sqrt_upper
from cfcheck.exact.symbolic import Symbolic
from cfcheck.kernel.funnel import FunnelClaim
from cfcheck.kernel.level import ONE, ZERO, Affine, Contracting, LevelPiece
from cfcheck.kernel.program import FunnelProgram, monomials
from cfcheck.reader import Broken
from cfcheck.robustness.derivatives import SteadyLeg, control_points, derivatives
from cfcheck.robustness.parametric import Combination, Parametric


DEGREES = (3, 2)  # of the monomials in Gram matrices of a leaf: of the free square, and of forks and the range
BEND_DEGREES = (2, 1)  # of a bound on V^(m+1)
FORK_DEGREE = 2  # of the polynomials at forks
ORDERS = (2, 3)
BEND = -1  # in place of the number of a Bernstein coefficient: the claim on V^(m+1)
RISE = 0  # likewise, for a cell that is of no part: the claim on V', which is B_0

Coefficients = tuple[fmpq, ...]
Inputs = tuple[fmpq, ...]  # in the order of the problem's


@dataclass(frozen=True)
class StartUp:
    """What a car does whose first pose comes up to `delay` (s) late: until then it holds the input number `choice`.

    Under it V' is at most `rise` (1/s) wherever V ≤ 1.
    """

    delay: fmpq
    choice: int
    rise: fmpq

    @property
    def level(self) -> fmpq:
        """From V at most this on V is below 1 until the first pose is there."""
        return 1 - self.delay * self.rise


@dataclass(frozen=True)
class SampledClaim:
    """What is stated of holds of up to `period` (s): one of `choices` does it, and V falls at `decrease` (1/s).

    `bends` has R_u (1/s^{m+1}) for each of the choices, m being the `order`.
    """

    period: fmpq
    order: int
    decrease: fmpq
    choices: tuple[Inputs, ...]
    bends: tuple[fmpq, ...]
    cuts: tuple[fmpq, ...]  # between which ranges of q the proof is put together
    start_up: StartUp | None = None  # where poses are late

    def left_out(self, choice: int) -> fmpq:
        """ρ, 1/s."""
        return self.period**self.order / factorial(self.order + 1) * self.bends[choice]

    def need(self, part: "Part", choice: int, j: int) -> fmpq:
        """By how many drops −B_j + slack has to be above zero, 1/s."""
        decrease = self.decrease if part.is_shell else fmpq(0)
        return decrease + (self.left_out(choice) if j == self.order - 1 else 0)


class Part(NamedTuple):
    """An inequality on a range: −B_j + slack ≥ need weight, slack and weight affine in q (`SampledClaim.need`)."""

    slack: Affine
    weight: Affine
    is_shell: bool


class LevelRange(NamedTuple):
    """A range of q; its `weight` is at most 1/σ on V ≤ 1, which bounds of V^(m+1) need."""

    piece: LevelPiece
    parts: tuple[Part, ...]


def ranges(funnel: FunnelClaim, span: Range, claim: SampledClaim) -> list[LevelRange]:
    """Ranges of q that cover the funnel while θ is in the span, with their inequalities; one of them in pieces.

    Inside, where V ≤ β̲, 1/σ is at least `room`. There B_j ≤ (1/σ − q)/h − ρ/σ has to hold, ρ for the last j alone:
    where ρ ≤ 1/h it is worst where 1/σ is least.

    Raises:
        Broken: for a V of another template, or cuts that do not follow each other where V may be β̲.
    """
    level, beta = funnel.level, funnel.beta_lower
    if not isinstance(level, Contracting):
        raise Broken("sampled: expected a V of the template contracting")
    least, peak = level.extent(span)
    timing = Affine(ZERO, level.rate)
    ends = beta * least, *claim.cuts, beta * peak
    if any(lower >= upper for lower, upper in pairwise(ends)):
        raise Broken("sampled: the cuts do not follow each other in the range that they cut")
    rising, itself = Affine(ZERO, 1 / beta), Affine(ZERO, ONE)

    def inside(room: Affine) -> Part:
        slack = Affine(room.constant / claim.period, (room.slope - 1) / claim.period)
        return Part(slack, room, is_shell=False)

    def shell(weight: Affine) -> Part:
        return Part(Affine(ZERO, ZERO), weight, is_shell=True)

    middle = (LevelRange(LevelPiece(*each, timing, itself), (inside(rising), shell(rising))) for each in pairwise(ends))
    return [
        LevelRange(LevelPiece(ZERO, beta * least, timing, Affine(least, ZERO)), (inside(Affine(least, ZERO)),)),
        *middle,
        LevelRange(LevelPiece(beta * peak, peak, timing, itself), (shell(Affine(peak, ZERO)),)),
    ]


class HoldCell(NamedTuple):
    """One of the values of a range at an input, where polynomials are not negative: B_j of a part, V' or P_{m+1}."""

    value: int  # j, RISE or BEND
    choice: int
    part: Part | None = None
    forks: tuple[fmpq_mpoly, ...] = ()


@dataclass(frozen=True)
class HeldRange(FunnelProgram):
    """Polynomials in y, x = W y, on one range of q, and what is claimed there.

    A cell of P_{m+1} has margin −R_u, one of V' minus a bound of V' on V ≤ 1.

    `values` are B_0 … B_{m−1} and P_{m+1}, in the symbols of `dynamics`.
    """

    dynamics: Symbolic
    values: Sequence[fmpq_mpoly]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    choices: tuple[Inputs, ...]
    shape: Matrix  # C
    whitening: Matrix
    piece: LevelPiece
    enclosures: Mapping[int, UnaryEnclosure]

    @property
    def peak(self) -> fmpq:
        return self.piece.upper

    @cached_property
    def functions(self) -> dict[int, Enclosure]:
        """Each function that the dynamics apply, by its generator's number."""
        found: dict[int, Enclosure] = {}
        for number, (index, (_, argument)) in enumerate(self.dynamics.functions.items()):
            found[index] = self.argument(argument, found).apply(self.enclosures[number])
        return found

    def argument(self, value: fmpq_mpoly, functions: Mapping[int, Enclosure] = MappingProxyType({})) -> Enclosure:
        """A polynomial in states, and in functions that are enclosed already."""
        return self._enclosed(value, functions).constant

    @cached_property
    def enclosed(self) -> list[Parametric]:
        """The values, inputs being parameters."""
        return [self._enclosed(value, self.functions) for value in self.values]

    def _enclosed(self, value: fmpq_mpoly, functions: Mapping[int, Enclosure]) -> Parametric:
        """A polynomial in states, inputs and functions, inputs being parameters."""
        names = self.dynamics.names
        count = len(self.states)
        gathered: dict[tuple[int, ...], dict[tuple[int, ...], fmpq]] = {}
        for exponents, coefficient in value.to_dict().items():
            powers = tuple(map(int, exponents))
            gathered.setdefault(powers[count:], {})[powers[:count]] = coefficient
        total = Parametric(self.domain, {})
        for powers, terms in gathered.items():
            factor = self.domain.exact(self._in_deviations(terms))
            parameters: list[str] = []
            for index, power in enumerate(powers, count):
                for _ in range(power):
                    if index < len(names):
                        parameters.append(names[index])
                    else:
                        factor = factor * functions[index]
            total += Parametric(self.domain, {tuple(parameters): factor})
        return total

    def _in_deviations(self, terms: Mapping[tuple[int, ...], fmpq], state: int = 0) -> fmpq_mpoly:
        """Σ c x^e as a polynomial in y, by Horner's rule: in this state, then in the next one."""
        if state == len(self.states):
            return self.ring.constant(sum(terms.values(), fmpq(0)))
        by_power: dict[int, dict[tuple[int, ...], fmpq]] = {}
        for exponents, coefficient in terms.items():
            by_power.setdefault(exponents[state], {})[exponents] = coefficient
        result = self.ring.constant(0)
        for power in range(max(by_power), -1, -1):
            result = self.domain.product(result, self.deviations[state])
            if power in by_power:
                result = self.domain.sum(result, self._in_deviations(by_power[power], state + 1))
        return result

    def at(self, value: int, choice: int) -> Combination:
        """One of the values at one of the inputs."""
        names = (f"input:{name}" for name in self.inputs)
        return self.enclosed[value].at(dict(zip(names, self.choices[choice], strict=True)))

    def upper(self, value: int, choice: int, most: int) -> fmpq_mpoly:
        """A polynomial of degree `most` that is nowhere on the range below one of the values."""
        rate, radius = self.at(value, choice), self.domain.radius
        constant, linear, square = rate.remainder
        square += sum((c * radius ** (d - 2) for d, c in enumerate(rate.sizes(above=most)) if d > most), fmpq(0))
        lower = self.piece.lower
        # closest at the inner edge, where remainders weigh most: |y|² is nearly q/peak
        around = sqrt_upper(lower / self.peak) if lower else fmpq(1)
        left = Enclosure(self.domain, self.ring.constant(0), (constant, linear, square)).remainder_bound(around)
        return self.domain.sum(rate.polynomial(most), self.norm_squared * left[1] + left[0])

    def fork(self, coefficients: Coefficients) -> fmpq_mpoly:
        """The polynomial at a fork."""
        names = monomials(len(self.states), FORK_DEGREE)
        return self.ring.from_dict({e: c for e, c in zip(names, coefficients, strict=True) if c})

    # --- claims

    def cells(self) -> Iterator[HoldCell]:
        """Those of R_u; what leaves there are a tree says."""
        for choice in range(len(self.choices)):
            yield HoldCell(BEND, choice)

    def degrees_of(self, cell: HoldCell) -> tuple[int, ...]:
        square, other = DEGREES if cell.part else BEND_DEGREES
        return square, *[other] * len(self.constraints(cell))

    def target(self, cell: HoldCell) -> fmpq_mpoly:
        most = self.domain.negative(self.upper(cell.value, cell.choice, 2 * self.degrees_of(cell)[0]))
        return self.domain.sum(cell.part.slack.at(self.form), most) if cell.part else most

    def weight(self, cell: HoldCell) -> fmpq_mpoly:
        return (cell.part or self.piece).weight.at(self.form)

    def least_weight(self, cell: HoldCell) -> fmpq:
        return (cell.part or self.piece).weight.least(self.piece.lower, self.piece.upper)

    def constraints(self, cell: HoldCell) -> list[fmpq_mpoly]:
        return [*cell.forks, *self.edges(self.piece.lower, self.piece.upper)]


def span_of(leg: SteadyLeg, period: fmpq) -> Range:
    """θ at which a car may be within a hold that began on the leg; of a lap, beyond its end too."""
    return fmpq(0), leg.duration + (leg.inputs["u0"][1] * period if leg.gap else 0)


def held_ranges(leg: SteadyLeg, claim: SampledClaim) -> Iterator[tuple[HeldRange, tuple[Part, ...]]]:
    """The ranges of q without hints yet, with the parts of each.

    Raises:
        Broken, ValueError: as `derivatives` and `ranges`.
    """
    each = derivatives(leg, claim.order + 1)
    values = [*control_points(each[:-1], claim.period), each[-1]]
    for piece, parts in ranges(leg.funnel, span_of(leg, claim.period), claim):
        held = HeldRange(
            dynamics=leg.dynamics,
            values=values,
            states=leg.states,
            inputs=tuple(leg.inputs),
            choices=claim.choices,
            shape=leg.funnel.shape,
            whitening=[],
            piece=piece,
            enclosures={},
        )
        yield held, parts
