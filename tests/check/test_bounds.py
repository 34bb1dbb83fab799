"""Bounds as a set of references: what lies in what, and what becomes of it on a similar path."""

from dataclasses import replace

from flint import fmpq

from cfcheck.exact.rational import Range
from cfcheck.path.bounds import Bounds
from cfcheck.path.piece import Piece
from tests.by_hand import ONE, TINY, ZERO, bounds, piece


SMOOTH = Bounds((ZERO, ONE), (ONE, fmpq(2)), (-ONE, ONE), (fmpq(-2), fmpq(2)))


def test_one_lies_in_another_where_every_interval_does() -> None:
    assert bounds().lies_in(bounds())
    assert SMOOTH.lies_in(SMOOTH) and SMOOTH.lies_in(replace(SMOOTH, curvature_rate=None))
    assert not replace(SMOOTH, curvature_rate=None).lies_in(SMOOTH)  # its curvature may jump
    for name, (lower, upper) in SMOOTH.intervals.items():
        for wider in ((lower - TINY, upper), (lower, upper + TINY)):
            assert SMOOTH.lies_in(replace(SMOOTH, **{name: wider}))
            assert not replace(SMOOTH, **{name: wider}).lies_in(SMOOTH)


def test_a_single_reference_has_no_width_and_no_change() -> None:
    still = ZERO, ZERO
    one = Bounds((ONE, ONE), (ONE, ONE), still)
    assert one.is_single and replace(one, curvature_rate=still).is_single
    assert not replace(one, curvature_rate=(ONE, ONE)).is_single
    assert not replace(one, speed=(ONE, ONE + TINY)).is_single


def test_a_similar_path_stays_inside_the_similar_bounds_and_no_narrower_ones() -> None:
    """κ = ω/v with ω = 1 + t, v = 2 + t/2: κ' = 3/2 / (2 + t/2)², all four largest or least at an end."""
    own = piece((1, 1), (2, fmpq(1, 2)))
    tight: dict[str, Range] = {
        "curvature": (fmpq(1, 2), fmpq(4, 5)),
        "speed": (fmpq(2), fmpq(5, 2)),
        "acceleration": (fmpq(1, 2), fmpq(1, 2)),
        "curvature_rate": (fmpq(6, 25), fmpq(3, 8)),
    }
    length, speed = fmpq(3), fmpq(5, 7)
    faster = speed / length  # of all that happens
    similar = Piece(
        own.segment,
        ZERO,
        own.duration / faster,
        tuple(c * faster ** (k + 1) for k, c in enumerate(own.turn_rate)),
        tuple(c * speed * faster**k for k, c in enumerate(own.speed)),
        ZERO,
    )
    assert similar.length == length * own.length and similar.turn == own.turn
    assert own.inside(Bounds(**tight)) and similar.inside(Bounds(**tight).scaled(length, speed))
    for name, (lower, upper) in tight.items():
        for narrower in ((lower + TINY, upper), (lower, upper - TINY)):
            given = Bounds(**(tight | {name: narrower}))
            assert not own.inside(given) and not similar.inside(given.scaled(length, speed))
    assert Bounds(**tight).scaled(length, speed).scaled(1 / length, 1 / speed) == Bounds(**tight)
