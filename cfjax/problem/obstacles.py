"""What the vehicle must not touch: discs and convex polygons in the plane, and the discs that stand for its body.

Lengths in m, inertial frame. The safe set that follows is S = {x : (footprint at the pose) ∩ (every obstacle) = ∅}.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from cfjax.coerce import Number, Numbers, array, keep, listed, numbers, real, refuse, shown
from cfjax.errors import InputError


PARALLEL = 1e-12  # relative area below which corners lie on a line
FARTHEST = 1e8  # m from the origin, more than twice round the earth: beyond, squares of coordinates lose all digits


@dataclass(frozen=True)
class Disc:
    """A round obstacle: centre and radius in m.

    Raises:
        InputError: for a centre that is not finite, or a radius that is not positive.
    """

    x: float
    y: float
    radius: float

    def __init__(self, x: Number, y: Number, radius: Number) -> None:
        expected = "a disc with a finite centre and a positive radius"
        x, y, radius = numbers("sets.obstacles", given := [x, y, radius], expected)
        if radius <= 0:
            refuse("sets.obstacles", expected, given)
        _near("sets.obstacles", (x, y, radius))
        keep(self, x=x, y=y, radius=radius)

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """The points whose hull, grown by `round`, is the obstacle."""
        return ((self.x, self.y),)

    @property
    def round(self) -> float:
        return self.radius


@dataclass(frozen=True)
class Polygon:
    """A convex polygon: corners [x, y] in m, in order, either way round, each of them a corner of the hull.

    Raises:
        InputError: for less than three corners, numbers that are not finite, and what is not convex.
    """

    corners: tuple[tuple[float, float], ...]

    def __init__(self, corners: Sequence[Numbers] | np.ndarray) -> None:
        expected = "a polygon with at least 3 corners [x, y]"
        rows = listed(corners)
        if rows is None or len(rows) < 3:
            refuse("sets.obstacles", expected, corners)
        keep(self, corners=tuple(numbers("sets.obstacles", row, expected, count=2) for row in rows))
        for corner in self.corners:
            _near("sets.obstacles", corner)
        given = shapely.Polygon(self.corners)
        hull = given.convex_hull
        if not given.is_valid or given.area < (1 - PARALLEL) * hull.area or hull.area <= 0:
            raise InputError(
                f"sets.obstacles: expected a convex polygon, its corners in order, got {shown(self.corners)}; several "
                "convex ones make any other"
            )

    @property
    def round(self) -> float:
        return 0.0


Obstacle = Disc | Polygon
"""What the footprint must not touch: a disc or a convex polygon, fixed in the plane."""


class FootprintDisc(NamedTuple):
    """A disc of the vehicle's body: radius and offset of its centre along the forward axis, m."""

    radius: float = 0.25
    offset: float = 0.0


def obstacles_of(value: object) -> tuple[Obstacle, ...]:
    """A list of obstacles, or of what a configuration says of them: {disc: [x, y, radius]}, {polygon: [[x, y], …]}.

    Raises:
        InputError: for anything else.
    """
    entries = listed(value)
    if entries is None:
        refuse("sets.obstacles", "a list, empty for none", value)
    return tuple(map(_obstacle, entries))


def _obstacle(entry: object) -> Obstacle:
    if isinstance(entry, Disc | Polygon):
        return entry
    (kind, shape), *more = entry.items() if isinstance(entry, Mapping) and entry else [("", None)]
    parts = None if more else listed(shape)
    if kind == "disc" and parts is not None and len(parts) == 3 and None not in map(real, parts):
        return Disc(*parts)
    if kind == "polygon" and parts is not None and all(len(listed(row) or ()) == 2 for row in parts):
        return Polygon(parts)
    return refuse("sets.obstacles", "entries {disc: [x, y, radius]} or {polygon: [[x, y], ...]}", entry)


def _near(name: str, given: Sequence[float]) -> None:
    """Raises InputError for numbers with which no distance can be computed."""
    if max(map(abs, given)) > FARTHEST:
        refuse(name, f"numbers of at most {FARTHEST:g} m", given)


def footprint_of(value: object) -> tuple[FootprintDisc, ...]:
    """The discs of a body, from a list of [radius, offset] in m.

    Raises:
        InputError: for anything else.
    """
    rows = listed(value)
    if rows is None or any(len(listed(row) or ()) != 2 for row in rows):
        refuse("vehicle.footprint", "a list of discs [radius, offset]", value)
    expected = "discs [radius, offset] in m, no radius below zero"
    discs = tuple(FootprintDisc(*numbers("vehicle.footprint", row, expected)) for row in rows)
    if not discs:
        raise InputError("vehicle.footprint: expected at least one disc")
    for disc in discs:
        if disc.radius < 0:
            refuse("vehicle.footprint", expected, disc)
        _near("vehicle.footprint", disc)
    return discs


def distances(
    obstacle: Obstacle, points: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 2"]]:
    """Distances (m) of points from the obstacle, zero inside, and the obstacle's nearest points.

    Raises:
        InputError: for what is no obstacle, or no points.
    """
    if not isinstance(obstacle, Disc | Polygon):
        refuse("obstacle", "a Disc or a Polygon, such as cfjax.problem.Disc(x, y, radius)", obstacle)
    points = array("points", points, (None, 2))
    _near("points", points[np.abs(points).max(axis=1).argmax()].tolist())
    shape = shapely.Point(obstacle.corners[0]) if isinstance(obstacle, Disc) else shapely.Polygon(obstacle.corners)
    lines = shapely.shortest_line(shapely.points(points), shape)
    nearest = shapely.get_coordinates(lines)[1::2]
    apart = np.linalg.norm(points - nearest, axis=1)
    toward = (points - nearest) / np.where(apart > 0, apart, 1.0)[:, None]
    return np.maximum(apart - obstacle.round, 0.0), nearest + obstacle.round * toward


def disc_centres(
    footprint: Sequence[FootprintDisc], poses: Float[np.ndarray, "n 3"]
) -> list[tuple[float, Float[np.ndarray, "n 2"]]]:
    """(radius, centres) of each of the footprint's discs at poses (heading in rad, position in m).

    Raises:
        InputError: for what is no footprint, or no poses.
    """
    footprint, poses = footprint_of(footprint), array("poses", poses, (None, 3))
    forward = np.stack([-np.sin(poses[:, 0]), np.cos(poses[:, 0])], axis=1)
    return [(disc.radius, poses[:, 1:] + disc.offset * forward) for disc in footprint]
