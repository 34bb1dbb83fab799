"""Convex parts, distances on a grid, Dubins' ways, the search, and smooth ways: each against another reckoning."""

import cmath
import itertools
import math
from typing import Any

import numpy as np
import pytest
import shapely

from cfjax import InputError
from cfjax.planner import Map
from cfjax.planner.bends import Bends
from cfjax.planner.convex import convex_parts, is_convex
from cfjax.planner.dubins import dubins_ways
from cfjax.planner.field import field_of
from cfjax.planner.search import BodyDiscs, Search, along
from cfjax.planner.smooth import smoothed
from cfjax.problem import Disc, Polygon
from tests.planner.scenes import ENTRIES, HOOK, scene, shape_of


def star(rng: np.random.Generator, corners: int) -> shapely.Polygon:
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    radius = rng.uniform(0.3, 1.0, corners)
    return shapely.Polygon(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1))


@pytest.mark.parametrize("seed", range(8))
def test_convex_parts_are_the_polygon(seed: int) -> None:
    rng = np.random.default_rng(seed)
    outer = star(rng, 12)
    polygon = (
        outer.difference(shapely.Point(outer.representative_point()).buffer(0.02, quad_segs=1)) if seed % 2 else outer
    )
    parts = [part for piece in shapely.get_parts(polygon) for part in convex_parts(piece)]
    assert all(map(is_convex, parts)) and len(parts) < 30
    union = shapely.union_all(parts)
    assert union.symmetric_difference(polygon).area < 1e-9
    assert sum(part.area for part in parts) == pytest.approx(polygon.area, abs=1e-9)  # none overlaps another


def test_a_convex_polygon_stays_whole_and_a_hook_has_few_parts() -> None:
    assert len(convex_parts(shapely.box(0, 0, 1, 1))) == 1
    assert len(convex_parts(shapely.Polygon(HOOK))) == 2


def test_a_map_knows_its_parts_and_walls() -> None:
    map = scene()
    assert map.labels[:2] == ("obstacle 0", "obstacle 0") and map.labels[-1] == "the upper wall"
    assert len(map.obstacles) == 4 + 4
    distance, number = map.nearest(np.array([0.0j, 5.0 + 2.4j]))
    assert map.labels[number[0]] == "the left wall" and distance[0] == pytest.approx(1.0)
    assert map.labels[number[1]] == "obstacle 1" and distance[1] == 0


@pytest.mark.parametrize(
    ("entries", "bounds", "message"),
    [
        ([{"polygon": [(0, 0), (1, 1)]}], None, "map: obstacle 0: expected a polygon with at least 3"),
        ([{"polygon": [(0, 0), (1, 1), (1, 0), (0, 1)]}], None, "obstacle 0: .* not valid .Self-intersection"),
        ([{"polygon": [(0, 0), (1, 1), (2, 2)]}], None, "obstacle 0: "),
        ([shapely.Point(0, 0)], None, "expected a polygon, got a Point"),
        ([{"square": 3}], None, "expected entries"),
        ([], (0, 0, 0, 1), r"map: bounds: expected a rectangle"),
    ],
)  # fmt: skip
def test_what_is_no_map_is_refused(entries: object, bounds: object, message: str) -> None:
    wrong: dict[str, Any] = {"obstacles": entries, "bounds": bounds}
    with pytest.raises(InputError, match=message):
        Map(**wrong)


def test_the_field_has_shapelys_distances() -> None:
    obstacles = [
        Disc(1.0, 1.0, 0.4),
        Polygon([(2, 0.5), (3, 0.7), (2.2, 2.0)]),
        Polygon([(3, 3), (3.5, 3), (3.5, 3.5)][::-1]),
    ]
    shapes = [shapely.Point(1, 1).buffer(0.4, 512), *(shapely.Polygon(o.corners) for o in obstacles[1:])]
    field = field_of(obstacles, np.array([0.0, 0.1, 0.0]), (0.0, 0.0, 4.0, 5.0), 0.05, 0.8)
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 4, 2000) + 1j * rng.uniform(0, 5, 2000)
    points = shapely.points(places.real, places.imag)
    grown = np.array([0.0, 0.1, 0.0])
    signed = [
        shapely.distance(points, shape)
        - shapely.distance(points, shapely.Point(99, 99).union(shapely.box(-50, -50, 50, 50).difference(shape)))
        for shape in shapes
    ]
    edge = np.min([places.real, 4 - places.real, places.imag, 5 - places.imag], axis=0)
    expected = np.minimum(np.min([s - g for s, g in zip(signed, grown, strict=True)], axis=0), np.minimum(edge, 0.8))
    found, slope = field.at(places)
    assert found == pytest.approx(expected, abs=0.03) and np.abs(found - expected).mean() < 1e-3
    ahead, _ = field.at(places + 1e-7)
    assert slope.real == pytest.approx((ahead - found) / 1e-7, abs=1e-5)


def test_dubins_ways_end_at_the_goal_and_the_first_is_the_shortest() -> None:
    rng, kinds = np.random.default_rng(0), set()
    for _ in range(300):
        start, end = ((complex(*rng.uniform(-2, 2, 2)), float(rng.uniform(-4, 4))) for _ in range(2))
        radius = float(rng.uniform(0.2, 1))
        ways = dubins_ways(start, end, radius)
        lengths = [sum(length for _, length in arcs) for arcs in ways]
        assert lengths == sorted(lengths) and lengths[0] >= abs(end[0] - start[0]) - 1e-12
        for arcs in ways:
            kinds.add(tuple(round(curvature * radius) for curvature, _ in arcs))
            place, direction = start
            for curvature, length in arcs:
                turned = cmath.exp(1j * curvature * length)
                place += cmath.exp(1j * direction) * ((turned - 1) / (1j * curvature) if curvature else length)
                direction += curvature * length
            assert abs(place - end[0]) < 1e-9 and abs(cmath.exp(1j * direction) - cmath.exp(1j * end[1])) < 1e-9
    assert len(kinds) == 6


def test_dubins_known_lengths() -> None:
    ahead, back = (0j, 0.0), (4 + 0j, 0.0)
    assert sum(length for _, length in dubins_ways(ahead, back, 1.0)[0]) == pytest.approx(4)
    turn = dubins_ways(ahead, (2j, math.pi), 1.0)[0]
    assert sum(length for _, length in turn) == pytest.approx(math.pi) and turn[0][0] == 1


@pytest.fixture(scope="module")
def searched() -> tuple:
    map, body = scene(), BodyDiscs(np.array([0.0, 0.3]), np.array([0.28, 0.24]))
    field = field_of(map.obstacles, np.zeros(len(map.obstacles)), map.bounds, 0.1, 0.8)
    start, goal = (0j, 0.0), (7.2 + 0j, math.pi / 2)
    return field, body, start, goal, Search(field, body, goal, 2.0, 0.3).way(start)


def room(body: BodyDiscs, places: np.ndarray, directions: np.ndarray) -> float:
    """To spare beside the scene, by shapely."""
    shapes = shapely.union_all([shape_of(entry) for entry in ENTRIES])
    centres = [(places + offset * np.exp(1j * directions), need) for offset, need in zip(*body, strict=True)]
    return min(float(shapely.distance(shapely.points(c.real, c.imag), shapes).min()) - need for c, need in centres)


def test_the_search_finds_a_way_that_is_clear(searched: tuple) -> None:
    _, body, start, goal, arcs = searched
    places, directions = along(arcs, start, 0.05)
    assert abs(places[-1] - goal[0]) < 1e-9 and abs(np.exp(1j * directions[-1]) - np.exp(1j * goal[1])) < 1e-9
    assert max(abs(curvature) for curvature, _ in arcs) <= 2 + 1e-12
    assert all(first != second for (first, _), (second, _) in itertools.pairwise(arcs))
    assert room(body, places, directions) > -0.02
    assert sum(length for _, length in arcs) < 12


def test_it_becomes_smooth_near_by(searched: tuple) -> None:
    field, body, start, goal, arcs = searched
    bends = smoothed(arcs, start, goal, field, body, 0.5, 0.03)
    assert bends is not None and np.array_equal(bends.end[:-1], bends.begin[1:])
    places, directions = bends.poses(4)
    assert abs(places[-1] - goal[0]) < 1e-10 and bends.sharpest < 2.02
    assert room(body, places, directions) > 0
    rough = Bends.along(arcs, start, 0.3)
    wind = [np.abs(np.diff(np.stack([b.begin, b.end], axis=1).ravel())).sum() for b in (bends, rough)]
    assert wind[0] < wind[1]


def test_a_path_of_bends_keeps_its_limits() -> None:
    length = np.array([1.0, 0.5, 2.0])
    bends = Bends(1 + 2j, 0.3, length, np.array([0.0, 1.0, 1.5]), np.array([1.0, 1.5, -0.5]))
    (segment,) = bends.path("p", 2.0, 1.0, 0.8).curve
    theta = np.linspace(0, segment.duration, 4001)
    v, omega = segment.speed.values(theta), segment.turn_rate.values(theta)
    assert np.abs(v * omega).max() <= 1 + 1e-9 and np.abs(segment.speed.values(theta, 1)).max() <= 0.8 + 1e-9
    assert v.max() == pytest.approx(1) and segment.speed.integrals(np.array([segment.duration]))[0] == pytest.approx(
        3.5
    )
    places, directions = bends.poses(1)
    ends = segment.poses(np.array(segment.speed.breaks))
    assert ends[:, 1] + 1j * ends[:, 2] == pytest.approx(places, abs=1e-7)
    assert ends[:, 0] == pytest.approx(directions - math.pi / 2, abs=1e-12)
