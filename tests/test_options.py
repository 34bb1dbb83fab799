"""What is given and does nothing is said; what only another unit explains is refused."""

import numpy as np
import pytest

import cfjax
import cfjax.synthesis
from cfjax.conf import options_of, preset, problem_of
from cfjax.errors import InputError
from cfjax.learner.elimination import Elimination
from cfjax.options import Options
from cfjax.problem import Box, KinematicBicycle, Problem, ball, circle, straight, tube
from cfjax.question import doubts
from cfjax.result import Result


CIRCLE = Problem(circle())


@pytest.mark.parametrize(
    ("problem", "options", "lines"),
    [
        (CIRCLE, Options(), []),
        (Problem(circle(), method="tt"), Options(), []),
        (Problem(circle(), timing=(0.8, 1.2)), Options(), []),
        (Problem(circle(), method="tt", timing=(1, 1)), Options(), []),
        (
            Problem(circle(), method="tt", timing=(0.8, 1.2)),
            Options(),
            ["timing: [0.8, 1.2] does nothing with method=tt, where u0 is 1"],
        ),
        (
            CIRCLE,
            Options(polytope=Elimination(margin=0.1, centre="analytic")),
            [
                "polytope.margin=0.1 does nothing with learner=gradient",
                "polytope.centre=analytic does nothing with learner=gradient",
            ],
        ),
        (CIRCLE, Options(learner="polytope", polytope=Elimination(batch=4)), []),
        (
            CIRCLE,
            Options(learner="polytope", restarts=8, rounds=1),
            [
                "restarts=8 does nothing with learner=polytope",
                "rounds=1 does nothing with learner=polytope",
            ],
        ),
        (
            Problem(circle(), safe=[60, 1, 1, 3]),
            Options(),
            [
                "sets.safe: 60 rad of heading are no limit, for headings end at pi rad; 60 degrees are 1.047 rad",
            ],
        ),
        (
            Problem(circle(), vehicle=KinematicBicycle(0.34, 1.6, 40.0)),
            Options(),
            [
                "vehicle.max_tan_steering: more than cars have, 1.6, an angle of 58 degrees; 1.6 degrees "
                "have the tangent 0.02793",
                "vehicle.max_thrust: 40 m/s² are more than cars have; is it a force in N?",
            ],
        ),
        (
            Problem(circle(radius=90.0), vehicle=KinematicBicycle(13.0)),
            Options(),
            ["vehicle.wheelbase: 13 m are more than cars have; 13 cm are 0.13 m"],
        ),
    ],
)
def test_what_does_nothing_or_is_in_another_unit_is_said(problem: Problem, options: Options, lines: list[str]) -> None:
    assert doubts(problem, options) == lines


def test_a_search_says_it_once(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    found = Result(cfjax.Verdict.INCONCLUSIVE, "not looked for", CIRCLE)
    monkeypatch.setattr(cfjax.synthesis, "_by_segments", lambda *_: found)
    config = preset("circle", ["method=tt", "timing=[0.5,3]"])
    cfjax.search(problem_of(config), options_of(config))
    assert capfd.readouterr().err == "warning: timing: [0.5, 3] does nothing with method=tt, where u0 is 1\n"


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (
            lambda: KinematicBicycle(max_tan_steering=25.0),
            "at most 2.75 (70 degrees), got 25, an angle of 87.7 degrees; 25 degrees have the tangent 0.4663",
        ),
        (lambda: KinematicBicycle(max_tan_steering=5.0), "got 5, an angle of 78.7 degrees; 5 degrees have the tangent"),
        (
            lambda: KinematicBicycle(max_tan_steering=400.0),
            "of the largest steering angle, at most 2.75 (70 degrees), got 400, an angle of 89.9 degrees",
        ),
        (lambda: KinematicBicycle(wheelbase=34.0), "expected m, from 0.005 to 25, got 34; 34 cm are 0.34 m"),
        (lambda: KinematicBicycle(wheelbase=330.0), "expected m, from 0.005 to 25, got 330; 330 mm are 0.33 m"),
        (lambda: KinematicBicycle(wheelbase=0.0027), "expected m, from 0.005 to 25, got 0.0027"),
        (lambda: KinematicBicycle(max_thrust=3000.0), "expected m/s², at most 100, got 3000: no force in N"),
        (lambda: straight(speed=2000), "path.speed: expected m/s, at most 400, got 2000"),
        (lambda: tube(speed=(500, 1500)), r"path.speed: expected m/s, at most 400, got [500, 1500]"),
        (lambda: Problem(circle(), inlet=(20, 0.5, 0.5, 0.5)), "below pi rad, got 20.0; 20 degrees are 0.3491 rad"),
    ],
)
def test_what_only_another_unit_explains_is_refused(build, words: str) -> None:
    with pytest.raises(cfjax.InputError) as caught:
        build()
    assert words in str(caught.value)


def test_cars_of_every_size_are_none_of_these() -> None:
    for wheelbase, angle in ((0.05, 30), (0.33, 24), (2.7, 28.6), (7.0, 45), (0.34, 69)):
        car = KinematicBicycle(wheelbase, float(np.tan(np.radians(angle))))
        assert bool(car.doubts) == (angle > 50)
    Problem(circle(), ball(0.4), safe=Box([np.pi, 1, 1, 3]))


def test_who_mistypes_a_name_is_told_the_one_that_is_near() -> None:
    with pytest.raises(InputError, match=r"^solver: expected one of .*, got clarabl; did you mean clarabel\?$"):
        Options(solver="clarabl")
    with pytest.raises(InputError, match=r"^path: expected one of .*, got circel; did you mean circle\?$"):
        preset("circel")
    with pytest.raises(InputError, match=r"^path\.radus: no such key; expected one of .*; did you mean radius\?$"):
        preset("circle", ["path.radus=2"])
    with pytest.raises(InputError, match=r", got xyz$"):
        Options(solver="xyz")
