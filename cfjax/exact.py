"""A path in exact numbers: what its floating-point profiles stand for, as the checker reads them.

Decimals are taken as they print, which leaves the pieces of a spline a rounding apart. Speeds are made continuous by
the constant terms of later pieces, poses follow by integration from the first one (`cfcheck.path.reference`); what
misses by more than rounding is refused.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from flint import acb, arb, fmpq

from cfcheck.clearance.half_plane import FootprintClaim, ObstacleClaim
from cfcheck.clearance.surroundings import ClearanceHints, SurroundingsClaim, WallClaim
from cfcheck.exact.polynomial import Coefficients, evaluate, shifted
from cfcheck.exact.rational import decimal_text, rational, upper_bound
from cfcheck.path.bounds import Bounds
from cfcheck.path.piece import Piece
from cfcheck.path.reference import LARGEST_POSE_GAP, LARGEST_SPEED_GAP, ExactPose, Reference, heading_gap
from cfjax.errors import InputError
from cfjax.problem import FootprintDisc, Interval, Obstacle, Tube, Wall
from cfjax.problem.path import Path, Segment


LARGEST_GAP = LARGEST_SPEED_GAP  # m/s and rad/s: rounding of a spline's coefficients


def exact_numbers(numbers: Sequence[float]) -> tuple[fmpq, ...]:
    """Each as the decimal that it prints as."""
    return tuple(rational(float(number)) for number in numbers)


def tube_within(bounds: Bounds) -> Tube:
    """Every path within bounds that are given in exact numbers, in floating-point ones."""
    return Tube(**{name: Interval(float(lower), float(upper)) for name, (lower, upper) in bounds.intervals.items()})


def exact_bounds(tube: Tube) -> Bounds:
    """The bounds of a tube in exact numbers, each end as the decimal that it prints as."""
    intervals = tube.curvature, tube.speed, tube.acceleration
    return Bounds(*((rational(float(ends.lower)), rational(float(ends.upper))) for ends in intervals))


def exact_surroundings(obstacles: Sequence[Obstacle], footprint: Sequence[FootprintDisc]) -> SurroundingsClaim:
    """Obstacles in convex parts, walls, and the body that has to clear them; without any of them no body either."""
    if not obstacles:
        return SurroundingsClaim()
    solid = (hull for each in obstacles if not isinstance(each, Wall) for hull in each.hulls)
    return SurroundingsClaim(
        tuple(ObstacleClaim(_points(hull.corners), rational(hull.round)) for hull in solid),
        tuple(FootprintClaim(*exact_numbers(disc)) for disc in footprint),
        tuple(WallClaim(_points(each.points)) for each in obstacles if isinstance(each, Wall)),
    )


def _points(points: Sequence[tuple[float, float]]) -> tuple[tuple[fmpq, fmpq], ...]:
    return tuple((rational(x), rational(y)) for x, y in points)


@dataclass(frozen=True)
class StatedProfile:
    """A piecewise polynomial: `coefficients[k]` in ascending powers of θ − breaks[k] (s)."""

    breaks: tuple[fmpq, ...]
    coefficients: tuple[Coefficients, ...]

    def __post_init__(self) -> None:
        ascending = all(a < b for a, b in zip(self.breaks, self.breaks[1:], strict=False))
        if len(self.breaks) != len(self.coefficients) + 1 or not ascending or not all(self.coefficients):
            raise ValueError("a profile needs increasing breaks, one more than pieces, and coefficients in each")

    @property
    def first(self) -> fmpq:
        """Its value where it begins."""
        return self.coefficients[0][0]


class StatedSegment(NamedTuple):
    """A stretch of path as it is written down: ω_r in rad/s, v_r in m/s, start pose (α in rad, x and y in m)."""

    turn_rate: StatedProfile
    speed: StatedProfile
    start: tuple[fmpq, fmpq, fmpq]


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


def exact_reference(segments: Sequence[StatedSegment], turn_rate_after: fmpq | None = None) -> Reference:
    """The reference that a chain of segments states.

    Speed is made continuous by the constant terms of later pieces, and so is the turning rate where it jumps by
    rounding alone; poses by integrating from the first one.

    Raises:
        ValueError: where the speed jumps by more than 1e-9 m/s, or a later segment does not start (1e-6 rad, 1e-6 m)
            where the one before ends.
    """
    pieces: list[Piece] = []
    arc = fmpq(0)
    for index, segment in enumerate(segments):
        breaks = segment.turn_rate.breaks, segment.speed.breaks
        if breaks[0][0] != 0 or breaks[1][0] != 0 or breaks[0][-1] != breaks[1][-1]:
            raise ValueError(f"segment {index}: turn rate and speed need the same range of theta, from 0")
        before = pieces[-1] if pieces else None
        speed = _continuous(index, segment.speed, before)
        turn = _joined(
            segment.turn_rate,
            evaluate(before.turn_rate, before.duration) if before else None,
            segments[index + 1].turn_rate.first if index + 1 < len(segments) else turn_rate_after,
        )
        ends = breaks[0] if breaks[0] == breaks[1] else sorted({*breaks[0], *breaks[1]})
        turning = moving = 0
        for begin, end in itertools.pairwise(ends):
            turning += breaks[0][turning + 1] <= begin
            moving += breaks[1][moving + 1] <= begin
            turn_rate = shifted(turn[turning], begin - breaks[0][turning])
            piece = Piece(index, begin, end - begin, turn_rate, shifted(speed[moving], begin - breaks[1][moving]), arc)
            pieces.append(piece)
            arc += piece.length
    heading, x, y = segments[0].start
    reference = Reference(tuple(pieces), ExactPose(heading, acb(arb(x), arb(y))))
    if len(segments) > 1:
        for index, segment in enumerate(segments[1:], start=1):
            _check_start(index, segment.start, reference.poses[index])
    return reference


def exact_course(path: Path) -> Reference:
    """The path that is proven: each segment's profile by itself, so that equal segments stay equal.

    One ends at the turning rate with which the next one of the path begins, where these differ by rounding alone.

    Raises:
        InputError: where a segment does not start (1e-6 rad, 1e-6 m) where the one before ends.
    """
    pieces: list[Piece] = []
    arc = fmpq(0)
    statements = [stated(segment) for segment in path.curve]
    try:
        for index, (statement, kind) in enumerate(zip(statements, path.kinds, strict=True)):
            after = path.kinds.index(kind) + 1  # of the first of its kind
            follower = statements[after % len(statements)] if after < len(statements) or path.closed else None
            own = exact_reference([statement], follower and follower.turn_rate.first)
            pieces += [replace(piece, segment=index, arc=arc + piece.arc) for piece in own.pieces]
            arc += own.length
        start = exact_reference(statements[:1]).start
        reference = Reference(tuple(pieces), ExactPose(start.heading, start.position))
        for index, statement in enumerate(statements[1:], start=1):
            _check_start(index, statement.start, reference.poses[index])
    except ValueError as error:
        raise InputError(f"path {path.name}: {error}") from None
    return reference


def _continuous(index: int, profile: StatedProfile, before: Piece | None) -> list[Coefficients]:
    """The speed's coefficients with constant terms that continue the piece before, exactly."""
    value = before.end_speed if before else profile.first
    joined = _joined(profile, value)
    for begin, end, coefficients in zip(profile.breaks, profile.breaks[1:], joined, strict=False):
        meant = coefficients[0]
        if meant != value:
            raise ValueError(
                f"speed jumps by {float(meant - value):.6g} m/s at theta = {float(begin):.6g} s of segment {index}, "
                f"from {float(value):.6g} to {float(meant):.6g} m/s: expected a continuous speed"
            )
        value = evaluate(coefficients, end - begin)
    return joined


def _joined(profile: StatedProfile, before: fmpq | None, after: fmpq | None = None) -> list[Coefficients]:
    """The coefficients of pieces that continue each other exactly, where they do but for rounding.

    So do what is there before them and after them, where it is given: the first by constant terms, as between pieces,
    the other one by the slope of the last piece, if it has one.
    """
    value = profile.first if before is None else before
    found = []
    for begin, end, (meant, *higher) in zip(profile.breaks, profile.breaks[1:], profile.coefficients, strict=False):
        found.append((value if abs(meant - value) <= LARGEST_GAP else meant, *higher))
        value = evaluate(found[-1], end - begin)
    if after is not None and abs(after - value) <= LARGEST_GAP and len(found[-1]) > 1:
        constant, slope, *higher = found[-1]
        found[-1] = (constant, slope + (after - value) / (profile.breaks[-1] - profile.breaks[-2]), *higher)
    return found


def _check_start(index: int, start: tuple[fmpq, fmpq, fmpq], pose: ExactPose) -> None:
    """Raises ValueError where a segment does not start where the one before ends."""
    heading, x, y = start
    turn = heading_gap(heading, pose.heading)
    if turn > LARGEST_POSE_GAP:
        raise ValueError(
            f"heading jumps by {decimal_text(turn)} rad between segments {index - 1} and {index}: no car follows a "
            f"corner, expected the segments to meet with one heading"
        )
    apart = upper_bound(abs(acb(arb(x), arb(y)) - pose.position))
    if apart > LARGEST_POSE_GAP:
        raise ValueError(
            f"segment {index} starts {decimal_text(apart)} m away from where segment {index - 1} ends: expected the "
            f"same place"
        )


def write_path(path: Path, pieces: Sequence[Piece], closed: bool) -> dict[str, Any]:
    """A path whose pieces in exact numbers are these; closed: one lap, driven again and again."""
    return {
        "name": path.name,
        "closed": closed,
        "start": [str(value) for value in exact_numbers(path.curve[0].start)],
        "pieces": [
            {
                "duration": str(piece.duration),
                "turn_rate": [str(c) for c in piece.turn_rate],
                "speed": [str(c) for c in piece.speed],
            }
            for piece in pieces
        ],
    }


def write_surroundings(surroundings: SurroundingsClaim) -> dict[str, Any]:
    """Obstacles and walls, and the discs of the body."""
    return {
        "obstacles": [
            {"corners": [[str(x), str(y)] for x, y in obstacle.corners], "round": str(obstacle.round)}
            for obstacle in surroundings.obstacles
        ]
        + [{"wall": [[str(x), str(y)] for x, y in wall.points]} for wall in surroundings.walls],
        "footprint": [{"radius": str(disc.radius), "offset": str(disc.offset)} for disc in surroundings.footprint],
    }


def write_clearance(clearance: ClearanceHints) -> list:
    """Stretches of each leg, with normals."""
    return [
        [{"end": str(stretch.end), "normals": [list(normal) for normal in stretch.normals]} for stretch in leg]
        for leg in clearance
    ]
