"""Walls, and that a path begins between two of them: a corridor.

Clearance says that the body touches no wall. That it is between them is said of the path's start, for nothing that
moves continuously without touching walls comes out: from the reference's place a straight line leads to a point of the
left wall, to the left of its heading, and one to a point of the right wall, to the right; neither meets a wall of the
corridor before. One more leads to the centre of each disc of the body. Where both walls are closed, the reference's
place lies inside exactly one of them, by the number of edges that a ray crosses: there the car stays for ever.

Frames and units: m in the inertial frame; at heading α the axis to the right is (cos α, sin α).
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from flint import acb, arb, fmpq

from cfcheck.clearance.half_plane import FootprintClaim
from cfcheck.exact.enclosure import Budget
from cfcheck.exact.rational import rational
from cfcheck.path.reference import ExactPose
from cfcheck.reader import Broken


SIDES = ("left", "right")
RAYS = ((1009, 463), (-463, 1009), (331, 977), (-1013, 127))  # along one of them no two points are alike, in most files
Point = tuple[fmpq, fmpq]
Edge = tuple[Point, Point]


class WallClaim(NamedTuple):
    """A polyline (m) through two points or more; of a corridor it is the wall on that side."""

    points: tuple[Point, ...]
    side: str | None = None

    @property
    def edges(self) -> tuple[Edge, ...]:
        """Pairs of points that follow each other."""
        return tuple(itertools.pairwise(self.points))

    @property
    def is_closed(self) -> bool:
        """Whether it ends where it begins."""
        return self.points[0] == self.points[-1]


def are_closed(corridor: Sequence[WallClaim]) -> bool:
    """Whether there is a corridor, and it has no ends."""
    return bool(corridor) and all(wall.is_closed for wall in corridor)


def prove_between(
    corridor: Sequence[WallClaim], footprint: Sequence[FootprintClaim], start: ExactPose, budget: Budget
) -> None:
    """Proves that the reference and the body's discs begin between the walls of a corridor; nothing without any.

    Raises:
        Broken: says what is not proven.
    """
    place, facing = start.position, acb(0, arb(start.heading)).exp()
    edges = [edge for wall in corridor for edge in wall.edges]
    budget.spend((len(corridor) + len(footprint) + len(RAYS)) * len(edges))
    for wall in corridor:
        if not _is_beside(place, facing if wall.side == "right" else -facing, wall, edges):
            raise Broken(
                f"corridor: it is not proven that its {wall.side} wall is to the {wall.side} of where it begins"
            )
    for disc in footprint if corridor else ():
        centre = place + disc.offset * facing * acb(0, 1)
        if disc.offset and not all(_are_apart((place, centre), edge) for edge in _close(place, centre, edges)):
            raise Broken("corridor: it is not proven that the whole body begins between its walls")
    if are_closed(corridor) and sum(_surrounds(wall, place) for wall in corridor) != 1:
        raise Broken("corridor: the path does not begin inside one of its walls and outside the other")


def _is_beside(place: acb, aside: acb, wall: WallClaim, edges: Sequence[Edge]) -> bool:
    """Whether a straight line leads from a place to that side, to a point of the wall, and meets no edge before."""
    point = _nearest(place, aside, wall)
    if point is None:
        return False
    end = _complex(point)
    return bool(((end - place) * aside.conjugate()).real > 0) and all(
        _is_end(place, point, edge) or _are_apart((place, end), edge) for edge in _close(place, end, edges)
    )


def _nearest(place: acb, aside: acb, wall: WallClaim) -> Point | None:
    """The wall's nearest point on a side of a place, as far as floating point tells: on the wall exactly."""
    x, y, u, v = (float(part.mid()) for part in (place.real, place.imag, aside.real, aside.imag))
    try:
        points = [(float(x), float(y)) for x, y in wall.points]
    except OverflowError:
        return None
    found, least = None, math.inf
    for index, ((ax, ay), (bx, by)) in enumerate(itertools.pairwise(points)):
        along = (bx - ax) ** 2 + (by - ay) ** 2
        share = min(max(((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / along, 0.0), 1.0) if along else 0.0
        dx, dy = ax + share * (bx - ax) - x, ay + share * (by - ay) - y
        if u * dx + v * dy > 0 and dx * dx + dy * dy < least:
            found, least = (index, share), dx * dx + dy * dy
    if found is None:
        return None
    (ax, ay), (bx, by) = wall.edges[found[0]]
    share = rational(found[1])
    return ax + share * (bx - ax), ay + share * (by - ay)


def _complex(point: Point) -> acb:
    return acb(arb(point[0]), arb(point[1]))


def _is_end(place: acb, point: Point, edge: Edge) -> bool:
    """Whether a point lies on an edge, which surely has nothing else of the straight line from a place to the point."""
    (ax, ay), (bx, by) = edge
    if (bx - ax) * (point[1] - ay) != (by - ay) * (point[0] - ax):
        return False
    if not (min(ax, bx) <= point[0] <= max(ax, bx) and min(ay, by) <= point[1] <= max(ay, by)):
        return False
    turned = ((_complex(edge[1]) - _complex(edge[0])).conjugate() * (place - _complex(edge[0]))).imag
    if turned > 0 or turned < 0:
        return True
    back = place - _complex(point)
    others = [(x - point[0], y - point[1]) for x, y in edge if (x, y) != point]
    return all((_complex(other) * back.conjugate()).real < 0 for other in others)


def _close(first: acb, second: acb, edges: Sequence[Edge]) -> Iterator[Edge]:
    """Edges whose box may meet that of the straight line between two places."""
    x, y = first.real.union(second.real), first.imag.union(second.imag)
    left, right, low, high = (end.mid().fmpq() for end in (x.lower(), x.upper(), y.lower(), y.upper()))
    for (ax, ay), (bx, by) in edges:
        across = (ax <= right or bx <= right) and (ax >= left or bx >= left)
        if across and (ay <= high or by <= high) and (ay >= low or by >= low):
            yield (ax, ay), (bx, by)


def _are_apart(line: tuple[acb, acb], edge: Edge) -> bool:
    """Whether two straight lines surely have no point in common: an axis separates them."""
    other = _complex(edge[0]), _complex(edge[1])
    along, across = line[1] - line[0], other[1] - other[0]
    for axis in (along * acb(0, 1), across * acb(0, 1), along):
        own, beside = ([(axis.conjugate() * end).real for end in ends] for ends in (line, other))
        if all(a < b for a in own for b in beside) or all(b < a for a in own for b in beside):
            return True
    return False


def _surrounds(wall: WallClaim, place: acb) -> bool:
    """Whether a place is inside a closed wall: a ray from there crosses an odd number of its edges.

    Raises:
        Broken: no ray tells, for the place is on the wall, or points of it are, as far as balls tell.
    """
    points = [_complex(point) - place for point in wall.points]
    for x, y in RAYS:
        crossed = _crossed([point * acb(x, -y) for point in points])
        if crossed is not None:
            return crossed % 2 == 1
    raise Broken("corridor: it is not decided which side of a wall the path begins on")


def _crossed(points: Sequence[acb]) -> int | None:
    """How many edges of a polyline cross the positive real axis; None where balls do not tell."""
    count = 0
    for a, b in itertools.pairwise(points):
        if not all(end.imag > 0 or end.imag < 0 for end in (a, b)):
            return None
        if (a.imag > 0) != (b.imag > 0):
            turned = (a.conjugate() * b).imag  # positive where the edge leads around zero to the left
            if not (turned > 0 or turned < 0):
                return None
            count += bool(turned > 0) == bool(b.imag > 0)
    return count
