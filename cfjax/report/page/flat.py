"""Figures over two axes: the plane, V along the way, inputs against their limits, margins along the path, sections."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely

from cfjax.problem import Interval
from cfjax.report.along import spans_of, stretches_of
from cfjax.report.page.cars import Car
from cfjax.report.page.figure import Figure, Trace, axis, band, layout, level, line
from cfjax.report.plane import ASKED_COLOURS, Plane, positions
from cfjax.report.rounded import margin_text, rounded_up, written
from cfjax.report.sections import sections_of
from cfjax.report.style import (
    BODY_COLOUR,
    BODY_EDGE_COLOUR,
    CAR_COLOURS,
    EDGE_COLOUR,
    END,
    FAILED_COLOUR,
    FUNNEL_COLOUR,
    GOAL_COLOUR,
    INLET_COLOUR,
    OBSTACLE_COLOUR,
    REFERENCE_COLOUR,
    START,
)
from cfjax.report.terms import input_label
from cfjax.result import Result


FINE = 5e-4  # of the plane's size, to which outlines of regions are kept
MOST_RINGS = 40  # starts or ends of funnels: more are no rings
SHOWN_INPUTS = 12  # cars
GAP = 0.4  # of the width, between panels side by side


def plane_figure(result: Result, plane: Plane, cars: list[Car]) -> Figure:
    """What funnel.png shows of the plane, to zoom into."""
    x0, x1, y0, y1 = plane.view
    fine = FINE * max(x1 - x0, y1 - y0)
    traces: list[Trace] = []
    if result.segments:
        if plane.obstacles:
            traces.append(_region(plane.body, fine, "reach of the body", BODY_COLOUR, BODY_EDGE_COLOUR))
        traces.append(_region(plane.funnel, fine, "funnel", FUNNEL_COLOUR, EDGE_COLOUR))
    seen = shapely.intersection(shapely.union_all(plane.obstacles), shapely.box(x0, y0, x1, y1))
    if not seen.is_empty:
        traces.append(_region(seen, fine, "obstacle", OBSTACLE_COLOUR, OBSTACLE_COLOUR))
    traces.append(
        _outline([plane.line[:: max(1, len(plane.line) // 2000)]], "reference", REFERENCE_COLOUR, 1.3, "dash")
    )
    traces += _grouped([(car.place[:, 0], car.place[:, 1], car) for car in cars], "x %{x:.3f} m, y %{y:.3f} m")
    for rings, colour, name in ((plane.inlets, INLET_COLOUR, START), (plane.outlets[::-1], GOAL_COLOUR, END)):
        if rings:
            traces.append(_outline(rings[:MOST_RINGS], name, colour, 1.6))
    traces += [_outline([ring], name, ASKED_COLOURS[name], 1.3, "dot") for name, ring in plane.asked.items()]
    if (failed := result.failed_at) is not None:
        place = plane.course(np.linspace(*failed, 60))[:, 1:]
        mark = {"mode": "lines+markers", "marker": {"symbol": "x", "size": 8}} if failed[0] == failed[1] else {}
        traces.append({**_outline([place], "here the proof failed", FAILED_COLOUR, 5.0), **mark})
    worst = [point for point in result.worst_points if point.condition == "d"]
    if worst and not any(found.span for found in result.segments):
        since = np.cumsum([0.0, *(segment.duration for segment in result.problem.path.curve)])
        theta = np.array([since[point.segment] + point.theta for point in worst])
        at = positions(plane.course, theta[:, None], np.array([point.x for point in worst])[:, None])[:, 0]
        marker = {"symbol": "diamond", "size": 10, "color": FAILED_COLOUR, "line": {"color": "white", "width": 1.5}}
        traces.append({**_outline([at], "worst point of (d)", FAILED_COLOUR, 1.0), "mode": "markers", "marker": marker})
    own = layout("x (m)", "y (m)")
    own["xaxis"] |= {"range": [x0, x1], "constrain": "domain"}
    own["yaxis"] |= {"range": [y0, y1], "scaleanchor": "x", "constrain": "domain"}
    return Figure("plane", "The funnel, the reference and the cars on the plane", traces, own, (x1 - x0) / (y1 - y0))


def value_figure(result: Result, cars: list[Car]) -> Figure:
    """V along the way of the cars."""
    traces = _grouped([(car.along, car.value, car) for car in cars], "V %{y:.4f} at %{x:.3f}")
    own = layout(_way_title(result), "V(θ, x)")
    funnel = result.segments[0].funnel
    own["yaxis"] |= {"range": [0, max(1.06, 1.04 * max(float(np.nanmax(car.value)) for car in cars))]}
    own["shapes"] = [band(funnel.beta_lower, 1.0), level(1.0)]
    own["annotations"] = [
        {
            "xref": "paper",
            "x": 1,
            "xanchor": "right",
            "y": funnel.beta_lower,
            "yanchor": "top",
            "text": f"shell V ∈ [{rounded_up(written(funnel.beta_lower))}, 1]",
            "showarrow": False,
            "font": {"size": 12},
            "bgcolor": "rgba(255,255,255,.8)",
        }
    ]
    return Figure("values", "V along the way of the cars", [{**trace, "showlegend": False} for trace in traces], own)


def input_figure(result: Result, cars: list[Car]) -> Figure:
    """What the law asks of the inputs, between their limits."""
    problem, names = result.problem, ("u0", *result.problem.vehicle.input_names)
    own = layout("", "")
    own["shapes"], own["annotations"] = [], []
    traces: list[Trace] = []
    share = 1.0 / len(names)
    for k, (name, box) in enumerate(zip(names, problem.inputs, strict=True)):
        number = "" if k == 0 else str(k + 1)
        top = 1 - k * share
        own[f"yaxis{number}"] = axis(
            input_label(name), domain=[top - share + 0.06, top], range=_around(box), nticks=6, anchor=f"x{number}"
        )
        own[f"xaxis{number}"] = axis(
            _way_title(result) if k == len(names) - 1 else "",
            anchor=f"y{number}",
            showticklabels=k == len(names) - 1,
            **({"matches": "x"} if k else {}),
        )
        low, high = _around(box)
        own["shapes"] += [band(low, box.lower, "#ffe3e3", f"y{number}"), band(box.upper, high, "#ffe3e3", f"y{number}")]
        own["shapes"] += [level(end, FAILED_COLOUR, f"y{number}", "dot") for end in {box.lower, box.upper}]
        curves = [(car.along, car.inputs[:, k], car) for car in cars[:SHOWN_INPUTS]]
        each = _grouped(curves, f"{name} %{{y:.4f}} at %{{x:.3f}}")
        for trace in each:
            traces.append({**trace, "xaxis": f"x{number}", "yaxis": f"y{number}", "showlegend": False})
    return Figure("inputs", "Inputs of the cars against their limits", traces, own)


def margin_figure(result: Result) -> Figure:
    """What is proven along the path, and what the falsifier found."""
    spans = spans_of(result)
    traces: list[Trace] = []
    top, bottom = 0.0, 0.0
    if result.margin_certified is not None:
        proven = [
            stretch
            for span, found in zip(spans, result.segments, strict=True)
            for stretch in stretches_of(found, *span)
        ]
        steps = [end for stretch in proven for end in (stretch.begin, stretch.end)]
        heights = [stretch.margin for stretch in proven for _ in range(2)]
        top = max(heights)
        traces.append(
            line(
                steps,
                heights,
                "certified",
                EDGE_COLOUR,
                2.0,
                fill="tozeroy",
                fillcolor=FUNNEL_COLOUR,
                **_hover(heights),
            )
        )
    falsified = np.array([found.margin_falsified for found in result.segments])
    if np.isfinite(falsified).any():  # tubes that came with the package are not searched again
        steps = [end for span in spans for end in span]
        traces.append(
            line(steps, each := np.repeat(falsified, 2), "falsified", REFERENCE_COLOUR, 1.6, "dash", **_hover(each))
        )
        top, bottom = max(top, float(np.nanmax(falsified))), min(0.0, float(np.nanmin(falsified)))
    own = layout("reference time θ (s)", "margin λ (1/s)")
    room = 0.12 * (top - bottom) or 1.0
    own["yaxis"] |= {"range": [bottom - room if bottom < 0 else 0.0, top + room]}
    own["xaxis"] |= {"range": [0.0, spans[-1][1]]}
    own["shapes"] = [level(0.0, "#adb5bd")] if bottom < 0 else []
    if (failed := result.failed_at) is not None:
        stripe = {
            **band(0.0, 1.0, FAILED_COLOUR, "paper"),
            "xref": "x",
            "x0": failed[0],
            "x1": failed[1],
            "opacity": 0.3,
        }
        own["shapes"].append({**stripe, "line": {"color": FAILED_COLOUR, "width": 1}})
    return Figure("margins", "The margin along the path, certified and falsified", traces, own)


def _hover(margins: Iterable[float]) -> dict[str, Any]:
    return {"text": [margin_text(float(each)) for each in margins], "hovertemplate": "%{text} 1/s at θ = %{x:.3f} s"}


def section_figure(result: Result) -> Figure:
    """Shadows of the first funnel, at θ = 0, with I and G on pairs of states."""
    own = layout("", "")
    traces: list[Trace] = []
    sections = list(sections_of(result))
    gap = GAP / len(sections)
    width = (1.0 - gap * (len(sections) - 1)) / len(sections)
    for k, section in enumerate(sections):
        number = "" if k == 0 else str(k + 1)
        begin = k * (width + gap)
        own[f"xaxis{number}"] = axis(
            section.labels[0], domain=[begin, min(begin + width, 1.0)], anchor=f"y{number}", nticks=5
        )
        own[f"yaxis{number}"] = axis(section.labels[1], anchor=f"x{number}", nticks=6)
        for shadow in section.shadows:
            is_funnel = shadow.colour == EDGE_COLOUR
            fill = {"fill": "toself", "fillcolor": FUNNEL_COLOUR} if is_funnel else {}
            dash = "dash" if shadow.colour == INLET_COLOUR else "solid"
            said = {**fill, "hoverinfo": "skip", "showlegend": not k}
            across, up = shadow.outline
            trace = line(across, up, shadow.role, shadow.colour, 2.0, dash, **said)
            traces.append({**trace, "xaxis": f"x{number}", "yaxis": f"y{number}", "legendgroup": shadow.role})
    return Figure("sections", "Shadows of the funnel, of I and of G on pairs of states", traces, own)


def _grouped(curves: list[tuple[np.ndarray, np.ndarray, Car]], says: str) -> list[Trace]:
    """Curves of cars of one colour as one trace with gaps: many traces are slow to draw."""
    traces = []
    for colour in CAR_COLOURS:
        own = [(x, y, car.number) for x, y, car in curves if car.colour == colour]
        if own:
            xs, ys = (np.concatenate([p for each in own for p in (each[k], [np.nan])][:-1]) for k in (0, 1))
            numbers = [n for x, _, n in own for n in [n] * (len(x) + 1)][:-1]
            first = {"legendgroup": "cars", "showlegend": colour == CAR_COLOURS[0]}
            said = {"customdata": numbers, "hovertemplate": f"car %{{customdata}}<br>{says}<extra></extra>"}
            traces.append(line(xs, ys, "cars", colour, 1.1, opacity=0.85, **first, **said))
    return traces


def _region(region: shapely.Geometry, fine: float, name: str, fill: str, edge: str) -> Trace:
    rings: list[np.ndarray] = []
    simple = shapely.orient_polygons(shapely.simplify(region, fine))  # holes turn the other way round and stay empty
    for part in shapely.get_parts(simple):
        if isinstance(part, shapely.Polygon) and not part.is_empty:
            rings += [np.asarray(ring.coords) for ring in (part.exterior, *part.interiors)]
    return {**_outline(rings, name, edge, 1.2), "fill": "toself", "fillcolor": fill}


def _outline(rings: list[np.ndarray], name: str, colour: str, width: float, dash: str = "solid") -> Trace:
    gap = np.full((1, 2), np.nan)
    corners = np.concatenate([part for ring in rings for part in (ring, gap)][:-1])
    return line(corners[:, 0], corners[:, 1], name, colour, width, dash, hoverinfo="skip")


def _way_title(result: Result) -> str:
    return "way of the reference (m)" if result.problem.path.tube else "reference time θ (s)"


def _around(box: Interval) -> list[float]:
    """An input's limits and a little more."""
    room = 0.12 * (box.upper - box.lower) or 0.2
    return [box.lower - room, box.upper + room]
