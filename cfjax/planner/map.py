"""A map: obstacles in the plane, and the rectangle in which a car may be.

Lengths in m, inertial frame. What is proven later knows discs and convex polygons alone, so other polygons are split.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from jaxtyping import Complex
from shapely.geometry.base import BaseGeometry

from cfjax.coerce import Numbers, keep, listed, numbers, refuse, text
from cfjax.errors import InputError
from cfjax.planner.convex import Solid, convex_parts
from cfjax.problem import Disc, Obstacle, Polygon, Pose, Wall
from cfjax.problem.obstacles import obstacles_of


WALLS = 4  # around bounds
WALL = 1.0  # m: how thick walls are drawn; a proof that none is touched needs no thickness
ROUNDNESS = 32  # chords of a quarter of a disc, where it is treated as a polygon


@dataclass(frozen=True, eq=False)
class Map:
    """Obstacles, and bounds [x, y, x, y] of the rectangle that the body may not leave (m); None: no bounds.

    `obstacles` are the convex parts, then the four walls around the bounds. `labels` says for each of them what it is
    a part of: the number of its entry, or the wall.

    Args:
        obstacles: each a `Disc`, a `Polygon`, a polygon of shapely, {disc: [x, y, radius]}, {polygon: [[x, y], …]},
            which need not be convex, or a list of these, which are one obstacle.
        bounds: lower corner, upper corner.
        source: what it was read from, for messages.
        names: what each entry is called in messages; None: "obstacle" and its number.
        start: a pose from which one may plan, if the map knows one; `goal` likewise.

    Raises:
        InputError: for anything else, polygons that cross themselves, and bounds without an area.
    """

    obstacles: tuple[Solid, ...]
    labels: tuple[str, ...]
    bounds: tuple[float, float, float, float] | None
    source: str
    start: Pose | None
    goal: Pose | None

    def __init__(
        self,
        obstacles: Sequence[Obstacle | Mapping | BaseGeometry | Sequence] = (),
        bounds: Numbers | None = None,
        source: str = "map",
        *,
        names: Sequence[str] | None = None,
        start: Pose | None = None,
        goal: Pose | None = None,
    ) -> None:
        source = text("source of a map", source)
        entries = [obstacles] if isinstance(obstacles, Mapping | str) else listed(obstacles)
        if entries is None:
            refuse(f"{source}: obstacles", "a list, empty for none", obstacles)
        called = [f"obstacle {index}" for index in range(len(entries))] if names is None else names
        found = [
            (part, label)
            for label, entry in zip(called, entries, strict=True)
            for part in _convex(f"{source}: {label}", entry)
        ]
        rectangle = None if bounds is None else _rectangle(f"{source}: bounds", bounds)
        found += [] if rectangle is None else _walls(rectangle)
        parts, labels = tuple(part for part, _ in found), tuple(label for _, label in found)
        keep(self, obstacles=parts, labels=labels, bounds=rectangle, source=source, start=start, goal=goal)

    @cached_property
    def shapes(self) -> np.ndarray:
        """The obstacles as geometries of shapely, discs a little too large."""
        return np.array([_shape(obstacle) for obstacle in self.obstacles], dtype=object)

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree(self.shapes)

    def nearest(self, places: Complex[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
        """Of places x + iy the distance (m) to the nearest obstacle, infinite where there is none, and its number."""
        if not len(self.obstacles):
            return np.full(len(places), np.inf), np.full(len(places), -1)
        points = shapely.points(np.real(places), np.imag(places))
        index = self._tree.nearest(points)
        return shapely.distance(points, self.shapes[index]), np.asarray(index)

    @property
    def entries(self) -> dict[str, Any]:
        """What a file of ours says of it (`read_map`): `Map(**entries)` is the same map."""
        sides = 0 if self.bounds is None else WALLS
        plain = zip(self.labels[: len(self.labels) - sides], map(_entry, self.obstacles), strict=False)
        grouped = [[part for _, part in group] for _, group in itertools.groupby(plain, key=lambda pair: pair[0])]
        bounds = None if self.bounds is None else list(self.bounds)
        return {"obstacles": [parts[0] if len(parts) == 1 else parts for parts in grouped], "bounds": bounds}

    def __repr__(self) -> str:
        inside = (
            ""
            if self.bounds is None
            else " in [{}, {}] x [{}, {}] m".format(*(f"{self.bounds[k]:g}" for k in (0, 2, 1, 3)))
        )
        return f"<{self.source}: {len(self.obstacles)} convex obstacles{inside}>"


def _entry(obstacle: Solid) -> dict[str, list]:
    if isinstance(obstacle, Disc):
        return {"disc": [obstacle.x, obstacle.y, obstacle.radius]}
    return {"polygon": [list(corner) for corner in obstacle.corners]}


def _convex(name: str, entry: object) -> Iterator[Solid]:
    """The convex parts of an entry."""
    if isinstance(entry, Disc):
        yield entry
        return
    if isinstance(entry, Polygon):
        entry = shapely.Polygon(entry.corners)
    if isinstance(entry, Mapping) and list(entry) == ["polygon"]:
        entry = _ring(name, entry["polygon"])
    if isinstance(entry, list | tuple) and entry:
        for part in entry:
            yield from _convex(name, part)
        return
    if not isinstance(entry, BaseGeometry):
        try:
            (found,) = obstacles_of([entry])
        except InputError as error:
            raise InputError(f"{name}: {str(error).partition(': ')[2]}") from None
        if isinstance(found, Wall):
            raise InputError(f"{name}: expected a disc or a polygon, got a wall; a thin polygon stands for one")
        yield from [found] if isinstance(found, Disc) else _convex(name, found)
        return
    if not isinstance(entry, shapely.Polygon | shapely.MultiPolygon) or entry.is_empty or not entry.is_valid:
        raise InputError(f"{name}: expected a polygon, got {_why(entry)}")
    for part in shapely.get_parts(entry):
        for piece in convex_parts(part):
            yield Polygon(shapely.get_coordinates(piece.exterior)[:-1])


def _ring(name: str, corners: object) -> shapely.Polygon:
    expected = "a polygon with at least 3 corners [x, y]"
    rows = listed(corners)
    if rows is None or len(rows) < 3:
        refuse(name, expected, corners)
    return shapely.Polygon([numbers(name, row, expected, count=2) for row in rows])


def _why(shape: BaseGeometry) -> str:
    if shape.is_empty:
        return "an empty shape"
    if not shape.is_valid:
        return f"one that is not valid ({shapely.is_valid_reason(shape)})"
    return f"a {shape.geom_type}"


def _rectangle(name: str, bounds: object) -> tuple[float, float, float, float]:
    expected = "a rectangle [x, y, x, y] (m), lower corner first"
    left, bottom, right, top = numbers(name, bounds, expected, count=4)
    if not (left < right and bottom < top):
        refuse(name, expected, bounds)
    return left, bottom, right, top


def _walls(bounds: tuple[float, float, float, float]) -> list[tuple[Solid, str]]:
    """What stands around the rectangle."""
    left, bottom, right, top = bounds
    sides = {
        "left": (left - WALL, bottom - WALL, left, top + WALL),
        "right": (right, bottom - WALL, right + WALL, top + WALL),
        "lower": (left - WALL, bottom - WALL, right + WALL, bottom),
        "upper": (left - WALL, top, right + WALL, top + WALL),
    }
    return [(Polygon([(a, b), (c, b), (c, d), (a, d)]), f"the {side} wall") for side, (a, b, c, d) in sides.items()]


def _shape(obstacle: Solid) -> BaseGeometry:
    if isinstance(obstacle, Polygon):
        return shapely.Polygon(obstacle.corners)
    chords = 1 / np.cos(np.pi / (4 * ROUNDNESS))  # polygon outside the circle
    return shapely.Point(obstacle.x, obstacle.y).buffer(obstacle.radius * chords, quad_segs=ROUNDNESS)
