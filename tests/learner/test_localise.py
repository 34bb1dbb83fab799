"""Learning by elimination, on a problem of two states whose feasible coefficients are known in closed form.

ẋ₁ = x₂, ẋ₂ = u with the demonstrated u = −x₁ − 2 x₂. V = a x₁² + 2 b x₁x₂ + d x₂² falls along it by at least ε|x|² at
every x exactly where 2b ≥ ε, 4d − 2b ≥ ε and (a − 2b − d)² ≤ (2b − ε)(4d − 2b − ε).
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, HalfspaceIntersection

from cfjax.learner.centre import (
    CentreError,
    Polytope,
    inscribed,
    irredundant,
    largest_ball,
    log_ball,
)
from cfjax.learner.elimination import CENTRES
from cfjax.learner.localise import Ending, Localised, Reply, Undecided, iteration_bound, localise


CLOSED = np.array([[0.0, 1.0], [-1.0, -2.0]])
LOWER, UPPER = np.array([-10.0, -10.0, -10.0]), np.array([20.0, 2.0, 20.0])  # of (a, b, d)
DELTA = 0.02


def feasible(c: np.ndarray, epsilon: float) -> bool:
    """The closed form."""
    a, b, d = c
    first, second = 2 * b - epsilon, 4 * d - 2 * b - epsilon
    return bool(first >= 0 and second >= 0 and (a - 2 * b - d) ** 2 <= first * second)


def falling(x: np.ndarray, epsilon: float) -> Polytope:
    """V̇ ≤ −ε|x|² at points x (k, 2) along the demonstration."""
    rate = x @ CLOSED.T
    rows = np.stack([2 * x[:, 0] * rate[:, 0], 2 * (x[:, 0] * rate[:, 1] + x[:, 1] * rate[:, 0])], axis=1)
    rows = np.concatenate([rows, 2 * x[:, 1:] * rate[:, 1:]], axis=1)
    return Polytope(rows, -epsilon * (x * x).sum(axis=1))


class Oracle:
    """The worst point on the circle, an eigenvector, and as many more as are violated among random ones."""

    def __init__(self, epsilon: float, batch: int = 1) -> None:
        self.epsilon, self.batch = epsilon, batch
        self.replies: list[Polytope] = []
        self.rng = np.random.default_rng(0)

    def __call__(self, c: np.ndarray) -> Reply:
        shape = np.array([[c[0], c[1]], [c[1], c[2]]])
        values, vectors = np.linalg.eigh(CLOSED.T @ shape + shape @ CLOSED + self.epsilon * np.eye(2))
        x = vectors.T[values > 0][::-1]
        if len(x):
            tried = self.rng.normal(size=(200, 2))
            tried = tried[falling(tried, self.epsilon).slack(c) < 0]
            x = np.concatenate([x, tried])[: self.batch]
        self.replies.append(falling(x, self.epsilon))
        return Reply(self.replies[-1])


def search(epsilon: float, batch: int = 1, **options: object) -> tuple[Localised, Oracle]:
    oracle = Oracle(epsilon, batch)
    return localise(LOWER, UPPER, oracle, delta=DELTA, **options), oracle


def volume(polytope: Polytope) -> float:
    rows = np.concatenate([polytope.normals, -polytope.offsets[:, None]], axis=1)
    return float(ConvexHull(HalfspaceIntersection(rows, largest_ball(polytope)[0]).intersections).volume)


@pytest.mark.parametrize("centre", CENTRES)
@pytest.mark.parametrize("epsilon", [0.1, 2.0, 3.5])
def test_finds_coefficients_of_the_closed_form_within_the_bound(centre: str, epsilon: float) -> None:
    found, _ = search(epsilon, centre=centre)
    assert found.ending is Ending.FOUND
    assert found.candidate is not None and feasible(found.candidate, epsilon)
    assert found.cuts <= found.bound
    ball = (math.prod(UPPER - LOWER) / (4 / 3 * math.pi)) ** (1 / 3)
    assert found.bound == math.ceil(3 * math.log(ball / DELTA) / math.log(9 / 8))


@pytest.mark.parametrize("batch", [1, 8])
@pytest.mark.parametrize("epsilon", [3.98, 4.1])
def test_what_is_infeasible_ends_within_the_bound(epsilon: float, batch: int) -> None:
    """2b ≥ ε with b ≤ 2: beyond 4 there is nothing, and a little before nothing that is δ-robust."""
    found, _ = search(epsilon, batch)
    assert found.ending is Ending.TOO_SMALL and found.candidate is None
    assert found.radius < DELTA and found.cuts <= found.bound


def takes_its_share(found: Localised, replies: list[Polytope], start: Polytope) -> bool:
    """(1 − 1/r) of the polytope's volume (r > 2), 8/9 of the ellipsoid's, with every cut."""
    volumes, polytope = [volume(start)], start
    for reply, step in zip(replies, found.history, strict=True):
        assert step.log_volume <= math.log(volumes[-1])
        polytope = polytope.cut(reply)
        if not len(reply) or largest_ball(polytope)[1] <= 1e-6:
            break
        volumes.append(volume(polytope))
    shares = np.array(volumes[1:]) / np.array(volumes[:-1])
    ellipsoids = np.diff([step.log_volume for step in found.history])
    most = 5 / 9 if start.dimension == 2 else 1 - 1 / start.dimension
    return bool((shares <= most + 1e-4).all() and (ellipsoids <= math.log(8 / 9) + 1e-5).all())


@pytest.mark.parametrize("epsilon", [3.5, 3.98, 4.1])
def test_every_cut_takes_its_share_of_the_volume(epsilon: float) -> None:
    found, oracle = search(epsilon)
    assert takes_its_share(found, oracle.replies, Polytope.box(LOWER, UPPER))


@pytest.mark.parametrize("size", [2, 3, 4])
def test_an_adversary_who_cuts_through_the_centre(size: int) -> None:
    """The least that an answer may take, in random directions, until nothing is left."""
    rng, replies = np.random.default_rng(size), []

    def oracle(c: np.ndarray) -> Reply:
        normal = rng.normal(size=(1, size))
        replies.append(Polytope(normal, normal @ c))
        return Reply(replies[-1])

    found = localise(-np.ones(size), np.ones(size), oracle, delta=0.05)
    assert found.ending is Ending.TOO_SMALL
    assert size + 3 <= found.cuts <= found.bound
    assert takes_its_share(found, replies, Polytope.box(-np.ones(size), np.ones(size)))


def test_the_share_of_a_triangle() -> None:
    """One half, as 1 − 1/r has it, is not what a cut through the centre leaves of every polygon."""
    triangle = Polytope(np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 1.0]]), np.array([0.0, 0.0, 1.0]))
    found = inscribed(triangle)
    assert found is not None
    np.testing.assert_allclose(found.centre, 1 / 3, atol=2e-5)
    kept = triangle.cut(Polytope(np.array([[1.0, 0.0]]), found.centre[:1]))
    assert volume(kept) / volume(triangle) == pytest.approx(5 / 9, abs=1e-4)


def test_no_cut_takes_what_satisfies_the_demonstrations() -> None:
    rng = np.random.default_rng(1)
    for epsilon in (0.5, 2.0, 3.0):
        found, oracle = search(epsilon, batch=4)
        kept = np.array([c for c in rng.uniform(LOWER, UPPER, (20000, 3)) if feasible(c, epsilon)])
        assert len(kept) > 10
        for polytope in (found.polytope, *oracle.replies):
            assert (polytope.normals @ kept.T <= polytope.offsets[:, None] + 1e-9).all()


def test_a_batch_saves_candidates() -> None:
    one, many = (search(3.5, batch)[0] for batch in (1, 8))
    assert one.ending is many.ending is Ending.FOUND
    assert len(many.history) <= len(one.history)


def test_half_spaces_that_are_taken_back() -> None:
    """A demonstration that leaves nothing, revised to one that does: the second half-space stands in for the first."""
    asked: list[np.ndarray] = []

    def oracle(c: np.ndarray) -> Reply:
        asked.append(c)
        if len(asked) == 3:
            return Reply(Polytope(np.zeros((0, 2)), np.zeros(0)))
        return Reply(Polytope(np.array([[1.0, 0.0]]), np.array([0.2 * len(asked)])), afresh=True)

    found = localise(np.zeros(2), np.ones(2), oracle, delta=0.01)
    assert found.ending is Ending.FOUND
    assert len(found.polytope) == 5
    np.testing.assert_allclose(asked[2], [0.2, 0.5], atol=1e-6)


def test_an_answer_has_to_exclude_the_candidate() -> None:
    useless = Reply(Polytope(np.array([[1.0, 0.0]]), np.array([2.0])))
    with pytest.raises(ValueError, match="excludes the candidate"):
        localise(np.zeros(2), np.ones(2), lambda c: useless, delta=0.01)


@pytest.mark.parametrize("kind", CENTRES)
def test_an_empty_polytope_has_no_centre(kind: str) -> None:
    nothing = Polytope.box(np.zeros(2), np.ones(2)).cut(Polytope(np.array([[1.0, 1.0]]), np.array([-1.0])))
    assert inscribed(nothing, kind) is None
    assert largest_ball(nothing)[1] < 0


def test_an_unbounded_set_has_no_largest_ball() -> None:
    with pytest.raises(CentreError):
        largest_ball(Polytope(np.array([[1.0, 0.0]]), np.array([1.0])))


def test_unknown_centre_is_refused() -> None:
    with pytest.raises(ValueError, match="none of the name middle"):
        inscribed(Polytope.box(np.zeros(2), np.ones(2)), "middle")


def test_largest_ellipsoid_of_a_triangle() -> None:
    """Steiner's: it meets the sides in their middles, with π/(3√3) of the area; whatever the affine image."""
    rng = np.random.default_rng(2)
    for scale in (1.0, 1e-3):
        corners = rng.normal(size=(3, 2)) * np.array([scale, 1.0])
        sides = np.roll(corners, -1, axis=0) - corners
        normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1)
        normals *= np.sign(np.einsum("ki,ki->k", normals, corners - corners.mean(axis=0)))[:, None]
        found = inscribed(Polytope(normals, np.einsum("ki,ki->k", normals, corners)))
        assert found is not None
        np.testing.assert_allclose(found.centre, corners.mean(axis=0), atol=2e-5)
        area = 0.5 * abs(sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0])
        assert found.log_volume == pytest.approx(math.log(math.pi / (3 * math.sqrt(3)) * area), abs=1e-5)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), size=st.integers(2, 4))
def test_ellipsoids_lie_inside_and_redundant_half_spaces_do_not_matter(seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(3 * size, size))
    extra = Polytope(normals, np.linalg.norm(normals, axis=1) * rng.uniform(0.2, 1.2, 3 * size))
    polytope = Polytope.box(-np.ones(size), np.ones(size)).cut(extra)
    fewer = irredundant(polytope)
    found = [inscribed(set_, kind) for set_ in (polytope, fewer) for kind in CENTRES]
    for ellipsoid in found:
        assert ellipsoid is not None
        reach = np.linalg.norm(polytope.normals @ ellipsoid.factor, axis=1)
        assert (reach <= polytope.slack(ellipsoid.centre) + 1e-9).all()
    largest, same = found[0], found[len(CENTRES)]
    assert largest is not None and same is not None
    assert largest.log_volume == pytest.approx(same.log_volume, abs=1e-4)
    assert all(other is not None and other.log_volume <= largest.log_volume + 1e-6 for other in found)
    points = rng.uniform(-1.2, 1.2, (2000, size))
    inside = [(set_.normals @ points.T <= set_.offsets[:, None] + 1e-9).all(axis=0) for set_ in (polytope, fewer)]
    np.testing.assert_array_equal(*inside)


def test_the_bound() -> None:
    for size, ball, delta in ((3, 1.0, 0.1), (11, 1.1, 0.01)):
        bound = iteration_bound(size, log_ball(size, ball), delta)
        share = 8 / 9 if size < 9 else 1 - 1 / size
        assert bound == math.ceil(size * math.log(ball / delta) / -math.log(share))
        assert log_ball(size, ball) + bound * math.log(share) < log_ball(size, delta)
        assert log_ball(size, ball) + (bound - 1) * math.log(share) >= log_ball(size, delta)


def test_a_search_that_cannot_go_on_says_so() -> None:
    """A centre that an oracle needs and does not get, or a candidate about which it cannot tell."""
    for error in (CentreError, Undecided):

        def oracle(c: np.ndarray, error: type[Exception] = error) -> Reply:
            if c[0] < 0.5 - 1e-3:
                raise error("no")
            return Reply(Polytope(np.array([[1.0, 0.0]]), c[:1]))

        found = localise(np.zeros(2), np.ones(2), oracle, delta=0.01)
        assert found.ending is Ending.SOLVER and found.candidate is None
        assert found.cuts == 1 and found.radius > 0.01


def test_a_limit_is_told_from_nothing_left() -> None:
    """Answers that take each other back never use up the box."""
    aside = iter(np.tile([[1.0], [-1.0]], (1000, 1)))

    def turning(c: np.ndarray) -> Reply:
        side = next(aside)
        return Reply(Polytope(np.array([[side[0], 0.0]]), side[0] * c[:1]), afresh=True)

    found = localise(np.zeros(2), np.ones(2), turning, delta=0.01)
    assert found.ending is Ending.LIMIT and found.cuts == found.bound


def test_half_spaces_without_a_normal() -> None:
    """0 · c ≤ b says nothing for b ≥ 0, and that there is nothing for b < 0."""
    box = Polytope.box(np.zeros(2), np.ones(2))
    idle, never = (Polytope(np.zeros((1, 2)), np.array([b])) for b in (0.0, -1.0))
    np.testing.assert_allclose(largest_ball(box.cut(idle))[0], 0.5)
    assert len(irredundant(box.cut(idle))) == 4
    assert largest_ball(box.cut(never))[1] == -math.inf
    assert largest_ball(irredundant(box.cut(never)))[1] == -math.inf
    for kind in CENTRES:
        found, same = inscribed(box.cut(idle), kind), inscribed(box, kind)
        assert found is not None and same is not None
        np.testing.assert_allclose(found.centre, same.centre, atol=1e-6)
        assert inscribed(box.cut(never), kind) is None
