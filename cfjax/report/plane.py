"""The plane: the reference, the funnel's shadow along it, what the body may reach there, obstacles, and cars.

Shadows are drawn as the regions that they sweep, not as many ellipses: unions of the convex hulls of neighbours.
"""

import math
from collections.abc import Sequence

import jax
import numpy as np
import shapely
from jaxtyping import Float

from cfjax.funnel import Funnel
from cfjax.problem import Disc, FootprintDisc, Obstacle, Problem
from cfjax.problem.course import poses_of
from cfjax.report.marks import (
    BODY,
    CAR_STARTS,
    CARS,
    CLOSEST,
    EARLIER_END,
    END,
    FAILED,
    FAILED_AT,
    FUNNEL,
    GOAL,
    INLET,
    LATER_START,
    OBSTACLE,
    REFERENCE,
    START,
    WALL,
    WORST,
    Axis,
    Kind,
    Lines,
    Panel,
    Points,
    rings_of,
)
from cfjax.report.style import ellipse_outline, rotation
from cfjax.result import Result


TURN, WAY = 0.03, 0.1  # between neighbours: rad, and m in half-widths of the shadow
FEWEST, MOST_OUTLINES = 24, 20_000  # of a funnel, of a path
SLICES = 31  # of the headings in the funnel, where a disc of the body lies off its origin
REACH = 0.2  # of its size, by which the picture goes on for obstacles that end farther away
MARGIN = 0.03  # of its size, around all
MOST_RINGS = 40  # starts and ends of funnels along a path: more are no rings

Poses = Float[np.ndarray, "t 3"]  # heading (rad) and position (m), inertial frame


class PathPoses:
    """Poses of the vehicle that moves along the whole path."""

    def __init__(self, problem: Problem) -> None:
        self.pieces = jax.tree.map(np.asarray, poses_of(problem.path, problem.side_slip))

    def __call__(self, theta: Float[np.ndarray, " t"]) -> Poses:
        begin = self.pieces.begin
        # `find` would be compiled for every number of poses
        piece = np.clip(np.searchsorted(begin, theta, side="right") - 1, 0, len(begin) - 1)
        columns = self.pieces.at(piece, theta)
        return np.stack([np.broadcast_to(value, theta.shape) for value, _ in columns], axis=-1)

    def between(self, begin: float, end: float, width: float, most: int) -> Float[np.ndarray, " t"]:
        """θ (s), so dense that shadows of this half-width (m) are nearly the same as their neighbours."""
        poses = self(np.linspace(begin, end, 200))
        turn = np.abs(np.diff(poses[:, 0])).sum()
        way = np.linalg.norm(np.diff(poses[:, 1:], axis=0), axis=1).sum()
        wanted = math.ceil(max(turn / TURN, way / (WAY * width)))
        return np.linspace(begin, end, int(np.clip(wanted, FEWEST, max(FEWEST, most))) + 1)


def shadows(funnel: Funnel, theta: Float[np.ndarray, " t"], poses: Poses) -> Float[np.ndarray, "t 96 2"]:
    """Outlines (m, inertial frame) of the funnel's shadow on the x–y plane at each of its θ: ellipses."""
    outline = ellipse_outline(np.linalg.inv(funnel.shape)[1:3, 1:3])
    size = np.sqrt(np.broadcast_to(funnel.level(theta), theta.shape))
    return _placed(poses, size[:, None, None] * outline.T[None])


def disc_shadows(
    funnel: Funnel, theta: Float[np.ndarray, " t"], poses: Poses, offset: float
) -> Float[np.ndarray, "t 96 2"]:
    """Corners (m, inertial frame) of the hull of all places of a point so far (m) ahead of the vehicle's origin.

    It moves with the heading too, so the funnel is cut into slices of one heading each: ellipses, whose farthest points
    in every direction are known.
    """
    inverse = np.linalg.inv(funnel.shape)
    spread, coupled = inverse[0, 0], inverse[1:3, 0]
    section = inverse[1:3, 1:3] - np.outer(coupled, coupled) / spread
    angle = np.linspace(0.0, 2 * np.pi, 96)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    reach = np.sqrt(np.einsum("ki,ij,kj->k", normals, section, normals))
    size = np.sqrt(np.broadcast_to(funnel.level(theta), theta.shape))
    where = np.sin(np.linspace(-np.pi / 2, np.pi / 2, SLICES))  # of the largest heading, dense at its ends
    heading = size[:, None] * math.sqrt(spread) * where
    ahead = offset * np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    centre = heading[..., None] * (coupled / spread) + ahead
    scale = size[:, None] * np.sqrt(1 - where**2)
    farthest = np.argmax(centre @ normals.T + scale[..., None] * reach, axis=1)  # slice, for each θ and direction
    each = np.arange(len(theta))[:, None]
    points = centre[each, farthest] + scale[each, farthest][..., None] * (normals @ section / reach[:, None])
    return _placed(poses, points)


def _placed(poses: Poses, points: Float[np.ndarray, "t k 2"]) -> Float[np.ndarray, "t k 2"]:
    """Points in the reference's frame, one set per pose, in the plane."""
    return poses[:, None, 1:] + np.einsum("tij,tkj->tki", rotation(poses[:, 0]), points)


def swept(outlines: Float[np.ndarray, "t k 2"]) -> shapely.Geometry:
    """The region that convex shapes, given by points, sweep from each to the next."""
    pairs = np.concatenate([outlines[:-1], outlines[1:]], axis=1)
    return shapely.union_all(shapely.convex_hull(shapely.linestrings(pairs)))


def body_region(
    funnel: Funnel, theta: Float[np.ndarray, " t"], poses: Poses, footprint: Sequence[FootprintDisc]
) -> shapely.Geometry:
    """Where the discs of the body may be along a funnel (m, inertial frame)."""
    parts = []
    for disc in footprint:
        centres = disc_shadows(funnel, theta, poses, disc.offset) if disc.offset else shadows(funnel, theta, poses)
        parts.append(shapely.buffer(swept(centres), disc.radius, quad_segs=24))
    return shapely.union_all(parts)


def obstacle_region(obstacle: Obstacle) -> shapely.Geometry:
    """The obstacle as a shape, m."""
    if isinstance(obstacle, Disc):
        return shapely.buffer(shapely.Point(obstacle.x, obstacle.y), obstacle.radius, quad_segs=48)
    return obstacle.shape


def positions(poses: Poses, x: Float[np.ndarray, "t n"]) -> Points:
    """Places (m, inertial frame) of cars with these deviations from poses of the reference."""
    return _placed(poses, x[:, None, 1:3])[:, 0]


class Plane:
    """What there is to be seen on the plane, and how much room it takes."""

    def __init__(self, result: Result) -> None:
        problem = result.problem
        self.result, self.course = result, PathPoses(problem)
        self.end = problem.path.duration
        self.theta = self.course.between(0.0, self.end, math.inf, MOST_OUTLINES)
        self.line = self.course(self.theta)[:, 1:]
        self.obstacles = [obstacle_region(obstacle) for obstacle in problem.obstacles]
        self.starts: list[Points] = []
        self.ends: list[Points] = []
        funnels, bodies = [], []
        spans = result.spans
        for (begin, end), found in zip(spans, result.segments, strict=True):
            funnel = found.funnel
            inverse = np.linalg.inv(funnel.shape)[1:3, 1:3]
            width = math.sqrt(np.linalg.eigvalsh(inverse).min() * min(1.0, funnel.end_level))
            theta = self.course.between(begin, end, width, MOST_OUTLINES // len(spans))
            own, poses = theta - begin, self.course(theta)
            outlines = shadows(funnel, own, poses)
            funnels.append(swept(outlines))
            self.starts.append(outlines[0])
            self.ends.append(outlines[-1])
            if self.obstacles:
                bodies.append(body_region(funnel, own, poses, problem.footprint))
        self.funnel, self.body = shapely.union_all(funnels), shapely.union_all(bodies)
        self.set_outlines = _set_outlines(problem, self.course, self.end) if result.segments else {}

    def view(self, ways: Sequence[Points]) -> tuple[float, float, float, float]:
        """Lower and upper end in x and y (m): all, and the ways of cars, but for obstacles that reach far."""
        shapes = [self.funnel, self.body, *map(shapely.linestrings, (self.line, *self.set_outlines.values()))]
        ends = np.array(shapely.GeometryCollection(shapes).bounds)
        for way in ways:
            ends = _around(ends, np.concatenate([way.min(axis=0), way.max(axis=0)]))
        size = max(ends[2] - ends[0], ends[3] - ends[1])
        outer = _wider(ends, REACH * size)
        for obstacle in self.obstacles:
            if not (seen := shapely.intersection(obstacle, shapely.box(*outer))).is_empty:
                ends = _around(ends, np.array(seen.bounds))
        x0, y0, x1, y1 = map(float, _wider(ends, MARGIN * size))
        return x0, x1, y0, y1

    def panel(self, ways: Sequence[Points]) -> Panel:
        """All of it, with the ways of cars (m, inertial frame)."""
        x0, x1, y0, y1 = self.view(ways)
        seen = shapely.intersection(np.array(self.obstacles, object), shapely.box(x0, y0, x1, y1))
        areas = [each for each in seen if each.area > 0]
        obstacles = shapely.union_all(areas)
        lines = [part for each in seen for part in shapely.get_parts(each) if isinstance(part, shapely.LineString)]
        marks = [Lines(kind, rings_of(shape)) for kind, shape in ((BODY, self.body), (FUNNEL, self.funnel))]
        marks += [Lines(OBSTACLE, rings_of(obstacles)), Lines(WALL, [np.asarray(line.coords) for line in lines])]
        marks += [*self._closest(), Lines(CARS, ways, each="car")]
        marks += [Lines(CAR_STARTS, [way[:1] for way in ways]), Lines(REFERENCE, [self.line], [self.theta])]
        if self.starts:
            few = len(self.starts) <= MOST_RINGS
            marks += [Lines(LATER_START, self.starts[1:]), Lines(EARLIER_END, self.ends[:-1])] if few else []
            marks += [_ring(START, self.starts[0], 0.0), _ring(END, self.ends[-1], self.end)]
        marks += [_ring(kind, ring, 0.0 if kind is INLET else self.end) for kind, ring in self.set_outlines.items()]
        marks += self._failed()
        marks += self._worst()
        across, up = Axis("x (m)", (x0, x1)), Axis("y (m)", (y0, y1))
        return Panel("plane", across, up, tuple(marks), equal=True)

    def _closest(self) -> list[Lines]:
        """Where what the body may reach comes nearest to what is beside it."""
        if not self.obstacles or self.body.is_empty:
            return []
        line = shapely.shortest_line(self.body, shapely.GeometryCollection(self.obstacles))
        return [Lines(CLOSEST, [np.asarray(line.coords)])] if line.length > 0 else []

    def _failed(self) -> list[Lines]:
        if (failed := self.result.failed_at) is None:
            return []
        theta = np.linspace(*failed, 200)
        line = self.course(theta)[:, 1:]
        return [Lines(FAILED, [line], [theta]), *([Lines(FAILED_AT, [line[:1]])] if failed[0] == failed[1] else [])]

    def _worst(self) -> list[Lines]:
        """Of condition (d), of funnels of segments: those of stretches in a tube have no place along the path."""
        worst = [point for point in self.result.worst_points if point.condition == "d"]
        spans = self.result.spans
        if not worst or not spans or any(found.span for found in self.result.segments):
            return []
        theta = np.array([spans[point.segment][0] + (point.theta or 0.0) for point in worst])
        at = positions(self.course(theta), np.array([point.x for point in worst]))
        return [Lines(WORST, [at], [theta])]


def _ring(kind: Kind, ring: Points, theta: float) -> Lines:
    return Lines(kind, [ring], [np.full(len(ring), theta)])


def _set_outlines(problem: Problem, course: PathPoses, end: float) -> dict[Kind, Float[np.ndarray, "96 2"]]:
    """Outlines (m, inertial frame) of I where the path begins and of G where it ends: of their positions."""
    found = {}
    sets = ((INLET, problem.inlet), (GOAL, problem.goal))
    for (kind, ellipsoid), pose in zip(sets, course(np.array([0.0, end])), strict=True):
        if ellipsoid is not None:
            outline = ellipse_outline(np.diag(np.square(ellipsoid.half_axes[1:3])))
            found[kind] = _placed(pose[None], outline.T[None])[0]
    return found


def _around(ends: np.ndarray, others: np.ndarray) -> np.ndarray:
    """The box around two boxes."""
    return np.concatenate([np.minimum(ends[:2], others[:2]), np.maximum(ends[2:], others[2:])])


def _wider(ends: np.ndarray, by: float) -> np.ndarray:
    return ends + by * np.array([-1.0, -1.0, 1.0, 1.0])
