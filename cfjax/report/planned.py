"""The picture of a plan: the map, the path, the shadow of its tubes, what the body sweeps, and the closest approach."""

import math

import numpy as np
import shapely

from cfjax.funnel import Funnel, template_named
from cfjax.planner import Plan
from cfjax.report.marks import BODY, END, NEAREST, OBSTACLE, REFERENCE, START, TUBE, Axis, Lines, Panel, rings_of
from cfjax.report.plane import body_region, obstacle_region, shadows, swept
from cfjax.tubes import CertifiedTube


SPACING = 0.2  # half-widths of a tube between its shadows
MARGIN = 0.03  # of the size of the picture, around all


def plan_panel(plan: Plan) -> Panel:
    """The plane, with all that the plan speaks of."""
    tubes, bodies, lines = [], [], []
    ends = []
    for stretch in plan.following.tubes:
        funnel = _funnel(stretch.tube)
        segment = plan.path.curve[stretch.segment]
        width = math.sqrt(float(stretch.tube.inverse[1, 1]))
        length = np.ptp(segment.speed.integrals(np.array([stretch.start, stretch.end])))
        theta = np.linspace(stretch.start, stretch.end, 2 + math.ceil(length / (SPACING * width)))
        poses = segment.poses(theta)
        outlines = shadows(funnel, theta, poses)
        tubes.append(swept(outlines))
        bodies.append(body_region(funnel, theta, poses, plan.footprint))
        lines.append(poses[:, 1:])
        ends += [outlines[0], outlines[-1]]
    obstacles = shapely.union_all([obstacle_region(obstacle) for obstacle in plan.map.obstacles])
    x0, y0, x1, y1 = _view(plan, shapely.union_all(bodies))
    seen = shapely.intersection(obstacles, shapely.box(x0, y0, x1, y1))
    near = [np.array([plan.place])] if plan.beside else []
    marks = (
        Lines(OBSTACLE, rings_of(seen)),
        Lines(BODY, rings_of(shapely.union_all(bodies))),
        Lines(TUBE, rings_of(shapely.union_all(tubes))),
        Lines(REFERENCE, lines),
        Lines(START, ends[:1]),
        Lines(END, ends[-1:]),
        Lines(NEAREST, near),
    )
    return Panel("plane", Axis("x (m)", (x0, x1)), Axis("y (m)", (y0, y1)), marks, equal=True)


def _funnel(tube: CertifiedTube) -> Funnel:
    shape = np.array([[float(entry) for entry in row] for row in tube.shape])
    return Funnel(template_named("contracting"), shape, 0.0, math.inf)


def _view(plan: Plan, body: shapely.Geometry) -> tuple[float, float, float, float]:
    """Lower and upper corner (m): the map's bounds, or its obstacles, and the body."""
    shapes = plan.map.shapes if plan.map.bounds is None else [shapely.box(*plan.map.bounds)]
    x0, y0, x1, y1 = shapely.GeometryCollection([*shapes, body]).bounds
    margin = MARGIN * max(x1 - x0, y1 - y0)
    return x0 - margin, y0 - margin, x1 + margin, y1 + margin
