"""What is shown of a result, as panels: the plane, V and inputs of cars, the reference, margins, sections."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cfjax.funnel import Funnel
from cfjax.report.cars import CarTrace, cars_of, ride_of
from cfjax.report.marks import (
    BEYOND,
    CAR_STARTS,
    CARS,
    CERTIFIED,
    FAILED_SPAN,
    FALSIFIED,
    FUNNEL,
    GOAL,
    INLET,
    JOINT,
    ONE_PATH,
    PROFILE,
    SHELL,
    TUBE,
    ZERO,
    Axis,
    Band,
    Lines,
    Note,
    Panel,
    rings_of,
)
from cfjax.report.plane import Plane, shadows, swept
from cfjax.report.style import ellipse_outline
from cfjax.report.terms import input_label, short_label, state_label
from cfjax.result import Result, SegmentResult, StretchMargin
from cfjax.rounded import margin_text, rounded_up, written


SHOWN_INPUTS = 12  # cars
MOST_JOINTS = 60  # more lines than that are no lines
LOST = 4.0  # V
LEAST_SPAN = 1e-6  # 1/m and m/s: what varies less is constant and rounding
ROOM = 0.12  # of what is shown of an axis, beyond it
TUBE_ROWS, PROFILE_ROWS = 300, 400  # of a picture, of a segment
HEADING, LATERAL, LONGITUDINAL, POSE = 0, 1, 2, 3  # states of every vehicle come in this order; then its own
ROOMY = 3  # sections, of which each has room for a long label


class Shown(NamedTuple):
    """All panels of a result by what they are about, and what they were made from."""

    plane: Plane | None  # None for a tube
    cars: list[CarTrace]
    panels: dict[str, list[Panel]]  # plane, values, inputs, profile, margins, sections: those that say something


def shown_of(result: Result, points: int) -> Shown:
    """Of the recorded cars as many and as finely as `points` of all together allow."""
    plane = None if result.problem.path.tube else Plane(result)
    cars = cars_of(result, plane.course if plane else None, points)
    panels: dict[str, list[Panel]] = {}
    if plane:
        panels["plane"] = [plane.panel([car.place for car in cars])]
    elif result.segments and cars:
        panels["plane"] = [tube_panel(result)]
    if cars:
        panels["values"] = [value_panel(result, cars)]
        panels["inputs"] = list(input_panels(result, cars[:SHOWN_INPUTS]))
    if plane:
        panels["profile"] = list(profile_panels(result))
        panels["margins"] = [margin_panel(result)] if result.segments else []
    if result.segments:
        panels["sections"] = list(section_panels(result))
    return Shown(plane, cars, {name: found for name, found in panels.items() if found})


def value_panel(result: Result, cars: list[CarTrace]) -> Panel:
    """V along the ways of the cars."""
    values = [car.value for car in cars]
    band, note = shell(result.segments[0].funnel)
    marks = (band, *_places(result), _curves(cars, values), note)
    return Panel("values", _way(result, cars), value_axis(np.concatenate(values)), marks)


def value_axis(values: Float[np.ndarray, "..."]) -> Axis:
    """V from 0 to above the shell and the values, but no farther than where a car is lost."""
    top = float(np.nanmax(values, initial=0.0))
    return Axis("V(θ, x)", (0.0, min(max(1.05, 1.04 * top), LOST)))


def shell(funnel: Funnel) -> tuple[Band, Note]:
    """The levels of V between which it decreases with the proven margin."""
    lower = rounded_up(written(funnel.beta_lower))
    return Band(SHELL, funnel.beta_lower, 1.0), Note(f"shell V ∈ [{lower}, 1]: V̇ ≤ −λ", funnel.beta_lower)


def input_panels(result: Result, cars: list[CarTrace]) -> Iterator[Panel]:
    """What the law asks of each input, between its limits."""
    problem = result.problem
    for k, (name, box) in enumerate(zip(("u0", *problem.vehicle.input_names), problem.inputs, strict=True)):
        beyond = Band(BEYOND, -math.inf, box.lower), Band(BEYOND, box.upper, math.inf)
        curves = _curves(cars, [car.inputs[:, k] for car in cars])
        yield Panel(
            f"input {name}",
            _way(result, cars),
            Axis(input_label(name), _roomy(box.lower, box.upper)),
            (*beyond, curves),
        )


def profile_panels(result: Result) -> Iterator[Panel]:
    """The reference's curvature and speed; nothing of one steady segment."""
    curve = result.problem.path.curve
    if len(curve) == 1 and curve[0].is_steady:
        return
    begin, theta, curvature, speed = 0.0, [], [], []
    for segment in curve:
        own = np.linspace(0.0, segment.duration, PROFILE_ROWS)
        theta.append(begin + own)
        speed.append(segment.speed.values(own))
        curvature.append(segment.turn_rate.values(own) / speed[-1])
        begin += segment.duration
    for name, title, values in (("curvature", "κ (1/m)", curvature), ("speed", "vᵣ (m/s)", speed)):
        every = np.concatenate(values)
        if name == "curvature" or np.ptp(every) > LEAST_SPAN:
            low, high = min(0.0, every.min()), max(0.0, every.max())  # zero lies in the picture
            line = Lines(PROFILE, [np.stack([np.concatenate(theta), every], axis=-1)])
            yield Panel(name, _way(result), Axis(title, _roomy(low, high)), (*_places(result), line))


def margin_panel(result: Result) -> Panel:
    """What is proven along the path, and what the falsifier found."""
    legs = list(zip(result.spans, result.segments, strict=True))
    seen = [(*span, found.margin_falsified) for span, found in legs if math.isfinite(found.margin_falsified)]
    is_proven = result.margin_certified is not None
    proven = [stretch for span, found in legs for stretch in stretches_of(found, *span) if is_proven]
    areas = [np.array([(a, 0.0), (a, m), (b, m), (b, 0.0), (a, 0.0)]) for a, b, m in proven]
    lines = [np.array([(a, m), (b, m)]) for a, b, m in seen]
    heights = [0.0, *(margin for *_, margin in (*proven, *seen))]
    low, high = _roomy(min(heights), max(heights))
    marks = Lines(CERTIFIED, areas, each="stretch"), *_places(result), Lines(FALSIFIED, lines, each="funnel")
    return Panel(
        "margins",
        _way(result),
        Axis("λ (1/s)", (low if min(heights) < 0 else 0.0, high), margin_text),
        (*marks, Band(ZERO, 0.0, 0.0)),
    )


def stretches_of(found: SegmentResult, begin: float, end: float) -> list[StretchMargin]:
    """What is proven along a funnel, θ along the whole path; in one piece where the stretches are not known."""
    if not found.stretches:
        return [StretchMargin(begin, end, found.margin_certified or 0.0)]
    return [StretchMargin(begin + each.begin, begin + each.end, each.margin) for each in found.stretches]


def section_panels(result: Result) -> Iterator[Panel]:
    """Shadows of the first funnel at θ = 0, of G and of I on pairs of states."""
    problem = result.problem
    names = problem.vehicle.state_names
    spreads = [(TUBE if problem.path.tube else FUNNEL, np.linalg.inv(result.segments[0].funnel.shape))]
    for kind, ellipsoid in ((GOAL, problem.goal), (INLET, problem.inlet)):
        if ellipsoid:
            spreads.append((kind, np.diag(np.square(ellipsoid.half_axes))))
    pairs = shown_pairs(len(names))
    called = state_label if len(pairs) <= ROOMY else short_label
    for k, pair in enumerate(pairs):
        marks = (Lines(kind, [ellipse_outline(spread[np.ix_(pair, pair)]).T]) for kind, spread in spreads)
        across, up = (Axis(called(names[state])) for state in pair)
        yield Panel(f"section {k + 1}", across, up, tuple(marks))


def shown_pairs(states: int) -> tuple[tuple[int, int], ...]:
    """Pairs of different states, so many panels: place, heading, and each state beside the pose with the way ahead."""
    beside = range(POSE, states) if states > POSE else (HEADING,)
    return (LATERAL, LONGITUDINAL), (LATERAL, HEADING), *((LONGITUDINAL, state) for state in beside)


def tube_panel(result: Result) -> Panel:
    """A tube along one of the paths it is proven for, turned to lie along the panel, and a car."""
    ride = ride_of(result, TUBE_ROWS)
    assert ride.place is not None
    funnel, line = result.segments[0].funnel, ride.poses[:, 1:]
    _, _, axes = np.linalg.svd(line - line.mean(axis=0), full_matrices=False)
    turn = axes * np.array([[1.0], [np.sign(np.linalg.det(axes))]])  # a rotation, no reflection: left stays left
    turned = [
        (points - line[0]) @ turn.T
        for points in (*rings_of(swept(shadows(funnel, 0 * ride.along, ride.poses))), line, ride.place)
    ]
    *rings, line, place = turned
    marks = (
        Lines(TUBE, rings),
        Lines(ONE_PATH, [line]),
        Lines(CARS, [place], each="car"),
        Lines(CAR_STARTS, [place[:1]]),
    )
    return Panel("plane", Axis("m"), Axis("m"), marks, equal=True)


def _way(result: Result, cars: Sequence[CarTrace] = ()) -> Axis:
    """Along the reference: of a tube, whose paths differ in length, as far as half of the cars come."""
    if result.problem.path.tube:
        return Axis("way of the reference (m)", (0.0, float(np.median([car.along[-1] for car in cars]))))
    return Axis("reference time θ (s)", (0.0, result.problem.path.duration))


def _places(result: Result) -> list[Band]:
    """Where one funnel follows another, and where the proof failed."""
    joints = [begin for begin, _ in result.spans[1:]]
    failed = [Band(FAILED_SPAN, *result.failed_at, upright=True)] if result.failed_at is not None else []
    return [*failed, *(Band(JOINT, at, at, upright=True) for at in joints if len(joints) <= MOST_JOINTS)]


def _curves(cars: list[CarTrace], values: list[np.ndarray]) -> Lines:
    return Lines(CARS, [np.stack([car.along, own], axis=-1) for car, own in zip(cars, values, strict=True)], each="car")


def _roomy(low: float, high: float) -> tuple[float, float]:
    """A little more than from `low` to `high`."""
    room = ROOM * (high - low) if high - low > LEAST_SPAN else 1.0
    return low - room, high + room
