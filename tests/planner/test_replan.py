"""A plan in a map that has changed: what is kept, what is proven again, and that the checker accepts all of it."""

import numpy as np
import pytest

from cfcheck import Outcome, check_document
from cfjax import InputError
from cfjax.certificate import clearance
from cfjax.planner import Map, Plan, plan, replan
from cfjax.tubes.certificate import chain_document
from tests.planner.scenes import BODY, BOUNDS, ENTRIES, GOAL, START, least_distance, shape_of, walls


CORNER = {"disc": (7.6, -1.6, 0.2)}  # near no path
DRIVEN = 1.5  # m


def in_the_way(found: Plan) -> dict:
    """A disc in the middle of the second half of a plan's path."""
    places = found.bends.poses()[0]
    middle = places[int(np.searchsorted(found.bends.arc, 0.62 * found.bends.arc[-1]))]
    return {"disc": (middle.real, middle.imag, 0.15)}


@pytest.fixture(scope="module")
def found() -> Plan:
    return plan(Map(ENTRIES, BOUNDS), START, GOAL, footprint=BODY)


@pytest.fixture
def looked(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many pieces of each leg a normal is searched for."""
    counts: list[int] = []
    known = clearance.rows_of

    def rows_of(hulls, along, level, disc):
        counts.append(len(level))
        return known(hulls, along, level, disc)

    monkeypatch.setattr(clearance, "rows_of", rows_of)
    return counts


def proven(found: Plan, entries: list[dict]) -> bool:
    """By the checker, from the file alone, and by cars at random, without the code of the package."""
    report = check_document(chain_document(found.following))
    shapes = [*map(shape_of, entries), walls(BOUNDS)]
    return report.outcome is Outcome.PROVEN and least_distance(found, shapes, BODY, 5000, seed=1) > 0


def test_nothing_is_proven_again_in_the_same_map(found: Plan, looked: list[int]) -> None:
    again = replan(found, found.map)
    assert sum(looked) == 0
    assert again.path == found.path
    assert proven(again, list(ENTRIES))


def test_far_from_what_is_new_the_old_proof_holds(found: Plan, looked: list[int]) -> None:
    entries = [*ENTRIES, CORNER]
    again = replan(found, Map(entries, BOUNDS))
    assert again.path == found.path and len(again.map.obstacles) == len(found.map.obstacles) + 1
    pieces = len(found.bends.length) * len(BODY)
    assert sum(looked) < pieces / 2
    assert proven(again, entries)


def test_around_what_is_in_the_way_the_driven_part_stays(found: Plan, looked: list[int]) -> None:
    entries = [*ENTRIES, in_the_way(found)]
    again = replan(found, Map(entries, BOUNDS), driven=DRIVEN)
    assert again.path != found.path
    assert proven(again, entries)
    kept = int(np.searchsorted(found.bends.arc, DRIVEN))
    for name in ("length", "begin", "end"):
        assert np.array_equal(getattr(again.bends, name)[:kept], getattr(found.bends, name)[:kept])
    old, new = found.path.curve[0], again.path.curve[0]
    at = np.linspace(0, old.speed.breaks[kept], 20)
    assert np.array_equal(old.poses(at), new.poses(at)) and np.array_equal(old.speed.values(at), new.speed.values(at))


def test_an_obstacle_that_is_gone_costs_nothing(found: Plan, looked: list[int]) -> None:
    again = replan(found, Map(ENTRIES[1:], BOUNDS))
    assert sum(looked) == 0 and proven(again, list(ENTRIES[1:]))


def test_what_was_proven_for_other_hulls_is_not_believed(found: Plan) -> None:
    """An obstacle that moved onto the path is new: nothing proven before hides it."""
    moved = [*ENTRIES[:-1], in_the_way(found)]
    again = replan(found, Map(moved, BOUNDS))
    assert again.path != found.path and proven(again, moved)


def test_what_is_driven_cannot_be_blocked(found: Plan) -> None:
    with pytest.raises(InputError, match=r"what may not change of the path, 9 m, is blocked at \("):
        replan(found, Map([*ENTRIES, in_the_way(found)], BOUNDS), driven=9.0)
