"""What the vehicle must not touch: discs and convex polygons in the plane, and the discs that stand for its body.

Lengths in m, inertial frame. The safe set that follows is S = {x : (footprint at the pose) ∩ (every obstacle) = ∅}.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from cfjax.errors import InputError


PARALLEL = 1e-12  # relative area below which corners lie on a line


@dataclass(frozen=True)
class Disc:
    """A round obstacle."""

    x: float
    y: float
    radius: float

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.x, self.y))) or not 0 < self.radius < math.inf:
            raise InputError(
                f"sets.obstacles: expected a disc with a finite centre and a positive radius, got "
                f"[{self.x}, {self.y}, {self.radius}]"
            )

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """The points whose hull, grown by `round`, is the obstacle."""
        return ((self.x, self.y),)

    @property
    def round(self) -> float:
        return self.radius


@dataclass(frozen=True)
class Polygon:
    """A convex polygon: corners in order, either way round, each of them a corner of the hull."""

    corners: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        finite = all(len(corner) == 2 and all(map(math.isfinite, corner)) for corner in self.corners)
        if len(self.corners) < 3 or not finite:
            raise InputError(
                f"sets.obstacles: expected a polygon with at least 3 corners [x, y], got {list(self.corners)}"
            )
        given = shapely.Polygon(self.corners)
        hull = given.convex_hull
        if not given.is_valid or given.area < (1 - PARALLEL) * hull.area or hull.area <= 0:
            raise InputError(
                f"sets.obstacles: expected a convex polygon, its corners in order, got {list(self.corners)}; several "
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


def distances(
    obstacle: Obstacle, points: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 2"]]:
    """Distances (m) of points from the obstacle, zero inside, and the obstacle's nearest points."""
    shape = shapely.Point(obstacle.corners[0]) if isinstance(obstacle, Disc) else shapely.Polygon(obstacle.corners)
    lines = shapely.shortest_line(shapely.points(points), shape)
    nearest = shapely.get_coordinates(lines)[1::2]
    apart = np.linalg.norm(points - nearest, axis=1)
    toward = (points - nearest) / np.where(apart > 0, apart, 1.0)[:, None]
    return np.maximum(apart - obstacle.round, 0.0), nearest + obstacle.round * toward


def disc_centres(
    footprint: Sequence[FootprintDisc], poses: Float[np.ndarray, "n 3"]
) -> list[tuple[float, Float[np.ndarray, "n 2"]]]:
    """(radius, centres) of each of the footprint's discs at poses (heading in rad, position in m)."""
    forward = np.stack([-np.sin(poses[:, 0]), np.cos(poses[:, 0])], axis=1)
    return [(disc.radius, poses[:, 1:] + disc.offset * forward) for disc in footprint]
