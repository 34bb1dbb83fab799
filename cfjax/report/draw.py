"""Panels of marks by Matplotlib."""

import math
import re
from typing import TYPE_CHECKING

import matplotlib
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline

from cfjax.report.marks import Band, Kind, Lines, Note, Panel


if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

DOTTED = re.compile("(\\w)\N{COMBINING DOT ABOVE}")  # not every font puts the dot above its letter
DASHES = {"solid": "-", "dash": (0, (4, 3)), "dot": (0, (1, 1.2))}
SYMBOLS = {"dot": ("o", 2.0), "cross": ("x", 7.0), "diamond": ("D", 4.5)}  # with their sizes, pt


def draw(axes: "Axes", panel: Panel) -> None:
    """All marks of a panel, its titles and ends."""
    for place, mark in enumerate(panel.marks):
        layer = 1 + place / len(panel.marks)  # behind the axes' own lines
        if isinstance(mark, Lines):
            _draw_lines(axes, mark, layer)
        elif isinstance(mark, Band):
            _draw_band(axes, mark, layer, panel)
        else:
            _draw_note(axes, mark, layer)
    axes.set(xlabel=panel.across.title, ylabel=panel.up.title)
    # ticks are made when the figure is shown, and would have the fonts that are set by then
    family, size = matplotlib.rcParams["font.family"], matplotlib.rcParams["font.size"]
    axes.tick_params(labelsize=size, labelfontfamily=family)
    axes.autoscale_view()
    axes.set(
        **{name: axis.range for name, axis in (("xlim", panel.across), ("ylim", panel.up)) if axis.range is not None}
    )
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim" if panel.across.range is None else "box")


def handles(*panels: Panel) -> "list[Artist]":
    """The legend: the kinds with a name, each once."""
    marks = [mark for panel in panels for mark in panel.marks if not isinstance(mark, Note)]
    return [_handle(kind) for kind in dict.fromkeys(mark.kind for mark in marks) if kind.label]


def _handle(kind: Kind) -> "Artist":
    if kind.fill:
        return Patch(facecolor=kind.fill, edgecolor=kind.colour, lw=kind.width, label=kind.label)
    return Line2D([], [], label=kind.label, **_symbol(kind) if kind.symbol else _line(kind))


def _line(kind: Kind) -> dict:
    return {"color": kind.colour, "lw": kind.width, "ls": DASHES[kind.dash]}


def _symbol(kind: Kind) -> dict:
    marker, size = SYMBOLS[kind.symbol]
    edge = {"mec": "white", "mew": 0.6} if kind.symbol == "diamond" else {"mew": 2.0 if kind.symbol == "cross" else 0}
    return {"marker": marker, "ms": size, "ls": "none", "color": kind.colour, **edge}


def _draw_lines(axes: "Axes", mark: Lines, layer: float) -> None:
    kind = mark.kind
    if kind.symbol:
        for part in mark.parts:
            axes.plot(*part.T, zorder=layer, **_symbol(kind))
    elif kind.fill and mark.parts:
        outline = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in mark.parts))
        axes.add_patch(PathPatch(outline, facecolor=kind.fill, edgecolor=kind.colour, lw=kind.width, zorder=layer))
    else:
        look = {"alpha": kind.opacity, "capstyle": "round" if kind.dash == "solid" else "butt", "zorder": layer}
        axes.add_collection(LineCollection(list(mark.parts), **_line(kind), **look))


def _draw_band(axes: "Axes", mark: Band, layer: float, panel: Panel) -> None:
    kind = mark.kind
    span, line = (axes.axvspan, axes.axvline) if mark.upright else (axes.axhspan, axes.axhline)
    low, high = panel.ends(mark)
    if kind.fill and low < high:
        span(low, high, color=kind.fill, alpha=kind.opacity, lw=0, zorder=layer)
    for end in {mark.low, mark.high}:
        if math.isfinite(end):
            line(end, zorder=layer, **_line(kind))


def _draw_note(axes: "Axes", mark: Note, layer: float) -> None:
    axes.annotate(
        DOTTED.sub(r"$\\dot{\1}$", mark.text),
        (0.98, mark.at),
        xycoords=("axes fraction", "data"),
        xytext=(0, -3),  # a shell is narrower than a line of text in a low panel
        textcoords="offset points",
        ha="right",
        va="top",
        fontsize=matplotlib.rcParams["font.size"] - 1,
        zorder=layer,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
    )
