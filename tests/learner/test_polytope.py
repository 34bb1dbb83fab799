"""The polytope learner on funnels: what its half-spaces mean, what it finds, what it says where it finds nothing."""

import math
from dataclasses import fields, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from cfjax.errors import InputError
from cfjax.funnel import TEMPLATES, Template
from cfjax.funnel.conditions import chain_excess
from cfjax.funnel.instance import Clearance, chain_of
from cfjax.learner.centre import CentreError, Polytope
from cfjax.learner.clearance_cuts import clearance_cuts
from cfjax.learner.coefficients import Coordinates
from cfjax.learner.demonstrations import best_vertices
from cfjax.learner.elimination import Elimination
from cfjax.learner.localise import Ending, Localised, Step
from cfjax.learner.oracle import FunnelOracle, Hunted
from cfjax.learner.polytope import CHANGES
from cfjax.learner.polytope import learn_polytope as learn
from cfjax.learner.run import EliminationRun, PolytopeLearned
from cfjax.learner.witnesses import FADING, Witnesses, dynamics, falling
from cfjax.problem import (
    Box,
    Disc,
    Ellipsoid,
    FootprintDisc,
    Interval,
    Method,
    Path,
    Problem,
    Profile,
    Segment,
    ball,
    circle,
    deviation_rate,
    straight,
    tube,
)
from cfjax.problem.path import Pose


REVISED = "revised"
ONCE = Elimination(climb=False)
MORE = "(at a witness's own level, 0.667 1/s more for each unit of V above it)"
S = Box((1.0, 1.0, 1.0, 3.0))
CIRCLE = Problem(circle(), safe=S)
TEMPLATE = {name: pytest.param(template, id=name) for name, template in TEMPLATES.items()}


def feedback(problem: Problem):
    """The linear quadratic regulator of the first reference, saturated; the timing along which |x|² falls fastest."""
    point = problem.path.curve[0].point(0.0)
    rest = problem.feedforward(point)
    lower, upper = (np.array([getattr(i, side) for i in problem.inputs]) for side in ("lower", "upper"))

    def motion(x: jax.Array, u: jax.Array) -> jax.Array:
        return jnp.stack([jnp.asarray(r) for r in deviation_rate(problem.vehicle, tuple(x), tuple(u), point)])

    state, columns = map(np.asarray, jax.jacobian(motion, (0, 1))(jnp.zeros(4), jnp.asarray(rest)))
    effort = np.diag(4 / (upper - lower)[1:] ** 2)
    solution = solve_continuous_are(state, columns[:, 1:], problem.inlet.shape, effort)
    gains = np.linalg.solve(effort, columns[:, 1:].T @ solution)

    def demonstrate(theta: np.ndarray, x: np.ndarray) -> np.ndarray:
        timing = best_vertices(problem, TEMPLATES["contracting"], 0.0, np.eye(4), theta, x)[:, :1]
        return np.clip(np.concatenate([timing, rest[1:] - x @ gains.T], axis=1), lower, upper)

    return demonstrate


def no_feedback(theta: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.repeat(CIRCLE.feedforward(CIRCLE.path.curve[0].point(0.0))[None], len(x), axis=0)


def coordinates(problem: Problem, template: Template, change: float = 1.0, **options: float) -> Coordinates:
    chain = chain_of(problem, template, 0.9)
    found = Coordinates.of(
        template, chain, 0.9, options.get("beta_inner"), None if template.name == "paper" else change
    )
    assert found is not None
    return found


compiled_excess = jax.jit(chain_excess, static_argnums=0)


def excess(problem: Problem, funnel) -> float:
    chain = chain_of(problem, funnel.template, 0.9)
    factor = np.linalg.cholesky(np.linalg.inv(funnel.shape))[None]
    return float(compiled_excess(funnel.template, chain, jnp.asarray(factor), jnp.asarray([funnel.rate])).max())


def candidates(space: Coordinates, count: int, seed: int) -> np.ndarray:
    """Random coefficients of the box, of which some satisfy (a), (b), (c) and some do not."""
    rng = np.random.default_rng(seed)
    drawn = rng.uniform(space.lower, space.upper, (count, len(space.lower)))
    middle = 0.5 * (space.lower + space.upper)
    return middle + rng.uniform(0, 1, (count, 1)) * (drawn - middle)


@pytest.mark.parametrize("template", TEMPLATE.values())
def test_coefficients_stand_for_a_funnel(template: Template) -> None:
    """Rows against V and its derivative by differences along the demonstrated motion, written out."""
    for beta_inner in (None, 0.5):
        space = coordinates(CIRCLE, template)
        space = replace(space, beta_inner=beta_inner)
        c = candidates(space, 1, 1)[0]
        shape, rate = space.shape(c), space.change_of(c) / space.duration
        rng = np.random.default_rng(2)
        x = 0.3 * rng.normal(size=(5, 4))
        theta = rng.uniform(0, space.duration, 5)
        level = rng.uniform(0.9, 1.0, 5)
        new = Witnesses(theta, x, level, feedback(CIRCLE)(theta, x), *dynamics(CIRCLE, theta, x))
        point = CIRCLE.path.curve[0].point(0.0)
        for k, (slack, y, t, u) in enumerate(zip(falling(space, new, 0.3).slack(c), x, theta, new.inputs, strict=True)):
            motion = np.array(deviation_rate(CIRCLE.vehicle, tuple(y), tuple(u), point), float)
            np.testing.assert_allclose(motion, new.drift[k] + new.columns[k] @ u, atol=1e-12)
            step = 1e-6

            before, here, after = (
                float(template.value(rate, t + s * u[0], (y + s * motion) @ shape @ (y + s * motion)))
                for s in (-step, 0.0, step)
            )
            falls = (after - before) / (2 * step)
            proportional = template.name == "contracting" or beta_inner is not None
            demand = 0.3 * here / 0.9 if proportional else 0.3 + FADING / space.duration * (here - level[k])
            assert slack * float(template.scale(rate, t)) == pytest.approx(-falls - demand, abs=1e-6)


def test_a_half_space_of_decrease_binds_where_the_witness_lies_no_deeper() -> None:
    """V ≥ ℓ implies V̇ ≤ −ε for all that keep to it; those that have the witness well inside are asked for less."""
    space = coordinates(CIRCLE, TEMPLATES["paper"])
    rng = np.random.default_rng(6)
    x, theta = 0.3 * rng.normal(size=(40, 4)), rng.uniform(0, space.duration, 40)
    level = rng.uniform(0.9, 1.0, 40)
    found = Witnesses(theta, x, level, feedback(CIRCLE)(theta, x), *dynamics(CIRCLE, theta, x))
    motion = found.drift + np.einsum("kij,kj->ki", found.columns, found.inputs)
    kept = deep = 0
    for c in candidates(space, 500, 7):
        shape, rate = space.shape(c), space.change_of(c) / space.duration
        value = np.einsum("ki,ij,kj->k", x, shape, x) + rate * theta
        falls = 2 * np.einsum("ki,ij,kj->k", x, shape, motion) + rate * found.inputs[:, 0]
        keeps = falling(space, found, 0.1).slack(c) >= 0
        assert (falls[keeps & (value >= level)] <= -0.1 + 1e-12).all()
        kept += int((keeps & (value >= level)).sum())
        deep += int((keeps & (falls > -0.1)).sum())
    assert kept > 100 and deep > 100


@pytest.mark.parametrize("template", TEMPLATE.values())
def test_the_box_holds_every_funnel_and_no_cut_takes_one(template: Template) -> None:
    """Whatever satisfies (a), (b), (c) lies in the box, in what is known from the start, and in every cut."""
    problem = Problem(circle(), inlet=Ellipsoid((0.3, 0.4, 0.5, 0.2)), goal=ball(0.45), safe=S)
    space = coordinates(problem, template, change=1.5)
    rng = np.random.default_rng(3)
    good = []
    for _ in range(4000):
        c = candidates(space, 1, int(rng.integers(10**9)))[0]
        if np.linalg.eigvalsh(space.shape(c)).min() > 0 and excess(problem, space.funnel(c)) < -1e-5:
            good.append(c)
        if len(good) == 40:
            break
    kept = np.array(good)
    assert len(kept) == 40
    known, seen = space.known(), 0
    assert (known.normals @ kept.T <= known.offsets[:, None]).all()
    for c in candidates(space, 300, 4):
        cuts = space.broken(c)
        if len(cuts):
            seen += 1
            assert cuts.slack(c).max() <= 1e-9  # each of them takes the candidate
            assert (cuts.normals @ kept.T <= cuts.offsets[:, None]).all()
        else:
            assert excess(problem, space.funnel(c)) <= 0
    assert seen > 100


def drawn_between(least: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Random symmetric matrices between `least` and 1, up to the edge: no word about a box of entries."""
    rng = np.random.default_rng(seed)
    root = np.sqrt(1 - least)
    found = []
    for _ in range(count):
        turn, _ = np.linalg.qr(rng.normal(size=(4, 4)))
        values = rng.choice([1e-3, 0.5, 1 - 1e-3], 4) * rng.uniform(0.9, 1.0, 4)
        found.append(np.diag(least) + root[:, None] * (turn * values @ turn.T) * root)
    return np.array(found)


def entries_of(matrix: np.ndarray) -> np.ndarray:
    rows, columns = np.triu_indices(4)
    return matrix[rows, columns] * np.where(rows == columns, 1.0, math.sqrt(2))


def test_the_box_says_no_more_than_the_conditions() -> None:
    """S binds, entry by entry: C' off the diagonal may be larger than a matrix bound of that size would allow."""
    problem = Problem(straight(), inlet=ball(0.5), goal=ball(0.5), safe=S)
    space = coordinates(problem, TEMPLATES["contracting"], change=2.0)
    counterexample = np.diag([0.57, 0.57, 0.57, 0.5])
    counterexample[0, 1] = counterexample[1, 0] = 0.41
    kept = [
        c
        for c in map(entries_of, [counterexample, *drawn_between(np.full(4, math.exp(-2)), 400, 7)])
        if excess(problem, space.funnel(c)) < -1e-5
    ]
    assert len(kept) > 20 and kept[0][1] == pytest.approx(0.41 * math.sqrt(2))
    for c in kept:
        assert (space.lower <= c).all() and (c <= space.upper).all()
        assert len(space.broken(c)) == 0
    # S binds: some have nearly the least diagonal entries that it leaves
    assert (np.array(kept) - space.lower)[:, [0, 4, 7]].min() < 0.15
    # and nothing is wider than it needs to be: the entries of matrices between the bounds reach the box's sides
    reached = np.abs([entries_of(m) for m in drawn_between(np.full(4, math.exp(-2)), 4000, 8)]).max(axis=0)
    off = [1, 2, 3, 5, 6, 8]
    assert (reached[off] >= 0.85 * space.upper[off]).all()


def test_units_do_not_matter() -> None:
    """I, G and S scaled: the same coefficients for the scaled C."""
    space = coordinates(CIRCLE, TEMPLATES["paper"])
    scale = np.array([0.5, 0.1, 0.1, 2.0])
    scaled = replace(
        CIRCLE,
        inlet=Ellipsoid(tuple(scale * CIRCLE.inlet.half_axes)),
        goal=Ellipsoid(tuple(scale * CIRCLE.goal.half_axes)),
        safe=Box(tuple(scale * S.half_widths)),
    )
    other = coordinates(scaled, TEMPLATES["paper"])
    np.testing.assert_allclose(other.lower, space.lower)
    c = candidates(space, 1, 0)[0]
    np.testing.assert_allclose(other.shape(c), space.shape(c) / np.outer(scale, scale))


def learn_polytope(problem: Problem, template: Template, **options: object) -> PolytopeLearned:
    """Options of the search and of the learner in one; without climbing unless told."""
    names = {field.name for field in fields(Elimination)}
    how = replace(ONCE, **{name: value for name, value in options.items() if name in names})
    return learn(problem, template, how, **{name: value for name, value in options.items() if name not in names})


def check_found(problem: Problem, found: PolytopeLearned, margin: float) -> None:
    assert found.learned is not None and found.funnels is not None, found.message
    assert found.learned.margin >= margin * (1 - 1e-3)
    assert found.learned.excess < 0
    assert excess(problem, found.funnels[0]) == pytest.approx(found.learned.excess, abs=1e-9)
    assert all(run.candidates <= run.search.bound for run in found.runs)


@pytest.fixture(scope="module")
def batched() -> PolytopeLearned:
    return learn_polytope(CIRCLE, TEMPLATES["paper"], margin=0.04, demonstrate=feedback(CIRCLE))


def test_the_papers_way_finds_the_circle(batched: PolytopeLearned) -> None:
    check_found(CIRCLE, batched, 0.04)
    (run,) = batched.runs
    assert run.search.ending is Ending.FOUND
    assert "a funnel of margin" in batched.message
    # demonstrations bind what was found: along them it falls
    funnel, x, inputs = batched.funnels[0], run.witnesses.x, run.witnesses.inputs
    point = CIRCLE.path.curve[0].point(0.0)
    for t, y, level, u in zip(run.witnesses.theta, x, run.witnesses.level, inputs, strict=True):
        motion = np.array(deviation_rate(CIRCLE.vehicle, tuple(y), tuple(u), point), float)
        above = y @ funnel.shape @ y + funnel.rate * t - level
        assert 2 * y @ funnel.shape @ motion + funnel.rate * u[0] <= -0.04 - FADING / 6 * above + 1e-9
    # every cut took its share of the ellipsoid
    volumes = np.diff([step.log_volume for step in run.search.history])
    assert (volumes <= math.log(8 / 9) + 1e-4).all()
    # 10 entries of C and c0, in the box of [lower, upper]
    width = np.array([1 - 0.25] * 3 + [1 - 1 / 36] + [math.sqrt(2)] * 6 + [0.88 - 1e-3])
    ball_ = math.exp((np.log(width).sum() - 5.5 * math.log(math.pi) + math.lgamma(6.5)) / 11)
    assert run.search.bound == math.ceil(11 * math.log(ball_ / 0.01) / -math.log(1 - 1 / 11))


def test_one_at_a_time_takes_more_candidates(batched: PolytopeLearned) -> None:
    single = learn_polytope(CIRCLE, TEMPLATES["paper"], margin=0.04, demonstrate=feedback(CIRCLE), batch=1)
    check_found(CIRCLE, single, 0.04)
    assert single.runs[0].demonstrations <= single.iterations
    assert single.iterations >= batched.iterations


@pytest.mark.parametrize("centre", ["analytic", "chebyshev"])
def test_other_centres(centre: str) -> None:
    options = {"margin": 0.02, "delta": 0.001, "demonstrate": feedback(CIRCLE)}
    found = learn_polytope(CIRCLE, TEMPLATES["paper"], centre=centre, **options)
    check_found(CIRCLE, found, 0.02)


def test_rates_are_tried_one_by_one() -> None:
    options = {"margin": 0.5, "demonstrate": feedback(CIRCLE), "changes": (0.3, 1.5, 3.0)}
    heard: list[float] = []
    found = learn_polytope(
        CIRCLE, TEMPLATES["contracting"], progress=lambda done, of: heard.append(done / of), **options
    )
    check_found(CIRCLE, found, 0.5)
    assert [run.change for run in found.runs] == [0.3, 1.5]  # what is slow does not reach the margin, 3 is not tried
    assert found.funnels is not None and found.funnels[0].rate == pytest.approx(1.5 / 6)
    assert heard == sorted(heard) and heard[-1] <= 1


def test_climbing_asks_the_same_demonstrations_for_more(batched: PolytopeLearned) -> None:
    found = learn_polytope(CIRCLE, TEMPLATES["paper"], margin=0.02, demonstrate=feedback(CIRCLE), climb=True)
    check_found(CIRCLE, found, 0.02)
    (run,) = found.runs
    assert run.search.ending is Ending.TOO_SMALL
    assert found.learned is not None and run.target > found.learned.margin
    assert (
        f"no 0.01-robust candidate of margin {run.target:.4g} 1/s {MORE} with c0 T from 0.001 to 0.88" in found.message
    )
    assert f"compatible with these {run.demonstrations} demonstrations ({run.search.cuts} cuts, at" in found.message


def test_what_no_feedback_cannot_do_is_said_within_the_bound() -> None:
    found = learn_polytope(CIRCLE, TEMPLATES["paper"], margin=0.4, demonstrate=no_feedback)
    assert found.learned is None and found.funnels is None
    (run,) = found.runs
    assert run.search.ending is Ending.TOO_SMALL and run.search.cuts <= run.search.bound
    assert f"no 0.01-robust candidate of margin 0.4 1/s {MORE} with c0 T from 0.001 to 0.88 is" in found.message
    assert f"compatible with these {run.demonstrations} demonstrations ({run.search.cuts} cuts, at" in found.message


def test_revised_demonstrations_need_not_be_good() -> None:
    """From the same useless demonstrations: inputs chosen anew for the candidates."""
    found = learn_polytope(CIRCLE, TEMPLATES["paper"], margin=0.02, demonstrate=no_feedback, demonstrations=REVISED)
    check_found(CIRCLE, found, 0.02)
    (run,) = found.runs
    assert np.ptp(run.witnesses.inputs, axis=0).max() > 0


def test_revised_demonstrations_show_nothing_where_nothing_is_found() -> None:
    found = learn_polytope(CIRCLE, TEMPLATES["contracting"], margin=30.0, changes=(1.0,), demonstrations=REVISED)
    assert found.learned is None
    assert "nothing is shown" in found.message and "compatible" not in found.message
    assert "of margin 30 1/s (at V = 0.9, 33.33 1/s at V = 1) at rate 0.167/T" not in found.message
    assert "margin 30 1/s (at V = 0.9, 33.33 1/s at V = 1) at rate 1/T" in found.message
    assert found.message.endswith("no other rates were tried")
    assert found.runs[0].figures()["bound"] is None


def test_tracking_and_a_speed_that_varies() -> None:
    """A stretch of road on which the car speeds up, looked at by stations, the clock running at rate 1."""
    speed = Profile((0.0, 3.0), ((1.0, 0.2),))
    segment = Segment(Profile.constant(0.0, 3.0), speed, Pose(-np.pi / 2, 0.0, 0.0))
    problem = Problem(Path("faster", (segment,)), safe=S, method=Method.TT)
    found = learn_polytope(
        problem, TEMPLATES["contracting"], margin=0.1, demonstrate=feedback(problem), changes=(1.0,), delta=0.002
    )
    check_found(problem, found, 0.1)
    (run,) = found.runs
    assert len(np.unique(run.witnesses.theta)) > 1


@pytest.mark.slow
def test_an_obstacle_beside_the_road() -> None:
    problem = Problem(straight(), obstacles=(Disc(1.0, 0.92, 0.3),))
    assert problem.safe is None
    found = learn_polytope(
        problem, TEMPLATES["contracting"], margin=0.3, demonstrate=feedback(problem), changes=(1.0,), delta=0.002
    )
    check_found(problem, found, 0.3)
    # a funnel as wide as 0.8 m would reach it; the half-spaces take it off, and not the one that was found
    assert found.funnels is not None
    chain = chain_of(problem, TEMPLATES["contracting"], 0.9)
    space = coordinates(problem, TEMPLATES["contracting"])
    clearance: Clearance = jax.tree.map(lambda values: values[0], chain.funnels.clearance)
    wide = space.form(np.eye(4) * problem.inlet.half_axes).sum(axis=0) * (0.5 / 0.8) ** 2
    np.testing.assert_allclose(space.shape(wide), np.eye(4) / 0.8**2, atol=1e-12)
    cuts = clearance_cuts(space, clearance, wide, 8)
    assert len(cuts) == 8 and cuts.slack(wide).max() < 0
    entries = space.inlet[:, None] * found.funnels[0].shape * space.inlet
    rows, columns = np.triu_indices(4)
    narrow = entries[rows, columns] * np.where(rows == columns, 1.0, math.sqrt(2))
    assert len(clearance_cuts(space, clearance, narrow, 8)) == 0


@pytest.mark.parametrize("template", TEMPLATE.values())
def test_half_planes_beside_obstacles_bind_all_funnels_alike(template: Template) -> None:
    """Whoever keeps to the half-plane that was chosen for another funnel satisfies the cut; the other one does not."""
    problem = Problem(
        straight(), obstacles=(Disc(1.0, 0.92, 0.3),), footprint=(FootprintDisc(0.2, 0.15), FootprintDisc(0.2, -0.15))
    )
    space = coordinates(problem, template)
    chain = chain_of(problem, template, 0.9)
    clearance: Clearance = jax.tree.map(lambda values: values[0], chain.funnels.clearance)
    theta, gap, reach, swing = (np.asarray(part) for part in clearance)
    assert swing.max() > 0  # turning counts
    rng = np.random.default_rng(11)
    narrow, wide = (drawn_between(np.full(4, least), 150, 12) for least in (0.3, 0.01))
    last = [[rng.uniform(0.01, 0.88)] if space.free_rate else [] for _ in range(300)]
    drawn = [np.append(entries_of(m), c0) for m, c0 in zip([*narrow, *wide], last, strict=True)]

    def room(c: np.ndarray) -> np.ndarray:
        """Between funnel and half-plane, at each place for each normal: by sampling nothing, in closed form."""
        rate = space.change_of(c) / space.duration
        inverse, level = np.linalg.inv(space.shape(c)), np.asarray(template.level(rate, theta))[:, None]
        along = np.sqrt(level * np.einsum("pdi,ij,pdj->pd", reach, inverse, reach))
        return gap - along - swing[:, None] * level * inverse[0, 0]

    rooms = np.array([room(c) for c in drawn])
    seen, tight = 0, np.inf
    for c, own in zip(drawn, rooms, strict=True):
        cuts = clearance_cuts(space, clearance, c, 8)
        if not len(cuts):
            assert own.max(axis=1).min() > 1e-3
            continue
        normal = own.argmax(axis=1)
        worst = np.argsort(own.max(axis=1))[: len(cuts)]
        assert (cuts.slack(c) < 0).all()
        for row, place in enumerate(worst):
            keeps = rooms[:, place, normal[place]] > 1e-3 * (1 + 1e-5)
            slack = cuts.offsets[row] - np.array(drawn) @ cuts.normals[row]
            assert (slack[keeps] >= 0).all()
            seen += int(keeps.sum())
            tight = min(tight, float(slack[keeps].min(initial=np.inf)))
    assert seen > 500 and tight < 0.3


def test_half_planes_are_counted_among_what_was_chosen() -> None:
    problem = Problem(straight(), obstacles=(Disc(1.0, 0.9, 0.3),))
    found = learn_polytope(
        problem, TEMPLATES["contracting"], margin=20.0, demonstrate=feedback(problem), changes=(1.0,), delta=0.05
    )
    (run,) = found.runs
    assert found.learned is None and run.half_planes > 0 and run.search.ending is Ending.TOO_SMALL
    assert f"{run.demonstrations} demonstrations and {run.half_planes} half-planes beside obstacles" in found.message
    assert run.figures()["half_planes"] == run.half_planes


def test_growing_funnels_are_tried_where_they_may() -> None:
    problem = Problem(straight(), inlet=ball(0.3), goal=ball(0.8), safe=S)
    found = learn_polytope(problem, TEMPLATES["contracting"], margin=40.0, demonstrate=feedback(problem), delta=0.3)
    assert [run.change for run in found.runs] == list(CHANGES) and min(CHANGES) == -1.0
    found = learn_polytope(
        problem, TEMPLATES["contracting"], margin=0.1, demonstrate=feedback(problem), changes=(-1.0,)
    )
    check_found(problem, found, 0.1)
    assert found.funnels is not None and found.funnels[0].end_level > 1


def test_what_holds_a_funnel_back_is_known_from_the_hunt_that_accepted_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Climbing needs no second hunt: the worst points are those of the first."""
    space = coordinates(CIRCLE, TEMPLATES["paper"])
    chain = chain_of(CIRCLE, TEMPLATES["paper"], 0.9)
    task = FunnelOracle(CIRCLE, TEMPLATES["paper"], chain, space, feedback(CIRCLE), Elimination(), 0.05, 0)
    rng = np.random.default_rng(5)
    points = rng.normal(size=(20, 5))
    points[:, -1] = 0.5
    quiet = Hunted(points, np.zeros(20, int), np.linspace(0.1, 0.2, 20))
    hunts = iter([quiet] * 5)
    monkeypatch.setattr(FunnelOracle, "_particles", lambda *_: next(hunts))
    c = entries_of(0.5 * np.eye(4))
    reply = task(np.append(c, 0.7))
    assert task.best[0] == 0.1 and task.target == pytest.approx(0.105)
    assert 1 <= len(task.witnesses.theta) <= 8 and len(reply.cuts) == len(task.witnesses.theta)


def test_a_candidate_without_a_margin_is_no_question(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lost particles have no deviation: none goes to the demonstrator, and the search says that it failed."""

    def demonstrate(theta: np.ndarray, x: np.ndarray) -> np.ndarray:
        assert np.isfinite(x).all() and np.isfinite(theta).all()
        return feedback(CIRCLE)(theta, x)

    lost = Hunted(np.full((20, 5), np.nan), np.zeros(20, int), np.full(20, -np.inf))
    monkeypatch.setattr(FunnelOracle, "_particles", lambda *_: lost)
    found = learn_polytope(CIRCLE, TEMPLATES["paper"], margin=0.04, demonstrate=demonstrate)
    assert found.learned is None and found.runs[0].search.ending is Ending.SOLVER
    assert "failed numerically" in found.message and "nothing is shown" in found.message


def test_messages_say_how_a_search_ended() -> None:
    """With revised demonstrations too a limit is none of room; other centres have a limit and no bound."""
    space = coordinates(CIRCLE, TEMPLATES["paper"])
    history = (Step(0.0, 0.1, 22, 1),) * 5

    def said(ending: Ending, how: Elimination) -> str:
        left = Polytope.box(space.lower, space.upper)
        search = Localised(ending, None, left, 5, 0.02, history)
        return EliminationRun(how, space, search, None, -math.inf, 0.05, Witnesses.none(CIRCLE), 0).message

    revised = replace(ONCE, demonstrations=REVISED)
    assert "was given up after 5 cuts; nothing is shown" in said(Ending.GIVEN_UP, revised)
    assert "ended after 5 cuts, its limit; nothing is shown" in said(Ending.LIMIT, revised)
    assert "without room for a ball of 0.01; demonstrations were revised" in said(Ending.TOO_SMALL, revised)
    assert said(Ending.TOO_SMALL, replace(ONCE, centre="analytic")).endswith("(5 cuts, limit 5, no bound)")
    assert said(Ending.TOO_SMALL, ONCE).endswith("(5 cuts, at most 5)")


def test_a_revision_without_a_centre_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(polytope: object) -> object:
        raise CentreError("no")

    monkeypatch.setattr("cfjax.learner.revision.largest_ball", none)
    found = learn_polytope(CIRCLE, TEMPLATES["paper"], margin=0.04, demonstrations=REVISED)
    assert found.learned is None and found.runs[0].search.ending is Ending.SOLVER


def test_dynamics_of_any_number_of_points() -> None:
    x = np.random.default_rng(5).normal(size=(130, 4))
    drift, columns = dynamics(CIRCLE, np.zeros(130), x)
    point = CIRCLE.path.curve[0].point(0.0)
    for k in (0, 63, 64, 129):
        rates = deviation_rate(CIRCLE.vehicle, tuple(x[k]), (0.7, 0.2, -1.0), point)
        np.testing.assert_allclose(drift[k] + columns[k] @ (0.7, 0.2, -1.0), np.array(rates, float), atol=1e-12)
    assert dynamics(CIRCLE, np.zeros(0), x[:0])[0].shape == (0, 4)


def test_revisions_are_given_up_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cfjax.learner.oracle.PATIENCE", 3)
    found = learn_polytope(CIRCLE, TEMPLATES["paper"], margin=0.9, demonstrations=REVISED)
    (run,) = found.runs
    assert found.learned is None and run.search.ending is Ending.GIVEN_UP and run.candidates == 3
    patient = learn_polytope(CIRCLE, TEMPLATES["paper"], margin=0.9, demonstrate=feedback(CIRCLE))
    assert patient.runs[0].search.ending is Ending.TOO_SMALL and patient.runs[0].candidates > 3


def test_the_same_twice(batched: PolytopeLearned) -> None:
    """Nothing but the seed decides: the same candidates, witnesses and coefficients to the last digit."""
    again = learn_polytope(CIRCLE, TEMPLATES["paper"], margin=0.04, demonstrate=feedback(CIRCLE))
    (first,), (second,) = batched.runs, again.runs
    assert first.search.history == second.search.history and first.figures() == second.figures()
    np.testing.assert_array_equal(first.witnesses.x, second.witnesses.x)
    assert first.search.candidate is not None and second.search.candidate is not None
    np.testing.assert_array_equal(first.search.candidate, second.search.candidate)


def test_what_cannot_be_asked_is_refused() -> None:
    paper = TEMPLATES["paper"]
    with pytest.raises(InputError, match="expected segments, got a tube"):
        learn_polytope(Problem(tube(), goal=ball(0.6)), paper, margin=0.1, demonstrations=REVISED)
    both = Path("both", (*circle().segments, *circle(radius=2.0).segments))
    with pytest.raises(InputError, match="learner=polytope: expected one distinct segment, got 2"):
        learn_polytope(Problem(both, safe=S), paper, margin=0.1, demonstrations=REVISED)
    with pytest.raises(InputError, match="expected revised where no demonstrator is given"):
        learn_polytope(CIRCLE, paper, margin=0.1)
    with pytest.raises(InputError, match="inputs within the problem's box"):
        learn_polytope(CIRCLE, paper, margin=0.1, demonstrate=lambda theta, x: np.full((len(x), 3), 9.0))
    with pytest.raises(InputError, match="expected finite inputs, got 24 that are not"):
        learn_polytope(CIRCLE, paper, margin=0.1, demonstrate=lambda theta, x: np.full((8, 3), np.nan))
    touched = Problem(straight(), obstacles=(Disc(1.0, 0.5505, 0.3),))
    with pytest.raises(InputError, match="between them and the body on the reference itself"):
        learn_polytope(touched, paper, margin=0.1, demonstrations=REVISED)
    nowhere = Problem(circle(), inlet=ball(0.5), goal=ball(0.05), safe=S)
    found = learn_polytope(nowhere, TEMPLATES["contracting"], margin=0.1, demonstrations=REVISED)
    assert found.learned is None and not found.runs
    assert found.message.startswith("(a)–(c) leave no room at rate 0.3/T, 0.6/T, ")


def test_a_chain_of_equal_segments_is_one() -> None:
    laps = Problem(Path("laps", circle().segments * 2), safe=S, timing=Interval(0.5, 2.0))
    found = learn_polytope(laps, TEMPLATES["paper"], margin=0.04, demonstrate=feedback(laps))
    check_found(laps, found, 0.04)
    assert found.funnels is not None and found.funnels[0].end_level < 1
