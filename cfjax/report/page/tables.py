"""What the page says in words and numbers."""

import math
from typing import NamedTuple

import numpy as np

from cfjax.problem import Disc, Wall
from cfjax.problem.vehicle import numbers_of
from cfjax.report.terms import input_label, short_label
from cfjax.result import Result
from cfjax.rounded import MILLI, margin_text, rounded_down, rounded_up, written
from cfjax.verdict import Verdict


Rows = list[tuple[str, ...]]

MEANING = {
    Verdict.CERTIFIED: "Proven. The exact checker accepted the certificate. Its own account:",
    Verdict.REFUTED: "Proven to fail. The checker confirms a witness against this candidate; others may do:",
    Verdict.INCONCLUSIVE: "Nothing is proven, neither that this funnel works nor that none exists. What was found:",
    Verdict.SOLVER_FAILED: "Nothing is proven: a numerical solver gave no usable answer. What it said:",
}
CONDITIONS = {
    "a": "I lies in the funnel",
    "b": "the funnel ends in G",
    "c": "the funnel stays in S, off obstacles",
    "d": "some input makes V fall",
}


class Fact(NamedTuple):
    """A figure that is shown large."""

    value: str
    unit: str
    name: str


def number(value: float | None, digits: int = 4) -> str:
    """Short, with a true minus; a dash where there is none."""
    if value is None or math.isnan(value):
        return "–"
    return f"{value:.{digits}g}".replace("inf", "∞").replace("-", "−")


def facts(result: Result) -> list[Fact]:
    """The figures that people look for first."""
    found = [
        Fact(margin(result.margin_certified), "1/s", "margin λ, certified"),
    ]
    falsified = result.margin_falsified
    if falsified is not None and math.isfinite(falsified):  # tubes that came with the package are not searched again
        found.append(Fact(margin(falsified), "1/s", "margin λ, falsified"))
    if result.margin_certified is None:
        found[0] = Fact("none", "", "margin λ, certified")
    if result.margin_per_metre is not None:
        found.append(Fact(margin(result.margin_per_metre), "1/m", "margin per metre, certified"))
    if (loop := result.closed_loop) is not None:
        found.append(Fact(f"{loop.cars:,}".replace(",", " "), "cars", f"driven, {loop.outcome}"))
        if loop.arrival:
            ends = " to ".join(number(each, 3) for each in loop.arrival)
            found.append(Fact(ends, "s", "cars arrived after"))
    if result.robustness is not None:
        period = rounded_down(result.robustness.alone.period, 3, MILLI)
        law = "told the speed alone, proven" if result.margin_per_metre else "proven"
        found.append(Fact(period, "ms", f"inputs held, {law}"))
        if (ahead := result.robustness.sampled) is not None:
            period = rounded_down(ahead.period, 3, MILLI)
            found.append(Fact(period, "ms", "inputs held by the law that looks one hold ahead, proven"))
            if ahead.delay:
                found.append(Fact(rounded_down(ahead.delay, 3, MILLI), "ms", "its poses late, predicted, proven"))
    if "total" in result.seconds:
        found.append(Fact(number(result.seconds["total"], 3), "s", "for all of it"))
    return found


def parameters(result: Result) -> Rows:
    """The question."""
    problem = result.problem
    vehicle, path = problem.vehicle, problem.path
    states = problem.vehicle.state_names
    own = ", ".join(f"{name} {_short(value)}" for name, value in numbers_of(vehicle).items())
    rows = [("path", path.name + (", closed" if path.closed else ""))]
    if tube := path.tube:
        bounds = (("speed", tube.speed, "m/s"), ("curvature", tube.curvature, "1/m"))
        for name, ends, unit in (*bounds, ("acceleration", tube.acceleration, "m/s²")):
            rows.append((f"{name} of the reference", f"{number(ends.lower)} to {number(ends.upper)} {unit}"))
    else:
        count = "1 segment" if len(path.segments) == 1 else f"{len(path.segments)} segments"
        rows.append(("duration T", f"{number(path.duration)} s, {count}"))
    rows.append(("method", problem.method.words))
    if result.segments:
        funnel = result.segments[0].funnel
        held = any(found.span for found in result.segments)
        kind = f"universal tubes, {len(result.segments)} in turn" if held else funnel.template.name
        rows.append(("template", kind))
        rows.append(("shell", f"V from {rounded_up(written(funnel.beta_lower))} to 1"))
    rows.append(("vehicle", vehicle.name + (f": {own}" if own else "")))
    for disc in problem.footprint:
        rows.append(("footprint", f"disc of {number(disc.radius)} m, {number(disc.offset)} m ahead"))
    for name, box in zip(("u0", *vehicle.input_names), problem.inputs, strict=True):
        rows.append((input_label(name), f"{number(box.lower)} to {number(box.upper)}"))
    for name, ellipsoid in (("inlet I", problem.inlet), ("goal G", problem.goal)):
        axes = _by_state(states, ellipsoid.half_axes) if ellipsoid else "none: the tube itself"
        rows.append((f"{name}, half-axes", axes))
    safe = "the whole plane" if problem.safe is None else _by_state(states, problem.safe.half_widths)
    rows.append(("safe set S, half-widths", safe))
    for obstacle in problem.obstacles:
        if isinstance(obstacle, Disc):
            text = f"disc of {number(obstacle.radius)} m at ({number(obstacle.x)}, {number(obstacle.y)}) m"
        elif isinstance(obstacle, Wall):
            text = f"wall through {len(obstacle.points)} points"
        else:
            text = "polygon " + " ".join(f"({number(x)}, {number(y)})" for x, y in obstacle.corners) + " m"
        rows.append(("obstacle", text))
    return rows


def funnels(result: Result) -> tuple[tuple[str, ...], Rows]:
    """Head and rows: each funnel, its margins and half-widths."""
    states = result.problem.vehicle.state_names
    held = any(found.span for found in result.segments)
    head = ("", "θ (s)", "certified (1/s)", "falsified (1/s)", *(f"± {short_label(name)}" for name in states))
    rows, since = [], 0.0
    for index, found in enumerate(result.segments):
        begin, end = found.span or (since, since + found.funnel.duration)
        since = end
        where = "any" if math.isinf(end) else f"{number(begin)} to {number(end)}"
        widths = (rounded_up(width, 3) for width in found.funnel.half_widths())
        margins = margin(found.margin_certified), margin(found.margin_falsified)
        rows.append((f"{'tube' if held else 'segment'} {index + 1}", where, *margins, *widths))
    return head, rows


def worst_points(result: Result) -> tuple[tuple[str, ...], Rows]:
    """Head and rows: the falsifier's worst points, the tightest first."""
    states = result.problem.vehicle.state_names
    head = ("condition", "slack", "segment", "θ (s)", *(short_label(name) for name in states))
    rows: Rows = []
    for point in sorted(result.worst_points, key=lambda point: (point.segment, point.condition)):
        slack = number(point.slack) + (" 1/s" if point.condition == "d" else "")
        where = "–" if point.theta is None else number(point.theta)
        says = f"({point.condition}) {CONDITIONS[point.condition]}"
        rows.append((says, slack, str(point.segment + 1), where, *(number(value, 3) for value in point.x)))
    return head, rows


def seconds(result: Result) -> list[tuple[str, str, float]]:
    """Stage, seconds, and its share of the total in percent."""
    total = result.seconds.get("total", 0.0) or sum(result.seconds.values()) or 1.0
    stages = [(name, value) for name, value in result.seconds.items() if name != "total"]
    rest = total - sum(value for _, value in stages)
    if rest > 0.005 * total:
        stages.append(("everything else", rest))
    return [(name, f"{value:.2f}", round(100 * min(value / total, 1.0), 1)) for name, value in stages]


def rounds(result: Result) -> tuple[tuple[str, ...], Rows]:
    """Head and rows: the margins after each round of learning and proving."""
    rows: Rows = [
        (
            str(index + 1),
            margin(figures.get("falsified")),
            margin(figures.get("certified") or None),
            f"{figures.get('counterexamples', 0):.0f}",
        )
        for index, figures in enumerate(result.history)
    ]
    return ("round", "falsified (1/s)", "certified (1/s)", "counterexamples"), rows


def absorbed(result: Result) -> tuple[tuple[str, ...], Rows]:
    """Head and rows: what the funnels absorb, by itself and all at once."""
    assert result.robustness is not None
    alone, joint = result.robustness.alone, result.robustness.together
    states = result.problem.vehicle.state_names
    rows: Rows = []

    def row(label: str, one: float, other: float | None, power: int = 0) -> None:
        rows.append((label, rounded_down(one, 3, power), rounded_down(other, 3, power)))

    row("inputs held for (ms)", alone.period, joint.period, MILLI)
    row("data old by (ms)", alone.delay, joint.delay, MILLI)
    for name, one, other in zip(states, alone.disturbance, joint.disturbance, strict=True):
        row(f"rate off by, a second: {short_label(name)}", one, other)
    for name, one, other in zip(states, alone.pose_error, joint.pose_error, strict=True):
        row(f"pose off by: {short_label(name)}", one, other)
    row("with the pose off, from starts with V up to", result.robustness.pose_level, result.robustness.level)
    for lower, upper, own in result.robustness.by_speed:
        speeds = f"{rounded_up(written(lower))} to {rounded_down(written(upper))} m/s"
        row(f"inputs held for (ms), chosen at {speeds}", own.period, None, MILLI)
    return ("", "by itself", "all at once"), rows


def extremes(result: Result, inputs: list[np.ndarray]) -> tuple[tuple[str, ...], Rows]:
    """Head and rows: what the shown cars needed of each input."""
    names = ("u0", *result.problem.vehicle.input_names)
    every = np.concatenate(inputs)
    rows: Rows = []
    for k, (name, box) in enumerate(zip(names, result.problem.inputs, strict=True)):
        used = f"{number(every[:, k].min(), 3)} to {number(every[:, k].max(), 3)}"
        rows.append((input_label(name), f"{number(box.lower)} to {number(box.upper)}", used))
    return ("input", "limits", "used by the cars shown"), rows


def margin(value: float | None) -> str:
    """As `margin_text`, with a true minus."""
    return margin_text(value).replace("inf", "∞").replace("-", "−")


def _by_state(states: tuple[str, ...], values: tuple[float, ...]) -> str:
    if len(set(values)) == 1 and len(values) > 1:
        return f"{number(values[0])} in every state"
    return ", ".join(f"{name} {number(value)}" for name, value in zip(states, values, strict=True))


def _short(value: object) -> str:
    return number(value) if isinstance(value, float) else str(value)
