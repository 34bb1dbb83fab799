"""Where a segment is cut into stretches: chosen by the falsifier, so that each of them is proven but once.

A longer stretch is a larger set of references at more of the funnel's levels, so the margin along it is smaller: for a
target there is a longest stretch from every θ, and going on from its end there are few. What particles find on a
stretch costs a hundredth of its proof and is nearly what the proof shows; where they are too hopeful the proof, which
alone decides, falls short, and the stretch is cut again (`cfjax.certificate.stretches`).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from cfjax.falsifier import stretch_margins
from cfjax.funnel import Funnel
from cfjax.funnel.instance import Stretch
from cfjax.problem import Interval, Problem, Segment, Tube


CELLS = 1024  # of a segment: stretches begin and end between them
BATCH = 16  # ends that are tried at once, all in one program
NEAR_ENOUGH = 1 / 16  # of a stretch's length, by which it may be shorter than the longest
LOWER = 0.97  # of the target, where too many stretches would be needed
ALMOST = 0.995  # of the margin of a cell that falls short of the target
LEAST_SHARE = 0.3  # of the target asked: below, shorter stretches are not what is missing


class Plan(NamedTuple):
    """Ends of the stretches, in cells; the first one begins at 0."""

    ends: tuple[int, ...]
    target: float  # 1/s, that each of them is to prove


def plan(
    problem: Problem,
    segment: Segment,
    funnel: Funnel,
    target: float,
    spare: float,
    most: int,
    is_smooth: bool = False,
) -> Plan:
    """Few stretches, none of which has a margin below `spare` (≥ 1) times the target (1/s) as far as particles find.

    The target is lowered where they would be more than `most`, or where a place alone does not reach it; what is then
    left to try is the whole segment in `most` equal parts; so it is where the reference stops, which has no curvature
    there: the proof then says between which θ. Of a smooth segment a stretch has bounds of the curvature's rate too.
    """
    planner = _Planner(problem, segment, funnel, is_smooth)
    wanted = target if planner.speed.min() > 0 else 0.0
    good: Plan | None = None
    failing = step = None
    while wanted > 0 and wanted >= LEAST_SHARE * target:
        ends, shortest = planner.ends(spare * wanted, most)
        if ends:
            good = Plan(ends, wanted)
        elif good is None and shortest < spare * wanted:  # a cell alone: what it has is the most that can be had
            wanted = shortest / spare * ALMOST
            continue
        else:
            failing = wanted
        if good is None:  # attempts take seconds: each goes further down than the one before
            step = LOWER if step is None else step**2
            wanted *= step
        elif failing is None or good.target >= LOWER * failing:
            break
        else:
            wanted = (good.target * failing) ** 0.5
    return good or Plan(tuple(CELLS * (k + 1) // most for k in range(most)), 0.0)


@dataclass
class _Planner:
    problem: Problem
    segment: Segment
    funnel: Funnel
    is_smooth: bool = False

    def __post_init__(self) -> None:
        self.theta = np.linspace(0.0, self.segment.duration, CELLS + 1)
        turn, speed = self.segment.turn_rate.values, self.segment.speed.values
        self.speed, self.slope = speed(self.theta), speed(self.theta, 1)
        moving = np.where(self.speed > 0, self.speed, np.nan)
        self.curvature = turn(self.theta) / moving
        self.curvature_rate = (turn(self.theta, 1) - self.curvature * self.slope) / moving
        self.known: dict[tuple[int, int], float] = {}

    def ends(self, target: float, most: int) -> tuple[tuple[int, ...], float]:
        """Of the longest stretches that reach the target, one after another, and the target.

        Nothing where more than `most` are needed, or where a cell alone falls short: then with that cell's margin.
        """
        ends: list[int] = []
        begin = 0
        while begin < CELLS:
            if len(ends) == most:
                return (), target
            end = self._longest(begin, target)
            if end == begin:
                return (), self.known[begin, begin + 1]
            ends.append(end)
            begin = end
        return tuple(ends), target

    def _longest(self, begin: int, target: float) -> int:
        """The last cell to which a stretch reaches the target, within a part of its length; `begin` for none."""
        good, bad = begin, CELLS + 1
        while bad - good > 1 + NEAR_ENOUGH * (good - begin):
            tried = np.unique(np.linspace(good, min(bad, CELLS), BATCH + 1).astype(int))[1:]
            tried = tried[tried < bad]
            short = self._margins(begin, tried) < target
            first = int(np.argmax(short)) if short.any() else len(tried)
            good = int(tried[first - 1]) if first else good
            bad = int(tried[first]) if first < len(tried) else bad
            if good == CELLS:
                break
        return good

    def _margins(self, begin: int, ends: Int[np.ndarray, " e"]) -> Float[np.ndarray, " e"]:
        new = [end for end in map(int, ends) if (begin, end) not in self.known]
        if new:
            stretches = [self._stretch(begin, end) for end in [*new, *new[-1:] * (BATCH - len(new))]]
            found = stretch_margins(self.problem, self.segment, self.funnel, stretches)
            self.known |= {(begin, end): float(margin) for end, margin in zip(new, found, strict=False)}
        return np.array([self.known[begin, int(end)] for end in ends])

    def _stretch(self, begin: int, end: int) -> Stretch:
        def range_of(values: Float[np.ndarray, " c"]) -> Interval:
            part = values[begin : end + 1]
            return Interval(float(part.min()), float(part.max()))

        bounds = Tube(range_of(self.curvature), range_of(self.speed), range_of(self.slope))
        changing = range_of(self.curvature_rate) if self.is_smooth else None
        return Stretch(float(self.theta[begin]), float(self.theta[end]), bounds, changing)
