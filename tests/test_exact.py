"""What a path states in exact numbers: speeds continued, segments that meet, breaks merged; jumps are refused."""

import math

import pytest
from flint import fmpq

from cfjax.exact import StatedProfile, StatedSegment, exact_reference
from tests.by_hand import ONE, ZERO, stated


def test_speeds_are_continued_exactly() -> None:
    segment = stated(((0,), (0,)), ((1, "0.1"), ("1.1000000001", "0.1")), breaks=(0, 1, 2))
    reference = exact_reference([segment])
    assert reference.pieces[1].speed == (fmpq(11, 10), fmpq(1, 10))
    assert reference.length == fmpq(11, 5)
    jump = stated(((0,), (0,)), ((1, "0.1"), ("1.100000002", "0.1")), breaks=(0, 1, 2))
    with pytest.raises(ValueError, match=r"speed jumps by 2e-09 m/s at theta = 1 s of segment 0"):
        exact_reference([jump])
    with pytest.raises(ValueError, match=r"speed jumps by 1 m/s at theta = 0 s of segment 1, from 1 to 2"):
        exact_reference([stated(((0,),), ((1,),)), stated(((0,),), ((2,),), start=(0, 0, 1))])


def test_segments_have_to_meet() -> None:
    first = stated(((0,),), ((1,),))
    exact_reference([first, stated(((0,),), ((1,),), start=("5e-7", "5e-7", 1))])
    exact_reference([first, stated(((0,),), ((1,),), start=(2 * math.pi, 0, 1))])
    with pytest.raises(ValueError, match=r"heading jumps by .* rad between segments 0 and 1"):
        exact_reference([first, stated(((0,),), ((1,),), start=("2e-6", 0, 1))])
    with pytest.raises(ValueError, match=r"segment 1 starts 0.00000200\d* m away from where segment 0 ends"):
        exact_reference([first, stated(((0,),), ((1,),), start=(0, "2e-6", 1))])


def test_profiles_with_different_breaks_are_merged() -> None:
    turn_rate = StatedProfile((ZERO, fmpq(1, 3), fmpq(2)), ((fmpq(1), fmpq(2)), (fmpq(5), fmpq(-1))))
    speed = StatedProfile((ZERO, fmpq(1), fmpq(2)), ((fmpq(1), fmpq(1, 2)), (fmpq(3, 2), ZERO, fmpq(1))))
    reference = exact_reference([StatedSegment(turn_rate, speed, (ZERO, ZERO, ZERO))])
    assert [p.theta for p in reference.pieces] == [ZERO, fmpq(1, 3), fmpq(1)]
    assert reference.pieces[1].turn_rate == (fmpq(5), fmpq(-1))
    assert reference.pieces[2].turn_rate == (fmpq(13, 3), fmpq(-1))
    assert reference.pieces[1].speed == (fmpq(7, 6), fmpq(1, 2))
    assert reference.pieces[2].speed == (fmpq(3, 2), ZERO, ONE)
    assert reference.length == fmpq(5, 4) + fmpq(3, 2) + fmpq(1, 3)
