"""That a path begins between the walls of a corridor: held against a geometry library, refused where it is not so."""

import copy

import numpy as np
import pytest
import shapely
from flint import acb, arb, fmpq

from cfcheck import Outcome, check_document
from cfcheck.claims.document import document_hash
from cfcheck.clearance.corridor import WallClaim, prove_between
from cfcheck.clearance.half_plane import FootprintClaim
from cfcheck.exact.enclosure import Budget
from cfcheck.exact.rational import rational
from cfcheck.path.reference import ExactPose
from cfcheck.reader import Broken
from cfjax.errors import InputError
from cfjax.problem import FootprintDisc, oval, straight
from cfjax.problem.corridor import walls_of
from cfjax.tubes import follow
from cfjax.tubes.certificate import chain_document


def wall(points: np.ndarray, side: str) -> WallClaim:
    return WallClaim(tuple((rational(float(x)), rational(float(y))) for x, y in points), side)


def pose(heading: float, x: float, y: float) -> ExactPose:
    return ExactPose(rational(heading), acb(arb(rational(x)), arb(rational(y))))


def is_between(walls: list[WallClaim], start: ExactPose, *discs: float) -> bool:
    footprint = [FootprintClaim(fmpq(0), rational(offset)) for offset in discs or (0.0,)]
    try:
        prove_between(walls, footprint, start, Budget())
    except Broken:
        return False
    return True


def ring(x: float, y: float, radius: float, corners: int = 12) -> np.ndarray:
    angle = 2 * np.pi * np.arange(corners + 1) / corners
    points = np.round(np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1), 3)
    points[-1] = points[0]
    return points


def test_what_is_accepted_is_seen_by_a_geometry_library() -> None:
    rng, accepted, refused = np.random.default_rng(0), 0, 0
    for _ in range(100):
        shapes = [np.round(rng.normal(size=(rng.integers(2, 6), 2)) + np.array([side, 0.0]), 2) for side in (-1.0, 1.0)]
        heading, x, y = np.round(rng.normal(size=3) * 0.4, 2).tolist()
        place, right = shapely.Point(x, y), np.array([np.cos(heading), np.sin(heading)])
        lines = [shapely.LineString(shape) for shape in shapes]
        both = shapely.unary_union(lines)
        told = is_between([wall(shapes[0], "left"), wall(shapes[1], "right")], pose(heading, x, y))
        # some point of each wall is seen on its side, among many
        seen = []
        for line, sign in zip(lines, (-1, 1), strict=True):
            points = [line.interpolate(share, normalized=True) for share in np.linspace(0, 1, 200)]
            aside = [p for p in points if sign * (np.array([p.x - x, p.y - y]) @ right) > 0]
            views = [shapely.LineString([place, p]) for p in aside]
            seen.append(any(shapely.intersection(both, view).length < 1e-6 and _first(both, view) for view in views))
        if told:
            accepted += 1
            assert all(seen)
        else:
            refused += 1
    assert accepted > 15 and refused > 15


def _first(walls: shapely.Geometry, view: shapely.LineString) -> bool:
    """Whether a line of sight meets walls at its end alone."""
    end = shapely.Point(view.coords[-1])
    return bool(shapely.distance(shapely.intersection(walls, view), end) < 1e-6) and not shapely.intersects(
        walls, shapely.LineString([view.coords[0], view.interpolate(view.length - 1e-6)])
    )


def test_exchanged_hidden_and_missing_walls_are_refused() -> None:
    left, right = np.array([[-1.0, 0.0], [-1.0, 5.0]]), np.array([[1.0, 0.0], [1.0, 5.0]])
    start = pose(0.0, 0.0, 0.0)
    assert is_between([wall(left, "left"), wall(right, "right")], start)
    assert is_between(
        [wall(left + np.array([0.0, 2.0]), "left"), wall(right + np.array([0.0, 2.0]), "right")], start
    )  # they begin farther on
    assert not is_between([wall(left, "right"), wall(right, "left")], start)
    assert not is_between([wall(left, "left"), wall(right - 3, "right")], start)  # both to the left
    hiding = np.array([[-2.0, 6.0], [-2.0, 0.0], [-0.5, -1.0], [-0.5, 6.0]])  # a wall that is hidden by the other one
    assert not is_between(
        [wall(left - np.array([0.5, 0.0]), "left"), wall(np.concatenate([hiding, right]), "right")], start
    )


def test_every_disc_of_the_body_is_between_the_walls() -> None:
    across = np.array([[-1.0, 0.0], [-1.0, 0.5], [0.9, 0.5], [-1.0, 0.6], [-1.0, 5.0]])
    walls = [wall(across, "left"), wall(np.array([[1.0, 0.0], [1.0, 5.0]]), "right")]
    assert is_between(walls, pose(0.0, 0.0, 0.0), 0.0, 0.4)
    assert not is_between(walls, pose(0.0, 0.0, 0.0), 0.0, 1.0)


def test_a_lap_begins_inside_one_wall_and_outside_the_other() -> None:
    inner, outer, beside = ring(0, 0, 1), ring(0, 0, 3), ring(6, 0, 2)
    assert is_between([wall(inner, "left"), wall(outer, "right")], pose(0.0, 2.0, 0.0))
    assert is_between([wall(outer, "left"), wall(inner, "right")], pose(np.pi, 2.0, 0.0))
    # between two laps that lie beside each other, and inside of one alone
    assert not is_between([wall(outer, "left"), wall(beside, "right")], pose(0.0, 3.5, 0.0))
    assert not is_between([wall(inner, "left"), wall(outer, "right")], pose(0.0, 4.0, 0.0))


# --- files


@pytest.fixture(scope="module")
def document() -> dict:
    body = (FootprintDisc(0.2, 0.0), FootprintDisc(0.15, 0.3))
    return chain_document(follow(oval(), closed=True, corridor={"left": 0.6, "right": 0.5}, footprint=body))


def answer(document: dict) -> tuple[Outcome, str]:
    report = check_document({**document, "hash": document_hash(document)})
    return report.outcome, report.message


def test_the_statement_says_that_the_car_is_inside(document: dict) -> None:
    outcome, message = answer(document)
    assert outcome is Outcome.PROVEN
    assert "the path begins between wall 0, to its left, and wall 1, to its right" in message
    assert "inside one of these laps and outside the other, as the body stays" in message
    open_ends = chain_document(follow(straight(6.0, 2.0), corridor=0.6))
    assert "begins between wall 0" in answer(open_ends)[1] and "one of these laps" not in answer(open_ends)[1]


def test_files_without_sides_say_what_they_said(document: dict) -> None:
    earlier = copy.deepcopy(document)
    for each in earlier["problem"]["sets"]["obstacles"]:
        del each["side"]
    outcome, message = answer(earlier)
    assert outcome is Outcome.PROVEN and "begins between" not in message and "clear of the walls" in message


def test_spoiled_sides_are_refused(document: dict) -> None:
    swapped = copy.deepcopy(document)
    left, right = swapped["problem"]["sets"]["obstacles"]
    left["side"], right["side"] = right["side"], left["side"]
    outcome, message = answer(swapped)
    assert outcome is Outcome.BROKEN and "it is not proven that its" in message
    alone = copy.deepcopy(document)
    del alone["problem"]["sets"]["obstacles"][0]["side"]
    outcome, message = answer(alone)
    assert outcome is Outcome.UNREADABLE and "a wall on either side of a corridor" in message


def test_one_corridor_at_a_time() -> None:
    with pytest.raises(InputError, match=r"sets\.corridor: expected one left and one right wall"):
        follow(straight(6.0, 2.0), corridor=0.6, obstacles=walls_of(0.8, straight(6.0, 2.0)))
