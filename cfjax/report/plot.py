"""The picture of a run: the plane with the funnel's shadow, and beside it what goes on along θ; or a tube."""

import math
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from cfjax.report.along import draw_along, panels
from cfjax.report.plane import Plane
from cfjax.report.rounded import margin_text
from cfjax.report.style import STYLE
from cfjax.report.tube_plot import draw_tube
from cfjax.result import Result


WIDTH, TALLEST = 9.2, 5.2  # of the figure, in
PAD = 0.07  # in, around every part
WIDE = 1.75  # width over height of the plane, from which on the panels are below it
AROUND = 1.25  # in: title, labels and legend
BESIDE, PLANE_BESIDE = 3.4, 4.9  # in: the panels beside the plane, and what is left for it
ROW = 7  # entries of the legend beside each other, at most
PLANE_ABOVE, PLANE_TALLEST = 8.3, 4.2  # in: the plane above them
LEAST, LEAST_STACK = 3.9, 4.7  # in, of the whole; with more than one panel beside the plane


def save_picture(result: Result, path: Path) -> None:
    """Write funnel.png."""
    with matplotlib.rc_context(STYLE):
        picture_of(result).savefig(path, metadata={"Software": None})


def picture_of(result: Result) -> Figure:
    """The funnels along a path, or a tube, and the cars that were driven through."""
    if not result.problem.path.tube:
        figure = _draw_path(result)
    else:
        figure = Figure(figsize=(WIDTH, 6.4 if result.rollouts else 3.9), layout="constrained", dpi=160)
        if result.segments:
            draw_tube(figure, result)
    figure.suptitle(_title(result), fontsize=10)
    return figure


def _draw_path(result: Result) -> Figure:
    """The plane takes as much room as its shape asks for."""
    layout = ConstrainedLayoutEngine(w_pad=PAD, h_pad=PAD)
    plane, drawn = Plane(result), panels(result)
    x0, x1, y0, y1 = plane.view
    shape = (x1 - x0) / (y1 - y0)
    if shape > WIDE or not drawn:
        above = min(PLANE_ABOVE / shape, PLANE_TALLEST)
        rows = 2 if len(drawn) > 1 else 1
        below = (0.5 + 1.15 * rows) if drawn else 0.0
        figure = Figure(figsize=(WIDTH, above + below + AROUND), layout=layout, dpi=160)
        parts = figure.add_gridspec(2 if drawn else 1, 1, height_ratios=[above + 0.3, below] if drawn else None)
        axes = figure.add_subplot(parts[0])
        if drawn:
            # V on the left, where there are cars; the others on the right, above each other
            columns = 2 if len(drawn) > 2 else 1
            inner = parts[1].subgridspec(rows, columns)
            places = [inner[:, 0], inner[0, 1], inner[1, 1]] if columns == 2 else [inner[k, 0] for k in range(rows)]
            stack = [figure.add_subplot(place) for place in places]
            draw_along(stack, drawn, result, [stack[0], stack[-1]] if columns == 2 else stack[-1:])
    else:
        tall = min(max(PLANE_BESIDE / shape + AROUND, LEAST_STACK if len(drawn) > 1 else LEAST), TALLEST)
        figure = Figure(figsize=(WIDTH, tall), layout=layout, dpi=160)
        parts = figure.add_gridspec(1, 2, width_ratios=[min(PLANE_BESIDE, (tall - AROUND) * shape) + 0.5, BESIDE])
        axes = figure.add_subplot(parts[0])
        heights = [1.9 if len(drawn) > 1 and k == 0 and result.rollouts else 1.0 for k in range(len(drawn))]
        inner = parts[1].subgridspec(len(drawn), 1, height_ratios=heights)
        stack = [figure.add_subplot(inner[k]) for k in range(len(drawn))]
        draw_along(stack, drawn, result, stack[-1:])
    plane.draw(axes)
    handles = plane.handles()
    rows = math.ceil(len(handles) / ROW)
    columns = math.ceil(len(handles) / rows)
    figure.legend(handles=handles, loc="outside lower left", ncols=columns, fontsize=8, handlelength=1.6)
    return figure


def _title(result: Result) -> str:
    margin, found = result.margin_certified, result.margin_falsified
    parts = [f"{result.problem.path.name}, {result.problem.method.value.upper()}"]
    if tube := result.problem.path.tube:
        speed, curvature, acceleration = (
            f"{bounds.lower:.4g}" if not bounds.half else f"{bounds.lower:.4g} to {bounds.upper:.4g}"
            for bounds in (tube.speed, tube.curvature, tube.acceleration)
        )
        parts.append(f"$v_r$ {speed} m/s, $\\kappa$ {curvature} 1/m, $v_r'$ {acceleration} m/s$^2$")
    elif held := sum(found.span is not None for found in result.segments):
        parts.append("in one universal tube" if held == 1 else f"in universal tubes, {held} in turn")
    elif result.segments:
        parts.append(f"{result.segments[0].funnel.template.name} template")
    parts.append(result.verdict.value)
    if margin is not None:
        parts.append(rf"$\lambda = {margin_text(margin)}$ s$^{{-1}}$ proven")
    elif found is not None:
        parts.append(rf"$\lambda = {margin_text(found)}$ s$^{{-1}}$ falsified, nothing proven")
    return " · ".join(parts)
