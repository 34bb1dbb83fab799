"""What the vehicle must not touch: discs, polygons and walls in the plane, and the discs that stand for its body.

All of it are hulls: corners, grown by a radius. A disc is one corner, a polygon one hull or several, a wall as many as
it has edges.

Lengths in m, inertial frame. The safe set that follows is S = {x : (footprint at the pose) ∩ (every obstacle) = ∅}.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from cfjax.coerce import Number, Numbers, array, keep, listed, numbers, real, refuse, shown
from cfjax.errors import InputError


PARALLEL = 1e-12  # relative area below which corners lie on a line
MOST_CORNERS = 32  # of a convex polygon that is one hull; one with more is split too
SIDES = ("left", "right")  # of a corridor
FARTHEST = 1e8  # m from the origin, more than twice round the earth: beyond, squares of coordinates lose all digits


class Hull(NamedTuple):
    """The hull of corners (m), counter-clockwise, grown by `round` (m)."""

    corners: tuple[tuple[float, float], ...]
    round: float = 0.0


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
    def hulls(self) -> tuple[Hull, ...]:
        """One."""
        return (Hull(((self.x, self.y),), self.radius),)

    @property
    def shape(self) -> shapely.Geometry:
        """Its centre: distances are counted from there."""
        return shapely.Point(self.x, self.y)


@dataclass(frozen=True)
class Polygon:
    """A polygon: corners [x, y] in m, in order, either way round. Where it is not convex it is split into triangles.

    Raises:
        InputError: for less than three corners, numbers that are not finite, and edges that cross each other.
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
        if not self.shape.is_valid or self.shape.area <= PARALLEL * self.shape.length**2:
            crossing = shapely.is_valid_reason(self.shape).lower().replace("[", " at (").replace("]", ") m")
            why = "its corners lie on a line" if self.shape.is_valid else crossing
            raise InputError(
                f"sets.obstacles: expected a polygon, its corners in order, got {shown(self.corners)}: {why}"
            )

    @cached_property
    def shape(self) -> shapely.Polygon:
        """It, for a geometry library."""
        return shapely.Polygon(self.corners)

    @cached_property
    def hulls(self) -> tuple[Hull, ...]:
        """Convex parts of it, which have its own corners: one where it is convex itself."""
        if len(self.corners) <= MOST_CORNERS and self.shape.area >= (1 - PARALLEL) * self.shape.convex_hull.area:
            return (_hull(self.shape),)
        return tuple(map(_hull, shapely.constrained_delaunay_triangles(self.shape).geoms))


@dataclass(frozen=True)
class Wall:
    """A polyline through two points [x, y] or more, in m, that nothing crosses; a closed one ends where it begins.

    `side` is left or right where it is a wall of a corridor.

    Raises:
        InputError: for less than two points that differ, numbers that are not finite, and another side.
    """

    points: tuple[tuple[float, float], ...]
    side: str | None = None

    def __init__(self, points: Numbers | np.ndarray, side: str | None = None) -> None:
        if side not in (None, *SIDES):
            refuse("wall", "left or right for its side, or none", side)
        rows = array("wall", points, (None, 2))
        if len(rows) < 2 or np.ptp(rows, axis=0).max() == 0:
            refuse("wall", "at least two points [x, y] that differ", points)
        _near("wall", rows[np.abs(rows).max(axis=1).argmax()].tolist())
        differ = np.append(True, (np.diff(rows, axis=0) != 0).any(axis=1))
        keep(self, points=tuple((x, y) for x, y in rows[differ].tolist()), side=side)

    @cached_property
    def shape(self) -> shapely.LineString:
        """It, for a geometry library."""
        return shapely.LineString(self.points)

    @property
    def hulls(self) -> tuple[Hull, ...]:
        """Its edges."""
        return tuple(map(Hull, itertools.pairwise(self.points)))


def _hull(shape: shapely.Geometry) -> Hull:
    ring = shapely.get_coordinates(shapely.orient_polygons(shape))[:-1]
    return Hull(tuple((x, y) for x, y in ring.tolist()))


Obstacle = Disc | Polygon | Wall
"""What the footprint must not touch: a disc, a polygon or a wall, fixed in the plane."""


class FootprintDisc(NamedTuple):
    """A disc of the vehicle's body: radius and offset of its centre along the forward axis, m."""

    radius: float = 0.25
    offset: float = 0.0


def convex_parts(obstacles: Sequence[Obstacle]) -> list[Obstacle]:
    """The same, with polygons that are not convex in parts that are; walls as they are."""
    found: list[Obstacle] = []
    for each in obstacles:
        split = isinstance(each, Polygon) and len(each.hulls) > 1
        found += [Polygon(hull.corners) for hull in each.hulls] if split else [each]
    return found


def obstacles_of(value: object) -> tuple[Obstacle, ...]:
    """A list of obstacles, or of what a configuration says of them: {disc: [x, y, radius]},
    {polygon: [[x, y], …]}, {wall: [[x, y], …]}.

    Raises:
        InputError: for anything else.
    """
    entries = listed(value)
    if entries is None:
        refuse("sets.obstacles", "a list, empty for none", value)
    return tuple(map(_obstacle, entries))


def _obstacle(entry: object) -> Obstacle:
    if isinstance(entry, Disc | Polygon | Wall):
        return entry
    (kind, shape), *more = entry.items() if isinstance(entry, Mapping) and entry else [("", None)]
    parts = None if more else listed(shape)
    if kind == "disc" and parts is not None and len(parts) == 3 and None not in map(real, parts):
        return Disc(*parts)
    if kind == "polygon" and parts is not None and all(len(listed(row) or ()) == 2 for row in parts):
        return Polygon(parts)
    if kind == "wall" and parts is not None and all(len(listed(row) or ()) == 2 for row in parts):
        return Wall(parts)
    expected = "entries {disc: [x, y, radius]}, {polygon: [[x, y], ...]} or {wall: [[x, y], ...]}"
    return refuse("sets.obstacles", expected, entry)


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
    if not isinstance(obstacle, Disc | Polygon | Wall):
        refuse("obstacle", "a Disc, a Polygon or a Wall, such as cfjax.problem.Disc(x, y, radius)", obstacle)
    points = array("points", points, (None, 2))
    _near("points", points[np.abs(points).max(axis=1).argmax()].tolist())
    round_ = obstacle.radius if isinstance(obstacle, Disc) else 0.0
    shape = obstacle.shape
    shapely.prepare(shape)
    lines = shapely.shortest_line(shape, shapely.points(points))
    nearest = shapely.get_coordinates(lines)[::2]
    apart = np.linalg.norm(points - nearest, axis=1)
    toward = (points - nearest) / np.where(apart > 0, apart, 1.0)[:, None]
    return np.maximum(apart - round_, 0.0), nearest + round_ * toward


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
