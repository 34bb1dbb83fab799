"""From a problem to a certified funnel: learner ⇄ falsifier, then certificate; then cars through it."""

import os
import sys
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from cfjax import coerce
from cfjax.ahead import compile_ahead
from cfjax.certificate import Statement, certify, proof_size, require_posable, require_room, robustness_of, statement_of
from cfjax.certificate.prover import NotProven
from cfjax.certificate.trace import dynamics_of
from cfjax.check.reader import Broken
from cfjax.check.structure import has_tube_structure, require_tube_structure
from cfjax.clock import Clock
from cfjax.errors import InputError, Interrupted
from cfjax.falsifier import Counterexample, falsify
from cfjax.funnel import Funnel, template_named
from cfjax.learner import Found, Learned, LearningTask
from cfjax.learner.objective import rank
from cfjax.options import Options, Progress
from cfjax.problem import Path, Problem, Vehicle
from cfjax.progress import watched
from cfjax.question import check_question, doubts
from cfjax.result import Result, SegmentResult, WorstPlace
from cfjax.simulation import drive_cars
from cfjax.solver.program import Shape
from cfjax.tubes.hold import hold_by_learning, hold_by_library
from cfjax.verdict import Verdict


MOST_FUNNELS = 1  # of a path that gets funnels of its own unless told otherwise: chains of several go by tubes
MOST_TRIED = 8  # of a path that no tube holds: more of them are learned only where that is what the user wants
GOOD_SHARE = 0.97  # certified over falsified margin: what a proof aims at, by shorter stretches where need be
CURVED_SHARE = 0.95  # where segments vary: the last percents would cost many stretches
ENOUGH_SHARE = 0.94  # a proof that falls further behind is worth another round of learning
LEAST_GAIN = 1.001  # certified margin over the best before: a round that brings less is the last one


def synthesize(problem: Problem, options: Options = Options(), progress: Progress | None = None) -> Result:
    """Find a control funnel function with the largest margin λ, prove it, and drive cars through it.

    `search` and `drive` in one, for whoever does not have to save the proof in between.

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
        return drive(search(problem, options, clock), options, clock)


def search(problem: Problem, options: Options = Options(), progress: Progress | None = None) -> Result:
    """Find a control funnel function with the largest margin λ and prove it.

    Learn, certify, and where the proof falls short of what the falsifier could not refute, learn again from the points
    that stood in the way. The best certified funnel is what is returned. `inconclusive` is no proof that none exists.
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
    if problem.path.tube or options.certificate == "segment" or not options.chosen_learner.tubes:
        return _by_segments(problem, options, clock)
    if options.certificate == "tube":
        _require_tubes(problem.vehicle)
        return _by_tubes(problem, options, clock)
    if (
        problem.authority != 1
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
    return _Search(problem, options, clock, workers).run()


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


def harden(result: Result, options: Options = Options(), progress: Progress | None = None) -> dict[str, Any] | None:
    """Hints for what the funnels of a certified result absorb; None where not asked.

    Where the period that is asked for is not proven, one line on stderr says why, and the rest comes without it.

    Raises:
        ValueError, NotProven: nothing was found.
    """
    coerce.objects(result=(result, Result), options=(options, Options))
    if not options.robustness:
        return None
    harden_with = partial(robustness_of, result, workers=_cores(), solver=options.solver)
    with watched(progress) as clock, clock.stage("robustness"):
        try:
            return harden_with(period=options.period)
        except (NotProven, ValueError) as failure:
            if options.period is None:
                raise
            print(f"warning: period: {options.period:g} s are not proven: {failure}", file=sys.stderr)
        return harden_with()


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
            print(f"warning: the cars were not driven ({_reason(error)}); the proof stands", file=sys.stderr)
        spent = clock.spent("simulate")
    total = result.seconds.get("total", 0.0) + spent - before
    return result.replace(seconds={**result.seconds, "simulate": spent, "total": total})


@dataclass
class _Aim:
    """What a round starts from: the margin wanted of the learner (1/s; None for the largest), and the last round's."""

    target: float | None
    out_of_reach: bool = False  # the learner found no such margin
    warm: tuple[Funnel, ...] | None = None
    counterexamples: tuple[Counterexample, ...] = ()


class _Search:
    """The learn–certify loop of one problem, with its clock and its history."""

    def __init__(self, problem: Problem, options: Options, clock: Clock, workers: int) -> None:
        self.asked, self.options, self.clock, self.workers = problem, options, clock, workers
        self.problem = problem  # objective=inlet enlarges I: what is proven may ask for more than was asked
        self.template = template_named(options.template)
        self.learner = options.chosen_learner
        self.history: list[dict[str, float]] = []
        self.search: dict[str, Any] = {}
        self.is_final = False  # the last certification ended for a reason that is no matter of the funnel

    def run(self) -> Result:
        """Rounds of learning and proving; a round that fails does not lose what an earlier one has proven."""
        wanted = self.options.objective.margin
        best: Result | None = None
        aim = _Aim(wanted)
        for round_ in range(self.learner.rounds):
            try:
                result = self._round(round_, aim)
            except Exception as error:
                if best is None or best.verdict is not Verdict.CERTIFIED:
                    raise
                print(
                    f"warning: round {round_ + 1} failed ({_reason(error)}); an earlier proof stands", file=sys.stderr
                )
                break
            except KeyboardInterrupt:
                if best is None or best.verdict is not Verdict.CERTIFIED:
                    raise
                seconds = {**self.clock.seconds, "total": sum(self.clock.seconds.values(), 0.0)}
                raise Interrupted(self._told(best).replace(seconds=seconds)) from None
            before = 0.0 if best is None else best.margin_certified or 0.0
            best = result if best is None else max(best, result, key=self._rank)
            certified, falsified = result.margin_certified or 0.0, result.margin_falsified or 0.0
            self.history.append(
                {
                    "falsified": falsified,
                    "certified": certified,
                    "counterexamples": len(aim.counterexamples),
                }
            )
            if self.is_final:
                break
            if certified >= (ENOUGH_SHARE * falsified if wanted is None else wanted) and certified:
                break
            if certified < LEAST_GAIN * before:  # as long as nothing is proven, every round is worth its time
                break
            if aim.target is not None and wanted is not None:
                if aim.out_of_reach:  # this was the largest margin
                    break
                # the proof fell short of what the learner aimed at: aim as much higher
                aim.target *= 1.001 * wanted / certified if certified else 1 / GOOD_SHARE
        assert best is not None
        return self._told(best)

    def _told(self, best: Result) -> Result:
        """The result with how it was found."""
        return best.replace(iterations=len(self.history), history=tuple(self.history), search=self.search)

    def _round(self, round_: int, aim: "_Aim") -> Result:
        found = self._learn(round_, aim)
        self.problem, learned = found.problem, found.learned
        aim.out_of_reach = aim.target is not None and (learned is None or learned.margin < aim.target)
        if learned is None:
            return Result(Verdict.INCONCLUSIVE, found.reason, self.problem)
        if learned.margin <= 0:
            message = f"the best candidate found has a margin of {learned.margin:.3g} 1/s"
            segments = [SegmentResult(funnel, learned.margin) for funnel in learned.funnels]
            with self.clock.stage("falsify"):
                worst = [point for kind, funnel in enumerate(learned.funnels) for point in self._worst(kind, funnel)]
            return Result(Verdict.INCONCLUSIVE, message, self.problem, self._along(segments), worst_points=tuple(worst))
        result, aim.counterexamples = self._certify(learned)
        aim.warm = learned.funnels
        return result

    def _learn(self, round_: int, aim: "_Aim") -> Found:
        """The best candidates for the objective, and the problem that they solve."""
        task = LearningTask(
            self.asked,
            self.template,
            self.options.beta_lower,
            self.options.beta_inner,
            self.options.objective,
            aim.target,
            seed=self.options.seed + 1000 * round_,
            warm=aim.warm,
            counterexamples=aim.counterexamples,
        )
        with self.clock.stage("learn"):
            found = self.learner.learn(task, lambda done, of: self.clock("learn", done, of))
        self.search["learner"] = self.learner.name
        for name, figure in found.figures.items():
            self.search[name] = self.search.get(name, 0) + figure if isinstance(figure, int) else figure
        return found

    def _certify(self, learned: Learned) -> tuple[Result, tuple[Counterexample, ...]]:
        """Certify, and falsify what was certified: rounding has moved it a little."""
        distinct = self.problem.path.distinct
        with self.clock.stage("certify"):
            # a stretch that proves what is wanted, or nearly what was not refuted, needs not be cut
            share = GOOD_SHARE if all(segment.is_steady for segment in distinct) else CURVED_SHARE
            wanted = self.options.objective.margin
            target = share * learned.margin if wanted is None else min(wanted, learned.margin)
            found = certify(
                self.problem,
                learned.funnels,
                target=target,
                progress=self.clock,
                workers=self.workers,
                solver=self.options.solver,
            )
        self.search["solver"] = ", ".join(found.solvers) or self.options.solver
        self.is_final = found.final
        results, counterexamples, places = [], list(found.counterexamples), []
        with self.clock.stage("falsify"):
            for kind, funnel in enumerate(found.funnels):
                points = self._worst(kind, funnel)
                places += points
                worst = next(point for point in points if point.condition == "d")
                counterexamples.append(Counterexample(kind, worst.theta or 0.0, worst.x))
                results.append(SegmentResult(funnel, worst.slack))
            # rounding changes no digit that counts: what the learner's search has found holds too
            least = min(range(len(results)), key=lambda kind: results[kind].margin_falsified)
            known = min(results[least].margin_falsified, learned.margin)
            results[least] = replace(results[least], margin_falsified=known)
        if found.verdict is Verdict.CERTIFIED and found.margins:
            results = [
                replace(
                    result, margin_certified=margin, margin_per_metre=per_metre, margin_sos=sos, stretches=stretches
                )
                for result, margin, per_metre, sos, stretches in zip(
                    results,
                    found.margins,
                    found.margins_per_metre,
                    found.numerical_margins,
                    found.stretches,
                    strict=True,
                )
            ]
        segments = self._along(results)
        result = Result(found.verdict, found.message, self.problem, segments, document=found.document)
        return result.replace(failed_at=found.failed_at, worst_points=tuple(places)), tuple(counterexamples)

    def _worst(self, kind: int, funnel: Funnel) -> list[WorstPlace]:
        """The falsifier's points against a funnel of a distinct segment, at the first such segment of the path."""
        segment, first = self.problem.path.distinct[kind], self.problem.path.kinds.index(kind)
        return [
            WorstPlace(first, point.condition, point.slack, point.theta if segment.last_theta else None, point.x)
            for point in falsify(self.problem, segment, funnel, seed=self.options.seed)
        ]

    def _along(self, results: Sequence[SegmentResult]) -> tuple[SegmentResult, ...]:
        """Those of the distinct segments, segment by segment of the path."""
        return tuple(results[kind] for kind in self.problem.path.kinds)

    def _rank(self, result: Result) -> tuple[float, ...]:
        """Larger is better; among unproven ones the falsified margin counts."""
        if not result.segments:
            return (-1.0,)
        certified, falsified = result.margin_certified or 0.0, result.margin_falsified or 0.0
        funnels = [found.funnel for found in result.segments]
        return (*rank(self.options.objective, result.problem, funnels, certified), falsified)


def _reason(error: Exception) -> str:
    """One line: XLA's messages go on for pages."""
    return traceback.format_exception_only(error)[0].splitlines()[0]


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
