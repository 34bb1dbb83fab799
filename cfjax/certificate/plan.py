"""Where a segment is cut into stretches: chosen by the falsifier, so that each of them is proven but once.

A longer stretch is a larger set of references at more of the funnel's levels, so the margin along it is smaller: for a
target there is a longest stretch from every θ, and going on from its end there are few. What particles find on a
stretch costs a hundredth of its proof and is nearly what the proof shows; where they are too hopeful the proof, which
alone decides, falls short, and the stretch is cut again (`cfjax.certificate.stretches`).
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from cfjax.falsifier import stretch_margins
from cfjax.funnel import Funnel
from cfjax.funnel.instance import Span
from cfjax.problem import Interval, Problem, Segment, Tube


CELLS = 1024  # of a segment: stretches begin and end between them
BATCH = 16  # ends that are tried at once, all in one program
NEAR_ENOUGH = 1 / 16  # of a stretch's length, by which it may be shorter than the longest
LOWER, NEAR = 0.97, 0.8  # of a target that needs too many stretches: near enough; so near that it is tried
MOST_ATTEMPTS = 2  # at a better target than that of equal parts: with five states each takes a minute
ALMOST = 0.995  # of the margin of a cell that falls short of the target
LEAST_SHARE = 0.3  # of the target asked: below, shorter stretches are not what is missing


class Cuts(NamedTuple):
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
) -> Cuts:
    """Few stretches, none of which has a margin below `spare` (≥ 1) times the target (1/s) as far as particles find.

    The target is lowered where they would be more than `most`, or where a place alone does not reach it; what is then
    left to try is the whole segment in `most` equal parts; so it is where the reference stops, which has no curvature
    there: the proof then says between which θ. Of a smooth segment a stretch has bounds of the curvature's rate too.
    """
    planner = _Planner(problem, segment, funnel, is_smooth)
    wanted, least = target if planner.speed.min() > 0 else 0.0, LEAST_SHARE * target
    while wanted > 0 and wanted >= least:
        ends, shortest = planner.ends(spare * wanted, most)
        if ends:
            return Cuts(ends, wanted)
        if shortest >= spare * wanted:
            return _below(planner, wanted, least, spare, most)
        wanted = shortest / spare * ALMOST  # a cell alone: what it has is the most that can be had
    return Cuts(_even(most), 0.0)


def _even(count: int) -> tuple[int, ...]:
    return tuple(CELLS * (k + 1) // count for k in range(count))


def _below(planner: "_Planner", failing: float, least: float, spare: float, most: int) -> Cuts:
    """A plan for a lower target than one that needs too many stretches: at least what equal parts reach can be had."""
    good = Cuts(_even(most), planner.margin(_even(most)) / spare)
    near = good.target >= NEAR * failing  # then a little lower may do
    for attempt in range(MOST_ATTEMPTS):
        if good.target >= LOWER * failing:
            break
        wanted = LOWER * failing if near and not attempt else (max(good.target, least) * failing) ** 0.5
        ends, _ = planner.ends(spare * wanted, most)
        if ends:
            good = Cuts(ends, wanted)
        else:
            failing = wanted
    return good if good.target >= least else Cuts(_even(most), 0.0)


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

    def margin(self, ends: Sequence[int]) -> float:
        """The least of all stretches of a plan."""
        return float(min(self._of_stretches(list(itertools.pairwise((0, *ends))))))

    def _margins(self, begin: int, ends: Int[np.ndarray, " e"]) -> Float[np.ndarray, " e"]:
        return self._of_stretches([(begin, end) for end in map(int, ends)])

    def _of_stretches(self, stretches: Sequence[tuple[int, int]]) -> Float[np.ndarray, " e"]:
        unknown = [each for each in stretches if each not in self.known]
        for new in (unknown[k : k + BATCH] for k in range(0, len(unknown), BATCH)):
            batch = [self._stretch(*each) for each in [*new, *new[-1:] * (BATCH - len(new))]]
            found = stretch_margins(self.problem, self.segment, self.funnel, batch)
            self.known |= {each: float(margin) for each, margin in zip(new, found, strict=False)}
        return np.array([self.known[each] for each in stretches])

    def _stretch(self, begin: int, end: int) -> Span:
        def range_of(values: Float[np.ndarray, " c"]) -> Interval:
            part = values[begin : end + 1]
            return Interval(float(part.min()), float(part.max()))

        bounds = Tube(range_of(self.curvature), range_of(self.speed), range_of(self.slope))
        changing = range_of(self.curvature_rate) if self.is_smooth else None
        return Span(float(self.theta[begin]), float(self.theta[end]), bounds, changing)
