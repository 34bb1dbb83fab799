"""Figures as plotly.js takes them: plain dictionaries, with no more digits than a screen shows.

plotly's Python classes would say the same, but importing them costs more time than the whole page.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cfjax.report.style import EDGE_COLOUR, FUNNEL_COLOUR


DIGITS = 5  # of the largest number of an array
INK, GRID = "#343a40", "#e9ecef"
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif"

Trace = dict[str, Any]


class Figure(NamedTuple):
    """What the page's script hands to plotly.js. A figure in space may be shown over several third axes."""

    name: str
    label: str  # what it shows, for those who do not see it
    traces: list[Trace]
    layout: dict[str, Any]
    shape: float = 0.0  # width over height of what is drawn in metres; 0: it fills the room it gets
    views: tuple[tuple[str, str, str], ...] = ()  # key in a trace's `heights`, what the button says, title of the axis


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


def line(x: Any, y: Any, name: str, colour: str, width: float = 1.5, dash: str = "solid", **more: Any) -> Trace:
    """A curve over two axes."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": rounded(x),
        "y": rounded(y),
        "name": name,
        "line": {"color": colour, "width": width, "dash": dash},
        **more,
    }


def layout(x: str, y: str, **more: Any) -> dict[str, Any]:
    """Of a figure with two axes, with their titles."""
    return {
        "font": {"family": FONT, "size": 13, "color": INK},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "margin": {"l": 58, "r": 14, "t": 10, "b": 48},
        "hovermode": "closest",
        "showlegend": True,
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom", "font": {"size": 12}},
        "xaxis": axis(x),
        "yaxis": axis(y),
        **more,
    }


def axis(title: str, **more: Any) -> dict[str, Any]:
    return {
        "title": {"text": title, "standoff": 8},
        "gridcolor": GRID,
        "zeroline": False,
        "linecolor": "#ced4da",
        "ticks": "outside",
        "tickcolor": "#ced4da",
        "automargin": True,
        **more,
    }


def band(low: float, high: float, colour: str = FUNNEL_COLOUR, y: str = "y") -> dict[str, Any]:
    """A stripe over the whole width, behind the curves."""
    return {
        "type": "rect",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "yref": y,
        "y0": low,
        "y1": high,
        "fillcolor": colour,
        "line": {"width": 0},
        "layer": "below",
        "opacity": 0.6,
    }


def level(at: float, colour: str = EDGE_COLOUR, y: str = "y", dash: str = "solid") -> dict[str, Any]:
    """A line over the whole width."""
    return {
        "type": "line",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "yref": y,
        "y0": at,
        "y1": at,
        "line": {"color": colour, "width": 1.3, "dash": dash},
    }
