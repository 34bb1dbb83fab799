"""Upper bounds of the margin: proven from the file, never below a margin that is certified, refused when spoiled."""

import copy
import json
from functools import cache

import numpy as np
import pytest
from flint import fmpq

import cfjax
from cfcheck import Outcome, check_document
from cfcheck.margin.dual import Dual, constant
from cfcheck.margin.upper_bound import Leaf, Row, leaf_holds
from cfcheck.margin.upper_bound_file import read_upper_bound
from cfjax.bracket import Bound, upper_bound
from cfjax.bracket.interval import Interval, Lift, unknowns
from cfjax.certificate import dump
from cfjax.errors import InputError


PROBLEM = cfjax.Problem(cfjax.straight(), method="tt")
SHAPE = np.diag([3.0, 3.0, 3.0, 3.0])
SHAPE[0, 1] = SHAPE[1, 0] = -0.8
SHAPE[2, 3] = SHAPE[3, 2] = 0.5


@cache
def found() -> Bound:
    bound = upper_bound(PROBLEM, 0.8)
    assert bound is not None
    return bound


def parsed() -> dict:
    return json.loads(dump(found().document))


def test_the_checker_proves_the_file_and_says_what_it_is() -> None:
    report = check_document(parsed())
    assert report.outcome is Outcome.BOUNDED, report.text
    assert "0.8 1/s or more" in report.message
    assert "couples alpha with x and y with v alone" in report.message


def test_no_bound_is_found_below_a_margin_that_is_certified() -> None:
    assert upper_bound(PROBLEM, 0.05, most_boxes=300) is None  # 0.0646 1/s is certified


@pytest.mark.parametrize(
    "change",
    [
        {"margin": "1/50"},
        {"beta_lower": "1/2"},
        {"tree": {"empty": 0}},
        {"tree": {"terms": [], "conditions": []}},
        {"tree": {"terms": [[0, 0, 0]], "conditions": [[0, 0]]}},
    ],
)
def test_another_claim_is_not_proven_by_it(change: dict) -> None:
    assert check_document(parsed() | change, skip_hash=True).outcome is Outcome.BROKEN


def test_a_problem_that_is_easier_is_not_bounded_by_it() -> None:
    document = parsed()
    document["problem"]["sets"]["inlet"]["half_axes"] = ["1/10"] * 4  # a smaller I leaves more room for C
    assert check_document(document, skip_hash=True).outcome is Outcome.BROKEN


def test_a_place_off_the_circle_is_refused() -> None:
    document = parsed()
    document["places"][0]["direction"] = ["1/2", "1/2"]
    report = check_document(document, skip_hash=True)
    assert report.outcome is Outcome.UNREADABLE and "a point of the unit circle" in report.message


@pytest.mark.parametrize("weights", [[], [[0, 0, 1]]])
def test_every_leaf_counts(weights: list) -> None:
    """A leaf with other weights, deep in the tree, breaks the whole."""
    document = copy.deepcopy(parsed())
    node = document["tree"]
    while "cut" in node:
        node = node["above"] if "cut" in node["above"] else node["below"]
    node.clear()
    node.update({"terms": weights, "conditions": []})
    assert check_document(document, skip_hash=True).outcome is Outcome.BROKEN


def candidate_of(shape: np.ndarray, c0: float) -> list[float]:
    """The unknowns of V = xᵀ C x + c0 θ by its Schur complements."""
    ridge = -np.linalg.solve(shape[np.ix_([0, 3], [0, 3])], shape[np.ix_([0, 3], [1, 2])])
    form = shape[np.ix_([1, 2], [1, 2])] + shape[np.ix_([1, 2], [0, 3])] @ ridge
    roots = np.sqrt(np.diag(form))
    return [c0, *roots, ridge[0, 0] / roots[0], ridge[1, 1] / roots[1]]


def row() -> Row:
    return read_upper_bound(parsed()).row


@pytest.mark.parametrize("c0", [0.05, 0.3])
def test_unknowns_say_whether_a_candidate_satisfies_a_and_b(c0: float) -> None:
    """Against eigenvalues, for random C of the form."""
    rng, question = np.random.default_rng(3), row()
    seen = set()
    for _ in range(400):
        shape = np.diag(rng.uniform(4 * (1 - 2 * c0) - 0.1, 4.1, 4))
        for i, j in ((0, 1), (2, 3)):
            shape[i, j] = shape[j, i] = rng.uniform(-2 * c0, 2 * c0)
        inside = np.linalg.eigvalsh(4 * np.eye(4) - shape)[0] > 0
        inside &= np.linalg.eigvalsh(shape - 4 * (1 - 2 * c0) * np.eye(4))[0] > 0
        unknown = [
            Dual(constant(fmpq(*float(value).as_integer_ratio()), 0).value, ()) for value in candidate_of(shape, c0)
        ]
        conditions = question.conditions(unknown, lambda value: constant(value, 0))
        seen.add(bool(inside))
        if inside:
            assert all(condition.value > 0 for condition in conditions)
    assert seen == {True, False}


def test_a_box_of_one_candidate_is_empty_where_a_condition_fails() -> None:
    """Both forms of what (a) and (b) ask say the same, on either side of the boundary."""
    rng, question = np.random.default_rng(7), row()
    seen = set()
    for _ in range(300):
        low, high = (np.array([float(end[k]) for end in question.root]) for k in (0, 1))
        candidate = [fmpq(round(1024 * value), 1024) for value in rng.uniform(low, high)]
        unknown = [Dual(constant(value, 0).value, ()) for value in candidate]
        conditions = [condition.value for condition in question.conditions(unknown, lambda value: constant(value, 0))]
        box = tuple((value, value) for value in candidate)
        for block in (0, 1):
            holds = all(condition > 0 for condition in conditions[3 * block : 3 * block + 3])
            assert question.is_empty(box, block) is not holds
            seen.add(holds)
    assert seen == {True, False}


def test_the_rate_at_a_place_is_that_of_the_dynamics() -> None:
    """V̇ by the unknowns, against ∇V · f at the deviation itself, with any steering and thrust."""
    bound = read_upper_bound(parsed())
    candidate = candidate_of(SHAPE, 0.1)
    for place in bound.places[:40:7]:
        assert place.direction is not None
        radius = float(np.sqrt(float(place.level) - 0.1 * float(place.theta)))
        far_x, far_y = (radius * float(part) for part in place.direction)
        _, root_x, root_y, tilt_x, tilt_y = candidate
        x = np.array([tilt_x * far_x, far_x / root_x, far_y / root_y, tilt_y * far_y])
        assert x @ SHAPE @ x + 0.1 * float(place.theta) == pytest.approx(float(place.level))
        steering, thrust, speed = 0.7, -2.0, 2.0
        fast = x[3] + speed
        rates = [fast / 0.34 * steering, -fast * np.sin(x[0]), fast * np.cos(x[0]) - speed, thrust]
        unknown = [Dual(constant(fmpq(*float(value).as_integer_ratio()), 0).value, ()) for value in candidate]
        rate = bound.row.value_rate(place, 0, unknown, lambda value: constant(value, 0))
        assert float(rate.value.mid()) == pytest.approx(2 * x @ SHAPE @ rates + 0.1, abs=1e-9)


def test_intervals_hold_values_and_derivatives() -> None:
    """Every operation of the search's numbers, at random points of random boxes."""
    rng = np.random.default_rng(5)

    def function(u: list, lift: Lift) -> Interval:
        return (u[0] * u[1] - u[2].square()) * (u[0] + lift(fmpq(2))).sqrt().sin() + (u[2] * u[2]).cos() * u[
            1
        ].inverse()

    for _ in range(50):
        low = rng.uniform([-1, 0.2, -1], [1, 2, 1])[None]
        high = low + rng.uniform(0, 0.5, 3)
        wide = function(unknowns(low, high), Lift(3))
        point = low + (high - low) * rng.uniform(size=3)
        at = function(unknowns(point, point), Lift(3))
        for outer, inner in ((wide.value, at.value), (wide.slopes, at.slopes)):
            assert (outer[0] <= inner[0] + 1e-12).all() and (outer[1] >= inner[1] - 1e-12).all()


def test_other_questions_are_refused_in_one_line() -> None:
    with pytest.raises(InputError, match="bound: expected a straight line"):
        upper_bound(cfjax.Problem(cfjax.circle()), 1.0)
    with pytest.raises(InputError, match="margin: expected"):
        upper_bound(PROBLEM, -1.0)


def test_a_leaf_without_weights_shows_nothing() -> None:
    bound = read_upper_bound(parsed())
    assert not leaf_holds(bound.row, bound.margin, bound.places, Leaf((), ()), bound.row.root)
