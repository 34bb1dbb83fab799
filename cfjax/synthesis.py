"""From a problem to a certified funnel: learner ⇄ falsifier, then certificate; then cars through it."""

import itertools
import os
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from cfjax.certificate import certify
from cfjax.falsifier import falsify
from cfjax.funnel import Funnel, template_named
from cfjax.learner import Learned, learn_for
from cfjax.options import Options, Progress
from cfjax.problem import Problem, Segment, Tube
from cfjax.result import Result, SegmentResult
from cfjax.simulation import Leg, drive_cars, drive_tube_cars
from cfjax.verdict import Verdict


GOOD_SHARE = 0.97  # certified over falsified margin: a proof that falls further behind is worth another round
LEAST_GAIN = 1.001  # certified margin over the best before: a round that brings less is the last one


def synthesize(problem: Problem, options: Options = Options(), progress: Progress | None = None) -> Result:
    """Find a control funnel function with the largest margin λ, prove it, and drive cars through it.

    `search` and `drive` in one, for whoever does not have to save the proof in between.

    Raises:
        InputError: where this kind of problem cannot be certified at all (see `cfjax.certificate.certify`).
    """
    return drive(search(problem, options, progress), options, progress)


def search(problem: Problem, options: Options = Options(), progress: Progress | None = None) -> Result:
    """Find a control funnel function with the largest margin λ and prove it.

    Learn, certify, and where the proof falls short of what the falsifier could not refute, learn again from the points
    that stood in the way. The best certified funnel is what is returned. `inconclusive` is no proof that none exists.

    Raises:
        InputError: where this kind of problem cannot be certified at all (see `cfjax.certificate.certify`).
    """
    started = time.perf_counter()
    loop = _Search(problem, options, progress or _silent)
    result = loop.run()
    return result.replace(seconds={**loop.seconds, "total": time.perf_counter() - started})


def drive(result: Result, options: Options = Options(), progress: Progress | None = None) -> Result:
    """Drive `options.cars` cars through the funnel of a certified result; any other result comes back as it is.

    The proof is finished and does not depend on them: where they cannot be driven (a number of cars that no memory
    holds, say), one line on stderr says why and the result comes back without a closed loop.
    """
    if result.verdict is not Verdict.CERTIFIED or not options.cars:
        return result
    progress = progress or _silent
    # one segment: the certifier refuses chains until their links are proven
    found, segment = result.segments[0], result.problem.path.segments[0]
    started = time.perf_counter()
    progress("simulate", 0, 1)
    try:
        margin, how_many = found.margin_certified or 0.0, {"cars": options.cars, "seed": options.seed}
        if isinstance(segment, Tube):
            per_metre = found.margin_per_metre or 0.0
            loop, cars = drive_tube_cars(result.problem, found.funnel, margin, per_metre, **how_many)
        else:
            ends = itertools.accumulate(segment.duration for segment in result.problem.path.segments)
            legs = [
                Leg(end, each.funnel, each.margin_certified or 0.0)
                for end, each in zip(ends, result.segments, strict=True)
            ]
            loop, cars = drive_cars(result.problem, legs, **how_many)
        result = result.replace(closed_loop=loop, rollouts=(cars,))
        progress("simulate", 1, 1)
    except Exception as error:
        print(f"warning: the cars were not driven ({_reason(error)}); the proof stands", file=sys.stderr)
    spent = time.perf_counter() - started
    return result.replace(
        seconds={**result.seconds, "simulate": spent, "total": result.seconds.get("total", 0.0) + spent}
    )


def _silent(stage: str, done: int, of: int) -> None:
    pass


@dataclass
class _Aim:
    """What a round starts from: the margin wanted of the learner (1/s; None for the largest), and the last round's."""

    target: float | None
    out_of_reach: bool = False  # the learner found no such margin
    warm: Funnel | None = None
    suspects: Float[np.ndarray, "k n"] | None = None


class _Search:
    """The learn–certify loop of one problem, with its clock and its history."""

    def __init__(self, problem: Problem, options: Options, progress: Progress) -> None:
        self.asked, self.options, self.progress = problem, options, progress
        self.problem = problem  # objective=inlet enlarges I: what is proven may ask for more than was asked
        self.template = template_named(options.template)
        self.seconds = {"learn": 0.0, "certify": 0.0}
        self.history: list[dict[str, float]] = []

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += time.perf_counter() - start

    def run(self) -> Result:
        """Rounds of learning and proving; a round that fails does not lose what an earlier one has proven."""
        wanted = self.options.objective.margin
        best: Result | None = None
        aim = _Aim(wanted)
        for round_ in range(self.options.rounds):
            try:
                result = self._round(round_, aim)
            except Exception as error:
                if best is None or best.verdict is not Verdict.CERTIFIED:
                    raise
                print(
                    f"warning: round {round_ + 1} failed ({_reason(error)}); an earlier proof stands", file=sys.stderr
                )
                break
            before = 0.0 if best is None else best.margin_certified or 0.0
            best = result if best is None else max(best, result, key=self._rank)
            certified, falsified = result.margin_certified or 0.0, result.margin_falsified or 0.0
            self.history.append(
                {
                    "falsified": falsified,
                    "certified": certified,
                    "counterexamples": 0 if aim.suspects is None else len(aim.suspects),
                }
            )
            if certified >= (GOOD_SHARE * falsified if wanted is None else wanted) and certified:
                break
            if certified < LEAST_GAIN * before:  # as long as nothing is proven, every round is worth its time
                break
            if aim.target is not None and wanted is not None:
                if aim.out_of_reach:  # this was the largest margin
                    break
                # the proof fell short of what the learner aimed at: aim as much higher
                aim.target *= 1.001 * wanted / certified if certified else 1 / GOOD_SHARE
        assert best is not None
        return best.replace(iterations=len(self.history), history=tuple(self.history))

    def _round(self, round_: int, aim: "_Aim") -> Result:
        segment = self.asked.path.segments[0]
        self.problem, learned = self._learn(segment, round_, aim)
        aim.out_of_reach = aim.target is not None and (learned is None or learned.margin < aim.target)
        if learned is None:
            return self._result(Verdict.INCONCLUSIVE, "no candidate was found that satisfies (a), (b) and (c)")
        if learned.margin <= 0:
            message = f"the best candidate found has a margin of {learned.margin:.3g} 1/s"
            return self._result(Verdict.INCONCLUSIVE, message, learned.funnel, learned.margin)
        result, aim.suspects = self._certify(segment, learned)
        aim.warm = learned.funnel
        return result

    def _learn(self, segment: Segment | Tube, round_: int, aim: "_Aim") -> tuple[Problem, Learned | None]:
        """The best funnel for the objective, and the problem that it solves."""
        with self.timed("learn"):
            return learn_for(
                self.options.objective,
                aim.target,
                self.asked,
                segment,
                self.template,
                beta_lower=self.options.beta_lower,
                beta_inner=self.options.beta_inner,
                candidates=self.options.restarts,
                seed=self.options.seed + 1000 * round_,
                warm=aim.warm,
                counterexamples=aim.suspects,
                progress=lambda done, of: self.progress("learn", done, of),
            )

    def _certify(self, segment: Segment | Tube, learned: Learned) -> tuple[Result, Float[np.ndarray, "k n"]]:
        """Certify, and falsify what was certified: rounding has moved it a little."""
        with self.timed("certify"):
            found = certify(self.problem, [learned.funnel], progress=self.progress, workers=_cores())
        with self.timed("learn"):
            funnel = found.funnels[0] if found.funnels else learned.funnel
            worst = {point.condition: point for point in falsify(self.problem, segment, funnel, seed=self.options.seed)}
        margin = min(worst["d"].slack, learned.margin) if funnel is learned.funnel else worst["d"].slack
        result = self._result(found.verdict, found.message, funnel, margin)
        if found.verdict is Verdict.CERTIFIED and found.margins:
            sos = found.numerical_margins[0]
            segments = (
                replace(
                    result.segments[0],
                    margin_certified=found.margins[0],
                    margin_per_metre=found.margins_per_metre[0],
                    margin_sos=sos,
                ),
            )
            result = result.replace(segments=segments, document=found.document)
        suspects = np.array([worst["d"].x, *found.suspects])
        return result, suspects

    def _result(
        self, verdict: Verdict, message: str, funnel: Funnel | None = None, margin: float = float("nan")
    ) -> Result:
        segments = (SegmentResult(funnel, margin),) if funnel is not None else ()
        return Result(verdict, message, self.problem, segments)

    def _rank(self, result: Result) -> tuple[float, ...]:
        """Larger is better; among unproven ones the falsified margin counts."""
        if not result.segments:
            return (-1.0,)
        certified, found = result.margin_certified or 0.0, result.segments[0]
        ranked = self.options.objective.rank(result.problem, found.funnel, certified)
        return (*ranked, found.margin_falsified)


def _reason(error: Exception) -> str:
    """One line: XLA's messages go on for pages."""
    return traceback.format_exception_only(error)[0].splitlines()[0]


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
