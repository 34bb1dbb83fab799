"""What a funnel is wanted for."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cfjax.coerce import instance, keep, number, one_of
from cfjax.errors import InputError
from cfjax.funnel.funnel import Funnel
from cfjax.problem import Problem


KINDS = ("margin", "width", "inlet")
LATERAL = 1
"""Index of the state x, the lateral deviation."""


@dataclass(frozen=True)
class Objective:
    """`margin`: the largest λ; `width`: the smallest lateral half-width, `inlet`: the largest I, at λ ≥ `margin` (1/s).

    The sets asked for always hold; `inlet` scales I up and keeps its shape.

    Args:
        kind: "margin", "width" or "inlet".
        margin: λ that width and inlet need, 1/s; None for the largest.

    Raises:
        InputError: for another kind, a margin that is not positive, and none where one is needed.
    """

    kind: str = "margin"
    margin: float | None = None

    def __post_init__(self) -> None:
        one_of("objective", self.kind, KINDS)
        if self.kind != "margin":
            if self.margin is None:
                raise InputError(
                    f"objective.margin: expected a positive number (1/s) with objective={self.kind}, got None"
                )
            keep(self, margin=number("objective.margin", self.margin, "1/s", above=0))
        elif self.margin is not None:
            raise InputError("objective.margin: expected none with objective=margin, which seeks the largest")

    def rank(self, problem: Problem, funnels: Sequence[Funnel], margin: float) -> tuple[float, ...]:
        """Larger is better: for funnels of the problem with that least certified margin (1/s, 0 for none)."""
        if self.margin is None or margin < self.margin:
            return 0.0, margin
        width = max(map(lateral_half_width, funnels))
        return 1.0, -width if self.kind == "width" else problem.inlet.half_axes[0]


def lateral_half_width(funnel: Funnel) -> float:
    """Largest lateral deviation in the funnel at any θ, m."""
    instance("funnel", funnel, Funnel)
    return math.sqrt(max(1.0, funnel.end_level)) * float(funnel.half_widths()[LATERAL])
