"""What there is to clear, and how far a body reaches, on arrays: the checker's geometry in floating point.

`reaches` is the checker's bound of first order (`cfcheck.clearance.sweep`), for all pieces of a path and all directions
of a fan at once; `Disc.reach` is how far a disc gets at single poses, without what its turn adds in higher orders.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from cfcheck.clearance.half_plane import ObstacleClaim, Shadow
from cfcheck.clearance.sweep import Normal
from cfcheck.kernel.legs import Leg
from cfcheck.path.piece import Piece
from cfcheck.path.reference import ExactPose, Reference
from cfjax.funnel.template import template_named


DIRECTIONS = 256  # of the fan
NORMAL_SCALE = 4096  # a normal's entries are whole numbers up to that
ENLARGED = 1e-3  # m: which hulls are near is told a little too generously
ROUGH = 4  # every so many directions of the fan are looked at where a rough look does


class Fan(NamedTuple):
    """Directions: the whole numbers that stand for them, and unit vectors."""

    normals: tuple[Normal, ...]
    units: Float[np.ndarray, "k 2"]
    angles: Float[np.ndarray, " k"]

    @classmethod
    def of(cls, angles: Float[np.ndarray, " k"]) -> "Fan":
        """As near to these (rad) as small whole numbers come."""
        entries = np.rint(NORMAL_SCALE * np.stack([np.cos(angles), np.sin(angles)], axis=1)).astype(int)
        entries //= np.gcd(*entries.T)[:, None]
        units = entries / np.linalg.norm(entries, axis=1, keepdims=True)
        return cls(tuple((int(x), int(y)) for x, y in entries), units, np.arctan2(units[:, 1], units[:, 0]))


FAN = Fan.of(np.linspace(-np.pi, np.pi, DIRECTIONS, endpoint=False))


@dataclass(frozen=True, eq=False)
class Hulls:
    """All that there is to clear in floating point, m."""

    claims: tuple[ObstacleClaim, ...]

    @cached_property
    def corners(self) -> Float[np.ndarray, "h c 2"]:
        """Of each hull as many as the one with the most: the last one stands again."""
        most = max(len(each.corners) for each in self.claims)
        rows = ([*each.corners, *[each.corners[-1]] * (most - len(each.corners))] for each in self.claims)
        return np.array([[[float(x), float(y)] for x, y in row] for row in rows])

    @cached_property
    def round(self) -> Float[np.ndarray, " h"]:
        return np.array([float(each.round) for each in self.claims])

    @cached_property
    def support(self) -> Float[np.ndarray, "h k"]:
        """min_c n·c − R along the directions of the fan."""
        return self.along(FAN.units)

    def along(self, units: Float[np.ndarray, "k 2"], which: Int[np.ndarray, " n"] | slice = slice(None)) -> np.ndarray:
        """The same along other directions, of some of them."""
        return (self.corners[which] @ units.T).min(axis=1) - self.round[which, None]

    @cached_property
    def _tree(self) -> shapely.STRtree:
        low, high = self.corners.min(axis=1) - self.round[:, None], self.corners.max(axis=1) + self.round[:, None]
        return shapely.STRtree(shapely.box(*low.T, *high.T))

    def near(
        self, low: Float[np.ndarray, "p 2"], high: Float[np.ndarray, "p 2"]
    ) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Pairs of a box, in order, and a hull whose own box meets it."""
        boxes, hulls = self._tree.query(shapely.box(*(low - ENLARGED).T, *(high + ENLARGED).T))
        order = np.argsort(boxes, kind="stable")
        return boxes[order], hulls[order]


class Along(NamedTuple):
    """Pieces of a path in floating point: where they begin and end, and how far they lead and turn (m, rad)."""

    start: Float[np.ndarray, "p 2"]
    end: Float[np.ndarray, "p 2"]
    way: Float[np.ndarray, " p"]
    heading: Float[np.ndarray, " p"]  # in the middle of those that it has
    swing: Float[np.ndarray, " p"]

    @classmethod
    def of(cls, pieces: Sequence[Piece], poses: Sequence[ExactPose]) -> "Along":
        """`poses` are those where pieces begin, and the last one ends."""
        places = np.array([[float(pose.position.real.mid()), float(pose.position.imag.mid())] for pose in poses])
        turns = np.array([[float(least), float(most)] for least, most in (piece.turns for piece in pieces)])
        headings = np.array([float(pose.heading) for pose in poses[: len(pieces)]])
        way = np.array([float(piece.way) for piece in pieces])
        return cls(places[:-1], places[1:], way, headings + turns.mean(axis=1), np.ptp(turns, axis=1) / 2)

    @classmethod
    def path(cls, reference: Reference) -> "Along":
        """All pieces of a path."""
        return cls.of(reference.pieces, reference.piece_poses)

    def some(self, index: slice | Int[np.ndarray, " n"] | Bool[np.ndarray, " p"]) -> "Along":
        """Some of the pieces."""
        return Along(*(each[index] for each in self))

    def apart(self) -> Float[np.ndarray, " p"]:
        """How far from the chord between its ends a piece may lead, m."""
        chord = np.linalg.norm(self.end - self.start, axis=1)
        return np.sqrt(np.maximum(self.way**2 - chord**2, 0.0)) / 2


class FunnelDisc(NamedTuple):
    """A disc of the body and its funnel's C⁻¹ in floating point."""

    radius: float
    offset: float
    spread: Float[np.ndarray, "3 3"]

    @classmethod
    def of(cls, shadow: Shadow) -> "FunnelDisc":
        spread = np.array([[float(shadow.inverse[i, j]) for j in range(3)] for i in range(3)])
        return cls(float(shadow.disc.radius), float(shadow.disc.offset), spread)

    @property
    def form(self) -> tuple[float, float, float]:
        """N by its entries aa, ab and bb (`cfcheck.clearance.sweep`)."""
        s, o = self.spread, self.offset
        return o * o * s[0, 0] - 2 * o * s[0, 1] + s[1, 1], s[1, 2] - o * s[0, 2], s[2, 2]

    def reach(
        self, poses: Float[np.ndarray, "t 3"], level: Float[np.ndarray, " t"], units: Float[np.ndarray, "k 2"]
    ) -> Float[np.ndarray, "t k"]:
        """n·p for the points p that it gets to, at poses of the reference."""
        facing = np.arctan2(units[:, 1], units[:, 0]) - poses[:, :1]
        a, b = np.cos(facing), np.sin(facing)
        aa, ab, bb = self.form
        norm = np.sqrt(level[:, None] * np.maximum((aa * a + 2 * ab * b) * a + bb * b * b, 0.0))
        return poses[:, 1:] @ units.T + self.offset * b + norm + self.radius

    def size(self, level: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        """How far its points are from the reference at most, m."""
        return np.sqrt(level * (self.spread[1, 1] + self.spread[2, 2])) + abs(self.offset) + self.radius


def reaches(
    along: Along, level: Float[np.ndarray, " p"], disc: FunnelDisc, units: Float[np.ndarray, "k 2"]
) -> Float[np.ndarray, "p k"]:
    """The checker's bound of first order: n·p for all points p that the disc gets to, along directions."""
    facing = np.arctan2(units[:, 1], units[:, 0]) - along.heading[:, None]
    a, b = np.cos(facing), np.sin(facing)
    across, along_it, w, rho = np.abs(a), np.abs(b), along.swing[:, None], level[:, None]
    aa, ab, bb = disc.form
    total = (along.start + along.end) @ units.T + along.way[:, None] * (along_it + across * w)
    norm = np.sqrt(rho * np.maximum((aa * a + 2 * ab * b) * a + bb * b * b, 0.0)) + w * np.sqrt(rho * (aa + bb))
    total = total / 2 + norm + disc.radius
    if o := disc.offset:
        square = rho * disc.spread[0, 0]
        total += o * b + abs(o) * w * (across + w * along_it / 2)
        total += abs(o) * (square / 2 * (along_it + w * across) + square**1.5 / 6 * (across + w * along_it))
    return total


class Rows(NamedTuple):
    """Pairs of a piece and a hull near it, in the order of the pieces, and which directions separate the two."""

    piece: Int[np.ndarray, " n"]
    hull: Int[np.ndarray, " n"]
    room: Float[np.ndarray, "n k"]  # m


def rows_of(hulls: Hulls, along: Along, level: Float[np.ndarray, " p"], disc: FunnelDisc, every: int = 1) -> Rows:
    """All of them that the checker may ask for, of one disc; `every` so many directions of the fan."""
    apart = (along.apart() + disc.size(level))[:, None]
    piece, hull = hulls.near(np.minimum(along.start, along.end) - apart, np.maximum(along.start, along.end) + apart)
    reach = reaches(along, level, disc, FAN.units[::every])
    return Rows(piece, hull, hulls.support[hull, ::every] - reach[piece])


def levels_of(leg: Leg) -> Float[np.ndarray, " p"]:
    """The largest ρ along each piece of a leg, for it is monotone."""
    if not leg.funnel.level.rate:
        return np.ones(leg.end - leg.begin)
    ends = np.array([[float(piece.theta), float(piece.theta + piece.duration)] for piece in leg.pieces])
    level = leg.funnel.level
    return np.asarray(template_named(level.name).level(float(level.rate), ends)).max(axis=1)
