"""Funnels along a path, one after another."""

from typing import NamedTuple

from cfjax.funnel.funnel import Funnel
from cfjax.problem import Tube


class Leg(NamedTuple):
    """A stretch of the path and the funnel there: a segment of a chain, or what is driven in one universal tube.

    θ counts along the whole path, over all its segments; a leg begins where the one before ends, the first at θ = 0.
    The funnel counts its own θ from the leg's begin.
    """

    end: float  # θ, s
    funnel: Funnel  # of the leg's duration; or of a tube: infinite, rate 0, V = xᵀCx
    margin: float  # λ, 1/s
    margin_per_metre: float = 0.0  # μ, 1/m of the reference's way; see `cfjax.control.law_numbers`
    along: Tube | None = None  # of a tube: bounds of the path, for all of which the law asks its decrease
