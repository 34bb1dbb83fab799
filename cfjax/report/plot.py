"""The picture of a funnel: its shadow on the plane with cars inside, and V along each rollout."""

from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from cfjax.funnel import Funnel
from cfjax.problem import Segment
from cfjax.report.style import (
    CAR_COLOURS,
    EDGE_COLOUR,
    FUNNEL_COLOUR,
    GOAL_COLOUR,
    INLET_COLOUR,
    REFERENCE_COLOUR,
    STYLE,
    draw_shell,
    ellipse_outline,
    rotation,
)
from cfjax.report.tube_plot import draw_tube
from cfjax.result import Result


if TYPE_CHECKING:
    from matplotlib.axes import Axes


def shadows(funnel: Funnel, segment: Segment, theta: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t 96 2"]:
    """Outlines (m, inertial frame) of the funnel's shadow on the x–y plane at each θ: ellipses."""
    outline = ellipse_outline(np.linalg.inv(funnel.shape)[1:3, 1:3])
    size = np.sqrt(np.broadcast_to(funnel.level(theta), theta.shape))
    poses = segment.poses(theta)
    turned = np.einsum("tij,jk->tki", rotation(poses[:, 0]), outline)
    return poses[:, None, 1:] + size[:, None, None] * turned


def positions(segment: Segment, theta: Float[np.ndarray, "t k"], x: Float[np.ndarray, "t k n"]) -> np.ndarray:
    """Positions of cars (m, inertial frame) from θ and the deviation; shape (t, k, 2)."""
    grid = np.linspace(0.0, segment.duration, 2001)
    table = segment.poses(grid)
    alpha, px, py = (np.interp(theta, grid, column) for column in table.T)
    turned = np.einsum("tkij,tkj->tki", rotation(alpha.ravel()).reshape(*alpha.shape, 2, 2), x[..., 1:3])
    return np.stack([px, py], -1) + turned


def save_picture(result: Result, path: Path) -> None:
    """Write funnel.png: every segment's funnel, or a tube, and the cars that were driven through it."""
    tube = result.problem.path.tube
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 6.4 if tube and result.rollouts else 3.9), layout="constrained", dpi=160)
        if tube and result.segments:
            draw_tube(figure, result)
        elif not tube:
            plane, values = figure.subplots(1, 2, width_ratios=[1.35, 1])
            _draw_plane(plane, result)
            _draw_values(values, result)
        figure.suptitle(_title(result), fontsize=10)
        figure.savefig(path, metadata={"Software": None})


def _title(result: Result) -> str:
    margin, found = result.margin_certified, result.margin_falsified
    parts = [f"{result.problem.path.name}, {result.problem.method.value.upper()}"]
    if tube := result.problem.path.tube:
        speed, curvature, acceleration = (
            f"{bounds.lower:.4g}" if not bounds.half else f"{bounds.lower:.4g} to {bounds.upper:.4g}"
            for bounds in (tube.speed, tube.curvature, tube.acceleration)
        )
        parts.append(f"$v_r$ {speed} m/s, $\\kappa$ {curvature} 1/m, $v_r'$ {acceleration} m/s$^2$")
    elif result.segments:
        parts.append(f"{result.segments[0].funnel.template.name} template")
    parts.append(result.verdict.value)
    if margin is not None:
        parts.append(rf"$\lambda$ = {margin:.3g} s$^{{-1}}$ proven")
    elif found is not None:
        parts.append(rf"$\lambda$ = {found:.3g} s$^{{-1}}$ falsified, nothing proven")
    return " · ".join(parts)


def _draw_plane(axes: "Axes", result: Result) -> None:
    for index, (segment, found) in enumerate(zip(result.problem.path.curve, result.segments, strict=False)):
        theta = np.linspace(0.0, segment.duration, 400)
        outlines = shadows(found.funnel, segment, theta)
        axes.add_collection(PolyCollection(list(outlines), facecolor=EDGE_COLOUR, edgecolor=EDGE_COLOUR, lw=1.2))
        axes.add_collection(PolyCollection(list(outlines), facecolor=FUNNEL_COLOUR, edgecolor="none"))
        line = segment.poses(theta)
        axes.plot(line[:, 1], line[:, 2], color=REFERENCE_COLOUR, lw=0.9, ls=(0, (4, 3)))
        if index < len(result.rollouts):
            cars = result.rollouts[index]
            where = positions(segment, cars.theta, cars.x)
            for car in range(where.shape[1]):
                colour = CAR_COLOURS[car % len(CAR_COLOURS)]
                axes.plot(where[:, car, 0], where[:, car, 1], color=colour, lw=0.6, alpha=0.8)
                axes.plot(*where[0, car], ".", color=colour, ms=2.5)
        axes.plot(*outlines[0].T, color=INLET_COLOUR, lw=1.2)
        axes.plot(*outlines[-1].T, color=GOAL_COLOUR, lw=1.2)
    axes.set(xlabel="$x$ (m)", ylabel="$y$ (m)")
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.margins(0.04)
    handles = [
        Patch(facecolor=FUNNEL_COLOUR, edgecolor=EDGE_COLOUR, label="funnel"),
        Line2D([], [], color=INLET_COLOUR, lw=1.2, label="start"),
        Line2D([], [], color=GOAL_COLOUR, lw=1.2, label="end"),
        Line2D([], [], color=REFERENCE_COLOUR, lw=0.9, ls=(0, (4, 3)), label="reference"),
        Line2D([], [], color=CAR_COLOURS[0], lw=0.8, label="cars"),
    ]
    axes.figure.legend(handles=handles, loc="outside lower left", ncols=5, fontsize=8, handlelength=1.6)


def _draw_values(axes: "Axes", result: Result) -> None:
    offset = 0.0
    for segment, cars in zip(result.problem.path.segments, result.rollouts, strict=False):
        for car in range(cars.theta.shape[1]):
            last = int(np.argmax(cars.theta[:, car])) + 1
            colour = CAR_COLOURS[car % len(CAR_COLOURS)]
            axes.plot(offset + cars.theta[:last, car], cars.value[:last, car], color=colour, lw=0.6, alpha=0.8)
        offset += segment.duration
    if result.segments:
        draw_shell(axes, result.segments[0].funnel)
    axes.set(xlabel=r"reference time $\theta$ (s)", ylabel=r"$V(\theta, x)$", ylim=(0, 1.05))
    axes.set_xlim(0, max(offset, 1e-9))
