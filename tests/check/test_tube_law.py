"""A law along every path within bounds: what is proven is true between the extreme references, and only where it is."""

import copy
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from cfcheck import Outcome, check_document
from cfcheck.claims.document import document_hash
from cfjax import Options
from cfjax.certificate import certify, dump
from cfjax.errors import InputError
from cfjax.funnel import Funnel, template_named
from cfjax.problem import FeedbackLaw, LinearLaw, Problem, PurePursuitLaw, ReferencePoint, StanleyLaw, Vehicle, tube
from cfjax.question import check_question
from cfjax.simulation import drive_tube_cars
from experiments.vehicles.cruiser import Cruiser


GAIN = np.array([-1.764, 1.333, 0.0])
SHAPE = np.array([[5.182, -4.836, 0.0], [-4.836, 7.16, 0.0], [0.0, 0.0, 10.98]])  # of a run of this question, rounded
SHARPEST = 0.05  # 1/m


@dataclass(frozen=True)
class Ahead(FeedbackLaw):
    """One that steers as the path turns, and adds to it what the deviation asks for."""

    name: ClassVar[str] = "ahead"

    def inputs(self, vehicle: Vehicle, x: Any, reference: ReferencePoint) -> tuple:
        return (0.5 * reference.turn_rate + sum(k * each for k, each in zip(GAIN, x, strict=True)),)


def problem_with(law: FeedbackLaw) -> Problem:
    return Problem(tube(SHARPEST, 1.0), vehicle=Cruiser(1.0, 0.5, 0.4), inlet=0.3, goal=0.9, law=law)


def candidate() -> Funnel:
    return Funnel(template_named("contracting"), SHAPE, 0.0, np.inf)


@pytest.fixture(scope="module")
def proven() -> dict[str, Any]:
    found = certify(problem_with(LinearLaw(GAIN[None])), [candidate()])
    assert found.document is not None, found.message
    return json.loads(dump(found.document))


def margin_of(document: dict[str, Any]) -> float:
    numerator, _, denominator = document["funnels"][0]["margin"].partition("/")
    return int(numerator) / int(denominator or 1)


def test_v_falls_at_every_curvature_within_bounds(proven: dict[str, Any]) -> None:
    """By the car's equations, written anew: at random deviations of the shell some u0 does for all curvatures."""
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(40_000, 3))
    direction /= np.sqrt(np.einsum("ki,ij,kj->k", direction, SHAPE, direction))[:, None]
    x = direction * np.sqrt(rng.uniform(0.9, 1, 40_000))[:, None]
    w = np.clip(x @ GAIN, -0.4, 0.4)
    assert {-0.4, 0.4} < set(w)  # all three regimes are met
    curvatures = np.linspace(-SHARPEST, SHARPEST, 11)
    rates = np.array([[_falls(x, w, u0, kappa) for kappa in curvatures] for u0 in (0.5, 2.0)])
    seen = float(-rates.max(axis=1).min(axis=0).max())
    assert 1.0 < margin_of(proven) <= seen < 1.2 * margin_of(proven)


def _falls(x: np.ndarray, w: np.ndarray, u0: float, kappa: float) -> np.ndarray:
    alpha, lateral, ahead = x.T
    f = np.stack([2 * w - u0 * kappa, -np.sin(alpha) + u0 * kappa * ahead, np.cos(alpha) - u0 * (1 + kappa * lateral)])
    return 2 * np.einsum("ki,ij,jk->k", x, SHAPE, f)


def test_cars_under_the_law_stay_in_the_tube(proven: dict[str, Any]) -> None:
    margin = margin_of(proven)
    loop, cars = drive_tube_cars(problem_with(LinearLaw(GAIN[None])), candidate(), margin, margin, cars=150, way=3.0)
    assert (loop.left_funnel, loop.missed_goal) == (0, 0)
    np.testing.assert_allclose(cars.inputs[..., 1], np.clip(cars.x @ GAIN, -0.4, 0.4), atol=1e-12)


# --- spoiled files


Change = Callable[[dict[str, Any]], object]


def spoiled(document: dict[str, Any], change: Change) -> tuple[Outcome, str]:
    copied = copy.deepcopy(document)
    change(copied)
    copied["hash"] = document_hash(copied)
    report = check_document(copied)
    return report.outcome, report.message


def hints_of(document: dict[str, Any]) -> dict[str, Any]:
    return document["hints"]["decrease"][0]


def reading(name: str) -> Change:
    """The law reads this in place of the lateral deviation."""

    def change(document: dict[str, Any]) -> None:
        nodes = document["problem"]["law"]["nodes"]
        next(node for node in nodes if node[:2] == ["input", "x"])[1] = f"reference:{name}"

    return change


def wider(name: str, ends: list[str]) -> Change:
    return lambda document: hints_of(document)["stretches"][0]["bounds"].update({name: ends})


def one_end(document: dict[str, Any]) -> None:
    """The upper end of the curvature alone, as where one is the mirror image of the other."""
    stretch = hints_of(document)["stretches"][0]
    stretch["cells"] = [cell for cell in stretch["cells"] if cell["reference"] == 1]
    for cell in stretch["cells"]:
        cell["reference"] = 0


def both(*changes: Change) -> Change:
    return lambda document: [change(document) for change in changes]


def test_a_law_that_reads_the_curvature_is_refused(proven: dict[str, Any]) -> None:
    assert check_document(proven).outcome is Outcome.PROVEN
    outcome, message = spoiled(proven, reading("turn_rate"))
    assert outcome is Outcome.BROKEN and "law: it is proven where it is the same at every reference" in message
    assert "it reads turn_rate" in message


def test_a_law_that_reads_the_speed_is_refused_where_that_changes(proven: dict[str, Any]) -> None:
    outcome, message = spoiled(proven, both(reading("speed"), wider("speed", ["1", "11/10"])))
    assert outcome is Outcome.BROKEN and "it reads speed, which changes" in message
    outcome, message = spoiled(proven, reading("speed"))  # it is 1 everywhere: another law, but one
    assert outcome is Outcome.BROKEN and "it reads" not in message
    outcome, message = spoiled(proven, both(reading("speed_slope"), wider("acceleration", ["0", "1/10"])))
    assert outcome is Outcome.BROKEN and "it reads speed_slope" in message


@pytest.mark.parametrize("mirror", [None, [-1, -1, 1, 1, -1]])
def test_no_mirror_image_speaks_for_the_other_end(proven: dict[str, Any], mirror: list[int] | None) -> None:
    """The law need not be its own mirror image, so both ends of the curvature have to be there."""
    outcome, message = spoiled(proven, both(one_end, lambda document: hints_of(document).update(mirror=mirror)))
    assert outcome is Outcome.BROKEN and "the proof has to cover" in message


# --- what may be asked


def ask(law: FeedbackLaw, speed: Any = 1.0) -> None:
    vehicle = {} if speed != 1.0 else {"vehicle": Cruiser(1.0, 0.5, 0.4)}
    check_question(Problem(tube(SHARPEST, speed), inlet=0.3, goal=0.9, law=law, **vehicle), Options())


@pytest.mark.parametrize("law", [LinearLaw(GAIN[None]), StanleyLaw(), PurePursuitLaw()])
def test_laws_that_know_no_curvature_may_be_asked_for_in_a_tube(law: FeedbackLaw) -> None:
    ask(law)


def test_others_are_refused_before_anything_is_learned() -> None:
    with pytest.raises(InputError, match="law=ahead: expected one that does not read the curvature"):
        ask(Ahead())
    with pytest.raises(InputError, match="law=stanley: expected one that does not read the speed"):
        ask(StanleyLaw(), (1.0, 2.0))
    ask(LinearLaw(), (1.0, 2.0))
