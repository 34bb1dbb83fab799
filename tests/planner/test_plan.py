"""From a map to a certificate: proven, seen by an independent sampler, planned again, and refused in one line."""

import math
from pathlib import Path

import numpy as np
import pytest

import cfjax
from cfcheck import Outcome, check_document
from cfcheck.reader import read_json
from cfjax import InputError
from cfjax.planner import Map, Plan, plan, planning
from cfjax.problem import Pose, RosPose
from tests.planner.scenes import BODY, BOUNDS, ENTRIES, GOAL, START, least_distance, scene, shape_of, walls


@pytest.fixture(scope="module")
def found() -> Plan:
    return plan(scene(), START, GOAL, footprint=BODY)


def test_the_checker_proves_what_is_written(found: Plan, tmp_path: Path) -> None:
    found.write(tmp_path / "plan.json")
    report = check_document(read_json(tmp_path / "plan.json"))
    assert report.outcome is Outcome.PROVEN
    assert f"clear of {len(found.map.obstacles)} obstacles that stand in the file" in report.message
    assert len(str(found).splitlines()) <= 10 and "mm to spare beside" in str(found)


def test_no_body_in_the_tubes_touches_the_map(found: Plan) -> None:
    """As it was given, before polygons were split and walls made of bounds."""
    least = least_distance(found, [*map(shape_of, ENTRIES), walls(BOUNDS)], BODY, 20_000, seed=0)
    assert 0 < least < 0.3  # clear, and near enough for the question to be one
    assert found.spare <= least


def test_it_leads_from_pose_to_pose_and_curvature_is_continuous(found: Plan) -> None:
    (segment,) = found.path.curve
    begin, end = segment.poses(np.array([0.0, segment.duration]))
    assert begin == pytest.approx(START, abs=1e-12)
    assert end[1:] == pytest.approx(GOAL[1:], abs=1e-8) and math.cos(end[0] - GOAL[0]) == pytest.approx(1, abs=1e-12)
    breaks = np.array(segment.speed.breaks[1:-1])
    for profile in (segment.turn_rate, segment.speed):
        before = np.nextafter(breaks, 0)
        assert profile.values(before) == pytest.approx(profile.values(breaks), abs=1e-9)
    assert segment.speed.values(breaks).max() <= 2 + 1e-12  # the speed asked for


def test_the_same_question_has_the_same_answer(found: Plan) -> None:
    assert plan(scene(), START, GOAL, footprint=BODY).path == found.path


def test_what_does_not_certify_is_planned_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A proof that asks for more room than the tubes: the obstacle in the way is grown until there is as much."""
    map, real, asked = Map([{"disc": (4.0, 0.0, 0.5)}], (-1.0, -3.0, 9.0, 3.0)), cfjax.follow, 0.2
    start, goal = Pose(-math.pi / 2, 0.0, 0.0), Pose(-math.pi / 2, 8.0, 0.0)
    first = plan(map, start, goal)

    def strict(path: cfjax.Path, *given, obstacles, **others) -> cfjax.Following:
        theta = np.linspace(0, path.curve[0].duration, 500)
        centre = obstacles[0].x, obstacles[0].y
        room = np.linalg.norm(path.curve[0].poses(theta)[:, 1:] - centre, axis=1).min() - 0.5 - 0.25
        if room < asked:
            raise InputError("path plan: obstacle 0 is in the way: by hand")
        return real(path, *given, obstacles=obstacles, **others)

    monkeypatch.setattr(planning, "follow", strict)
    again = plan(map, start, goal)
    assert again.attempts > first.attempts == 1 and again.spare > first.spare
    monkeypatch.setattr(planning, "GROWTH", 0.0)
    with pytest.raises(InputError, match=r"map: no path was proven in 2 attempts; obstacle 0 is in the way at \("):
        plan(map, start, goal, attempts=2)


CLOSED = ({"polygon": [(3.0, -2.0), (3.2, -2.0), (3.2, 4.0), (3.0, 4.0)]},)
GAP = (
    {"polygon": [(3.0, -2.0), (3.2, -2.0), (3.2, 0.8), (3.0, 0.8)]},
    {"polygon": [(3.0, 1.2), (3.2, 1.2), (3.2, 4.0), (3.0, 4.0)]},
)


@pytest.mark.parametrize(
    ("entries", "start", "goal", "message"),
    [
        (ENTRIES, (2.5, 0.0, 0), GOAL, r"start: .* nothing, got \(2.5, 0\) m with .* m too little beside obstacle 0"),
        (ENTRIES, START, (7.9, 0.0, 0), r"goal: .* got \(7.9, 0\) m with 0.2.* m too little beside the right wall"),
        (ENTRIES, START, (9.0, 0.0, 0), r"goal: expected a place in map, \[-1, 8\] x \[-2, 4\] m, .* 1 m outside"),
        (CLOSED, START, GOAL, r"map: no way from \(0, 0\) m to .* a gap of 0.6.* m, .* beside obstacle 0, is closed"),
        (GAP, START, GOAL, r"no way .* narrowest one .*, at \(2.9.*, 1.*\) m beside obstacle 1, has 0.3.* m"),
        (ENTRIES, (0, 1), GOAL, "start: expected a pose"),
        (ENTRIES, START, RosPose(0, float("nan"), 1), "goal: expected a pose"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line(entries: tuple, start: tuple, goal: tuple, message: str) -> None:
    with pytest.raises(InputError, match=message) as refused:
        plan(Map(entries, BOUNDS), start, goal)
    assert "\n" not in str(refused.value)


def test_bends_that_are_too_tight_are_named() -> None:
    """In a corridor no car turns round."""
    with pytest.raises(InputError, match=r"none comes to the goal with bends of a radius of at least 0.4.* m"):
        plan(Map((), (0.0, 0.0, 8.0, 1.2)), Pose(-math.pi / 2, 1.0, 0.6), Pose(math.pi / 2, 7.0, 0.6))


def test_a_pose_that_no_bend_leaves_or_reaches_is_named() -> None:
    """Across a corridor a car does not get away; nor does one come to stand so."""
    corridor, along, across = Map((), (0.0, 0.0, 1.4, 12.0)), 0.0, -math.pi / 2
    for start, goal, words in ((across, along, "leaves the start"), (along, across, "comes to the goal")):
        with pytest.raises(InputError, match=f"none {words} with bends of a radius of at least"):
            plan(corridor, [0.7, 1.0, start], [0.7, 11.0, goal])


def test_speeds_that_no_tube_holds_are_refused() -> None:
    with pytest.raises(InputError, match=r"speed: expected 0\.5 to 32 m/s, which the tubes hold, got 0\.1"):
        plan(scene(), START, GOAL, speed=0.1)


def test_another_car_and_a_map_without_bounds() -> None:
    """Of full size, whose body is two discs."""
    car = cfjax.KinematicBicycle(2.6, 1.0, 4.0)
    posts = [{"disc": (20.0, 0.5, 2.0)}, {"disc": (60.0, -1.0, 3.0)}]
    found = plan(
        posts, RosPose(0, 0, 0), [90, 0, -math.pi / 2], vehicle=car, footprint=[[1.2, 0.0], [1.2, 2.6]], speed=15
    )
    assert least_distance(found, list(map(shape_of, posts)), ((1.2, 0.0), (1.2, 2.6)), 20_000, seed=1) > 0
    assert found.path.curve[0].speed.coefficients[-1][0] > 5 and "beside obstacle 1" in str(found)
