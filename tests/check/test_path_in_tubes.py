"""A path with its tubes in one file: replayed, and broken by every claim that is stretched."""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cfjax
from cfcheck import Outcome, check_document, check_file
from cfcheck.claims.document import document_hash
from cfcheck.reader import read_json
from cfjax.certificate import certify
from cfjax.certificate.trace import trace_deviation
from cfjax.certificate.writing import write_vehicle
from cfjax.errors import InputError
from cfjax.funnel import Funnel, template_named
from cfjax.problem import Interval, KinematicBicycle, Pose, Problem, Profile, Segment, Tube, ball
from cfjax.problem import Path as Course
from cfjax.tubes import chain_document, library, library_files, write_chain
from cfjax.tubes.certified import CertifiedTube, Origin, tube_of
from cfjax.tubes.follow import Following
from tests.check.courses import kink_document
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
    assert 'path: "oval"' in report.message and "lap after lap for ever" in report.message
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
    names = {run.tube.name for run in found.runs}
    assert f"legs: {len(found.runs)}, joints: {len(found.links)}, funnels: {len(names)}" in report.message
    small = cfjax.follow(cfjax.circle(1.0, 0.8), vehicle=KinematicBicycle(0.3, 1.0, 2.0))
    report = check_document(chain_document(small))
    assert report.outcome is Outcome.PROVEN, report.message
    assert "(wheelbase 0.3, max_tan_steering 1, max_thrust 2)" in report.message


def test_tubes_made_by_hand_have_no_file() -> None:
    tube = next(tube for tube in library() if tube.name == "narrow-gentle-slow")
    found = cfjax.follow(cfjax.circle(1.0, 1.0), [replace(tube, origin=None)])
    with pytest.raises(InputError, match="expected tubes"):
        chain_document(found)


def path_of(document: dict[str, Any]) -> dict[str, Any]:
    return document["problem"]["path"]


def pieces_of(document: dict[str, Any]) -> list[dict[str, Any]]:
    return path_of(document)["pieces"]


def parameters_of(document: dict[str, Any]) -> dict[str, Any]:
    return document["problem"]["vehicle"]["parameters"]


def model_of(document: dict[str, Any], index: int = 0) -> dict[str, Any]:
    """The car that a funnel is proven for, written down where it is the one that drives."""
    problem, funnel = document["problem"], document["funnels"][index]
    if funnel["model"] is None:
        same = {"vehicle": problem["vehicle"], "inputs": problem["inputs"]}
        funnel["model"] = {**json.loads(json.dumps(same)), "length": "1", "speed": "1"}
    return funnel["model"]


def of_another_car(document: dict[str, Any], **parameters: str) -> None:
    """The funnels are proven for the car as it was; the one that drives has these parameters, and its dynamics."""
    for index in range(len(document["funnels"])):
        model_of(document, index)
    parameters_of(document).update(parameters)
    numbers = {name: float(Fraction(value)) for name, value in parameters_of(document).items()}
    car = KinematicBicycle(**numbers)
    document["problem"]["vehicle"] = write_vehicle(car, trace_deviation(car))
    limits = {"w": numbers["max_tan_steering"], "thrust": numbers["max_thrust"]}
    for entry in document["problem"]["inputs"]:
        if entry["name"] in limits:
            entry.update(lower=f"-{limits[entry['name']]:g}", upper=f"{limits[entry['name']]:g}")


SPIKE = {"turn_rate": ["0", "0", "1800", "-18000"], "duration": "1/10"}  # 2.67 1/m in the middle, 0 at the ends
LEAVES = "the reference leaves the bounds of the proof"
SPOILED: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "too fast": (lambda d: [piece.update(speed=["40"]) for piece in pieces_of(d)], LEAVES),
    "speed jumps": (lambda d: pieces_of(d)[5]["speed"].__setitem__(0, "11/10"), "speed jumps at piece 5"),
    "curvature": (lambda d: pieces_of(d)[9]["turn_rate"].__setitem__(0, "5/2"), LEAVES),
    "spike": (lambda d: pieces_of(d)[9].update(SPIKE), LEAVES),
    "standstill": (lambda d: [piece.update(speed=["0"]) for piece in pieces_of(d)], LEAVES),
    "backwards": (lambda d: [piece.update(speed=["-1"]) for piece in pieces_of(d)], LEAVES),
    "does not close": (lambda d: (pieces_of(d).pop(), d["legs"][-1].update(end=63)), "end of the lap is not its start"),
    "longer": (lambda d: pieces_of(d)[7].update(duration="2"), "end of the lap is not its start"),
    "ratio too low": (lambda d: d["joints"][0].update(ratio="1/100"), "does not lie inside the start"),
    "ratio too high": (lambda d: d["joints"][0].update(ratio="2"), "not as wide as is claimed"),
    "another vehicle": (lambda d: model_of(d)["vehicle"].update(name="hovercraft"), "name and states of the problem's"),
    "weaker car": (lambda d: of_another_car(d, max_thrust="3"), "more of thrust than the vehicle that drives has"),
    "longer car": (lambda d: of_another_car(d, wheelbase="7/20"), "more of w than the vehicle that drives has"),
    "stretched tube": (lambda d: model_of(d).update(length="2"), LEAVES),
    "faster tube": (lambda d: model_of(d).update(speed="2"), "more of thrust than the vehicle that drives has"),
    "other inputs": (lambda d: d["problem"]["inputs"][2].update(upper="3"), "condition (d)"),
    "fewer inputs than the proof has": (
        lambda d: (model_of(d), d["problem"]["inputs"][2].update(upper="399/100")),
        "more of thrust than the vehicle that drives has",
    ),
    "tube's margin": (lambda d: d["funnels"][0].update(margin="100"), "margin 100 1/s claimed"),
    "tube's bounds": (lambda d: stretch_of(d)["bounds"].update(curvature=["-3", "3"]), "condition (d)"),
    "model of a funnel that changes": (
        lambda d: (model_of(d), d["funnels"][0].update(margin_per_metre=None)),
        "no model for a funnel that changes with theta",
    ),
}


def stretch_of(document: dict[str, Any]) -> dict[str, Any]:
    return document["hints"]["decrease"][0]["stretches"][0]


def assert_broken(document: dict[str, Any], words: str) -> None:
    """With a hash that is that of what stands there."""
    report = check_document(renewed(document))
    assert report.outcome in (Outcome.BROKEN, Outcome.UNREADABLE), report.message
    assert words in report.message
    assert "\n" not in report.message


@pytest.mark.parametrize("name", SPOILED)
def test_stretched_claims_are_broken(document: dict[str, Any], name: str) -> None:
    spoil, words = SPOILED[name]
    spoil(document)
    assert_broken(document, words)


def a_tube_of(document: dict[str, Any], length: str, speed: str) -> dict[str, Any]:
    """A tube of the package as one for every path within its bounds, proven for a car of another scale."""
    found = read_json(next(path for path in library_files() if path.name.startswith("wide-gentle-slow")))
    assert isinstance(found, dict)
    model_of(found).update(length=length, speed=speed)
    thrust = Fraction(speed) ** 2 / Fraction(length)
    for entry in found["problem"]["inputs"]:
        scale = {"w": 1 / Fraction(length), "thrust": thrust}.get(entry["name"], 1)
        entry.update(lower=str(Fraction(entry["lower"]) * scale), upper=str(Fraction(entry["upper"]) * scale))
    found["problem"]["sets"].update(inlet=None, goal=None, safe=None)
    return found


def test_bounds_of_every_path_are_those_of_the_car_that_drives(document: dict[str, Any]) -> None:
    """Slower by four: the paths that are meant are slower too, not those of the car that it is proven for."""
    tube = a_tube_of(document, "1", "1/4")
    assert_broken(tube, "are not those of every path that is meant")
    bounds = path_of(tube)["bounds"]
    scales = {"speed": Fraction(1, 4), "acceleration": Fraction(1, 16)}
    for name, scale in scales.items():
        bounds[name] = [str(Fraction(end) * scale) for end in bounds[name]]
    report = check_document(renewed(tube))
    assert report.outcome is Outcome.PROVEN, report.message
    bounds["curvature"][1] = str(Fraction(bounds["curvature"][1]) * 2)
    assert_broken(tube, "are not those of every path that is meant")


def test_signs_of_a_mirror_are_in_the_order_of_the_inputs(document: dict[str, Any]) -> None:
    """Else steering and thrust, one of which has no symmetric limits, could stand for each other."""
    named_otherwise(document)
    model_of(document)
    document["problem"]["inputs"][1:] = document["problem"]["inputs"][:0:-1]
    assert_broken(document, "inputs in another order")


def test_models_that_make_no_sense_are_refused(document: dict[str, Any]) -> None:
    model_of(document)["vehicle"]["parameters"].pop("max_thrust")
    assert_broken(document, "parameters, states or inputs are not those of a kinematic_bicycle")
    named_otherwise(document)
    assert_broken(document, "name and states of the problem's vehicle")


def test_a_great_many_legs_and_stretches_do_not_keep_the_checker_busy() -> None:
    """Long coefficients, each leg cut by each stretch: what is looked at before anything is proven is paid for too."""
    document = kink_document()
    first = f"1/{3**360}"
    piece = {"duration": "1/2", "turn_rate": [first] * 8, "speed": ["3/2", *[first] * 7]}
    others = [{**piece, "turn_rate": [f"1/{3**370 + k}", *piece["turn_rate"][1:]]} for k in range(512)]
    path_of(document).update(pieces=others, start=["0", "0", "0"])
    document["legs"] = [{"end": k + 1, "funnel": 0} for k in range(512)]
    document["joints"] = [{"ratio": "1"}] * 511
    (last,) = document["hints"]["decrease"][0]["stretches"][-1:]
    wide = {"curvature": ["-9", "9"], "speed": ["1", "2"], "acceleration": ["-9", "9"], "curvature_rate": ["-9", "9"]}
    ends = [str(Fraction(k + 1, 128)) for k in range(64)]
    document["hints"]["decrease"][0]["stretches"] = [{**last, "end": end, "bounds": wide} for end in ends]
    document["problem"]["sets"].update(inlet=None, goal=None)
    begin = time.perf_counter()
    assert_broken(document, "more arithmetic than the checker takes")
    assert time.perf_counter() - begin < 120  # a hang, not a benchmark


def test_what_a_car_can_do_more_is_no_matter(document: dict[str, Any]) -> None:
    """The funnels are those of the car as it was, by its own inputs."""
    of_another_car(document, max_thrust="5", wheelbase="33/100")
    report = check_document(renewed(document))
    assert report.outcome is Outcome.PROVEN, report.message
    assert "thrust in [-5, 5]" in report.message


# --- a vehicle that the checker does not know


def named_otherwise(document: dict[str, Any]) -> None:
    """The same dynamics under another name."""
    document["problem"]["vehicle"]["name"] = "another"


def another_constant(document: dict[str, Any]) -> None:
    """One of the constants in the dynamics that the funnel is proven for."""
    nodes = model_of(document)["vehicle"]["dynamics"]["nodes"]
    next(node for node in nodes if node[0] == "constant")[1] = "7/2"


OTHERWISE: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "longer": (lambda d: model_of(d).update(length="11/10"), "another vehicle, none of kinematic_bicycle"),
    "faster": (lambda d: model_of(d).update(speed="11/10"), "another vehicle, none of kinematic_bicycle"),
    "parameters": (
        lambda d: model_of(d)["vehicle"]["parameters"].update(wheelbase="1/3"),
        "another vehicle, none of kinematic_bicycle",
    ),
    "dynamics": (another_constant, "another vehicle, none of kinematic_bicycle"),
    "limits": (lambda d: model_of(d)["inputs"][1].update(upper="2"), "more of w than the vehicle that drives has"),
    "name": (
        lambda d: (model_of(d), d["problem"]["vehicle"].update(name="kinematic_bicycle")),
        "name and states of the problem's vehicle",
    ),
    "states": (lambda d: model_of(d)["vehicle"]["states"].__setitem__(3, "speed"), "name and states of the problem's"),
    "sets": (
        lambda d: d["problem"]["sets"].update(inlet={"half_axes": ["1/100"] * 3}),
        "a list of 4 entries",
    ),
}


def test_a_path_of_an_unknown_vehicle_is_one_of_what_its_graph_shows(document: dict[str, Any]) -> None:
    named_otherwise(document)
    report = check_document(renewed(document))
    assert report.outcome is Outcome.PROVEN, report.message
    assert "a name unknown to this checker" in report.message and "depends on the path's speed alone" in report.message
    vehicle = document["problem"]["vehicle"]
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
    assert len(document["legs"]) == 2
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
    path_of(document)["name"] = "another"
    assert check_document(document).message.startswith("hash:")
    assert check_document(document, skip_hash=True).outcome is Outcome.PROVEN


UNREADABLE: dict[str, Callable[[dict[str, Any]], object]] = {
    "no funnel": lambda d: d.update(funnels=[]),
    "unknown funnel": lambda d: d["legs"][0].update(funnel=1),
    "leg backwards": lambda d: d["legs"].append({"end": 3, "funnel": 0}),
    "legs end early": lambda d: d["legs"][-1].update(end=len(pieces_of(d)) - 1),
    "joint missing": lambda d: d["joints"].pop(),
    "version": lambda d: d.update(version=1),
    "closed": lambda d: path_of(d).update(closed=1),
    "segments": lambda d: pieces_of(d)[0].update(segment=1),
    "duration": lambda d: pieces_of(d)[0].update(duration="0"),
    "scale": lambda d: model_of(d).update(length="-1"),
    "field": lambda d: d.update(more=1),
    "long": lambda d: pieces_of(d)[0]["speed"].append("1/" + "3" * 200),
    "many": lambda d: path_of(d).update(pieces=pieces_of(d) * 80),
    "float": lambda d: pieces_of(d)[0]["speed"].__setitem__(0, 1.0),
}


@pytest.mark.parametrize("name", UNREADABLE)
def test_what_is_no_path_in_tubes_is_unreadable(document: dict[str, Any], name: str) -> None:
    UNREADABLE[name](document)
    report = check_document(renewed(document))
    assert report.outcome is Outcome.UNREADABLE, report.message


def test_wild_paths_do_not_keep_the_checker_busy(document: dict[str, Any]) -> None:
    """Polynomials of the highest degree with the longest coefficients, as many pieces as are taken."""
    rng = np.random.default_rng(0)

    def wild() -> list[str]:
        return [f"{rng.integers(1, 9)}{''.join(map(str, rng.integers(0, 10, 80)))}/{10**80 + 1}" for _ in range(8)]

    for spin in ("1", "1000000"):
        piece = {"duration": "1/100", "turn_rate": [spin, *wild()[1:]], "speed": ["1"]}
        path_of(document)["pieces"] = [dict(piece) for _ in range(1000)]
        document["legs"] = [{"end": 1000, "funnel": 0}]
        begin = time.perf_counter()
        assert check_document(renewed(document)).outcome is Outcome.BROKEN
        assert time.perf_counter() - begin < 60  # a hang, not a benchmark: it takes seconds
