"""Points as they follow each other: repeated ones merged, and whether they are a lap."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex
from scipy.spatial import KDTree

from cfjax.errors import InputError
from cfjax.problem.points import LONGEST, SHORTEST, Points, as_rows, at, metres


MERGED = 1e-9  # of the extent of all points: closer ones are one point
REPEATED = 0.05  # of the median distance of neighbours: a last point that is nearer to the first one repeats it
MEETING = 0.5  # so near it repeats the first one too, if the path ends in the direction in which it begins
FOLLOWING = 1.5  # so near the first point is the next one, if that is straight ahead
BESIDE = 0.25  # so near a path runs over its beginning
AHEAD = math.pi / 4  # rad
MOST_BETWEEN = 50  # points between two, on average, where a path is compared with its beginning


class Route(NamedTuple):
    """Points that differ from the one before; of a lap without the first one at its end again."""

    points: Points
    closed: bool
    account: str  # "closed (gap 0.9 mm)", for people


def route_of(points: Points, closed: bool | None) -> Route:
    """Points that differ from the one before, and whether they are a lap: None decides by where they end."""
    place = points.place
    if len(place) == 1:
        raise InputError(f"{points.at(0)}: expected at least two points, got one")
    same = MERGED * float(np.abs(place - place[0]).max())
    if same == 0:
        raise InputError(f"{points.source}: expected points that differ, all {len(place)} are {at(place[0])}")
    length = float(np.abs(np.diff(place)).sum())
    if not SHORTEST <= length <= LONGEST:
        raise InputError(
            f"{points.source}: expected points in m, between {SHORTEST:g} and {LONGEST:g} m along them, got "
            f"{length:.4g} m: say their unit, as in x_mm,y_mm, in the header or by path.columns=[x_mm,y_mm]"
        )
    keep = [0]
    for index in range(1, len(place)):
        if abs(place[index] - place[keep[-1]]) > same:
            keep.append(index)
    points = points.chosen(np.array(keep))
    if closed is False:
        count, account = len(keep), f"open (ends {metres(abs(points.place[-1] - points.place[0]))} apart)"
    else:
        count, account = _lap(points.place, same)
        if closed and count == 0:
            count, account = len(keep), f"closed (gap {metres(abs(points.place[-1] - points.place[0]))})"
    if closed is None:
        closed = count > 0
    if count == 0:
        gap = abs(points.place[-1] - points.place[0])
        count, account = len(keep), f"open (ends {metres(gap)} apart)"
    if closed and count < 3:
        raise InputError(f"{points.source}: expected at least three different points of a closed path, got {count}")
    return Route(points.chosen(np.arange(count)), closed, account)


def _lap(place: Complex[np.ndarray, " n"], same: float) -> tuple[int, str]:
    """How many of the points are one lap, the rest repeating its beginning, and how it closes; 0 where none does."""
    first, last = place[0], place[-1]
    gap, chords = abs(last - first), np.abs(np.diff(place))
    spacing = float(np.median(chords))
    if beyond := _beyond(place[:-1] if gap <= MEETING * spacing else place, spacing):
        extra = float(chords[beyond - 1 :].sum() - abs(first - place[beyond - 1]))
        kept = beyond - 1 if abs(place[beyond - 1] - first) <= BESIDE * spacing else beyond
        return kept, f"closed (runs {metres(max(extra, 0.0))} beyond its start, which is cut off)"
    if gap <= same:
        return len(place) - 1, "closed"
    if gap <= REPEATED * spacing:
        return len(place) - 1, f"closed (gap {metres(gap)})"
    if len(place) < 4:
        return 0, ""
    begins, ends = _direction(place), _direction(place[::-1]) * -1
    if gap <= MEETING * spacing and _turn(ends, begins) <= AHEAD:
        return len(place) - 1, f"closed (gap {metres(gap)})"
    joint = first - last
    straight = max(_turn(place[-1] - place[-2], joint), _turn(joint, place[1] - place[0])) <= AHEAD
    if gap <= FOLLOWING * max(spacing, min(chords[0], chords[-1])) and straight:
        return len(place), f"closed (gap {metres(gap)}, the first point follows the last)"
    return 0, ""


def _beyond(place: Complex[np.ndarray, " n"], spacing: float) -> int:
    """The first point that comes after the first one again, where all that follow run over the beginning; else 0."""
    near = BESIDE * spacing
    begin, step = place[:-1], np.diff(place)
    part = np.clip(((place[0] - begin) * np.conj(step)).real / np.abs(step) ** 2, 0.0, 1.0)
    passes = np.abs(place[0] - begin - part * step) <= near
    passes &= np.abs(np.angle(step * np.conj(place[1] - place[0]))) <= AHEAD
    away = np.flatnonzero(np.abs(place - place[0]) > 2 * spacing)
    if not len(away):
        return 0
    passes[: away[0]] = False
    if not passes.any():
        return 0
    after = int(passes.argmax()) + 1
    known = _filled(np.append(place[:after], place[0]), near)
    away = KDTree(as_rows(known)).query(as_rows(place[after:]))[0] if len(known) else np.array([np.inf])
    return after if away.max() <= 1.5 * near else 0


def _filled(place: Complex[np.ndarray, " n"], step: float) -> Complex[np.ndarray, " m"]:
    """Points along the straight lines between points, no farther apart; none, where that were too many."""
    count = np.maximum(1, np.ceil(np.abs(np.diff(place)) / step)).astype(int)
    if count.sum() > MOST_BETWEEN * len(place):
        return place[:0]
    own = np.concatenate([[0], np.cumsum(count)])
    return np.interp(np.arange(own[-1] + 1), own, place)


def _direction(place: Complex[np.ndarray, " n"]) -> complex:
    """In which the points begin: over the first few of them, so that noise says little."""
    return complex(place[min(3, len(place) - 1)] - place[0])


def _turn(before: complex, after: complex) -> float:
    return abs(float(np.angle(after * np.conj(before))))
