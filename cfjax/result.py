"""What a synthesis returns: one typed object with verdict, message, funnels, margins and statistics."""

import itertools
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from cfjax import coerce
from cfjax.funnel import Funnel, Leg
from cfjax.lazy import public
from cfjax.problem import Problem, Tube
from cfjax.verdict import Verdict


if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class StretchMargin(NamedTuple):
    """The margin proven on a stretch of a segment: θ from begin to end (s), λ in 1/s."""

    begin: float
    end: float
    margin: float


@dataclass(frozen=True)
class SegmentResult:
    """One segment's funnel and its margins λ in 1/s; None where there is no such figure.

    A path that is held by universal tubes has one for each stretch in one tube, with the tube's bounds and where it
    holds, instead of one for each of its segments.
    """

    funnel: Funnel
    margin_falsified: float  # smallest margin that the falsifier found: the true one is not larger
    margin_certified: float | None = None  # proven: the true one is not smaller
    margin_per_metre: float | None = None  # proven for a tube: V' <= -margin_per_metre v_r, 1/m
    contraction: float | None = None  # of a tube: m of the path until V <= 1 has become V <= beta_inner, at that margin
    margin_sos: float | None = None  # optimum of the numerical sums-of-squares program
    reference: Tube | None = None  # bounds of the tube by which a path is held
    span: tuple[float, float] | None = None  # and where: θ along the whole path, s
    along: Tube | None = None  # bounds of the path in that tube, everywhere it holds: what the law asks for
    stretches: tuple[StretchMargin, ...] = ()  # proven along θ, which covers the segment; none for a tube


class WorstPlace(NamedTuple):
    """Where the falsifier saw a condition closest to failing, or failing: a deviation from a segment's reference.

    `slack` is positive where the condition holds: for (d) the margin λ in 1/s, else dimensionless, as
    `cfjax.falsifier.WorstPoint` has it. Of segments that are alike it is the first.
    """

    segment: int  # of the path, from 0
    condition: str  # "a", "b", "c" or "d"
    slack: float
    theta: float  # s of the segment; says nothing in a tube
    x: tuple[float, ...]  # deviation, in the units of the states


@dataclass(frozen=True)
class ClosedLoop:
    """Cars driven through the funnel under the certified law; counts of what must not happen, and what was seen."""

    cars: int
    left_funnel: int  # V > 1 at some time, in the funnel where the car was
    left_safe: int  # outside S at some time: outside the box, or into an obstacle
    missed_goal: int  # not inside G when θ reached T; in a tube: outside G at some time
    largest_value: float  # max of V over all cars and times
    arrival: tuple[float, float] | None  # earliest and latest, s; None in a tube, which has no end, or if none arrived


@dataclass(frozen=True)
class Absorbed:
    """Amounts: inputs held for `period` s, rates off by `disturbance` a second, the pose off by `pose_error` and
    `delay` s old; by state, in its unit.
    """

    period: float
    disturbance: tuple[float, ...]
    pose_error: tuple[float, ...]
    delay: float


@dataclass(frozen=True)
class Robustness:
    """What certified funnels absorb under a law that inherits the certificate: proven (`cfjax.check.robustness`).

    `alone` has each by itself, of disturbance and pose error in one state at a time; `together` all at once. V stays
    below 1, where the pose has an error from starts below a level. Of a tube: under a law that reaches the margins for
    every curvature and acceleration at once; of a path in tubes: for those of the path (`SegmentResult.along`).
    """

    alone: Absorbed
    pose_level: float  # of V at the start, with an error of the pose alone
    together: Absorbed
    level: float  # likewise, with all at once
    by_speed: tuple[tuple[float, float, Absorbed], ...] = ()  # of a tube: `alone` from one speed to another, m/s


@dataclass(frozen=True)
class Rollouts:
    """Recorded cars: clock and θ (s), deviations, and V; axes (time, car[, state]). Arrived cars stay at θ = T.

    θ counts along the whole path, over all its segments; V is that of the funnel in which the car is.
    In a tube every car has a path of its own, and `reference` is the pose on it: heading in rad, position in m.
    """

    clock: Float[np.ndarray, "t k"]
    theta: Float[np.ndarray, "t k"]
    x: Float[np.ndarray, "t k n"]
    value: Float[np.ndarray, "t k"]
    inputs: Float[np.ndarray, "t k m"]  # (u0, *vehicle inputs) that the law takes there
    reference: Float[np.ndarray, "t k 3"] | None = None


@dataclass(frozen=True)
class Result:
    """Verdict and message (one line), the funnels found with their margins, and how it went.

    `cfjax.synthesize` makes it.
    """

    verdict: Verdict
    message: str
    problem: Problem
    segments: tuple[SegmentResult, ...] = ()
    robustness: Robustness | None = None
    closed_loop: ClosedLoop | None = None
    rollouts: tuple[Rollouts, ...] = ()  # one for the cars that were driven, along the whole path
    seconds: dict[str, float] = field(default_factory=dict)  # learn, certify, simulate, plot, …, total
    iterations: int = 0  # rounds of the learn–certify loop
    history: tuple[dict[str, float], ...] = ()  # per round: margin falsified, certified, counterexamples
    search: dict[str, Any] = field(default_factory=dict)  # how the learner went about it: its own figures
    document: dict[str, Any] | None = None  # certificate.json, where there is one
    failed_at: tuple[float, float] | None = None  # θ along the whole path (s), where one place stopped the proof
    worst_points: tuple[WorstPlace, ...] = ()  # of the falsifier; none of tubes that came with the package
    command: str | None = None  # of the shell, that asked for it; None where Python did
    account: tuple[str, ...] = field(default=(), compare=False)  # the checker's, in paragraphs; not in result.json

    def __post_init__(self) -> None:
        coerce.keep(
            self,
            verdict=coerce.choice("verdict", self.verdict, Verdict),
            message=coerce.text("message", self.message),
            problem=coerce.instance("problem", self.problem, Problem),
            segments=coerce.instances("segments", self.segments, SegmentResult),
            rollouts=coerce.instances("rollouts", self.rollouts, Rollouts),
            iterations=coerce.whole("iterations", self.iterations, 0),
        )
        for name, kind in (
            ("robustness", Robustness),
            ("closed_loop", ClosedLoop),
            ("document", dict),
            ("command", str),
        ):
            coerce.optional(name, getattr(self, name), kind)
        coerce.objects(seconds=(self.seconds, dict), search=(self.search, dict))

    @property
    def margin_certified(self) -> float | None:
        """The smallest over the segments, 1/s; None unless every segment is certified."""
        margins = [segment.margin_certified for segment in self.segments]
        return None if not margins or None in margins else min(m for m in margins if m is not None)

    @property
    def margin_falsified(self) -> float | None:
        """The smallest over the segments, 1/s."""
        return min((segment.margin_falsified for segment in self.segments), default=None)

    @property
    def spans(self) -> list[tuple[float, float]]:
        """θ along the whole path (s) from which on and until when each funnel holds: a segment's, or a stretch's."""
        ends = itertools.accumulate((segment.duration for segment in self.problem.path.segments), initial=0.0)
        own = list(itertools.pairwise(ends))
        return [found.span or own[index] for index, found in enumerate(self.segments)]

    @property
    def legs(self) -> list[Leg]:
        """Where along the path each funnel holds, a segment or a stretch in one tube; of a path that is no tube."""
        per_metre = [(found.margin_per_metre or 0.0) if found.span else 0.0 for found in self.segments]
        return [
            Leg(end, found.funnel, found.margin_certified or 0.0, way, found.along)
            for (_, end), found, way in zip(self.spans, self.segments, per_metre, strict=True)
        ]

    def plot(self, panel: str | None = None, axes: "Axes | None" = None) -> "Figure":
        """A Matplotlib figure of the result, or of one of its panels: `cfjax.plot`."""
        return public("plot")(self, panel, axes)

    def replace(self, **changes: Any) -> "Result":
        """The same result with some fields changed."""
        return replace(self, **changes)
