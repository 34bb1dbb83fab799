"""Any polygon as convex ones, which are what a proof of clearance knows."""

import itertools

import numpy as np
import shapely

from cfjax.problem.obstacles import PARALLEL, Disc, Polygon


Solid = Disc | Polygon
"""What a map is made of: discs and convex polygons."""

MOST_CORNERS = 16  # of a part: more of them make a half-plane's proof longer than another part would


def convex_parts(polygon: shapely.Polygon) -> list[shapely.Polygon]:
    """Convex polygons that together are the polygon, its holes left open.

    Triangles between its corners, of which neighbours are joined across the longest edges first, as long as the union
    is convex (Hertel and Mehlhorn 1983).
    """
    if is_convex(polygon):
        return [_hull(polygon)]
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    parts = [part for part in triangles if isinstance(part, shapely.Polygon) and part.area > 0]
    owner = list(range(len(parts)))

    def find(index: int) -> int:
        while owner[index] != index:
            index = owner[index]
        return index

    for first, second in _neighbours(parts):
        a, b = find(first), find(second)
        union = shapely.union(parts[a], parts[b])
        if a != b and isinstance(union, shapely.Polygon) and is_convex(union):
            hull = _hull(union)
            if len(hull.exterior.coords) <= MOST_CORNERS + 1:
                parts[a], owner[b] = hull, a
    return [part for index, part in enumerate(parts) if owner[index] == index]


def is_convex(polygon: shapely.Polygon) -> bool:
    """Whether it is its own hull, but for rounding."""
    return polygon.area >= (1 - PARALLEL) * polygon.convex_hull.area


def _hull(polygon: shapely.Polygon) -> shapely.Polygon:
    hull = polygon.convex_hull
    assert isinstance(hull, shapely.Polygon)  # it has an area
    return hull


def _neighbours(triangles: list[shapely.Polygon]) -> list[tuple[int, int]]:
    """Pairs that share an edge, by its length, the longest first."""
    seen: dict[frozenset, int] = {}
    found = []
    for index, triangle in enumerate(triangles):
        for begin, end in itertools.pairwise(triangle.exterior.coords):
            edge = frozenset((begin, end))
            if edge in seen:
                found.append((-float(np.hypot(begin[0] - end[0], begin[1] - end[1])), seen[edge], index))
            seen[edge] = index
    return [(first, second) for _, first, second in sorted(found)]
