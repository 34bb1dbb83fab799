"""Panels of marks as plotly.js takes them: plain dictionaries, with no more digits than a screen shows.

plotly's Python classes would say the same, but importing them costs more time than the whole page.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely

from cfjax.report.marks import Axis, Band, Kind, Lines, Note, Panel, joined


DIGITS = 5  # of the largest number of an array
INK, GRID = "#343a40", "#e9ecef"
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif"
SCREEN = 1.5  # px, for a pt in print
FINE = 5e-4  # of their size, to which lines on a map are kept
ROW_GAP, COLUMN_GAP = 0.06, 0.4  # between panels: of the height; of the width, all together
SYMBOLS = {"dot": ("circle", 4), "cross": ("x", 9), "diamond": ("diamond", 8)}  # with their sizes, px

Trace = dict[str, Any]


class Figure(NamedTuple):
    """What the page's script hands to plotly.js. A figure in space may be shown over several third axes."""

    name: str
    label: str  # what it shows, for those who do not see it
    traces: list[Trace]
    layout: dict[str, Any]
    shape: float = 0.0  # width over height of what is drawn in metres; 0: it fills the room it gets
    views: tuple[tuple[str, str, str], ...] = ()  # key in a trace's `heights`, what the button says, title of the axis


def figure_of(name: str, label: str, panels: Sequence[Panel], beside: bool = False) -> Figure:
    """Panels below each other, over one axis, or beside each other."""
    layout = _layout()
    traces: list[Trace] = []
    labels: set[str] = set()
    for k, panel in enumerate(panels):
        number = str(k + 1) if k else ""
        across, up = axis(panel.across, anchor=f"y{number}"), axis(panel.up, anchor=f"x{number}")
        if len(panels) > 1 and beside:
            gap = COLUMN_GAP / len(panels)
            width = (1 - gap * (len(panels) - 1)) / len(panels)
            across |= {"domain": [k * (width + gap), min(k * (width + gap) + width, 1.0)], "nticks": 5}
        elif len(panels) > 1:
            top, is_last = 1 - k / len(panels), k == len(panels) - 1
            up |= {"domain": [top - 1 / len(panels) + ROW_GAP, top], "nticks": 6}
            across |= {
                "showticklabels": is_last,
                **({} if is_last else {"title": {"text": ""}}),
                **({"matches": "x"} if k else {}),
            }
        if panel.equal:
            up |= {"scaleanchor": f"x{number}"}
            for each in (across, up):
                each |= {"constrain": "domain"} if panel.across.range else {}
        layout[f"xaxis{number}"], layout[f"yaxis{number}"] = across, up
        for mark in panel.marks:
            if isinstance(mark, Lines):
                legend = {"showlegend": bool(mark.kind.label) and mark.kind.label not in labels}
                labels.add(mark.kind.label)
                traces.append({**_trace(mark, panel), **legend, "xaxis": f"x{number}", "yaxis": f"y{number}"})
            elif isinstance(mark, Band):
                layout["shapes"] += _shapes(mark, panel, number)
            else:
                layout["annotations"].append(_annotation(mark, number))
    layout["showlegend"] = len(labels - {""}) > 1
    return Figure(name, label, traces, layout, panels[0].shape or 0.0)


def rounded(values: np.ndarray | Sequence[float]) -> list[Any]:
    """Numbers as JSON has them: short, and None for what is not finite."""
    array = np.asarray(values, float)
    finite = np.isfinite(array)
    largest = float(np.abs(array[finite]).max(initial=0.0))
    places = DIGITS - 1 - math.floor(math.log10(largest)) if largest else 0
    short = np.round(array, int(np.clip(places, 0, 12)))
    numbers = short.astype(object)
    numbers[~finite] = None
    return numbers.tolist()


def look(kind: Kind, scale: float = SCREEN) -> Trace:
    """How lines or symbols of a kind are drawn, in a plane or in space."""
    shown: Trace = {"name": kind.label, "legendgroup": kind.label or None, "opacity": kind.opacity}
    if kind.symbol:
        symbol, size = SYMBOLS[kind.symbol]
        edge = {"color": "white", "width": 1.0} if kind.symbol == "diamond" else {"width": 0}
        return shown | {
            "mode": "markers",
            "marker": {"symbol": symbol, "size": size, "color": kind.colour, "line": edge},
        }
    return shown | {"mode": "lines", "line": {"color": kind.colour, "width": scale * kind.width, "dash": kind.dash}}


def _trace(mark: Lines, panel: Panel) -> Trace:
    """All parts as one trace, with gaps: many traces are slow to draw."""
    parts = [_simple(part) for part in mark.parts] if panel.equal and not mark.kind.symbol else mark.parts
    corners = joined(parts)
    trace = {"type": "scatter", "x": rounded(corners[:, 0]), "y": rounded(corners[:, 1]), **look(mark.kind)}
    if mark.kind.fill:
        trace |= {"fill": "toself", "fillcolor": mark.kind.fill}
    if not mark.each:
        return {**trace, "hoverinfo": "skip"}
    numbers = joined([np.full(len(part), k + 1.0) for k, part in enumerate(parts)])
    says = [f"{mark.each} %{{customdata}}", f"{panel.across.title}: %{{x:.4g}}", f"{panel.up.title}: %{{y:.4g}}"]
    if (text := panel.up.text) is not None:
        trace["text"] = [text(float(height)) for height in corners[:, 1]]
        says[2] = f"{panel.up.title}: %{{text}}"
    return {
        **trace,
        "hoveron": "points",
        "customdata": rounded(numbers),
        "hovertemplate": "<br>".join(says) + "<extra></extra>",
    }


def _simple(part: np.ndarray) -> np.ndarray:
    """A line on a map without the corners that nobody sees."""
    if len(part) < 3:
        return part
    return np.asarray(shapely.simplify(shapely.LineString(part), FINE * np.ptp(part, axis=0).max()).coords)


def _shapes(band: Band, panel: Panel, number: str) -> list[dict[str, Any]]:
    """An area over the whole width, behind all lines, and lines at its ends."""
    over, along = ("y", "x") if band.upright else ("x", "y")
    whole = {f"{over}ref": f"{over}{number} domain", f"{over}0": 0, f"{over}1": 1, f"{along}ref": f"{along}{number}"}
    low, high = panel.ends(band)
    line = {"color": band.kind.colour, "width": SCREEN * band.kind.width, "dash": band.kind.dash}
    ends = [end for end in sorted({band.low, band.high}) if math.isfinite(end)]
    area = {
        "type": "rect",
        "layer": "below",
        "fillcolor": band.kind.fill,
        "opacity": band.kind.opacity,
        "line": {"width": 0},
    }
    return [
        *([{**whole, **area, f"{along}0": low, f"{along}1": high}] if band.kind.fill and low < high else []),
        *({**whole, "type": "line", "line": line, f"{along}0": end, f"{along}1": end} for end in ends),
    ]


def _annotation(note: Note, number: str) -> dict[str, Any]:
    place = {
        "xref": f"x{number} domain",
        "x": 1,
        "xanchor": "right",
        "yref": f"y{number}",
        "y": note.at,
        "yanchor": "top",
    }
    return {**place, "text": note.text, "showarrow": False, "font": {"size": 12}, "bgcolor": "rgba(255,255,255,.8)"}


def _layout() -> dict[str, Any]:
    return {
        "font": {"family": FONT, "size": 13, "color": INK},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "margin": {"l": 58, "r": 14, "t": 10, "b": 48},
        "hovermode": "closest",
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom", "font": {"size": 12}},
        "shapes": [],
        "annotations": [],
    }


def axis(shown: Axis, **more: Any) -> dict[str, Any]:
    return {
        "title": {"text": shown.title, "standoff": 8},
        "gridcolor": GRID,
        "zeroline": False,
        "linecolor": "#ced4da",
        "ticks": "outside",
        "tickcolor": "#ced4da",
        "automargin": True,
        **({"range": list(shown.range)} if shown.range else {}),
        **more,
    }
