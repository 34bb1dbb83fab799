"""What a file shows, as data: numbers are the exact ones of its claims, and none is rounded here.

The checker makes these records when everything is replayed. How they read in English is written in
`cfjax.check.statement`, and nowhere else.
"""

import enum
from dataclasses import dataclass

from flint import fmpq

from cfjax.check.bounds import Bounds, Extreme
from cfjax.check.chain import ChainClaim
from cfjax.check.decrease import contraction_way
from cfjax.check.document import Course, FunnelClaim, ProblemClaim, VehicleClaim, Witness
from cfjax.check.handover import Run
from cfjax.check.meaning import Assumptions


@dataclass(frozen=True)
class ProvenFunnels:
    """A control funnel function along a path: a funnel for each kind of its segments."""

    problem: ProblemClaim
    course: Course
    funnels: tuple[FunnelClaim, ...]
    assumptions: Assumptions | None

    @property
    def margins(self) -> tuple[fmpq, ...]:
        """λ by segment, 1/s."""
        return tuple(self.funnels[kind].margin for kind in self.course.kinds)

    @property
    def arrival(self) -> tuple[fmpq, fmpq]:
        """Earliest and latest, s."""
        slowest, fastest = self.problem.inputs["u0"]
        return self.course.reference.duration / fastest, self.course.reference.duration / slowest


@dataclass(frozen=True)
class ProvenTube:
    """One control funnel function along every path within bounds; `margin_per_metre` in 1/m of the reference."""

    problem: ProblemClaim
    bounds: Bounds
    funnel: FunnelClaim
    margin_per_metre: fmpq
    assumptions: Assumptions | None

    @property
    def margins(self) -> tuple[fmpq, ...]:
        """λ, 1/s."""
        return (self.funnel.margin,)

    @property
    def contraction(self) -> fmpq:
        """Metres of the reference after which V ≤ 1 has become V ≤ β_in, under inputs that reach the margin."""
        way = contraction_way(self.funnel.beta_lower, self.funnel.beta_inner)
        return self.problem.inputs["u0"][1] * way / self.margin_per_metre


@dataclass(frozen=True)
class ProvenChain:
    """A path with the tubes that hold along it in turn; `vehicle` is the path's own, V is at most `finish` at the end.

    Tubes are in the units of the path.
    """

    claim: ChainClaim
    vehicle: VehicleClaim
    assumptions: Assumptions | None
    runs: tuple[Run, ...]
    links: int
    finish: fmpq

    @property
    def margins(self) -> tuple[fmpq, ...]:
        """λ by run, 1/s."""
        return tuple(run.tube.margin for run in self.runs)

    @property
    def arrival(self) -> tuple[fmpq, fmpq]:
        """Earliest and latest, s; of a closed path, of a lap."""
        earliest = latest = fmpq(0)
        for run in self.runs:
            slowest, fastest = run.tube.timing
            for piece in self.claim.reference.pieces[run.begin : run.end]:
                earliest, latest = earliest + piece.duration / fastest, latest + piece.duration / slowest
        return earliest, latest


class Violation(enum.Enum):
    """What a witness violates."""

    INLET = enum.auto()  # (a)
    GOAL = enum.auto()  # (b)
    SAFE = enum.auto()  # (c)
    HEADING = enum.auto()  # (c), where the heading wraps
    DECREASE = enum.auto()  # (d)


@dataclass(frozen=True)
class Refuted:
    """A candidate that is no control funnel function with the margin that it claims, by a witness.

    `extremes` are the references for which (d) is asked where the witness is.
    """

    problem: ProblemClaim
    funnels: tuple[FunnelClaim, ...]
    witness: Witness
    violation: Violation
    extremes: tuple[Extreme, ...]
    assumptions: Assumptions | None


Shown = ProvenFunnels | ProvenTube | ProvenChain | Refuted
