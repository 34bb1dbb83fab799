"""The three pictures of docs/funnel.md, drawn from one certified run: what a deviation is, what is proven, and why.

`experiments/pictures.py` makes them.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from cfjax.control import MinNorm, descent_at, law_numbers
from cfjax.problem import deviation_rate
from cfjax.report.style import (
    CAR_COLOUR,
    EDGE_COLOUR,
    FUNNEL_COLOUR,
    GOAL_COLOUR,
    INLET_COLOUR,
    REFERENCE_COLOUR,
    ellipse_outline,
    rotation,
)
from cfjax.result import Result


if TYPE_CHECKING:
    from matplotlib.axes import Axes

ALPHA, LATERAL, ALONG = 0, 1, 2  # of the states (heading, x, y, …)
GRID, ARROWS = 161, 17  # points of a side
STATE = (-0.4, 0.2)  # heading (rad) and x (m) at which the box of inputs is drawn, before it is put on the shell
SHELL = 0.95  # V there


def frame(result: Result) -> Figure:
    """A car beside its reference, and the funnel around that: the deviation in the reference's frame."""
    (found,), (segment,) = result.segments, result.problem.path.curve
    theta = np.linspace(0, 0.2 * segment.duration, 200)
    poses = segment.poses(theta)
    at = 110
    figure = Figure(figsize=(6.4, 3.3), layout="constrained", dpi=150)
    axes = figure.add_subplot()
    shadow = np.linalg.inv(found.funnel.shape)[1:3, 1:3]
    for k in range(0, 200, 66):
        level = found.funnel.level(theta[k])
        outline = rotation(poses[k : k + 1, 0])[0] @ ellipse_outline(level * shadow) + poses[k, 1:, None]
        axes.add_patch(Polygon(outline.T, facecolor=FUNNEL_COLOUR, edgecolor=EDGE_COLOUR, lw=0.6, alpha=0.55))
    axes.plot(*poses[:, 1:].T, color=REFERENCE_COLOUR, lw=1.2)
    turn, origin = rotation(poses[at : at + 1, 0])[0], poses[at, 1:]
    ahead, aside = turn @ [0.0, 1.0], turn @ [1.0, 0.0]
    deviation = np.array([0.34, 0.2])  # x and y, m
    car = origin + turn @ deviation
    for direction, label, shift in ((ahead, "$y$", (-0.03, 0.05)), (aside, "$x$", (0.05, -0.02))):
        axes.annotate(
            "", origin + 0.62 * direction, origin, arrowprops={"arrowstyle": "-|>", "color": REFERENCE_COLOUR}
        )
        axes.text(*(origin + 0.66 * direction + shift), label, ha="center", va="center")
    corner = origin + turn @ [deviation[0], 0.0]
    axes.plot(*np.stack([corner, car]).T, color=CAR_COLOUR, lw=0.9, ls=":")
    _draw_car(axes, origin, float(poses[at, 0]), REFERENCE_COLOUR, 0.35)
    _draw_car(axes, car, float(poses[at, 0]) + 0.45, CAR_COLOUR, 1.0)
    axes.annotate(
        r"reference $x_r(\theta)$", origin, (-118, -42), textcoords="offset points", fontsize=9,
        arrowprops={"arrowstyle": "-", "lw": 0.6},
    )  # fmt: skip
    axes.annotate(
        r"car: deviation $(\alpha, x, y, v)$", car, (26, 22), textcoords="offset points", fontsize=9,
        color=CAR_COLOUR, arrowprops={"arrowstyle": "-", "lw": 0.6, "color": CAR_COLOUR},
    )  # fmt: skip
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()
    return figure


def _draw_car(axes: "Axes", place: np.ndarray, heading: float, colour: str, alpha: float) -> None:
    """A wedge whose nose looks along the heading; the rear axle lies at `place`."""
    wedge = np.array([[-0.07, -0.03], [0.07, -0.03], [0.0, 0.27]])
    outline = wedge @ rotation(np.array([heading]))[0].T + place
    axes.add_patch(Polygon(outline, facecolor=colour, edgecolor="none", alpha=alpha, zorder=4))
    axes.plot(*place, "o", color=colour, ms=3, zorder=5)


def sets(result: Result) -> Figure:
    """The lateral deviation along θ: from I to G, inside S; and V of the same cars."""
    ((found,), (cars,)) = result.segments, result.rollouts
    problem, funnel = result.problem, found.funnel
    end = funnel.duration
    figure = Figure(figsize=(7.6, 2.9), layout="constrained", dpi=150)
    plane, values = figure.subplots(1, 2, width_ratios=[1.25, 1])
    theta = np.linspace(0, end, 200)
    width = np.array([funnel.half_widths(float(t))[LATERAL] for t in theta])
    plane.fill_between(theta, -width, width, color=FUNNEL_COLOUR, lw=0, label=r"the funnel, $V \leq 1$")
    for sign in (-1, 1):
        plane.plot(theta, sign * width, color=EDGE_COLOUR, lw=1.0)
        if problem.safe is not None:
            plane.axhline(sign * problem.safe.half_widths[LATERAL], color=REFERENCE_COLOUR, lw=0.9, ls="--")
    for place, reach, colour, name in (
        (0.0, problem.inlet.half_axes[LATERAL], INLET_COLOUR, "$I$"),
        (end, problem.goal.half_axes[LATERAL], GOAL_COLOUR, "$G$"),
    ):
        plane.plot([place, place], [-reach, reach], color=colour, lw=4, solid_capstyle="butt", zorder=3)
        plane.text(place, -reach - 0.05, name, color=colour, ha="center", va="top")
    if problem.safe is not None:
        plane.text(
            0.5 * end, problem.safe.half_widths[LATERAL] - 0.04, "edge of $S$", ha="center", va="top", fontsize=8
        )
    for car in range(min(12, cars.theta.shape[1])):
        last = int(np.argmax(cars.theta[:, car])) + 1
        plane.plot(cars.theta[:last, car], cars.x[:last, car, LATERAL], color=CAR_COLOUR, lw=0.7)
        values.plot(cars.theta[:last, car], cars.value[:last, car], color=CAR_COLOUR, lw=0.7)
    plane.set(xlabel=r"reference time $\theta$ (s)", ylabel="deviation $x$ (m)", xlim=(-0.02 * end, 1.02 * end))
    values.axhspan(funnel.beta_lower, 1.0, color=FUNNEL_COLOUR, lw=0, zorder=0)
    values.axhline(1.0, color=EDGE_COLOUR, lw=1.0)
    values.text(end, funnel.beta_lower - 0.02, r"shell: $\dot V \leq -\lambda$", ha="right", va="top", fontsize=8)
    values.set(xlabel=r"reference time $\theta$ (s)", ylabel="$V$", xlim=(0, end), ylim=(0, 1.04))
    return figure


def decrease(result: Result) -> Figure:
    """Why V falls: V̇ under the law on a plane of deviations, and the inputs that are left at one of them."""
    (found,) = result.segments
    problem, funnel = result.problem, found.funnel
    numbers = law_numbers(problem, funnel, found.margin_certified or 0.0)
    point = problem.path.curve[0].point(0.0)
    law, template = MinNorm(), funnel.template
    figure = Figure(figsize=(7.6, 3.3), layout="constrained", dpi=150)
    plane, box = figure.subplots(1, 2, width_ratios=[1.2, 1])

    def motion(x: Float[np.ndarray, "k n"]) -> tuple[np.ndarray, np.ndarray]:
        """V̇ and the rates of heading and x under the law at θ = 0."""
        columns = tuple(jnp.asarray(x.T))
        descent = descent_at(problem.vehicle, template, numbers, point, 0.0, columns)
        inputs = law.choose(descent)
        rate = descent.rate + sum(
            slope * (v - centre) for slope, v, centre in zip(descent.slopes, inputs, descent.centre, strict=True)
        )
        rates = deviation_rate(problem.vehicle, columns, inputs, point)
        return np.asarray(rate), np.stack([np.broadcast_to(r, len(x)) for r in rates[:2]], axis=-1)

    def slice_of(count: int) -> tuple[np.ndarray, np.ndarray]:
        reach = 1.02 / np.sqrt(np.linalg.eigvalsh(funnel.shape[:2, :2]).min())
        side = np.linspace(-reach, reach, count)
        alpha, lateral = np.meshgrid(side, side)
        x = np.zeros((count * count, problem.dimension))
        x[:, ALPHA], x[:, LATERAL] = alpha.ravel(), lateral.ravel()
        return side, x

    side, x = slice_of(GRID)
    value = funnel.value(0.0, x).reshape(GRID, GRID)
    rate, _ = motion(x)
    inside = np.ma.masked_where(value > 1, rate.reshape(GRID, GRID))
    colours = plane.pcolormesh(side, side, inside, cmap="Blues_r", vmax=0.0, rasterized=True)
    figure.colorbar(colours, ax=plane, label=r"$\dot V$ under the law (1/s)", shrink=0.9)
    plane.contour(side, side, value, [funnel.beta_lower, 1.0], colors=[REFERENCE_COLOUR], linewidths=[0.6, 1.0])
    _, coarse = slice_of(ARROWS)
    within = funnel.value(0.0, coarse) < 1
    _, way = motion(coarse[within])
    plane.quiver(*coarse[within][:, :2].T, *way.T, color=REFERENCE_COLOUR, width=0.004, alpha=0.7)
    state = np.zeros((1, problem.dimension))
    state[0, [ALPHA, LATERAL]] = STATE
    state *= np.sqrt(SHELL / float(funnel.value(0.0, state)[0]))
    plane.plot(*state[0, :2], "o", color=CAR_COLOUR, ms=5)
    plane.set(xlabel="deviation of the heading (rad)", ylabel="deviation $x$ (m)")
    plane.set_title(r"$y = v = 0$: levels $\underline{\beta}$ and 1, and the way of cars", fontsize=9)
    _draw_box(box, result, state)
    return figure


def _draw_box(axes: "Axes", result: Result, state: np.ndarray) -> None:
    """Inputs (timing, steering) at one state, thrust as the law has it: those that bring V down, and the law's."""
    (found,), problem = result.segments, result.problem
    numbers = law_numbers(problem, found.funnel, found.margin_certified or 0.0)
    point = problem.path.curve[0].point(0.0)
    descent = descent_at(problem.vehicle, found.funnel.template, numbers, point, 0.0, tuple(state[0]))
    inputs = [float(v) for v in MinNorm().choose(descent)]
    slopes, centre = [float(s) for s in descent.slopes], [float(c) for c in descent.centre]
    (u_low, u_high), (w_low, w_high) = ((i.lower, i.upper) for i in problem.inputs[:2])
    timing, steering = np.meshgrid(np.linspace(u_low, u_high, GRID), np.linspace(w_low, w_high, GRID))
    others = sum(slopes[k] * (inputs[k] - centre[k]) for k in range(2, len(slopes)))
    rate = float(descent.rate) + slopes[0] * (timing - centre[0]) + slopes[1] * (steering - centre[1]) + others
    demand = -float(numbers.decrease)
    axes.contourf(timing, steering, rate, [-1e9, demand], colors=[FUNNEL_COLOUR])
    axes.contour(timing, steering, rate, [demand], colors=[EDGE_COLOUR], linewidths=1.2)
    axes.add_patch(
        Rectangle((u_low, w_low), u_high - u_low, w_high - w_low, fill=False, edgecolor=REFERENCE_COLOUR, lw=1.0)
    )
    axes.plot(*centre[:2], "s", color=REFERENCE_COLOUR, ms=5, label="what the reference needs")
    axes.plot(*inputs[:2], "o", color=CAR_COLOUR, ms=6, label="the law's choice")
    axes.set(xlabel=r"timing $u_0$", ylabel=r"steering $w = \tan\gamma$")
    axes.set_title(r"the box of inputs at the dot: $\dot V \leq -\lambda'$ is blue", fontsize=9)
    axes.margins(0.06)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, fontsize=8, handletextpad=0.3)


DRAWN: dict[str, Callable[[Result], Figure]] = {
    "funnel_frame": frame,
    "funnel_sets": sets,
    "funnel_decrease": decrease,
}
