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

    @property
    def profiles(self) -> tuple[Interval, ...]:
        """What the dynamics see of it."""
        return self.curvature, self.speed, self.acceleration

    @property
    def last_theta(self) -> float:
        """All θ are alike, so what is looked at at the end of a funnel is looked at at θ = 0."""
        return 0.0

    @property
    def top_speed(self) -> float:
        """m/s."""
        return self.speed.upper

    @property
    def has_mirror_images(self) -> bool:
        """Whether with each path its mirror image is meant too: V is then its own mirror image."""
        return self.curvature.middle == 0

    def middle(self) -> ReferencePoint:
        """The reference that stands for all of them: in the middle of the bounds, of no path in particular."""
        kappa, v, a = self.curvature.middle, self.speed.middle, self.acceleration.middle
        return ReferencePoint(kappa * v, v, kappa * a, a)

    def samples(self, count: int) -> list[ReferencePoint]:
        """References to look at: the extreme ones, however many places of a segment would be."""
        return [point for group in self.references() for point in group]

    def references(self) -> list[list[ReferencePoint]]:
        """The extreme references: a group for each pair of ends of curvature and acceleration, in it the ends of speed.

        The worst reference of the tube is one of these: at a fixed input V̇ is affine in speed, and curvature and
        acceleration enter as u0 (κ v_r g(x) + a h(x)), so that the input that is good at the worst pair of ends serves
        all between (`cfcheck.vehicle.structure` proves this on the vehicle's graph).
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
