"""Stretches are chosen by the falsifier: as few as a target needs, none of them below it."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from cfcheck.claims.hints import MOST_GRAM_ENTRIES
from cfjax.certificate import certify
from cfjax.certificate.certifier import statement_of
from cfjax.certificate.plan import BATCH, CELLS, Cuts, _Planner, plan
from cfjax.certificate.prover import Means, Prover, StretchProof
from cfjax.certificate.rounding import round_funnel
from cfjax.falsifier import falsify, stretch_margins
from cfjax.funnel import Funnel, template_named
from cfjax.funnel.instance import Span
from cfjax.problem import Interval, Path, Pose, Problem, Profile, ReferencePoint, Segment, Tube, ball, deviation_rate
from cfjax.solver import solver_named
from cfjax.verdict import Verdict


DURATION = 2.0  # s: a bend of 2 m, whose curvature rises to 1.3 1/m in its middle and comes back to nothing
PEAK = 1.2944
MARGIN = 2.23  # 1/s, of the funnel that a learner found once


@pytest.fixture(scope="module")
def bend() -> tuple[Problem, Segment, Funnel]:
    scale = 16 * PEAK / DURATION**4
    turn = Profile((0.0, DURATION), ((0.0, 0.0, scale * DURATION**2, -2 * scale * DURATION, scale),))
    segment = Segment(turn, Profile.constant(1.0, DURATION), Pose(0.0, 0.0, 0.0))
    shape = np.array(
        [
            [1.49213, -2.8409, -0.664931, 0.207919],
            [-2.8409, 10.2684, -0.199129, -0.119166],
            [-0.664931, -0.199129, 11.0539, -0.218095],
            [0.207919, -0.119166, -0.218095, 1.13316],
        ]
    )
    funnel = Funnel(template_named("contracting"), shape, 0.978312, DURATION)
    return Problem(Path("bend", (segment,)), inlet=ball(0.3), goal=ball(0.5)), segment, funnel


def stretch_of(segment: Segment, begin: float, end: float) -> Span:
    theta = np.linspace(begin, end, 999)
    kappa = segment.turn_rate.polynomial(theta)
    return Span(begin, end, Tube(Interval(float(kappa.min()), float(kappa.max())), Interval(1.0, 1.0)))


def margins(problem: Problem, segment: Segment, funnel: Funnel, ends: list[tuple], seed: int = 0) -> np.ndarray:
    """By the program that a plan uses: as many stretches at once."""
    stretches = [stretch_of(segment, *pair) for pair in ends]
    padded = stretches + stretches[-1:] * (-len(stretches) % BATCH)
    batches = [padded[k : k + BATCH] for k in range(0, len(padded), BATCH)]
    found = [stretch_margins(problem, segment, funnel, batch, seed=seed) for batch in batches]
    return np.concatenate(found)[: len(ends)]


def slow_margin(problem: Problem, funnel: Funnel, stretch: Span, count: int) -> float:
    """Least margin over random deviations of the shell, each at its worst curvature and θ: what anyone would write.

    Steering has no authority where V_α = 0, thrust none where V_v = 0: a part of the points lies there.
    """
    rng = np.random.default_rng(0)
    covector = rng.normal(size=(count, 4))
    covector[::3, 0] = covector[::2, 3] = 0.0
    x = np.linalg.solve(funnel.shape, covector.T).T
    low = funnel.beta_lower * min(float(funnel.level(stretch.begin)), float(funnel.level(stretch.end)))
    high = max(float(funnel.level(stretch.begin)), float(funnel.level(stretch.end)))
    q = rng.uniform(low, high, count)
    x *= np.sqrt(q / funnel.form(x))[:, None]
    drop = np.minimum(q / funnel.beta_lower, high)
    worst = np.full(count, np.inf)
    for kappa in (stretch.bounds.curvature.lower, stretch.bounds.curvature.upper):
        point = ReferencePoint(kappa, 1.0)
        values = []
        for inputs in np.array(np.meshgrid(*[(i.lower, i.upper) for i in problem.inputs])).reshape(3, -1).T:
            rate = np.stack(np.broadcast_arrays(*deviation_rate(problem.vehicle, tuple(x.T), tuple(inputs), point)), 1)
            values.append(2 * np.einsum("ki,ij,kj->k", x, funnel.shape, rate) + funnel.rate * q * inputs[0])
        worst = np.minimum(worst, -np.min(values, axis=0) / drop)
    return float(worst.min())


@pytest.mark.slow
def test_particles_find_what_sampling_finds_and_more(bend: tuple[Problem, Segment, Funnel]) -> None:
    problem, segment, funnel = bend
    ends = [(0.0, 0.1), (0.3, 0.9), (0.8, 1.2), (0.0, 2.0)]
    found = margins(problem, segment, funnel, ends)
    sampled = np.array([slow_margin(problem, funnel, stretch_of(segment, *pair), 200_000) for pair in ends])
    assert (found <= 1.002 * sampled).all() and found[-1] < 0.9 * sampled[-1]
    assert (found >= sampled - 0.05 * MARGIN).all()


def test_a_longer_stretch_has_less_and_a_place_has_what_the_falsifier_finds(
    bend: tuple[Problem, Segment, Funnel],
) -> None:
    problem, segment, funnel = bend
    nested = [(0.8 - spread, 0.8 + spread) for spread in (0.001, 0.05, 0.1, 0.2, 0.4)]
    assert (np.diff(margins(problem, segment, funnel, nested)) < 0).all()
    places = [(at, at + 1e-6) for at in np.linspace(0.0, DURATION - 1e-6, 32)]
    least = margins(problem, segment, funnel, places).min()
    (worst,) = (point for point in falsify(problem, segment, funnel) if point.condition == "d")
    assert least == pytest.approx(worst.slack, rel=0.01)
    assert worst.slack == pytest.approx(MARGIN, rel=0.01)


def test_as_few_stretches_as_the_target_needs(bend: tuple[Problem, Segment, Funnel]) -> None:
    problem, segment, funnel = bend
    counts = []
    for share in (0.95, 0.85, 0.5):
        target = share * MARGIN
        ends, reached = plan(problem, segment, funnel, target, 1.0, 20)
        assert reached == target and ends[-1] == CELLS and list(ends) == sorted(set(ends))
        at = np.array([0, *ends]) / CELLS * DURATION
        assert margins(problem, segment, funnel, list(itertools.pairwise(at)), seed=1).min() >= 0.998 * target
        joined = list(zip(at[:-2], at[2:], strict=True))
        assert (margins(problem, segment, funnel, joined) < target).all()
        counts.append(len(ends))
    assert counts == sorted(counts, reverse=True) and counts[0] > counts[-1]


@pytest.mark.slow
def test_a_target_out_of_reach_is_lowered(bend: tuple[Problem, Segment, Funnel]) -> None:
    problem, segment, funnel = bend
    few = plan(problem, segment, funnel, 0.95 * MARGIN, 1.0, 4)
    assert len(few.ends) <= 4 and 0.5 * MARGIN < few.target < 0.95 * MARGIN
    high = plan(problem, segment, funnel, 1.1 * MARGIN, 1.01, 20)
    assert 0.95 * MARGIN < high.target < MARGIN
    assert plan(problem, segment, funnel, 10 * MARGIN, 1.0, 4) == Cuts(
        (CELLS // 4, CELLS // 2, 3 * CELLS // 4, CELLS), 0.0
    )


@pytest.mark.parametrize("speed", [(0.0, 1.0), (1.0, -1.0), (1.0, -1.25)], ids=["starts", "stops", "turns back"])
def test_a_reference_that_stops_is_not_proven_but_no_bad_input(speed: tuple[float, float]) -> None:
    segment = Segment(Profile.constant(0.0, 1.0), Profile((0.0, 1.0), (speed,)), Pose(0.0, 0.0, 0.0))
    problem = Problem(Path("stop", (segment,)), inlet=ball(0.3), goal=ball(0.5))
    funnel = Funnel(template_named("contracting"), 8 * np.eye(4), 0.1, 1.0)
    assert plan(problem, segment, funnel, 0.01, 1.01, 4) == Cuts((CELLS // 4, CELLS // 2, 3 * CELLS // 4, CELLS), 0.0)
    outcome = certify(problem, [funnel], target=0.01)
    assert outcome.verdict is Verdict.INCONCLUSIVE
    assert "theta" in outcome.message


@pytest.mark.slow
def test_one_input_for_all_references_costs_more_the_longer_a_stretch_is(bend: tuple[Problem, Segment, Funnel]) -> None:
    """Of a smooth stretch; of a place it is the input that is best there."""
    each, one = (_Planner(*bend, is_smooth=is_smooth) for is_smooth in (False, True))
    ends = np.array([1, 128, 512])
    free, bound = each._margins(0, ends), one._margins(0, ends)
    assert bound[0] == pytest.approx(free[0], rel=0.02)
    # both are found by a search that comes as near as a millionth, by another way on another processor
    assert (bound <= free * (1 + 1e-5)).all() and bound[0] > bound[1] > bound[2]
    assert bound[2] < free[2] - 0.02


def test_a_margin_is_looked_for_once(bend: tuple[Problem, Segment, Funnel], monkeypatch: pytest.MonkeyPatch) -> None:
    problem, segment, funnel = bend
    planner = _Planner(problem, segment, funnel)
    first = planner.ends(0.8 * MARGIN, 20)

    def never(*_: object) -> np.ndarray:
        raise AssertionError("asked twice")

    monkeypatch.setattr("cfjax.certificate.plan.stretch_margins", never)
    assert planner.ends(0.8 * MARGIN, 20) == first and first[0]
    with pytest.raises(AssertionError, match="asked twice"):
        replace(planner).ends(0.8 * MARGIN, 20)


def test_no_more_stretches_are_planned_than_the_file_can_hold(
    bend: tuple[Problem, Segment, Funnel], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Curvature, speed and acceleration that vary: 8 extreme references, 128 cells a stretch, room for 9 of them."""
    problem, segment, funnel = bend
    varying = Segment(segment.turn_rate, Profile((0.0, DURATION), ((1.0, 0.1, 0.05),)), segment.start)
    problem = replace(problem, path=Path("varying", (varying,)))
    asked: list[int] = []

    def planned(
        problem: Problem, segment: Segment, funnel: Funnel, target: float, spare: float, most: int, is_smooth: bool
    ) -> Cuts:
        assert not is_smooth
        asked.append(most)
        return Cuts((CELLS,), 0.0)

    def never(*_: object) -> StretchProof:
        raise AssertionError("asked too much")

    monkeypatch.setattr("cfjax.certificate.prover.plan", planned)
    monkeypatch.setattr(Prover, "prove", never)
    rounded, statement = round_funnel(funnel, varying), statement_of(problem)
    clock = {"plan": 0.0, "exact": 0.0}
    prover = Prover(problem, rounded, statement.claim, 0, MOST_GRAM_ENTRIES, Means(solver_named("batched"), clock))
    with pytest.raises(AssertionError, match="asked too much"):
        prover.along(statement.pieces(0), 1.0)
    assert asked == [9] and 9 * prover.entries <= MOST_GRAM_ENTRIES < 10 * prover.entries
