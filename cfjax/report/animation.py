"""A car in the funnel, moving: a GIF.

GIF, for matplotlib writes it with Pillow, which is installed wherever matplotlib is; a film would ask for ffmpeg. It is
read by every browser and on every page of a repository.
"""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from matplotlib.animation import PillowWriter
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from cfjax.problem import KinematicBicycle, Vehicle
from cfjax.report.draw import draw
from cfjax.report.marks import Axis, Panel
from cfjax.report.panels import shell, value_axis
from cfjax.report.plane import Plane, shadows
from cfjax.report.style import CAR_COLOUR, EDGE_COLOUR, INLET_COLOUR
from cfjax.result import Result
from cfjax.simulation.sampled import SampledLoop


if TYPE_CHECKING:
    from matplotlib.axes import Axes

FRAMES, RATE = 120, 20  # at most; a second
SIZE, RESOLUTION = (7.6, 4.0), 90  # in, dots per in
OVERHANG, WIDTH, WHEEL = 0.22, 0.6, 0.28  # of the wheelbase: beyond the axles, of the body, of a wheel's length
BODY = 0.3  # m, where the vehicle has no wheelbase


def save_animation(result: Result, loop: SampledLoop, path: Path) -> None:
    """Write the GIF: of the recorded cars the one with the largest V, the funnel's shadow at its θ, and V."""
    draft = path.with_name(f".part-{path.name}")
    try:
        _Scene(result, loop).write(draft)
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


class _Scene:
    """What stands, and what moves."""

    def __init__(self, result: Result, loop: SampledLoop) -> None:
        samples = loop.samples
        self.result, self.loop = result, loop
        self.car = int(np.nanargmax(loop.largest_value[samples.cars]))
        self.clock = samples.clock[:, self.car]
        last = int(np.argmax(self.clock))
        wanted = np.linspace(0.0, self.clock[last], min(FRAMES, last + 1))
        # samples are dense: the last one before a frame will do
        self.rows = np.minimum(np.searchsorted(self.clock[: last + 1], wanted, side="right") - 1, last)
        self.pace = float(self.clock[last]) / (max(len(self.rows) - 1, 1) / RATE)  # of the film, in seconds a second
        self.state, self.seen = samples.state[:, self.car], samples.measured[:, self.car]
        self.command, self.value = samples.command[:, self.car], samples.value[:, self.car]
        self.plane = Plane(result)
        duration = result.problem.path.duration
        theta = samples.theta[:, self.car]
        lap = np.floor(theta / duration) if result.problem.path.closed else np.zeros_like(theta)
        self.theta = np.clip(
            theta - np.where(theta - lap * duration > 0, lap, lap - (lap > 0)) * duration, 0.0, duration
        )

    def write(self, path: Path) -> None:
        figure = Figure(figsize=SIZE, layout="constrained", dpi=RESOLUTION)
        axes, side = figure.subplots(1, 2, width_ratios=[2.2, 1])
        draw(axes, self.plane.panel([]))
        x0, x1, y0, y1 = self.plane.view([self.state[:, 1:3]])
        axes.set(xlim=(x0, x1), ylim=(y0, y1))
        colour = CAR_COLOUR
        moving: dict[str, Any] = {
            "trail": axes.plot([], [], color=colour, lw=1.0)[0],
            "funnel": axes.plot([], [], color=INLET_COLOUR, lw=1.3)[0],
            "seen": axes.plot([], [], "+", color=EDGE_COLOUR, ms=6, mew=1.2)[0],
            "parts": [axes.add_patch(Polygon(np.zeros((3, 2)), zorder=5, lw=0.6)) for _ in range(5)],
            "value": side.plot([], [], color=colour, lw=1.0)[0],
            "now": side.plot([], [], ".", color=colour, ms=6)[0],
            "clock": side.set_title("", fontsize=9, loc="left"),
        }
        self._side(side)
        writer = PillowWriter(fps=RATE)
        with writer.saving(figure, str(path), RESOLUTION):
            for row in self.rows:
                self._move(moving, int(row))
                writer.grab_frame()

    def _side(self, side: "Axes") -> None:
        across = Axis("clock (s)", (0.0, float(self.clock.max()) or 1.0))
        draw(side, Panel("values", across, value_axis(self.value), shell(self.result.segments[0].funnel)))

    def _move(self, moving: dict[str, Any], row: int) -> None:
        state, colour = self.state[row], CAR_COLOUR
        moving["trail"].set_data(*self.state[: row + 1, 1:3].T)
        moving["funnel"].set_data(*self._shadow(float(self.theta[row])).T)
        far = np.hypot(*(self.seen[row, 1:3] - state[1:3])) > 0
        moving["seen"].set_data(*([self.seen[row, 1:2], self.seen[row, 2:3]] if far else [[], []]))
        parts = car_parts(self.result.problem.vehicle, state, self.command[row])
        for patch, corners in zip(moving["parts"], parts, strict=False):
            patch.set_xy(corners)
            patch.set(facecolor="#343a40", edgecolor="none")
        moving["parts"][0].set(facecolor="white", edgecolor=colour, lw=1.2, alpha=0.9)
        moving["value"].set_data(self.clock[: row + 1], self.value[: row + 1])
        moving["now"].set_data(self.clock[row : row + 1], self.value[row : row + 1])
        moving["clock"].set_text(f"{self.clock[row]:.2f} s  (film: {self.pace:.2g} × real time)")

    def _shadow(self, theta: float) -> Float[np.ndarray, "96 2"]:
        """Of the funnel at θ of the lap, m."""
        spans = self.result.spans
        leg = max(index for index, (begin, _) in enumerate(spans) if begin <= theta or not index)
        at = np.array([theta])
        return shadows(self.result.segments[leg].funnel, at - spans[leg][0], self.plane.course(at))[0]


def car_parts(
    vehicle: Vehicle, state: Float[np.ndarray, " n"], command: Float[np.ndarray, " m"]
) -> list[Float[np.ndarray, "4 2"]]:
    """Corners (m, inertial frame) of the body and, of a bicycle, of four wheels, the front ones steered."""
    length = vehicle.wheelbase if isinstance(vehicle, KinematicBicycle) else BODY
    c, s = np.cos(state[0]), np.sin(state[0])
    lateral, forward = np.array([c, s]), np.array([-s, c])

    def box(ahead: float, aside: float, half_length: float, half_width: float, turn: float) -> np.ndarray:
        corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * np.array([half_length, half_width])
        ct, st = np.cos(turn), np.sin(turn)
        along, across = ct * corners[:, 0] - st * corners[:, 1], st * corners[:, 0] + ct * corners[:, 1]
        return state[1:3] + np.outer(ahead + along, forward) - np.outer(aside + across, lateral)

    body = box(0.5 * length, 0.0, (0.5 + OVERHANG) * length, 0.5 * WIDTH * length, 0.0)
    if not isinstance(vehicle, KinematicBicycle):
        return [body]
    wheel, track = 0.5 * WHEEL * length, 0.5 * WIDTH * length
    return [
        body,
        *(
            box(ahead, aside, wheel, 0.35 * wheel, turn)
            for ahead, turn in ((0.0, 0.0), (length, float(command[0])))
            for aside in (-track, track)
        ),
    ]
