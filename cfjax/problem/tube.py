"""Tubes: a reference that is a set of paths.

In the body frame a path enters the dynamics only through its curvature κ = ω_r/v_r, its speed v_r and v_r' = dv_r/dθ. A
tube leaves them free in intervals: what holds for it holds for every path, of any length, whose pose and heading are
continuous and whose curvature (which may jump), speed and acceleration stay inside.
"""

import itertools
import math
from dataclasses import dataclass

from cfjax.coerce import Numbers, keep
from cfjax.errors import InputError
from cfjax.problem.deviation import ReferencePoint
from cfjax.problem.vehicle import Interval, interval


FASTEST = 400.0  # m/s: beyond, no car has ever been, and a number is in mm/s


@dataclass(frozen=True)
class Tube:
    """All stretches of path within bounds: curvature in 1/m, speed in m/s, acceleration dv_r/dθ in m/s².

    Raises:
        InputError: for what is no interval, and where a path could stand still or run backwards.
    """

    curvature: Interval
    speed: Interval
    acceleration: Interval

    def __init__(
        self,
        curvature: Interval | Numbers,
        speed: Interval | Numbers,
        acceleration: Interval | Numbers = Interval(0.0, 0.0),
    ) -> None:
        keep(
            self,
            curvature=interval("path.curvature", curvature, "1/m"),
            speed=interval("path.speed", speed, "m/s"),
            acceleration=interval("path.acceleration", acceleration, "m/s²"),
        )
        if self.speed.lower <= 0:
            raise InputError(f"path.speed: expected an interval above zero, got {self.speed}")
        if self.speed.upper > FASTEST:
            raise InputError(f"path.speed: expected m/s, at most {FASTEST:g}, got {self.speed}")

    @property
    def duration(self) -> float:
        """A tube has no end."""
        return math.inf

    @property
    def is_steady(self) -> bool:
        """Nothing depends on θ: every θ sees the same set."""
        return True

    def references(self) -> list[list[ReferencePoint]]:
        """The extreme references: a group for each pair of ends of curvature and acceleration, in it the ends of speed.

        The worst reference of the tube is one of these: at a fixed input V̇ is affine in speed, and curvature and
        acceleration enter as u0 (κ v_r g(x) + a h(x)), so that the input that is good at the worst pair of ends serves
        all between (`cfjax.check.structure` proves this on the vehicle's graph).
        """
        return [
            [ReferencePoint(kappa * v, v, 0.0, a) for v in _ends(self.speed)]
            for kappa, a in itertools.product(_ends(self.curvature), _ends(self.acceleration))
        ]

    def nominal(self) -> list[ReferencePoint]:
        """For each group the reference at which the signs of the inputs' authorities are read: the fastest."""
        return [group[-1] for group in self.references()]


def _ends(interval: Interval) -> list[float]:
    return sorted({interval.lower, interval.upper})
