"""Hints for sampled control (`cfcheck.robustness.sampled`): the finite set of inputs, and all that has to be shown of
it.

Where which of the inputs is good, trees say (`cfjax.certificate.hold_trees`).
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from math import floor, log2
from typing import Any, NamedTuple

import numpy as np
from flint import fmpq
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from cfcheck.exact.enclosure import LARGEST_EFFORT, UnaryEnclosure
from cfcheck.kernel.program import CellProof
from cfcheck.robustness.derivatives import SteadyLeg
from cfcheck.robustness.ranges import RISE, HeldRange, HoldCell, Inputs, Part, SampledClaim, held_ranges, span_of
from cfcheck.robustness.sampled_hints import START_UP
from cfjax.certificate.fit import FUNCTIONS, enclose
from cfjax.certificate.hold_trees import TreeGrower, program_at, write_proof
from cfjax.certificate.program import MARGIN_BITS, prove, solved
from cfjax.certificate.prover import NotProven
from cfjax.certificate.rounding import dyadic, round_whitening
from cfjax.certificate.writing import write_unary
from cfjax.solver import Solver
from cfjax.verdict import Verdict


RATIO = 2.0  # of the ends of a range of q
CUT_BITS, LEVEL_BITS = 16, 20
ORDER = 3
ENOUGH = 0.5  # of λ: what samples have to say of three levels, or there are more of them
SHARE = 0.5  # of what samples say: so much λ' is looked for. More of it takes more leaves


def sampled_hints(leg: SteadyLeg, period: fmpq, solver: Solver, delay: fmpq | None = None) -> dict[str, Any]:
    """What is stated of holds up to the period (s), with hints; with three levels of each input, or more of one.

    With a `delay` (s) also of the time until a first pose that is so late.

    Raises:
        NotProven: a part of the funnel for which nothing was found.
        Broken, ValueError: a vehicle, a V or a reference of a kind that is not looked at.
    """
    motion = _Motion.of(leg)
    try:
        return hints_with(leg, period, motion.levels(), solver, least=ENOUGH * float(leg.funnel.margin), delay=delay)
    except NotProven:
        return hints_with(leg, period, motion.levels(motion.strongest), solver, delay=delay)


def hints_with(
    leg: SteadyLeg,
    period: fmpq,
    levels: Sequence[Sequence[fmpq]],
    solver: Solver,
    *,
    order: int = ORDER,
    least: float = 0.0,
    delay: fmpq | None = None,
) -> dict[str, Any]:
    """The same with these levels of each input, and so many derivatives of V in the polynomial.

    Raises:
        NotProven: also where V falls at no more than `least` (1/s) at some sample.
    """
    with threadpool_limits(1, user_api="blas"):  # for arrays of this size threads only wait for each other
        choices: tuple[Inputs, ...] = tuple(itertools.product(*levels))
        nothing = (fmpq(0),) * len(choices)
        claim = SampledClaim(period, order, fmpq(1), choices, nothing, _cuts(leg, period))
        ranges = [(_with_functions(held), parts) for held, parts in held_ranges(leg, claim)]
        start = {} if delay is None else {START_UP: _start_up(leg, [held for held, _ in ranges], delay, solver)}
        return _stated(ranges, claim, solver, least) | start


def _start_up(leg: SteadyLeg, each: Sequence[HeldRange], delay: fmpq, solver: Solver) -> dict[str, Any]:
    """How fast V may rise under the reference's own inputs, until a pose is there that is `delay` (s) late."""
    choice = each[0].choices.index(_Motion.of(leg).own)
    bounds = [_bounds(held, [HoldCell(RISE, choice)], solver)[0] for held in each]
    rise = max(fmpq(1, 2**LEVEL_BITS), *(-margin for margin, _ in bounds))
    rise = fmpq((rise * 2**LEVEL_BITS).ceil(), 2**LEVEL_BITS)
    if not rise * delay < 1:
        change = f"V rises at up to {float(rise):.3g} 1/s under the reference's own inputs"
        raise NotProven(Verdict.INCONCLUSIVE, f"sampled: {change} until a pose is there, {float(delay):g} s late")
    proofs = [write_proof(proof) for _, proof in bounds]
    return {"delay": str(delay), "choice": choice, "rise": str(rise), "proofs": proofs}


def _stated(
    ranges: Sequence[tuple[HeldRange, tuple[Part, ...]]], claim: SampledClaim, solver: Solver, least: float
) -> dict[str, Any]:
    bends = [_bounds(held, list(held.cells()), solver) for held, _ in ranges]
    largest = (max(fmpq(0), *(-margin for margin, _ in each)) for each in zip(*bends, strict=True))
    claim = replace(claim, bends=tuple(fmpq(bound.ceil()) for bound in largest))
    growers = [[TreeGrower(held, part, claim, solver) for part in parts] for held, parts in ranges]
    everywhere = list(itertools.chain.from_iterable(growers))
    shell = [grower for grower in everywhere if grower.part.is_shell]
    best = min(grower.best() for grower in shell)
    if not best > least:
        change = f"V changes by {-best:.3g} 1/s over a hold somewhere"
        raise NotProven(Verdict.INCONCLUSIVE, f"sampled: {change}, whichever input is held")
    for grower in everywhere:
        grower.grow(SHARE * best if grower.part.is_shell else 0.0)
    decrease = min(leaf.spare for grower in shell for leaf in grower.leaves)
    return {
        "period": str(claim.period),
        "order": claim.order,
        "decrease": str(fmpq(floor(decrease * 2**MARGIN_BITS), 2**MARGIN_BITS)),
        "inputs": [[str(value) for value in choice] for choice in claim.choices],
        "bends": [str(bound) for bound in claim.bends],
        "cuts": [str(cut) for cut in claim.cuts],
        "ranges": [
            {
                "whitening": [[str(entry) for entry in row] for row in held.whitening],
                "enclosures": write_unary(held.enclosures),
                "bends": [write_proof(proof) for _, proof in own],
                "trees": [grower.written() for grower in each],
            }
            for (held, _), own, each in zip(ranges, bends, growers, strict=True)
        ],
    }


class _Motion(NamedTuple):
    """On the reference: the inputs that keep a car there, and which one of the vehicle's moves V most."""

    box: tuple[tuple[fmpq, fmpq], ...]
    own: tuple[fmpq, ...]
    strongest: int

    @classmethod
    def of(cls, leg: SteadyLeg) -> "_Motion":
        """From the rates at x = 0, which are affine in the inputs."""
        names, box = tuple(leg.inputs), tuple(leg.inputs.values())
        still = {f"reference:{name}": float(value) for name, value in leg.profile.items()}
        still |= dict.fromkeys(leg.states, 0.0)

        def rates(inputs: Float[np.ndarray, " m"]) -> Float[np.ndarray, " n"]:
            values = still | {f"input:{name}": value for name, value in zip(names, inputs, strict=True)}
            graph = leg.question.model.vehicle.graph
            return np.array(graph.evaluate(values, float, lambda _, name, argument: FUNCTIONS[name](argument)))

        units = np.eye(len(names))
        effects = np.array([rates(unit) - rates(0 * unit) for unit in units])
        rest, *_ = np.linalg.lstsq(effects[1:].T, -rates(units[0]), rcond=None)
        shape = np.array([[float(entry) for entry in row] for row in leg.funnel.shape])
        widths = np.array([float(upper - lower) for lower, upper in box])
        moved = np.einsum("ij,jk,ik->i", effects, shape, effects) * widths**2
        own = [fmpq(1), *(dyadic(value, LEVEL_BITS) for value in rest)]
        clipped = (min(max(value, lower), upper) for value, (lower, upper) in zip(own, box, strict=True))
        return cls(box, tuple(clipped), 1 + int(moved[1:].argmax()))

    def levels(self, fine: int | None = None) -> list[list[fmpq]]:
        """Of each input both ends and the reference's own; of the one that is named what lies in the middle too."""
        found = [sorted({lower, own, upper}) for (lower, upper), own in zip(self.box, self.own, strict=True)]
        if fine is not None:
            found[fine] = sorted({*found[fine], *((one + other) / 2 for one, other in itertools.pairwise(found[fine]))})
        return found


def _cuts(leg: SteadyLeg, period: fmpq) -> tuple[fmpq, ...]:
    """Ranges of q whose ends are in the ratio RATIO, nearly."""
    least, peak = leg.funnel.level.extent(span_of(leg, period))
    beta = leg.funnel.beta_lower
    count = max(1, round(log2(float(peak / least)) / log2(RATIO)))
    inner = (float(beta * least) * float(peak / least) ** (k / count) for k in range(1, count))
    return tuple(dyadic(value, CUT_BITS) for value in inner)


def _with_functions(held: HeldRange) -> HeldRange:
    """With a whitening, and with enclosures of the functions on its ball."""
    shape = np.array([[float(entry) for entry in row] for row in held.shape])
    held = replace(held, whitening=round_whitening(shape / float(held.peak)))
    enclosures: dict[int, UnaryEnclosure] = {}
    for number, (function, argument) in enumerate(held.dynamics.functions.values()):
        enclosures[number] = enclose(function, held.argument(argument))
    return replace(held, enclosures=enclosures)


def _bounds(held: HeldRange, cells: Sequence[HoldCell], solver: Solver) -> list[tuple[fmpq, CellProof]]:
    """Of each cell the margin that is proven on the range, minus a bound of a derivative of V, and its proof."""
    programs = [program_at(held, cell) for cell in cells]
    found = []
    for cell, program, solution in zip(cells, programs, solved(solver, programs), strict=True):
        held.domain.budget.left = LARGEST_EFFORT
        proven = prove(held, cell, program, solution)
        if proven.proof is None:
            raise NotProven(Verdict.SOLVER_FAILED, f"sampled: no bound of a derivative of V: {solution}")
        found.append((proven.margin, proven.proof))
    return found
