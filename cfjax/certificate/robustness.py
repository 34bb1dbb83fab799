"""Hints for what a certified funnel absorbs: bounds on V̇ and V̈ over it, and the file that carries them.

Each vertex is a small semidefinite program (`cfcheck.robustness.hold`), some hundredths of a second. The file states
the largest amounts that were found (`amounts`), with hints for the bounds that allow them.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from flint import fmpq

from cfcheck.claims.document import Certificate, Claims, read_certificate
from cfcheck.claims.hints import MOST_STRETCHES
from cfcheck.claims.proof import Question
from cfcheck.exact.enclosure import LARGEST_EFFORT, Enclosure, UnaryEnclosure
from cfcheck.exact.rational import rational
from cfcheck.kernel.legs import Leg
from cfcheck.kernel.program import CellProof
from cfcheck.path.bounds import Bounds
from cfcheck.replay import stated_and_proven
from cfcheck.robustness.amounts import AbsorbedClaim, Stated
from cfcheck.robustness.descent import held_question, law_numbers_of
from cfcheck.robustness.hold import ORDERS, HeldCell, HeldMotion, derivatives_of
from cfcheck.robustness.hold_hints import CLAIM, DEGREES, SAMPLED
from cfcheck.robustness.rate_bounds import motions, motions_within
from cfcheck.robustness.sampled import steady_leg
from cfcheck.vehicle.structure import require_tube_structure
from cfjax.certificate.amounts import largest_amounts, write_amounts
from cfjax.certificate.bounds import bounds_along
from cfjax.certificate.fit import enclose
from cfjax.certificate.program import program_of, prove, solved
from cfjax.certificate.prover import NotProven
from cfjax.certificate.rounding import round_whitening
from cfjax.certificate.sampled import sampled_hints
from cfjax.certificate.writing import with_hash, write_bounds, write_grams, write_unary
from cfjax.coerce import instance, whole
from cfjax.result import Result
from cfjax.solver import DEFAULT, Program, Solution, Solver, solver_named
from cfjax.solver.program import Shape
from cfjax.verdict import Verdict


BAND, MOST_BANDS = 3.0, 2  # ratio of a band's speeds; each costs up to some hundred programs
LOSS, HALVINGS = 1.1, 4  # a stretch is halved if the outer levels have that many times the bound of the inner ones


class Hints(NamedTuple):
    """The file of hints for a certified result, where there is one; the same with what else was asked, or why not."""

    file: dict[str, Any] | None
    whole: dict[str, Any] | None = None
    lack: str = ""


def robustness_of(result: Result, workers: int = 1, solver: str | Solver = DEFAULT) -> dict[str, Any] | None:
    """The file of hints for a certified result; None where there is nothing that is certified.

    Raises:
        NotProven, Broken, ValueError: as `robustness_document`.
    """
    document, workers = instance("result", result, Result).document, whole("workers", workers, 1)
    if document is None or document["claim"] != "funnel":
        return None
    return robustness_document(document, workers, solver)


def robustness_document(document: dict[str, Any], workers: int = 1, solver: str | Solver = DEFAULT) -> dict[str, Any]:
    """The file of hints for a certificate: the document that the checker accepted.

    Raises:
        NotProven: a bound that no hint was found for.
        Broken, ValueError: dynamics or levels of a kind that has no bounds here.
    """
    certificate, oracle = read_certificate(document), solver_named(solver, workers)
    count = range(len(certificate.claims.funnels))
    funnels = [_funnel_hints(certificate, index, oracle) for index in count]
    return _with_amounts(document, funnels, certificate.claims)


def with_holds(
    document: dict[str, Any],
    file: dict[str, Any],
    period: float,
    delay: float | None = None,
    solver: str | Solver = DEFAULT,
) -> dict[str, Any]:
    """The file of hints for a certificate, with those for a law that looks a `period` (s) ahead.

    With a `delay` (s) also for poses that come so late. What is stated is said in `cfcheck.robustness.sampled`.

    Raises:
        NotProven: nothing was found for some part of the funnel.
        Broken, ValueError: a vehicle, a V or a path of a kind that is not looked at.
    """
    leg, late = steady_leg(read_certificate(document)), None if delay is None else rational(delay)
    sampled = sampled_hints(leg, rational(period), solver_named(solver), late)
    return with_hash(CLAIM, {name: file[name] for name in ("certificate", "amounts", "funnels")} | {SAMPLED: sampled})


def _funnel_hints(certificate: Certificate, index: int, solver: Solver) -> dict[str, Any]:
    """For one funnel of a certificate, beside what the path does along its legs."""
    claims, own = certificate.claims, certificate.hints[index]
    model, legs, course = claims.models[index], claims.legs_of(index), claims.problem.course
    if own.duration is not None:
        question = held_question(claims, index, own.mirror, law_numbers_of(claims.driven[index], None))
        ends = [stretch.end for stretch in own.stretches if stretch.end is not None]
        return {"bounds": None, "stretches": hints_along(question, legs, ends, solver)}
    held = model.as_driven(own.stretches[0].bounds)
    bounds = course if isinstance(course, Bounds) else bounds_along(legs, held)
    question = held_question(claims, index, own.mirror, law_numbers_of(claims.driven[index], bounds))
    as_proven = model.as_proven(bounds)
    return {"bounds": write_bounds(bounds), "stretches": hints_within(question, as_proven, solver)}


def _with_amounts(document: dict[str, Any], funnels: list[dict[str, Any]], claims: Claims) -> dict[str, Any]:
    """The whole file: it states the largest amounts that are found for what its hints prove."""

    def file(stated: Stated) -> dict[str, Any]:
        content = {"certificate": document["hash"], "amounts": write_amounts(stated), "funnels": funnels}
        return with_hash(CLAIM, content)

    none = (fmpq(0),) * len(claims.problem.vehicle.states)
    nothing = AbsorbedClaim(fmpq(0), none, none, fmpq(0))
    _, bounds = stated_and_proven(document, file(Stated(nothing, nothing, ())))
    return file(largest_amounts(bounds))


def held_shape(states: int) -> Shape:
    """Of the largest programs that bound V̇ and V̈: the same for every funnel of so many states."""
    return states, (DEGREES[0], DEGREES[1], DEGREES[1])


class _HintedInterval(NamedTuple):
    """Hints for a stretch of θ that begins here, and the bounds of V̈ on its ranges of levels (1/s²)."""

    begin: fmpq
    end: fmpq
    hints: dict[str, Any]
    bends: list[float]


def hints_along(question: Question, legs: Sequence[Leg], ends: list[fmpq], solver: Solver) -> list[dict[str, Any]]:
    """For a funnel that changes with θ: a stretch ends at each of `ends`. Condition (d)'s own do.

    What the programs leave out weighs more the more the level changes along a stretch: where the bound suffers, the
    stretch is halved.

    Raises:
        NotProven, Broken, ValueError: as `robustness_document`.
    """

    def bounded(begin: fmpq, end: fmpq) -> _HintedInterval:
        levels = [_levels(motion, solver) for motion, _ in motions(question, legs, (begin, end))]
        return _HintedInterval(begin, end, {"end": str(end), "levels": levels}, list(map(_bend, levels)))

    found = [bounded(*span) for span in itertools.pairwise([fmpq(0), *ends])]
    for _ in range(min(HALVINGS, MOST_STRETCHES - len(found))):
        worst = max(range(len(found)), key=lambda index: max(found[index].bends))
        begin, end, _, bends = found[worst]
        if max(bends) <= LOSS * max(stretch.bends[0] for stretch in found):
            break
        middle = (begin + end) / 2
        found[worst : worst + 1] = bounded(begin, middle), bounded(middle, end)
    return [stretch.hints for stretch in found]


def _bend(level: dict[str, Any]) -> float:
    """The bound of V̈ on a range of levels, 1/s²."""
    return max(-float(Fraction(cell["margin"])) for cell in level["cells"] if cell["order"] == max(ORDERS))


def hints_within(question: Question, bounds: Bounds, solver: Solver) -> list[dict[str, Any]]:
    """For an invariant funnel along paths within bounds, in bands of speed.

    Raises:
        NotProven, Broken, ValueError: as `robustness_document`.
    """
    require_tube_structure(question.dynamics)
    found = []
    for band in itertools.pairwise(speed_bands(bounds)):
        motions_and_levels = motions_within(question, bounds, band)
        found.append({"end": str(band[1]), "levels": [_levels(motion, solver) for motion, _ in motions_and_levels]})
    return found


def speed_bands(bounds: Bounds) -> list[fmpq]:
    """Ends of bands of speed, of equal ratio: as many as it takes to stay near BAND, and no more than MOST_BANDS."""
    lower, upper = bounds.speed
    count = max(1, min(MOST_BANDS, round(math.log(float(upper / lower), BAND))))
    inner = [rational(float(f"{float(lower) * float(upper / lower) ** (k / count):.3g}")) for k in range(1, count)]
    return [lower, *inner, upper]


def _levels(motion: HeldMotion, solver: Solver) -> dict[str, Any]:
    """Hints on one range of levels."""
    shape = np.array([[float(entry) for entry in row] for row in motion.shape])
    motion = replace(motion, whitening=round_whitening(shape / float(motion.peak)))
    enclosures: dict[int, UnaryEnclosure] = {}
    slopes: dict[int, UnaryEnclosure] = {}
    wanted = derivatives_of(motion.graph, motion.states)

    def fit_here(node: int, function: str, argument: Enclosure) -> Enclosure:
        enclosures[node] = enclose(function, argument)
        if node in wanted:
            slopes[node] = enclose(wanted[node], argument)
        return argument.apply(enclosures[node])

    motion.rates(motion.vertices[0], fit_here)
    motion = replace(motion, enclosures=enclosures, derivatives=slopes)
    budget = motion.domain.budget
    cells, programs = list(motion.cells()), []
    for cell in cells:
        budget.left = LARGEST_EFFORT  # a vertex has it to itself, as in the replay
        programs.append(program_of(motion, cell))
    written = []
    for cell, program, solution in zip(cells, programs, solved(solver, programs), strict=True):
        budget.left = LARGEST_EFFORT
        proof = _exactly(motion, cell, program, solution)
        grams = write_grams(proof.grams)
        written.append({"order": cell.order, "vertex": cell.vertex, "margin": str(proof.margin), "grams": grams})
    return {
        "whitening": [[str(entry) for entry in row] for row in motion.whitening],
        "enclosures": write_unary(enclosures),
        "derivatives": write_unary(slopes),
        "cells": written,
    }


def _exactly(motion: HeldMotion, cell: HeldCell, program: Program, solution: Solution) -> CellProof:
    found = prove(motion, cell, program, solution)
    if found.proof is None:
        name = f"the {cell.order}. derivative of V"
        raise NotProven(Verdict.SOLVER_FAILED, f"no bound of {name}: {found.solution}")
    return found.proof
