"""How far a body gets along normals while its reference drives along a part of a leg: bounds of first order, in balls.

Most obstacles near a path are farther away than a crude bound tells; what it leaves open is looked at more closely
(`cfcheck.clearance.half_plane`). On a part of length s the heading is α = α_m + δ with |δ| ≤ w. With a = n·lat(α_m) and
b = n·fwd(α_m), for |n·fwd(α)| ≤ |b| + |a| w, the place p_r of the reference goes along n at most

    n·p_r ≤ (n·p_start + n·p_end + s (|b| + |a| w))/2,

as a way that ends where it does goes there and back. A disc with offset o has its centre at p_r + x_R lat + y_R fwd +
o fwd(α + α_R), and with a', b' at α itself, A = (C⁻¹)_αα and so α_R² ≤ ρ A,

    o n·fwd(α + α_R) ≤ o b' − o a' α_R + |o b'| ρ A/2 + |o a'| (ρ A)^{3/2}/6,
    o b' ≤ o b + |o| (w |a| + w² |b|/2),    |b'| ≤ |b| + w |a|,    |a'| ≤ |a| + w |b|.

m·x with m = (−o a', a', b', 0, …) reaches √(ρ N(a', b')) with the quadratic form N(a', b') = mᵀ C⁻¹ m; its root is a
norm, and (a', b') is within w |n| of (a, b):  √N(a', b') ≤ √N(a, b) + w |n| √(trace N).

Obstacles are compared with that in whole numbers of UNIT metres, rounded so that they are larger.

Frames and units: as in `cfcheck.clearance.half_plane`.
"""

import bisect
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from flint import acb, arb, fmpq

from cfcheck.clearance.half_plane import ObstacleClaim, Shadow
from cfcheck.path.piece import Piece
from cfcheck.path.reference import ExactPose


BITS = 32
UNIT = 2**BITS  # to the metre
Normal = tuple[int, int]
Box = tuple[int, int, int, int]  # least x and y, largest x and y


def length_of(normal: Normal) -> int:
    """At least |n|, in units of the normal's own entries times 1/UNIT."""
    return math.isqrt((normal[0] ** 2 + normal[1] ** 2) << 2 * BITS) + 1


class Hull(NamedTuple):
    """An obstacle in whole numbers: corners that are at most one unit below the true ones in x and in y."""

    number: int  # among all of them
    claim: ObstacleClaim
    corners: tuple[tuple[int, int], ...]
    round: int  # at least the true one
    box: Box  # which holds all of it

    @classmethod
    def of(cls, number: int, claim: ObstacleClaim) -> "Hull":
        """The obstacle with that number, rounded."""
        corners = tuple((_below(x), _below(y)) for x, y in claim.corners)
        wide = -_below(-claim.round)
        xs, ys = [x for x, _ in corners], [y for _, y in corners]
        box = (min(xs) - wide, min(ys) - wide, max(xs) + wide + 1, max(ys) + wide + 1)
        return cls(number, claim, corners, wide, box)

    def nearest(self, normal: Normal, length: int) -> int:
        """At most n·p for all of its points p, in units; `length` as `length_of`."""
        x, y = normal
        corner = min(x * cx + y * cy for cx, cy in self.corners) + min(x, 0) + min(y, 0)
        return corner - (self.round * length >> BITS) - 1 if self.round else corner


def _below(value: fmpq) -> int:
    return int(value.p * UNIT // value.q)


def _at_least(ball: arb) -> int | None:
    """A whole number of units that is at least every number (m) in the ball; None where it is no number."""
    found = (ball * UNIT).upper().ceil().unique_fmpz()
    return None if found is None else int(found)


def _root(ball: arb) -> arb:
    """At least the root of every number in the ball, those below zero counted as zero."""
    most = ball.upper()
    return arb(0) if most <= 0 else most.sqrt()


class Nearby:
    """Obstacles by where they begin in x: which of them have a box that meets another one."""

    def __init__(self, claims: Sequence[ObstacleClaim]) -> None:
        self.hulls = sorted(itertools.starmap(Hull.of, enumerate(claims)), key=lambda hull: hull.box[0])
        self.begins = [hull.box[0] for hull in self.hulls]
        self.widest = max((hull.box[2] - hull.box[0] for hull in self.hulls), default=0)

    def candidates(self, box: Box) -> range:
        """Numbers of those that can meet the box: all that do are among them."""
        first = bisect.bisect_left(self.begins, box[0] - self.widest)
        return range(first, bisect.bisect_right(self.begins, box[2]))

    def meeting(self, box: Box) -> Iterator[Hull]:
        """Those whose box meets it."""
        left, low, right, high = box
        for index in self.candidates(box):
            hull = self.hulls[index]
            x0, y0, x1, y1 = hull.box
            if x0 <= right and x1 >= left and y0 <= high and y1 >= low:
                yield hull


@dataclass(frozen=True, eq=False)
class Sweep:
    """A part of a leg, the poses of the reference at its ends, and a disc of the body with its funnel."""

    piece: Piece
    start: ExactPose
    end: ExactPose
    shadow: Shadow

    @cached_property
    def _swing(self) -> arb:
        """w, rad."""
        least, most = self.piece.turns
        return arb((most - least) / 2)

    @cached_property
    def _facing(self) -> acb:
        """e^{i α_m}."""
        least, most = self.piece.turns
        return acb(0, arb(self.start.heading + (least + most) / 2)).exp()

    @cached_property
    def _level(self) -> fmpq:
        """A rational that ρ is at most."""
        return self.shadow.level.extent((self.piece.theta, self.piece.theta + self.piece.duration))[1]

    @cached_property
    def _form(self) -> tuple[arb, arb, arb]:
        """ρ N by its entries aa, ab and bb."""
        s, o, level = self.shadow.inverse, self.shadow.disc.offset, self._level
        aa = o * o * s[0, 0] - 2 * o * s[0, 1] + s[1, 1]
        return arb(level * aa), arb(level * (s[1, 2] - o * s[0, 2])), arb(level * s[2, 2])

    @cached_property
    def _turned(self) -> tuple[arb, arb]:
        """|o| times ρ A/2 and (ρ A)^{3/2}/6."""
        square, offset = arb(self._level * self.shadow.inverse[0, 0]), abs(self.shadow.disc.offset)
        return square / 2 * offset, square * square.sqrt() / 6 * offset

    @cached_property
    def box(self) -> Box | None:
        """What the disc stays in, in units; None where that is no number.

        The reference keeps within √(s² − c²)/2 of the chord, of length c, between its ends: it stays in an ellipse with
        these as foci.
        """
        way, start, end = arb(self.piece.way), self.start.position, self.end.position
        bulge = _root(way * way - abs(end - start) ** 2) / 2
        apart = bulge + self.shadow.around(self._level) + self.shadow.disc.radius
        x, y = (start.real, end.real), (start.imag, end.imag)
        sides = (apart - x[0].min(x[1]), apart - y[0].min(y[1]), apart + x[0].max(x[1]), apart + y[0].max(y[1]))
        found = [_at_least(side) for side in sides]
        if None in found:
            return None
        left, low, right, high = (side for side in found if side is not None)
        return -left, -low, right, high

    def reach(self, normal: Normal) -> int | None:
        """At least n·p for all points p that the disc gets to, in units; None where that is no number."""
        own = acb(*normal)
        length, facing = abs(own), own.conjugate() * self._facing
        a, b, w, o = facing.real, -facing.imag, self._swing, self.shadow.disc.offset
        across, along = abs(a), abs(b)
        moved = (own.conjugate() * (self.start.position + self.end.position)).real
        aa, ab, bb = self._form
        norm = _root(aa * a * a + 2 * ab * a * b + bb * b * b) + w * length * (aa + bb).sqrt()
        total = (moved + self.piece.way * (along + across * w)) / 2 + norm + self.shadow.disc.radius * length
        if o:
            second, third = self._turned
            total += o * b + abs(o) * w * (across + w * along / 2)
            total += second * (along + w * across) + third * (across + w * along)
        return _at_least(total)
