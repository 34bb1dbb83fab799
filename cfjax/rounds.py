"""Rounds of learning and proving: learner ⇄ falsifier, then certificate, until nothing is gained any more."""

import sys
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from cfjax.certificate import certify
from cfjax.clock import Clock
from cfjax.errors import Interrupted
from cfjax.falsifier import Counterexample, falsify
from cfjax.funnel import Funnel, template_named
from cfjax.learner import Found, Learned, LearningTask
from cfjax.learner.objective import rank
from cfjax.options import Options
from cfjax.problem import Problem
from cfjax.result import Result, SegmentResult, WorstPlace
from cfjax.verdict import Verdict


GOOD_SHARE = 0.97  # certified over falsified margin: what a proof aims at, by shorter stretches where need be
CURVED_SHARE = 0.95  # where segments vary: the last percents would cost many stretches
ENOUGH_SHARE = 0.94  # a proof that falls further behind is worth another round of learning
LEAST_GAIN = 1.001  # certified margin over the best before: a round that brings less is the last one


@dataclass
class _Aim:
    """What a round starts from: the margin wanted of the learner (1/s; None for the largest), and the last round's."""

    target: float | None
    out_of_reach: bool = False  # the learner found no such margin
    warm: tuple[Funnel, ...] | None = None
    counterexamples: tuple[Counterexample, ...] = ()


class LearnCertifyLoop:
    """The learn–certify loop of one problem, with its clock and its history."""

    def __init__(self, problem: Problem, options: Options, clock: Clock, workers: int) -> None:
        self.given, self.options, self.clock, self.workers = problem, options, clock, workers
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
                    f"warning: round {round_ + 1} failed ({reason_of(error)}); an earlier proof stands", file=sys.stderr
                )
                break
            except KeyboardInterrupt:
                if best is None or best.verdict is not Verdict.CERTIFIED:
                    raise
                seconds = {**self.clock.seconds, "total": sum(self.clock.seconds.values(), 0.0)}
                raise Interrupted(self._with_history(best).replace(seconds=seconds)) from None
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
        return self._with_history(best)

    def _with_history(self, best: Result) -> Result:
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
            self.given,
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


def reason_of(error: Exception) -> str:
    """One line: XLA's messages go on for pages."""
    return traceback.format_exception_only(error)[0].splitlines()[0]
