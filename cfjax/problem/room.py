"""How much room the reference itself leaves between the body and what is beside it.

Frames and units: m in the inertial frame, θ in s from the start of a segment.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cfjax.errors import InputError
from cfjax.problem.obstacles import FootprintDisc, Obstacle, Wall, disc_centres, distances
from cfjax.problem.path import Path


POSES = 401  # per segment, at which the reference's distance from obstacles is looked at


class Near(NamedTuple):
    """Where a disc of the body, of that radius (m), comes nearest to an obstacle; `room` is what is between them, m."""

    segment: int
    theta: float  # s
    place: tuple[float, float]  # m
    obstacle: str  # its name: "obstacle 0", "wall 1", each counted by itself
    radius: float
    room: float


def nearest(path: Path, obstacles: Sequence[Obstacle], footprint: Sequence[FootprintDisc]) -> Iterator[Near]:
    """Where each disc of the body comes nearest to each obstacle, segment by segment."""
    names = list(_names(obstacles))
    for index, segment in enumerate(path.curve if obstacles else ()):
        theta = np.linspace(0.0, segment.duration, POSES)
        discs = disc_centres(footprint, segment.poses(theta))
        for name, obstacle in zip(names, obstacles, strict=True):
            for radius, centres in discs:
                apart, _ = distances(obstacle, centres)
                worst = int(np.argmin(apart))
                place = float(centres[worst, 0]), float(centres[worst, 1])
                yield Near(index, float(theta[worst]), place, name, radius, float(apart[worst] - radius))


def _names(obstacles: Sequence[Obstacle]) -> Iterator[str]:
    counts = {"obstacle": 0, "wall": 0}
    for each in obstacles:
        kind = "wall" if isinstance(each, Wall) else "obstacle"
        yield f"{kind} {counts[kind]}"
        counts[kind] += 1


def require_clear(path: Path, obstacles: Sequence[Obstacle], footprint: Sequence[FootprintDisc]) -> None:
    """The reference itself has to clear every obstacle, or nothing that surrounds it does.

    Raises:
        InputError: says where it does not, and by how much.
    """
    for near in nearest(path, obstacles, footprint):
        if near.room <= 0:
            (x, y), radius = near.place, near.radius
            raise InputError(
                f"path: segment {near.segment} at theta = {near.theta:.4g} s, ({x:.4g}, {y:.4g}) m, comes within "
                f"{near.room + radius:.4g} m of {near.obstacle}; expected more than the vehicle's radius "
                f"there, {radius:g} m"
            )
