"""A corridor: a wall on either side of a path, from half-widths along it or through points that are given.

The safe set S(θ) of the paper asks the vehicle's position to stay within half-widths of the path. Here the whole body
has to: half-widths become walls in the plane that no disc of the footprint may touch. A wall keeps to within
`TOLERANCE` of its half-widths. Where it would fold, on the inside of a bend that is tighter than the corridor is wide,
the fold is left out.

Frames and units: m in the inertial frame; left is to the left of somebody who looks along the path.
"""

import itertools
import pathlib
from collections.abc import Mapping
from os import PathLike
from typing import NamedTuple, TypeGuard

import numpy as np
import shapely
from jaxtyping import Float

from cfjax.coerce import array, number, real, refuse
from cfjax.errors import InputError
from cfjax.problem.obstacles import SIDES, Wall
from cfjax.problem.path import Path
from cfjax.problem.points import read_points


FILE = "file"
TOLERANCE = 2e-3  # m between a wall and the half-widths that it stands for
DECIMALS = 4  # of the coordinates of a wall that is made from half-widths: short numbers in the certificate
STEP = 0.25  # m between places of the path at which half-widths are taken, at most
MOST_PLACES = 2**15
FORMS = (
    'expected a half-width in m, {left: …, right: …} with half-widths or points (a file or [[x, y], …]), or "file", '
    "which takes the widths in the path's own file"
)


class _Line(NamedTuple):
    """Places of a path: θ (s) from its start, and poses there."""

    theta: Float[np.ndarray, " n"]
    poses: Float[np.ndarray, "n 3"]

    def at(self, index: int) -> str:
        """For messages."""
        _, x, y = self.poses[index]
        return f"at theta = {self.theta[index]:.4g} s, ({x:.4g}, {y:.4g}) m"


def walls_of(corridor: object, path: Path, closed: bool | None = None) -> tuple[Wall, ...]:
    """The left and the right wall of a corridor along the path; none for None.

    Args:
        corridor: a half-width (m); a mapping of left and right, each a half-width, a list of half-widths at the places
            `theta` (s along the whole path, a third entry), points [x, y] (m), or the name of a file of points; or
            "file": the widths in the path's own file.
        path: along which it leads.
        closed: whether the path is a lap, of which a wall ends where it begins; None: where its end meets its start.

    Raises:
        InputError: for anything else, edges that cross each other or themselves, and a path that leads outside.
    """
    if corridor is None:
        return ()
    if path.tube:
        raise InputError("sets.corridor: expected none for a tube, which has no place")
    lap = path.closed if closed is None else closed
    line = _line(path)
    left, right = _edges(corridor, path, line, lap)
    walls = Wall(_closed(left, lap), "left"), Wall(_closed(right, lap), "right")
    _check_crossings(walls, line)
    _check_sides(walls, line)
    return walls


def _line(path: Path) -> _Line:
    theta, poses, begin = [], [], 0.0
    fastest = (np.abs(each.speed.values(_grid(each.duration, 65))).max() for each in path.curve)
    lengths = [float(speed * each.duration) for speed, each in zip(fastest, path.curve, strict=True)]
    step = max(STEP, sum(lengths) / MOST_PLACES)
    for segment, length in zip(path.curve, lengths, strict=True):
        own = _grid(segment.duration, max(9, int(length / step) + 2))
        theta.append(begin + own)
        poses.append(segment.poses(own))
        begin += segment.duration
    return _Line(np.concatenate(theta), np.concatenate(poses))


def _grid(duration: float, places: int) -> Float[np.ndarray, " n"]:
    return np.linspace(0.0, duration, places)


# --- what is given


def with_own_points(corridor: object, folder: pathlib.Path) -> object:
    """The same corridor with the points (m) in it of files that it names, relative to a folder: it needs no file then.

    Raises:
        InputError: for a file that cannot be read.
    """
    if not isinstance(corridor, Mapping):
        return corridor
    return {name: _points(folder / given).tolist() if _is_file(given) else given for name, given in corridor.items()}


def _is_file(given: object) -> TypeGuard[str | PathLike]:
    return isinstance(given, str | PathLike)


def _points(file: str | PathLike) -> Float[np.ndarray, "n 2"]:
    place = read_points(file).place
    return np.stack([np.real(place), np.imag(place)], axis=1)


def _edges(corridor: object, path: Path, line: _Line, lap: bool) -> list[Float[np.ndarray, "n 2"]]:
    """Points of the left and of the right wall."""
    if isinstance(corridor, str) and corridor == FILE:
        if path.edges is None:
            raise InputError(
                "sets.corridor: expected a path from a file with columns of widths, such as w_tr_left_m and "
                f"w_tr_right_m, got {path.name} without"
            )
        return [np.array(edge) for edge in path.edges]
    if (width := real(corridor)) is not None:
        corridor = dict.fromkeys(SIDES, width)
    if not isinstance(corridor, Mapping) or not {*SIDES} <= {*corridor} <= {*SIDES, "theta"}:
        raise InputError(f"sets.corridor: {FORMS}, got {corridor!r}"[:300])
    given = {str(name): value for name, value in corridor.items()}
    theta = array("sets.corridor.theta", given["theta"], (None,)) if "theta" in given else None
    return [_edge(name, given[name], theta, line, lap) for name in SIDES]


def _edge(
    name: str, given: object, theta: Float[np.ndarray, " k"] | None, line: _Line, lap: bool
) -> Float[np.ndarray, "n 2"]:
    label = f"sets.corridor.{name}"
    if _is_file(given):
        return _points(given)
    if real(given) is not None:
        return _beside(name, np.full(len(line.theta), number(label, given, "m", above=0)), line, lap)
    if theta is None:
        return array(label, given, (None, 2))
    widths = array(label, given, (len(theta),))
    if not (np.diff(theta) > 0).all():
        refuse("sets.corridor.theta", "increasing numbers", theta.tolist())
    if widths.min() <= 0:
        refuse(label, "half-widths above 0 m", float(widths.min()))
    return _beside(name, np.interp(line.theta, theta, widths), line, lap)


def _beside(name: str, widths: Float[np.ndarray, " n"], line: _Line, lap: bool) -> Float[np.ndarray, "m 2"]:
    """Points so far beside the path, without the folds on the inside of bends."""
    side = -1.0 if name == "left" else 1.0
    lateral = np.stack([np.cos(line.poses[:, 0]), np.sin(line.poses[:, 0])], axis=1)
    points = line.poses[:, 1:] + side * widths[:, None] * lateral
    if lap:  # the end is the beginning
        points, widths = points[:-1], widths[:-1]
    if not shapely.LineString(_closed(points, lap)).is_simple:
        reference = shapely.LineString(line.poses[:, 1:])
        shapely.prepare(reference)
        points = points[shapely.distance(reference, shapely.points(points)) >= widths - TOLERANCE]
    if len(points) < 3:
        raise InputError(f"sets.corridor.{name}: expected half-widths that leave an edge, got {widths.max():g} m")
    thin = shapely.simplify(shapely.LineString(_closed(points, lap)), TOLERANCE / 2)
    return np.round(shapely.get_coordinates(thin), DECIMALS)


def _closed(points: Float[np.ndarray, "n 2"], lap: bool) -> Float[np.ndarray, "m 2"]:
    """Of a lap with the first one at the end again."""
    return np.concatenate([points, points[:1]]) if lap and (points[0] != points[-1]).any() else points


# --- what cannot be a corridor


def _check_crossings(walls: tuple[Wall, Wall], line: _Line) -> None:
    """Raises InputError where edges cross each other, or themselves."""
    for name, wall in zip(SIDES, walls, strict=True):
        if not wall.shape.is_simple:
            x, y = _self_crossing(wall)
            raise InputError(
                f"sets.corridor: the {name} edge crosses itself at ({x:.4g}, {y:.4g}) m, {_near(line, x, y)}"
            )
    left, right = (wall.shape for wall in walls)
    if left.intersects(right):
        x, y = shapely.get_coordinates(shapely.intersection(left, right))[0]
        raise InputError(f"sets.corridor: the edges cross each other at ({x:.4g}, {y:.4g}) m, {_near(line, x, y)}")


def _self_crossing(wall: Wall) -> tuple[float, float]:
    edges = [shapely.LineString(pair) for pair in itertools.pairwise(wall.points)]
    pairs = shapely.STRtree(edges).query(edges, predicate="intersects").T
    last = len(edges) - 1
    for i, j in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].tolist():
        if j > i + 1 and (i, j) != (0, last):
            x, y = shapely.get_coordinates(shapely.intersection(edges[i], edges[j]))[0]
            return float(x), float(y)
    return wall.points[0]


def _near(line: _Line, x: float, y: float) -> str:
    return f"beside the path {line.at(int(np.hypot(line.poses[:, 1] - x, line.poses[:, 2] - y).argmin()))}"


def _check_sides(walls: tuple[Wall, Wall], line: _Line) -> None:
    """Raises InputError where the path crosses an edge, or begins with an edge on the wrong side of it."""
    course = shapely.LineString(line.poses[:, 1:])
    heading, x, y = line.poses[0]
    for name, side, wall in zip(SIDES, (-1.0, 1.0), walls, strict=True):
        shapely.prepare(wall.shape)
        nearest = shapely.get_coordinates(shapely.shortest_line(wall.shape, shapely.Point(x, y)))[0]
        beside = side * float(np.cos(heading) * (nearest[0] - x) + np.sin(heading) * (nearest[1] - y))
        apart = float(np.hypot(*(nearest - (x, y))))
        if beside <= 0:
            raise InputError(
                f"path: begins outside its corridor, {line.at(0)}: the {name} edge is {apart:.4g} m away on the other "
                "side; were left and right exchanged?"
            )
        if wall.shape.intersects(course):
            outside = shapely.get_coordinates(shapely.intersection(wall.shape, course))[0]
            index = int(np.hypot(*(line.poses[:, 1:] - outside).T).argmin())
            raise InputError(f"path: leaves its corridor {line.at(index)}, where it crosses the {name} edge")
