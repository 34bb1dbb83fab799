"""Headings and the jump at the end of a lap, against points of the ellipsoid and at the edge of what is a lap."""

import math

import numpy as np
import pytest
from flint import fmpq, fmpq_mat

from cfcheck.exact.rational import rational
from cfcheck.path.reference import Gap, heading_gap, is_closed
from cfjax.exact import exact_reference
from tests.by_hand import ONE, TINY, ZERO, stated, tube


def test_headings_are_compared_modulo_full_turns() -> None:
    assert heading_gap(rational(math.pi), rational(-math.pi)) < fmpq(1, 10**15)
    assert float(heading_gap(rational(2000 * math.pi + 0.25), ZERO)) == pytest.approx(0.25)
    assert float(heading_gap(rational(-0.25), rational(4 * math.pi))) == pytest.approx(0.25)
    assert heading_gap(fmpq(1), fmpq(1)) < fmpq(1, 10**30)


LONG_AXES = (fmpq(1, 10**4), ONE, fmpq(1, 100), fmpq(1, 100))  # 10 m forward, little weight on the heading
LONG = [[axis if i == j else ZERO for j in range(4)] for i, axis in enumerate(LONG_AXES)]


@pytest.mark.parametrize(
    ("changes", "gap", "tightness"),
    [
        ({}, Gap(fmpq(3, 100), fmpq(1, 100), fmpq(2, 100), fmpq(1, 100)), 0.3),
        ({"shape": LONG}, Gap(fmpq(1, 100), ZERO, ZERO, ZERO), 0.03),  # what is far away swings far
    ],
)
def test_no_deviation_jumps_further_than_the_bound(changes: dict, gap: Gap, tightness: float) -> None:
    rng = np.random.default_rng(0)
    own = tube(**changes)
    shape = np.array([[float(entry) for entry in row] for row in own.shape])
    root = np.linalg.inv(np.linalg.cholesky(shape)).T
    bound, worst = float(gap.jump(own.shape, own.inverse)), 0.0
    for _ in range(2000):
        x = root @ (lambda d: d / np.linalg.norm(d))(rng.normal(size=4))
        delta, lateral, forward, speed = rng.choice([-1, 1], 4) * np.array([float(part) for part in gap])
        turn = np.array([[math.cos(delta), -math.sin(delta)], [math.sin(delta), math.cos(delta)]])
        after = np.array([x[0] + delta, *(turn @ x[1:3] + [lateral, forward]), x[3] + speed])
        worst = max(worst, abs(math.sqrt(after @ shape @ after) - 1))
    assert tightness * bound < worst <= bound


def test_where_no_pose_jumps_states_need_not_hold_one() -> None:
    stays = Gap(ZERO, ZERO, ZERO, ZERO)
    for size in (1, 2, 5):
        shape = [[ONE * (i == j) for j in range(size)] for i in range(size)]
        assert stays.jump(shape, fmpq_mat(shape).inv()) == 0


def test_a_lap_is_closed_by_pose_and_speed() -> None:
    limits = Gap(fmpq(1, 10**6), fmpq(1, 10**6), fmpq(1, 10**6), fmpq(1, 10**9))
    assert is_closed(limits)
    for k in range(4):
        assert not is_closed(Gap(*(part * (1 + TINY * (i == k)) for i, part in enumerate(limits))))


def test_lap_gap_is_in_the_body_frame_of_the_start() -> None:
    for heading in (0.3, math.pi / 2):  # one metre forward
        gap = exact_reference([stated(((0,),), ((1,),), start=(heading, 5, 6))]).gap
        assert gap.lateral < fmpq(1, 10**15) and float(gap.forward) == pytest.approx(1)
    reference = exact_reference([stated(((0,),), ((1,),), start=(math.pi / 2, 5, 6))])
    end = reference.poses[-1].position
    assert float(end.real) == pytest.approx(4) and float(end.imag) == pytest.approx(6)
