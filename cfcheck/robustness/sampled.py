"""Inputs chosen from a finite set for a whole hold: that for every deviation one of them brings V down, proven.

A car of a steady segment holds inputs u from s = 0 on. As long as V ≤ 1, by Taylor's theorem

    V(s) = V + s (V' + s/2 V'' + … + s^{m−1}/m! V^(m)) + s^{m+1}/(m+1)! V^(m+1)(somewhere on the way),

all derivatives along this u. The bracket is a polynomial of degree m − 1 in s. On 0 ≤ s ≤ h it is at most the largest
of its Bernstein coefficients B_0 … B_{m−1}, and what is left out is at most s ρ, ρ = h^m/(m+1)! R, where **R_u** bounds
V^(m+1) on V ≤ 1 at this u; with (s/h)^m ≤ (s/h)^{m−1}, ρ is added to B_{m−1} alone. So V(s) ≤ V + s max_j B_j for every
s ≤ h. What has to be shown is that for every deviation some u of the set has

    on the shell β̲ ≤ V ≤ 1:   B_j ≤ −λ',           and inside it, V ≤ β̲:   B_j ≤ (1 − V)/h          for every j.

Then V never rises above 1, and on the shell it falls at λ' from one choice to the next, however long each hold is.

The derivatives are exact polynomials (`cfcheck.robustness.derivatives`); the inequalities are stated for each range of
q = xᵀ C x (`cfcheck.robustness.ranges`).

**The cut.** Where some input does it, a tree says: each fork holds a polynomial, and the deviations where it is not
negative go one way, all others the other way. Whatever the polynomials are, the leaves cover the range. A leaf names
one input, and sums of squares show B_j there (`cfcheck.kernel.program`), with the forks on the way as constraints.

**Late poses.** A law that knows how old a pose is, and which inputs were held since, knows the deviation at which its
next input begins to act: the model's motion. So all of the above holds from the first choice on. Until the first pose
is there, for τ* or less, one input of the set is held. If V' ≤ D under it wherever V ≤ 1, V ≤ 1 − D τ* at the start
suffices (`cfcheck.robustness.ranges.StartUp`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from flint import fmpq, fmpq_mpoly

from cfcheck.claims.document import Certificate
from cfcheck.claims.hints import EnclosureHints
from cfcheck.claims.proof import MOST_EFFORT, Question, dynamics_of, prove_enclosures
from cfcheck.exact.enclosure import LARGEST_EFFORT, Budget
from cfcheck.exact.rational import Matrix, sqrt_lower, sqrt_upper
from cfcheck.kernel.program import CellProof, Gram
from cfcheck.path.reference import Gap
from cfcheck.reader import Broken
from cfcheck.robustness.derivatives import SteadyLeg
from cfcheck.robustness.ranges import (
    BEND,
    ORDERS,
    RISE,
    Coefficients,
    HeldRange,
    HoldCell,
    Part,
    SampledClaim,
    StartUp,
    held_ranges,
)


Proof = tuple[fmpq, tuple[Gram, ...]]  # margin and Gram matrices


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
    """For one range of q; `bends` proves R_u for each input, `trees` has one for each part."""

    whitening: Matrix
    enclosures: EnclosureHints  # by the number of the function among those of the dynamics
    bends: tuple[Proof, ...]
    trees: tuple[Tree, ...]
    rise: Proof | None = None  # a bound of V' under the input of a start-up, where there is one


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
    ranges = list(held_ranges(leg, claim))
    if len(ranges) != len(hints):
        raise Broken(f"sampled: expected hints for {len(ranges)} ranges of q, got {len(hints)}")
    functions = {number: name for number, (name, _) in enumerate(leg.dynamics.functions.values())}
    for index, ((held, parts), own) in enumerate(zip(ranges, hints, strict=True)):
        if len(own.trees) != len(parts) or len(own.bends) != len(claim.choices):
            raise Broken(f"sampled: in range {index} of q the hints are not for what is asked there")
        enclosures = prove_enclosures(own.enclosures, functions, effort)
        hinted = replace(held, whitening=own.whitening, enclosures=enclosures)
        proof = _Proof(hinted, claim, f"sampled, range {index} of q", effort)
        for choice, bend in enumerate(own.bends):
            proof.bend(choice, bend)
        if claim.start_up is not None:
            proof.rise(claim.start_up, own.rise)
        for part, tree in zip(parts, own.trees, strict=True):
            proof.tree(part, tree, ())


def _require_sense(leg: SteadyLeg, claim: SampledClaim) -> None:
    box = leg.inputs
    if not claim.period > 0 or not claim.decrease > 0 or claim.order not in ORDERS:
        raise Broken("sampled: expected a positive period and decrease, and an order of 2 or 3")
    if len(claim.bends) != len(claim.choices) or any(bend < 0 for bend in claim.bends):
        raise Broken("sampled: expected a bound for each of the inputs, none below zero")
    if claim.start_up is not None:
        _require_start(leg, claim, claim.start_up)
    for choice in claim.choices:
        inside = (lower <= value <= upper for value, (lower, upper) in zip(choice, box.values(), strict=True))
        if not all(inside):
            raise Broken("sampled: an input is not in the box of inputs")


def _require_start(leg: SteadyLeg, claim: SampledClaim, start_up: StartUp) -> None:
    """θ goes on at the u0 of the input that is held, from a start on the leg to one."""
    if not start_up.choice < len(claim.choices) or not start_up.delay > 0 or not start_up.rise > 0:
        raise Broken("sampled: expected a start-up with one of the inputs, a positive delay and a positive rise")
    if start_up.level <= 0 or claim.choices[start_up.choice][0] * start_up.delay >= leg.duration:
        raise Broken("sampled: no start is left from which V stays below 1 until the first pose is there")


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

    def rise(self, start_up: StartUp, proof: Proof | None) -> None:
        """V' until the first pose is there."""
        if proof is None or -self._shown(HoldCell(RISE, start_up.choice), proof) > start_up.rise:
            raise Broken(f"{self.where}: V may rise faster than stated until the first pose is there")

    def tree(self, part: Part, tree: Tree, forks: tuple[fmpq_mpoly, ...]) -> None:
        """The inequalities of a part, on all leaves of its tree."""
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
