"""Scenes of CommonRoad as maps: where things stand, what is refused, and a plan on a narrow road."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

import cfjax
from cfcheck import Outcome, check_document
from cfjax import InputError
from cfjax.planner import Map, read_map
from cfjax.planner.__main__ import main
from cfjax.problem import KinematicBicycle
from cfjax.tubes.certificate import chain_document
from experiments.random_maps import least_distance


FILE = Path(__file__).parent / "scene.xml"
BODY = [[1.0, 0.0], [1.0, 1.4], [1.0, 2.8]]


@pytest.fixture(scope="module")
def scene() -> Map:
    return read_map(FILE)


def named(scene: Map, name: str) -> shapely.Geometry:
    shapes = [shape for shape, label in zip(scene.shapes, scene.labels, strict=True) if label == name]
    return shapely.union_all(shapes)


def test_things_stand_where_the_scene_says(scene: Map) -> None:
    car, bin_, fence = (named(scene, f"staticObstacle {number}") for number in (10, 11, 12))
    turn = np.array([[math.cos(0.1), -math.sin(0.1)], [math.sin(0.1), math.cos(0.1)]])
    corners = np.array([[-2.25, -0.9], [2.25, -0.9], [2.25, 0.9], [-2.25, 0.9]]) @ turn.T + (20.0, 1.2)
    assert shapely.symmetric_difference(car, shapely.Polygon(corners)).area < 1e-9
    assert bin_.centroid.coords[0] == pytest.approx((28.0, 0.3))  # the circle is 1 m ahead of what looks along +y
    assert bin_.area == pytest.approx(math.pi * 0.4**2, rel=1e-3)
    assert fence.area == pytest.approx(shapely.Polygon([(0, 0), (2, 0), (2, 0.5), (0.5, 0.2)]).area)


def test_what_is_no_road_is_an_obstacle_and_narrow_gaps_of_lanelets_are_none(scene: Map) -> None:
    edge = named(scene, "the edge of the road")
    for x, y in ((15.0, 4.0), (15.0, 7.9), (30.002, 2.0), (50.0, 7.0)):  # the third is between two lanelets
        assert not edge.covers(shapely.Point(x, y))
    for x, y in ((15.0, -0.1), (15.0, 8.1), (35.0, 7.0), (62.0, 14.0)):
        assert edge.covers(shapely.Point(x, y))


def test_start_and_goal_are_those_of_the_planning_problem(scene: Map) -> None:
    assert scene.start is not None and scene.goal is not None
    assert tuple(scene.start) == pytest.approx((-math.pi / 2, 3.0, 2.0))  # 0 rad from +x
    assert tuple(scene.goal) == pytest.approx((0.45 - math.pi / 2, 56.0, 10.0))


def test_a_goal_without_orientation_looks_along_the_road(tmp_path: Path) -> None:
    text = FILE.read_text()
    start, end = text.index("      <orientation><intervalStart>"), text.index("</intervalEnd></orientation>")
    along = math.atan2(7.0, 15.0) + math.atan2(7.5, 16.0)
    for spoiled in (
        text[:start] + text[end + len("</intervalEnd></orientation>") :],
        text.replace(
            text[text.index("<position><rectangle>", start - 400) : start], '<position><lanelet ref="1"/></position>'
        ),
    ):
        file = tmp_path / "goal.xml"
        file.write_text(spoiled)
        goal = read_map(file).goal
        assert goal is not None
        expected = (56.0, 10.0, along / 2) if goal.x > 20 else (15.0, 2.0, 0.45)
        assert (goal.x, goal.y, goal.alpha + math.pi / 2) == pytest.approx(expected, abs=0.02)


def test_a_full_size_car_drives_the_scene_by_a_proof(scene: Map, capsys: pytest.CaptureFixture[str]) -> None:
    found = cfjax.plan(scene, vehicle=KinematicBicycle(2.7), footprint=BODY, speed=5.0)
    assert check_document(chain_document(found.following)).outcome is Outcome.PROVEN
    road = shapely.union_all(scene.shapes)
    assert least_distance(found, [road], 5000, 0) > 0
    body = [word for radius, offset in BODY for word in ("--footprint", str(radius), str(offset))]
    assert main([str(FILE), "--wheelbase", "2.7", "--speed", "5", *body]) == 0
    assert "beside" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<commonRoad ", "<other ", "expected XML"),
        ("commonRoad", "roads", "expected a scene of CommonRoad, got an element roads"),
        ("<radius>0.4</radius>", "<radius>wide</radius>", "staticObstacle 11: expected a number as radius, got 'wide'"),
        ("<exact>0.1</exact>", "<interval/>", "staticObstacle 10: expected a number as orientation/exact, got none"),
        ("<position><point><x>8.0</x><y>7.2</y></point></position>", "<position><circle/></position>", "is one point"),
        ('<staticObstacle id="12">', '<dynamicObstacle id="9"/><staticObstacle id="12">', "1 that move"),
        ("lanelet", "line", "expected lanelets, got none"),
        ("<commonRoad", "<!DOCTYPE a><commonRoad", "without a document type"),
        ("<x>62.0</x><y>10.5</y>", "<x>62.0</x><y>20.5</y>", "lanelet 2: expected bounds that do not cross"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = FILE.read_text()
    assert old in text
    file = tmp_path / "spoiled.xml"
    file.write_text(text.replace(old, new))
    with pytest.raises(InputError) as error:
        read_map(file)
    assert words in str(error.value) and "\n" not in str(error.value)


def test_a_map_without_poses_asks_for_them() -> None:
    with pytest.raises(InputError, match="start: expected a pose"):
        cfjax.plan(Map())
