"""What a simulation leaves behind: summary, a row for each car, a picture and, if wanted, an animation."""

import csv
import dataclasses
import io
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from rich.console import Console
from rich.table import Table

from cfjax.plants import Model
from cfjax.report.animation import save_animation
from cfjax.report.files import versions, write_whole
from cfjax.report.plane import Plane
from cfjax.report.rounded import MILLI, rounded_down
from cfjax.report.style import CAR_COLOURS, REFERENCE_COLOUR, STYLE, draw_shell
from cfjax.result import Result
from cfjax.simulate.experiment import Experiment
from cfjax.simulation.sampled import SampledLoop


if TYPE_CHECKING:
    from matplotlib.axes import Axes


SUMMARY, CARS, PICTURE, ANIMATION = "summary.json", "cars.csv", "simulation.png", "simulation.gif"
WIDTH, TALLEST = 9.2, 5.4  # of the picture, in


def write_simulation(experiment: Experiment, loop: SampledLoop, folder: Path, *, animate: bool = False) -> None:
    """Write summary.json, cars.csv and simulation.png into the folder, and simulation.gif; each whole or not at all."""
    content = summary_json(experiment, loop)
    write_whole(folder / SUMMARY, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())
    write_whole(folder / CARS, cars_csv(experiment, loop).encode())
    with matplotlib.rc_context(STYLE):
        figure = picture_of(experiment.result, loop, title_of(experiment, loop))
        image = io.BytesIO()
        figure.savefig(image, format="png", metadata={"Software": None})
        write_whole(folder / PICTURE, image.getvalue())
        if animate:
            save_animation(experiment.result, loop, folder / ANIMATION)
        else:
            (folder / ANIMATION).unlink(missing_ok=True)  # of another simulation


def summary_json(experiment: Experiment, loop: SampledLoop) -> dict[str, Any]:
    """Times in s, lengths in m; null where there is no such figure."""
    question = dataclasses.asdict(experiment.question)
    commands = experiment.problem.vehicle.command_names
    return {
        "question": {key: str(value) if isinstance(value, Path) else value for key, value in question.items()},
        "path": experiment.problem.path.name,
        "period": experiment.period,
        "law_inherits_certificate": experiment.law.inherits,
        "cars": len(loop.arrived),
        "started_in_funnel": int((loop.start_value <= 1).sum()),
        "arrived": int(loop.arrived.sum()),
        "in_goal": int(loop.in_goal.sum()),
        "left_safe": int(loop.left_safe.sum()),
        "left_funnel": int(loop.left_funnel.sum()),
        "failed": int(loop.failed.sum()),
        "success": int(loop.success.sum()),
        "arrival": _spread(loop.time[loop.arrived]),
        "largest_value": _spread(loop.largest_value[~loop.failed]),
        "rms_lateral": _spread(loop.rms_lateral[~loop.failed]),
        "largest_lateral": _spread(loop.largest_lateral[~loop.failed]),
        "saturation": {name: _spread(loop.saturation[~loop.failed, index]) for index, name in enumerate(commands)},
        "clearance": _spread(loop.clearance[np.isfinite(loop.clearance)]),
        "versions": versions(),
    }


def _spread(values: np.ndarray) -> dict[str, float] | None:
    """Least, median, mean and largest."""
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    return {
        "min": float(values.min()),
        "median": float(np.median(values)),
        "mean": float(values.mean()),
        "max": float(values.max()),
    }


def cars_csv(experiment: Experiment, loop: SampledLoop) -> str:
    """A row for each car, full precision: its start (world frame), what became of it, and the figures."""
    vehicle = experiment.problem.vehicle
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    flags = ("arrived", "in_goal", "left_safe", "left_funnel", "failed")
    numbers = ("time", "left_safe_at", "largest_value", "rms_lateral", "largest_lateral", "clearance")
    saturation = [f"saturation ({name})" for name in vehicle.command_names]
    writer.writerow(["car", *vehicle.state_names, "theta", "start_value", *flags, *numbers, *saturation])
    for car in range(len(loop.arrived)):
        figures = [*loop.starts[car], loop.theta[car], loop.start_value[car]]
        rest = [*(getattr(loop, name)[car] for name in numbers), *loop.saturation[car]]
        said = [int(getattr(loop, name)[car]) for name in flags]
        writer.writerow([car, *map(_cell, figures), *said, *map(_cell, rest)])
    return file.getvalue()


def _cell(value: float) -> str:
    return repr(float(value)) if math.isfinite(value) else ""


def print_summary(experiment: Experiment, loop: SampledLoop) -> None:
    """A table for people."""
    content = summary_json(experiment, loop)
    table = Table(title=title_of(experiment, loop), title_justify="left", show_header=True, header_style="bold")
    for name in ("", "min", "median", "max"):
        table.add_column(name, justify="left" if not name else "right")

    def row(label: str, spread: dict[str, float] | None, scale: float = 1.0) -> None:
        cells = (f"{scale * spread[key]:.4g}" for key in ("min", "median", "max")) if spread else ("–",) * 3
        table.add_row(label, *cells)

    row("arrival, s", content["arrival"])
    row("largest V", content["largest_value"])
    row("lateral error, rms, m", content["rms_lateral"])
    row("lateral error, largest, m", content["largest_lateral"])
    for name, spread in content["saturation"].items():
        row(f"saturated, % ({name})", spread, 100.0)
    if content["clearance"]:
        row("clearance, m", content["clearance"])
    console = Console()
    console.print(table)
    counts = ("arrived", "in_goal", "left_safe", "left_funnel", "failed")
    told = ", ".join(f"{content[name]} {label}" for name, label in zip(counts, COUNTS, strict=True))
    print(f"{content['cars']} cars, {content['started_in_funnel']} started in the funnel: {told}")
    if said := account_of_period(experiment):
        print(said)
    if not experiment.law.inherits:
        print(f"the law {experiment.question.law} does not inherit the certificate")


def account_of_period(experiment: Experiment) -> str | None:
    """What the proven control period says of these cars; None where none is proven of this law.

    It is proven of the model whose state is seen exactly and at once, and of nothing else that can be driven.
    """
    robustness = experiment.result.robustness
    if robustness is None or not experiment.law.inherits:
        return None
    proven = f"{rounded_down(robustness.alone.period, 4, MILLI)} ms"
    begin = f"control period {1e3 * experiment.period:.4g} ms: "
    if not _is_the_model(experiment):
        return begin + f"the proven {proven} are of the model, seen exactly; of this plant and noise nothing is proven"
    if experiment.period > robustness.alone.period:
        return begin + f"longer than the proven {proven}"
    return begin + f"within the proven {proven}"


def _is_the_model(experiment: Experiment) -> bool:
    plant = experiment.plant
    exact = not any(np.any(np.asarray(number)) for number in jax.tree.leaves(experiment.sensor))
    return exact and isinstance(plant, Model) and plant.vehicle == experiment.problem.vehicle


COUNTS = ("arrived", "of them in G", "left S", "left the funnel", "failed")


def title_of(experiment: Experiment, loop: SampledLoop) -> str:
    question = experiment.question
    noise = "" if question.noise == "none" else f", noise {question.noise}"
    return (
        f"{experiment.problem.path.name}: {len(loop.arrived)} cars on {question.plant}{noise}, "
        f"law {question.law}, every {1e3 * experiment.period:.4g} ms"
    )


def picture_of(result: Result, loop: SampledLoop, title: str) -> Figure:
    """The plane with the recorded cars, and V, lateral error and the first command along the clock."""
    plane = Plane(result)
    plane.cars = [loop.samples.state[..., 1:3]]
    x0, x1, y0, y1 = plane.view
    shape = (x1 - x0) / (y1 - y0)
    wide = shape > 1.75
    if wide:
        figure = Figure(figsize=(WIDTH, min(8.3 / shape, 4.2) + 3.4), layout=_layout(), dpi=130)
        parts = figure.add_gridspec(2, 1, height_ratios=[min(8.3 / shape, 4.2) + 0.3, 2.2])
        inner = parts[1].subgridspec(1, 3)
        panels = [figure.add_subplot(inner[k]) for k in range(3)]
    else:
        figure = Figure(figsize=(WIDTH, TALLEST), layout=_layout(), dpi=130)
        parts = figure.add_gridspec(1, 2, width_ratios=[5.2, 4.0])
        inner = parts[1].subgridspec(3, 1)
        panels = [figure.add_subplot(inner[k]) for k in range(3)]
        for panel in panels[:-1]:
            panel.tick_params(labelbottom=False)
    axes = figure.add_subplot(parts[0])
    plane.draw(axes)
    _draw_clock(panels, result, loop)
    for panel in panels if wide else panels[-1:]:
        panel.set_xlabel("clock (s)")
    figure.legend(handles=plane.handles(), loc="outside lower left", ncols=8, fontsize=8, handlelength=1.6)
    figure.suptitle(title, fontsize=10)
    return figure


def _layout() -> ConstrainedLayoutEngine:
    return ConstrainedLayoutEngine(w_pad=0.07, h_pad=0.07)


def _draw_clock(panels: "list[Axes]", result: Result, loop: SampledLoop) -> None:
    samples, name = loop.samples, result.problem.vehicle.command_names[0]
    value, lateral, command = panels
    for car in range(samples.clock.shape[1]):
        last = int(np.argmax(samples.clock[:, car])) + 1
        clock, style = (
            samples.clock[:last, car],
            {"color": CAR_COLOURS[car % len(CAR_COLOURS)], "lw": 0.6, "alpha": 0.8},
        )
        value.plot(clock, samples.value[:last, car], **style)
        lateral.plot(clock, samples.deviation[:last, car, 1], **style)
        command.plot(clock, samples.command[:last, car, 0], drawstyle="steps-post", **style)
    draw_shell(value, result.segments[0].funnel)
    top = float(np.nanmax(samples.value)) if samples.value.size else 1.0
    value.set(ylabel=r"$V(\theta, x)$", ylim=(0, min(max(1.05, 1.05 * top), 4.0)))
    lateral.axhline(0.0, color=REFERENCE_COLOUR, lw=0.6, ls=(0, (4, 3)))
    lateral.set_ylabel("lateral error (m)")
    command.set_ylabel(name.replace(", ", " (") + ")" if ", " in name else name)
    for panel in panels:
        panel.set_xlim(0, float(samples.clock.max()) or 1.0)
