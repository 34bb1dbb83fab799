"""result.json: a result as JSON, and read back."""

import dataclasses
import math
from typing import Any

import numpy as np
from flint import fmpq

from cfcheck.exact.rational import float_below
from cfcheck.kernel.containment import half_widths
from cfcheck.robustness.amounts import SHARE
from cfjax.funnel import Funnel, template_named
from cfjax.problem import Disc, Ellipsoid, FeedbackLaw, Interval, Obstacle, Problem, Tube, Wall
from cfjax.problem.vehicle import numbers_of
from cfjax.report.files import (
    versions,
)
from cfjax.result import Absorbed, ClosedLoop, Result, Robustness, Sampled, SegmentResult, StretchMargin, WorstPlace
from cfjax.verdict import Verdict


def result_json(result: Result) -> dict[str, Any]:
    """The content of result.json. Margins in 1/s, times in s; null where there is no such figure."""
    problem = result.problem
    states = ("u0", *problem.vehicle.input_names)
    return {
        "verdict": result.verdict.value,
        "message": result.message,
        "method": problem.method.value,
        "path": problem.path.name,
        "source": problem.path.source or None,
        "closed": problem.path.closed,
        "template": result.segments[0].funnel.template.name if result.segments else None,
        "margin": {"certified": _number(result.margin_certified), "falsified": _number(result.margin_falsified)},
        "margin_per_metre": _number(_margin_per_metre(result)),
        "segments": [_segment_json(problem, found) for found in result.segments],
        "inputs": {name: [box.lower, box.upper] for name, box in zip(states, problem.inputs, strict=True)},
        "vehicle": {
            "name": problem.vehicle.name,
            **numbers_of(problem.vehicle),
            "footprint": [[disc.radius, disc.offset] for disc in problem.footprint],
        },
        "law": _law_json(problem.law) if problem.law else None,
        "sets": {
            "inlet": list(problem.inlet.half_axes),
            "goal": list(problem.goal.half_axes) if problem.goal else None,
            "safe": list(problem.safe.half_widths) if problem.safe else None,
            "obstacles": [_obstacle_json(obstacle) for obstacle in problem.obstacles],
        },
        "failed_at": list(result.failed_at) if result.failed_at else None,
        "worst_points": [_worst_json(problem, point) for point in result.worst_points],
        "seconds": {stage: round(value, 3) for stage, value in result.seconds.items()},
        "iterations": result.iterations,
        "search": dict(result.search),
        "history": [{name: _number(float(value)) for name, value in figures.items()} for figures in result.history],
        "robustness": _robustness_json(problem, result.robustness) if result.robustness else None,
        "closed_loop": _closed_loop_json(result.closed_loop) if result.closed_loop else None,
        "command": result.command,
        "versions": versions(),
    }


def _obstacle_json(obstacle: Obstacle) -> dict[str, Any]:
    """As in the configuration."""
    if isinstance(obstacle, Disc):
        return {"disc": [obstacle.x, obstacle.y, obstacle.radius]}
    if isinstance(obstacle, Wall):
        return {"wall": [list(point) for point in obstacle.points]}
    return {"polygon": [list(corner) for corner in obstacle.corners]}


def _worst_json(problem: Problem, point: WorstPlace) -> dict[str, Any]:
    """θ in s of the segment; the deviation by state."""
    deviation = dict(zip(problem.vehicle.state_names, point.x, strict=True))
    return {
        "segment": point.segment,
        "condition": point.condition,
        "slack": _number(point.slack),
        "theta": point.theta,
        "x": deviation,
    }


def _worst_of(data: dict[str, Any]) -> WorstPlace:
    slack = math.nan if data["slack"] is None else data["slack"]
    return WorstPlace(data["segment"], data["condition"], slack, data["theta"], tuple(data["x"].values()))


def _law_json(law: FeedbackLaw) -> dict[str, Any]:
    """Its name, and its numbers where it is a dataclass."""
    fields = dataclasses.asdict(law) if dataclasses.is_dataclass(law) else {}
    return {"name": law.name, **fields}


def _segment_json(problem: Problem, found: SegmentResult) -> dict[str, Any]:
    funnel, states = found.funnel, problem.vehicle.state_names
    content = {
        "duration": _number(funnel.duration),
        "C": np.asarray(funnel.shape).tolist(),
        "template": funnel.template.name,
        funnel.template.rate_name: float(funnel.rate),
        "beta": 1.0,
        "beta_lower": float(funnel.beta_lower),
        "beta_inner": float(funnel.inner),
        "margin_certified": _number(found.margin_certified),
        "margin_falsified": _number(found.margin_falsified),
        "margin_sos": _number(found.margin_sos),
        "stretches": [stretch._asdict() for stretch in found.stretches],  # θ of the segment; what is proven there
        # of {x' C x <= 1}, exactly and rounded up
        "half_widths": dict(zip(states, _half_widths(funnel), strict=True)),
    }
    if found.margin_certified is not None:
        # of each state's rate alone: with it V still does not grow on beta_lower <= V <= 1 at theta = 0; what the
        # checker proves of a law that it names is `disturbance` in `robustness`
        absorbed = funnel.absorbed_disturbance(found.margin_certified)
        content["margin_as_disturbance"] = {name: _below(bound) for name, bound in zip(states, absorbed, strict=True)}
    if tube := problem.path.tube or found.reference:
        content["margin_per_metre"] = _number(found.margin_per_metre)
        content["contraction"] = {"level": float(funnel.inner), "metres": _number(found.contraction)}
        content["reference"] = {name: list(ends) for name, ends in _bounds(tube).items()}
    if found.along:
        content["along"] = {name: list(ends) for name, ends in _bounds(found.along).items()}
    if found.span:
        content["theta"] = list(found.span)  # along the whole path, s: where the tube holds it
    return content


def _bounds(tube: Tube) -> dict[str, tuple[float, float]]:
    named = {"speed": tube.speed, "curvature": tube.curvature, "acceleration": tube.acceleration}
    return {name: (interval.lower, interval.upper) for name, interval in named.items()}


def _below(value: float) -> float:
    """A little less than a figure that was rounded to nearest some times over."""
    return float(value) * (1 - 1e-14)


def _half_widths(funnel: Funnel) -> list[float]:
    exact = half_widths([[fmpq(*float(entry).as_integer_ratio()) for entry in row] for row in funnel.shape])
    return [-float_below(-width) for width in exact]


def _robustness_json(problem: Problem, robustness: Robustness) -> dict[str, Any]:
    """Periods and delays in s; disturbances in units of the states a second.

    Where sampled control is proven, `period` and `delay` are those of its law; `any_law` has what every law absorbs.
    """
    states = problem.vehicle.state_names

    def absorbed(amounts: Absorbed) -> dict[str, Any]:
        return {
            "period": amounts.period,
            "disturbance": dict(zip(states, amounts.disturbance, strict=True)),
            "pose_error": dict(zip(states, amounts.pose_error, strict=True)),
            "delay": amounts.delay,
        }

    together = absorbed(robustness.together) | {"level": robustness.level}
    alone = absorbed(robustness.alone) | {"pose_level": robustness.pose_level}
    content = {"law_share": float_below(SHARE), **alone, "jointly": together}
    if robustness.by_speed:
        content["by_speed"] = [{"speed": [lower, upper], **absorbed(own)} for lower, upper, own in robustness.by_speed]
    return dataclasses.asdict(robustness.sampled) | {"any_law": content} if robustness.sampled else content


def _closed_loop_json(loop: ClosedLoop) -> dict[str, Any]:
    content = dataclasses.asdict(loop)
    return content | {
        "largest_value": _number(loop.largest_value),
        "arrival": [_number(time) for time in loop.arrival] if loop.arrival else None,
    }


def _margin_per_metre(result: Result) -> float | None:
    """The smallest of the tubes', or the smallest certified λ over the largest speed of its segment, 1/m.

    Not stretch by stretch, where it might be more: the checker answers for a segment's margin, not for a stretch's.
    """
    held = result.margin_per_metre is not None or any(found.span for found in result.segments)
    if held or result.margin_certified is None:
        return result.margin_per_metre
    margins = [found.margin_certified or 0.0 for found in result.segments]
    tops = [segment.top_speed for segment in result.problem.path.segments]
    return min(_below(margin / top) for margin, top in zip(margins, tops, strict=True))


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def result_of(data: dict[str, Any], problem: Problem, document: dict[str, Any] | None) -> Result:
    """The result whose `result_json` this is; `problem` is the configured one, `document` its certificate.

    Raises:
        KeyError, TypeError, ValueError, AttributeError: for what is none.
    """
    loop = data["closed_loop"]
    # objective=inlet enlarges the I of the configuration
    path = dataclasses.replace(problem.path, source=data.get("source") or "")  # not of the folder's own copy
    problem = dataclasses.replace(problem, path=path, inlet=Ellipsoid(tuple(data["sets"]["inlet"])))
    return Result(
        verdict=Verdict(data["verdict"]),
        message=data["message"],
        problem=problem,
        segments=tuple(_segment_of(segment) for segment in data["segments"]),
        robustness=_robustness_of(data.get("robustness")),
        closed_loop=ClosedLoop(**{**loop, "arrival": tuple(loop["arrival"]) if loop["arrival"] else None})
        if loop
        else None,
        seconds=data["seconds"],
        iterations=data["iterations"],
        search=data.get("search", {}),
        history=tuple(data.get("history", ())),
        document=document,
        failed_at=tuple(data["failed_at"]) if data.get("failed_at") else None,
        worst_points=tuple(_worst_of(point) for point in data.get("worst_points", ())),
        command=data.get("command"),
    )


def _robustness_of(data: dict[str, Any] | None) -> Robustness | None:
    if data is None:
        return None

    def absorbed(own: dict[str, Any]) -> Absorbed:
        return Absorbed(
            own["period"], tuple(own["disturbance"].values()), tuple(own["pose_error"].values()), own["delay"]
        )

    sampled, own = None, data
    if "any_law" in data:
        own = data["any_law"]
        ahead = {name: value for name, value in data.items() if name != "any_law"}
        sampled = Sampled(**ahead | {"inputs": tuple(map(tuple, ahead["inputs"])), "bends": tuple(ahead["bends"])})
    bands = tuple((*band["speed"], absorbed(band)) for band in own.get("by_speed", ()))
    together = own["jointly"]
    return Robustness(absorbed(own), own["pose_level"], absorbed(together), together["level"], bands, sampled)


def _tube_of(data: dict[str, Any]) -> Tube:
    return Tube(**{name: Interval(*ends) for name, ends in data.items()})


def _segment_of(data: dict[str, Any]) -> SegmentResult:
    template = template_named(data["template"])
    funnel = Funnel(
        template,
        np.array(data["C"], float),
        data[template.rate_name],
        math.inf if data["duration"] is None else data["duration"],
        data["beta_lower"],
        data["beta_inner"],
    )
    falsified, span = data["margin_falsified"], data.get("theta")
    return SegmentResult(
        funnel=funnel,
        margin_falsified=math.nan if falsified is None else falsified,
        margin_certified=data["margin_certified"],
        margin_per_metre=data.get("margin_per_metre"),
        contraction=data.get("contraction", {}).get("metres"),
        margin_sos=data.get("margin_sos"),
        reference=_tube_of(data["reference"]) if span else None,
        along=_tube_of(data["along"]) if "along" in data else None,
        span=(span[0], span[1]) if span else None,
        stretches=tuple(StretchMargin(**stretch) for stretch in data.get("stretches", ())),
    )
