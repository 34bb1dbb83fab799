"""The legs of a path as arrays, for whoever drives it: one car or thousands, here or in C."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float

from cfjax.coerce import instances, objects
from cfjax.control.law import LawNumbers, leg_numbers
from cfjax.errors import InputError
from cfjax.funnel import Leg, Template
from cfjax.problem import Problem


MEETS = 1e-9  # relative to the path's duration: what rounding may leave between an end and what it should meet


@dataclass(frozen=True)
class LegArrays:
    """Legs along a path, one after another; every array has a leading axis of legs. θ counts along the whole path."""

    template: Template
    begin: Float[np.ndarray, " l"]  # θ, s: from where each funnel counts its own
    end: Float[np.ndarray, " l"]  # θ, s; the last one is exactly the path's end
    numbers: LawNumbers

    def of(self, leg: int) -> LawNumbers:
        """What is asked of a law in that leg."""
        return jax.tree.map(lambda values: values[leg], self.numbers)


def leg_arrays(problem: Problem, legs: Sequence[Leg]) -> LegArrays:
    """The legs (`Result.legs`) as arrays.

    Raises:
        InputError: for a tube, which has no course; where the legs do not lead along the path from its start to its
            end, or their funnels have several templates or another number of states.
    """
    objects(problem=(problem, Problem))
    legs = instances("legs", legs, Leg)
    duration = float(np.cumsum([segment.duration for segment in problem.path.require_course()])[-1])
    ends = [0.0, *(float(leg.end) for leg in legs)]
    shortest = min((b - a for a, b in itertools.pairwise(ends)), default=0.0)
    if not shortest > MEETS * duration or not abs(ends[-1] - duration) <= MEETS * duration:
        raise InputError(
            f"legs: expected increasing ends, the last at theta = {duration:g} s where the path ends, got {ends[1:]}"
        )
    for index, (leg, begin) in enumerate(zip(legs, ends[:-1], strict=True)):
        own = leg.funnel.duration
        if np.isfinite(own) and not abs(own - (leg.end - begin)) <= MEETS * duration:
            raise InputError(f"legs: expected a funnel of {leg.end - begin:g} s for leg {index}, got one of {own:g} s")
        if leg.funnel.dimension != problem.dimension:
            raise InputError(f"legs: expected {problem.dimension} states, got {leg.funnel.dimension} in leg {index}")
    # at rate 0 every template is V = xᵀCx, so a tube's goes with any
    templates = {leg.funnel.template.name: leg.funnel.template for leg in legs if leg.funnel.rate}
    if len(templates) > 1:
        raise InputError(f"legs: expected funnels of one template, got {' and '.join(sorted(templates))}")
    return LegArrays(
        template=next(iter(templates.values()), legs[0].funnel.template),
        begin=np.array(ends[:-1]),
        end=np.array([*ends[1:-1], duration]),
        numbers=jax.tree.map(lambda *values: np.stack(values), *(leg_numbers(problem, leg) for leg in legs)),
    )
