"""Where along the path a proof ended, as `Result.failed_at` says it and pictures mark it: no program is solved here."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from flint import fmpq

from cfjax.certificate import certify
from cfjax.certificate.prover import NotProven, Prover, StretchProof
from cfjax.certificate.stretches import ThetaInterval
from cfjax.conf import preset, problem_of
from cfjax.funnel import Funnel, template_named
from cfjax.problem import FootprintDisc, Problem, ball
from cfjax.problem.obstacles import distances
from cfjax.verdict import Verdict


def _problem(name: str) -> Problem:
    return problem_of(preset(name))


def _funnels(problem: Problem, size: float, rate: float) -> list[Funnel]:
    """One for each distinct segment: {q <= 1} is a ball, of radius `size`."""
    shape = np.eye(4) / size**2
    return [Funnel(template_named("contracting"), shape, rate, s.duration) for s in problem.path.distinct]


def test_where_the_body_may_touch() -> None:
    problem = replace(_problem("obstacle"), footprint=(FootprintDisc(0.3),))
    found = certify(problem, _funnels(problem, 0.35, 0.05))
    assert "condition (c), segment 0" in found.message
    assert found.failed_at is not None and found.failed_at[0] == found.failed_at[1]
    (segment,), (square,) = problem.path.curve, problem.obstacles
    theta = np.array([found.failed_at[0], *np.linspace(0.0, segment.duration, 400)])
    order = np.argsort(theta)
    apart, _ = distances(square, segment.poses(theta[order])[:, 1:])
    there = apart[np.flatnonzero(order == 0)[0]]
    assert there < apart.min() + 0.02  # the funnel hardly shrinks: it comes farthest where its middle is nearest


def test_the_joint_whose_link_is_broken() -> None:
    problem = replace(_problem("oval"), inlet=ball(0.3), goal=ball(0.9))
    found = certify(problem, _funnels(problem, 0.45, -0.1))  # grows
    assert "from segment 0 to segment 1" in found.message
    end = problem.path.curve[0].duration
    assert found.failed_at == (end, end)


def test_the_stretch_that_proved_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = _problem("figure_eight")
    first, second = (segment.duration for segment in problem.path.curve)

    def prove(self: Prover, stretch: ThetaInterval, *_: Any) -> StretchProof:
        if self.kind == 1:
            raise NotProven(Verdict.INCONCLUSIVE, f"{stretch.name}nothing")
        return StretchProof(stretch, (), fmpq(1), fmpq(1), 1.0, {}, (), ())

    monkeypatch.setattr(Prover, "prove", prove)
    found = certify(problem, _funnels(problem, 0.53, 0.2))
    assert found.message.endswith("nothing")
    assert found.failed_at == pytest.approx((first, first + second))


def test_what_fails_everywhere_has_no_place() -> None:
    problem = _problem("oval")
    found = certify(problem, _funnels(problem, 0.4, 0.2))  # does not hold I
    assert (found.verdict, found.failed_at) == (Verdict.INCONCLUSIVE, None)
