"""Obstacles and the body that has to clear them: what a file says of both, and the proof along every leg of a path.

The proof goes along every leg, with the funnel that holds there (`cfjax.check.clearance`).
"""

from collections.abc import Sequence
from typing import NamedTuple

from cfjax.check.clearance import FootprintClaim, HalfPlane, ObstacleClaim, Shadow, prove_clearance
from cfjax.check.enclosure import Budget
from cfjax.check.legs import Leg
from cfjax.check.reader import Broken, Item


MOST_OBSTACLES, MOST_CORNERS, MOST_DISCS, MOST_HALF_PLANES = 64, 32, 8, 200
CLEARANCE_EFFORT = 2**23  # of all half-planes of a file: half a minute

HalfPlanes = tuple[HalfPlane, ...]
Clearance = tuple[tuple[tuple[HalfPlanes, ...], ...], ...]  # by leg, obstacle and disc of the footprint


class Surroundings(NamedTuple):
    """Obstacles, and the discs of the vehicle's body; none of either where nothing is to be cleared."""

    obstacles: tuple[ObstacleClaim, ...] = ()
    footprint: tuple[FootprintClaim, ...] = ()


def prove_surroundings(surroundings: Surroundings, legs: Sequence[Leg], clearance: Clearance) -> None:
    """Proves that no disc of the body touches an obstacle at any θ of a leg, wherever in its funnel the vehicle is.

    Raises:
        Broken: says what is not proven.
    """
    obstacles, footprint = surroundings
    if not footprint:
        raise Broken("condition (c): there are obstacles, and no footprint that could clear them")
    budget = Budget(CLEARANCE_EFFORT)
    for leg, by_obstacle in zip(legs, clearance, strict=True):
        for number, (obstacle, by_disc) in enumerate(zip(obstacles, by_obstacle, strict=True)):
            for disc, planes in zip(footprint, by_disc, strict=True):
                try:
                    shadow = Shadow(leg.funnel.shape, leg.funnel.level, disc)
                    prove_clearance(leg.pieces, leg.start, shadow, obstacle, planes, budget)
                except ValueError as error:
                    raise Broken(f"condition (c), leg {leg.index}, obstacle {number}: {error}") from None


# --- reading


def read_surroundings(obstacles: Item, footprint: Item) -> Surroundings:
    """From two lists.

    Raises:
        Unreadable: says what was expected where.
    """
    return Surroundings(
        tuple(map(_obstacle, obstacles.items(MOST_OBSTACLES, least=0))),
        tuple(map(_disc, footprint.items(MOST_DISCS, least=0))),
    )


def _obstacle(item: Item) -> ObstacleClaim:
    corners, rounding = item.record("corners", "round")
    points = (corner.items(2, 2) for corner in corners.items(MOST_CORNERS))
    return ObstacleClaim(tuple((x.rational(), y.rational()) for x, y in points), rounding.rational())


def _disc(item: Item) -> FootprintClaim:
    radius, offset = item.record("radius", "offset")
    return FootprintClaim(radius.rational(), offset.rational())


def read_clearance(item: Item, surroundings: Surroundings, legs: int) -> Clearance:
    """Half-planes for so many legs; an empty list where there are no obstacles.

    Raises:
        Unreadable: says what was expected where.
    """
    obstacles, discs = map(len, surroundings)
    if not obstacles:
        item.items(0, 0)
        return ()
    return tuple(
        tuple(tuple(map(_half_planes, disc.items(discs, discs))) for disc in leg.items(obstacles, obstacles))
        for leg in item.items(legs, legs)
    )


def _half_planes(item: Item) -> HalfPlanes:
    found = []
    for entry in item.items(MOST_HALF_PLANES):
        end, normal = entry.record("end", "normal")
        x, y = normal.items(2, 2)
        found.append(HalfPlane(end.rational(), (x.rational(), y.rational())))
    return tuple(found)
