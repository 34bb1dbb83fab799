"""Tubes: a proof at the extreme references is held against the truth, and against whoever stretches it."""

import json
import math
import re
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from flint import fmpq

from cfcheck import Outcome, check_document
from cfcheck.claims.document import document_hash
from cfcheck.claims.proof import Question
from cfcheck.exact.graph import Graph
from cfcheck.exact.rational import Matrix
from cfcheck.exact.symbolic import Symbolic
from cfcheck.kernel.funnel import Model
from cfcheck.path.bounds import Bounds
from cfcheck.reader import Broken
from cfcheck.vehicle.model import VehicleClaim
from cfcheck.vehicle.structure import is_mirror, require_tube_structure
from cfjax.certificate import certify, dump, refute
from cfjax.certificate.mirror import mirrored as sought
from cfjax.funnel import TEMPLATES, Funnel
from cfjax.problem import Interval, KinematicBicycle, Method, Problem, ReferencePoint, affine_deviation, ball, tube
from tests import by_hand
from tests.check.graphs import ACCELERATION, FIRST, OMEGA, SECOND, SLOPE, SPEED, TURNING, U0, W, dynamics


Document = dict[str, Any]
ODD_EVEN = 6  # place of C's entry between alpha, odd under the mirror, and v, even


# --- a proven tube and its spoiled copies ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def deep_text() -> str:
    """Constant speed, down to β_in = 1/2: two pieces, eight cells."""
    shape = np.array([[23.5, -12, 0, 0], [-12, 36.4, 0, 0], [0, 0, 36.9, 12.5], [0, 0, 12.5, 23.5]])
    problem = Problem(tube(1.5, 1.5), inlet=ball(0.15), goal=ball(0.25), method=Method.TT)
    document = certify(problem, [Funnel(TEMPLATES["paper"], shape, 0.0, math.inf, 0.9, 0.5)], workers=2).document
    assert document is not None
    return dump(document)


def checked(document: Document) -> Any:
    return check_document({**document, "hash": document_hash(document)})


def bounds_of(document: Document) -> Document:
    return document["problem"]["path"]["bounds"]


def stretch(document: Document) -> Document:
    """The one that a tube has."""
    return document["hints"]["decrease"][0]["stretches"][0]


def cells(document: Document) -> list[Document]:
    return stretch(document)["cells"]


def test_a_proven_tube_says_what_it_is_about(tube_text: str, deep_text: str) -> None:
    report = check_document(json.loads(tube_text))
    assert report.outcome is Outcome.PROVEN
    for part in (
        "every path",
        "in [1, 2] m/s",
        "[-1.5, 1.5] 1/m",
        "[-0.5, 0.5] m/s^2",
        "for ever",
        "half-widths (0.22",
    ):
        assert part in report.message
    assert float(report.margins[0]) == pytest.approx(0.904, abs=0.01)
    assert float(report.margin_per_metre) == pytest.approx(0.479, abs=0.01)
    report = check_document(json.loads(deep_text))
    assert report.outcome is Outcome.PROVEN
    per_metre = float(report.margin_per_metre)
    found = re.search(r"inside V <= 0.5 within ([0-9.]+) m", report.message)
    assert found is not None
    way = (0.1 + 0.9 * math.log(0.9 / 0.5)) / per_metre  # ∫ dV / (μ min(1, V/β̲)) from β_in to 1
    assert way <= float(found[1]) <= way * (1 + 1e-4)


def test_mirror_images_are_left_out(tube_text: str, deep_text: str) -> None:
    """Ends of speed and acceleration at the upper end of κ alone, four sign patterns each."""
    assert len(cells(json.loads(tube_text))) == 4 * 4
    assert {cell["piece"] for cell in cells(json.loads(deep_text))} == {0, 1}


@pytest.mark.parametrize("name", ["margin", "margin_per_metre"])
def test_less_is_proven_too(tube_text: str, name: str) -> None:
    document = json.loads(tube_text)
    document["funnels"][0][name] = str(Fraction(document["funnels"][0][name]) * Fraction(2, 3))
    assert checked(document).outcome is Outcome.PROVEN


def stretched(name: str, end: int, by: str) -> Callable[[Document], None]:
    def spoil(document: Document) -> None:
        for bounds in (bounds_of(document)[name], stretch(document)["bounds"][name]):
            bounds[end] = str(Fraction(bounds[end]) + Fraction(by))

    spoil.__name__ = f"{name}[{end}] by {by}"
    return spoil


def raised(name: str, factor: Fraction) -> Callable[[Document], None]:
    def spoil(document: Document) -> None:
        funnel = document["funnels"][0]
        funnel[name] = str(Fraction(funnel[name]) * factor)

    spoil.__name__ = f"{name} times {factor}"
    return spoil


def wider_curvature(document: Document) -> None:
    for bounds in (bounds_of(document), stretch(document)["bounds"]):
        bounds["curvature"] = ["-151/100", "151/100"]


def wider_paths_than_the_proof_is_for(document: Document) -> None:
    bounds_of(document)["curvature"][1] = f"{15 * 10**11 + 1}/{10**12}"


def proof_with_an_end(document: Document) -> None:
    stretch(document)["end"] = "1"


def mirror_not_stated(document: Document) -> None:
    document["hints"]["decrease"][0]["mirror"] = None


def odd_meets_even(document: Document) -> None:
    document["funnels"][0]["shape"][ODD_EVEN] = f"1/{10**15}"


def asymmetric_steering(document: Document) -> None:
    limits = next(entry for entry in document["problem"]["inputs"] if entry["name"] == "w")
    limits["lower"] = f"-{10**12 - 1}/{10**12}"


def rate_is_not_zero(document: Document) -> None:
    document["funnels"][0]["rate"] = f"1/{10**12}"


def no_margin_per_metre(document: Document) -> None:
    document["funnels"][0]["margin_per_metre"] = None


def margin_per_metre_is_zero(document: Document) -> None:
    document["funnels"][0]["margin_per_metre"] = "0"


def reference_left_out(document: Document) -> None:
    stretch(document)["cells"] = [cell for cell in cells(document) if cell["reference"] != 3]


def references_swapped(document: Document) -> None:
    for cell in cells(document):
        cell["reference"] ^= 1


def accelerations_swapped(document: Document) -> None:
    for cell in cells(document):
        cell["reference"] ^= 2


def one_proof_for_two_references(document: Document) -> None:
    first = [cell for cell in cells(document) if cell["reference"] == 0]
    others = [cell for cell in cells(document) if cell["reference"] > 1]
    stretch(document)["cells"] = first + [{**cell, "reference": 1} for cell in first] + others


def member_with_other_signs(document: Document) -> None:
    for cell in cells(document):
        if cell["reference"] == 1:
            cell["signs"] = [-sign for sign in cell["signs"]]


def other_speeds(document: Document) -> None:
    for bounds in (bounds_of(document), stretch(document)["bounds"]):
        bounds["speed"] = ["1/2", "1"]


def more_inputs_are_free(document: Document) -> None:
    document["problem"]["inputs"][0] |= {"lower": "1/2", "upper": "2"}
    document["problem"]["method"] = "pf"


SPOILS = [
    wider_curvature,
    wider_paths_than_the_proof_is_for,
    proof_with_an_end,
    mirror_not_stated,
    stretched("curvature", 0, f"-1/{10**12}"),
    stretched("curvature", 1, f"1/{10**12}"),
    stretched("curvature", 0, "1/2"),  # smaller, but no mirror image of itself: the proof is of one end only
    stretched("speed", 0, "-1/100"),
    stretched("speed", 1, "1/100"),
    stretched("acceleration", 0, "-1/100"),
    stretched("acceleration", 1, "1/100"),
    odd_meets_even,
    asymmetric_steering,
    rate_is_not_zero,
    raised("margin", 1 + Fraction(1, 10**4)),
    raised("margin_per_metre", 1 + Fraction(1, 10**4)),
    raised("margin", Fraction(-1)),
    raised("beta_inner", 1 - Fraction(1, 10**9)),
    no_margin_per_metre,
    margin_per_metre_is_zero,
    reference_left_out,
    references_swapped,
    accelerations_swapped,
    one_proof_for_two_references,
    member_with_other_signs,
    other_speeds,
    more_inputs_are_free,
]


def test_fewer_paths_have_the_same_proof(tube_text: str) -> None:
    document = json.loads(tube_text)
    bounds_of(document).update(curvature=["0", "1"], speed=["3/2", "3/2"])
    assert checked(document).outcome is Outcome.PROVEN


def test_a_tube_may_go_without_a_goal(tube_text: str) -> None:
    """What is said then is another statement, in another file."""
    document = json.loads(tube_text)
    with_goal = check_document(json.loads(tube_text))
    document["problem"]["sets"]["goal"] = None
    assert check_document(document).message == "hash: the content has changed since the hash was taken"
    report = checked(document)
    assert (report.outcome, report.margins) == (Outcome.PROVEN, with_goal.margins)
    assert "inside G" in with_goal.message
    assert "no G is asked;" in report.message
    assert "inside G" not in report.message
    assert "G with" not in report.message


@pytest.mark.parametrize("goal", [{}, [], False, 0, "null", {"half_axes": None}, {"half_axes": []}], ids=str)
def test_nothing_else_is_no_goal(tube_text: str, goal: object) -> None:
    document = json.loads(tube_text)
    document["problem"]["sets"]["goal"] = goal
    report = checked(document)
    assert report.outcome is Outcome.UNREADABLE
    assert "problem.sets.goal" in report.message


def test_where_no_sets_are_asked_the_funnel_is_what_is_said(paper_text: str, lap_text: str, tube_text: str) -> None:
    for text in (paper_text, lap_text, tube_text):
        document = json.loads(text)
        document["problem"]["sets"]["goal"] = document["problem"]["sets"]["inlet"] = None
        report = checked(document)
        assert report.outcome is Outcome.PROVEN
        assert "no I is asked; no G is asked" in report.message and "from every start with V < 1" in report.message
        assert ("until it arrives with V <= 1 after" in report.message) is (text is not tube_text)
        document["problem"]["sets"]["safe"] = {"half_axes": ["1"] * 4}
        assert checked(document).outcome is Outcome.UNREADABLE


def test_where_no_goal_is_asked_none_is_missed(tube_text: str) -> None:
    """A witness against (b) that is one with G is none without it."""
    document = json.loads(tube_text)
    document["claim"] = "refutation"
    del document["hints"]
    document["witness"] = {"condition": "b", "leg": 0, "theta": "0", "reference": 0, "x": ["0", "1/8", "0", "0"]}
    document["problem"]["sets"]["goal"] = {"half_axes": ["1/10"] * 4}
    assert checked(document).outcome is Outcome.REFUTED
    document["problem"]["sets"]["goal"] = None
    report = checked(document)
    assert (report.outcome, report.message) == (
        Outcome.BROKEN,
        "witness: condition (b) is not asked here",
    )


@pytest.mark.parametrize("spoil", SPOILS, ids=lambda spoil: spoil.__name__)
def test_a_stretched_claim_is_broken(tube_text: str, spoil: Callable[[Document], None]) -> None:
    document = json.loads(tube_text)
    spoil(document)
    report = checked(document)
    assert report.outcome is Outcome.BROKEN, report.message
    assert report.message.isprintable()


@pytest.mark.parametrize("name", ["beta_inner", "margin", "margin_per_metre", "beta_lower"])
def test_a_deeper_or_faster_claim_is_broken(deep_text: str, name: str) -> None:
    document = json.loads(deep_text)
    raised(name, Fraction(99, 100) if name.startswith("beta") else Fraction(1001, 1000))(document)
    assert checked(document).outcome is Outcome.BROKEN


def test_what_is_no_tube_is_unreadable(tube_text: str) -> None:
    for name, bounds in (
        ("speed", ["0", "2"]),
        ("speed", ["-1", "2"]),
        ("curvature", ["1", "-1"]),
        ("acceleration", ["1"]),
        ("acceleration", ["-1", "0", "1"]),
    ):
        document = json.loads(tube_text)
        bounds_of(document)[name] = bounds
        assert checked(document).outcome is Outcome.UNREADABLE
    document = json.loads(tube_text)
    document["funnels"][0]["beta_inner"] = "19/20"
    assert checked(document).outcome is Outcome.UNREADABLE


def test_a_segment_has_no_margin_per_metre(paper_text: str) -> None:
    document = json.loads(paper_text)
    document["funnels"][0]["margin_per_metre"] = document["funnels"][0]["margin"]
    assert "margin per metre" in checked(document).message


# --- the truth, in floating point ------------------------------------------------------------------------------------


@pytest.mark.parametrize("which", ["tube_text", "deep_text"])
def test_one_input_serves_every_reference(which: str, request: pytest.FixtureRequest) -> None:
    """V̇ ≤ −max(λ, μ v) min(1, V/β̲) at κ, v, a inside the bounds, by an input that knows x's cell alone."""
    document = json.loads(request.getfixturevalue(which))
    funnel, path = document["funnels"][0], bounds_of(document)
    number = {
        name: float(Fraction(funnel[name])) for name in ("beta_lower", "beta_inner", "margin", "margin_per_metre")
    }
    lower = np.zeros((4, 4))
    lower[np.tril_indices(4)] = [float(Fraction(entry)) for entry in funnel["shape"]]
    shape = lower + np.tril(lower, -1).T
    bounds = {name: [float(Fraction(end)) for end in path[name]] for name in ("curvature", "speed", "acceleration")}
    ends = np.array(
        [[float(Fraction(entry[side])) for side in ("lower", "upper")] for entry in document["problem"]["inputs"]]
    )

    rng = np.random.default_rng(0)
    k = 4000
    directions = rng.normal(size=(k, 4))
    # half of them where an input has nothing to say: V_alpha = 0, V_v = 0
    directions[: k // 4, 0] = directions[k // 4 : k // 2, 3] = 0.0
    gradient_of_direction = directions @ np.linalg.inv(shape)
    q = rng.choice([1.0, number["beta_lower"], number["beta_inner"]], size=k)
    q[k // 2 :] = rng.uniform(number["beta_inner"], 1.0, size=k - k // 2)
    form = np.einsum("ki,ij,kj->k", gradient_of_direction, shape, gradient_of_direction)
    x = gradient_of_direction * np.sqrt(q / form)[:, None]
    gradient = 2 * x @ shape

    def affine(kappa: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """V̇ = drift + columns · u, by the paper's car."""
        alpha, px, py, dv = x.T
        omega, zero, one = kappa * v, np.zeros(k), np.ones(k)
        drift = np.stack([zero, -(dv + v) * np.sin(alpha), (dv + v) * np.cos(alpha), zero], axis=1)
        timing = np.stack([-omega, omega * py, -v - omega * px, -a], axis=1)
        steering = np.stack([(dv + v) / 0.34, zero, zero, zero], axis=1)
        thrust = np.stack([zero, zero, zero, one], axis=1)
        columns = np.stack([(gradient * column).sum(axis=1) for column in (timing, steering, thrust)], axis=1)
        return (gradient * drift).sum(axis=1), columns

    # the ends of κ and a at which V̇ is largest, told from x alone
    turning = gradient[:, 0] * -1 + gradient[:, 1] * x[:, 2] - gradient[:, 2] * x[:, 1]
    kappa_worst = np.where(turning > 0, *reversed(bounds["curvature"]))
    a_worst = np.where(-gradient[:, 3] > 0, *reversed(bounds["acceleration"]))
    _, authority = affine(kappa_worst, np.full(k, bounds["speed"][1]), a_worst)
    inputs = np.where(authority > 0, ends[:, 0], ends[:, 1])

    closest = math.inf
    for trial in range(40):
        kappa, v, a = (
            rng.choice(ends, size=k) if trial < 8 else rng.uniform(*ends, size=k)
            for ends in (bounds["curvature"], bounds["speed"], bounds["acceleration"])
        )
        drift, columns = affine(kappa, v, a)
        value_rate = drift + (columns * inputs).sum(axis=1)
        demand = np.maximum(number["margin"], number["margin_per_metre"] * v) * np.minimum(1, q / number["beta_lower"])
        slack = -value_rate - demand
        assert slack.min() >= -1e-9
        closest = min(closest, slack.min())
    assert closest < 0.2  # and the claim is close to the truth


def test_the_dynamics_of_the_test_are_those_of_the_package() -> None:
    """The columns above, once, against the one definition of the car."""
    vehicle = KinematicBicycle()
    x, omega, v, a = np.array([0.3, -0.2, 0.1, 0.4]), 1.2, 1.5, -0.7
    drift, columns = (np.asarray(part) for part in affine_deviation(vehicle, x, ReferencePoint(omega, v, 0.3, a)))
    assert drift == pytest.approx([0, -1.9 * math.sin(0.3), 1.9 * math.cos(0.3), 0])
    assert columns[:, 0] == pytest.approx([-omega, omega * 0.1, -v + omega * 0.2, -a])
    assert columns[:, 1] == pytest.approx([1.9 / 0.34, 0, 0, 0])
    assert columns[:, 2] == pytest.approx([0, 0, 0, 1])


def test_a_refuted_tube_names_a_reference_inside_its_bounds() -> None:
    third = Interval(-1 / 3, 1 / 3)
    problem = Problem(tube(1.8, Interval(1.0, 4.0), third), inlet=ball(0.15), goal=ball(0.25))
    shape = np.array([[23.5, -12, 0, 0], [-12, 36.4, 0, 0], [0, 0, 36.9, 12.5], [0, 0, 12.5, 23.5]])
    document = refute(problem, Funnel(TEMPLATES["paper"], shape, 0.0, math.inf), margin=3.0).document
    assert document is not None
    bounds_of(document)["curvature"] = [f"-{10**20 // 3}/{10**20 // 5}", f"{10**20 // 3}/{10**20 // 5}"]
    report = checked(document)
    assert report.outcome is Outcome.REFUTED
    assert "curvature in [-1.66667, 1.66667] 1/m" in report.message  # outward: 1.66666…
    assert re.search(r"at curvature about -?1.66667 1/m, speed [14] m/s", report.message)
    document["witness"]["reference"] = 7 if document["witness"]["reference"] != 7 else 0
    assert checked(document).outcome in (Outcome.BROKEN, Outcome.REFUTED)
    bounds_of(document)["speed"] = ["1", "1"]
    document["witness"]["reference"] = 4
    assert "no such reference" in checked(document).message


# --- the structure that the argument needs ---------------------------------------------------------------------------


def test_dynamics_of_the_form_are_taken() -> None:
    require_tube_structure(dynamics(FIRST, SECOND))
    for more in (
        ("mul", TURNING, ("sin", ("cos", ("mul", "a", "b")))),  # g(x) with functions of functions
        ("mul", SPEED, ("mul", U0, ("mul", W, W))),  # affine in the speed, whatever the inputs do
        ("sub", ("mul", OMEGA, OMEGA), ("mul", OMEGA, OMEGA)),  # written, but not there
        ("mul", U0, U0),
        ("inv", ("add", 2, "a")),
    ):
        require_tube_structure(dynamics(("add", FIRST, more), SECOND))


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (("mul", OMEGA, OMEGA), "turning rate"),
        (("mul", ("mul", OMEGA, OMEGA), U0), "turning rate"),
        (OMEGA, "turning rate"),
        (("mul", OMEGA, W), "turning rate"),
        (("mul", TURNING, W), "turning rate"),
        (("mul", TURNING, U0), "turning rate"),
        (("mul", TURNING, SPEED), "turning rate"),
        (("mul", TURNING, ACCELERATION), "turning rate"),
        (("mul", ("mul", TURNING, "b"), ("mul", "a", W)), "turning rate"),
        (("mul", SPEED, SPEED), "speed"),
        (("mul", ("mul", SPEED, "a"), ("mul", SPEED, U0)), "speed"),
        (("sin", SPEED), "of the states alone"),
        (("inv", SPEED), "of the states alone"),
        (("cos", W), "of the states alone"),
        (("mul", TURNING, ("tan", U0)), "of the states alone"),
        (("sin", ("add", "a", ("cos", OMEGA))), "of the states alone"),
        (SLOPE, "jumps"),
        (("mul", SLOPE, "a"), "jumps"),
        (ACCELERATION, "acceleration"),
        (("mul", ACCELERATION, W), "acceleration"),
        (("mul", ("mul", ACCELERATION, U0), SPEED), "acceleration"),
        (("mul", ("mul", ACCELERATION, U0), ACCELERATION), "acceleration"),
        (("mul", ("mul", ACCELERATION, U0), W), "acceleration"),
    ],
)
def test_other_dynamics_are_refused(more: Any, reason: str) -> None:
    for rates in ((("add", FIRST, more), SECOND), (FIRST, ("add", SECOND, more))):
        with pytest.raises(Broken, match=reason):
            require_tube_structure(dynamics(*rates))


BOX = {"u0": (fmpq(1, 2), fmpq(2)), "w": (fmpq(-1), fmpq(1))}
APART: Matrix = [[fmpq(2), fmpq(0)], [fmpq(0), fmpq(3)]]


def mirrored(given: Symbolic, box: Any = BOX, shape: Matrix = APART, curvature: Any = (fmpq(-1), fmpq(1))) -> bool:
    model = Model(VehicleClaim("two", {}, ("a", "b"), Graph((), ())), box)
    question = sought(Question(model, given, by_hand.funnel(shape=shape)))
    return question.is_mirrored(Bounds(curvature, (fmpq(1), fmpq(2)), (fmpq(-1), fmpq(0))))


def test_a_mirror_needs_dynamics_box_shape_and_curvature() -> None:
    assert mirrored(dynamics(FIRST, SECOND))
    tiny = fmpq(1, 10**300)
    assert not mirrored(dynamics(FIRST, SECOND), curvature=(fmpq(-1), 1 + tiny))
    assert not mirrored(dynamics(FIRST, SECOND), curvature=(fmpq(0), fmpq(1)))
    assert not mirrored(dynamics(FIRST, SECOND), box={**BOX, "w": (fmpq(-1), 1 - tiny)})
    assert mirrored(dynamics(FIRST, SECOND), box={**BOX, "u0": (fmpq(1), fmpq(1))})
    assert not mirrored(dynamics(FIRST, SECOND), shape=[[fmpq(2), tiny], [tiny, fmpq(3)]])


@pytest.mark.parametrize(
    "rates",
    [
        (("add", FIRST, 1), SECOND),
        (("add", FIRST, "b"), SECOND),
        (("add", FIRST, ("mul", W, W)), SECOND),
        (("add", FIRST, ("sin", ("add", "a", "b"))), SECOND),  # neither odd nor even
        (("add", FIRST, ("cos", "a")), SECOND),
        (("add", FIRST, ("mul", ACCELERATION, U0)), SECOND),
        (FIRST, ("add", SECOND, "a")),
        (FIRST, ("add", SECOND, TURNING)),
        (FIRST, ("add", SECOND, ("mul", SPEED, W))),
        (FIRST, ("add", SECOND, ("tan", "a"))),
        (FIRST, ("add", SECOND, ("inv", ("add", 2, "a")))),
    ],
)
def test_a_drift_to_one_side_breaks_the_mirror(rates: Any) -> None:
    assert not mirrored(dynamics(*rates))


def test_parity_of_functions() -> None:
    for even in (
        ("cos", "a"),
        ("cos", ("mul", "a", "b")),
        ("inv", ("add", 2, ("mul", "a", "a"))),
        ("cos", ("sin", "a")),
        ("sqrt", ("add", 2, ("mul", "a", "a"))),
    ):
        assert mirrored(dynamics(FIRST, ("add", SECOND, even)))
        assert not mirrored(dynamics(("add", FIRST, even), SECOND))
    for odd in (("sin", "a"), ("tan", ("mul", "a", "b")), ("inv", "a"), ("sin", ("tan", "a"))):
        assert mirrored(dynamics(("add", FIRST, odd), SECOND))
        assert not mirrored(dynamics(FIRST, ("add", SECOND, odd)))
    for neither in (("sqrt", "a"), ("sqrt", ("add", 2, "a"))):
        assert not mirrored(dynamics(FIRST, ("add", SECOND, neither)))
        assert not mirrored(dynamics(("add", FIRST, neither), SECOND))


def test_a_look_at_a_mirror_is_paid_for() -> None:
    """Arguments of functions count, too."""
    even: Any = ("add", ("mul", "a", "a"), ("mul", "b", "b"))
    power = ("add", 1, even)
    for _ in range(4):
        power = ("mul", power, power)  # degree 32: 153 terms
    given = dynamics(FIRST, ("add", SECOND, ("cos", power)))
    before = given.domain.budget.left
    assert is_mirror(given, ("a", "b"), BOX, APART, (-1, 1, 1, -1))
    assert before - given.domain.budget.left >= 153
    assert not is_mirror(given, ("a", "b"), BOX, APART, (-1, 1, -1, -1))  # time does not run backwards
    assert not is_mirror(given, ("a", "b"), BOX, APART, (1, 1, 1, -1))
    assert not is_mirror(given, ("a", "b"), BOX, APART, (0, 1, 1, 0))
