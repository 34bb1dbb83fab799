"""Bounds of curvature, speed and acceleration along a path, proven, and rounded outwards to short decimals."""

import itertools
from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal

from flint import fmpq

from cfcheck.exact.rational import Range, float_below, rational
from cfcheck.kernel.legs import Leg
from cfcheck.path.bounds import Bounds
from cfcheck.path.piece import Piece
from cfjax.certificate.stretches import bounded


STEP = Decimal("1e-6")  # to which bounds are rounded
# curvatures to both sides less unequal than this are taken as equal: mirror images are half the proof
ALIKE = fmpq(1, 2)


def bounds_of_pieces(pieces: Sequence[Piece]) -> Bounds:
    """The hull of what the pieces do, whichever segments they are of.

    Raises:
        ValueError: where none is found: the speed is not positive, say.
    """
    segments = itertools.groupby(pieces, key=lambda piece: piece.segment)
    return _hull_of([list(group) for _, group in segments])


def _hull_of(stretches: Sequence[Sequence[Piece]]) -> Bounds:
    """Of stretches, along each of which θ goes on."""
    found = [bounded(own, own[0].theta, own[-1].theta + own[-1].duration).bounds for own in stretches]
    curvature, speed, acceleration = map(_hull, zip(*(bounds.intervals.values() for bounds in found), strict=True))
    widest = max(-curvature[0], curvature[1])
    if min(-curvature[0], curvature[1]) > ALIKE * widest:
        curvature = -widest, widest
    return Bounds(curvature, speed, acceleration)


def bounds_along(legs: Sequence[Leg], within: Bounds) -> Bounds:
    """What the path does along all of these legs; nothing that is not within the bounds of their funnel.

    Raises:
        ValueError: as `bounds_of_pieces`.
    """
    bounds = _hull_of([leg.pieces for leg in legs])
    return Bounds(**{name: _meet(ends, within.intervals[name]) for name, ends in bounds.intervals.items()})


def _meet(first: Range, second: Range) -> Range:
    return max(first[0], second[0]), min(first[1], second[1])


def _hull(ranges: Sequence[Range]) -> Range:
    lower, upper = min(low for low, _ in ranges), max(high for _, high in ranges)

    def outwards(value: fmpq, rounding: str) -> fmpq:
        if rational(float_below(value)) == value:  # a decimal: one speed stays one speed
            return value
        exact = Decimal(int(value.p)) / Decimal(int(value.q))
        return rational(float(exact.quantize(STEP, rounding=rounding)))

    return outwards(lower, ROUND_FLOOR), outwards(upper, ROUND_CEILING)
