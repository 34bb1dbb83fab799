"""A path with its tubes in one file: replayed, and broken by every claim that is stretched."""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cfjax
from cfjax.certificate import certify
from cfjax.check import Outcome, check_document, check_file
from cfjax.check.certified import CertifiedTube, Origin
from cfjax.check.chain import tube_of
from cfjax.check.document import document_hash
from cfjax.errors import InputError
from cfjax.funnel import Funnel, template_named
from cfjax.problem import Interval, KinematicBicycle, Pose, Problem, Profile, Segment, Tube, ball
from cfjax.problem import Path as Course
from cfjax.tubes import chain_document, library, write_chain
from cfjax.tubes.follow import Following
from tests.check.vehicles import SeenAhead


@pytest.fixture(scope="module")
def following() -> Following:
    return cfjax.follow(cfjax.oval(), closed=True)


@pytest.fixture(scope="module")
def text(following: Following) -> str:
    return json.dumps(chain_document(following))


@pytest.fixture
def document(text: str) -> dict[str, Any]:
    """A fresh copy to be spoiled."""
    return json.loads(text)


def renewed(document: dict[str, Any]) -> dict[str, Any]:
    return {**document, "hash": document_hash(document)}


def test_the_oval_is_proven_from_its_file(following: Following, tmp_path: Path) -> None:
    write_chain(following, tmp_path / "oval.json")
    report = check_file(tmp_path / "oval.json")
    assert report.outcome is Outcome.PROVEN, report.message
    assert 'path: "oval"' in report.message and "for ever, lap after lap" in report.message
    assert report.arrival is not None
    earliest, latest = following.arrival
    assert earliest <= float(report.arrival[0]) and float(report.arrival[1]) <= latest
    assert latest / earliest == pytest.approx(4)


def changing_speed() -> Course:
    """From the slow tubes to the fast ones and back: links are needed."""
    breaks = (0.0, 4.0, 7.0, 12.0, 15.0, 20.0)
    speed = ((3.5,), (3.5, 0.0, 0.25, -0.25 / 4.5), (5.0 - 0.75,), (4.25, 0.0, -0.25, 0.25 / 4.5), (3.5,))
    turn_rate = tuple((0.2,) for _ in speed)
    return Course("fast", (Segment(Profile(breaks, turn_rate), Profile(breaks, speed), Pose(0.0, 0.0, 0.0)),))


def test_links_and_another_car_are_replayed() -> None:
    found = cfjax.follow(changing_speed())
    assert len({run.tube.name for run in found.runs}) > 1
    report = check_document(chain_document(found))
    assert report.outcome is Outcome.PROVEN, report.message
    assert f"links: {len(found.links)}" in report.message
    small = cfjax.follow(cfjax.circle(1.0, 0.8), vehicle=KinematicBicycle(0.3, 1.0, 2.0))
    report = check_document(chain_document(small))
    assert report.outcome is Outcome.PROVEN, report.message
    assert "(wheelbase 0.3, max_tan_steering 1, max_thrust 2)" in report.message


def test_tubes_made_by_hand_have_no_file() -> None:
    tube = next(tube for tube in library() if tube.name == "narrow-gentle-slow")
    found = cfjax.follow(cfjax.circle(1.0, 1.0), [replace(tube, origin=None)])
    with pytest.raises(InputError, match="expected tubes"):
        chain_document(found)


def tube_bounds(document: dict[str, Any]) -> dict[str, Any]:
    return document["tubes"][0]["certificate"]["problem"]["path"]["tube"]


SPIKE = {"turn_rate": ["0", "0", "1800", "-18000"], "duration": "1/10"}  # 2.67 1/m in the middle, 0 at the ends
SPOILED: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "too fast": (lambda d: [piece.update(speed=["40"]) for piece in d["path"]["pieces"]], "leaves tube 0"),
    "speed jumps": (lambda d: d["path"]["pieces"][5]["speed"].__setitem__(0, "11/10"), "speed jumps at piece 5"),
    "curvature": (lambda d: d["path"]["pieces"][9]["turn_rate"].__setitem__(0, "5/2"), "leaves tube"),
    "spike": (lambda d: d["path"]["pieces"][9].update(SPIKE), "leaves tube"),
    "standstill": (lambda d: [piece.update(speed=["0"]) for piece in d["path"]["pieces"]], "leaves tube"),
    "backwards": (lambda d: [piece.update(speed=["-1"]) for piece in d["path"]["pieces"]], "leaves tube"),
    "does not close": (lambda d: (d["path"]["pieces"].pop(), d["runs"][-1].update(end=63)), "does not hand over"),
    "longer": (lambda d: d["path"]["pieces"][7].update(duration="2"), "does not hand over"),
    "run too short": (
        lambda d: d["runs"][-1].update(end=len(d["path"]["pieces"]) - 1),
        "from the first piece to the last",
    ),
    "level too low": (lambda d: d["levels"].__setitem__(0, "1/100"), "does not hand over"),
    "level too high": (lambda d: d["levels"].__setitem__(0, "2"), "does not hand over"),
    "level missing": (lambda d: d["levels"].pop(), "expected 1 levels"),
    "another vehicle": (lambda d: d["vehicle"].update(name="hovercraft"), "tube 0: it is proven for another vehicle"),
    "weaker car": (lambda d: d["vehicle"]["parameters"].update(max_thrust="3"), "can do what this one cannot"),
    "longer car": (lambda d: d["vehicle"]["parameters"].update(wheelbase="7/20"), "can do what this one cannot"),
    "stretched tube": (lambda d: d["tubes"][0].update(length="2"), "leaves tube 0"),
    "faster tube": (lambda d: d["tubes"][0].update(speed="2"), "can do what this one cannot"),
    "tube's margin": (
        lambda d: d["tubes"][0]["certificate"]["funnels"][0].update(margin="100"),
        "margin 100 1/s claimed",
    ),
    "tube's bounds": (lambda d: tube_bounds(d).update(curvature=["-3", "3"]), "tube 0: condition (d)"),
}


def assert_broken(document: dict[str, Any], words: str) -> None:
    """With hashes that are those of what stands there."""
    for tube in document["tubes"]:
        tube["certificate"] = renewed(tube["certificate"])
    report = check_document(renewed(document))
    assert report.outcome is Outcome.BROKEN, report.message
    assert words in report.message
    assert "\n" not in report.message


@pytest.mark.parametrize("name", SPOILED)
def test_stretched_claims_are_broken(document: dict[str, Any], name: str) -> None:
    spoil, words = SPOILED[name]
    spoil(document)
    assert_broken(document, words)


# --- a vehicle that the checker does not know


def named_otherwise(document: dict[str, Any]) -> None:
    """The same dynamics under another name, of the path and of its tubes."""
    document["vehicle"]["name"] = "another"
    for entry in document["tubes"]:
        entry["certificate"]["problem"]["vehicle"]["name"] = "another"


def a_second_tube(document: dict[str, Any]) -> dict[str, Any]:
    """A copy of the first one, in which the last piece is; returned for its certificate to be changed."""
    copied = json.loads(json.dumps(document["tubes"][0]))
    document["tubes"].append(copied)
    last = len(document["path"]["pieces"])
    document["runs"] = [{"end": last - 1, "tube": 0}, {"end": last, "tube": 1}]
    return copied["certificate"]["problem"]


def another_constant(document: dict[str, Any]) -> None:
    """One of the constants in the second tube's dynamics."""
    nodes = a_second_tube(document)["vehicle"]["dynamics"]["nodes"]
    next(node for node in nodes if node[0] == "constant")[1] = "7/2"


def other_limits(document: dict[str, Any]) -> None:
    a_second_tube(document)["inputs"][1]["upper"] = "9/10"


OTHERWISE: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "longer": (lambda d: d["tubes"][0].update(length="11/10"), "expected scales of 1"),
    "faster": (lambda d: d["tubes"][0].update(speed="11/10"), "expected scales of 1"),
    "parameters": (lambda d: d["vehicle"]["parameters"].update(wheelbase="1/3"), "can do what this one cannot"),
    "dynamics": (another_constant, "tube 1: it is proven for another vehicle"),
    "limits": (other_limits, "tube 1: it is proven for another vehicle"),
    "name": (lambda d: d["vehicle"].update(name="kinematic_bicycle"), "tube 0: it is proven for another vehicle"),
    "sets": (
        lambda d: d.update(sets={"inlet": ["1/100"] * 3, "goal": ["1"] * 4, "safe": None}),
        "expected 4 numbers each",
    ),
}


def test_a_path_of_an_unknown_vehicle_is_one_of_what_its_graph_shows(document: dict[str, Any]) -> None:
    named_otherwise(document)
    for entry in document["tubes"]:
        entry["certificate"] = renewed(entry["certificate"])
    report = check_document(renewed(document))
    assert report.outcome is Outcome.PROVEN, report.message
    assert "a name unknown to this checker" in report.message and "depends on the path's speed alone" in report.message
    vehicle = document["tubes"][0]["certificate"]["problem"]["vehicle"]
    nodes, outputs = vehicle["dynamics"]["nodes"], vehicle["dynamics"]["outputs"]
    nodes += [["input", "x"], ["add", outputs[0], len(nodes)]]  # what turns by where it is, is no body
    outputs[0] = len(nodes) - 1
    report = check_document(renewed(document))
    assert report.outcome is Outcome.BROKEN
    assert "laps are closed for bodies" in report.message


def steady_tube(curvature: float, vehicle: SeenAhead) -> CertifiedTube:
    """Of one reference alone, which says nothing of any other; certified."""
    zero = Interval(0.0, 0.0)
    bounds = Tube(Interval(curvature, curvature), Interval(1.0, 1.0), zero)
    problem = Problem(Course("one", (bounds,)), vehicle=vehicle, inlet=ball(0.3), goal=ball(0.9))
    shape = np.array([[3.841, -1.6, 0, 0], [-1.6, 5.186, 0, 0], [0, 0, 4.591, 1.156], [0, 0, 1.156, 5.04]])
    found = certify(problem, [Funnel(template_named("contracting"), shape, 0.0, np.inf)])
    assert found.document is not None, found
    assert check_document(found.document).outcome is Outcome.PROVEN
    return replace(tube_of(found.document, f"{curvature}"), origin=Origin(found.document))


def test_tubes_of_one_reference_each_are_no_path_of_one_that_looks_elsewhere() -> None:
    """Straight on, then along an arc: the heading of the reference jumps between them, where neither tube sees it."""
    vehicle = SeenAhead(ahead=0.1)
    tubes = [steady_tube(curvature, vehicle) for curvature in (0.0, 0.3)]
    breaks = (0.0, 12.0, 15.0)
    kink = Segment(Profile(breaks, ((0.0,), (0.3,))), Profile(breaks, ((1.0,), (1.0,))), Pose(0.0, 0.0, 0.0))
    document = chain_document(cfjax.follow(Course("kink", (kink,)), tubes))
    assert len(document["runs"]) == 2
    report = check_document(document)
    assert report.outcome is Outcome.BROKEN
    assert "along the path or at one angle" in report.message


@pytest.mark.parametrize("name", OTHERWISE)
def test_nothing_is_taken_for_an_unknown_vehicle_s(document: dict[str, Any], name: str) -> None:
    spoil, words = OTHERWISE[name]
    named_otherwise(document)
    spoil(document)
    assert_broken(document, words)


def test_the_hash_is_looked_at(document: dict[str, Any]) -> None:
    document["path"]["name"] = "another"
    assert check_document(document).message.startswith("hash:")
    assert check_document(document, skip_hash=True).outcome is Outcome.PROVEN


UNREADABLE: dict[str, Callable[[dict[str, Any]], object]] = {
    "a chain in a chain": lambda d: d["tubes"][0].update(certificate=json.loads(json.dumps(d))),
    "no tube": lambda d: d.update(tubes=[]),
    "unknown tube": lambda d: d["runs"][0].update(tube=1),
    "run backwards": lambda d: d["runs"].append({"end": 3, "tube": 0}),
    "version": lambda d: d.update(version=1),
    "parameter": lambda d: d["vehicle"]["parameters"].pop("wheelbase"),
    "closed": lambda d: d["path"].update(closed=1),
    "segments": lambda d: d["path"]["pieces"][0].update(segment=1),
    "duration": lambda d: d["path"]["pieces"][0].update(duration="0"),
    "field": lambda d: d.update(more=1),
    "long": lambda d: d["path"]["pieces"][0]["speed"].append("1/" + "3" * 200),
    "many": lambda d: d["path"].update(pieces=d["path"]["pieces"] * 40),
    "float": lambda d: d["path"]["pieces"][0]["speed"].__setitem__(0, 1.0),
}


@pytest.mark.parametrize("name", UNREADABLE)
def test_what_is_no_chain_is_unreadable(document: dict[str, Any], name: str) -> None:
    UNREADABLE[name](document)
    report = check_document(renewed(document))
    assert report.outcome is Outcome.UNREADABLE, report.message


def test_wild_paths_do_not_keep_the_checker_busy(document: dict[str, Any]) -> None:
    """Polynomials of the highest degree with the longest coefficients, as many pieces as are taken."""
    rng = np.random.default_rng(0)

    def wild() -> list[str]:
        return [f"{rng.integers(1, 9)}{''.join(map(str, rng.integers(0, 10, 80)))}/{10**80 + 1}" for _ in range(8)]

    for spin in ("1", "1000000"):
        piece = {"segment": 0, "duration": "1/100", "turn_rate": [spin, *wild()[1:]], "speed": ["1"]}
        document["path"]["pieces"] = [dict(piece) for _ in range(1000)]
        document["runs"] = [{"end": 1000, "tube": 0}]
        begin = time.perf_counter()
        assert check_document(renewed(document)).outcome is Outcome.BROKEN
        assert time.perf_counter() - begin < 60  # a hang, not a benchmark: it takes seconds
