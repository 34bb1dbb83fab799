"""What a simulation leaves behind: summary, a row for each car, a picture and, if wanted, an animation."""

import csv
import dataclasses
import io
import json
import math
from pathlib import Path
from typing import Any

import jax
import matplotlib
import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from cfjax.plants import Model, Sensor
from cfjax.report import marks
from cfjax.report.animation import save_animation
from cfjax.report.files import versions, write_whole
from cfjax.report.marks import Axis, Band, Lines, Panel
from cfjax.report.panels import shell, value_axis
from cfjax.report.plane import Plane
from cfjax.report.plot import compose
from cfjax.report.style import STYLE
from cfjax.result import Result
from cfjax.rounded import MILLI, rounded_down
from cfjax.simulation.experiment import AHEAD, Experiment
from cfjax.simulation.sampled import SampledLoop


SUMMARY, CARS, PICTURE, ANIMATION = "summary.json", "cars.csv", "simulation.png", "simulation.gif"


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
    setup = dataclasses.asdict(experiment.setup)
    commands = experiment.problem.vehicle.command_names
    return {
        "question": {key: str(value) if isinstance(value, Path) else value for key, value in setup.items()},
        "path": experiment.problem.path.name,
        "period": experiment.period,
        "law_inherits_certificate": experiment.inherits,
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
    vehicle, frame = experiment.problem.vehicle, experiment.frame
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    flags = ("arrived", "in_goal", "left_safe", "left_funnel", "failed")
    numbers = ("time", "left_safe_at", "largest_value", "rms_lateral", "largest_lateral", "clearance")
    saturation = [f"saturation ({name})" for name in vehicle.command_names]
    writer.writerow(
        ["car", frame.heading, *vehicle.state_names[1:], "theta", "start_value", *flags, *numbers, *saturation]
    )
    for car in range(len(loop.arrived)):
        heading, *others = loop.starts[car]
        figures = [heading + frame.shift, *others, loop.theta[car], loop.start_value[car]]
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
    counted = ", ".join(f"{content[name]} {label}" for name, label in zip(counts, COUNTS, strict=True))
    print(f"{content['cars']} cars, {content['started_in_funnel']} started in the funnel: {counted}")
    if said := account_of_period(experiment):
        print(said)
    if not experiment.inherits:
        print(f"the law {experiment.setup.law} does not inherit the certificate")


def account_of_period(experiment: Experiment) -> str | None:
    """What the proven control period says of these cars; None where none is proven of this law.

    It is proven of the model whose state is seen exactly and at once, and of nothing else that can be driven.
    """
    robustness = experiment.result.robustness
    if robustness is None or not experiment.inherits:
        return None
    ahead = robustness.sampled if experiment.setup.law == AHEAD else None
    period, delay = (ahead.period, ahead.delay) if ahead else (robustness.alone.period, 0.0)
    sensor, late = experiment.sensor, float(experiment.sensor.delay)
    driven, proven = f"{1e3 * experiment.period:.4g} ms", f"{rounded_down(period, 4, MILLI)} ms"
    if late and ahead:
        driven, proven = f"{driven}, delay {1e3 * late:.4g} ms", f"{proven}, {rounded_down(delay, 4, MILLI)} ms"
        if np.isclose(late / experiment.period, round(late / experiment.period)):  # else poses are interpolated
            sensor = dataclasses.replace(sensor, delay=0.0)
    begin = f"control period {driven}: "
    if not _is_the_model(experiment, sensor):
        return begin + f"the proven {proven} are of the model, seen exactly; of this plant and noise nothing is proven"
    if experiment.period > period or late > delay:
        return begin + f"longer than the proven {proven}"
    return begin + f"within the proven {proven}"


def _is_the_model(experiment: Experiment, sensor: Sensor) -> bool:
    plant = experiment.plant
    exact = not any(np.any(np.asarray(number)) for number in jax.tree.leaves(sensor))
    return exact and isinstance(plant, Model) and plant.vehicle == experiment.problem.vehicle


COUNTS = ("arrived", "of them in G", "left S", "left the funnel", "failed")


def title_of(experiment: Experiment, loop: SampledLoop) -> str:
    setup = experiment.setup
    noise = "" if setup.noise == "none" else f", noise {setup.noise}"
    return (
        f"{experiment.problem.path.name}: {len(loop.arrived)} cars on {setup.plant}{noise}, "
        f"law {setup.law}, every {1e3 * experiment.period:.4g} ms"
    )


def picture_of(result: Result, loop: SampledLoop, title: str) -> Figure:
    """The plane with the recorded cars, and V, lateral error and the first command along the clock."""
    samples, name = loop.samples, result.problem.vehicle.command_names[0]
    drawn = range(samples.clock.shape[1])
    plane = Plane(result).panel([samples.state[:, car, 1:3] for car in drawn])
    lasts = [int(np.argmax(samples.clock[:, car])) + 1 for car in drawn]
    clocks = [samples.clock[:last, car] for car, last in zip(drawn, lasts, strict=True)]
    clock = Axis("clock (s)", (0.0, float(samples.clock.max()) or 1.0))

    def curves(values: np.ndarray, held: bool = False) -> Lines:
        """One for each car, over its clock; steps where a value is held until the next one."""
        own = [values[: len(own), car] for car, own in enumerate(clocks)]
        over = clocks if not held else [np.repeat(each, 2)[1:] for each in clocks]
        own = own if not held else [np.repeat(each, 2)[:-1] for each in own]
        return Lines(marks.CARS, [np.stack(both, axis=-1) for both in zip(over, own, strict=True)])

    (band, note), zero = shell(result.segments[0].funnel), Band(marks.ZERO, 0.0, 0.0)
    unit = name.replace(", ", " (") + ")" if ", " in name else name
    panels = [
        Panel("values", clock, value_axis(samples.value), (band, curves(samples.value), note)),
        Panel("lateral", clock, Axis("lateral error (m)"), (zero, curves(samples.deviation[..., 1]))),
        Panel("command", clock, Axis(unit), (curves(samples.command[..., 0], held=True),)),
    ]
    return compose(plane, panels, title)
