"""The picture of a run: the plane with the funnel's shadow, and beside it what goes on along θ; or a tube."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from cfjax import coerce
from cfjax.report.draw import draw, handles
from cfjax.report.marks import Panel
from cfjax.report.panels import shown_of
from cfjax.report.style import PAPER, STYLE, WIDTHS
from cfjax.result import Result
from cfjax.rounded import margin_text


if TYPE_CHECKING:  # a run does not wait for the planner's imports
    from cfjax.planner import Plan


POINTS = 100_000  # of all cars together
WIDTH, TALLEST = 9.2, 5.2  # of the figure, in, unless a width is asked for
NARROW = 5.5  # in: a narrower figure has its panels below each other
CM = 1 / 2.54  # in
LEAST_WIDTH, MOST_WIDTH = 6.0, 60.0  # cm
PAD = 0.07  # in, around every part
WIDE = 1.75  # width over height of the plane, from which on the panels are below it
AROUND = 1.25  # in: title, labels and legend
BESIDE, PLANE_BESIDE = 0.37, 0.53  # of the width: the panels beside the plane, and what is left for it
ENTRY = 1.5  # in: an entry of the legend
MARGIN, PLANE_TALLEST = 0.9, 4.2  # in: the plane above the panels
LEAST = 3.9  # in, of the whole
LETTER = 0.075  # of the least height of a panel in a stack: of its title, which has to fit
# of files by suffix: no dates and versions, so that the same picture is the same file
UNDATED = {".png": {"Software": None}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}


def save_picture(result: Result, path: Path, width: str | float | None = None) -> None:
    """Write `plot(result, width=width)`, as PNG, SVG or PDF by the file's suffix."""
    figure = plot(result, width=width)
    with matplotlib.rc_context(STYLE):
        figure.savefig(path, metadata=UNDATED[path.suffix])


def plot(
    result: "Result | Plan", panel: str | None = None, axes: Axes | None = None, width: str | float | None = None
) -> Figure:
    """The funnels along a path, or a tube, and the cars that were driven through, as a Matplotlib figure.

    `result.plot()` is the same. `result.plot().savefig("funnel.pdf")` writes it for a paper.

    Args:
        result: what `cfjax.synthesize` returned; or `cfjax.plan`, whose picture is a plane alone.
        panel: one panel alone: "plane", "values" (V along the cars' ways), "input u0" and the other inputs,
            "curvature", "speed", "margins", "section 1" and so on, as far as the result has them. None: all of it.
        axes: where the panel is drawn. None: in a figure of its own.
        width: of the figure for a paper, which has the title in its caption: "column" (8.8 cm), "page" (18.1 cm), or
            cm. None: as wide as a screen shows well, with a title.

    Raises:
        InputError: where the result has no such panel.
    """
    coerce.optional("axes", axes, Axes)
    wide = None if width is None else _inches(width)
    with matplotlib.rc_context(PAPER if wide else STYLE):
        if axes is not None:
            draw(axes, _panel(result, panel))
            figure = axes.get_figure(root=True)
            assert figure is not None
            return figure
        if not isinstance(result, Result):
            figure = _mapped(_panel(result, panel), wide or WIDTH)
        elif panel is None:
            figure = _whole(result, wide)
        else:
            own = wide or PLANE_BESIDE * WIDTH
            figure = Figure(figsize=(own, own * LEAST / (PLANE_BESIDE * WIDTH)), layout="constrained", dpi=160)
            draw(figure.add_subplot(), _panel(result, panel))
        return figure


def _inches(width: str | float) -> float:
    """Raises InputError for what is no width."""
    known = WIDTHS[coerce.one_of("width", width, WIDTHS)] if isinstance(width, str) else width
    return CM * coerce.number("width", known, "cm", least=LEAST_WIDTH, most=MOST_WIDTH)


def _panel(result: "Result | Plan", name: str | None) -> Panel:
    if not isinstance(result, Result):
        from cfjax.planner import Plan
        from cfjax.report.planned import plan_panel

        said = "a Result, such as what cfjax.synthesize(problem) returns, or a Plan of cfjax.plan"
        found = plan_panel(result if isinstance(result, Plan) else coerce.refuse("result", said, result))
        return {found.name: found}[coerce.one_of("panel", name or found.name, (found.name,))]
    panels = {panel.name: panel for group in shown_of(result, POINTS).panels.values() for panel in group}
    return panels[coerce.one_of("panel", name, panels)]


def _mapped(panel: Panel, width: float) -> Figure:
    """The plane of a plan, its legend below it."""
    assert panel.shape is not None
    height = min(width / panel.shape, width) + MARGIN
    figure = Figure(figsize=(min(width, height * panel.shape + MARGIN), height), layout="constrained", dpi=160)
    draw(figure.add_subplot(), panel)
    figure.legend(handles=handles(panel), loc="outside lower center", ncols=max(2, int(width / ENTRY)))
    return figure


def _whole(result: Result, width: float | None) -> Figure:
    groups = shown_of(result, POINTS).panels
    above = groups.get("plane", []) + groups.get("values", [])
    title = "" if width else _title(result)
    if result.problem.path.tube:
        return _tube(above, groups.get("sections", []), title, width or WIDTH)
    profile = groups.get("profile", [])
    along = [*above[1:], *profile, *(groups.get("margins", []) if profile else [])]
    return compose(above[0], along, title, width or WIDTH)


def compose(plane: Panel, along: Sequence[Panel], title: str, width: float = WIDTH) -> Figure:
    """The plane, which takes as much room as its shape asks for, and below or beside it panels over one axis."""
    shape = plane.shape
    assert shape is not None
    heights = [max(1.0, LETTER * len(panel.up.title)) for panel in along]
    if shape > WIDE or not along or width < NARROW:
        columns = 2 if len(along) > 2 and width >= NARROW else 1  # the first on the left, the others on the right
        heights = heights[columns - 1 :]
        above, below = min((width - MARGIN) / shape, PLANE_TALLEST), 0.5 + 1.15 * sum(heights) if along else 0.0
        figure = _figure(above + below + AROUND, title, width)
        sizes = [above + 0.3, below] if along else [1.0]
        place, *rest = figure.add_gridspec(len(sizes), 1, height_ratios=sizes)
        places = []
        if along:
            inner = rest[0].subgridspec(len(heights), columns, height_ratios=heights)
            places = [*([inner[:, 0]] * (columns - 1)), *(inner[k, -1] for k in range(len(heights)))]
    else:
        if along[0].name == "values" and len(along) > 1:
            heights[0] = 1.9
        least = max(LEAST, AROUND + 0.9 * sum(heights))
        tall = max(least, min(PLANE_BESIDE * width / shape + AROUND, TALLEST))
        figure = _figure(tall, title, width)
        widths = [min(PLANE_BESIDE * width, (tall - AROUND) * shape) + 0.5, BESIDE * width]
        place, beside = figure.add_gridspec(1, 2, width_ratios=widths)
        inner = beside.subgridspec(len(along), 1, height_ratios=heights)
        places = [inner[k] for k in range(len(along))]
    draw(figure.add_subplot(place), plane)
    for panel, where in zip(along, places, strict=True):
        axes = figure.add_subplot(where)
        draw(axes, panel)
        if not where.is_last_row():  # those below say what the axis is
            axes.set_xlabel("")
            axes.tick_params(labelbottom=False)
    return _with_legend(figure, plane, *along)


def _tube(above: list[Panel], sections: list[Panel], title: str, width: float) -> Figure:
    """Where cars were driven, one of the paths and V; the sections below."""
    rows = [row for row in (above, sections) if row]
    if width < NARROW:
        rows = [*([panel] for panel in above), *(sections[k : k + 2] for k in range(0, len(sections), 2))]
    figure = _figure(1.4 + 2.5 * len(rows), title, width)
    grid = figure.add_gridspec(max(1, len(rows)), 1)
    for k, row in enumerate(rows):
        parts = grid[k].subgridspec(1, len(row))
        for place, panel in enumerate(row):
            draw(figure.add_subplot(parts[place]), panel)
    return _with_legend(figure, *above, *sections)


def _with_legend(figure: Figure, *panels: Panel) -> Figure:
    if entries := handles(*panels):
        most = int(figure.get_figwidth() / ENTRY)
        columns = math.ceil(len(entries) / math.ceil(len(entries) / most))
        size = matplotlib.rcParams["font.size"] - 1
        figure.legend(handles=entries, loc="outside lower left", ncols=columns, fontsize=size, handlelength=1.6)
    return figure


def _figure(height: float, title: str, width: float) -> Figure:
    figure = Figure(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=PAD, h_pad=PAD), dpi=160)
    if title:
        figure.suptitle(title, fontsize=10)
    return figure


def _title(result: Result) -> str:
    margin, found = result.margin_certified, result.margin_falsified
    parts = [f"{result.problem.path.name}, {result.problem.method.value.upper()}"]
    if tube := result.problem.path.tube:
        speed, curvature, acceleration = (
            f"{bounds.lower:.4g}" if not bounds.half else f"{bounds.lower:.4g} to {bounds.upper:.4g}"
            for bounds in (tube.speed, tube.curvature, tube.acceleration)
        )
        parts.append(f"vᵣ {speed} m/s, κ {curvature} 1/m, v̇ᵣ {acceleration} m/s²")
    elif held := sum(found.span is not None for found in result.segments):
        parts.append("in one universal tube" if held == 1 else f"in universal tubes, {held} in turn")
    elif result.segments:
        parts.append(f"{result.segments[0].funnel.template.name} template")
    parts.append(result.verdict.value)
    if margin is not None:
        parts.append(f"λ = {margin_text(margin)} 1/s proven")
    elif found is not None:
        parts.append(f"λ = {margin_text(found)} 1/s falsified, nothing proven")
    return " · ".join(parts)
