"""The controller of a certified run as C99: one header and one source, with the tables of its path.

What stands in the two templates beside this file is the same for every run; what a run adds is text from the one
definition of each thing: the vehicle's graph, the funnel's template, the path's polynomials (`cfjax.problem.course`),
the input box and the margins.
"""

import hashlib
import textwrap
from collections.abc import Iterable, Sequence
from decimal import ROUND_FLOOR
from importlib import resources
from itertools import product
from os import PathLike
from pathlib import Path
from string import Template as Text
from typing import NamedTuple

import jax
import numpy as np
from flint import fmpq

from cfcheck.exact.rational import decimal_text
from cfjax.coerce import choice, file, instance
from cfjax.control.law import LAW_SHARE
from cfjax.control.legs import leg_arrays
from cfjax.errors import InputError
from cfjax.export.graph_c import dynamics, number, straight
from cfjax.funnel import Template
from cfjax.problem import Frame, Problem
from cfjax.problem.course import poses_of, profiles_of
from cfjax.problem.vehicle import numbers_of
from cfjax.report.files import write_whole
from cfjax.result import Result
from cfjax.verdict import Verdict


HEADER, SOURCE = "cfjax_controller.h", "cfjax_controller.c"
INDENT = "    "
HEADINGS = {
    Frame.PAPER: "heading (rad, 0 looks along +y, counter-clockwise)",
    Frame.ROS: "yaw (rad, 0 looks along +x, counter-clockwise)",
}
MOTIONS = {
    Frame.PAPER: "Heading 0 looks along +y and counts counter-clockwise: x' = -v sin(heading), y' = v cos(heading).",
    Frame.ROS: "Yaw 0 looks along +x and counts counter-clockwise: x' = v cos(yaw), y' = v sin(yaw).",
}


class Sources(NamedTuple):
    """The text of the two files, ASCII."""

    header: str
    source: str


def write_controller(result: Result, folder: str | PathLike[str], frame: Frame | str = Frame.PAPER) -> list[Path]:
    """Write header and source into `folder`, each whole or not at all; returns their paths.

    `frame`: of the heading in states, `paper` or `ros`.

    Raises:
        InputError: where the run has no controller (see `sources_of`), or there is no such frame.
    """
    sources, folder = sources_of(result, frame), file("folder", folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in ((SOURCE, sources.source), (HEADER, sources.header)):
        write_whole(folder / name, text.encode("ascii"))
    return [folder / HEADER, folder / SOURCE]


def sources_of(result: Result, frame: Frame | str = Frame.PAPER) -> Sources:
    """Header and source of the controller that drives a certified run's path under the min-norm law.

    `frame`: of the heading in states, `paper` or `ros`.

    Raises:
        InputError: where the run is not certified, where it is of a tube alone, or where C has not what the vehicle
            needs.
    """
    instance("result", result, Result)
    frame = choice("frame", frame, Frame)
    if result.verdict is not Verdict.CERTIFIED or result.document is None:
        raise InputError(f"export: expected a certified run, got one that is {result.verdict.value}")
    result.problem.path.require_course()
    fields = {
        name: _ascii(text) for name, text in {**_names(result, frame), **_tables(result), **_code(result)}.items()
    }
    banner = [line for long in _ascii(_banner(result, frame)).splitlines() for line in textwrap.wrap(long, 116) or [""]]
    fields["banner"] = "\n".join(f" * {line}".rstrip() for line in banner)
    room = resources.files("cfjax.export")
    source = Text(room.joinpath("controller.c.in").read_text("utf-8"))
    header = Text(room.joinpath("controller.h.in").read_text("utf-8"))
    # two files that do not belong together do not compile
    content = "".join(each.substitute(fields, identity="") for each in (header, source))
    identity = f"0x{hashlib.sha256(content.encode()).hexdigest()[:8]}u"
    return Sources(header.substitute(fields, identity=identity), source.substitute(fields, identity=identity))


def _ascii(text: str) -> str:
    """As it may stand in a comment."""
    return text.replace("*/", "* /").replace("/*", "/ *").encode("ascii", "backslashreplace").decode()


def _template(result: Result) -> Template:
    return leg_arrays(result.problem, result.legs).template


def _inputs(problem: Problem) -> tuple[str, ...]:
    return ("u0", *problem.vehicle.input_names)


def _names(result: Result, frame: Frame) -> dict[str, str]:
    """What the two files call things, and how many there are."""
    problem = result.problem
    vehicle, internal = problem.vehicle, problem.vehicle.internal_names
    brakes = dict(vehicle.brakes)
    held = [name for name in vehicle.input_names if name not in brakes]
    safe = [
        *([f"{', '.join(held)} held as it was last"] if held else []),
        *(f"{name} brings {state} to zero as fast as its limits allow, then 0" for name, state in vehicle.brakes),
    ]
    return {
        "vehicle": vehicle.name,
        "states": str(problem.dimension),
        "inputs": str(len(_inputs(problem))),
        "commands": str(len(vehicle.command_names)),
        "legs": str(len(result.legs)),
        "closed": str(int(problem.path.closed)),
        "duration": number(float(leg_arrays(problem, result.legs).end[-1])),
        "ros": str(int(frame is Frame.ROS)),
        "state_list": ", ".join((frame.heading, *vehicle.state_names[1:])),
        "state_units": ", ".join((HEADINGS[frame], "x, y (m)", *internal)),
        "input_list": ", ".join(_inputs(problem)),
        "command_list": "; ".join(vehicle.command_names),
        "safe": "\n".join(f" *   {each}" for each in safe),
        "rate_name": _template(result).rate_name,
        "share": f"{LAW_SHARE:g}",
    }


def _tables(result: Result) -> dict[str, str]:
    """Numbers: funnels, the box, the path."""
    problem = result.problem
    vehicle, names = problem.vehicle, _inputs(problem)
    brakes = {name: vehicle.state_names.index(state) for name, state in vehicle.brakes}
    profiles, poses = (
        jax.tree.map(np.asarray, pieces)
        for pieces in (profiles_of(problem.path), poses_of(problem.path, problem.side_slip))
    )
    if (poses.origin != poses.begin[:, None]).any():
        raise AssertionError("the pose's cubics count from where they begin")
    arrays, legs = leg_arrays(problem, result.legs), []
    for index, (begin, end) in enumerate(zip(arrays.begin, arrays.end, strict=True)):
        numbers = arrays.of(index)
        demands = (numbers.beta_lower, numbers.beta_inner, numbers.decrease, numbers.decrease_per_metre)
        scalars = [begin, end, *map(float, (numbers.rate, *demands))]
        ends = sorted(
            set(product(*(map(float, each) for each in (numbers.curvature or (), numbers.acceleration or ()))))
        )
        at_ends = ", ".join(_row([end[k] for end in ends] or [0.0]) for k in range(2))
        legs.append(f"{_row(scalars)[1:-1]}, {len(ends)}, {at_ends}, {_table(np.asarray(numbers.shape))}")
    return {
        "lower": _list(interval.lower for interval in problem.inputs),
        "upper": _list(interval.upper for interval in problem.inputs),
        "brakes": ", ".join(str(brakes.get(name, -1)) for name in names),
        "leg_table": ",\n".join(f"{INDENT}{{{leg}}}" for leg in legs),
        "pieces": str(len(profiles.begin)),
        "order": str(profiles.coefficients.shape[2]),
        "piece_begins": ",\n".join(f"{INDENT}{number(value)}" for value in profiles.begin),
        "piece_table": ",\n".join(
            f"{INDENT}{{{_row(origin)}, {_row(table[0])}, {_row(table[1])}}}"
            for origin, table in zip(profiles.origin, profiles.coefficients, strict=True)
        ),
        "cells": str(len(poses.begin)),
        "cell_begins": ",\n".join(f"{INDENT}{number(value)}" for value in poses.begin),
        "cell_table": ",\n".join(f"{INDENT}{{{_table(table)}}}" for table in poses.coefficients),
    }


def _list(values: Iterable[float]) -> str:
    return ", ".join(number(float(value)) for value in values)


def _row(values: Iterable[float]) -> str:
    return f"{{{_list(values)}}}"


def _table(rows: Iterable[Iterable[float]]) -> str:
    return "{" + ", ".join(_row(row) for row in rows) + "}"


def _code(result: Result) -> dict[str, str]:
    """Statements, each from the one definition of what it computes."""
    vehicle, template = result.problem.vehicle, _template(result)
    states, inputs = vehicle.state_names, vehicle.input_names
    given, owner = [f"inputs[{i + 1}]" for i in range(len(inputs))], f"vehicle {vehicle.name}"
    commands = [f"command[{i}]" for i in range(len(vehicle.command_names))]
    rest = [f"rest[{i}]" for i in range(len(states))]
    profile = ["turn_rate", "speed"]
    code = {
        "dynamics": dynamics(vehicle),
        "dynamics_at_rest": dynamics(vehicle, at_rest=True),
        "rest": straight(lambda *point: (0.0, 0.0, 0.0, *vehicle.reference(*point)[1]), profile, rest, owner),
        "command": straight(lambda *values: vehicle.command(values), given, commands, owner),
        "value": straight(lambda *values: [template.value(*values)], ["rate", "t", "q"], ["value"], template.name),
        "level": straight(
            lambda *values: [template.level(*values), template.scale(*values)],
            ["rate", "t"],
            ["*level", "*scale"],
            template.name,
        ),
        "timing": straight(lambda *values: [template.timing(*values)], ["rate", "q"], ["timing"], template.name),
    }
    return {name: _indented(lines) for name, lines in code.items()}


def _indented(lines: Sequence[str]) -> str:
    return "\n".join(INDENT + line for line in lines)


def _laps(result: Result) -> str:
    """Whether one lap proves the next: V ≤ 1 at the end has to lie in V ≤ 1 at the start; numbers compared, no more."""
    problem, first, last = result.problem, result.legs[0].funnel, result.legs[-1].funnel
    if not problem.path.closed:
        return "No: the path is open. Past its end the reference goes straight on; nothing is proven there."
    if all(a <= b for a, b in zip(problem.goal_axes, problem.inlet.half_axes, strict=True)):
        return "Yes: G lies in I, so that each lap begins as the first one."
    if np.array_equal(first.shape, last.shape) and last.rate >= 0:
        return "Yes: the last funnel is the first one, and no wider at the end."
    return "No: G does not lie in I. The next lap is driven, and each step says whether V <= 1."


def _banner(result: Result, frame: Frame) -> str:
    """What the controller is, and what is guaranteed of it."""
    problem, document = result.problem, result.document or {}
    duration = leg_arrays(problem, result.legs).end[-1]
    path, vehicle = problem.path, problem.vehicle
    numbers = ", ".join(f"{name} {value}" for name, value in numbers_of(vehicle).items())
    axes = ", ".join(f"{axis:g}" for axis in problem.inlet.half_axes)
    goal = ", ".join(f"{axis:g}" for axis in problem.goal_axes)
    kept = []
    if problem.safe:
        widths = ", ".join(f"{width:g}" for width in problem.safe.half_widths)
        kept.append(f"inside the box S (half-widths {widths})")
    if problem.obstacles:
        kept.append(f"clear of {len(problem.obstacles)} obstacles")
    safe = f" On the way V <= 1 is {' and '.join(kept)}." if kept else ""
    margins = ", ".join(_below(leg.margin) for leg in result.legs[:8])
    more = f" and {len(result.legs) - 8} more" if len(result.legs) > 8 else ""
    return f"""cfjax: a controller with a proof. Made by python -m cfjax.export; do not edit.

certificate  {document.get("hash", "without a hash")}
path         {path.name}, {duration:g} s of reference time, {"closed" if path.closed else "open"}
vehicle      {vehicle.name} ({numbers})
method       {problem.method.words}, template {_template(result).name}
margins      {margins}{more} 1/s, one for each leg; the law asks {LAW_SHARE:g} of it

Units: m, s, rad. {MOTIONS[frame]}
A deviation is seen from the reference: heading, to its right, ahead, then the internal states.

Guaranteed of the law in continuous time, for the vehicle above: whoever is in V <= 1 stays there up to the path's \
end. I (half-axes {axes}) lies in V <= 1 at the start, V <= 1 lies in G (half-axes {goal}) at the end.{safe}
Lap after lap: {_laps(result)}
{_held(result)} Floating point is not part of any proof here. Each step says whether V <= 1."""


def _below(proven: float) -> str:
    """Six digits, rounded down."""
    return decimal_text(fmpq(*proven.as_integer_ratio()), ROUND_FLOOR)


def _held(result: Result) -> str:
    """What is proven of steps that take time."""
    if result.robustness is None:
        return (
            "The certificate speaks of inputs that follow the state at once. What inputs held for a step take away has "
            f"to fit into the {1 - LAW_SHARE:.0%} of the margin that the law does not ask for and into what V loses "
            "anyway."
        )
    alone, together = (_below(amounts.period) for amounts in (result.robustness.alone, result.robustness.together))
    return (
        f"Held for a step: the same is proven for steps of up to {alone} s with nothing else amiss, or of up to "
        f"{together} s with the disturbance, pose error and delay of `jointly` in result.json."
    )
