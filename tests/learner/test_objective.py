"""Tubes and objectives: what is learned keeps the sets, and is as wide, narrow or fast as was asked."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cfjax.errors import InputError
from cfjax.falsifier import falsify
from cfjax.funnel import TEMPLATES, Objective, lateral_half_width
from cfjax.funnel.instance import Unit
from cfjax.learner import Learned, learn, learn_for
from cfjax.problem import Ellipsoid, Interval, Method, Problem, ball, tube


TEMPLATE = TEMPLATES["contracting"]
POSITION = (3.0, 0.25, 0.25, 20.0)  # G of the position alone
SMALL = Problem(tube(1.8, 2.0), inlet=ball(0.05), goal=ball(0.25), method=Method.TT)


@cache
def learned(problem: Problem, **options: float) -> Learned:
    found = learn(problem, TEMPLATE, **options)
    assert found is not None
    return found


def holds(problem: Problem, found: Learned) -> None:
    """(a), (b) strictly, and the margin that is said, in a search of its own."""
    worst = {point.condition: point.slack for point in falsify(problem, problem.path.segments[0], found.funnel, seed=9)}
    assert worst["a"] > 0 and worst["b"] > 0
    assert worst["d"] == pytest.approx(found.margin, rel=0.02)


@pytest.mark.parametrize(("method", "before"), [(Method.PF, 3.9), (Method.TT, 0.98)])
def test_margins_of_the_trials_are_passed(method: Method, before: float) -> None:
    """2 m/s, 1.8 1/m, I = 0.15, G = 0.25 in the position, as the trials had it (certified numerically there)."""
    problem = Problem(tube(1.8, 2.0), inlet=ball(0.15), goal=Ellipsoid(POSITION), method=method)
    found = learned(problem)
    assert found.margin > before
    holds(problem, found)


@pytest.mark.slow
def test_speed_does_not_matter_to_path_following() -> None:
    """From 1 to 10π m/s with accelerations the margin per metre is that at 1 m/s alone; for tracking it is lost."""
    wide = Problem(tube(1.8, Interval(1.0, 31.4159), 1.0), inlet=ball(0.15), goal=ball(0.25))

    def per_metre(problem: Problem, found: Learned) -> float:
        points = falsify(problem, problem.path.segments[0], found.funnel, unit=Unit.METRE)
        return next(point.slack for point in points if point.condition == "d")

    found = learned(wide)
    assert found.margin >= 0.85  # at 1 m/s
    assert per_metre(wide, found) >= 0.95 * learned(replace(wide, path=tube(1.8, 1.0))).margin
    assert np.abs(found.funnel.shape[:2, 2:]).max() == 0  # its own mirror image
    tracking = replace(wide, method=Method.TT)
    followed = learn(tracking, TEMPLATE)
    assert followed is not None
    assert per_metre(tracking, followed) < 0.1


def test_decrease_down_to_an_inner_level_costs_little() -> None:
    near, far = learned(SMALL), learned(SMALL, beta_inner=0.1)
    assert far.funnel.inner == 0.1
    assert far.margin >= 0.97 * near.margin


def test_a_tube_without_a_goal_is_as_good_and_wider() -> None:
    """Nothing but I bounds it: what is a tube in G is one without it."""
    free = replace(SMALL, goal=None)
    found = learned(free)
    assert found.margin >= 0.99 * learned(SMALL).margin
    worst = {point.condition: point.slack for point in falsify(free, free.path.segments[0], found.funnel, seed=9)}
    assert set(worst) == {"a", "c", "d"}
    assert min(worst.values()) > 0


@pytest.mark.slow
def test_asymmetric_tubes_are_learned_for_both_ends() -> None:
    problem = replace(SMALL, path=tube(Interval(-0.5, 2.0), 2.0))
    found = learned(problem)
    assert found.margin > 0
    holds(problem, found)


@pytest.mark.slow
def test_width_is_the_least_that_has_the_margin() -> None:
    target = 0.9 * learned(SMALL).margin
    options = {"candidates": 4}
    problem, found = learn_for(Objective("width", target), target, SMALL, TEMPLATE, **options)
    assert found is not None and problem == SMALL
    assert found.margin >= target
    holds(problem, found)
    width = lateral_half_width(found.funnel)
    assert 0.05 < width < lateral_half_width(learned(SMALL).funnel)
    # a narrower tube with that margin is not found: the margin falls with the width
    closer = replace(SMALL, safe=None, goal=Ellipsoid((0.25, 0.98 * width, 0.25, 0.25)))
    narrow = learn(closer, TEMPLATE)
    assert narrow is None or narrow.margin < 1.01 * target


@pytest.mark.slow
def test_inlet_grows_until_the_margin_is_used_up() -> None:
    target = 0.5 * learned(SMALL).margin
    problem, found = learn_for(Objective("inlet", target), target, SMALL, TEMPLATE)
    assert found is not None
    assert problem.inlet.half_axes[0] > 0.06
    assert len(set(problem.inlet.half_axes)) == 1 and problem.goal == SMALL.goal
    assert target <= found.margin < 1.1 * target
    holds(problem, found)


def test_a_margin_out_of_reach_gives_the_largest() -> None:
    problem, found = learn_for(Objective("width", 1e3), 1e3, SMALL, TEMPLATE)
    assert problem == SMALL and found is not None
    assert found.margin == pytest.approx(learned(SMALL).margin, rel=1e-6)


def test_bad_objectives() -> None:
    for kind, margin, words in (
        ("depth", None, "expected one of margin, width, inlet"),
        ("width", None, "expected a positive number"),
        ("inlet", float("nan"), "expected a positive finite number"),
        ("margin", 1.0, "expected none"),
    ):
        with pytest.raises(InputError, match=words):
            Objective(kind, margin)
