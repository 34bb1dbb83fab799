"""A way as its curvature, linear in arc length on each piece: lines, arcs and clothoids.

Places are complex numbers x + iy in m, directions of motion in rad from +x, curvatures in 1/m, positive to the left.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from cfjax.planner.dubins import Arcs
from cfjax.problem import Path, Pose, Profile, Segment
from cfjax.problem.frames import QUARTER


_nodes, _weights = np.polynomial.legendre.leggauss(6)
NODES, WEIGHTS = 0.5 * (1 + _nodes), 0.5 * _weights  # on [0, 1]


@dataclass(frozen=True, eq=False)
class Bends:
    """Pieces from a pose on: lengths (m), and the curvature at both ends of each."""

    place: complex
    direction: float
    length: Float[np.ndarray, " pieces"]
    begin: Float[np.ndarray, " pieces"]
    end: Float[np.ndarray, " pieces"]

    @classmethod
    def along(cls, arcs: Arcs, start: tuple[complex, float], longest: float) -> "Bends":
        """Arcs, in pieces of at most so many m."""
        parts = [max(1, math.ceil(length / longest)) for _, length in arcs]
        lengths = np.repeat([length / count for (_, length), count in zip(arcs, parts, strict=True)], parts)
        curvature = np.repeat([curvature for curvature, _ in arcs], parts)
        return cls(*start, lengths, curvature, curvature)

    @cached_property
    def ends(self) -> list[tuple[complex, float]]:
        """Places and directions at the start and at the end of each piece."""
        places, directions = self.poses()
        return list(zip(places.tolist(), directions.tolist(), strict=True))

    def some(self, pieces: int) -> "Bends":
        """So many pieces from the start on."""
        return Bends(self.place, self.direction, self.length[:pieces], self.begin[:pieces], self.end[:pieces])

    def then(self, other: "Bends") -> "Bends":
        """This one and then another one, which begins where it ends."""
        joined = (
            np.concatenate([getattr(each, name) for each in (self, other)]) for name in ("length", "begin", "end")
        )
        return Bends(self.place, self.direction, *joined)

    @property
    def sharpest(self) -> float:
        """1/m."""
        return float(max(np.abs(self.begin).max(), np.abs(self.end).max()))

    @property
    def arc(self) -> Float[np.ndarray, " ends"]:
        """m from the start to the ends of pieces, with the start."""
        return np.concatenate([[0.0], np.cumsum(self.length)])

    @property
    def turned(self) -> Float[np.ndarray, " ends"]:
        """Directions at the ends of pieces."""
        return self.direction + np.concatenate([[0.0], np.cumsum(self.length * (self.begin + self.end) / 2)])

    def poses(self, count: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Places and directions at the start and at `count` places of each piece, its end the last."""
        share = np.arange(1, count + 1) / count
        inner = self.length[:, None, None] * share[:, None] * NODES  # pieces × places × nodes
        steps = self.length[:, None] * share * (np.exp(1j * self._directions(inner)) @ WEIGHTS)
        first = self.place + np.concatenate([[0.0], np.cumsum(steps[:, -1])])
        places = first[:-1, None] + steps
        directions = self._directions(self.length[:, None] * share)
        return np.append(self.place, places.ravel()), np.append(self.direction, directions.ravel())

    def _directions(self, s: np.ndarray) -> np.ndarray:
        """At distances (m) from where each piece begins."""
        first, begin, slope = (
            values.reshape(-1, *[1] * (s.ndim - 1))
            for values in (self.turned[:-1], self.begin, (self.end - self.begin) / self.length)
        )
        return first + s * (begin + s * slope / 2)

    def path(self, name: str, speed: float, lateral: float, acceleration: float) -> Path:
        """The path at most at a speed (m/s), with at most so much lateral and forward acceleration (m/s²).

        On each piece the energy v²/2 is linear in arc length, so that the acceleration is constant and ω_r a cubic.
        """
        sharpest = np.maximum(np.abs(self.begin), np.abs(self.end))
        sharpest = np.maximum(np.append(sharpest, 0), np.insert(sharpest, 0, 0))
        energy = np.minimum(speed**2, lateral / np.maximum(sharpest, lateral / speed**2)) / 2
        ramp = acceleration * self.arc
        energy = np.minimum.accumulate(energy - ramp) + ramp
        v = np.sqrt(2 * (np.minimum.accumulate((energy + ramp)[::-1])[::-1] - ramp))
        first, last, bend, slope = v[:-1], v[1:], self.begin, (self.end - self.begin) / self.length
        duration = 2 * self.length / (first + last)
        a = (last - first) / duration
        turning = [bend * first, bend * a + slope * first**2, 1.5 * slope * first * a, slope * a**2 / 2]
        breaks = np.concatenate([[0.0], np.cumsum(duration)])
        segment = Segment(
            Profile(breaks, np.stack(turning, axis=1)),
            Profile(breaks, np.stack([first, a], axis=1)),
            Pose(self.direction - QUARTER, self.place.real, self.place.imag),
        )
        return Path(name, (segment,))
