"""A path whose curvature does not jump, for a vehicle with a state that goes with it: proven, and bent."""

import itertools
import json
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flint import fmpq

from cfcheck import Outcome, Report, check_document
from cfcheck.claims.document import document_hash
from cfcheck.claims.references import jumps_in_turning
from cfcheck.exact.rational import rational
from cfcheck.path.bounds import Bounds
from cfcheck.path.piece import Piece
from cfcheck.reader import Broken
from cfcheck.replay import check_robustness
from cfcheck.vehicle.structure import has_tube_structure, require_affine_reference
from cfcheck.vehicle.symbolic import symbolic
from cfjax.certificate import certify
from cfjax.certificate.robustness import robustness_document
from cfjax.certificate.trace import trace_deviation
from cfjax.exact import exact_course
from cfjax.funnel import Funnel, template_named
from cfjax.funnel.instance import Span, instance_of
from cfjax.problem import (
    Interval,
    KinematicBicycle,
    Method,
    Path,
    Pose,
    Problem,
    Profile,
    ReferencePoint,
    Segment,
    Tube,
    Vehicle,
    ball,
    deviation_rate,
    ellipse,
    figure_eight,
)
from cfjax.verdict import Verdict
from experiments.vehicles.steered_car import SteeredCar
from experiments.vehicles.unicycle import Unicycle
from tests.by_hand import piece
from tests.check.graphs import (
    ACCELERATION,
    FIRST,
    OMEGA,
    SECOND,
    SLOPE,
    SPEED,
    TURNING,
    U0,
    W,
    add_to_rate,
    dynamics,
)
from tests.check.vehicles import Cart, SeenAhead


Document = dict[str, Any]
SHAPE = np.array(
    [[16.42, -9.12, -0.8, 4.58], [-9.12, 11.05, 0.1, -2.94], [-0.8, 0.1, 15.7, -3.15], [4.58, -2.94, -3.15, 4.96]]
)


def problem_along(turn_rate: tuple, speed: tuple = (1.0,)) -> Problem:
    """1.2 s of a bend; TT, to be quick."""
    breaks = (0.0, 0.6, 1.2) if len(turn_rate) == 2 else (0.0, 1.2)
    bend = Segment(Profile(breaks, turn_rate), Profile((0.0, 1.2), (speed,)), Pose(0.0, 0.0, 0.0))
    return Problem(Path("bend", (bend,)), vehicle=Cart(), inlet=ball(0.19), goal=ball(0.62), method=Method.TT)


BEND = problem_along(((0.2, 0.13),))


def certified(problem: Problem) -> Document:
    found = certify(problem, [Funnel(template_named("contracting"), SHAPE, 0.0, 1.2)], workers=2)
    assert found.verdict is Verdict.CERTIFIED, found.message
    assert found.document is not None
    return found.document


@pytest.fixture(scope="module")
def text() -> str:
    return json.dumps(certified(BEND))


@pytest.fixture
def document(text: str) -> Document:
    """A fresh copy to be spoiled."""
    return json.loads(text)


def checked(document: Document) -> Report:
    return check_document({**document, "hash": document_hash(document)})


def stretch(document: Document) -> Document:
    (found,) = document["hints"]["decrease"][0]["stretches"]
    return found


# --- the proof, and whether it is true


def test_a_bend_is_proven_for_a_vehicle_whose_steering_is_a_state(document: Document) -> None:
    report = checked(document)
    assert report.outcome is Outcome.PROVEN, report.message
    assert "depends on the path's speed and turning rate alone" in report.message
    bounds = {name: [float(Fraction(end)) for end in ends] for name, ends in stretch(document)["bounds"].items()}
    assert bounds["curvature_rate"] == pytest.approx([0.13, 0.13], abs=1e-5)
    assert bounds["curvature"] == pytest.approx([0.2, 0.2 + 1.2 * 0.13], abs=1e-5)
    assert {cell["reference"] for cell in stretch(document)["cells"]} == {0, 1, 2, 3}


@pytest.mark.parametrize("speed", [(1.0,), (1.0, 0.05)], ids=["steady", "faster"])
def test_v_falls_as_is_said_along_the_path_itself(speed: tuple) -> None:
    """In floating point, by the vehicle's own dynamics: at every place and state some vertex of the box does."""
    problem, rng = problem_along(((0.2, 0.1), (0.26, 0.2)), speed), np.random.default_rng(0)
    document = certified(problem)
    margin = float(Fraction(document["funnels"][0]["margin"]))
    assert checked(document).outcome is Outcome.PROVEN
    (segment,) = problem.path.curve
    assert isinstance(segment, Segment)
    gradient = rng.normal(size=(6000, 4))
    gradient[2000:, 3] = 0.0  # steering has no authority over V there, and neither has speed where the last two thirds
    gradient[4000:, 2] = 0.0  # are near alpha = 0: a law has the least to choose from
    x = np.linalg.solve(SHAPE, gradient.T).T
    x = jnp.asarray(x / np.sqrt(np.einsum("ki,ij,kj->k", x, SHAPE, x))[:, None])
    corners = [(1.0, v, w) for v in (0.0, 2.0) for w in (-8.0, 8.0)]

    def rising(point: ReferencePoint, u: tuple) -> jax.Array:
        rate = jnp.stack(jnp.broadcast_arrays(*deviation_rate(problem.vehicle, tuple(x.T), u, point)), axis=1)
        return 2 * jnp.einsum("ki,ij,kj->k", x, jnp.asarray(SHAPE), rate)

    slack = []
    for theta in np.linspace(0.0, 1.2, 13):
        point = segment.point(float(theta))
        best = np.min([np.asarray(rising(point, u)) for u in corners], axis=0)
        slack.append(-best.max() - margin)
    assert min(slack) >= -1e-9
    assert min(slack) < 3 * margin  # what is said is not empty, though one input has to do for all references


def test_held_inputs_are_proven_too(document: Document) -> None:
    hints = robustness_document(document, workers=2)
    report = check_robustness(check_document(document), document, hints)
    assert report.outcome is Outcome.PROVEN, report.message
    assert report.robustness is not None and 1e-5 < float(report.robustness.alone.period) < 0.1


# --- bent


def plain(document: Document) -> None:
    stretch(document)["bounds"].pop("curvature_rate")


def one_vertex_less(document: Document) -> None:
    stretch(document)["cells"] = [cell for cell in stretch(document)["cells"] if cell["reference"] != 3]


def rate_bounds(*ends: str) -> Callable[[Document], None]:
    return lambda document: stretch(document)["bounds"].update(curvature_rate=list(ends))


def pieces_of(document: Document) -> list[Document]:
    return document["problem"]["path"]["pieces"]


def in_two(document: Document, by: str) -> None:
    """The same path in two pieces, the second of which begins with a jump of the turning rate."""
    (whole,) = pieces_of(document)
    end = Fraction(whole["turn_rate"][0]) + Fraction(3, 5) * Fraction(whole["turn_rate"][1])
    half = {**whole, "duration": "3/5"}
    document["problem"]["path"]["pieces"] = [half, {**half, "turn_rate": [str(end + Fraction(by)), "13/100"]}]
    document["legs"][0]["end"] = 2


def not_affine(document: Document) -> None:
    """The steering is driven by a trillionth of the square of the turning rate too."""
    add_to_rate(document, 3, ("mul", fmpq(1, 10**12), ("mul", OMEGA, OMEGA)))


def follows_acceleration(document: Document) -> None:
    """As a state would that goes with acceleration, and jumps where that does; here it is zero all along."""
    add_to_rate(document, 3, ACCELERATION)


BENT: dict[str, tuple[Callable[[Document], object], str]] = {
    "no bounds of the rate": (plain, "a tube needs dynamics"),
    "rate too low": (rate_bounds("1/10", "1299/10000"), "leaves the bounds"),
    "rate too high": (rate_bounds("1301/10000", "1/5"), "leaves the bounds"),
    "wider than is proven": (rate_bounds("-9", "9"), "margin"),
    "a vertex is missing": (one_vertex_less, "the proof has to cover"),
    "the curve is sharper": (lambda d: pieces_of(d)[0]["turn_rate"].__setitem__(1, "131/1000"), "leaves the bounds"),
    "the turning rate jumps": (lambda d: in_two(d, "1/1000000000"), ": the turning rate jumps"),
    "dynamics that are not affine": (not_affine, "have to be affine in the reference's curvature"),
    "a state that goes with acceleration": (follows_acceleration, "have to enter times u0"),
    "more is claimed": (lambda d: d["funnels"][0].update(margin="4"), "margin 4 1/s claimed"),
}


@pytest.mark.parametrize("name", BENT)
def test_what_is_bent_is_broken(document: Document, name: str) -> None:
    bend, words = BENT[name]
    bend(document)
    report = checked(document)
    assert report.outcome is Outcome.BROKEN, report.message
    assert words in report.message


def test_in_two_pieces_that_meet_it_is_the_same_path(document: Document) -> None:
    in_two(document, "0")
    assert checked(document).outcome is Outcome.PROVEN


@pytest.mark.parametrize("ends", [["1", "0"], ["1"], [0.1, 0.2], "1"])
def test_bounds_that_are_none_are_unreadable(document: Document, ends: Any) -> None:
    stretch(document)["bounds"]["curvature_rate"] = ends
    assert checked(document).outcome is Outcome.UNREADABLE


def test_a_tube_has_no_bounds_of_the_rate(tube_text: str) -> None:
    """Its paths may jump in curvature as they like."""
    document = json.loads(tube_text)
    document["problem"]["path"]["bounds"]["curvature_rate"] = ["0", "0"]
    report = checked(document)
    assert report.outcome is Outcome.UNREADABLE and "curvature_rate" in report.message
    document = json.loads(tube_text)
    stretch(document)["bounds"]["curvature_rate"] = ["0", "0"]
    assert checked(document).outcome is Outcome.BROKEN


# --- what the argument needs of the dynamics


def test_dynamics_that_are_affine_in_the_reference_are_taken() -> None:
    for vehicle in (KinematicBicycle(), Unicycle(), SteeredCar(), Cart()):
        require_affine_reference(of(vehicle))
    assert has_tube_structure(of(Unicycle()))
    assert not has_tube_structure(of(SteeredCar())) and not has_tube_structure(of(Cart()))
    over = ("inv", SPEED)
    for more in (
        ("mul", OMEGA, over),  # the curvature
        ("mul", OMEGA, ("mul", W, ("sin", "a"))),
        ("mul", ("mul", OMEGA, SPEED), ("inv", ("mul", -3, SPEED))),
    ):
        require_affine_reference(dynamics(("add", FIRST, more), SECOND))
    # ω'/v − ω a/v² is the curvature's rate, however it is written
    rate = ("sub", ("mul", SLOPE, over), ("mul", ("mul", OMEGA, ACCELERATION), ("inv", ("mul", SPEED, SPEED))))
    require_affine_reference(dynamics(("add", FIRST, rate), SECOND))


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("mul", OMEGA, OMEGA), "affine"),
        (("mul", TURNING, OMEGA), "affine"),
        (("mul", SPEED, SPEED), "affine"),
        (("mul", OMEGA, SPEED), "affine"),  # κ v²
        (("inv", SPEED), "affine"),
        (("mul", SLOPE, ("mul", U0, SPEED)), "affine"),
        (("mul", SLOPE, SLOPE), "affine"),
        (("mul", ("mul", SLOPE, ("inv", SPEED)), "a"), "affine"),  # κ' + κ a/v
        (("mul", ACCELERATION, ACCELERATION), "affine"),
        (("sin", OMEGA), "apply sin to states alone"),
        (("sin", ("add", "a", ("inv", SPEED))), "apply sin to states alone"),
        (("inv", ("add", SPEED, "a")), "apply inv to states alone"),
        (("inv", ("inv", SPEED)), "apply inv to states alone"),
        (("inv", ("mul", SPEED, OMEGA)), "apply inv to states alone"),
    ],
)
def test_others_are_refused(more: Any, words: str) -> None:
    for rates in ((("add", FIRST, more), SECOND), (FIRST, ("add", SECOND, more))):
        with pytest.raises(Broken, match=words):
            require_affine_reference(dynamics(*rates))


def of(vehicle: Vehicle) -> Any:
    return symbolic(trace_deviation(vehicle), vehicle.state_names, ("u0", *vehicle.input_names))


def test_an_angle_that_changes_by_a_square_root_is_none() -> None:
    with pytest.raises(Broken, match="apply sqrt to states alone"):
        require_affine_reference(of(SeenAhead()))


# --- bounds, vertices, joints


def test_the_rate_of_the_curvature_is_looked_at_exactly() -> None:
    """κ = ω/v with ω = 1 + t, v = 2 + t/2: κ' = (v − ω/2)/v² = 3/2 / (2 + t/2)², falling."""
    own = piece((1, 1), (2, fmpq(1, 2)))
    lowest, highest = fmpq(3, 2) / fmpq(25, 4), fmpq(3, 8)
    wide = Bounds((fmpq(0), fmpq(1)), (fmpq(2), fmpq(5, 2)), (fmpq(1, 2), fmpq(1, 2)))
    hair = fmpq(1, 10**30)

    def inside(low: fmpq, high: fmpq) -> bool:
        return own.inside(Bounds(wide.curvature, wide.speed, wide.acceleration, (low, high)))

    assert own.inside(wide) and inside(lowest, highest)
    assert not inside(lowest + hair, highest) and not inside(lowest, highest - hair)


def test_learner_and_checker_look_at_the_same_vertices() -> None:
    bounds = ((0.25, 0.5), (1.0, 1.5), (-0.25, 0.5), (-1.0, 2.0))
    exact = Bounds(*((rational(low), rational(high)) for low, high in bounds))
    curvature, speed, acceleration, rate = (Interval(*ends) for ends in bounds)
    given = Span(0.0, 1.2, Tube(curvature, speed, acceleration), rate)
    (segment,) = BEND.path.curve
    found = instance_of(BEND, segment, template_named("contracting"), 0.9, stretches=[given])
    members = np.stack([np.asarray(field)[0, 0] for field in found.references], axis=-1)
    fields = ("turn_rate", "speed", "turn_rate_slope", "speed_slope")
    wanted = [[float(extreme.profile[name]) for name in fields] for extreme in exact.extremes()]
    middle = [float(exact.extremes()[0].nominal[name]) for name in fields]
    np.testing.assert_allclose(members, [*wanted, middle], rtol=1e-15)
    np.testing.assert_allclose([float(np.asarray(field)[0, 0]) for field in found.nominal], middle, rtol=1e-15)


@pytest.mark.parametrize("path", [ellipse(), ellipse(segments=4), figure_eight()], ids=lambda path: path.name)
def test_a_turning_rate_that_is_continuous_but_for_rounding_is_so_exactly(path: Path) -> None:
    def jumps(pieces: tuple[Piece, ...]) -> list[bool]:
        return [jumps_in_turning(*pair) for pair in itertools.pairwise(pieces)]

    pieces = exact_course(path).pieces
    assert not any(jumps(pieces))
    stated = [float(c) for segment in path.curve for own in segment.turn_rate.coefficients for c in own]
    np.testing.assert_allclose([float(c) for own in pieces for c in own.turn_rate], stated, atol=1e-9)


def test_a_jump_that_is_meant_stays_one() -> None:
    breaks = (0.0, 1.0, 2.0)
    kink = Segment(Profile(breaks, ((0.0,), (0.3,))), Profile(breaks, ((1.0,), (1.0,))), Pose(0.0, 0.0, 0.0))
    first, second = exact_course(Path("kink", (kink,))).pieces
    assert (first.turn_rate, second.turn_rate) == ((fmpq(0),), (fmpq(3, 10),))
