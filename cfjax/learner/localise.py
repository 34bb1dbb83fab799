"""Learning by elimination: coefficients in a box, an oracle that cuts candidates off, and the centre of what is left.

The learner of Ravanbakhsh and Sankaranarayanan (*Learning Lyapunov (potential) functions from counterexamples and
demonstrations*, RSS 2017; *Learning control Lyapunov functions from counterexamples and demonstrations*, Autonomous
Robots 2019), without a word about funnels. An oracle is asked about a candidate c; it accepts it, or names half-spaces
that every candidate wanted lies in and c does not.

**The bound.** Let P₀ be the box in r dimensions and Δ the radius of the ball of its volume (a ball that contains it,
as in the articles, has a larger one: only the volume counts). A candidate is δ-robust if the whole ball of radius δ
about it satisfies every half-space that was ever named. Each cut at or beyond the centre of the maximum-volume
ellipsoid E_k leaves at most a share s of the volume. So if after k cuts a δ-robust candidate is left,

    vol B_δ ≤ vol E_k ≤ s^k vol B_Δ,      k ≤ r ln(Δ/δ) / (−ln s).

The articles have s = 1 − 1/r, of the polytope. Of the ellipsoid s = 8/9 is proven (`cfjax.learner.centre`). From r = 9
on, as for a funnel of a car (10 coefficients, or 11), the bound of the articles is stated and enforced, for it is the
one that readers know: the proven one is the sharper of the two there (by a tenth at r = 10, by half at r = 16), so
every search keeps to it. Below r = 9 the articles' share is smaller than can be relied on (a triangle), and a search
that is ended by it would end for no reason: the proven one is taken.

The bound counts cuts: a ball of radius δ can be left after ⌊r ln(Δ/δ) / (−ln s)⌋ of them, and after one more none is.
That is the number which is stated, the expression rounded up. It speaks of cuts that exclude the centre, hence the
half-spaces of an oracle have to; of other centres, and of oracles that take back what they said, it says nothing, and
there the same number is no more than a limit.
"""

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cfjax.learner.centre import CentreError, Inscribed, Polytope, inscribed, irredundant, largest_ball, log_ball


MANY = 40  # half-spaces per dimension, from which on redundant ones are looked for
ELLIPSOID_SHARE = 8 / 9  # that a cut through its centre leaves of the largest ellipsoid's volume, at most
EXCLUDED = 1e-9  # slack that rounding may leave to a candidate that is cut off


class Undecided(Exception):
    """An oracle that can neither accept a candidate nor say what is wrong with it."""


class GivenUp(Exception):
    """An oracle that does not want to be asked any more, though candidates are left."""


class Reply(NamedTuple):
    """Half-spaces that exclude the candidate; none accepts it. `afresh`: in place of all that were named before."""

    cuts: Polytope
    afresh: bool = False


Oracle = Callable[[Float[np.ndarray, " r"]], Reply]


class Ending(enum.Enum):
    """How a search ended."""

    FOUND = "found"  # the oracle accepted the centre
    TOO_SMALL = "too small"  # no ball of radius δ satisfies all half-spaces
    LIMIT = "limit"  # as many cuts as the bound, and still room for a ball: the bound does not hold here
    GIVEN_UP = "given up"  # the oracle had enough
    SOLVER = "solver"  # no centre was found of a polytope that has one, or the oracle was undecided


class Step(NamedTuple):
    """One question: ellipsoid and largest ball of the polytope at whose centre it was asked, and what came of it."""

    log_volume: float  # of the ellipsoid
    radius: float  # of the largest ball
    half_spaces: int
    cuts: int  # half-spaces of the answer, those of earlier ones included where it begins afresh; 0: accepted


@dataclass(frozen=True)
class Localised:
    """What a search by elimination has found or shown."""

    ending: Ending
    candidate: Float[np.ndarray, " r"] | None
    polytope: Polytope  # what was left, the last cuts included
    bound: int  # on the number of cuts; with other centres than mve, or answers that take back others, only a limit
    radius: float  # of the largest ball in `polytope`; not above zero where it is empty
    history: tuple[Step, ...]

    @property
    def cuts(self) -> int:
        """How many questions were answered by cuts."""
        return sum(step.cuts > 0 for step in self.history)


def iteration_bound(dimension: int, log_volume: float, delta: float) -> int:
    """The number of cuts after which no ball of radius `delta` is left of a set of that volume.

    r ln(Δ/δ) / (−ln(1 − 1/r)), rounded up, from r = 9 on, where 8/9 in place of 1 − 1/r would give a smaller number
    that holds too; 8/9 below.
    """
    share = max(1 - 1 / dimension, ELLIPSOID_SHARE)
    return max(0, math.floor((log_volume - log_ball(dimension, delta)) / -math.log(share)) + 1)


def localise(
    lower: Float[np.ndarray, " r"],
    upper: Float[np.ndarray, " r"],
    oracle: Oracle,
    *,
    delta: float,
    centre: str = "mve",
    known: Polytope | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Localised:
    """Ask the oracle at centres until it accepts one or no ball of radius `delta` is left.

    An oracle that raises `CentreError`, `Undecided` or `GivenUp` ends the search: nothing is known about that
    candidate. `known` are half-spaces that hold from the start, beside the box. `progress` hears (cuts so far, bound).
    """
    box = Polytope.box(lower, upper)
    bound = iteration_bound(len(lower), float(np.log(upper - lower).sum()), delta)
    start = box if known is None else box.cut(known)
    polytope, history = start, []
    frame: Inscribed | None = None
    many = MANY * len(lower)

    def ended(ending: Ending, radius: float, candidate: np.ndarray | None = None) -> Localised:
        return Localised(ending, candidate, polytope, bound, radius, tuple(history))

    while True:
        try:
            _, radius = largest_ball(polytope)
        except CentreError:
            return ended(Ending.SOLVER, math.nan)
        if radius < delta:
            return ended(Ending.TOO_SMALL, radius)
        if len(history) >= bound:
            return ended(Ending.LIMIT, radius)
        frame = _centre(polytope, centre, frame)
        if frame is None:
            return ended(Ending.SOLVER, radius)
        try:
            reply = oracle(frame.centre)
        except GivenUp:
            return ended(Ending.GIVEN_UP, radius)
        except (CentreError, Undecided):
            return ended(Ending.SOLVER, radius)
        history.append(Step(frame.log_volume, radius, len(polytope), len(reply.cuts)))
        if not len(reply.cuts):
            return ended(Ending.FOUND, radius, frame.centre)
        if not reply.afresh and reply.cuts.slack(frame.centre).min() > EXCLUDED:
            raise ValueError("oracle: expected a half-space that excludes the candidate, or none at all")
        polytope = (start if reply.afresh else polytope).cut(reply.cuts)
        if len(polytope) > many:
            polytope = irredundant(polytope)
            many = max(many, 2 * len(polytope))
        if progress:
            progress(len(history), bound)


def _centre(polytope: Polytope, kind: str, frame: Inscribed | None) -> Inscribed | None:
    """In the frame of the last ellipsoid, or in that of the largest ball where the solver fails there."""
    for start in (frame, None):
        try:
            return inscribed(polytope, kind, start)
        except CentreError:
            continue
    return None
