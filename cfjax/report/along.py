"""Panels along θ: V of the cars, the reference's curvature and speed, the margins proven and falsified."""

import itertools
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from cfjax.problem import Segment
from cfjax.report.style import (
    CAR_COLOURS,
    EDGE_COLOUR,
    FAILED_COLOUR,
    FUNNEL_COLOUR,
    REFERENCE_COLOUR,
    SPEED_COLOUR,
    draw_shell,
)
from cfjax.result import Result, SegmentResult, StretchMargin


if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_JOINTS = 60  # more lines than that are no lines
LEAST_SPAN = 1e-6  # 1/m and m/s: what varies less is constant and rounding

Panel = Callable[["Axes", Result], None]


def panels(result: Result) -> list[Panel]:
    """Those that say something: nothing varies along one steady segment, and without cars there is no V."""
    curve = result.problem.path.curve
    varies = len(curve) > 1 or not all(segment.is_steady for segment in curve)
    return [
        *([_draw_values] if result.rollouts else []),
        *([_draw_reference] if varies else []),
        *([_draw_margins] if varies and result.segments else []),
    ]


def draw_along(stack: "list[Axes]", drawn: list[Panel], result: Result, label: "list[Axes]") -> None:
    """Each panel into its axes, over the same θ; `label` are the lowest ones, which say what θ is."""
    joints = [begin for begin, _ in spans_of(result)][1:]
    for axes, panel in zip(stack, drawn, strict=True):
        panel(axes, result)
        if len(joints) <= MOST_JOINTS:
            for joint in joints:
                axes.axvline(joint, color="#adb5bd", lw=0.6, zorder=-1)  # behind the shell and its label
        if (failed := result.failed_at) is not None:
            axes.axvspan(*failed, color=FAILED_COLOUR, alpha=0.25, lw=0, zorder=0)
            for end in failed:
                axes.axvline(end, color=FAILED_COLOUR, lw=0.8, zorder=0)
        axes.set_xlim(0, _ends(result)[-1])
        axes.tick_params(labelbottom=axes in label)
    for axes in label:
        axes.set_xlabel(r"reference time $\theta$ (s)")


def spans_of(result: Result) -> list[tuple[float, float]]:
    """θ along the whole path (s), from which on and until when each of the result's funnels holds.

    Those are the path's segments, or the stretches in one universal tube.
    """
    own = list(itertools.pairwise(_ends(result)))
    return [found.span or own[index] for index, found in enumerate(result.segments)]


def _ends(result: Result) -> list[float]:
    """θ at which segments begin, and the last one's end."""
    return [0.0, *itertools.accumulate(segment.duration for segment in result.problem.path.curve)]


def _draw_values(axes: "Axes", result: Result) -> None:
    for cars in result.rollouts:
        for car in range(cars.theta.shape[1]):
            last = int(np.argmax(cars.theta[:, car])) + 1
            colour = CAR_COLOURS[car % len(CAR_COLOURS)]
            axes.plot(cars.theta[:last, car], cars.value[:last, car], color=colour, lw=0.6, alpha=0.8)
    draw_shell(axes, result.segments[0].funnel)
    axes.set(ylabel=r"$V(\theta, x)$", ylim=(0, 1.05))


def _draw_reference(axes: "Axes", result: Result) -> None:
    samples = [_sampled(segment) for segment in result.problem.path.curve]
    theta = np.concatenate([since + own for since, (own, _, _) in zip(_ends(result), samples, strict=False)])
    curvature, speed = (np.concatenate([sample[k] for sample in samples]) for k in (1, 2))
    axes.plot(theta, curvature, color=REFERENCE_COLOUR, lw=1.0)
    axes.set_ylabel(r"$\kappa$ (1/m)")
    low, high = min(0.0, curvature.min()), max(0.0, curvature.max())  # straight lies in the picture
    room = 0.12 * (high - low) if high - low > LEAST_SPAN else 1.0
    axes.set_ylim(low - room, high + room)
    if np.ptp(speed) > LEAST_SPAN:
        right = axes.twinx()
        right.spines["right"].set_visible(True)
        right.plot(theta, speed, color=SPEED_COLOUR, lw=1.0)
        right.set_ylabel(r"$v_r$ (m/s)", color=SPEED_COLOUR)
        right.tick_params(axis="y", colors=SPEED_COLOUR)
        right.set_ylim(0, 1.12 * speed.max())


def _sampled(segment: Segment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """θ of the segment (s), curvature (1/m) and speed (m/s)."""
    theta = np.linspace(0.0, segment.duration, 400)
    speed = segment.speed.values(theta)
    return theta, segment.turn_rate.values(theta) / speed, speed


def _draw_margins(axes: "Axes", result: Result) -> None:
    spans = spans_of(result)
    falsified = [found.margin_falsified for found in result.segments]
    top, bottom = max(0.0, *falsified), min(0.0, *falsified)
    if result.margin_certified is not None:
        proven = [
            stretch
            for span, found in zip(spans, result.segments, strict=True)
            for stretch in stretches_of(found, *span)
        ]
        steps = [stretch.begin for stretch in proven] + [proven[-1].end]
        heights = [stretch.margin for stretch in proven]
        axes.stairs(heights, steps, fill=True, facecolor=FUNNEL_COLOUR, lw=0)
        axes.stairs(heights, steps, baseline=None, color=EDGE_COLOUR, lw=1.2, label="proven")
        top = max(top, *heights)
    edges = [begin for begin, _ in spans] + [spans[-1][1]]
    if not np.isnan(falsified).all():  # as of tubes that came with the package
        axes.stairs(falsified, edges, baseline=None, color=REFERENCE_COLOUR, lw=0.9, ls=(0, (4, 3)), label="falsified")
    room = 0.12 * (top - bottom) or 1.0
    axes.set(ylabel=r"$\lambda$ (1/s)", ylim=(bottom - room if bottom < 0 else 0.0, top + room))
    if bottom < 0:
        axes.axhline(0.0, color="#adb5bd", lw=0.6, zorder=0)
    # above the panel: inside there is no place that is always free
    axes.legend(fontsize=7.5, ncols=2, loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0, handlelength=1.6)


def stretches_of(found: SegmentResult, begin: float, end: float) -> list[StretchMargin]:
    """What is proven along a funnel, θ along the whole path; in one piece where the stretches are not known."""
    if not found.stretches:
        return [StretchMargin(begin, end, found.margin_certified or 0.0)]
    return [StretchMargin(begin + each.begin, begin + each.end, each.margin) for each in found.stretches]
