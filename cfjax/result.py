"""What a synthesis returns: one typed object with verdict, message, funnels, margins and statistics."""

import html
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from cfjax import coerce
from cfjax.funnel import Funnel, Leg, Objective
from cfjax.lazy import public
from cfjax.problem import Problem, Tube, Vehicle
from cfjax.rounded import MILLI, margin_text, rounded_down, rounded_up, written
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
    theta: float | None  # s of the segment; None in a tube, where all are alike
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

    @property
    def outcome(self) -> str:
        """Whether all of them did what is proven, in words."""
        failures = self.left_funnel + self.left_safe + self.missed_goal
        return f"{failures} failures" if failures else "none lost"


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
class Sampled:
    """What is proven of the law that looks one hold ahead (`cfjax.control.sampled`): `period` (s) is the longest hold.

    It takes one of `inputs` (u0, *vehicle inputs), and on the shell V falls at `decrease` (1/s) or more. `bends` bounds
    the derivative of V of order `order` + 1 under each of them. A pose that it sees may be `delay` s old: it predicts
    (`cfjax.control.prediction`), and from V ≤ `level` on stays in V ≤ 1 until the first pose is there.
    """

    period: float
    order: int
    decrease: float
    inputs: tuple[tuple[float, ...], ...]
    bends: tuple[float, ...]
    delay: float = 0.0
    level: float = 1.0
    start: int = 0  # the number of the input that is held until then


@dataclass(frozen=True)
class Robustness:
    """What certified funnels absorb under a law that inherits the certificate: proven
    (`cfcheck.robustness.rate_bounds`).

    `alone` has each by itself, of disturbance and pose error in one state at a time; `together` all at once. V stays
    below 1, where the pose has an error from starts below a level. Of a tube: under a law that reaches the margins for
    every curvature and acceleration at once; of a path in tubes: for those of the path (`SegmentResult.along`).
    """

    alone: Absorbed
    pose_level: float  # of V at the start, with an error of the pose alone
    together: Absorbed
    level: float  # likewise, with all at once
    by_speed: tuple[tuple[float, float, Absorbed], ...] = ()  # of a tube: `alone` from one speed to another, m/s
    sampled: Sampled | None = None  # of another law, where that was asked for


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
    def margin_per_metre(self) -> float | None:
        """The smallest proven per metre of the path, 1/m; None for funnels of a path's own segments."""
        margins = [found.margin_per_metre for found in self.segments]
        return None if not margins or None in margins else min(m for m in margins if m is not None)

    @property
    def spans(self) -> list[tuple[float, float]]:
        """θ along the whole path (s) from which on and until when each funnel holds: a segment's, or a stretch's."""
        ends = itertools.accumulate((segment.duration for segment in self.problem.path.segments), initial=0.0)
        own = list(itertools.pairwise(ends))
        return [found.span or own[index] for index, found in enumerate(self.segments)]

    @property
    def legs(self) -> list[Leg]:
        """Where each funnel holds: a segment, a stretch in one tube, or, without end, every path of a tube."""
        return [
            Leg(end, found.funnel, found.margin_certified or 0.0, found.margin_per_metre or 0.0, found.along)
            for (_, end), found in zip(self.spans, self.segments, strict=True)
        ]

    def plot(self, panel: str | None = None, axes: "Axes | None" = None, width: str | float | None = None) -> "Figure":
        """A Matplotlib figure of the result, or of one of its panels: `cfjax.plot`."""
        return public("plot")(self, panel, axes, width)

    def report(self, path: Path | str | None = None) -> Path:
        """Write the page that shows the result, and return where it is: `cfjax.write_report`."""
        return public("write_report")(self, path)

    def replace(self, **changes: Any) -> "Result":
        """The same result with some fields changed."""
        return replace(self, **changes)

    def without_claim(self, verdict: Verdict, message: str) -> "Result":
        """The same funnels under another verdict: without a certificate, and without margins that one proves."""
        nothing = {"margin_certified": None, "margin_per_metre": None, "contraction": None, "stretches": ()}
        segments = tuple(replace(segment, **nothing) for segment in self.segments)
        return replace(self, verdict=verdict, message=message, account=(), segments=segments, document=None)

    # --- for people

    @property
    def title(self) -> str:
        """Verdict, path and method."""
        law = f", law {self.problem.law.name}" if self.problem.law else ""
        return f"{self.verdict.value}: {self.problem.path.name}, {self.problem.method.words}{law}"

    def facts(self, objective: Objective = Objective()) -> list[tuple[str, str]]:
        """What came out, in words and units, each under its label; figures are rounded so that they claim less."""
        coerce.instance("objective", objective, Objective)
        found: list[tuple[str, str]] = []
        if self.margin_certified is None:  # otherwise the message is the checker's whole account
            found.append(("reason", self.message))
            found.append(("what helps", "docs/not-certified.md, the cheapest first"))
        if self.margin_falsified is not None:
            found.append(("margin", self._margin()))
            if objective.margin is not None:
                found.append(("objective", self._reached(objective.margin)))
        if self.robustness is not None:
            found += self._absorbed(self.robustness)
        if self.closed_loop is not None:
            found += self._driven(self.closed_loop)
        return found

    def describe(self, objective: Objective = Objective()) -> str:
        """The same as a list for a terminal."""
        return "\n".join([self.title, *(f"  {label:<14}  {text}" for label, text in self.facts(objective))])

    def __str__(self) -> str:
        return self.describe()

    def __repr__(self) -> str:
        margin = () if self.margin_falsified is None else (f"margin {self._margin()}",)
        loop = self.closed_loop
        cars = () if loop is None else (f"{loop.cars} cars, {loop.outcome}",)
        return f"<{'; '.join([self.title, *margin, *cars])}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{html.escape(label)}</th><td>{html.escape(text)}</td></tr>" for label, text in self.facts()
        )
        return f"<table><caption>{html.escape(self.title)}</caption>{rows}</table>"

    def _margin(self) -> str:
        margin, falsified = self.margin_certified, self.margin_falsified
        per_metre = self.margin_per_metre
        proven = "nothing proven" if margin is None else f"{margin_text(margin)} 1/s proven"
        way = f" ({margin_text(per_metre)} per metre of the path)" if per_metre else ""
        known = falsified is not None and math.isfinite(falsified)  # the package's own tubes are not searched again
        return f"{proven}{way}" + (f"; the falsifier found no less than {margin_text(falsified)} 1/s" if known else "")

    def _reached(self, wanted: float) -> str:
        """Whether a margin that was asked for is there; then half-widths of I and of the funnel's start."""
        if (self.margin_certified or 0.0) < wanted:
            return f"objective.margin: {wanted:g} 1/s was not reached; this is the largest margin that was found"
        vehicle, widths = self.problem.vehicle, self.segments[0].funnel.half_widths()
        inlet = _by_state(vehicle, [rounded_down(written(axis)) for axis in self.problem.inlet.half_axes[:1]])
        widths_text = _by_state(vehicle, [rounded_up(float(width), 3) for width in widths])
        return f"inlet {inlet}; funnel's half-widths {widths_text}"

    def _absorbed(self, robustness: Robustness) -> list[tuple[str, str]]:
        alone, vehicle = robustness.alone, self.problem.vehicle
        law = ", under the law that is told the speed alone" if self.margin_per_metre else ""
        often = f" (control at {rounded_up(1 / alone.period, 3)} Hz or faster)" if alone.period else ""
        rates = _by_state(vehicle, [rounded_down(rate, 2) for rate in alone.disturbance], vehicle.rate_units)
        return [
            *_looks_ahead(robustness.sampled),
            ("absorbs", f"one of the following{law}"),
            ("control period", f"{rounded_down(alone.period, 3, MILLI)} ms{often}"),
            ("delay", f"{rounded_down(alone.delay, 3, MILLI)} ms, of all that is measured"),
            ("disturbance", f"{rates}, of one state's rate"),
        ]

    def _driven(self, loop: ClosedLoop) -> list[tuple[str, str]]:
        goal = f", {loop.missed_goal} missed G" if self.problem.goal else ""
        safe = f", {loop.left_safe} left S" if self.problem.safe or self.problem.obstacles else ""
        found = [
            (
                "cars",
                f"{loop.cars} driven: {loop.left_funnel} left the funnel{safe}{goal}; largest V "
                f"{loop.largest_value:.4g}",
            )
        ]
        if loop.arrival:
            first, last = (f"{float(f'{time:.3g}'):g}" for time in loop.arrival)
            span = first if first == last else f"{first} to {last}"  # with trajectory tracking all arrive at once
            found.append(("arrival", f"after {span} s, of these cars"))
        return found


def _looks_ahead(holds: Sampled | None) -> list[tuple[str, str]]:
    if holds is None:
        return []
    found = [("sampled control", f"{rounded_down(holds.period, 3, MILLI)} ms, by the law that looks one hold ahead")]
    if holds.delay:
        late = f"{rounded_down(holds.delay, 3, MILLI)} ms, of the pose, by prediction"
        found.append(("its delay", f"{late}; from starts in V <= {rounded_down(holds.level, 3)}"))
    return found


def _by_state(vehicle: Vehicle, values: Sequence[str], units: Sequence[str] = ()) -> str:
    """Figures of the first states, each with its name and unit; the states' own units unless given."""
    entries = zip(vehicle.state_names, values, units or vehicle.state_units, strict=False)
    return ", ".join(f"{name} {value} {unit}".rstrip() for name, value, unit in entries)
