"""The funnel in space: its shadow on the plane, drawn upwards over θ or over a car's clock; or a tube along one path.

Over the clock a funnel is not one body: cars meet it sooner or later, for the timing of the reference is theirs. It is
drawn as the one car meets it that comes closest to its edge.
"""

from typing import Any

import numpy as np
import shapely

from cfjax.report.along import spans_of
from cfjax.report.page.cars import Car, ways_of
from cfjax.report.page.figure import FONT, INK, Figure, Trace, rounded
from cfjax.report.plane import Plane, positions, shadows
from cfjax.report.style import (
    EDGE_COLOUR,
    END,
    FAILED_COLOUR,
    GOAL_COLOUR,
    INLET_COLOUR,
    OBSTACLE_COLOUR,
    REFERENCE_COLOUR,
    START,
    ellipse_outline,
    rotation,
)
from cfjax.report.tube_plot import SHOWN_WAY, most_winding
from cfjax.result import Result


ROWS, CORNERS = 300, 32  # of the surface, over all funnels, at most; of an ellipse
FEWEST_ROWS = 8  # of a funnel
SHOWN_CARS = 10
ROW_WIDTH = 0.8  # m: between rows on a straight line a tenth of it
RINGS = 14  # at most, that show the shape
LONG, THIN = 60.0, 0.4  # in half-widths of the funnel: paths that long have lines so much thinner
LEAST_SHARE = 0.3  # of the longer side on the plane that the shorter one is drawn with
BLUES = [[0.0, "#e3eef9"], [0.5, "#a9cbe8"], [1.0, EDGE_COLOUR]]


def space_of_path(result: Result, plane: Plane, cars: list[Car]) -> Figure:
    """Funnels along a path."""
    course, spans = plane.course, spans_of(result)
    total = sum(segment.duration for segment in result.problem.path.curve)
    guide = max(cars, key=lambda car: float(np.nanmax(car.value)), default=None)

    def heights(theta: np.ndarray) -> dict[str, list[Any]]:
        """Of each row over both axes."""
        clock = theta if guide is None else np.interp(theta, guide.along, guide.clock)
        return {"theta": rounded(theta), "time": rounded(np.where(np.isfinite(theta), clock, np.nan))}

    traces: list[Trace] = []
    rows, thetas, rings, ring_thetas = [], [], [], []
    for (begin, end), found in zip(spans, result.segments, strict=True):
        # no more than it takes: where many transparent strips lie over each other they show
        theta = course.between(begin, end, ROW_WIDTH, ROWS)
        count = min(len(theta), max(FEWEST_ROWS, round(ROWS * (end - begin) / total)))
        theta = np.linspace(begin, end, count)
        outlines = shadows(found.funnel, theta - begin, course(theta))[:, :: 96 // CORNERS]
        outlines = np.concatenate([outlines, outlines[:, :1]], axis=1)
        rows += [*outlines, np.full_like(outlines[0], np.nan)]
        thetas += [*theta, np.nan]
        shown = np.linspace(0, count - 1, max(2, round(RINGS * (end - begin) / total))).round().astype(int)
        rings += list(outlines[shown])
        ring_thetas += list(theta[shown])
    if rows:
        surface = np.stack(rows[:-1])
        theta = np.array(thetas[:-1])
        traces.append(_surface(surface, heights(theta), "funnel", theta))
        traces.append(_rings(rings, heights(_repeated(ring_thetas)), EDGE_COLOUR, 2.0, ""))
        for at, colour, name in ((0, INLET_COLOUR, START), (-1, GOAL_COLOUR, END)):
            traces.append(_rings([rings[at]], heights(_repeated([ring_thetas[at]])), colour, 7.0, name))
    theta = np.linspace(0.0, total, ROWS)
    traces.append(_curve(course(theta)[:, 1:], heights(theta), "reference", REFERENCE_COLOUR, 4.0, "dash"))
    x0, x1, y0, y1 = plane.view
    for obstacle in plane.obstacles:
        seen = shapely.intersection(obstacle, shapely.box(x0, y0, x1, y1))
        for part in shapely.get_parts(seen):
            if isinstance(part, shapely.Polygon) and not part.is_empty:
                ring = np.asarray(part.exterior.coords)
                traces.append(_wall(ring, heights(np.array([0.0, total]))))
    reach = max((found.funnel.half_widths()[1:3].max() for found in result.segments), default=1.0)
    thin = THIN if max(x1 - x0, y1 - y0) > LONG * reach else 1.0
    traces += _ways(cars, guide, thin)
    if result.failed_at is not None:
        theta = np.linspace(*result.failed_at, 40)
        line = _curve(course(theta)[:, 1:], heights(theta), "here the proof failed", FAILED_COLOUR, 10.0)
        traces.append(line)
    worst = [point for point in result.worst_points if point.condition == "d"]
    ends = np.concatenate([[0.0], np.cumsum([s.duration for s in result.problem.path.curve])])
    if worst and not any(found.span for found in result.segments):
        theta = np.array([ends[point.segment] + point.theta for point in worst])
        x = np.array([point.x for point in worst])
        place = positions(course, theta[:, None], x[:, None])[:, 0]
        traces.append(
            {
                **_curve(place, heights(theta), "worst point of (d)", FAILED_COLOUR, 1.0),
                "mode": "markers",
                "marker": {
                    "symbol": "diamond",
                    "size": 5,
                    "color": FAILED_COLOUR,
                    "line": {"color": "white", "width": 1},
                },
            }
        )
    whose = " at u₀ = 1" if guide is None else f" of car {guide.number}"
    views = (
        ("theta", "x, y, θ", "reference time θ (s)"),
        ("time", "x, y, time", f"time t{whose} (s)"),
    )
    shape = np.array([x1 - x0, y1 - y0])
    return Figure("space", "The funnel in three dimensions", traces, _scene(shape, views[0][2]), views=views)


def space_of_tube(result: Result, cars: list[Car]) -> Figure:
    """A tube along one of the paths that it is proven for; along a straight one where no car was driven."""
    funnel = result.segments[0].funnel
    clocks: np.ndarray | None = None
    far = SHOWN_WAY * float(funnel.half_widths()[1])
    if result.rollouts:
        record = result.rollouts[0]
        number = most_winding(record)
        way = ways_of(record)[:, number]
        last = int(np.searchsorted(way, far)) + 1
        kept = np.unique(np.linspace(0, min(last, len(way)) - 1, ROWS).astype(int))
        poses, clocks, way = record.reference[kept, number], record.clock[kept, number], way[kept]  # pyright: ignore[reportOptionalSubscript]
        x = record.x[kept, number]
    else:
        way = np.linspace(0.0, 0.3 * far, 80)
        poses, x = np.stack([0 * way, 0 * way, way], axis=-1), None
    turns = rotation(poses[:, 0])
    outline = ellipse_outline(np.linalg.inv(funnel.shape)[1:3, 1:3])[:, :: 96 // CORNERS]
    outline = np.concatenate([outline, outline[:, :1]], axis=1)
    outlines = poses[:, None, 1:] + np.einsum("tij,jk->tki", turns, outline)

    def heights(rows: np.ndarray) -> dict[str, list[Any]]:
        return {"way": rounded(way[rows]), **({} if clocks is None else {"time": rounded(clocks[rows])})}

    every = np.arange(len(way))
    traces = [_surface(outlines, heights(every), "tube", way)]
    shown = np.linspace(0, len(way) - 1, RINGS).round().astype(int)
    repeated = np.repeat(shown, len(outline[0]) + 1)
    rings = _rings(list(outlines[shown]), heights(repeated), EDGE_COLOUR, 2.0, "")
    traces.append(rings)
    traces.append(_curve(poses[:, 1:], heights(every), "one of the paths", REFERENCE_COLOUR, 4.0, "dash"))
    if x is not None:
        place = poses[:, 1:] + np.einsum("tij,tj->ti", turns, x[:, 1:3])
        traces.append(_curve(place, heights(every), "a car", cars[0].colour, 5.0))
    views = [("way", "x, y, way", "way of the reference (m)")]
    if clocks is not None:
        views.append(("time", "x, y, time", "time t (s)"))
    span = np.ptp(outlines.reshape(-1, 2), axis=0)
    label = "The tube along one path in three dimensions"
    return Figure("space", label, traces, _scene(span, views[0][2]), views=tuple(views))


def _repeated(thetas: list[float]) -> np.ndarray:
    """θ of the corners of rings, with a gap after each."""
    return np.concatenate([[*([theta] * (CORNERS + 1)), np.nan] for theta in thetas])


def _surface(outlines: np.ndarray, heights: dict[str, list[Any]], name: str, shade: np.ndarray) -> Trace:
    """Rows of corners; the page's script spreads each row's height over its corners."""
    return {
        "type": "surface",
        "x": rounded(outlines[..., 0]),
        "y": rounded(outlines[..., 1]),
        "heights": heights,
        "spread": outlines.shape[1],
        "shades": rounded(shade),
        "colorscale": BLUES,
        "opacity": 0.55,
        "showscale": False,
        "hoverinfo": "skip",
        "name": name,
        "showlegend": True,
        "contours": {axis: {"highlight": False} for axis in "xyz"},
        "lighting": {"ambient": 0.75, "diffuse": 0.5, "specular": 0.06, "roughness": 0.9},
    }


def _wall(ring: np.ndarray, heights: dict[str, list[Any]]) -> Trace:
    both = np.stack([ring, ring])
    return {
        **_surface(both, heights, "obstacle", np.zeros(2)),
        "colorscale": [[0, OBSTACLE_COLOUR], [1, OBSTACLE_COLOUR]],
        "opacity": 0.3,  # what lies behind it is seen
    }


def _curve(
    place: np.ndarray, heights: dict[str, list[Any]], name: str, colour: str, width: float, dash: str = "solid"
) -> Trace:
    return {
        "type": "scatter3d",
        "mode": "lines",
        "x": rounded(place[:, 0]),
        "y": rounded(place[:, 1]),
        "heights": heights,
        "name": name,
        "line": {"color": colour, "width": width, "dash": dash},
        "hovertemplate": "x %{x:.3f} m<br>y %{y:.3f} m<br>%{z:.3f}<extra>" + name + "</extra>",
    }


def _rings(rings: list[np.ndarray], heights: dict[str, list[Any]], colour: str, width: float, name: str) -> Trace:
    gap = np.full((1, 2), np.nan)
    corners = np.concatenate([part for ring in rings for part in (ring, gap)])
    return {**_curve(corners, heights, name, colour, width), "hoverinfo": "skip", "showlegend": bool(name)}


def _ways(cars: list[Car], guide: Car | None, thin: float) -> list[Trace]:
    shown = cars[:SHOWN_CARS]
    if guide is not None and guide not in shown:
        shown = [*shown[:-1], guide]
    traces = []
    for k, car in enumerate(shown):
        heights = {"theta": rounded(car.along), "time": rounded(car.clock)}
        bold = car is guide
        way = _curve(
            car.place, heights, f"car {car.number}" if bold else "cars", car.colour, thin * (6.0 if bold else 2.5)
        )
        first = k == next((i for i, other in enumerate(shown) if other is not guide), 0)
        traces.append({**way, "legendgroup": "guide" if bold else "cars", "showlegend": bold or first})
    return traces


def _scene(span: np.ndarray, height: str) -> dict[str, Any]:
    ratio = np.maximum(span / span.max(), LEAST_SHARE)
    axes = {
        name: {
            "title": {"text": title},
            "backgroundcolor": "#f8f9fa",
            "gridcolor": "#dee2e6",
            "zerolinecolor": "#ced4da",
            "showspikes": False,
            "nticks": 6,
        }
        for name, title in (("xaxis", "x (m)"), ("yaxis", "y (m)"), ("zaxis", height))
    }
    return {
        "font": {"family": FONT, "size": 12, "color": INK},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "legend": {"orientation": "h", "x": 0, "y": 1, "yanchor": "top", "bgcolor": "rgba(255,255,255,.75)"},
        "uirevision": "kept",
        "scene": {
            **axes,
            "aspectmode": "manual",
            "aspectratio": {"x": 1.15 * float(ratio[0]), "y": 1.15 * float(ratio[1]), "z": 0.85},
            "camera": {"eye": {"x": 1.25, "y": -1.35, "z": 0.85}, "center": {"x": 0, "y": 0, "z": -0.08}},
        },
    }
