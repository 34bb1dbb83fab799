"""What a funnel is wanted for."""

from dataclasses import dataclass

from cfjax.coerce import keep, number, one_of
from cfjax.errors import InputError


KINDS = ("margin", "width", "inlet")


@dataclass(frozen=True)
class Objective:
    """`margin`: the largest λ; `width`: the smallest lateral half-width, `inlet`: the largest I, at λ ≥ `margin` (1/s).

    The sets asked for always hold; `inlet` scales I up and keeps its shape.

    Args:
        kind: "margin", "width" or "inlet".
        margin: 1/s, λ that the narrowest funnel or the largest I has to have; None with "margin".

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
