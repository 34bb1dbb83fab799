"""A law that is part of the question: what is proven of it, and that nothing false is."""

import copy
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from flint import fmpq, fmpq_mpoly_ctx

from cfcheck import Outcome, check_document
from cfcheck.claims.document import document_hash
from cfcheck.exact.enclosure import Domain, Enclosure, UnaryEnclosure
from cfcheck.exact.quotient import Quotient, applied
from cfcheck.exact.rational import rational
from cfcheck.kernel.law import HIGH, INSIDE, LOW, REGIMES, Limited
from cfjax.certificate import certify, dump, refute
from cfjax.falsifier import WorstPoint, falsify
from cfjax.funnel import Funnel, Leg, template_named
from cfjax.problem import FeedbackLaw, LinearLaw, Problem, ReferencePoint, Vehicle, straight
from cfjax.simulation import drive_cars
from experiments.vehicles.cruiser import Cruiser


GAIN = ((-1.764, 1.333, 0.0),)
SHAPE = np.array([[4.728, -4.557, -0.004697], [-4.557, 7.857, 0.001133], [-0.004697, 0.001133, 11.04]])
RATE = 0.6732627
Change = Callable[[dict[str, Any]], object]


@dataclass(frozen=True)
class Saturating(FeedbackLaw):
    """One with a quotient, a sine and a cosine."""

    name: ClassVar[str] = "saturating"

    def inputs(self, vehicle: Vehicle, x: Any, reference: ReferencePoint) -> tuple:
        alpha, lateral, _ = x
        return ((1.4 * lateral * jnp.cos(alpha) - 1.8 * jnp.sin(alpha)) / (1 + 0.2 * lateral * jnp.sin(alpha)),)


def problem_with(law: FeedbackLaw | None) -> Problem:
    return Problem(straight(3.0, 1.0), vehicle=Cruiser(1.0, 0.5, 0.4), inlet=0.3, goal=0.3, law=law)


def candidate() -> Funnel:
    return Funnel(template_named("contracting"), SHAPE, RATE, 3.0)


@pytest.fixture(scope="module")
def linear() -> dict[str, Any]:
    """The certificate of a linear law."""
    found = certify(problem_with(LinearLaw(GAIN)), [candidate()])
    assert found.document is not None, found.message
    return json.loads(dump(found.document))


@pytest.fixture(scope="module")
def quotient() -> dict[str, Any]:
    found = certify(problem_with(Saturating()), [candidate()])
    assert found.document is not None, found.message
    return json.loads(dump(found.document))


def by_hand(document: dict[str, Any], law: Callable[[np.ndarray], np.ndarray], count: int = 40_000) -> float:
    """The least margin (1/s) that is seen in random points of the shell, by the vehicle's equations written anew."""
    (funnel,) = document["funnels"]
    entries = iter(map(rational, funnel["shape"]))
    shape = np.zeros((3, 3))
    for i in range(3):
        for j in range(i + 1):
            shape[i, j] = shape[j, i] = float_of(next(entries))
    rate, begin = (float_of(rational(funnel[name])) for name in ("rate", "beta_lower"))
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(count, 3)) @ np.linalg.inv(np.linalg.cholesky(shape))
    direction /= np.sqrt(np.einsum("ki,ij,kj->k", direction, shape, direction))[:, None]
    theta, level = rng.uniform(0, 3, count), rng.uniform(begin, 1, count)
    form = level * np.exp(-rate * theta)
    x = direction * np.sqrt(form)[:, None]
    w = np.clip(law(x), -0.4, 0.4)
    assert {-0.4, 0.4} < set(w)  # all three regimes are met
    alpha = x[:, 0]
    rates = []
    for u0 in (0.5, 2.0):
        f = np.stack([2 * w, -np.sin(alpha), np.cos(alpha) - u0], axis=1)
        form_rate = 2 * np.einsum("ki,ij,kj->k", x, shape, f)
        rates.append(np.exp(rate * theta) * (form_rate + rate * u0 * form))
    return float(-np.minimum(*rates).max())


def margin_of(document: dict[str, Any]) -> float:
    return float_of(rational(document["funnels"][0]["margin"]))


def test_v_falls_under_a_linear_law_as_proven(linear: dict[str, Any]) -> None:
    proven = margin_of(linear)
    seen = by_hand(linear, lambda x: x @ np.array(GAIN[0]))
    assert 0.9 < proven <= seen < 1.2 * proven


def test_v_falls_under_a_law_with_quotients_as_proven(quotient: dict[str, Any]) -> None:
    def law(x: np.ndarray) -> np.ndarray:
        alpha, lateral, _ = x.T
        return (1.4 * lateral * np.cos(alpha) - 1.8 * np.sin(alpha)) / (1 + 0.2 * lateral * np.sin(alpha))

    proven = margin_of(quotient)
    assert 0.5 < proven <= by_hand(quotient, law) < 1.3 * proven


def test_the_report_names_the_law(linear: dict[str, Any]) -> None:
    message = check_document(linear).message
    assert (
        'w in [-0.4, 0.4], all but u0 as the law "linear", a graph in the file, has them, or the nearer limit'
        in message
    )


def test_cars_under_the_law_stay_in_the_funnel(linear: dict[str, Any]) -> None:
    legs = [Leg(3.0, candidate(), margin_of(linear))]
    loop, cars = drive_cars(problem_with(LinearLaw(GAIN)), legs, cars=200)
    assert (loop.left_funnel, loop.missed_goal) == (0, 0)
    np.testing.assert_allclose(cars.inputs[..., 1], np.clip(cars.x @ np.array(GAIN[0]), -0.4, 0.4), atol=1e-12)


# --- spoiled files


def spoiled(document: dict[str, Any], change: Change) -> tuple[Outcome, str]:
    copied = copy.deepcopy(document)
    change(copied)
    copied["hash"] = document_hash(copied)
    report = check_document(copied)
    return report.outcome, report.message


def law_of(document: dict[str, Any]) -> dict[str, Any]:
    return document["problem"]["law"]


def cells_of(document: dict[str, Any]) -> list[dict[str, Any]]:
    return document["hints"]["decrease"][0]["stretches"][0]["cells"]


def another_gain(factor: str) -> Change:
    def change(document: dict[str, Any]) -> None:
        node = next(node for node in law_of(document)["nodes"] if node[0] == "constant" and node[1].startswith("-"))
        node[1] = str(rational(node[1]) * rational(factor))

    return change


def reading(name: str) -> Change:
    return lambda document: law_of(document)["nodes"][0].__setitem__(1, name)


def with_model(document: dict[str, Any]) -> None:
    problem, (funnel,) = document["problem"], document["funnels"]
    own = {"vehicle": problem["vehicle"], "inputs": problem["inputs"]}
    funnel["model"] = own | {"length": "1", "speed": "1"}
    funnel["margin_per_metre"] = "1"


def cell_with(document: dict[str, Any], regime: int) -> dict[str, Any]:
    return next(cell for cell in cells_of(document) if cell["signs"][1] == regime)


def without_law(document: dict[str, Any]) -> None:
    del document["problem"]["law"], document["hints"]["decrease"][0]["law_degree"]


def moved(document: dict[str, Any]) -> None:
    """What is proven at the upper limit, said of the lower one, and the other way round."""
    for cell in cells_of(document):
        if cell["signs"][1]:
            cell["signs"][1] *= -1


SPOILED: dict[str, tuple[Change, Outcome, str]] = {
    "another gain": (another_gain("9/10"), Outcome.BROKEN, "condition (d)"),
    "the gain's sign": (another_gain("-1"), Outcome.BROKEN, "condition (d)"),
    "no law": (without_law, Outcome.BROKEN, "the proof has to cover 8 cells"),
    "no cell inside": (lambda d: cells_of(d).remove(cell_with(d, INSIDE)), Outcome.BROKEN, "is missing"),
    "no cell at the upper limit": (lambda d: cells_of(d).remove(cell_with(d, HIGH)), Outcome.BROKEN, "is missing"),
    "limits exchanged": (moved, Outcome.BROKEN, "condition (d)"),
    "a wider limit": (lambda d: d["problem"]["inputs"][1].update(upper="1/2"), Outcome.BROKEN, "condition (d)"),
    "one Gram matrix less": (lambda d: cell_with(d, INSIDE)["grams"].pop(), Outcome.UNREADABLE, "grams"),
    "more remainder": (
        lambda d: cell_with(d, LOW).update(remainder=["0", "0"]),
        Outcome.BROKEN,
        "leave over is more than is stated",
    ),
    "a law that reads inputs": (reading("input:w"), Outcome.UNREADABLE, "a law reads states and the reference"),
    "a law that reads u0": (reading("input:u0"), Outcome.UNREADABLE, "a law reads states and the reference"),
    "a law that reads a slope": (reading("reference:turn_rate_slope"), Outcome.UNREADABLE, "a law reads states"),
    "two outputs": (lambda d: law_of(d)["outputs"].append(0), Outcome.UNREADABLE, "outputs"),
    "no degree": (lambda d: d["hints"]["decrease"][0].pop("law_degree"), Outcome.BROKEN, "go together"),
    "a degree of none": (lambda d: d["hints"]["decrease"][0].update(law_degree=0), Outcome.UNREADABLE, "law_degree"),
    "a field more": (lambda d: law_of(d).update(limits=[]), Outcome.UNREADABLE, "limits"),
    "a model": (with_model, Outcome.UNREADABLE, "no model where a law is part of the problem"),
}


@pytest.mark.parametrize("name", SPOILED)
def test_a_spoiled_file_is_refused(linear: dict[str, Any], name: str) -> None:
    change, outcome, message = SPOILED[name]
    assert check_document(linear).outcome is Outcome.PROVEN
    found = spoiled(linear, change)
    assert found[0] is outcome and message in found[1], found


def test_an_enclosure_of_the_law_is_proven(quotient: dict[str, Any]) -> None:
    def change(document: dict[str, Any]) -> None:
        functions = document["hints"]["decrease"][0]["stretches"][0]["enclosures"]
        node = len(document["problem"]["vehicle"]["dynamics"]["nodes"])
        own = [entry for entry in functions if entry["node"] >= node]
        assert {entry["function"] for entry in own} == {"sin", "cos", "inv"}
        own[0]["bound"] = str(rational(own[0]["bound"]) / 2)

    outcome, message = spoiled(quotient, change)
    assert outcome is Outcome.BROKEN and "is larger than its enclosure claims" in message


def test_a_law_is_proven_at_every_extreme_reference(linear: dict[str, Any]) -> None:
    def change(document: dict[str, Any]) -> None:
        document["hints"]["decrease"][0]["stretches"][0]["bounds"]["curvature"] = ["-1/1000", "1/1000"]

    outcome, message = spoiled(linear, change)
    assert outcome is Outcome.BROKEN and "the proof has to cover 24 cells" in message

    def with_a_rate(document: dict[str, Any]) -> None:
        change(document)
        document["hints"]["decrease"][0]["stretches"][0]["bounds"]["curvature_rate"] = ["-1", "1"]

    outcome, message = spoiled(linear, with_a_rate)
    assert outcome is Outcome.BROKEN and "here the curvature's rate is bounded too" in message


# --- refuted candidates


def test_a_law_is_refuted_where_the_box_is_not() -> None:
    weak = problem_with(LinearLaw(((-0.2, 0.1, 0.0),)))
    found = refute(weak, candidate(), 0.5)
    assert found.document is not None, found.message
    assert "condition (d) fails: under the law no u0 decreases V as fast as claimed" in found.message
    assert found.document["witness"]["condition"] == "d"
    without = {**found.document, "problem": {k: v for k, v in found.document["problem"].items() if k != "law"}}
    assert spoiled(without, lambda _: None)[0] is Outcome.BROKEN  # some other input does it


def test_a_good_law_is_not_refuted(linear: dict[str, Any]) -> None:
    points = falsify(problem_with(LinearLaw(GAIN)), straight(3.0, 1.0).segments[0], candidate(), rounds=1)
    worst = [WorstPoint("d", 0.0, point.theta, point.x) for point in points if point.condition == "d"]
    assert refute(problem_with(LinearLaw(GAIN)), candidate(), margin_of(linear), worst).document is None


# --- the falsifier


def test_the_falsifier_looks_at_the_law() -> None:
    def margin(law: FeedbackLaw | None) -> float:
        found = falsify(problem_with(law), straight(3.0, 1.0).segments[0], candidate(), rounds=2)
        return next(point.slack for point in found if point.condition == "d")

    own, best, weak = margin(LinearLaw(GAIN)), margin(None), margin(LinearLaw(((-0.2, 0.1, 0.0),)))
    assert weak < 0 < own < best


# --- what a law is on its cells


RING = fmpq_mpoly_ctx.get(["y0", "y1"], "degrevlex")


def quotient_law(remainder: tuple[int, int, int]) -> tuple[Quotient, Callable[..., Any]]:
    """N/D of N = y0 + y0 y1²/2, D = (2 + y1 + y0³/4)/4 with remainders on the unit ball; what both may be."""
    y0, y1 = RING.gens()
    domain = Domain(RING, fmpq(1))
    constant, linear, square = (fmpq(each, 1000) for each in remainder)
    above = Enclosure(domain, y0 + y0 * y1 * y1 * fmpq(1, 2), (constant, linear, square))
    below = Enclosure(domain, (2 + y1 + y0**3 * fmpq(1, 4)) * fmpq(1, 4), (fmpq(1, 40), fmpq(0), fmpq(0)))
    unary = UnaryEnclosure("inv", (fmpq(4),), fmpq(1, 8), fmpq(1), fmpq(5))
    one_over = applied(0, "inv", Quotient(below), lambda *_: unary)

    def value(a: float, b: float, share: float, other: float) -> tuple[float, float]:
        size = math.hypot(a, b)
        error = share * sum(e * size**k / 1000 for k, e in enumerate(remainder))
        return a + a * b * b / 2 + error, (2 + b + a**3 / 4) / 4 + other / 40

    return Quotient(above) * one_over, value


@pytest.mark.parametrize("degree", [None, 1, 2])
@pytest.mark.parametrize("remainder", [(0, 0, 0), (20, 10, 5)])
def test_statements_of_the_cells_cover_the_law(degree: int | None, remainder: tuple[int, int, int]) -> None:
    """Where boundaries say that a cell is, the limited law is what the cell says of it: for every N and D enclosed."""
    k, true = quotient_law(remainder)
    limited = Limited(k, fmpq(-4, 5), fmpq(3, 5), degree)
    rng, met, closest = np.random.default_rng(3), dict.fromkeys(REGIMES, 0), math.inf
    for _ in range(4000):
        a, b = rng.uniform(-1, 1, 2) * math.sqrt(0.5)
        above, below = true(a, b, *rng.choice([-1.0, 0.3, 1.0], 2))
        u, covered = min(max(above / below, -0.8), 0.6), False
        for regime in REGIMES:
            if min(value_at(side, a, b) for side in limited.constraints(regime)) < 0:
                continue
            covered, met[regime] = True, met[regime] + 1
            found = limited.value(regime)
            enclosed = found.numerator
            size, own = math.hypot(a, b), u * below if found.powers else u
            spread = sum(float_of(e) * size**power for power, e in enumerate(enclosed.remainder))
            distance = abs(own - value_at(enclosed.polynomial, a, b))
            assert distance <= spread + 1e-12
            closest = min(closest, spread - distance)
        assert covered  # by one cell at least
    assert min(met.values()) > 50
    assert closest < 0.03  # they say no more than they have to


def value_at(polynomial: Any, a: float, b: float) -> float:
    return sum(float_of(fmpq(c)) * a ** int(e[0]) * b ** int(e[1]) for e, c in polynomial.to_dict().items())


def float_of(value: fmpq) -> float:
    return int(value.p) / int(value.q)
