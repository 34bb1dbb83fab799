"""A path between its sets by tubes: proven bounds, the package's tubes, and what is refused."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cfcheck import Outcome, check_document
from cfcheck.claims.document import document_hash
from cfjax import synthesis
from cfjax.errors import InputError
from cfjax.funnel import Objective
from cfjax.options import Options
from cfjax.problem import (
    Disc,
    Ellipsoid,
    Interval,
    Path,
    Problem,
    ball,
    circle,
    ellipse,
    figure_eight,
    oval,
    slalom,
    straight,
)
from cfjax.result import Result
from cfjax.tubes.hold import bounds_of, hold_by_learning, hold_by_library
from cfjax.verdict import Verdict


NARROW = Problem(slalom(amplitude=0.3), inlet=ball(0.15), goal=ball(0.25))


@pytest.mark.parametrize("path", [oval(), figure_eight(), slalom(), circle(), straight()], ids=lambda p: p.name)
def test_bounds_hold_and_are_close(path) -> None:
    bounds = bounds_of(path)
    for segment in path.curve:
        points = [segment.point(theta) for theta in np.linspace(0, segment.duration, 400)]
        curvature = np.array([point.turn_rate / point.speed for point in points])
        assert bounds.curvature.lower <= curvature.min() and curvature.max() <= bounds.curvature.upper
        assert all(point.speed in bounds.speed for point in points)
    widest = max(abs(bounds.curvature.lower), bounds.curvature.upper)
    assert (
        widest
        <= np.abs(
            [s.point(t).turn_rate / s.point(t).speed for s in path.curve for t in np.linspace(0, s.duration, 2001)]
        ).max()
        + 1e-3
    )
    if path.name in ("slalom", "figure_eight"):  # as much to the left as to the right
        assert bounds.curvature.lower == -bounds.curvature.upper


def test_the_package_holds_a_slalom() -> None:
    result = hold_by_library(NARROW)
    assert result is not None and result.verdict is Verdict.CERTIFIED and result.document is not None
    assert result.segments[0].span is not None and result.segments[0].span[0] == 0.0
    assert result.segments[-1].span is not None
    assert result.segments[-1].span[1] == pytest.approx(sum(segment.duration for segment in NARROW.path.curve))
    assert "I with half-axes (0.15, 0.15, 0.15, 0.15)" in result.message
    # the sets are claims: larger ones are not proven
    for name, values, words in (
        ("inlet", {"half_axes": ["1/2"] * 4}, "does not lie inside the funnel's start"),
        ("goal", {"half_axes": ["1/20"] * 4}, "does not lie inside the goal G"),
        ("safe", {"half_widths": ["1", "1/10", "1", "1"]}, "leaves the safe set S in x"),
    ):
        question = result.document["problem"]
        document = {**result.document, "problem": {**question, "sets": {**question["sets"], name: values}}}
        report = check_document({**document, "hash": document_hash(document)})
        assert report.outcome is Outcome.BROKEN and words in report.message


def test_the_package_has_no_tube_for_these() -> None:
    assert hold_by_library(replace(NARROW, inlet=ball(0.5), goal=ball(0.6))) is None
    assert hold_by_library(replace(NARROW, goal=ball(0.01))) is None
    assert hold_by_library(Problem(slalom(amplitude=0.3, speed=0.1), inlet=ball(0.15), goal=ball(0.25))) is None


def test_what_is_asked_of_a_learned_tube_and_what_becomes_of_none() -> None:
    asked = []

    def learn(problem: Problem, inner: float) -> Result:
        asked.append((problem, inner))
        return Result(Verdict.INCONCLUSIVE, "nothing found", problem)

    problem = Problem(oval(), inlet=ball(0.5), goal=Ellipsoid((0.5, 0.3, 0.3, 0.5)))
    result = hold_by_learning(problem, learn)
    ((tube, inner),) = asked
    assert tube.path.tube is not None and tube.path.tube.curvature.upper == pytest.approx(2.0, abs=1e-3)
    assert tube.inlet == problem.inlet
    # {V ≤ inner} of a tube inside that larger G lies in the G that was asked for
    assert all(
        np.sqrt(inner) * wide <= goal for wide, goal in zip(tube.goal.half_axes, problem.goal.half_axes, strict=True)
    )
    assert all(wide > start for wide, start in zip(tube.goal.half_axes, tube.inlet.half_axes, strict=True))
    assert result.verdict is Verdict.INCONCLUSIVE and result.problem == problem
    assert "no tube for the path's bounds: nothing found" in result.message


def test_a_goal_that_no_tube_comes_down_to_is_an_answer_and_no_bad_input() -> None:
    problem = Problem(figure_eight(), inlet=ball(0.5), goal=ball(0.05))
    result = hold_by_learning(problem, lambda *_: pytest.fail("asked to learn"))
    assert (
        result.verdict is Verdict.INCONCLUSIVE and "no tube for the path's bounds leads from I to G" in result.message
    )


def test_the_law_keeps_to_the_timing_that_is_proven() -> None:
    result = hold_by_library(replace(NARROW, timing=Interval(0.25, 4.0)))
    assert result is not None and result.problem.timing == Interval(0.5, 2.0)
    assert "u0 in [0.5, 2]" in result.message
    assert hold_by_library(replace(NARROW, timing=Interval(0.75, 1.5))) is None  # proven with more than there is


def test_one_speed_stays_one_speed() -> None:
    bounds = bounds_of(circle(speed=np.pi / 2))
    assert bounds.speed == Interval(np.pi / 2, np.pi / 2)


@pytest.mark.parametrize(
    ("path", "options", "route"),
    [
        (oval(), {}, "segments"),
        (figure_eight(), {}, "tubes"),
        (figure_eight(), {"certificate": "segment"}, "segments"),
        (oval(), {"certificate": "tube"}, "tubes"),
        (figure_eight(), {"template": "paper"}, "segments"),
        (figure_eight(), {"objective": Objective("width", 0.5)}, "segments"),
    ],
)
def test_the_way_that_a_path_goes(monkeypatch: pytest.MonkeyPatch, path: Path, options: dict, route: str) -> None:
    taken = []

    def instead(name: str) -> Callable[..., Result]:
        def go(problem: Problem, *_: object) -> Result:
            taken.append(name)
            return Result(Verdict.CERTIFIED, name, problem)

        return go

    monkeypatch.setattr(synthesis, "_by_segments", instead("segments"))
    monkeypatch.setattr(synthesis, "_by_tubes", instead("tubes"))
    assert synthesis.search(Problem(path), Options(**options)).message == route
    assert taken == [route]
    assert synthesis.search(replace(NARROW, obstacles=(Disc(3.0, 5.0, 0.5),)), Options()).message == "tubes"


def test_where_no_tube_does_it_segments_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(synthesis, "_by_segments", lambda problem, *_: Result(Verdict.CERTIFIED, "segments", problem))
    assert synthesis.search(Problem(figure_eight(), inlet=ball(0.5), goal=ball(0.05)), Options()).message == "segments"
    with pytest.raises(InputError, match="template: expected contracting with certificate=tube, got paper"):
        synthesis.search(NARROW, Options(certificate="tube", template="paper"))


def test_many_funnels_are_learned_only_where_that_is_what_the_user_wants(monkeypatch: pytest.MonkeyPatch) -> None:
    def failed(problem: Problem, *_: object) -> Result:
        return Result(Verdict.INCONCLUSIVE, "no tube", problem)

    monkeypatch.setattr(synthesis, "_by_tubes", failed)
    monkeypatch.setattr(synthesis, "_by_segments", lambda problem, *_: Result(Verdict.CERTIFIED, "segments", problem))
    few, many = (Problem(ellipse(segments=count)) for count in (synthesis.MOST_TRIED - 1, synthesis.MOST_TRIED + 1))
    assert synthesis.search(few, Options()).message == "segments"
    found = synthesis.search(many, Options())
    assert (found.verdict, found.message[:36]) == (Verdict.INCONCLUSIVE, "no tube; certificate=segment would l")
    assert f"each of the path's {len(many.path.distinct)} segments" in found.message
    assert synthesis.search(many, Options(certificate="segment")).message == "segments"


def test_a_path_of_more_pieces_than_a_certificate_holds_is_refused_before_learning(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("cfjax.tubes.hold.MOST_PIECES", 4)
    with pytest.raises(InputError, match=r"path slalom: expected at most 4 polynomial pieces, .*\(path.smoothing"):
        hold_by_learning(NARROW, lambda *_: pytest.fail("learned"))
