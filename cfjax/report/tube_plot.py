"""The picture of a tube: its sections with I and G, one of the paths it is proven for, and V along the way of cars."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cfjax.funnel import Funnel
from cfjax.report.sections import Section, sections_of
from cfjax.report.style import (
    CAR_COLOURS,
    EDGE_COLOUR,
    FUNNEL_COLOUR,
    GOAL_COLOUR,
    INLET_COLOUR,
    REFERENCE_COLOUR,
    draw_shell,
    ellipse_outline,
    rotation,
)
from cfjax.result import Result, Rollouts


SHOWN_WAY = 60.0  # of one path, in lateral half-widths of the tube: enough to see it turn
MOST_OUTLINES = 300


def draw_tube(figure: Figure, result: Result) -> None:
    """All panels; without rollouts only the sections."""
    found, cars = result.segments[0], result.rollouts[0] if result.rollouts else None
    rows: Any = figure.subfigures(2 if cars else 1, 1, squeeze=False, height_ratios=[1.15, 1] if cars else None)
    if cars is not None:
        plane, values = rows[0, 0].subplots(1, 2, width_ratios=[1.5, 1])
        _draw_path(plane, found.funnel, cars)
        _draw_values(values, found.funnel, cars)
    below = rows[-1, 0]
    sections = list(sections_of(result))
    _draw_sections(below.subplots(1, len(sections)), sections)
    handles = [
        Line2D([], [], color=EDGE_COLOUR, lw=1.4, label="tube $V = 1$"),
        Line2D([], [], color=INLET_COLOUR, lw=1.2, label="starts $I$"),
    ]
    if result.problem.goal:
        handles.append(Line2D([], [], color=GOAL_COLOUR, lw=1.2, label="bound $G$"))
    below.legend(handles=handles, loc="outside lower left", ncols=3, fontsize=8, handlelength=1.6)


def _draw_path(axes: Axes, funnel: Funnel, cars: Rollouts) -> None:
    """The random path of one recorded car, turned to lie along the panel, the tube along it, and the car."""
    assert cars.reference is not None
    car = most_winding(cars)
    way = _way(cars)[:, car]
    last = int(np.searchsorted(way, SHOWN_WAY * float(funnel.half_widths()[1]))) + 1
    shown = np.unique(np.linspace(0, min(last, len(way)) - 1, MOST_OUTLINES).astype(int))
    poses, x = cars.reference[shown, car], cars.x[shown, car]
    centred = poses[:, 1:] - poses[:, 1:].mean(axis=0)[None, :]
    _, _, axes_of_path = np.linalg.svd(centred, full_matrices=False)
    # a rotation, not a reflection: left stays left
    turn = axes_of_path * np.array([[1.0], [np.sign(np.linalg.det(axes_of_path))]])
    outline = ellipse_outline(np.linalg.inv(funnel.shape)[1:3, 1:3])
    turns = rotation(poses[:, 0])
    outlines = (poses[:, None, 1:] + np.einsum("tij,jk->tki", turns, outline)) @ turn.T
    line = poses[:, 1:] @ turn.T
    where = (poses[:, 1:] + np.einsum("tij,tj->ti", turns, x[:, 1:3])) @ turn.T
    origin = line[0]
    axes.add_collection(PolyCollection(list(outlines - origin), facecolor=EDGE_COLOUR, edgecolor=EDGE_COLOUR, lw=1.2))
    axes.add_collection(PolyCollection(list(outlines - origin), facecolor=FUNNEL_COLOUR, edgecolor="none"))
    axes.plot(*(line - origin).T, color=REFERENCE_COLOUR, lw=0.9, ls=(0, (4, 3)), label="one of the paths")
    axes.plot(*(where - origin).T, color=CAR_COLOURS[0], lw=0.9, label="a car")
    axes.plot(*(where[0] - origin), ".", color=CAR_COLOURS[0], ms=4)
    axes.set(xlabel="m", ylabel="m")
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    axes.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def most_winding(cars: Rollouts) -> int:
    """The path that turns most to and fro: what its heading varies by, less what is left of it in the end."""
    assert cars.reference is not None
    heading = cars.reference[:: max(1, len(cars.reference) // 40), :, 0]
    return int(np.argmax(np.abs(np.diff(heading, axis=0)).sum(axis=0) - np.abs(heading[-1] - heading[0])))


def _way(cars: Rollouts) -> Float[np.ndarray, "t k"]:
    """Length of the reference's way, m."""
    assert cars.reference is not None
    steps = np.linalg.norm(np.diff(cars.reference[..., 1:], axis=0), axis=-1)
    return np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])


def _draw_values(axes: Axes, funnel: Funnel, cars: Rollouts) -> None:
    way = _way(cars)
    for car in range(way.shape[1]):
        axes.plot(way[:, car], cars.value[:, car], color=CAR_COLOURS[car % len(CAR_COLOURS)], lw=0.5, alpha=0.8)
    draw_shell(axes, funnel)
    axes.set(xlabel="way of the reference (m)", ylabel="$V(x)$", ylim=(0, 1.05))
    axes.set_xlim(0, float(np.median(way[-1])))


def _draw_sections(panels: "np.ndarray", sections: Sequence[Section]) -> None:
    """Shadows of the tube, I and G on pairs of states."""
    for axes, section in zip(panels, sections, strict=True):
        for shadow in section.shadows:
            if shadow.colour == EDGE_COLOUR:
                axes.fill(*shadow.outline, color=FUNNEL_COLOUR)
            axes.plot(*shadow.outline, color=shadow.colour, lw=1.4 if shadow.colour == EDGE_COLOUR else 1.2)
        axes.set(xlabel=section.labels[0], ylabel=section.labels[1])
        axes.autoscale_view()
        axes.margins(0.06)
