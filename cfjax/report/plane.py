"""The plane: the reference, the funnel's shadow along it, what the body may reach there, obstacles, and cars.

Shadows are drawn as the regions that they sweep, not as many ellipses: unions of the convex hulls of neighbours.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax
import numpy as np
import shapely
from jaxtyping import Float
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline

from cfjax.funnel import Funnel
from cfjax.problem import Disc, FootprintDisc, Obstacle, Problem
from cfjax.problem.course import poses_of
from cfjax.report.along import spans_of
from cfjax.report.style import (
    ASKED,
    BODY_COLOUR,
    BODY_EDGE_COLOUR,
    CAR_COLOURS,
    EDGE_COLOUR,
    END,
    FAILED_COLOUR,
    FUNNEL_COLOUR,
    GOAL,
    GOAL_COLOUR,
    INLET,
    INLET_COLOUR,
    OBSTACLE_COLOUR,
    REFERENCE_COLOUR,
    START,
    ellipse_outline,
    rotation,
)
from cfjax.result import Result


if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

TURN, WAY = 0.03, 0.1  # between neighbours: rad, and m in half-widths of the shadow
FEWEST, MOST_OUTLINES = 24, 20_000  # of a funnel, of a path
SLICES = 31  # of the headings in the funnel, where a disc of the body lies off its origin
REACH = 0.2  # of its size, by which the picture goes on for obstacles that end farther away
MARGIN = 0.03  # of its size, around all
ASKED_COLOURS = {INLET: INLET_COLOUR, GOAL: GOAL_COLOUR}

Poses = Float[np.ndarray, "t 3"]  # heading (rad) and position (m), inertial frame


class Course:
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
    return shapely.Polygon(obstacle.corners)


def positions(
    course: Course, theta: Float[np.ndarray, "t k"], x: Float[np.ndarray, "t k n"]
) -> Float[np.ndarray, "t k 2"]:
    """Positions of cars (m, inertial frame) from θ along the whole path (s) and the deviation."""
    poses = course(theta.ravel())
    return _placed(poses, x[..., 1:3].reshape(-1, 1, 2)).reshape(*theta.shape, 2)


class Plane:
    """What is to be drawn on the plane, and how much room it takes."""

    def __init__(self, result: Result) -> None:
        problem = result.problem
        self.result, self.course = result, Course(problem)
        theta = self.course.between(0.0, sum(s.duration for s in problem.path.curve), math.inf, MOST_OUTLINES)
        self.line = self.course(theta)[:, 1:]
        self.obstacles = [obstacle_region(obstacle) for obstacle in problem.obstacles]
        self.inlets: list[np.ndarray] = []
        self.outlets: list[np.ndarray] = []
        funnels, bodies = [], []
        spans = spans_of(result)
        for (begin, end), found in zip(spans, result.segments, strict=True):
            funnel = found.funnel
            inverse = np.linalg.inv(funnel.shape)[1:3, 1:3]
            width = math.sqrt(np.linalg.eigvalsh(inverse).min() * min(1.0, funnel.end_level))
            theta = self.course.between(begin, end, width, MOST_OUTLINES // len(spans))
            own, poses = theta - begin, self.course(theta)
            outlines = shadows(funnel, own, poses)
            funnels.append(swept(outlines))
            self.inlets.append(outlines[0])
            self.outlets.append(outlines[-1])
            if self.obstacles:
                bodies.append(body_region(funnel, own, poses, problem.footprint))
        self.asked = _asked(problem, self.course) if result.segments else {}
        self.funnel, self.body = shapely.union_all(funnels), shapely.union_all(bodies)
        self.cars = [positions(self.course, cars.theta, cars.x) for cars in result.rollouts]

    @property
    def view(self) -> tuple[float, float, float, float]:
        """Lower and upper end in x and y (m): all but for obstacles that reach far."""
        shapes = [
            self.funnel,
            self.body,
            shapely.linestrings(self.line),
            *map(shapely.linestrings, self.asked.values()),
        ]
        ends = np.array(shapely.GeometryCollection(shapes).bounds)
        for cars in self.cars:
            points = cars.reshape(-1, 2)
            ends = _around(ends, np.concatenate([points.min(axis=0), points.max(axis=0)]))
        size = max(ends[2] - ends[0], ends[3] - ends[1])
        reach = REACH * size * np.array([-1.0, -1.0, 1.0, 1.0])
        outer = shapely.box(*(ends + reach))
        for obstacle in self.obstacles:
            if not (seen := shapely.intersection(obstacle, outer)).is_empty:
                ends = _around(ends, np.array(seen.bounds))
        x0, y0, x1, y1 = ends
        spare = MARGIN * size
        return float(x0 - spare), float(x1 + spare), float(y0 - spare), float(y1 + spare)

    def draw(self, axes: "Axes") -> None:
        """All of it, in metres, equal in both directions."""
        if self.obstacles:
            _fill(axes, self.body, facecolor=BODY_COLOUR, edgecolor=BODY_EDGE_COLOUR, lw=0.8)
        _fill(axes, self.funnel, facecolor=FUNNEL_COLOUR, edgecolor=EDGE_COLOUR, lw=1.0)
        for obstacle in self.obstacles:
            _fill(axes, obstacle, facecolor=OBSTACLE_COLOUR, edgecolor="none")
        axes.plot(*self.line.T, color=REFERENCE_COLOUR, lw=0.9, ls=(0, (4, 3)))
        for cars in self.cars:
            for car in range(cars.shape[1]):
                colour = CAR_COLOURS[car % len(CAR_COLOURS)]
                axes.plot(*cars[:, car].T, color=colour, lw=0.6, alpha=0.8)
                axes.plot(*cars[0, car], ".", color=colour, ms=2.5)
        for joint, outline in enumerate(self.inlets):
            axes.plot(*outline.T, color=INLET_COLOUR, lw=0.8 if joint else 1.4, zorder=3)
        for joint, outline in enumerate(reversed(self.outlets)):
            axes.plot(*outline.T, color=GOAL_COLOUR, lw=0.8 if joint else 1.4, zorder=3)
        for name, outline in self.asked.items():
            axes.plot(*outline.T, color=ASKED_COLOURS[name], lw=1.1, ls=ASKED, zorder=3)
        if (failed := self.result.failed_at) is not None:
            line = self.course(np.linspace(*failed, 200))[:, 1:]
            axes.plot(*line.T, color=FAILED_COLOUR, lw=3.0, solid_capstyle="round", zorder=4)
            if failed[0] == failed[1]:
                axes.plot(*line[0], "x", color=FAILED_COLOUR, ms=7, mew=2, zorder=4)
        x0, x1, y0, y1 = self.view
        axes.set(xlabel="$x$ (m)", ylabel="$y$ (m)", xlim=(x0, x1), ylim=(y0, y1))
        axes.set_aspect("equal")

    def handles(self) -> "list[Artist]":
        """Of the legend: what there is."""
        reference = Line2D([], [], color=REFERENCE_COLOUR, lw=0.9, ls=(0, (4, 3)), label="reference")
        found: list[Artist] = []
        if self.inlets:
            found += [
                Patch(facecolor=FUNNEL_COLOUR, edgecolor=EDGE_COLOUR, label="funnel"),
                Line2D([], [], color=INLET_COLOUR, lw=1.4, label=START),
                Line2D([], [], color=GOAL_COLOUR, lw=1.4, label=END),
            ]
            found += [Line2D([], [], color=ASKED_COLOURS[name], lw=1.1, ls=ASKED, label=name) for name in self.asked]
        found.append(reference)
        if self.obstacles:
            found.append(Patch(facecolor=OBSTACLE_COLOUR, label="obstacle"))
            if self.inlets:
                found.insert(1, Patch(facecolor=BODY_COLOUR, edgecolor=BODY_EDGE_COLOUR, label="reach of the body"))
        if self.cars:
            found.append(Line2D([], [], color=CAR_COLOURS[0], lw=0.8, label="cars"))
        if self.result.failed_at is not None:
            found.append(Line2D([], [], color=FAILED_COLOUR, lw=3.0, label="here the proof failed"))
        return found


def _asked(problem: Problem, course: Course) -> dict[str, Float[np.ndarray, "96 2"]]:
    """Outlines (m, inertial frame) of I where the path begins and of G where it ends: of their positions."""
    ends = np.array([0.0, sum(segment.duration for segment in problem.path.curve)])
    found = {}
    for name, ellipsoid, pose in zip((INLET, GOAL), (problem.inlet, problem.goal), course(ends), strict=True):
        if ellipsoid is not None:
            outline = ellipse_outline(np.diag(np.square(ellipsoid.half_axes[1:3])))
            found[name] = _placed(pose[None], outline.T[None])[0]
    return found


def _around(ends: np.ndarray, others: np.ndarray) -> np.ndarray:
    """The box around two boxes."""
    return np.concatenate([np.minimum(ends[:2], others[:2]), np.maximum(ends[2:], others[2:])])


def _fill(axes: "Axes", region: shapely.Geometry, **style: object) -> None:
    """A region with its holes."""
    for part in shapely.get_parts(shapely.orient_polygons(region)):
        if isinstance(part, shapely.Polygon) and not part.is_empty:
            rings = [np.asarray(ring.coords) for ring in (part.exterior, *part.interiors)]
            outline = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))
            axes.add_patch(PathPatch(outline, **style))
