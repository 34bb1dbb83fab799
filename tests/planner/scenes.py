"""Maps by hand and by chance, and cars that are drawn at random from all that a plan's tubes allow."""

import math

import numpy as np
import shapely

from cfjax.planner import Map, Plan
from cfjax.problem import Pose


BODY = ((0.2, 0.0), (0.15, 0.3))
HOOK = [(2.0, -1.0), (3.0, -1.0), (3.0, 1.6), (1.2, 1.6), (1.2, 1.3), (2.0, 1.3)]  # not convex
ENTRIES = (
    {"polygon": HOOK},
    {"disc": (5.0, 2.4, 0.5)},
    {"polygon": [(4.6, -1.5), (6.2, -1.5), (5.4, 0.8)]},
)
BOUNDS = (-1.0, -2.0, 8.0, 4.0)
START, GOAL = Pose(-math.pi / 2, 0.0, 0.0), Pose(0.0, 7.2, 0.0)


def shape_of(entry: dict) -> shapely.Geometry:
    """An entry of a map, without the code of the package."""
    if "disc" in entry:
        x, y, radius = entry["disc"]
        return shapely.Point(x, y).buffer(radius, 256)
    return shapely.Polygon(entry["polygon"])


def least_distance(plan: Plan, shapes: list, body: tuple, count: int, seed: int) -> float:
    """The least distance (m) of the discs of random cars on the edge of a plan's tubes from shapes, by shapely."""
    rng, least, each = np.random.default_rng(seed), math.inf, count // len(plan.following.tubes) + 1
    for stretch in plan.following.tubes:
        segment = plan.path.curve[stretch.segment]
        theta = np.sort(rng.uniform(stretch.start, stretch.end, each))
        heading, x, y = segment.poses(theta).T
        shape = np.array([[float(entry) for entry in row] for row in stretch.tube.shape])
        w = rng.normal(size=(each, len(shape)))
        off = w / np.sqrt(np.einsum("ki,ij,kj->k", w, shape, w))[:, None]
        cos, sin = np.cos(heading), np.sin(heading)
        x, y = x + cos * off[:, 1] - sin * off[:, 2], y + sin * off[:, 1] + cos * off[:, 2]
        heading = heading + off[:, 0]
        for radius, offset in body:
            centres = shapely.points(x - offset * np.sin(heading), y + offset * np.cos(heading))
            tree = shapely.STRtree(shapes)
            least = min(least, float(shapely.distance(centres, np.array(shapes)[tree.nearest(centres)]).min()) - radius)
    return least


def walls(bounds: tuple[float, float, float, float]) -> shapely.Geometry:
    """All around a rectangle."""
    inner = shapely.box(*bounds)
    return inner.buffer(5.0, join_style="mitre").difference(inner)


def scene() -> Map:
    return Map(ENTRIES, BOUNDS)
