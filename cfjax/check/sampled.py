"""Inputs chosen from a finite set for a whole hold: that for every deviation one of them brings V down, proven.

A car of a steady segment holds inputs u from s = 0 on. As long as V ≤ 1, by Taylor's theorem

    V(s) = V + s (V' + s/2 V'' + … + s^{m−1}/m! V^(m)) + s^{m+1}/(m+1)! V^(m+1)(somewhere on the way),

all derivatives along this u. The bracket is a polynomial of degree m − 1 in s. On 0 ≤ s ≤ h it is at most the largest
of its Bernstein coefficients B_0 … B_{m−1}, and what is left out is at most s ρ, ρ = h^m/(m+1)! R, where **R_u** bounds
V^(m+1) on V ≤ 1 at this u; with (s/h)^m ≤ (s/h)^{m−1}, ρ is added to B_{m−1} alone. So V(s) ≤ V + s max_j B_j for every
s ≤ h. What has to be shown is that for every deviation some u of the set has

    on the shell β̲ ≤ V ≤ 1:   B_j ≤ −λ',           and inside it, V ≤ β̲:   B_j ≤ (1 − V)/h          for every j.

Then V never rises above 1, and on the shell it falls at λ' from one choice to the next, however long each hold is.

For V = e^{kθ} q the derivatives are e^{kθ} P_n with P_0 = q and P_{n+1} = ∇P_n · f + k u0 P_n: exact polynomials in
states, inputs and the sines of states. θ is eliminated as in `cfjax.check.level`: ranges of q = xᵀ C x cover the
funnel, and drop(q) is at least e^{−kθ} wherever the claim is made.

**The cut.** Where some input does it, a tree says: each fork holds a polynomial, and the deviations where it is not
negative go one way, all others the other way. Whatever the polynomials are, the leaves cover the range. A leaf names
one input, and sums of squares show B_j there (`cfjax.check.program`), with the forks on the way as constraints.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import pairwise
from math import comb, factorial
from types import MappingProxyType
from typing import NamedTuple

from flint import fmpq, fmpq_mpoly

from cfjax.check.bounds import Range
from cfjax.check.document import Certificate
from cfjax.check.enclosure import LARGEST_EFFORT, Budget, Enclosure, UnaryEnclosure
from cfjax.check.funnel import FunnelClaim
from cfjax.check.held import TIMING
from cfjax.check.hints import EnclosureHints
from cfjax.check.level import Affine, Contracting, LevelPiece
from cfjax.check.parametric import Combination, Parametric
from cfjax.check.program import CellProof, FunnelProgram, Gram, Matrix, monomials
from cfjax.check.proof import MOST_EFFORT, Question, dynamics_of, prove_enclosures
from cfjax.check.rational import sqrt_lower, sqrt_upper
from cfjax.check.reader import Broken
from cfjax.check.reference import Gap
from cfjax.check.symbolic import Symbolic


DEGREES = (3, 2)  # of the monomials in Gram matrices of a leaf: of the free square, and of forks and the range
BEND_DEGREES = (2, 1)  # of a bound on V^(m+1)
FORK_DEGREE = 2  # of the polynomials at forks
ORDERS = (2, 3)
BEND = -1  # in place of the number of a Bernstein coefficient: the claim on V^(m+1)

Coefficients = tuple[fmpq, ...]
Proof = tuple[fmpq, tuple[Gram, ...]]  # margin and Gram matrices
Inputs = tuple[fmpq, ...]  # in the order of the problem's


@dataclass(frozen=True)
class Leaf:
    """The input, by its number, that does it here, and a proof for each Bernstein coefficient."""

    choice: int
    proofs: tuple[Proof, ...]


@dataclass(frozen=True)
class Fork:
    """A polynomial by its coefficients up to FORK_DEGREE; what holds where it is not negative, and what elsewhere."""

    coefficients: Coefficients
    above: "Tree"
    below: "Tree"


Tree = Leaf | Fork


@dataclass(frozen=True)
class RangeHints:
    """For one range of q; `bends` proves R_u for each input, trees are there where something is asked (`parts`)."""

    whitening: Matrix
    enclosures: EnclosureHints  # by the number of the function among those of the dynamics
    bends: tuple[Proof, ...]
    trees: tuple[Tree, ...]


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

    def left_out(self, choice: int) -> fmpq:
        """ρ, 1/s."""
        return self.period**self.order / factorial(self.order + 1) * self.bends[choice]

    def need(self, part: "Part", choice: int, j: int) -> fmpq:
        """By how many drops −B_j + slack has to be above zero, 1/s."""
        asked = self.decrease if part.is_shell else fmpq(0)
        return asked + (self.left_out(choice) if j == self.order - 1 else 0)


@dataclass(frozen=True)
class SteadyLeg:
    """A leg of one turning rate and speed (`profile`, by the graph's names), and what is asked of its funnel.

    `duration` in s; `gap` is the jump of the reference where the leg closes a lap.
    """

    question: Question
    profile: Mapping[str, fmpq]
    duration: fmpq
    gap: Gap | None

    @property
    def dynamics(self) -> Symbolic:
        """In symbols."""
        return self.question.dynamics

    @property
    def funnel(self) -> FunnelClaim:
        """V."""
        return self.question.funnel

    @property
    def states(self) -> tuple[str, ...]:
        """Their names."""
        return self.question.model.vehicle.states

    @property
    def inputs(self) -> Mapping[str, Range]:
        """The box by name, u0 first."""
        return self.question.model.inputs


# --- derivatives of V


def derivatives(leg: SteadyLeg, order: int) -> list[fmpq_mpoly]:
    """P_1 … P_order: derivatives of V/σ, in the symbols of the dynamics with the numbers of the reference put in.

    Raises:
        Broken: the dynamics apply a function to something else than states.
        ValueError: a polynomial is larger than the checker takes, or a derivative of it is not known.
    """
    dynamics, funnel = leg.dynamics, leg.funnel
    states, domain = leg.states, leg.dynamics.domain
    _require_functions_of_states(dynamics, states)
    symbols, zero = dynamics.symbols, domain.ring.constant(0)
    profile = {f"reference:{name}": value for name, value in leg.profile.items()}
    generators = domain.ring.names()
    numbers: dict[str | int, fmpq | int] = {
        generators[dynamics.names.index(name)]: value for name, value in profile.items()
    }
    rates = [rate.subs(numbers) for rate in dynamics.rates]
    circles = _circles(dynamics)
    pairs = ((i, j) for i in range(len(states)) for j in range(len(states)))
    value = sum((funnel.shape[i][j] * symbols[states[i]] * symbols[states[j]] for i, j in pairs), zero)
    found = []
    for _ in range(order):
        along = (
            domain.product(dynamics.derivative(value, state), rate) for state, rate in zip(states, rates, strict=True)
        )
        turned = domain.product(value, funnel.level.rate * symbols[TIMING])
        value = reduce(domain.sum, along, turned)
        for circle in circles:
            value = domain.rest(value, circle)
        found.append(value)
    return found


def _require_functions_of_states(dynamics: Symbolic, states: Sequence[str]) -> None:
    known = {dynamics.names.index(state) for state in states}
    for index, (function, argument) in dynamics.functions.items():
        if any(power and k not in known for e in argument.to_dict() for k, power in enumerate(map(int, e))):
            raise Broken(f"vehicle: sampled control is proven for dynamics whose {function} is of the states alone")
        known.add(index)


def _circles(dynamics: Symbolic) -> list[fmpq_mpoly]:
    """sin² + cos² − 1, which is zero, for each argument that both are applied to."""
    found, ring = [], dynamics.domain.ring
    for index, (function, argument) in dynamics.functions.items():
        for other, (cofunction, same) in dynamics.functions.items():
            if (function, cofunction) == ("sin", "cos") and argument == same:
                found.append(ring.gens()[index] ** 2 + ring.gens()[other] ** 2 - 1)
    return found


def control_points(each: Sequence[fmpq_mpoly], period: fmpq) -> list[fmpq_mpoly]:
    """B_0 … B_{m−1} from P_1 … P_m."""
    size = len(each)
    found = []
    for j in range(size):
        weights = (period**k * fmpq(comb(j, k), comb(size - 1, k) * factorial(k + 1)) for k in range(j + 1))
        found.append(sum((weight * value for weight, value in zip(weights, each, strict=False)), 0 * each[0]))
    return found


# --- ranges of q


class Part(NamedTuple):
    """What is asked on a range: −B_j + slack ≥ need drop, slack and drop affine in q (`SampledClaim.need`)."""

    slack: Affine
    drop: Affine
    is_shell: bool


class Asked(NamedTuple):
    """A range of q; its `drop` is at most 1/σ on V ≤ 1, which bounds of V^(m+1) need."""

    piece: LevelPiece
    parts: tuple[Part, ...]


def ranges(funnel: FunnelClaim, span: Range, claim: SampledClaim) -> list[Asked]:
    """Ranges of q that cover the funnel while θ is in the span, with what is asked there; one of them in pieces.

    Inside, where V ≤ β̲, 1/σ is at least `room`. There B_j ≤ (1/σ − q)/h − ρ/σ is asked, ρ for the last j alone: where
    ρ ≤ 1/h it is worst where 1/σ is least.

    Raises:
        Broken: for a V of another template, or cuts that do not follow each other where V may be β̲.
    """
    level, beta, zero = funnel.level, funnel.beta_lower, fmpq(0)
    if not isinstance(level, Contracting):
        raise Broken("sampled: expected a V of the template contracting")
    least, peak = level.extent(span)
    timing = zero, level.rate
    ends = beta * least, *claim.cuts, beta * peak
    if any(lower >= upper for lower, upper in pairwise(ends)):
        raise Broken("sampled: the cuts do not follow each other in the range that they cut")
    rising, itself = (zero, 1 / beta), (zero, fmpq(1))

    def inside(room: Affine) -> Part:
        return Part((room[0] / claim.period, (room[1] - 1) / claim.period), room, is_shell=False)

    def shell(drop: Affine) -> Part:
        return Part((zero, zero), drop, is_shell=True)

    middle = (Asked(LevelPiece(*each, timing, itself), (inside(rising), shell(rising))) for each in pairwise(ends))
    return [
        Asked(LevelPiece(zero, beta * least, timing, (least, zero)), (inside((least, zero)),)),
        *middle,
        Asked(LevelPiece(beta * peak, peak, timing, itself), (shell((peak, zero)),)),
    ]


class HoldCell(NamedTuple):
    """One of the values of a range at an input, where polynomials are not negative: B_j of a part, or P_{m+1}."""

    value: int  # j, or BEND
    choice: int
    part: Part | None = None
    forks: tuple[fmpq_mpoly, ...] = ()


@dataclass(frozen=True)
class HeldRange(FunnelProgram):
    """Polynomials in y, x = W y, on one range of q, and what is claimed there; a cell of P_{m+1} has margin −R_u.

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
        norm_squared = sum((y * y for y in self.ring.gens()), self.ring.constant(0))
        return self.domain.sum(rate.polynomial(most), norm_squared * left[1] + left[0])

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
        return square, *[other] * (len(cell.forks) + len(self.edges))

    def target(self, cell: HoldCell) -> fmpq_mpoly:
        most = self.domain.negative(self.upper(cell.value, cell.choice, 2 * self.degrees_of(cell)[0]))
        return self.domain.sum(affine(cell.part.slack, self.form), most) if cell.part else most

    def drop(self, cell: HoldCell) -> fmpq_mpoly:
        return affine(cell.part.drop, self.form) if cell.part else self.piece.drop_at(self.form)

    def least_drop(self, cell: HoldCell) -> fmpq:
        constant, slope = cell.part.drop if cell.part else self.piece.drop
        return constant + slope * (self.piece.lower if slope > 0 else self.piece.upper)

    def constraints(self, cell: HoldCell) -> list[fmpq_mpoly]:
        return [*cell.forks, *self.edges]

    @cached_property
    def edges(self) -> list[fmpq_mpoly]:
        """q − q_lo and q_hi − q; the first says nothing where q_lo is 0."""
        above = [self.form - self.piece.lower] if self.piece.lower > 0 else []
        return [*above, self.piece.upper - self.form]


def affine(coefficients: Affine, q: fmpq_mpoly) -> fmpq_mpoly:
    """Constant and slope at q."""
    constant, slope = coefficients
    return constant + slope * q


# --- the proof


def span_of(leg: SteadyLeg, period: fmpq) -> Range:
    """θ at which a car may be within a hold that began on the leg; of a lap, beyond its end too."""
    return fmpq(0), leg.duration + (leg.inputs["u0"][1] * period if leg.gap else 0)


def held_ranges(leg: SteadyLeg, claim: SampledClaim) -> Iterator[tuple[HeldRange, tuple[Part, ...]]]:
    """The ranges of q without hints yet, with what is asked on each.

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


def prove_holds(certificate: Certificate, claim: SampledClaim, hints: Sequence[RangeHints]) -> None:
    """What a file states of holds along the path of a proven certificate.

    Raises:
        Broken, ValueError: says what is not proven.
    """
    prove_sampled(steady_leg(certificate), claim, hints, Budget(MOST_EFFORT))


def steady_leg(certificate: Certificate) -> SteadyLeg:
    """The one steady leg that a certificate is about, which may be a lap.

    Raises:
        Broken: it is about another path.
    """
    claims = certificate.claims
    problem = claims.problem
    if len(claims.legs) != 1 or not problem.is_steady or claims.funnels[0].margin_per_metre is not None:
        raise Broken("sampled: expected a path that is one leg of one turning rate and speed, with a funnel of its own")
    (leg,) = claims.legs
    question = Question(problem.car, dynamics_of(problem.car), claims.funnels[0])
    return SteadyLeg(
        question, leg.pieces[0].profile(fmpq(0)), leg.duration, leg.reference.gap if problem.is_lap else None
    )


def prove_sampled(leg: SteadyLeg, claim: SampledClaim, hints: Sequence[RangeHints], effort: Budget) -> None:
    """Everything that is stated of holds on a steady leg.

    A hold may begin before the end of a lap and last beyond it. Until it ends V goes on along the same reference, so
    the ranges hold for θ up to u0 h beyond T; that the deviation lies in the next lap's V ≤ 1 then is shown by itself.

    Raises:
        Broken, ValueError: says what is not proven.
    """
    _require_sense(leg, claim)
    if leg.gap is not None:
        _prove_lap(leg, leg.gap, claim)
    asked = list(held_ranges(leg, claim))
    if len(asked) != len(hints):
        raise Broken(f"sampled: expected hints for {len(asked)} ranges of q, got {len(hints)}")
    functions = {number: name for number, (name, _) in enumerate(leg.dynamics.functions.values())}
    for index, ((held, parts), own) in enumerate(zip(asked, hints, strict=True)):
        if len(own.trees) != len(parts) or len(own.bends) != len(claim.choices):
            raise Broken(f"sampled: in range {index} of q the hints are not for what is asked there")
        enclosures = prove_enclosures(own.enclosures, functions, effort)
        told = replace(held, whitening=own.whitening, enclosures=enclosures)
        proof = _Proof(told, claim, f"sampled, range {index} of q", effort)
        for choice, bend in enumerate(own.bends):
            proof.bend(choice, bend)
        for part, tree in zip(parts, own.trees, strict=True):
            proof.tree(part, tree, ())


def _require_sense(leg: SteadyLeg, claim: SampledClaim) -> None:
    box = leg.inputs
    if not claim.period > 0 or not claim.decrease > 0 or claim.order not in ORDERS:
        raise Broken("sampled: expected a positive period and decrease, and an order of 2 or 3")
    if len(claim.bends) != len(claim.choices) or any(bend < 0 for bend in claim.bends):
        raise Broken("sampled: expected a bound for each of the inputs, none below zero")
    for choice in claim.choices:
        inside = (lower <= value <= upper for value, (lower, upper) in zip(choice, box.values(), strict=True))
        if not all(inside):
            raise Broken("sampled: an input is not in the box of inputs")


def _prove_lap(leg: SteadyLeg, gap: Gap, claim: SampledClaim) -> None:
    """A hold that lasts beyond the end of a lap ends in the next lap's V ≤ 1, on the shell with V as low as stated.

    At a θ that is δ beyond T, √V of the next lap is at most √ρ(T) √V + J/√ρ(δ), where V goes on along this lap's end.
    The next reference has moved by its gap, seen from a body frame that may have turned, and by the gap in heading
    times the way since the start.
    """
    level, shape, highest = leg.funnel.level, leg.funnel.shape, leg.inputs["u0"][1]
    away = gap.lateral + gap.forward + gap.heading * abs(leg.profile["speed"]) * highest * claim.period
    jump = Gap(gap.heading, away, away, gap.speed).jump(shape, leg.funnel.inverse)
    least, _ = level.extent((fmpq(0), highest * claim.period))
    left = 1 - sqrt_upper(level.bounds(leg.duration)[1])
    lowest = leg.funnel.beta_lower - claim.decrease * claim.period  # of V where a hold that began on the shell ends
    if level.rate < 0 or lowest <= 0 or jump / sqrt_lower(least) > left * sqrt_lower(lowest):
        raise Broken("sampled: a hold over the end of a lap may leave the funnel of the next one, or bring V down less")


@dataclass(frozen=True)
class _Proof:
    """Claims on one range, proven one by one; each has the effort of one to itself, all share that of the file."""

    held: HeldRange
    claim: SampledClaim
    where: str
    effort: Budget

    def bend(self, choice: int, proof: Proof) -> None:
        """R_u."""
        if -self._shown(HoldCell(BEND, choice), proof) > self.claim.bends[choice]:
            raise Broken(f"{self.where}: derivative {self.claim.order + 1} of V may exceed the bound of input {choice}")

    def tree(self, part: Part, tree: Tree, forks: tuple[fmpq_mpoly, ...]) -> None:
        """What is asked of a part, on all leaves of its tree."""
        if isinstance(tree, Fork):
            here = self.held.fork(tree.coefficients)
            self.tree(part, tree.above, (*forks, here))
            self.tree(part, tree.below, (*forks, -here))
            return
        if not tree.choice < len(self.claim.choices) or len(tree.proofs) != self.claim.order:
            raise Broken(f"{self.where}: a leaf is not about an input that is stated")
        if not part.is_shell and self.claim.left_out(tree.choice) * self.claim.period > 1:
            raise Broken(
                f"{self.where}: too little is known of V under input {tree.choice} to hold it inside the shell"
            )
        for j, proof in enumerate(tree.proofs):
            if self._shown(HoldCell(j, tree.choice, part, forks), proof) < self.claim.need(part, tree.choice, j):
                what = "V does not fall as stated" if part.is_shell else "V may rise above 1"
                raise Broken(f"{self.where}: {what} on a leaf of input {tree.choice}")

    def _shown(self, cell: HoldCell, proof: Proof) -> fmpq:
        budget = self.held.domain.budget
        budget.left = LARGEST_EFFORT
        shown = self.held.proven_margin(CellProof(cell, *proof))
        self.effort.spend(LARGEST_EFFORT - budget.left)
        return shown
