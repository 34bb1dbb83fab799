"""What certified tubes say of a car, and when one hands over to another: an integrated flow, and the very edge."""

import dataclasses

import numpy as np
import pytest
from flint import fmpq
from scipy.integrate import solve_ivp

from cfjax.check.document import FunnelClaim
from cfjax.check.handover import Run, hands_over, needed_distance, prove_chain
from cfjax.check.level import Contracting
from cfjax.check.proof import is_entered
from cfjax.check.rational import rational
from cfjax.check.reference import Gap, Reference
from cfjax.control.law import LAW_SHARE
from cfjax.exact import exact_reference
from tests.by_hand import ONE, TINY, ZERO, bounds, stated, tube


def test_level_is_what_the_slowest_descent_leaves() -> None:
    own = tube(margin_per_metre=fmpq(3, 2))
    beta, rate = 0.25, LAW_SHARE * 1.5 / 2  # what the run-time law enforces, at the fastest timing
    flow = solve_ivp(
        lambda _, v: -rate * np.minimum(1, v / beta), (0, 3), [1.0], rtol=1e-10, atol=1e-12, dense_output=True
    )
    for distance in np.linspace(0, 2, 21):
        level = own.level_after(rational(float(distance)))
        assert float(level) == pytest.approx(float(flow.sol(distance)[0]), rel=1e-6)
        back = own.distance_to(level)
        assert back is not None and float(back) == pytest.approx(float(distance), abs=1e-12)
    assert own.level_after(fmpq(10**9)) == own.beta_inner
    assert own.distance_to(fmpq(1)) == own.distance_to(fmpq(3)) == 0
    assert own.distance_to(own.beta_inner) is not None
    assert own.distance_to(own.beta_inner - TINY) is None


def test_handing_over_is_decided_exactly() -> None:
    wide, narrow = tube(), tube("narrow", scale=fmpq(2))
    assert hands_over(wide, narrow, fmpq(1, 2) - TINY)
    assert not hands_over(wide, narrow, fmpq(1, 2))
    assert hands_over(narrow, wide, fmpq(2) - TINY)
    found = needed_distance(wide, narrow, fmpq(1, 2) - TINY)
    assert found is not None and found[0] == fmpq(1, 2) - TINY and found[1] == 2 * (fmpq(1, 2) + TINY)
    assert needed_distance(narrow, wide, fmpq(3, 2)) == (ONE, ZERO)
    assert needed_distance(wide, narrow, fmpq(1, 2)) is None
    assert needed_distance(wide, tube(scale=fmpq(101)), fmpq(1, 102)) is None  # below beta_inner
    # over a jump the level shrinks with (1 − jump)²
    gap = Gap(ZERO, ZERO, ZERO, fmpq(1, 10))
    over = needed_distance(wide, narrow, fmpq(1, 3), gap)
    assert over is not None and over[0] == fmpq(1, 3) * (1 - gap.jump(narrow.shape, narrow.inverse)) ** 2
    assert needed_distance(wide, narrow, fmpq(1, 3), Gap(ZERO, ZERO, ZERO, ONE)) is None


def test_a_chain_is_proven_link_by_link() -> None:
    wide, narrow = tube(), tube("narrow", bounds(fmpq(1, 2)), fmpq(2))
    level = fmpq(1, 2) - TINY
    needed = 1 + 2 * TINY

    def reference(length: fmpq) -> Reference:
        return exact_reference([stated(((1,), (0,)), ((1,), (1,)), breaks=(0, length, 3))])

    runs = [Run(0, 1, wide), Run(1, 2, narrow)]
    (link,) = prove_chain(reference(needed), runs, [level], False)
    assert link.available == link.needed == needed
    with pytest.raises(ValueError, match="tube wide does not hand over to tube narrow"):
        prove_chain(reference(needed - TINY), runs, [level], False)
    with pytest.raises(ValueError, match="does not hand over"):
        prove_chain(reference(needed), runs, [fmpq(1, 2)], False)
    with pytest.raises(ValueError, match=r"segment 0 at theta = 0 s leaves tube narrow"):
        prove_chain(reference(needed), [Run(0, 2, narrow)], [], False)
    for broken in ([Run(0, 1, wide)], [Run(1, 2, wide)], [Run(0, 1, wide), Run(0, 2, wide)]):
        with pytest.raises(ValueError, match="follow each other"):
            prove_chain(reference(needed), broken, [level] * (len(broken) - 1), False)
    with pytest.raises(ValueError, match="expected 1 levels"):
        prove_chain(reference(needed), runs, [], False)
    with pytest.raises(ValueError, match="does not hand over"):  # the end is nowhere near the start
        prove_chain(reference(needed), runs, [level, ONE], True)
    other = dataclasses.replace(narrow, parameters={"wheelbase": ONE})
    with pytest.raises(ValueError, match="one vehicle"):
        prove_chain(reference(needed), [Run(0, 1, wide), Run(1, 2, other)], [level], False)


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
    """Equal funnels, C = 4 I: V ≤ 1 of the first lies in √V < root where root > 1, and by a jump of 1/20 m later."""
    shape = [[fmpq(4 * (i == j)) for j in range(4)] for i in range(4)]
    funnel = FunnelClaim(Contracting(fmpq(0)), shape, fmpq(9, 10), fmpq(9, 10), fmpq(1), None)
    still, jumps = Gap(*(fmpq(0),) * 4), Gap(fmpq(0), fmpq(1, 20), fmpq(0), fmpq(0))  # √C_xx/20 = 1/10
    for gap, root, inside in (
        (still, fmpq(1001, 1000), True),
        (still, fmpq(999, 1000), False),
        (jumps, fmpq(1101, 1000), True),
        (jumps, fmpq(1099, 1000), False),
        (jumps, fmpq(1, 20), False),
    ):
        assert is_entered(funnel, fmpq(1), funnel, gap, root) is inside
