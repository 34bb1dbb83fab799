"""Which pairs of states a funnel is shown over, wherever its shadows are drawn; and these shadows."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cfjax.report.style import EDGE_COLOUR, GOAL_COLOUR, INLET_COLOUR, ellipse_outline
from cfjax.report.terms import short_label, state_label
from cfjax.result import Result


HEADING, LATERAL, LONGITUDINAL, POSE = 0, 1, 2, 3  # states of every vehicle come in this order; then its own

ROOMY = 3  # panels, of which each has room for a long label


def shown_pairs(states: int) -> tuple[tuple[int, int], ...]:
    """Pairs of different states, so many panels: place, heading, and each state beside the pose with the way ahead."""
    beside = range(POSE, states) if states > POSE else (HEADING,)
    return (LATERAL, LONGITUDINAL), (LATERAL, HEADING), *((LONGITUDINAL, state) for state in beside)


@dataclass(frozen=True)
class Shadow:
    """An outline over a pair of states; `role` says of what."""

    role: str  # V = 1, goal G or inlet I
    colour: str
    outline: Float[np.ndarray, "2 96"]


@dataclass(frozen=True)
class Section:
    """A panel: what its axes are called, and shadows, the largest set first."""

    labels: tuple[str, str]
    shadows: tuple[Shadow, ...]


def sections_of(result: Result) -> Iterator[Section]:
    """Of the first funnel at θ = 0, with G and I."""
    problem = result.problem
    names = problem.vehicle.state_names
    spreads = [("V = 1", EDGE_COLOUR, np.linalg.inv(result.segments[0].funnel.shape))]
    for role, colour, ellipsoid in (("goal G", GOAL_COLOUR, problem.goal), ("inlet I", INLET_COLOUR, problem.inlet)):
        if ellipsoid:
            spreads.append((role, colour, np.diag(np.square(ellipsoid.half_axes))))
    pairs = shown_pairs(len(names))
    called = state_label if len(pairs) <= ROOMY else short_label
    for pair in pairs:
        shadows = (
            Shadow(role, colour, ellipse_outline(spread[np.ix_(pair, pair)])) for role, colour, spread in spreads
        )
        yield Section((called(names[pair[0]]), called(names[pair[1]])), tuple(shadows))
