"""What a tube absorbs: bounds against V itself beside paths that jump, and attacks on the law that knows no path."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flint import fmpq

from cfcheck import Outcome, check_document
from cfcheck.path.bounds import Bounds
from cfcheck.reader import Broken
from cfcheck.replay import check_robustness
from cfcheck.robustness.amounts import (
    AbsorbedClaim,
    BoundsOver,
    ProvenRobustness,
    Rates,
    kept_level,
    least_level,
    verified,
)
from cfcheck.robustness.rate_bounds import HORIZON
from cfjax.certificate import certify
from cfjax.certificate.amounts import largest_amounts
from cfjax.certificate.robustness import robustness_document, speed_bands
from cfjax.control import MinNorm, any_path_numbers, path_point
from cfjax.control.law import LAW_SHARE
from cfjax.errors import InputError
from cfjax.falsifier import first_escape
from cfjax.funnel import Funnel, template_named
from cfjax.problem import Interval, Method, Problem, ReferencePoint, Tube, ball, circle, deviation_rate, tube
from tests.certificate.changed import answer_to


SAMPLES = 20_000
# from runs of +path=tube, rounded: one of a single speed with the timing free, one with all that a tube can have
CASES = {
    "steady pf": (
        Problem(tube(1.0, Interval(1.0, 1.0), 0.0), inlet=ball(0.4), goal=ball(0.6)),
        [[3.841, -1.6, 0, 0], [-1.6, 5.186, 0, 0], [0, 0, 4.591, 1.156], [0, 0, 1.156, 5.04]],
    ),
    "changing tt": (
        Problem(tube(1.5, Interval(1.0, 2.0), 0.5), inlet=ball(0.15), goal=ball(0.25), method=Method.TT),
        [[23.16, -11.77, 0, 0], [-11.77, 36.3, 0, 0], [0, 0, 36.96, 12.5], [0, 0, 12.5, 23.47]],
    ),
}


class Case:
    """A proven tube with what it absorbs, and its two files."""

    def __init__(self, name: str) -> None:
        self.problem, shape = CASES[name]
        found = certify(self.problem, [Funnel(template_named("contracting"), np.array(shape), 0.0, math.inf)])
        assert found.document is not None and found.margins and found.margins_per_metre
        (self.funnel,), (self.margin,), (self.per_metre,) = found.funnels, found.margins, found.margins_per_metre
        self.document, self.hints = found.document, robustness_document(found.document, workers=2)
        self.report = check_robustness(check_document(self.document), self.document, self.hints)
        assert self.report.outcome is Outcome.PROVEN, self.report.message
        assert self.report.robustness is not None and self.per_metre is not None
        self.proven: ProvenRobustness = self.report.robustness

    @property
    def tube(self) -> Tube:
        (bounds,) = self.problem.path.segments
        assert isinstance(bounds, Tube)
        return bounds

    def states(self, rng: np.random.Generator, lowest: float = 0.0) -> jax.Array:
        """With V from `lowest` to 1, half of them at 1."""
        y = rng.normal(size=(SAMPLES, 4))
        y /= np.linalg.norm(y, axis=1, keepdims=True)
        level = np.where(rng.uniform(size=SAMPLES) < 0.5, 1.0, rng.uniform(lowest, 1.0, SAMPLES))
        return jnp.asarray(y @ np.linalg.inv(np.linalg.cholesky(self.funnel.shape)) * np.sqrt(level)[:, None])

    def inputs(self, rng: np.random.Generator) -> jax.Array:
        """Of the box, three quarters of them corners."""
        lower, upper = (np.array([getattr(box, end) for box in self.problem.inputs]) for end in ("lower", "upper"))
        share = rng.uniform(size=(SAMPLES, len(lower)))
        share = np.where(rng.uniform(size=(SAMPLES, 1)) < 0.75, np.round(share), share)
        return jnp.asarray(lower + share * (upper - lower))


def among(rng: np.random.Generator, interval: Interval, ends: float = 0.75) -> jax.Array:
    """A sample of an interval for each car, a share of them ends of it."""
    share = rng.uniform(size=SAMPLES)
    share = np.where(rng.uniform(size=SAMPLES) < ends, np.round(share), share)
    return jnp.asarray(interval.lower + share * (interval.upper - interval.lower))


@pytest.fixture(scope="module")
def case() -> Callable[[str], Case]:
    """By name; each is proven once."""
    made: dict[str, Case] = {}

    def get(name: str) -> Case:
        if name not in made:
            made[name] = Case(name)
        return made[name]

    return get


@pytest.mark.parametrize("name", CASES)
def test_bounds_hold_beside_any_path_and_are_close(case: Callable[[str], Case], name: str) -> None:
    """V̇ ≤ D, and what V̇ at a curvature and acceleration that stay rises by beside any others stays below M and L."""
    own = case(name)
    rng = np.random.default_rng(0)
    x, u, other = own.states(rng), own.inputs(rng), own.inputs(rng)
    v, bounds = among(rng, own.tube.speed), own.tube
    kappa, a = among(rng, bounds.curvature), among(rng, bounds.acceleration)
    looked_at, steady = among(rng, bounds.curvature), among(rng, bounds.acceleration)
    shape = jnp.asarray(own.funnel.shape)

    def motion(x: jax.Array, u: jax.Array, v: jax.Array, kappa: jax.Array, a: jax.Array) -> jax.Array:
        point = ReferencePoint(kappa * v, v, kappa * a, a)
        rates = deviation_rate(own.problem.vehicle, tuple(x), tuple(u), point)
        return jnp.stack([jnp.asarray(rate, float) for rate in rates])

    @jax.jit
    @jax.vmap
    def both(*at: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        x, u, other, v, kappa, a, looked_at, steady = at

        def rising(x: jax.Array, v: jax.Array) -> jax.Array:
            return 2 * x @ shape @ motion(x, u, v, looked_at, steady)

        def along(moved_by: jax.Array) -> jax.Array:
            return jax.jvp(rising, (x, v), (motion(x, moved_by, v, kappa, a), a * moved_by[0]))[1]

        return rising(x, v), along(u), along(other)

    first, second, stale = map(np.asarray, both(x, u, other, v, kappa, a, looked_at, steady))
    rates = own.proven.rates
    assert 0.75 * float(rates[-1].rise) < first.max() <= float(rates[-1].rise)
    assert 0.65 * float(rates[-1].bend) < second.max() <= float(rates[-1].bend)
    assert np.abs(stale).max() <= float(rates[-1].staleness)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "widest"), [("steady pf", 1.3), ("changing tt", 2.0)])
def test_nothing_leaves_within_the_period_and_something_soon_after(
    case: Callable[[str], Case], name: str, widest: float
) -> None:
    """Against any input that a law may take, and a path that jumps as is worst at each moment."""
    own = case(name)
    period = float(own.proven.alone.period)

    less, per_metre = LAW_SHARE * own.margin, LAW_SHARE * own.per_metre
    escape = first_escape(
        own.problem, own.tube, own.funnel, less, 1.1 * widest * period, decrease_per_metre=per_metre, trials=2**15
    )
    assert period <= escape < widest * period


def attack(own: Case, amounts: AbsorbedClaim, kept: fmpq, seed: int = 0) -> float:
    """The largest V above what is to be kept, of cars under the law that knows the path's speed alone.

    The path jumps anew eight times in a delay and in a period, to ends of its bounds for most cars. Without a period
    inputs are held for a microsecond.
    """
    rng = np.random.default_rng(seed)
    level, period, delay = float(kept), max(float(amounts.period), 1e-6), float(amounts.delay)
    x, v, before = own.states(rng, 0.5) * math.sqrt(level), among(rng, own.tube.speed), own.inputs(rng)
    signs = rng.choice([-1.0, 1.0], size=(2, SAMPLES, 4))
    off = jnp.asarray(signs[0] * [float(d) for d in amounts.disturbance])
    wrong = jnp.asarray(signs[1] * [float(e) for e in amounts.pose_error])
    turns, slopes = (
        jnp.stack([among(rng, interval) for _ in range(16)]) for interval in (own.tube.curvature, own.tube.acceleration)
    )
    shape = jnp.asarray(own.funnel.shape)
    numbers = any_path_numbers(own.problem, own.funnel, own.margin, own.per_metre)

    def value(x: jax.Array) -> jax.Array:
        return jnp.einsum("ki,ij,kj->k", x, shape, x)

    def drive(x: jax.Array, v: jax.Array, u: jax.Array, turns: jax.Array, slopes: jax.Array, h: float) -> tuple:
        """Where the cars are after eight jumps, h s apart, and the largest V on the way."""
        speeds = own.tube.speed

        def step(at: tuple, now: tuple) -> tuple:
            (x, v, most), (kappa, a) = at, now
            reach = jnp.maximum(h, 1e-12) * u[0]
            a = jnp.clip(a, (speeds.lower - v) / reach, (speeds.upper - v) / reach)

            def rate(x: jax.Array, v: jax.Array) -> jax.Array:
                point = ReferencePoint(kappa * v, v, kappa * a, a)
                rates = deviation_rate(own.problem.vehicle, tuple(x.T), tuple(u), point)
                return jnp.stack([jnp.asarray(entry, float) for entry in rates], axis=1) + off

            middle = x + h / 2 * rate(x, v)
            x, v = x + h * rate(middle, v + h / 2 * a * u[0]), v + h * a * u[0]
            return (x, v, jnp.maximum(most, value(x))), None

        return jax.lax.scan(step, (x, v, value(x)), (turns, slopes))[0]

    @jax.jit
    def end(x: jax.Array, v: jax.Array) -> jax.Array:
        point = path_point(jnp.zeros(SAMPLES), v, jnp.zeros(SAMPLES))
        told = tuple((x + wrong).T)
        u = jnp.stack(MinNorm()(own.problem.vehicle, own.funnel.template, numbers, point, 0.0, told))
        x, v, before_it = drive(x, v, before.T, turns[:8], slopes[:8], delay / 8)  # since it was measured
        _, _, most = drive(x, v, u, turns[8:], slopes[8:], period / 8)
        return jnp.where(before_it <= level + 1e-12, most - level, -1.0).max()

    return float(end(x, v))


@pytest.mark.parametrize("what", ["period", "disturbance", "together"])
def test_the_law_keeps_v_whatever_the_path_does(case: Callable[[str], Case], what: str) -> None:
    own = case("changing tt")
    alone, nothing = own.proven.alone, own.proven.alone.scaled(fmpq(0))
    amounts = {
        "period": replace(nothing, period=alone.period),
        "disturbance": replace(nothing, disturbance=(alone.disturbance[0], *nothing.disturbance[1:])),
        "together": own.proven.together,
    }[what]
    kept = own.proven.level if what == "together" else fmpq(1)
    assert attack(own, amounts, kept) <= 1e-9
    assert attack(own, amounts.scaled(fmpq(32)), kept) > 1e-9  # the attack is none that nothing would fail


def test_times_are_no_longer_than_the_bounds_hold(case: Callable[[str], Case]) -> None:
    for name in CASES:
        own = case(name)
        for rates, amounts in zip(own.proven.rates, own.proven.by_speed, strict=True):
            assert (rates.horizon == HORIZON) == (name == "changing tt")
            assert max(amounts.period, amounts.delay) <= rates.horizon
            assert amounts.period >= own.proven.alone.period


def test_an_error_of_the_pose_in_a_band_is_one_whose_level_is_told() -> None:
    """A slow band alone absorbs a larger error, from starts that have to lie deeper: the level told is not of that."""
    one = Rates(
        rise=fmpq(10),
        bend=fmpq(100),
        slopes=(fmpq(200),),
        gradient=(fmpq(3),),
        norms=(fmpq(5),),
        widest=fmpq(1),
        staleness=fmpq(50),
        decrease=fmpq(1),
        inner=fmpq(9, 10),
    )
    rates = one, replace(one, slopes=(fmpq(800),), decrease=fmpq(2))
    bounds = BoundsOver(rates, partial(least_level, rates), (), bands=((fmpq(1), fmpq(2)), (fmpq(2), fmpq(3))))
    every = verified(largest_amounts(bounds), bounds)
    slow, fast = every.by_speed
    alone = largest_amounts(BoundsOver((one,), partial(least_level, (one,)), ())).alone
    assert alone.pose_error[0] > every.alone.pose_error[0]  # else there is nothing to see
    for band, own in zip(rates, (slow, fast), strict=True):
        kept = kept_level(band, replace(own.scaled(fmpq(0)), pose_error=own.pose_error))
        assert kept is not None and kept >= every.pose_level
    bolder = largest_amounts(bounds)._replace(by_speed=(replace(slow, period=fast.period * 4), fast))
    with pytest.raises(Broken, match="the period in band 0 that is claimed"):
        verified(bolder, bounds)
    with pytest.raises(Broken, match="amounts for 2 bands of speed, got 1"):
        verified(largest_amounts(bounds)._replace(by_speed=(slow,)), bounds)
    assert slow.disturbance[0] < fast.disturbance[0]


def levels(hints: dict) -> list[dict]:
    return hints["funnels"][0]["stretches"][0]["levels"]


def test_files_that_show_less_or_nothing(case: Callable[[str], Case]) -> None:
    own = case("steady pf")
    report = check_document(own.document)
    answer = partial(answer_to, report=report, document=own.document, hints=own.hints)
    assert "for every curvature and acceleration of the bounds at once" in own.report.message
    assert "whatever curvature and acceleration do meanwhile" in own.report.message
    outcome, message = answer(lambda h: h["funnels"][0]["bounds"].update(curvature=["0", "0"]))
    assert outcome is Outcome.BROKEN and "narrower than those of the path" in message
    outcome, message = answer(lambda h: h["funnels"][0].update(bounds=None))
    assert outcome is Outcome.UNREADABLE and "bounds of the path for a funnel" in message
    outcome, message = answer(lambda h: h["amounts"]["by_speed"][0].update(pose_error=["9"] * 4))
    assert outcome is Outcome.UNREADABLE and "pose_error" in message
    outcome, message = answer(lambda h: h["funnels"][0]["stretches"][0].update(end="3/2"))
    assert outcome is Outcome.BROKEN and "bands of speed" in message
    outcome, message = answer(lambda h: h["funnels"][0]["stretches"][0]["levels"][0]["cells"].pop())
    assert outcome is Outcome.BROKEN and "16 vertices" in message
    outcome, message = answer(lambda h: h["funnels"][0]["stretches"].append(h["funnels"][0]["stretches"][0]))
    assert outcome is Outcome.BROKEN and "bands of speed" in message
    outcome, message = answer(lambda h: levels(h).append(levels(h)[0]))
    assert outcome is Outcome.BROKEN and "ranges of levels" in message


def test_speeds_are_cut_into_few_bands() -> None:
    def bands(lower: int, upper: int) -> list[float]:
        still = (fmpq(0), fmpq(0))
        return [float(end) for end in speed_bands(Bounds(still, (fmpq(lower), fmpq(upper)), still))]

    assert bands(1, 1) == [1, 1]
    assert bands(1, 2) == [1, 2]
    assert bands(1, 9) == [1, 3, 9]
    assert bands(1, 100) == [1, 10, 100]


def test_the_law_that_knows_no_path_is_of_tubes() -> None:
    problem = Problem(circle())
    funnel = Funnel(template_named("contracting"), np.eye(4), 0.0, math.inf)
    with pytest.raises(InputError, match="path: expected a tube, got circle"):
        any_path_numbers(problem, funnel, 1.0, 1.0)
