"""References as claims have them: bounds as a file writes them, one reference in words, what changes along pieces."""

import itertools
from collections.abc import Sequence

from cfcheck.exact.polynomial import evaluate
from cfcheck.exact.rational import Range, about
from cfcheck.path.bounds import Bounds, Extreme
from cfcheck.path.piece import Piece
from cfcheck.reader import Item


BOUNDS, CURVATURE_RATE = ("curvature", "speed", "acceleration"), "curvature_rate"


def place_of(extremes: Sequence[Extreme], index: int) -> str:
    """The extreme reference with this number, in words; empty if there is only one."""
    if len(extremes) == 1:
        return ""
    profile = extremes[index].profile
    curvature = profile["turn_rate"] / profile["speed"]
    changing = (profile["turn_rate_slope"] - curvature * profile["speed_slope"]) / profile["speed"]
    return (
        f"curvature {about(curvature)} 1/m, speed {about(profile['speed'])} m/s, "
        f"acceleration {about(profile['speed_slope'])} m/s^2, "
        + (
            f"curvature rate {about(changing)} 1/(m s), "
            if any(each.profile["turn_rate_slope"] for each in extremes)
            else ""
        )
    )


def read_bounds(item: Item) -> Bounds:
    """Intervals of curvature (1/m), speed (m/s) and acceleration (m/s²).

    Raises:
        Unreadable: says what was expected where.
    """
    return _bounds(item.record(*BOUNDS))


def read_stretch_bounds(item: Item) -> Bounds:
    """The same for a stretch of a path, with the rate of its curvature, 1/(m s), if that is bounded."""
    if isinstance(item.value, dict) and CURVATURE_RATE in item.value:
        return _bounds(item.record(*BOUNDS, CURVATURE_RATE))
    return read_bounds(item)


def _bounds(entries: Sequence[Item]) -> Bounds:
    found: list[Range] = []
    for entry in entries:
        lower, upper = (end.rational() for end in entry.items(2, 2))
        if lower > upper:
            entry.refuse("an interval, lower end first")
        found.append((lower, upper))
    if not found[BOUNDS.index("speed")][0] > 0:
        entries[BOUNDS.index("speed")].refuse("speeds above zero")
    return Bounds(**dict(zip((*BOUNDS, CURVATURE_RATE), found, strict=False)))


def are_steady(pieces: Sequence[Piece]) -> bool:
    """Whether turning rate and speed are written as one number each, the same in all of them."""
    first = pieces[0]
    return all(
        piece.is_constant and (piece.turn_rate, piece.speed) == (first.turn_rate, first.speed) for piece in pieces
    )


def turning_jumps(pieces: Sequence[Piece]) -> bool:
    """Whether the turning rate jumps between two successive pieces."""
    return any(jumps_in_turning(one, other) for one, other in itertools.pairwise(pieces))


def jumps_in_turning(before: Piece, after: Piece) -> bool:
    """Whether the turning rate at the start of the second piece differs from that at the end of the first."""
    return evaluate(before.turn_rate, before.duration) != after.turn_rate[0]
