"""Hints for what a certified funnel absorbs: bounds on V̇ and V̈ over it, and the file that carries them.

Each vertex is a small semidefinite program (`cfjax.check.held`), some hundredths of a second. The file states the
largest amounts that were found (`amounts`), with hints for the bounds that allow them.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from flint import fmpq

from cfjax.certificate.amounts import entries_of, largest_amounts, write_amounts
from cfjax.certificate.bounds import bounds_along
from cfjax.certificate.fit import enclose
from cfjax.certificate.program import program_of, prove, solved
from cfjax.certificate.prover import NotProven
from cfjax.certificate.rounding import round_whitening
from cfjax.certificate.sampled import sampled_hints
from cfjax.certificate.writing import with_hash, write_bounds, write_grams, write_unary
from cfjax.check.amounts import Absorbed, Stated
from cfjax.check.bounds import Bounds
from cfjax.check.chain import CHAIN, prove_runs, read_chain
from cfjax.check.chain_robustness import leg_of, timing_of
from cfjax.check.document import SegmentClaim, read_certificate
from cfjax.check.enclosure import LARGEST_EFFORT, Enclosure, UnaryEnclosure
from cfjax.check.held import HeldCell, HeldMotion, derivatives_of
from cfjax.check.held_hints import CLAIM, DEGREES, SAMPLED
from cfjax.check.program import CellProof
from cfjax.check.proof import LegClaim
from cfjax.check.rational import rational
from cfjax.check.replay import stated_and_proven
from cfjax.check.robustness import motions, tube_motions
from cfjax.check.sampled import steady_leg
from cfjax.check.structure import require_tube_structure
from cfjax.check.symbolic import symbolic
from cfjax.coerce import instance, whole
from cfjax.result import Result
from cfjax.solver import DEFAULT, Program, Solution, Solver, solver_named
from cfjax.solver.program import Shape
from cfjax.verdict import Verdict


BAND, MOST_BANDS = 3.0, 2  # ratio of a band's speeds; each costs up to some hundred programs


def robustness_of(
    result: Result, workers: int = 1, solver: str | Solver = DEFAULT, period: float | None = None
) -> dict[str, Any] | None:
    """The file of hints for a certified result; None where there is nothing that is certified.

    With a `period` (s) also of a law that looks so far ahead and holds what it chooses (`cfjax.check.sampled`).

    Raises:
        NotProven, Broken, ValueError: as `robustness_document`.
    """
    document, workers = instance("result", result, Result).document, whole("workers", workers, 1)
    if document is None or document["claim"] not in ("funnel", CHAIN):
        return None
    return robustness_document(document, workers, solver, period)


def robustness_document(
    document: dict[str, Any], workers: int = 1, solver: str | Solver = DEFAULT, period: float | None = None
) -> dict[str, Any]:
    """The file of hints for a certificate, of funnels or of a path in tubes: the document that the checker accepted.

    Raises:
        NotProven: a bound that no hint was found for.
        Broken, ValueError: dynamics or levels of a kind that has no bounds here.
    """
    if document["claim"] == CHAIN:
        if period is not None:
            raise ValueError("sampled: expected a path of one segment, got one in tubes")
        return _chain_document(document, solver_named(solver, workers))
    certificate = read_certificate(document)
    problem = certificate.problem
    dynamics = symbolic(problem.vehicle.graph, problem.vehicle.states, tuple(problem.inputs))
    oracle = solver_named(solver, workers)
    each = zip(problem.distinct, certificate.funnels, certificate.hints, strict=True)
    funnels = [
        hints_for(LegClaim(problem, dynamics, segment, funnel), [stretch.end for stretch in hints.stretches], oracle)
        if isinstance(segment, SegmentClaim)
        else tube_hints(LegClaim(problem, dynamics, segment, funnel), oracle)
        for segment, funnel, hints in each
    ]
    content = {"funnels": funnels, "entries": [str(root) for root in entries_of(certificate)]}
    more = {}
    if period is not None:
        leg, course = steady_leg(certificate, dynamics)
        more[SAMPLED] = sampled_hints(leg, course.closed, rational(period), oracle)
    return _with_amounts(document, content, len(problem.vehicle.states), more)


def _with_amounts(
    document: dict[str, Any], content: dict[str, Any], states: int, more: Mapping[str, Any] = MappingProxyType({})
) -> dict[str, Any]:
    """The whole file: it states the largest amounts that are found for what its hints prove, and what there is more."""

    def file(stated: Stated, **more: Any) -> dict[str, Any]:
        return with_hash(CLAIM, {"certificate": document["hash"], "amounts": write_amounts(stated), **content, **more})

    nothing = Absorbed(fmpq(0), (fmpq(0),) * states, (fmpq(0),) * states, fmpq(0))
    _, bounds = stated_and_proven(document, file(Stated(nothing, nothing, ())))
    return file(largest_amounts(bounds), **more)


def _chain_document(document: dict[str, Any], solver: Solver) -> dict[str, Any]:
    """Of a path in tubes: for each of them, beside what the path does along its runs."""
    claim = read_chain(document, skip_hash=True)
    runs, _ = prove_runs(claim)
    index_of = {run.tube: index for run, (_, _, index) in zip(runs, claim.runs, strict=True)}
    tubes: dict[int, dict[str, Any]] = {}
    for tube, bounds in bounds_along(claim.reference, runs).items():
        leg = leg_of(claim, index_of[tube], tube, bounds, timing_of(runs))
        tubes[index_of[tube]] = {"bounds": write_bounds(bounds), "bands": tube_hints(leg, solver)}
    return _with_amounts(document, {"tubes": [entry for _, entry in sorted(tubes.items())]}, len(runs[0].tube.states))


def held_shape(states: int) -> Shape:
    """Of the largest programs that bound V̇ and V̈: the same for every funnel of so many states."""
    return states, (DEGREES[0], DEGREES[1], DEGREES[1])


def hints_for(leg: LegClaim[SegmentClaim], ends: list[fmpq], solver: Solver) -> list[dict[str, Any]]:
    """For one funnel: a stretch of θ ends at each of `ends`. Condition (d)'s own do.

    Raises:
        NotProven, Broken, ValueError: as `robustness_document`.
    """
    found = []
    for begin, end in itertools.pairwise([fmpq(0), *ends]):
        asked = motions(leg, (begin, end))
        found.append({"end": str(end), "levels": [_levels(motion, solver) for motion, _ in asked]})
    return found


def tube_hints(leg: LegClaim[Bounds], solver: Solver) -> list[dict[str, Any]]:
    """For a tube, in bands of speed.

    Raises:
        NotProven, Broken, ValueError: as `robustness_document`.
    """
    require_tube_structure(leg.dynamics)
    found = []
    for band in itertools.pairwise(speed_bands(leg.along)):
        asked = tube_motions(leg, band)
        found.append({"end": str(band[1]), "levels": [_levels(motion, solver) for motion, _ in asked]})
    return found


def speed_bands(tube: Bounds) -> list[fmpq]:
    """Ends of bands of speed, of equal ratio: as many as it takes to stay near BAND, and no more than MOST_BANDS."""
    lower, upper = tube.speed
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
