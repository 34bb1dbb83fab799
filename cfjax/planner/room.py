"""What a path has to keep so that tubes hold it: curvature, acceleration, speed, and the room that their shadows need.

The *shadow* of a tube is what the origin of a car, or the centre of a disc of its body, reaches around the reference.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cfcheck.exact.rational import Range
from cfjax.errors import InputError
from cfjax.planner.search import BodyDiscs
from cfjax.problem import FootprintDisc
from cfjax.tubes import CertifiedTube


BEND = 0.995  # of the tubes' bound of curvature, which a path may have
ACCELERATION = 0.98  # of their bound of acceleration


class PlanLimits(NamedTuple):
    """What a path keeps: 1/m, m/s, m/s² to the side and ahead; and the body that it is planned with."""

    curvature: float
    speed: float
    lateral: float
    acceleration: float
    body: BodyDiscs


def limits_of(
    tubes: Sequence[CertifiedTube], speed: float, lateral: float, footprint: Sequence[FootprintDisc]
) -> PlanLimits:
    """The tightest bends that tubes hold at all speeds up to the one asked for, and the narrowest tubes that do.

    Raises:
        InputError: where no tubes hold that speed, and the slower ones in bends.
    """
    narrowest = {tube.bounds: tube for tube in sorted(tubes, key=_width, reverse=True)}
    for tightest in sorted({_bend(tube) for tube in tubes}, reverse=True):
        able = [tube for tube in narrowest.values() if _bend(tube) >= tightest]
        slowest = min(_speeds(tube)[0] for tube in able)
        curvature = BEND * min(tightest, lateral / slowest**2)
        in_bends = min(speed, math.sqrt(lateral / curvature))
        used = [tube for tube in able if _speeds(tube)[0] <= speed and in_bends <= _speeds(tube)[1]]
        if used and slowest <= in_bends and speed <= max(_speeds(tube)[1] for tube in used):
            ahead = ACCELERATION * min(_least(tube.bounds.acceleration) for tube in used)
            needs = [disc.radius + max(shadow(tube, disc) for tube in used) for disc in footprint]
            body = BodyDiscs(np.array([disc.offset for disc in footprint], float), np.array(needs))
            return PlanLimits(curvature, speed, lateral, ahead, body)
    low, high = min(_speeds(tube)[0] for tube in tubes), max(_speeds(tube)[1] for tube in tubes)
    raise InputError(f"speed: expected {low:.4g} to {high:.4g} m/s, which the tubes hold, got {speed:g}")


def shadow(tube: CertifiedTube, disc: FootprintDisc) -> float:
    """How far (m) the centre of the body's disc gets from its place on the reference, wherever in the tube the car is.

    The centre is off by (x_R − o sin α_R, y_R − o (1 − cos α_R)) across and along, o the offset.
    """
    inverse = np.array([[float(tube.inverse[i, j]) for j in range(3)] for i in range(3)])
    reach = np.array([[-disc.offset, 1, 0], [0, 0, 1]])
    return math.sqrt(np.linalg.eigvalsh(reach @ inverse @ reach.T)[-1]) + abs(disc.offset) * inverse[0, 0] / 2


def _bend(tube: CertifiedTube) -> float:
    return _least(tube.bounds.curvature)


def _speeds(tube: CertifiedTube) -> tuple[float, float]:
    low, high = tube.bounds.speed
    return float(low), float(high)


def _least(interval: Range) -> float:
    """How far an interval reaches to either side of 0."""
    low, high = interval
    return float(min(-low, high))


def _width(tube: CertifiedTube) -> float:
    return shadow(tube, FootprintDisc(0.0, 0.0))
