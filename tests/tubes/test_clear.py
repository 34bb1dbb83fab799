"""Paths in tubes beside obstacles: proven, seen by an independent sampler, and spoiled."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
import shapely
from flint import fmpq

from cfcheck import Outcome, check_document
from cfcheck.claims import assumptions
from cfcheck.claims.document import document_hash
from cfjax.errors import InputError
from cfjax.options import Options
from cfjax.problem import (
    Disc,
    FootprintDisc,
    KinematicBicycle,
    Path,
    Polygon,
    Pose,
    Problem,
    Profile,
    Segment,
    ball,
    circle,
    slalom,
    straight,
)
from cfjax.simulation import drive_cars
from cfjax.synthesis import search
from cfjax.tubes import follow
from cfjax.tubes.certificate import chain_document
from cfjax.tubes.follow import Following
from cfjax.tubes.hold import hold_by_learning, hold_by_library
from cfjax.tubes.store import library
from cfjax.verdict import Verdict


PATH = slalom(amplitude=0.3)
BODY = (FootprintDisc(0.2, 0.0), FootprintDisc(0.15, 0.3))
OBSTACLES = (Disc(5.0, 0.9, 0.2), Polygon([(2.0, -1.2), (2.3, -0.75), (2.6, -1.2)]), Disc(4.0, -30.0, 2.0))


@pytest.fixture(scope="module")
def beside() -> Following:
    return follow(PATH, obstacles=OBSTACLES, footprint=BODY)


@pytest.fixture(scope="module")
def document(beside: Following) -> dict:
    return chain_document(beside)


def sealed(document: dict) -> dict:
    return {**document, "hash": document_hash(document)}


def test_the_checker_proves_it_and_says_so(beside: Following, document: dict) -> None:
    report = check_document(document)
    assert report.outcome is Outcome.PROVEN
    assert "clear of 3 obstacles that stand in the file, by a footprint of radius 0.2 m at offset 0 m" in report.message
    assert "clear of 3 obstacles, wherever in its tube the car is" in str(beside)


def test_no_body_in_a_tube_touches_an_obstacle(beside: Following) -> None:
    """Random cars on the boundary of each tube, in the plane, by another library's distances."""
    hulls = [hull for obstacle in OBSTACLES for hull in obstacle.hulls]
    shapes = [shapely.MultiPoint(hull.corners).convex_hull.buffer(hull.round, 256) for hull in hulls]
    rng, least = np.random.default_rng(0), np.inf
    for stretch in beside.tubes:
        segment = beside.path.curve[stretch.segment]
        theta = np.repeat(rng.uniform(stretch.start, stretch.end, 200), 50)
        heading, x, y = segment.poses(theta).T
        shape = np.array([[float(entry) for entry in row] for row in stretch.tube.shape])
        w = rng.normal(size=(len(theta), len(shape)))
        deviation = w / np.sqrt(np.einsum("ki,ij,kj->k", w, shape, w))[:, None]
        cos, sin = np.cos(heading), np.sin(heading)
        x, y = x + cos * deviation[:, 1] - sin * deviation[:, 2], y + sin * deviation[:, 1] + cos * deviation[:, 2]
        heading = heading + deviation[:, 0]
        for disc in BODY:
            centres = shapely.points(x - disc.offset * np.sin(heading), y + disc.offset * np.cos(heading))
            least = min(least, *((shapely.distance(centres, shape) - disc.radius).min() for shape in shapes))
    assert 0 < least < 0.2  # clear, and near enough for the question to be one


def test_an_obstacle_in_the_way_is_named() -> None:
    with pytest.raises(InputError, match=r"obstacle 1 is in the way: from theta = .* the body may reach it"):
        follow(PATH, obstacles=(*OBSTACLES[:1], Disc(3.0, 0.02, 0.1)), footprint=BODY)


def test_a_tube_that_is_too_wide_is_left_in_time() -> None:
    """Beside the obstacle the narrow one is left only where the wide one is clear."""
    tubes = [tube for tube in library(KinematicBicycle()) if tube.name in ("wide-gentle-slow", "narrow-gentle-slow")]
    wide, narrow = sorted(tubes, key=lambda tube: tube.name, reverse=True)
    path, pole = straight(length=40.0), Disc(10.0, 0.55, 0.1)
    free = follow(path, [wide])
    assert {stretch.tube.name for stretch in free.tubes} == {wide.name}
    with pytest.raises(InputError, match="obstacle 0 is in the way"):
        follow(path, [wide], obstacles=(pole,))
    beside = follow(path, [wide, narrow], obstacles=(pole,))
    assert beside.tube_at(0, 15.0).name == narrow.name
    assert check_document(chain_document(beside)).outcome is Outcome.PROVEN


def sets(document: dict) -> dict:
    return document["problem"]["sets"]


def plane(document: dict) -> dict:
    """The last stretch of the first leg."""
    return document["hints"]["clearance"][0][-1]


@pytest.mark.parametrize(
    ("spoil", "outcome", "words"),
    [
        (lambda d: sets(d)["obstacles"][0].update(corners=[["5", "1/2"]]), Outcome.BROKEN, "obstacle 0"),
        (lambda d: sets(d)["footprint"][0].update(radius="3/2"), Outcome.BROKEN, "leg 0, obstacle 1"),
        (lambda d: sets(d)["footprint"][1].update(radius="3/2"), Outcome.BROKEN, "leg 0, obstacle 1"),
        (lambda d: sets(d).update(footprint=[]), Outcome.BROKEN, "no footprint"),
        (lambda d: d["hints"]["clearance"].pop(), Outcome.UNREADABLE, "clearance"),
        (lambda d: d["hints"].pop("clearance"), Outcome.UNREADABLE, "clearance"),
        (lambda d: plane(d).update(normals=[]), Outcome.BROKEN, "no half-plane is stated"),
        (lambda d: plane(d).update(normals=[[0, 1]]), Outcome.BROKEN, "obstacle 1"),
        (lambda d: plane(d).update(normals=[[0, 0]]), Outcome.UNREADABLE, "normals that are not zero"),
        (lambda d: plane(d).update(end="1"), Outcome.BROKEN, "stretches whose ends increase"),
        (lambda d: d["hints"].update(clearance=[[[[plane(d)]]]]), Outcome.UNREADABLE, "an earlier release"),
    ],
)
def test_what_is_not_proven_is_refused(document: dict, spoil, outcome: Outcome, words: str) -> None:
    spoiled = copy.deepcopy(document)
    spoil(spoiled)
    report = check_document(sealed(spoiled))
    assert report.outcome is outcome and words in report.message


def test_half_planes_of_another_run_prove_nothing() -> None:
    """A wide tube, then a narrow one along a bend: each run has its own, counted from where it begins."""
    breaks = (0.0, 8.0, 10.0)
    bend = Segment(Profile(breaks, ((0.2,), (1.8,))), Profile(breaks, ((1.0,), (1.0,))), Pose(0.0, 0.0, 0.0))
    by_name = {tube.name: tube for tube in library(KinematicBicycle())}
    narrow = by_name["normal-tight-slow"]
    only_bends = replace(narrow, bounds=replace(narrow.bounds, curvature=(fmpq(3, 2), narrow.bounds.curvature[1])))
    path = Path("narrowing", (bend,))
    found = follow(path, [by_name["wide-gentle-slow"], only_bends], obstacles=(Disc(1.5, 2.0, 0.2),), footprint=BODY)
    document = chain_document(found)
    first, second = (run.leg(found.reference) for run in found.runs)
    heading, x, y = bend.poses(np.array([float(first.duration)]))[0]
    assert float(second.start.heading) == pytest.approx(heading, abs=1e-9)
    place = float(second.start.position.real.mid()), float(second.start.position.imag.mid())
    assert place == pytest.approx((x, y), abs=1e-6)
    assert len(document["legs"]) == 2 and check_document(document).outcome is Outcome.PROVEN
    document["hints"]["clearance"].reverse()
    assert check_document(sealed(document)).outcome is Outcome.BROKEN
    document["hints"]["clearance"].reverse()
    place = [str(fmpq(round(64 * value), 64)) for value in bend.poses(np.array([9.0]))[0, 1:]]  # on the second run
    document["problem"]["sets"]["obstacles"][0].update(corners=[place])
    report = check_document(sealed(document))
    assert report.outcome is Outcome.BROKEN and ", obstacle 0: " in report.message


def test_a_lap_of_another_car_is_clear() -> None:
    """A car of full size: the tubes are scaled by similarity; the path is driven lap after lap."""
    vehicle = KinematicBicycle(2.6, 1.0, 4.0)
    track, body = circle(30.0, 8.0), [[1, 1]]
    found = follow(track, vehicle=vehicle, closed=True, obstacles=(Disc(0.0, 0.0, 26.0),), footprint=body)
    report = check_document(chain_document(found))
    assert report.outcome is Outcome.PROVEN and "clear of one obstacle that stands in the file" in report.message
    with pytest.raises(InputError, match="obstacle 0 is in the way"):
        follow(track, vehicle=vehicle, closed=True, obstacles=(Disc(0.0, 0.0, 28.9),), footprint=body)


def test_only_a_body_clears_obstacles(document: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    renamed = json.loads(json.dumps(document).replace("kinematic_bicycle", "my_own"))
    assert check_document(sealed(renamed)).outcome is Outcome.PROVEN  # by its dynamics it is one
    monkeypatch.setattr(assumptions, "is_a_body", lambda *_: False)
    report = check_document(sealed(renamed))
    assert report.outcome is Outcome.BROKEN and "obstacles are cleared by bodies" in report.message


def test_a_path_that_was_followed_elsewhere_claims_no_obstacles() -> None:
    problem = Problem(PATH, inlet=ball(0.15), goal=ball(0.25), obstacles=OBSTACLES, footprint=BODY)
    with pytest.raises(InputError, match="expected a path that was followed beside the problem's obstacles"):
        chain_document(follow(PATH), problem)


def test_what_no_checker_reads_is_refused_before_a_tube_is_learned() -> None:
    problem = Problem(PATH, inlet=ball(0.1), goal=ball(0.25), obstacles=[Disc(5.0, 3.0 + k, 0.1) for k in range(4097)])
    with pytest.raises(InputError, match="obstacles"):
        hold_by_learning(problem, lambda *_: pytest.fail("asked to learn"))


def test_tubes_of_the_package_lead_from_i_to_g_beside_obstacles() -> None:
    problem = Problem(PATH, inlet=ball(0.15), goal=ball(0.25), obstacles=OBSTACLES, footprint=BODY)
    result = hold_by_library(problem)
    assert result is not None and result.verdict is Verdict.CERTIFIED
    assert "clear of 3 obstacles" in result.message
    summary, _ = drive_cars(result.problem, result.legs, cars=200)
    assert (summary.left_funnel, summary.left_safe, summary.missed_goal) == (0, 0, 0)
    blocked = replace(problem, obstacles=(Disc(5.0, 0.62, 0.1),))
    assert hold_by_library(blocked) is None  # the reference itself is clear, what a tube holds is not


def test_a_tube_is_learned_as_narrow_as_obstacles_ask_for() -> None:
    problem = Problem(PATH, inlet=ball(0.1), goal=ball(0.25), obstacles=(Disc(5.0, 0.95, 0.2),), footprint=BODY)
    asked = []

    def learn(tube: Problem, inner: float):
        asked.append(tube)
        return search(tube, Options(certificate="segment", robustness=False, beta_inner=inner))

    result = hold_by_learning(problem, learn)
    assert asked[0].safe is not None and asked[0].safe.half_widths[1] <= problem.room
    assert result.verdict is Verdict.CERTIFIED and "clear of one obstacle that stands" in result.message
