"""The funnel in space: its shadow on the plane, drawn upwards over θ or over a car's clock; or a tube along one path.

Over the clock a funnel is not one body: cars meet it sooner or later, for the timing of the reference is theirs. It is
drawn as the one car meets it that comes closest to its edge.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from cfjax.report.cars import CarTrace, Ride, ride_of
from cfjax.report.marks import CARS, FUNNEL, OBSTACLE, ONE_PATH, TUBE, Kind, Lines, joined
from cfjax.report.page.figure import FONT, INK, Figure, Trace, look, rounded
from cfjax.report.panels import Shown
from cfjax.report.plane import shadows
from cfjax.result import Result


ROWS, CORNERS = 300, 32  # of the surface, over all funnels, at most; of an ellipse
FEWEST_ROWS = 8  # of a funnel
SHOWN_CARS = 10
ROW_WIDTH = 0.8  # m: between rows on a straight line a tenth of it
RINGS = 14  # at most, that show the shape
SCALE = 4.5  # px, for a pt in print
RING, BOLD = 0.45, 1.4  # pt: lines of rings, and of the car whose clock it is
LONG, THIN = 60.0, 0.4  # in half-widths of the funnel: paths that long have lines so much thinner
LEAST_SHARE = 0.3  # of the longer side on the plane that the shorter one is drawn with

Heights = Callable[[np.ndarray], dict[str, list[Any]]]  # from θ (s) or way (m) of rows, by the key of a view
Leg = tuple[Float[np.ndarray, "t c 2"], Float[np.ndarray, " t"]]  # outlines (m), and θ or way of each


def space_of(result: Result, shown: Shown) -> Figure | None:
    """Funnels along a path, with what is on the plane, or a tube along one path; None for a tube that was not found."""
    if shown.plane is not None:
        return _of_path(result, shown)
    return _of_tube(result) if result.segments else None


def _of_path(result: Result, shown: Shown) -> Figure:
    assert shown.plane is not None
    course, end = shown.plane.course, shown.plane.end
    guide = max(shown.cars, key=lambda car: float(np.nanmax(car.value)), default=None)
    heights = _heights("theta", guide)
    legs = []
    for (begin, until), found in zip(result.spans, result.segments, strict=True):
        # no more rows than it takes: where many transparent strips lie over each other they show
        most = max(FEWEST_ROWS, round(ROWS * (until - begin) / end))
        theta = np.linspace(begin, until, min(len(course.between(begin, until, ROW_WIDTH, ROWS)), most))
        legs.append((shadows(found.funnel, theta - begin, course(theta)), theta))
    traces = _body(FUNNEL, legs, heights)
    (panel,) = shown.panels["plane"]
    for mark in panel.marks:
        if isinstance(mark, Lines) and mark.kind is OBSTACLE:
            traces += [_wall(ring, heights(np.array([0.0, end]))) for ring in mark.parts]
        elif isinstance(mark, Lines) and mark.theta:
            traces.append(_lines(mark, heights(joined(mark.theta))))
    span = np.ptp(np.array([panel.across.range, panel.up.range]), axis=1)
    reach = max((found.funnel.half_widths()[1:3].max() for found in result.segments), default=1.0)
    traces += _ways(shown.cars, guide, THIN if span.max() > LONG * reach else 1.0)
    whose = " at u₀ = 1" if guide is None else f" of car {guide.number}"
    views = ("theta", "x, y, θ", "reference time θ (s)"), ("time", "x, y, time", f"time t{whose} (s)")
    return Figure("space", "The funnel in three dimensions", traces, _scene(span, views[0][2]), views=views)


def _of_tube(result: Result) -> Figure:
    """Along a straight path where no car was driven."""
    ride = ride_of(result, ROWS)
    outlines = shadows(result.segments[0].funnel, 0 * ride.along, ride.poses)
    heights = _heights("way", ride)
    traces = _body(TUBE, [(outlines, ride.along)], heights)
    curves = [Lines(ONE_PATH, [ride.poses[:, 1:]]), *([] if ride.place is None else [Lines(CARS, [ride.place])])]
    traces += [_lines(mark, heights(ride.along)) for mark in curves]
    views = [("way", "x, y, way", "way of the reference (m)")]
    views += [] if ride.clock is None else [("time", "x, y, time", "time t (s)")]
    scene = _scene(np.ptp(outlines.reshape(-1, 2), axis=0), views[0][2])
    return Figure("space", "The tube along one path in three dimensions", traces, scene, views=tuple(views))


def _heights(key: str, guide: CarTrace | Ride | None) -> Heights:
    """Over both third axes; time is that of one car, and the reference's own where there is none."""

    def heights(along: np.ndarray) -> dict[str, list[Any]]:
        clock = along if guide is None or guide.clock is None else np.interp(along, guide.along, guide.clock)
        return {key: rounded(along), "time": rounded(clock)}

    return heights


def _body(kind: Kind, legs: list[Leg], heights: Heights) -> list[Trace]:
    """The surface of all legs, and rings that show its shape."""
    if not legs:
        return []
    total = sum(along[-1] - along[0] for _, along in legs)
    rows, rings, at = [], [], []
    for outlines, along in legs:
        closed = outlines[:, [*range(0, outlines.shape[1] - 1, outlines.shape[1] // CORNERS), 0]]
        count = max(2, round(RINGS * (along[-1] - along[0]) / total))
        shown = np.linspace(0, len(along) - 1, count).round().astype(int)
        rows.append(closed)
        rings += list(closed[shown])
        at += [np.full(closed.shape[1], each) for each in along[shown]]
    along = joined([own for _, own in legs])
    surface = _surface(joined(rows), heights(along)) | {
        "shades": rounded(along),
        "colorscale": [[0.0, "#e3eef9"], [0.5, "#a9cbe8"], [1.0, kind.colour]],
        "name": kind.label,
        "showlegend": True,
    }
    return [surface, _lines(Lines(replace(kind, label="", width=RING), rings), heights(joined(at)))]


def _surface(outlines: Float[np.ndarray, "t c 2"], heights: dict[str, list[Any]]) -> Trace:
    """Rows of corners; the page's script spreads each row's height over its corners."""
    return {
        "type": "surface",
        "x": rounded(outlines[..., 0]),
        "y": rounded(outlines[..., 1]),
        "heights": heights,
        "spread": outlines.shape[1],
        "shades": [0.0] * len(outlines),
        "opacity": 0.55,
        "showscale": False,
        "hoverinfo": "skip",
        "contours": {axis: {"highlight": False} for axis in "xyz"},
        "lighting": {"ambient": 0.75, "diffuse": 0.5, "specular": 0.06, "roughness": 0.9},
    }


def _wall(ring: Float[np.ndarray, "c 2"], heights: dict[str, list[Any]]) -> Trace:
    """Of an obstacle: what lies behind it is seen."""
    colours = [[0, OBSTACLE.colour], [1, OBSTACLE.colour]]
    return _surface(np.stack([ring, ring]), heights) | {"colorscale": colours, "opacity": 0.3}


def _lines(mark: Lines, heights: dict[str, list[Any]], thin: float = 1.0) -> Trace:
    place, label = joined(mark.parts), mark.kind.label
    hover = {"hovertemplate": f"x %{{x:.3f}} m<br>y %{{y:.3f}} m<br>%{{z:.3f}}<extra>{label}</extra>"}
    return {
        "type": "scatter3d",
        "x": rounded(place[:, 0]),
        "y": rounded(place[:, 1]),
        "heights": heights,
        "showlegend": bool(label),
        **look(mark.kind, SCALE * thin),
        **(hover if label else {"hoverinfo": "skip"}),
    }


def _ways(cars: list[CarTrace], guide: CarTrace | None, thin: float) -> list[Trace]:
    """Of some cars, and of the one whose clock it is."""
    others = [car for car in cars if car is not guide][: SHOWN_CARS - 1]
    groups = [(CARS, others), (replace(CARS, label=f"car {guide.number}", width=BOLD), [guide])] if guide else []
    traces = []
    for kind, own in groups:
        if own:
            columns = {
                name: rounded(joined(values))
                for name, values in (("theta", [car.along for car in own]), ("time", [car.clock for car in own]))
            }
            traces.append(_lines(Lines(kind, [car.place for car in own]), columns, thin))
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
