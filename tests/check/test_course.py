"""Curved paths in several segments with obstacles: a certificate against the truth, and against whoever bends it."""

import contextlib
import copy
import json
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from flint import fmpq

from cfcheck import Outcome, check_document
from cfcheck.claims.assumptions import require_supported
from cfcheck.claims.document import document_hash
from cfcheck.claims.problem import read_problem
from cfcheck.exact.rational import rational
from cfcheck.exact.symbolic import symbolic
from cfcheck.reader import Broken
from cfjax.certificate import dump
from cfjax.certificate.certifier import legs_of
from cfjax.certificate.rounding import round_funnel
from cfjax.certificate.trace import trace_deviation
from cfjax.certificate.writing import seal, write_funnel, write_problem, write_witness
from cfjax.funnel import Funnel, template_named
from cfjax.problem import Method, Path, Pose, Problem, Profile, Segment, affine_deviation, ball, straight
from cfjax.problem.obstacles import disc_centres, distances
from tests.check.courses import SHAPE, bend, kink_document, lap_problem
from tests.check.graphs import ACCELERATION, OMEGA, SLOPE, SPEED, U0, add_to_rate
from tests.check.vehicles import SeenAhead


Document = dict[str, Any]
HAIR = Fraction(1, 10**12)


def checked(document: Document) -> Any:
    return check_document({**document, "hash": document_hash(document)})


def moved(holder: Any, key: Any, by: Fraction | int | str) -> None:
    holder[key] = str(Fraction(holder[key]) + Fraction(by))


def scaled(document: Document, kind: int, factor: str) -> None:
    """C of one of the two funnels, and what joints say of it."""
    shape = document["funnels"][kind]["shape"]
    shape[:] = [str(Fraction(entry) * Fraction(factor)) for entry in shape]
    for leg, joint in enumerate(document["joints"]):
        ratio = Fraction(joint["ratio"])
        joint["ratio"] = str(ratio * Fraction(factor) if leg % 2 == kind else ratio / Fraction(factor))


def first_leg_alone(document: Document) -> None:
    """An open path that is one steady straight."""
    path(document).update(pieces=path(document)["pieces"][:1], closed=False)
    document.update(legs=document["legs"][:1], joints=[])
    document["funnels"].pop()
    document["hints"]["decrease"].pop()
    document["hints"]["clearance"] = document["hints"]["clearance"][:1]


def path(document: Document) -> Document:
    return document["problem"]["path"]


def sets(document: Document) -> Document:
    return document["problem"]["sets"]


def stretches(document: Document, kind: int = 1) -> list[Document]:
    return document["hints"]["decrease"][kind]["stretches"]


@pytest.fixture
def lap(lap_text: str) -> Document:
    """A fresh copy to be spoiled."""
    return json.loads(lap_text)


# --- the sentence and the truth --------------------------------------------------------------------------------------


def test_the_sentence_says_laps_and_obstacles(lap: Document) -> None:
    report = checked(lap)
    assert report.outcome is Outcome.PROVEN
    assert len(stretches(lap)) == 3
    assert [leg["funnel"] for leg in lap["legs"]] == [0, 1, 0, 1]
    for part in (
        "lap after lap for ever",
        "6 pieces stand in the file (",
        "legs: 4, joints: 4, funnels: 2",
        "clear of 2 obstacles",
        "radius 0.2 m at offset 0 m and radius 0.15 m at offset 0.2 m",
        "rate 0.25, 0 1/s",
    ):
        assert part in report.message
    assert [float(margin) for margin in report.margins] == pytest.approx([0.734, 0.959, 0.734, 0.959], abs=0.02)


def test_what_is_not_asked_is_not_said(lap: Document) -> None:
    """Weaker questions have the same proof, and a sentence that is weaker too."""
    open_ = copy.deepcopy(lap)
    path(open_)["closed"] = False
    assert "joints: expected a list of 3" in checked(open_).message
    open_["joints"].pop()
    assert checked(open_).outcome is Outcome.PROVEN
    assert "for ever" not in checked(open_).message
    sets(lap)["obstacles"] = []
    assert "clearance: expected a list of 0" in checked(lap).message  # no half-planes for nothing
    lap["hints"]["clearance"] = []
    report = checked(lap)
    assert report.outcome is Outcome.PROVEN
    assert "obstacle" not in report.message
    assert "footprint" not in report.message


def test_the_proof_is_true_of_the_real_reference(lap: Document) -> None:
    """No code of the checker: the profiles, V and the dynamics in floating point, at θ and x of the shell."""
    problem, rng = lap_problem(), np.random.default_rng(0)
    corners = [np.array([1.0, w, thrust]) for w in (-1, 1) for thrust in (-4, 4)]
    for kind, segment in enumerate(problem.path.distinct):
        assert isinstance(segment, Segment)
        shape, rate, margin = _float_funnel(lap, kind)
        root = np.linalg.inv(np.linalg.cholesky(shape))
        slack = []
        for theta in [*np.linspace(0, segment.duration, 9), *rng.uniform(0, segment.duration, 16)]:
            point = segment.point(float(theta))
            for value in (0.9, 0.95, 1.0):
                ridges = rng.normal(size=(24, 4)) * [0, 1, 1, 0]  # ∇V without authority of steering or thrust
                directions = np.concatenate([rng.normal(size=(12, 4)), ridges @ root.T])
                x = np.sqrt(value * np.exp(-rate * theta)) * directions / np.linalg.norm(directions, axis=1)[:, None]
                for deviation in x @ root:
                    slack.append(_decrease(problem, shape, rate, theta, deviation, point, corners) - margin)
        assert min(slack) >= -1e-9
        assert min(slack) < 0.15 * margin  # and the claim is not empty


def _float_funnel(document: Document, kind: int) -> tuple[np.ndarray, float, float]:
    funnel = document["funnels"][kind]
    shape = np.zeros((4, 4))
    shape[np.tril_indices(4)] = [float(Fraction(entry)) for entry in funnel["shape"]]
    return shape + np.tril(shape, -1).T, float(Fraction(funnel["rate"])), float(Fraction(funnel["margin"]))


def _decrease(
    problem: Problem, shape: np.ndarray, rate: float, theta: float, x: np.ndarray, point: Any, corners: list
) -> float:
    """−V̇ of the best vertex, V = e^{kθ} xᵀ C x."""
    drift, columns = (np.asarray(part) for part in affine_deviation(problem.vehicle, x, point))
    q = x @ shape @ x
    return float(
        np.exp(rate * theta) * max(-(2 * x @ shape @ (drift + columns @ u) + rate * q * u[0]) for u in corners)
    )


@pytest.mark.slow
def test_joints_and_obstacles_are_true(lap: Document) -> None:
    problem, rng = lap_problem(), np.random.default_rng(1)
    directions = rng.normal(size=(4000, 4))
    sphere = directions / np.linalg.norm(directions, axis=1)[:, None]
    segments = problem.path.curve
    for index, segment in enumerate(segments):
        after = segments[(index + 1) % 4]
        one, rate, _ = _float_funnel(lap, index % 2)
        two, _, _ = _float_funnel(lap, (index + 1) % 2)
        x = np.exp(-rate * segment.duration / 2) * sphere @ np.linalg.inv(np.linalg.cholesky(one))
        x[:, 3] += segment.point(segment.duration).speed - after.point(0.0).speed
        assert np.einsum("ni,ij,nj->n", x, two, x).max() < 1
    for index, segment in enumerate(segments):
        shape, rate, _ = _float_funnel(lap, index % 2)
        body = sphere @ np.linalg.inv(np.linalg.cholesky(shape))
        theta = np.linspace(0, segment.duration, 41)
        for at, (alpha, px, py) in zip(theta, segment.poses(theta), strict=True):
            x = np.exp(-rate * at / 2) * body
            heading = alpha + x[:, 0]
            cars = np.column_stack(
                [
                    heading,
                    px + x[:, 1] * np.cos(alpha) - x[:, 2] * np.sin(alpha),
                    py + x[:, 1] * np.sin(alpha) + x[:, 2] * np.cos(alpha),
                ]
            )
            for radius, centres in disc_centres(problem.footprint, cars):
                for obstacle in problem.obstacles:
                    assert distances(obstacle, centres)[0].min() > radius


# --- attacks ---------------------------------------------------------------------------------------------------------


def opened(document: Document) -> None:
    path(document)["closed"] = False
    document["joints"].pop()


def another_funnel(document: Document) -> None:
    """That of the straight for a bend."""
    document["legs"][1]["funnel"] = 0


def from_the_second_on(document: Document) -> None:
    for leg in document["legs"]:
        leg["funnel"] = 1 - leg["funnel"]


def a_jump_that_is_too_large(document: Document) -> None:
    """The straight 0.1 m/s faster: its own proof is spoiled too, but joints come first."""
    opened(document)
    for index in (0, 3):
        moved(path(document)["pieces"][index]["speed"], 0, Fraction(1, 10))
    for side in (0, 1):
        moved(stretches(document, 0)[0]["bounds"]["speed"], side, Fraction(1, 10))


def link_too_wide(document: Document) -> None:
    scaled(document, 1, "9/10")
    sets(document)["goal"]["half_axes"] = ["1/3"] * 4


def the_first_leg_s_stretch_ends_early(document: Document) -> None:
    moved(document["hints"]["clearance"][0][-1], "end", -HAIR)


def turned_normals(document: Document) -> None:
    for leg in document["hints"]["clearance"]:
        for stretch in leg:
            stretch["normals"] = [[-y, x] for x, y in stretch["normals"]]


def a_gap(document: Document) -> None:
    """The last bend shorter by 10 µm: none for the other one's proof any more, and no end of a lap."""
    piece = path(document)["pieces"][-1]
    moved(piece, "duration", Fraction(-1, 10**5))


def all_bends_shorter(document: Document) -> None:
    """Both bends, and the proof with them: legs, but no lap."""
    for index in (2, 5):
        moved(path(document)["pieces"][index], "duration", Fraction(-1, 10**5))
    moved(stretches(document)[-1], "end", Fraction(-1, 10**5))


def another_vehicle(document: Document) -> None:
    document["problem"]["vehicle"]["name"] = "other"


def another_vehicle_on_an_open_path(document: Document) -> None:
    another_vehicle(document)
    opened(document)
    sets(document)["obstacles"], document["hints"]["clearance"] = [], []


def start_moved(document: Document) -> None:
    moved(path(document)["start"], 1, "1")


def start_turned(document: Document) -> None:
    moved(path(document)["start"], 0, "-1")


def bound(stretch: int, name: str, side: int, by: Fraction) -> Callable[[Document], None]:
    def spoil(document: Document) -> None:
        moved(stretches(document)[stretch]["bounds"][name], side, by)

    return spoil


def constant_of_another(document: Document) -> None:
    """Cells and their bounds of one stretch for another: the right references, the wrong range of θ."""
    one, two = stretches(document)[:2]
    two["cells"], two["whitening"], two["enclosures"] = one["cells"], one["whitening"], one["enclosures"]


ATTACKS: dict[str, tuple[Callable[[Document], object], str]] = {
    "first stretch missing": (lambda d: stretches(d).pop(0), "leaves the bounds"),
    "stretch missing": (lambda d: stretches(d).pop(1), "leaves the bounds"),
    "last stretch missing": (lambda d: stretches(d).pop(), "do not end where the leg does"),
    "out of order": (lambda d: stretches(d).insert(0, stretches(d).pop(1)), "leaves the bounds"),
    "backwards": (lambda d: stretches(d).reverse(), "do not end where the leg does"),
    "twice": (lambda d: stretches(d).insert(1, stretches(d)[0]), "do not follow each other"),
    "longer": (lambda d: moved(stretches(d)[0], "end", HAIR), "leaves the bounds"),
    "end early": (lambda d: moved(stretches(d)[2], "end", -HAIR), "do not end where the leg does"),
    "end late": (lambda d: moved(stretches(d)[2], "end", HAIR), "do not end where the leg does"),
    "negative end": (lambda d: stretches(d)[0].update(end="-1"), "a positive rational"),
    "no end": (lambda d: stretches(d)[2].update(end=None), "an end of every stretch"),
    "remainder": (
        lambda d: stretches(d)[0]["cells"][0]["remainder"].__setitem__(0, "0"),
        "what the enclosures leave over is more than is stated",
    ),
    "mirror": (lambda d: d["hints"]["decrease"][1].update(mirror=[1] * 7), "not their own mirror images"),
    "no mirror": (lambda d: d["hints"]["decrease"][1].update(mirror=[0] * 7), "not their own mirror images"),
    "joint missing": (lambda d: d["joints"].pop(), "joints: expected a list of 4"),
    "joint that is no ratio": (lambda d: d["joints"][0].update(ratio="-1"), "a positive rational"),
    "leg missing": (
        lambda d: (d["legs"].pop(), d["joints"].pop()),
        "legs: expected the last one to end with piece 6, got 4",
    ),
    "leg too long": (lambda d: d["legs"][0].update(end=2), "the speed jumps at piece 1, inside leg 0"),
    "third funnel": (lambda d: d["legs"][3].update(funnel=2), "a whole number between 0 and 1"),
    "curvature from below": (bound(0, "curvature", 0, HAIR), "leaves the bounds"),
    "curvature from above": (bound(0, "curvature", 1, -HAIR), "leaves the bounds"),
    "speed from below": (bound(2, "speed", 0, HAIR), "leaves the bounds"),
    "speed from above": (bound(2, "speed", 1, -HAIR), "leaves the bounds"),
    "acceleration": (lambda d: stretches(d)[2]["bounds"].update(acceleration=["0", "0"]), "leaves the bounds"),
    "acceleration by a hair": (
        lambda d: stretches(d)[2]["bounds"].update(acceleration=[str(Fraction(1, 100) - HAIR)] * 2),
        "leaves the bounds",
    ),
    "bounds wider than the proof": (bound(1, "curvature", 1, Fraction(1, 2)), "condition (d)"),
    "whitening": (
        lambda d: stretches(d)[1].update(
            whitening=[[str(Fraction(w) * Fraction(99, 100)) for w in r] for r in stretches(d)[1]["whitening"]]
        ),
        "whitening",
    ),
    "cells of another stretch": (constant_of_another, "condition (d)"),
    "cells of another kind": (
        lambda d: d["hints"]["decrease"].__setitem__(1, copy.deepcopy(d["hints"]["decrease"][0])),
        "do not end where the leg does",
    ),
    "cells of a reference missing": (
        lambda d: stretches(d)[0].update(cells=[c for c in stretches(d)[0]["cells"] if c["reference"] == 0]),
        "is missing",
    ),
    "another funnel": (another_funnel, "leg 1: the stretches of the proof do not end where the leg does"),
    "funnels out of order": (from_the_second_on, "numbered as they appear"),
    "joint": (link_too_wide, "joint, from leg 1 to leg 2: the end of the funnel"),
    "joint that says too much": (
        lambda d: d["joints"][1].update(ratio="2"),
        "joint, from leg 1 to leg 2: the next funnel is not as wide",
    ),
    "joint over the jump": (lambda d: scaled(d, 1, "110/100"), "joint, from leg 0 to leg 1: the end of the funnel"),
    "jump too large": (a_jump_that_is_too_large, "joint, from leg 0 to leg 1"),
    "gap": (a_gap, "leg 3: the stretches of the proof do not end where the leg does"),
    "no lap": (all_bends_shorter, "the end of the lap is not its start"),
    "rate": (lambda d: d["funnels"][0].update(rate="1/8"), "joint, from leg 0 to leg 1"),
    "rate of the bend": (lambda d: d["funnels"][1].update(rate="1/1000"), "condition (d)"),
    "margin": (lambda d: moved(d["funnels"][1], "margin", "1/100"), "funnel 1: condition (d)"),
    "margin of the straight": (lambda d: moved(d["funnels"][0], "margin", "1/100"), "funnel 0: condition (d)"),
    "goal": (lambda d: sets(d)["goal"].update(half_axes=["1/5"] * 4), "funnel 1: condition (b)"),
    "inlet": (lambda d: sets(d)["inlet"].update(half_axes=["1/6"] * 4), "funnel 0: condition (a)"),
    "safe": (lambda d: sets(d)["safe"]["half_widths"].__setitem__(1, "1/6"), "condition (c)"),
    "start moved": (start_moved, "clearance is not proven at theta"),
    "start turned": (start_turned, "clearance is not proven at theta"),
    "obstacle grown": (lambda d: sets(d)["obstacles"][0].update(round="1"), "clearance is not proven at theta"),
    "obstacle moved": (
        lambda d: sets(d)["obstacles"][1]["corners"].append(["0", "1"]),
        "clearance is not proven at theta",
    ),
    "body larger": (lambda d: sets(d)["footprint"][1].update(radius="1"), "clearance is not proven at theta"),
    "body longer": (lambda d: sets(d)["footprint"][1].update(offset="3/2"), "clearance is not proven at theta"),
    "no body": (lambda d: sets(d).update(footprint=[]), "no footprint that could clear them"),
    "normals turned": (turned_normals, "clearance is not proven at theta"),
    "stretches end early": (the_first_leg_s_stretch_ends_early, "expected stretches whose ends increase"),
    "stretches missing": (lambda d: d["hints"].update(clearance=[]), "expected a list of 4"),
    "a leg's stretches missing": (lambda d: d["hints"]["clearance"][0].clear(), "expected a list of 1 to"),
    "a stretch's normals missing": (
        lambda d: [each.update(normals=[]) for leg in d["hints"]["clearance"] for each in leg],
        "no half-plane is stated",
    ),
    "another vehicle": (another_vehicle, "laps are closed for bodies that look along the path"),
    "another vehicle's links": (another_vehicle_on_an_open_path, "the speed jumps, and with it states of a vehicle"),
    "funnel missing": (lambda d: d["funnels"].pop(), "legs[1].funnel: expected a whole number between 0 and 0"),
    "margin per metre": (
        lambda d: d["funnels"][1].update(margin_per_metre="1/9"),
        "a margin per metre and a proof without an end go together",
    ),
}


@pytest.mark.parametrize("name", ATTACKS)
def test_what_is_bent_is_broken(lap: Document, name: str) -> None:
    spoil, words = ATTACKS[name]
    spoil(lap)
    report = checked(lap)
    assert report.outcome in (Outcome.BROKEN, Outcome.UNREADABLE)
    assert words in report.message


def test_a_jump_is_absorbed_exactly_as_far_as_the_inequality_goes(lap: Document) -> None:
    """C₀ ≻ ρ₀/(1 − J)² C₁ in floating point: the bend's C larger by less than the slack is accepted, by more is not."""
    first, rate, _ = _float_funnel(lap, 0)
    second, _, _ = _float_funnel(lap, 1)
    segments = lap_problem().path.curve
    jump = np.sqrt(second[3, 3]) * (segments[0].point(segments[0].duration).speed - segments[1].point(0.0).speed)
    level = np.exp(-rate * segments[0].duration)
    ratio = 1 / np.linalg.eigvals(np.linalg.solve(first, level * second / (1 - jump) ** 2)).real.max()
    assert 1 < ratio < 1.1  # nearly: the jump grows with √factor
    for factor, holds in ((1 + 0.9 * (ratio - 1), True), (1 + 1.1 * (ratio - 1), False)):
        document = copy.deepcopy(lap)
        scaled(document, 1, str(Fraction(factor).limit_denominator(10**6)))
        report = checked(document)
        assert ("joint" not in report.message) is holds
        assert report.outcome is Outcome.BROKEN  # the bend's proof was for another C


def test_obstacles_need_a_vehicle_with_a_meaning(lap: Document) -> None:
    """One leg, open: nothing but the obstacles is left to refuse."""
    first_leg_alone(lap)
    assert checked(lap).outcome is Outcome.PROVEN
    another_vehicle(lap)
    report = checked(lap)
    assert report.outcome is Outcome.PROVEN
    assert (
        "those of a body whose reference looks along the path, and what else it has of states depends" in report.message
    )
    slope_enters(lap, 1)  # whatever moves so is no body
    assert "obstacles are cleared by bodies that look along the path only" in checked(lap).message
    sets(lap)["obstacles"], lap["hints"]["clearance"] = [], []
    assert checked(lap).outcome is Outcome.PROVEN


def test_a_tube_clears_no_obstacle(tube_text: str) -> None:
    document = json.loads(tube_text)
    sets(document)["obstacles"] = [{"corners": [["100", "0"]], "round": "1"}]
    sets(document)["footprint"] = [{"radius": "1/4", "offset": "0"}]
    report = checked(document)
    assert report.outcome is Outcome.BROKEN
    assert "what has no place clears no obstacle" in report.message


def slope_enters(document: Document, output: int = 3) -> None:
    """Another vehicle, whose reference has a state that goes with the turning rate: no tube's proof reads its slope."""
    another_vehicle(document)
    add_to_rate(document, output, ("neg", ("mul", SLOPE, U0)))


def test_curvature_must_not_jump_under_a_vehicle_whose_reference_then_jumps() -> None:
    """Straight, then an arc: each stretch has one reference, and the deviation would jump between them, unseen."""
    document = kink_document()
    assert checked(document).outcome is Outcome.PROVEN  # a car whose reference does not jump
    another_vehicle(document)
    report = checked(document)
    assert report.outcome is Outcome.PROVEN
    assert "what else it has of states depends on the path's speed alone" in report.message
    slope_enters(document)
    report = checked(document)
    assert report.outcome is Outcome.BROKEN
    assert ": the turning rate jumps" in report.message


def test_a_slope_that_is_zero_all_along_does_no_harm(lap: Document) -> None:
    first_leg_alone(lap)
    sets(lap)["obstacles"], lap["hints"]["clearance"] = [], []
    slope_enters(lap)
    assert checked(lap).outcome is Outcome.PROVEN
    (piece,) = path(lap)["pieces"]
    half = str(Fraction(piece["duration"]) / 2)
    path(lap)["pieces"] = [{**piece, "duration": half}, {**piece, "duration": half}]
    lap["legs"][0]["end"] = 2
    assert checked(lap).outcome is Outcome.PROVEN  # in two pieces that say the same


@pytest.mark.parametrize(
    ("follows", "jump", "message"),
    [
        (False, {}, ""),
        (True, {}, ""),
        (False, {"turn_rate": "1/1000000000"}, ""),  # states that depend on the speed alone
        (True, {"turn_rate": "1/1000000000"}, ": the turning rate jumps"),
        (False, {"speed": "1/1000000000"}, ": the speed jumps"),
    ],
)
def test_states_that_nobody_knows_must_not_jump_between_segments(follows: bool, jump: dict, message: str) -> None:
    parts = ((1.0, Pose(0.0, 0.0, 0.0)), (2.0, Pose(0.0, 0.0, 1.0)))
    segments = (Segment(Profile.constant(0.0, end), Profile.constant(1.0, end), start) for end, start in parts)
    problem = Problem(Path("two", tuple(segments)))
    document = {"problem": write_problem(problem, trace_deviation(problem.vehicle))}
    another_vehicle(document)
    if follows:
        slope_enters(document)
    _, second = path(document)["pieces"]
    for profile, by in jump.items():
        moved(second[profile], 0, by)
    with pytest.raises(Broken, match=message) if message else contextlib.nullcontext():
        asked_of(document)


def asked_of(document: Document) -> None:
    """That the path may be asked about, for the dynamics in the file."""
    claim = read_problem(document["problem"])
    require_supported(claim, symbolic(claim.vehicle.graph, claim.vehicle.states, tuple(claim.inputs)))


def test_what_the_turning_rate_does_otherwise_must_not_jump_either() -> None:
    """A term of a method without timing, in which nothing says that it is one of a state of the reference."""
    document = kink_document()
    another_vehicle(document)
    asked_of(document)
    add_to_rate(document, 3, OMEGA)
    with pytest.raises(Broken, match=": the turning rate jumps"):
        asked_of(document)


def test_where_the_turning_rate_jumps_dynamics_are_those_of_a_tube() -> None:
    """What jumps with it is bounded by states and inputs alone: that is what held inputs are proven with."""
    document = kink_document()
    another_vehicle(document)
    add_to_rate(document, 3, ("mul", ("mul", ACCELERATION, U0), SPEED))
    asked_of(document)
    report = checked(document)
    assert report.outcome is Outcome.BROKEN
    assert "the acceleration enters as acceleration times u0 g(x)" in report.message


def seen_ahead(document: Document) -> None:
    """Another vehicle: the same car by a point ahead of it, which looks away from the path where it turns."""
    vehicle = SeenAhead()
    document["problem"]["vehicle"] = write_problem(Problem(straight(), vehicle=vehicle), trace_deviation(vehicle))[
        "vehicle"
    ]


def test_a_reference_must_not_look_elsewhere_where_curvature_jumps() -> None:
    """Straight, then an arc, in one leg or in two: the body's heading would jump between them, unseen."""
    document = kink_document()
    seen_ahead(document)
    with pytest.raises(Broken, match="along the path or at one angle"):
        asked_of(document)


def test_a_tube_holds_no_reference_that_looks_elsewhere(tube_text: str) -> None:
    document = json.loads(tube_text)
    another_vehicle(document)
    report = checked(document)
    assert report.outcome is Outcome.PROVEN
    assert "what else it has of states depends on the path's speed alone" in report.message
    seen_ahead(document)
    report = checked(document)
    assert report.outcome is Outcome.BROKEN
    assert "along the path or at one angle" in report.message


# --- witnesses on a curve --------------------------------------------------------------------------------------------


def test_a_witness_on_a_curve_holds_at_its_theta_alone() -> None:
    """At a deviation the best decrease differs along the bend: a margin in between is refuted at one θ only."""
    segment = bend()
    problem = Problem(Path("bend", (segment,)), inlet=ball(0.14), goal=ball(0.26), method=Method.TT)
    funnel = round_funnel(Funnel(template_named("contracting"), SHAPE, 0.0, segment.duration), segment)
    corners = [np.array([1.0, w, thrust]) for w in (-1, 1) for thrust in (-4, 4)]
    directions = np.random.default_rng(4).normal(size=(400, 4))
    points = 0.97 * directions / np.linalg.norm(directions, axis=1)[:, None] @ np.linalg.inv(np.linalg.cholesky(SHAPE))
    early, late = 0.0, 1.5

    def best(x: np.ndarray, theta: float) -> float:
        return _decrease(problem, SHAPE, 0.0, theta, x, segment.point(theta), corners)

    x = max(points, key=lambda x: best(x, early) - best(x, late))
    assert best(x, early) - best(x, late) > 0.1
    margin = rational(round((best(x, early) + best(x, late)) / 2, 3))
    exact = [rational(round(float(value), 9)) for value in x]

    def verdict(theta: float, claimed: fmpq, number: int = 0, condition: str = "d") -> Any:
        question = write_problem(problem, trace_deviation(problem.vehicle))
        witness = write_witness(condition, number, rational(theta), 0, exact)
        candidate = write_funnel(funnel.claim(claimed))
        return check_document(
            json.loads(dump(seal("refutation", question, [candidate], witness, legs_of(problem.path))))
        )

    told = verdict(late, margin)
    assert told.outcome is Outcome.REFUTED
    assert "theta = 1.5 s" in told.message
    assert verdict(early, margin).outcome is Outcome.BROKEN
    assert verdict(late, rational(round(best(x, late) - 0.01, 3))).outcome is Outcome.BROKEN
    assert "outside the leg" in verdict(3.0, margin).message
    assert verdict(late, margin, number=1).outcome is Outcome.UNREADABLE
    assert "one end of the leg" in verdict(late, margin, condition="b").message
