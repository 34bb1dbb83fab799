"""Bounds: a set of references. One of them, a stretch of a path, or every path within limits.

In the body frame a path enters the dynamics only through its curvature κ = ω_r/v_r, its speed v_r, the acceleration
a = dv_r/dθ and, where the states of a reference go with the curvature, its rate κ' = dκ/dθ. Bounds are intervals of
these. `cfcheck.vehicle.structure` shows, on the vehicle's graph, why it is enough to prove their extreme references.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

from flint import fmpq

from cfcheck.exact.rational import Range


MOST_EXTREMES = 16  # references of a stretch: ends of curvature and its rate, speed, acceleration


class Extreme(NamedTuple):
    """A reference `profile` for which (d) has to be proven; `nominal` is the one at which its cells' signs are read."""

    nominal: Mapping[str, fmpq]
    profile: Mapping[str, fmpq]


@dataclass(frozen=True)
class Bounds:
    """All references within closed intervals of curvature (1/m), speed (m/s), acceleration dv_r/dθ (m/s²).

    With an interval of the curvature's rate dκ/dθ, 1/(m s), they are those of paths whose curvature does not jump, and
    changes within it; without one the curvature may jump.
    """

    curvature: Range
    speed: Range
    acceleration: Range
    curvature_rate: Range | None = None

    @property
    def intervals(self) -> dict[str, Range]:
        """The intervals by name; that of the curvature's rate only if there is one."""
        named = {"curvature": self.curvature, "speed": self.speed, "acceleration": self.acceleration}
        return named if self.curvature_rate is None else named | {"curvature_rate": self.curvature_rate}

    @property
    def is_single(self) -> bool:
        """Whether they contain a single reference."""
        flat = all(lower == upper for lower, upper in (self.curvature, self.speed, self.acceleration))
        return flat and self.curvature_rate in (None, (0, 0))

    def lies_in(self, other: "Bounds") -> bool:
        """Whether all of these references are among the other one's."""
        own = self.intervals
        return all(
            name in own and lower <= own[name][0] and own[name][1] <= upper
            for name, (lower, upper) in other.intervals.items()
        )

    def scaled(self, length: fmpq, speed: fmpq) -> "Bounds":
        """The bounds of the similar paths: lengths and speeds multiplied by these."""
        factors = {
            "curvature": 1 / length,
            "speed": speed,
            "acceleration": speed**2 / length,
            "curvature_rate": speed / length**2,
        }
        return Bounds(
            **{name: (low * factors[name], high * factors[name]) for name, (low, high) in self.intervals.items()}
        )

    def extremes(self, mirrored: bool = False) -> list[Extreme]:
        """References that suffice for all: by curvature, then acceleration, then speed, lower ends first.

        The two speeds of one curvature and acceleration have one nominal reference, and so one sign pattern and vertex:
        the vertex that is best at the highest speed. (At lower ones acceleration may call for another u0, but thrust
        then has room to make up for it, where at the highest speed a wrong u0 would cost most.)

        With bounds of the curvature's rate they are the vertices of the box, and signs, and with them the one input of
        all, are read in its middle; mirror images are of no use there.
        """
        if self.curvature_rate is not None:
            box = self.curvature, self.speed, self.acceleration, self.curvature_rate
            middle = _profile(*((lower + upper) / 2 for lower, upper in box))
            return [Extreme(middle, _profile(*vertex)) for vertex in product(*map(_ends, box))]
        curvatures = [self.curvature[1]] if mirrored else _ends(self.curvature)
        return [
            Extreme(_profile(kappa, self.speed[1], a), _profile(kappa, v, a))
            for kappa, a, v in product(curvatures, _ends(self.acceleration), _ends(self.speed))
        ]


def _profile(kappa: fmpq, v: fmpq, a: fmpq, kappa_rate: fmpq | None = None) -> dict[str, fmpq]:
    """A reference's inputs to the dynamics; these must not depend on the slope ω' if the curvature may jump."""
    slope = fmpq(0) if kappa_rate is None else kappa_rate * v + kappa * a
    return {"turn_rate": kappa * v, "speed": v, "turn_rate_slope": slope, "speed_slope": a}


def _ends(interval: Range) -> list[fmpq]:
    return sorted(set(interval))
