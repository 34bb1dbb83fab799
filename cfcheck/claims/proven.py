"""What a file shows, as data: numbers are the exact ones of its claims, and none is rounded here.

The checker makes these records when everything is replayed. How they read in English is written in
`cfcheck.statement`, and nowhere else.
"""

import enum
from dataclasses import dataclass

from flint import arb, fmpq

from cfcheck.claims.assumptions import Assumptions
from cfcheck.claims.document import Claims, Witness
from cfcheck.claims.problem import ProblemClaim
from cfcheck.exact.definite import exact_matrix
from cfcheck.exact.rational import Matrix, Range, sqrt_upper, upper_bound
from cfcheck.path.bounds import Bounds, Extreme


def contraction_way(beta_lower: fmpq, level: fmpq) -> fmpq:
    """A rational that is at least ∫ dV / min(1, V/β̲) from the level to 1: 1 − β̲ + β̲ ln(β̲/level) below β̲."""
    if level >= beta_lower:
        return max(1 - level, fmpq(0))
    return 1 - beta_lower + beta_lower * upper_bound(arb(beta_lower / level).log())


def half_widths(shape: Matrix) -> list[fmpq]:
    """Rationals that are at least the largest |x_i| with xᵀ C x ≤ 1, in the units of the states."""
    inverse = exact_matrix(shape).inv()
    return [sqrt_upper(inverse[i, i]) for i in range(len(shape))]


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
        """λ by leg, 1/s; that of the funnel if there are no legs."""
        claims = self.claims
        return tuple(claims.driven[part.funnel].margin for part in claims.parts) or (claims.driven[0].margin,)

    @property
    def arrival(self) -> Range | None:
        """Earliest and latest, s; of a lap if the path is closed; None if the claim is about every path in bounds."""
        course = self.claims.problem.course
        if isinstance(course, Bounds):
            return None
        slowest, fastest = self.claims.problem.inputs["u0"]
        return course.reference.duration / fastest, course.reference.duration / slowest

    @property
    def margin_per_metre(self) -> fmpq | None:
        """μ, 1/m of the reference, if the claim is about every path within bounds; else None."""
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
