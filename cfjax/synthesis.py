"""From a problem to a certified funnel: learner ⇄ falsifier, then certificate; then cars through it."""

import os
import sys
import time
from dataclasses import replace

from cfcheck import check_document
from cfcheck.reader import Broken
from cfcheck.replay import check_robustness
from cfcheck.vehicle.structure import has_tube_structure, require_tube_structure
from cfjax import coerce
from cfjax.ahead import compile_ahead
from cfjax.certificate import Statement, proof_size, require_posable, require_room, robustness_of, statement_of
from cfjax.certificate.absorbed import held_to, with_amounts
from cfjax.certificate.prover import NotProven
from cfjax.certificate.robustness import Hints, with_holds
from cfjax.certificate.trace import dynamics_of
from cfjax.clock import Clock
from cfjax.errors import InputError, Interrupted
from cfjax.funnel import template_named
from cfjax.options import Options, Progress
from cfjax.problem import Path, Problem, Vehicle
from cfjax.progress import watched
from cfjax.question import check_question, doubts
from cfjax.result import Result
from cfjax.rounds import LearnCertifyLoop, reason_of
from cfjax.simulation import drive_cars
from cfjax.solver.program import Shape
from cfjax.tubes.hold import hold_by_learning, hold_by_library
from cfjax.verdict import Verdict


MOST_FUNNELS = 1  # of a path that gets funnels of its own unless told otherwise: chains of several go by tubes
MOST_TRIED = 8  # of a path that no tube holds: more of them are learned only where that is what the user wants


def synthesize(problem: Problem, options: Options = Options(), progress: Progress | None = None) -> Result:
    """Find a control funnel function with the largest margin λ, prove it, and drive cars through it.

    `search`, a proof of the period that is asked for, and `drive` in one, for whoever does not have to save the proof
    in between.

    Args:
        problem: the question.
        options: how the funnel is sought.
        progress: hears how far each stage is, as (stage, done, of). None: bars show it on a terminal, lines in a
            notebook; elsewhere nothing is shown.

    Raises:
        InputError: where this kind of problem cannot be certified at all (see `cfjax.certificate.certify`).
    """
    coerce.function("progress", progress)
    with watched(progress) as clock:
        try:
            found = search(problem, options, clock)
        except Interrupted as stopped:
            result: Result = stopped.result
            if options.period is not None:
                result = held_to(result, options.period, options.delay, "the search was interrupted")
            raise Interrupted(result) from None
        return drive(_hardened(found, options, clock), options, clock)


def search(problem: Problem, options: Options = Options(), progress: Progress | None = None) -> Result:
    """Find a control funnel function with the largest margin λ and prove it.

    Learn, certify, and where the proof falls short of what the falsifier could not refute, learn again from the points
    that stood in the way. The best certified funnel is what is returned. `inconclusive` is no proof that none exists.
    The period that is asked for is no part of it: that is proven by `synthesize`, or in the run folder.
    What is given and changes nothing, and what another unit explains better, is named on stderr, in a line each.
    Problem, options and progress are those of `synthesize`.

    Raises:
        InputError: where this kind of problem cannot be certified at all (see `cfjax.certificate.certify`).
        Interrupted: a KeyboardInterrupt, with the result of an earlier round that has proven something.
    """
    check_question(problem, options)
    coerce.function("progress", progress)
    started = time.perf_counter()
    for line in doubts(problem, options):
        print(f"warning: {line}", file=sys.stderr)
    with watched(progress) as clock:
        result = _searched(problem, options, clock)
    return result.replace(seconds={**clock.seconds, "total": time.perf_counter() - started})


def _searched(problem: Problem, options: Options, clock: Clock) -> Result:
    """By funnels of the path's own, or by tubes."""
    if problem.path.tube or problem.law or options.certificate == "segment" or not options.chosen_learner.tubes:
        return _by_segments(problem, options, clock)
    if options.certificate == "tube":
        _require_tubes(problem.vehicle)
        return _by_tubes(problem, options, clock)
    if (
        problem.input_share != 1
        or _is_short(problem.path)
        or not _fits_tubes(options)
        or not has_tube_structure(dynamics_of(problem.vehicle))
    ):
        return _by_segments(problem, options, clock)
    result = _by_tubes(problem, options, clock)
    return result if result.verdict is Verdict.CERTIFIED else _instead(result, problem, options, clock)


def _instead(failed: Result, problem: Problem, options: Options, clock: Clock) -> Result:
    """Funnels of the path's own segments, where they are few; else what is known, and how to have them."""
    count = len(problem.path.distinct)
    if count <= MOST_TRIED or problem.obstacles:  # beside these a funnel of its own may be narrow where it has to be
        return _by_segments(problem, options, clock)
    return failed.replace(
        message=f"{failed.message}; certificate=segment would learn and prove a funnel for each of the path's {count} "
        f"segments, a larger path.segment_length or smaller bounds (path.speed, path.acceleration) may hold in one tube"
    )


def _is_short(path: Path) -> bool:
    """Whether a funnel of its own costs little: segments that are alike, at constant speed, which is half the proof."""
    return len(path.distinct) <= MOST_FUNNELS and all(segment.speed.is_constant for segment in path.curve)


def _require_tubes(vehicle: Vehicle) -> None:
    """Raises InputError unless a tube can hold the vehicle: its reference's states must not go with the curvature."""
    try:
        require_tube_structure(dynamics_of(vehicle))
    except Broken as error:
        raise InputError(f"certificate: expected auto or segment, got tube: {error}") from None


def _fits_tubes(options: Options) -> bool:
    """Whether tubes are asked for nothing that they are not: they have one template, and finished ones one margin."""
    return options.template == "contracting" and options.objective.margin is None


def _by_segments(problem: Problem, options: Options, clock: Clock) -> Result:
    """Funnels made for the path's own segments; or the one of a tube."""
    statement = statement_of(problem)  # what no proof answers is not learned first
    require_posable(problem, statement, template_named(options.template), options.beta_lower, options.beta_inner)
    workers, shapes = _room_for(problem, statement, options)
    if _cores() > 1:
        compile_ahead(problem, shapes, options)
    return LearnCertifyLoop(problem, options, clock, workers).run()


def _room_for(problem: Problem, statement: Statement, options: Options) -> tuple[int, tuple[Shape, ...]]:
    """How many programs of the proof are solved side by side, and their shapes, as far as they are known.

    A proof that takes long is announced on stderr.

    Raises:
        InputError: it takes more than `options.proof` allows.
    """
    levels = options.beta_lower, options.beta_inner
    size = proof_size(problem, statement, template_named(options.template), *levels, options.solver)
    if size is None:
        return _cores(), ()
    workers, line = require_room(size, options.proof.memory, options.proof.hours, _cores())
    if line:
        print(line, file=sys.stderr)
    return workers, size.shapes


def _by_tubes(problem: Problem, options: Options, clock: Clock) -> Result:
    """Tubes that came with the package where they do it, else one that is learned for the path's bounds."""

    def learned(bounds: Problem, beta_inner: float) -> Result:
        inner = min(beta_inner, options.beta_inner or beta_inner)
        try:
            return _by_segments(bounds, replace(options, beta_inner=inner), clock)
        except Interrupted:  # what was proven answers another question
            raise KeyboardInterrupt from None

    with clock.stage("tubes"):
        found = hold_by_library(problem) if _fits_tubes(options) else None
        return found or hold_by_learning(problem, learned)


def harden(result: Result, options: Options = Options(), progress: Progress | None = None) -> Hints:
    """Hints for what the funnels of a certified result absorb, and for the period and delay that are asked for.

    Raises:
        ValueError, NotProven: nothing was found.
    """
    coerce.objects(result=(result, Result), options=(options, Options))
    if not options.robustness:
        return Hints(None)
    with watched(progress) as clock, clock.stage("robustness"):
        file = robustness_of(result, workers=_cores(), solver=options.solver)
        if file is None or result.document is None or options.period is None:
            return Hints(file)
        try:
            return Hints(file, with_holds(result.document, file, options.period, options.delay, options.solver))
        except (NotProven, ValueError) as failure:
            return Hints(file, lack=str(failure))


def _hardened(result: Result, options: Options, clock: Clock) -> Result:
    """The result with what the checker shows of the period and the delay that are asked for, if that is enough."""
    if options.period is None or result.verdict is not Verdict.CERTIFIED:
        return result
    try:
        hints = harden(result, options, clock)
        if hints.whole is None:
            return held_to(result, options.period, options.delay, hints.lack)
        with clock.stage("check"):
            report = check_robustness(check_document(result.document), result.document, hints.whole)
    except (NotProven, ValueError) as failure:
        return held_to(result, options.period, options.delay, str(failure))
    return held_to(with_amounts(result, report), options.period, options.delay, report.refusal)


def drive(result: Result, options: Options = Options(), progress: Progress | None = None) -> Result:
    """Drive `options.cars` cars through the funnel of a certified result; any other result comes back as it is.

    The proof is finished and does not depend on them: where they cannot be driven (a number of cars that no memory
    holds, say), one line on stderr says why and the result comes back without a closed loop.

    Raises:
        InputError: for what is no result, or no options.
    """
    coerce.objects(result=(result, Result), options=(options, Options))
    coerce.function("progress", progress)
    if result.verdict is not Verdict.CERTIFIED or not options.cars:
        return result
    with watched(progress, result.seconds) as clock:
        before = clock.spent("simulate")
        try:
            with clock.stage("simulate"):
                loop, cars = drive_cars(result.problem, result.legs, cars=options.cars, seed=options.seed)
                result = result.replace(closed_loop=loop, rollouts=(cars,))
        except Exception as error:
            print(f"warning: the cars were not driven ({reason_of(error)}); the proof stands", file=sys.stderr)
        spent = clock.spent("simulate")
    total = result.seconds.get("total", 0.0) + spent - before
    return result.replace(seconds={**result.seconds, "simulate": spent, "total": total})


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
