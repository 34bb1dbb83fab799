"""What is absorbed along a path that tubes hold: how V comes down under held inputs, links, cars of other sizes."""

import copy
import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flint import fmpq

import cfjax
from cfcheck import Outcome, Report, check_document
from cfcheck.claims.document import read_certificate
from cfcheck.exact.rational import Range, sqrt_lower, sqrt_upper
from cfcheck.kernel.legs import Joint
from cfcheck.kernel.legs import Leg as ProvenLeg
from cfcheck.path.bounds import Bounds
from cfcheck.path.reference import Gap
from cfcheck.replay import check_robustness
from cfcheck.robustness.amounts import SHARE, AbsorbedClaim, LawNumbers, Rates, verified
from cfcheck.robustness.descent import HeldFunnel, are_entered, bounds_over, held_over
from cfcheck.robustness.hold_hints import read_robustness
from cfjax.certificate.amounts import largest_amounts
from cfjax.certificate.robustness import robustness_document
from cfjax.funnel import Funnel, Leg, template_named
from cfjax.plants import Model, sensor_named
from cfjax.problem import (
    Interval,
    KinematicBicycle,
    Path,
    Pose,
    Problem,
    Profile,
    ReferencePoint,
    Segment,
    Tube,
    ball,
    deviation_rate,
)
from cfjax.simulation.controller import Follower
from cfjax.simulation.sampled import drive_sampled
from cfjax.simulation.starts import in_world
from cfjax.simulation.track import track_of
from cfjax.tubes import chain_document, library
from cfjax.tubes.follow import Following
from tests.by_hand import claims, tube
from tests.certificate.changed import answer_to


SAMPLES = 20_000
GOALS = (fmpq(1), fmpq(1, 4), fmpq(1, 5))  # levels of V
NOTHING = AbsorbedClaim(fmpq(0), (fmpq(0),) * 4, (fmpq(0),) * 4, fmpq(0))


class Chain(NamedTuple):
    """A path with its tubes, both files, and what is proven of them."""

    following: Following
    document: dict[str, Any]
    hints: dict[str, Any]
    report: Report
    held: tuple[HeldFunnel, ...]


def chain_of(following: Following) -> Chain:
    document = chain_document(following)
    hints = robustness_document(document, workers=2)
    report = check_robustness(check_document(document), document, hints)
    assert report.outcome is Outcome.PROVEN, report.message
    certificate = read_certificate(document)
    file = read_robustness(hints, str(document["hash"]), certificate.claims)
    assert verified(file.stated, bounds_over(certificate, file.hints)) == report.robustness
    return Chain(following, document, hints, report, held_over(certificate, file.hints))


def narrowing(gentle: float) -> Following:
    """Some metres in a wide tube, then a bend that only a narrow one holds: V has to come down to a tenth before."""
    breaks = (0.0, gentle, gentle + 2.0)
    bend = Segment(Profile(breaks, ((0.2,), (1.8,))), Profile(breaks, ((1.0,), (1.0,))), Pose(0.0, 0.0, 0.0))
    by_name = {each.name: each for each in library()}
    wide, narrow = by_name["wide-gentle-slow"], by_name["normal-tight-slow"]
    bends = replace(narrow.bounds, curvature=(fmpq(3, 2), narrow.bounds.curvature[1]))
    only_bends = replace(narrow, bounds=bends)
    following = cfjax.follow(Path("narrowing", (bend,)), [wide, only_bends])
    assert len(following.runs) == 2
    return following


@pytest.fixture(scope="module")
def two() -> Chain:
    return chain_of(narrowing(8.0))


# --- how V comes down


def by_hand(within: Range = (fmpq(-1), fmpq(1))) -> HeldFunnel:
    """μ = 1/m, β̲ = 0.9, β_in = 0.1, at 1 to 2 m/s in two bands, with accelerations `within`."""
    rates = Rates(
        rise=fmpq(10),
        bend=fmpq(400),
        slopes=(fmpq(20),) * 4,
        gradient=(fmpq(3),) * 4,
        norms=(fmpq(2),) * 4,
        widest=fmpq(1),
        staleness=fmpq(300),
        decrease=SHARE,
        inner=fmpq(9, 10),
    )
    funnel = tube(beta_lower=fmpq(9, 10), beta_inner=fmpq(1, 10), margin_per_metre=fmpq(1)).claim
    bounds = Bounds((fmpq(0), fmpq(0)), (fmpq(1), fmpq(2)), within)
    return HeldFunnel(
        funnel=funnel,
        numbers=LawNumbers(fmpq(1), fmpq(1), shell=fmpq(9, 10), inner=fmpq(1, 10), bounds=bounds),
        fastest=fmpq(1),
        bands=((fmpq(1), fmpq(3, 2)), (fmpq(3, 2), fmpq(2))),
        rates=(rates, replace(rates, bend=fmpq(600), decrease=SHARE * fmpq(3, 2))),
    )


def worst_end(own: HeldFunnel, way: float, amounts: AbsorbedClaim, speed: float) -> float:
    """V after so many metres where all goes as badly as the bounds allow, hold by hold.

    The law sees V as it was before the delay, and less by what an error of the pose does; the speed is the given one
    whenever it looks, and as much higher in between as it can be.
    """
    rates = own.rates[0] if speed <= 1.5 else own.rates[1]
    inner, shell, fastest = float(own.numbers.inner), float(own.numbers.shell), float(own.fastest)
    period, delay = float(amounts.period), float(amounts.delay)
    disturbance, pose_error = (np.array(each, float) for each in (amounts.disturbance, amounts.pose_error))
    slopes, gradient = (np.array([float(value) for value in each]) for each in (rates.slopes, rates.gradient))
    norm = float(np.array([float(value) for value in rates.norms]) @ pose_error)
    unseen = 2 * norm + norm**2  # of V
    rise = float(rates.rise) + gradient @ disturbance
    against = gradient @ disturbance + slopes @ pose_error + (float(rates.staleness) + slopes @ disturbance) * delay
    bend = float(rates.bend) + slopes @ disturbance
    assert own.numbers.bounds is not None and own.numbers.margin_per_metre is not None
    surge = float(own.numbers.bounds.acceleration[1]) * fastest * (period + delay)

    value = before = 1 - unseen  # as high as it may be where an input is chosen here for the first time
    metres = (speed + surge) * fastest
    gone = metres * (period + delay)  # until then inputs are another tube's
    while gone < way:
        taken = value + (before - value) * delay / period - unseen  # for V: a delay is shorter than a hold here
        asked = float(SHARE) * float(own.numbers.margin_per_metre) * speed * min(1.0, taken / shell)
        change = (against - asked) * period + bend * period**2 / 2 if taken >= inner else rise * period
        before, value = value, value + change
        gone += metres * period
    return value


def assert_no_worse_than_told(own: HeldFunnel, amounts: AbsorbedClaim, above: float) -> None:
    """For ways and speeds; what is told is close where the speed is the slowest one, which is the one that counts."""
    for way, speed in WAYS:
        told = float(own.descent(amounts).end_level(fmpq(round(1000 * way), 1000)))
        worst = worst_end(own, way, amounts, speed)
        assert worst <= told + 1e-12
        assert told < worst + above or speed > 1


WAYS = tuple(itertools.product((0.05, 0.3, 1.0, 2.0, 5.0), (1.0, 1.5, 2.0)))


@pytest.mark.parametrize("period", [1e-4, 5e-4, 1e-3])
def test_v_comes_down_no_slower_than_is_said(period: float) -> None:
    own = by_hand(within=(fmpq(0), fmpq(0)))
    amounts = replace(NOTHING, period=fmpq(round(period * 10**6), 10**6))
    assert_no_worse_than_told(own, amounts, 0.03 + 60 * period)


@pytest.mark.parametrize("share", [fmpq(1, 4), fmpq(1)])
def test_nor_where_everything_is_amiss_at_once(share: fmpq) -> None:
    own = by_hand()
    each = fmpq(1, 200), fmpq(1, 2000)
    some = AbsorbedClaim(fmpq(1, 5000), (each[0],) * 4, (each[1],) * 4, fmpq(1, 8000)).scaled(share)
    assert_no_worse_than_told(own, some, 0.1)


def test_a_speed_that_rises_meanwhile_is_more_of_the_way() -> None:
    """By 300 m/s²: within a period and a delay the car is an eighth faster than when it looked."""
    own = by_hand(within=(fmpq(-300), fmpq(300)))
    late = replace(NOTHING, period=fmpq(1, 4000), delay=fmpq(1, 6000))
    assert_no_worse_than_told(own, late, 0.1)


def test_bounds_of_a_similar_motion() -> None:
    """Three times as fast, of states measured in units of which 2, 4, 5 and 8 are one."""
    rates = replace(by_hand().rates[0], horizon=fmpq(1, 20))
    axes = tuple(map(fmpq, (2, 4, 5, 8)))
    found = rates.in_units(axes, fmpq(3))
    assert (found.rise, found.decrease) == (30, 3 * rates.decrease)  # 1/s
    assert (found.bend, found.staleness) == (400 * 9, 300 * 9)  # 1/s²
    assert found.slopes == (fmpq(30), fmpq(15), fmpq(12), fmpq(15, 2))  # 1/s per unit
    assert found.gradient == (fmpq(3, 2), fmpq(3, 4), fmpq(3, 5), fmpq(3, 8))  # per unit
    assert found.norms == (fmpq(1), fmpq(1, 2), fmpq(2, 5), fmpq(1, 4))
    assert (found.widest, found.inner, found.horizon) == (rates.widest, rates.inner, fmpq(1, 60))


def test_with_nothing_amiss_v_comes_down_as_in_the_certificate() -> None:
    own = by_hand()
    for way in (0.1, 0.5, 1.0, 3.0):
        exact = fmpq(round(100 * way), 100)
        certified = own.funnel.level_after(exact, own.fastest)
        # slower by what a law in floating point may miss, and by steps from level to level
        assert certified <= own.descent(NOTHING).end_level(exact) <= certified + fmpq(3, 100)


def test_more_amiss_is_more_of_the_way() -> None:
    own, way = by_hand(), fmpq(1)
    some = AbsorbedClaim(fmpq(1, 2000), (fmpq(1, 100),) * 4, (fmpq(1, 1000),) * 4, fmpq(1, 4000))
    before = own.descent(NOTHING).end_level(way)
    for name in ("period", "disturbance", "pose_error", "delay"):
        assert own.descent(replace(NOTHING, **{name: getattr(some, name)})).end_level(way) > before
    assert own.descent(some).end_level(way) < own.entry(NOTHING)
    much = some.scaled(fmpq(40))
    assert 0 <= own.descent(much).end_level(way) - (1 - own.blurred(much)) < fmpq(1, 10**20)  # nothing falls
    assert own.entry(some) < 1 - own.blurred(some) < 1


# --- along a real path


def period_of(document: dict[str, Any], two: Chain) -> fmpq:
    """The longest that is found for inputs to be held, by the hints for the same funnels."""
    certificate = read_certificate(document, skip_hash=True)
    hints = read_robustness(two.hints, str(two.document["hash"]), certificate.claims).hints
    return largest_amounts(bounds_over(certificate, hints)).alone.period


def test_what_is_spent_on_links_is_not_absorbed(two: Chain) -> None:
    """The shorter the way in the wide tube, the less may go amiss; enough of it, and the tubes themselves decide."""
    absorbed = two.report.robustness
    assert absorbed is not None
    periods = []
    for metres in (4.6, 5.0, 8.0):
        periods.append(period_of(chain_document(narrowing(metres)), two))  # at the same curvatures and speed
    assert 0 < periods[0] < periods[1] < periods[2] == absorbed.alone.period
    own = min(min(2 * one.decrease / one.bend for one in held.rates) for held in two.held)
    assert absorbed.alone.period < own


def test_what_is_spent_on_g_is_not_absorbed(two: Chain) -> None:
    """G narrower than the last tube: V has to come down to it as well; the narrower it is, the less may go amiss."""
    absorbed, last = two.report.robustness, two.held[1].funnel
    assert absorbed is not None
    periods = []
    for level in GOALS:
        document = copy.deepcopy(two.document)
        goal = [str(sqrt_upper(4 * level * last.inverse[i, i])) for i in range(4)]  # holds {V <= level}
        document["problem"]["sets"]["goal"] = {"half_axes": goal}
        periods.append(period_of(document, two))
    assert absorbed.alone.period == periods[0] > periods[1] > periods[2] > 0


def leads_on(own: HeldFunnel, ends: list[fmpq], gap: Gap | None = None) -> bool:
    """Whether legs in one funnel that end at these levels lead into each other, at ratios of 1/2; laps over the gap."""
    reference = claims([own.funnel] * len(ends)).legs[0].reference
    legs = [ProvenLeg(reference, k, k + 1, own.funnel, k) for k in range(len(ends))]
    still = Gap(*(fmpq(0),) * 4)
    meeting = [(one, other, still) for one, other in itertools.pairwise(legs)]
    if gap is not None:
        meeting.append((legs[-1], legs[0], gap))
    joints = [Joint(*each, fmpq(1, 2)) for each in meeting]
    return are_entered(joints, ends, [own.entry(replace(NOTHING, period=fmpq(1, 1000)))] * len(ends))


def test_a_tube_has_to_end_as_low_as_the_next_one_is_entered() -> None:
    """Into the first one again too, where the path is a lap: there lower still, by the gap of its reference."""
    own, gap = by_hand(), Gap(fmpq(0), fmpq(1, 100), fmpq(0), fmpq(0))
    entry = own.entry(replace(NOTHING, period=fmpq(1, 1000)))
    assert entry == fmpq(99, 100)  # D' = 10
    bound, hair = entry / 2, fmpq(1, 10**9)
    jump = gap.jump(own.funnel.shape, own.funnel.inverse)
    lower = (sqrt_lower(entry) - jump) ** 2 / 2
    assert lower < bound - hair
    assert leads_on(own, [bound - hair, fmpq(1)])
    assert not leads_on(own, [bound + hair, fmpq(0)])
    assert leads_on(own, [bound - hair, lower - hair], gap)
    assert not leads_on(own, [bound - hair, lower + hair], gap)
    assert not leads_on(own, [bound + hair, fmpq(0)], gap)
    assert not leads_on(own, [fmpq(0)], Gap(fmpq(0), fmpq(1), fmpq(0), fmpq(0)))  # wider than the tube


def states_of(own: HeldFunnel, level: float, rng: np.random.Generator) -> jax.Array:
    """On {V = level}."""
    y = rng.normal(size=(SAMPLES, 4))
    shape = np.array([[float(entry) for entry in row] for row in own.funnel.shape])
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return jnp.asarray(math.sqrt(level) * y @ np.linalg.inv(np.linalg.cholesky(shape)))


def inputs_of(vehicle: KinematicBicycle, timing: tuple[float, float], rng: np.random.Generator) -> jax.Array:
    """Corners of the box, three quarters of them, and what lies between."""
    box = np.array([timing, *((limits.lower, limits.upper) for limits in vehicle.input_box)])
    share = rng.uniform(size=(SAMPLES, 3))
    share = np.where(rng.uniform(size=(SAMPLES, 1)) < 0.75, np.round(share), share)
    return jnp.asarray(box[:, 0] + share * (box[:, 1] - box[:, 0]))


def rates_of(vehicle: KinematicBicycle, own: HeldFunnel) -> Callable[[jax.Array, jax.Array], jax.Array]:
    """ẋ of states (k, 4) under inputs (k, 3), on the run's own curvature and speed."""
    assert own.numbers.bounds is not None
    kappa, speed = float(own.numbers.bounds.curvature[0]), float(own.numbers.bounds.speed[0])
    point = ReferencePoint(kappa * speed, speed, 0.0, 0.0)

    def rate(x: jax.Array, u: jax.Array) -> jax.Array:
        return jnp.stack(jnp.broadcast_arrays(*deviation_rate(vehicle, tuple(x.T), tuple(u.T), point)), axis=1)

    return rate


def level_of(own: HeldFunnel, x: jax.Array) -> np.ndarray:
    shape = np.array([[float(entry) for entry in row] for row in own.funnel.shape])
    return np.einsum("ki,ij,kj->k", np.asarray(x), shape, np.asarray(x))


def test_whatever_is_held_into_the_next_tube_stays_inside_until_an_input_is_chosen_there(two: Chain) -> None:
    absorbed, vehicle, rng = two.report.robustness, KinematicBicycle(), np.random.default_rng(0)
    assert absorbed is not None
    own, rate = two.held[1], rates_of(vehicle, two.held[1])
    amounts = replace(NOTHING, period=absorbed.alone.period)
    start, inputs = states_of(own, float(own.entry(amounts)), rng), inputs_of(vehicle, (0.5, 2.0), rng)

    def after(time: float) -> float:
        x = start
        for _ in range(4):
            x = x + time / 4 * rate(x + time / 8 * rate(x, inputs), inputs)
        return float(level_of(own, x).max())

    period = float(absorbed.alone.period)
    assert after(period) <= 1
    assert after(4 * period) > 1


@pytest.mark.parametrize("car", [(0.3, 1.0, 2.0), (0.34, 1.2, 5.0)], ids=["smaller", "stronger"])
def test_bounds_are_those_of_the_car_that_drives(car: tuple[float, float, float]) -> None:
    """A similar car, and one that can do more than the proven one: V̇ and V̈ stay below the bounds, and come close."""
    vehicle, rng = KinematicBicycle(*car), np.random.default_rng(1)
    found = chain_of(cfjax.follow(cfjax.circle(1.0, 0.8), vehicle=vehicle))
    (own,) = found.held
    rate, shape = rates_of(vehicle, own), jnp.asarray([[float(entry) for entry in row] for row in own.funnel.shape])
    x, u = states_of(own, 1.0, rng), inputs_of(vehicle, (0.5, 2.0), rng)

    def rising(x: jax.Array) -> jax.Array:
        return 2 * jnp.einsum("ki,ij,kj->k", x, shape, rate(x, u))

    first, second = jax.jvp(rising, (x,), (rate(x, u),))
    (rates,) = own.rates
    assert 0.7 * float(rates.rise) < float(first.max()) <= float(rates.rise)
    assert 0.5 * float(rates.bend) < float(second.max()) <= float(rates.bend)
    slopes = jnp.abs(jax.vmap(jax.grad(lambda x, u: 2 * x @ shape @ rate(x[None], u[None])[0]))(x, u)).max(axis=0)
    assert all(seen <= float(bound) for seen, bound in zip(slopes, rates.slopes, strict=True))


@pytest.mark.slow
def test_cars_stay_in_both_tubes_at_the_proven_period(two: Chain) -> None:
    """Under the law that asks for the path's bounds, from V = 1, over the link and to the end."""
    absorbed, following = two.report.robustness, two.following
    assert absorbed is not None
    problem = Problem(following.path, inlet=ball(0.2), goal=ball(0.5))
    legs = []
    for stretch, own in zip(following.tubes, two.held, strict=True):
        shape = np.array([[float(entry) for entry in row] for row in own.funnel.shape])
        levels = float(own.funnel.beta_lower), float(own.funnel.beta_inner)
        funnel = Funnel(template_named("contracting"), shape, 0.0, math.inf, *levels)
        along = Tube(
            *(
                Interval(*map(float, getattr(own.numbers.bounds, name)))
                for name in ("curvature", "speed", "acceleration")
            )
        )
        legs.append(
            Leg(stretch.end, funnel, float(own.numbers.margin), float(own.numbers.margin_per_metre or 0), along)
        )
    track, period = track_of(problem, legs), float(absorbed.alone.period)
    x = states_of(two.held[0], 1 - 1e-9, np.random.default_rng(2))[:16]
    starts = in_world(track, x)
    loop = drive_sampled(
        problem,
        legs,
        Follower(track, period),
        Model(problem.vehicle),
        starts,
        period=period,
        sensor=sensor_named("none", problem.vehicle),
        theta=np.zeros(16),
    )
    assert loop.arrived.all()
    assert loop.largest_value.max() <= 1
    assert not loop.left_funnel.any()


# --- files


def test_what_is_told_of_the_path_is_looked_at(two: Chain) -> None:
    sentence = two.report.message
    assert "for every curvature and acceleration of the bounds at once, one of the following" in sentence
    assert "; funnel 0: lambda = " in sentence
    assert "whatever the path does meanwhile" in sentence

    own = {"report": check_document(two.document), "document": two.document, "hints": two.hints}
    answer = partial(answer_to, **own)

    def bounds(index: int, name: str, ends: list[str]) -> Callable[[dict], None]:
        return lambda hints: hints["funnels"][index]["bounds"].update({name: ends})

    assert answer(lambda hints: None)[0] is Outcome.PROVEN
    spoiled = {
        "leaves the bounds that are told of it in funnel 0": bounds(0, "curvature", ["1/4", "1/3"]),
        "wider than funnel 1": bounds(1, "curvature", ["9/5", "3"]),
        "bands of speed": bounds(0, "speed", ["1/2", "2"]),
        "have to cover": lambda hints: hints["funnels"][1]["stretches"][0]["levels"][0]["cells"].pop(),
        "hints for another certificate": lambda hints: hints.update(certificate="0" * 64),
        "do not allow the period": lambda hints: hints["amounts"]["alone"].update(period="1/50"),
        "expected amounts for 0 bands": lambda hints: hints["amounts"]["by_speed"].append(hints["amounts"]["alone"]),
    }
    for reason, change in spoiled.items():
        outcome, message = answer(change)
        assert outcome is Outcome.BROKEN and reason in message, message
    assert answer(lambda hints: hints["funnels"].pop())[0] is Outcome.UNREADABLE
    assert answer(lambda hints: hints["funnels"][0].update(bounds=None))[0] is Outcome.UNREADABLE
