"""From a funnel to inputs: the laws that a car runs."""

from cfjax.coerce import one_of
from cfjax.control.given import Given
from cfjax.control.law import (
    Descent,
    Law,
    LawNumbers,
    any_path_numbers,
    descent_at,
    law_numbers,
    leg_numbers,
    path_point,
)
from cfjax.control.min_norm import MinNorm, nearest_in_box
from cfjax.control.query import Located, locate
from cfjax.control.sontag import LinSontag, Sontag


LAWS: dict[str, Law] = {law.name: law for law in (MinNorm(), Sontag(), LinSontag())}
"""Laws by name."""


def law_named(name: str) -> Law:
    """The law of that name; raises InputError with the list of names."""
    return LAWS[one_of("law", name, LAWS)]


__all__ = [
    "LAWS",
    "Descent",
    "Given",
    "Law",
    "LawNumbers",
    "LinSontag",
    "Located",
    "MinNorm",
    "Sontag",
    "any_path_numbers",
    "descent_at",
    "law_named",
    "law_numbers",
    "leg_numbers",
    "locate",
    "nearest_in_box",
    "path_point",
]
