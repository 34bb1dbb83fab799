"""What certified tubes say of a car, and when one hands over to another: an integrated flow, and the very edge."""

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest
from flint import fmpq
from scipy.integrate import solve_ivp

from cfcheck.exact.rational import rational
from cfcheck.kernel.legs import Joint, Leg, is_wider, prove_joints
from cfcheck.kernel.level import Contracting, Paper
from cfcheck.path.reference import Gap
from cfcheck.reader import Broken
from cfjax.certificate.joints import widest_ratio
from cfjax.control.law import LAW_SHARE
from cfjax.exact import exact_reference
from cfjax.tubes.choice import needed_distance
from tests.by_hand import ONE, TINY, ZERO, bounds, claims, funnel, stated, tube


def test_level_is_what_the_slowest_descent_leaves() -> None:
    own, fastest = tube(margin_per_metre=fmpq(3, 2)), fmpq(2)
    beta, rate = 0.25, LAW_SHARE * 1.5 / 2  # what the run-time law enforces, at the fastest timing
    flow = solve_ivp(
        lambda _, v: -rate * np.minimum(1, v / beta), (0, 3), [1.0], rtol=1e-10, atol=1e-12, dense_output=True
    )
    for distance in np.linspace(0, 2, 21):
        level = own.claim.level_after(rational(float(distance)), fastest)
        assert float(level) == pytest.approx(float(flow.sol(distance)[0]), rel=1e-6)
        back = own.distance_to(level, fastest)
        assert back is not None and float(back) == pytest.approx(float(distance), abs=1e-12)
    assert own.claim.level_after(fmpq(10**9), fastest) == own.beta_inner
    assert own.distance_to(fmpq(1), fastest) == own.distance_to(fmpq(3), fastest) == 0
    assert own.distance_to(own.beta_inner, fastest) is not None
    assert own.distance_to(own.beta_inner - TINY, fastest) is None
    still = replace(own.claim, margin_per_metre=None)  # of which no margin per metre is claimed
    assert still.level_after(fmpq(10**9), fastest) == 1


def test_how_much_wider_a_funnel_is_is_decided_exactly() -> None:
    wide, narrow = tube(), tube("narrow", scale=fmpq(2))
    assert is_wider(wide.shape, narrow.shape, fmpq(1, 2) - TINY)
    assert not is_wider(wide.shape, narrow.shape, fmpq(1, 2))
    assert is_wider(narrow.shape, wide.shape, fmpq(2) - TINY)
    nearly = widest_ratio(wide.shape, narrow.shape)
    assert nearly is not None and fmpq(1, 2) - fmpq(1, 10**8) < nearly < fmpq(1, 2)
    fastest = fmpq(2)
    found = needed_distance(wide, narrow, fmpq(1, 2) - TINY, ZERO, fastest)
    assert found is not None and found[0] == fmpq(1, 2) - TINY and found[1] == 2 * (fmpq(1, 2) + TINY)
    assert needed_distance(narrow, wide, fmpq(3, 2), ZERO, fastest) == (ONE, ZERO)
    assert needed_distance(wide, tube(scale=fmpq(101)), fmpq(1, 102), ZERO, fastest) is None  # below beta_inner
    # over a jump the level shrinks with (1 − jump)²
    over = needed_distance(wide, narrow, fmpq(1, 3), fmpq(1, 10), fastest)
    assert over is not None and over[0] == fmpq(1, 3) * fmpq(81, 100)
    assert needed_distance(wide, narrow, fmpq(1, 3), ONE, fastest) is None


def test_legs_are_joined_one_by_one() -> None:
    wide, narrow = tube().claim, tube("narrow", bounds(fmpq(1, 2)), fmpq(2)).claim
    ratio, fastest = fmpq(1, 2) - TINY, fmpq(2)
    needed = 1 + 2 * TINY

    def legs(length: fmpq) -> list[Leg]:
        reference = exact_reference([stated(((1,), (0,)), ((1,), (1,)), breaks=(0, length, 3))])
        return [Leg(reference, 0, 1, wide), Leg(reference, 1, 2, narrow, 1)]

    (joint,) = prove_joints(legs(needed), False, [ratio], fastest)
    assert joint.before.length == needed and joint.after.pieces[0].theta == 0
    # V comes down to 1/2 over a metre, no less: a hair less of it, or a faster θ, is too little
    for own, most in ((legs(needed - fmpq(1, 10**9)), fastest), (legs(needed), fastest + fmpq(1, 10**9))):
        with pytest.raises(Broken, match="joint, from leg 0 to leg 1: the end of the funnel does not lie inside"):
            prove_joints(own, False, [ratio], most)
    with pytest.raises(Broken, match="joint, from leg 0 to leg 1: the next funnel is not as wide as is claimed"):
        prove_joints(legs(needed), False, [fmpq(1, 2)], fastest)
    with pytest.raises(Broken, match="the end of the lap is not its start"):
        prove_joints(legs(needed), True, [ratio, ONE], fastest)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"within": bounds(acceleration=(ONE, -ONE))}, "interval of acceleration"),
        ({"within": bounds(speed=(ZERO, ONE))}, "speeds above zero"),
        ({"within": dataclasses.replace(bounds(), curvature_rate=(ZERO, ZERO))}, "curvature that may jump"),
        ({"shape": [[ONE] * 4] * 4}, "positive definite"),
        ({"shape": [[ONE]]}, "positive definite"),
        ({"beta_inner": fmpq(1, 2)}, "beta_inner"),
        ({"margin_per_metre": ZERO}, "positive margin"),
        ({"inputs": {"w": (ONE, ONE)}}, "u0"),
        ({"inputs": {"u0": (ZERO, ONE)}}, "u0"),
    ],
)
def test_numbers_of_no_tube_are_refused(changes: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        tube(**changes)


def test_a_funnel_is_entered_below_its_root_less_the_jump() -> None:
    """Equal funnels, C = 4 I: V ≤ 1 of the first lies in √V < root where root ≥ 1, and by a jump of 1/20 m later."""
    before, after = claims([funnel(), funnel()]).legs
    still, jumps = Gap(*(fmpq(0),) * 4), Gap(fmpq(0), fmpq(1, 20), fmpq(0), fmpq(0))  # √C_xx/20 = 1/10
    for gap, root, inside in (
        (still, fmpq(1001, 1000), True),
        (still, fmpq(999, 1000), False),
        (jumps, fmpq(1101, 1000), True),
        (jumps, fmpq(1099, 1000), False),
        (jumps, fmpq(1, 20), False),
    ):
        assert Joint(before, after, gap, fmpq(1)).is_entered(fmpq(1), root) is inside


def test_a_leg_ends_as_low_as_its_template_has_it() -> None:
    """q ≤ (level − c0) of the paper's V after a second, q ≤ e^{-k} level of the other one."""
    for level, highest in ((Paper(fmpq(1, 4)), 0.25), (Contracting(fmpq(1, 4)), 0.5 * math.exp(-0.25))):
        (leg,) = claims([funnel(level=level)]).legs
        low, high = leg.end_form(fmpq(1, 2))
        assert low <= high and float(high) == pytest.approx(highest)
