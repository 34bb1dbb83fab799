"""A path in exact numbers: what its floating-point profiles stand for, as the checker reads them.

Decimals are taken as they print. Speeds are made continuous along each segment by the constant terms of later pieces,
poses follow by integration from the first one (`cfjax.check.reference`).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from flint import fmpq

from cfjax.check.rational import rational
from cfjax.check.reference import (
    ExactPose,
    Piece,
    Reference,
    StatedProfile,
    StatedSegment,
    check_start,
    exact_reference,
)
from cfjax.errors import InputError
from cfjax.problem.path import Path, Segment


def exact_numbers(numbers: Sequence[float]) -> tuple[fmpq, ...]:
    return tuple(rational(float(number)) for number in numbers)


def stated(segment: Segment) -> StatedSegment:
    """The segment as it is written down, in rationals."""
    alpha, x, y = exact_numbers(segment.start)
    breaks = exact_numbers(segment.turn_rate.breaks)
    same = segment.turn_rate.breaks == segment.speed.breaks
    return StatedSegment(
        StatedProfile(breaks, tuple(map(exact_numbers, segment.turn_rate.coefficients))),
        StatedProfile(
            breaks if same else exact_numbers(segment.speed.breaks),
            tuple(map(exact_numbers, segment.speed.coefficients)),
        ),
        (alpha, x, y),
    )


def exact_course(path: Path) -> Reference:
    """The path that is proven: each segment's profile by itself, so that equal segments stay equal.

    Raises:
        InputError: where a segment does not start (1e-6 rad, 1e-6 m) where the one before ends.
    """
    pieces: list[Piece] = []
    arc = fmpq(0)
    statements = [stated(segment) for segment in path.curve]
    try:
        for index, statement in enumerate(statements):
            own = exact_reference([statement])
            pieces += [replace(piece, segment=index, arc=arc + piece.arc) for piece in own.pieces]
            arc += own.length
        start = exact_reference(statements[:1]).start
        reference = Reference(tuple(pieces), ExactPose(start.heading, start.position))
        for index, statement in enumerate(statements[1:], start=1):
            check_start(index, statement.start, reference.poses[index])
    except ValueError as error:
        raise InputError(f"path {path.name}: {error}") from None
    return reference


def write_pieces(pieces: Sequence[Piece]) -> list[dict[str, Any]]:
    """A path in exact numbers."""
    return [
        {
            "segment": piece.segment,
            "duration": str(piece.duration),
            "turn_rate": [str(c) for c in piece.turn_rate],
            "speed": [str(c) for c in piece.speed],
        }
        for piece in pieces
    ]
