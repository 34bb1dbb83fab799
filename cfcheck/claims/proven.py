"""What a file shows, as data: numbers are the exact ones of its claims, and none is rounded here.

The checker makes these records when everything is replayed. How they read in English is written in
`cfcheck.statement`, and nowhere else.
"""

import enum
from dataclasses import dataclass

from flint import fmpq

from cfcheck.claims.assumptions import Assumptions
from cfcheck.claims.document import Claims, Witness
from cfcheck.claims.problem import ProblemClaim
from cfcheck.exact.rational import Range
from cfcheck.kernel.funnel import contraction_way
from cfcheck.path.bounds import Bounds, Extreme


@dataclass(frozen=True)
class Proven:
    """A control funnel function: legs and joints along a path, or one funnel for every path within bounds.

    At the end of the path V is at most `finish`.
    """

    claims: Claims
    assumptions: Assumptions | None
    finish: fmpq = fmpq(1)

    @property
    def falls(self) -> bool:
        """Whether V comes down along the path: under a law that enforces the margin per metre."""
        return any(funnel.margin_per_metre is not None for funnel in self.claims.funnels)

    @property
    def margins(self) -> tuple[fmpq, ...]:
        """λ by leg, 1/s; of one funnel where there are no legs."""
        claims = self.claims
        return tuple(claims.driven[part.funnel].margin for part in claims.parts) or (claims.driven[0].margin,)

    @property
    def arrival(self) -> Range | None:
        """Earliest and latest, s, of a closed path for a lap; None where no path is meant that lies somewhere."""
        course = self.claims.problem.course
        if isinstance(course, Bounds):
            return None
        slowest, fastest = self.claims.problem.inputs["u0"]
        return course.reference.duration / fastest, course.reference.duration / slowest

    @property
    def margin_per_metre(self) -> fmpq | None:
        """μ where every path within bounds is meant, 1/m of the reference."""
        return None if self.claims.parts else self.claims.driven[0].margin_per_metre

    @property
    def contraction(self) -> fmpq | None:
        """Metres of the reference after which V ≤ 1 has become V ≤ β_in, under inputs that reach that margin."""
        per_metre, funnel = self.margin_per_metre, self.claims.driven[0]
        if per_metre is None:
            return None
        return self.claims.problem.fastest * contraction_way(funnel.beta_lower, funnel.beta_inner) / per_metre


class Violation(enum.Enum):
    """What a witness violates."""

    INLET = enum.auto()  # (a)
    GOAL = enum.auto()  # (b)
    SAFE = enum.auto()  # (c)
    HEADING = enum.auto()  # (c), where the heading wraps
    DECREASE = enum.auto()  # (d)
    LAW = enum.auto()  # (d) under the law that is part of the question


@dataclass(frozen=True)
class Refuted:
    """A candidate that is no control funnel function with the margin that it claims, by a witness.

    `extremes` are the references at which (d) has to hold where the witness is.
    """

    claims: Claims
    witness: Witness
    violation: Violation
    extremes: tuple[Extreme, ...]
    assumptions: Assumptions | None


@dataclass(frozen=True)
class Bounded:
    """No control funnel function of the form of `cfcheck.margin.upper_bound` has margin λ = `margin` (1/s) or more."""

    problem: ProblemClaim
    assumptions: Assumptions | None
    beta_lower: fmpq
    margin: fmpq


Shown = Proven | Refuted | Bounded
