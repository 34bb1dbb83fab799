"""Normals that prove a funnel's clearance of obstacles and walls: sought in floating point, judged by the checker.

At one θ the clearance along a unit normal n is min_c n·c − R − r − h(n), h how far the disc's centre reaches. As a
function of n it is concave and homogeneous, so that where it is positive for some direction it has one peak, which a
fan of directions finds.

The checker's bound of first order (`cfcheck.clearance.sweep`) is cheap, and serves all hulls: `reaches` is the same
formula on arrays, for all pieces of a path and all directions of the fan at once. A piece on which some direction
separates each hull by it is done; pieces that follow each other share their normals as long as these do. Where a hull
is nearer than that, the piece is looked at by samples, cut where directions have to change, and the checker looks
closely.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from flint import fmpq
from jaxtyping import Bool, Float, Int

from cfcheck.clearance.corridor import prove_between
from cfcheck.clearance.surroundings import (
    CLEARANCE_EFFORT,
    MOST_NORMALS,
    Blocked,
    Body,
    ClearanceHints,
    ClearStretch,
    SurroundingsClaim,
    shadows_of,
)
from cfcheck.clearance.sweep import Nearby, Normal
from cfcheck.exact.enclosure import Budget
from cfcheck.kernel.legs import Leg
from cfcheck.path.piece import Piece
from cfcheck.path.reference import ExactPose
from cfjax.certificate.hulls import FAN, Along, Fan, FunnelDisc, Hulls, levels_of, rows_of
from cfjax.funnel.template import template_named
from cfjax.problem.path import Pose, Profile, Segment


SHARED = 6  # normals that pieces share; a piece by itself may need more
SAFE = 1e-6  # m: a bound in floating point that the exact one confirms
SAMPLES = 17  # poses along a part that is looked at closely
NARROWINGS, NARROW_DIRECTIONS = 2, 17  # of a direction around the fan's best one: to a milliradian
SHARE = 0.5  # of the clearance that each θ has by itself: what one direction has to keep
NEARLY = 0.02  # m: clearances below that are looked at along finer directions
MOST_HALVINGS = 12  # of a piece


class NotClear(ValueError):
    """The body may touch a hull, as far as half-planes tell: at `theta` (s) of a leg; both by their numbers."""

    def __init__(self, message: str, theta: float, leg: int = 0, hull: int = 0) -> None:
        super().__init__(message)
        self.theta, self.leg, self.hull = theta, leg, hull


Known = Mapping[int, Sequence[ClearStretch]]
"""What is proven of pieces of a path, by their numbers; `end` counts from where each begins."""


def find_clearance(
    surroundings: SurroundingsClaim,
    legs: Sequence[Leg],
    hulls: Hulls | None = None,
    along: Along | None = None,
    known: Known = MappingProxyType({}),
) -> ClearanceHints:
    """Stretches with normals along every leg that `prove_surroundings` accepts; none where nothing is to be cleared.

    `hulls` and `along`, of the legs' whole path, are given by whoever has them; what is known is not proven again.

    Raises:
        NotClear: where the body may touch an obstacle or a wall.
        Broken: the path does not begin between the walls of a corridor.
        ValueError: all proofs together are more than the checker takes, or a funnel ends before its leg does.
    """
    if surroundings.is_empty:
        return ()
    hulls = Hulls(surroundings.hulls) if hulls is None else hulls
    along = Along.path(legs[0].reference) if along is None else along
    nearby, budget = Nearby(hulls.claims), Budget(CLEARANCE_EFFORT)
    found = []
    for leg in legs:
        body = Body(shadows_of(leg, surroundings.footprint), nearby, budget)
        search = SeparationSearch(leg, body, hulls)
        try:
            own = {index - leg.begin: known[index] for index in range(leg.begin, leg.end) if index in known}
            found.append(search.stretches(along.some(slice(leg.begin, leg.end)), own))
        except NotClear as failure:
            error = search.deepest() or failure
            raise NotClear(f"{surroundings.name(error.hull)}: {error}", error.theta, leg.index, error.hull) from None
    prove_between(surroundings.corridor, surroundings.footprint, legs[0].start, budget)
    return tuple(found)


@dataclass(frozen=True, eq=False)
class SeparationSearch:
    """For the stretches of one leg, each of which is proven as soon as it is found."""

    leg: Leg
    body: Body
    hulls: Hulls

    @cached_property
    def _discs(self) -> list[FunnelDisc]:
        return [FunnelDisc.of(shadow) for shadow in self.body.shadows]

    def stretches(self, along: Along, known: Known) -> tuple[ClearStretch, ...]:
        """From θ = 0 to the leg's end; `along` are its pieces, and `known` what is proven of some of them.

        Raises:
            NotClear: where none is found.
        """
        fresh = np.array([index for index in range(len(along.way)) if index not in known], int)
        level = levels_of(self.leg)[fresh]
        tables = [rows_of(self.hulls, along.some(fresh), level, disc) for disc in self._discs]
        poses = self.leg.reference.piece_poses[self.leg.begin : self.leg.end + 1]
        cuts = [np.searchsorted(rows.piece, np.arange(len(level) + 1)) for rows in tables]
        shared: list[int] | None = None  # of the stretch that may go on
        found: list[ClearStretch] = []
        for index, piece in enumerate(self.leg.pieces):
            if index in known:
                found += [ClearStretch(piece.theta + each.end, each.normals) for each in known[index]]
                shared = None
                continue
            row = int(np.searchsorted(fresh, index))
            room = [rows.room[cut[row] : cut[row + 1]] for rows, cut in zip(tables, cuts, strict=True)]
            chosen = _cover(np.concatenate(room) > SAFE, shared or [])
            start, end = poses[index : index + 2]
            normals = tuple(FAN.normals[k] for k in chosen or ())
            if chosen is None or any(self.body.left_open(piece, start, end, normals)):
                found += self._closely(piece, start, end, MOST_HALVINGS)
                shared = None
                continue
            if shared is not None and chosen[: len(shared)] == shared:
                found.pop()
            found.append(ClearStretch(piece.theta + piece.duration, normals))
            shared = chosen
        return _joined(found, {piece.theta + piece.duration for piece in self.leg.pieces})

    def _closely(self, part: Piece, start: ExactPose, end: ExactPose, halvings: int) -> list[ClearStretch]:
        """Along a part of a piece, by samples; halved where no directions serve all along it."""
        hull, normals = 0, self._directions(part, start)
        if normals is not None:
            try:
                self.body.clear(part, start, end, normals)
                return [ClearStretch(part.theta + part.duration, normals)]
            except Blocked as error:
                hull = error.hull
        if not halvings:
            theta = float(part.theta)
            raise NotClear(f"no half-plane leads on from theta = {theta:.6g} s", theta, hull=hull)
        first, second = part.halves
        middle = start.after(first)
        found = self._closely(first, start, middle, halvings - 1)
        return [*found, *self._closely(second, middle, end, halvings - 1)]

    def looks(self, part: Piece, start: ExactPose) -> "Iterator[Look]":
        """What samples along a part of a piece tell of each disc that is near something."""
        theta = np.linspace(0.0, float(part.duration), SAMPLES)
        poses, at = _segment(part, start).poses(theta), float(part.theta) + theta
        level = np.asarray(template_named(self.leg.funnel.level.name).level(float(self.leg.funnel.level.rate), at))
        for disc in self._discs:
            apart = disc.size(level)[:, None]
            low, high = (poses[:, 1:] - apart).min(axis=0), (poses[:, 1:] + apart).max(axis=0)
            _, hulls = self.hulls.near(low[None], high[None])
            if hulls.size:
                yield Look(self.hulls, disc, hulls, at, poses, level)

    def deepest(self) -> NotClear | None:
        """Where along the leg the body reaches farthest into a hull, as far as samples tell; None where it does not."""
        poses, found, least = self.leg.reference.piece_poses[self.leg.begin :], None, 0.0
        for piece, start in zip(self.leg.pieces, poses, strict=False):
            for look in self.looks(piece, start):
                if (own := look.own()).min() < least:
                    found, least = look.touch(own), float(own.min())
        return found

    def _directions(self, part: Piece, start: ExactPose) -> tuple[Normal, ...] | None:
        """Normals that separate each hull from each disc, as far as samples tell, and keep their share of clearance.

        None where there are none, or too many.

        Raises:
            NotClear: where the body touches a hull.
        """
        found: dict[Normal, None] = {}
        for look in self.looks(part, start):
            own = look.own()
            if not own.min() > 0:
                raise look.touch(own)
            least = SHARE * own.min(axis=1)
            keeps = look.room.min(axis=1) >= least[:, None]
            fine = keeps.any(axis=1)
            found |= dict.fromkeys(FAN.normals[k] for k in _cover(keeps[fine], []) or ())
            for row in np.flatnonzero(~fine).tolist():
                best, normal = look.narrowed(row, slice(None))
                if best < least[row]:
                    return None
                found[normal] = None
        return tuple(found) if len(found) <= MOST_NORMALS else None


@dataclass(frozen=True, eq=False)
class Look:
    """A disc at samples along a part of a piece, and the hulls near it."""

    all_hulls: Hulls
    disc: FunnelDisc
    hulls: Int[np.ndarray, " h"]
    theta: Float[np.ndarray, " t"]  # s, from the start of the leg
    poses: Float[np.ndarray, "t 3"]
    level: Float[np.ndarray, " t"]

    @cached_property
    def room(self) -> Float[np.ndarray, "h t k"]:
        """Clearances (m) along the directions of the fan."""
        return self.all_hulls.support[self.hulls][:, None] - self.disc.reach(self.poses, self.level, FAN.units)

    def own(self) -> Float[np.ndarray, "h t"]:
        """Those that each place has along its own best direction; small ones by finer directions."""
        own = self.room.max(axis=2)
        for row in np.flatnonzero(own.min(axis=1) < NEARLY).tolist():
            place = int(own[row].argmin())
            own[row, place] = max(own[row, place], self.narrowed(row, slice(place, place + 1))[0])
        return own

    def touch(self, own: Float[np.ndarray, "h t"]) -> NotClear:
        """What is to be said of the place with the least clearance, where there is none."""
        row, place = (int(index) for index in np.unravel_index(own.argmin(), own.shape))
        at = float(self.theta[place])
        message = f"the body may reach {-own[row, place]:.3g} m into it at theta = {at:.6g} s"
        return NotClear(message, at, hull=int(self.hulls[row]))

    def narrowed(self, row: int, places: slice) -> tuple[float, Normal]:
        """The largest clearance (m) that one direction keeps from a hull at the places, and the direction."""
        angle, width = FAN.angles[int(self.room[row, places].min(axis=0).argmax())], 2 * np.pi / len(FAN.normals)
        best, normal = -np.inf, FAN.normals[0]
        for _ in range(NARROWINGS):
            fan = Fan.of(angle + np.linspace(-width, width, NARROW_DIRECTIONS))
            reach = self.disc.reach(self.poses[places], self.level[places], fan.units)
            room = self.all_hulls.along(fan.units, self.hulls[[row]]) - reach.max(axis=0)
            k = int(room[0].argmax())
            best, normal, angle, width = float(room[0, k]), fan.normals[k], fan.angles[k], width / 8
        return best, normal


def _cover(serves: Bool[np.ndarray, "n k"], shared: Sequence[int]) -> list[int] | None:
    """Directions, those shared first, such that one of them serves each row; None where a row has none."""
    chosen, left = list(shared), ~serves[:, list(shared)].any(axis=1)
    while left.any():
        counts = serves[left].sum(axis=0)
        if not counts.any():
            return None
        best = np.flatnonzero(counts == counts.max())
        chosen.append(int(best[len(best) // 2]))
        left &= ~serves[:, chosen[-1]]
    return _cover(serves, []) if shared and len(chosen) > SHARED else chosen


def _joined(stretches: Sequence[ClearStretch], ends: Set[fmpq]) -> tuple[ClearStretch, ...]:
    """The same, those with the same normals as one where a piece ends; cuts inside a piece stay.

    What is proven of two parts of a piece need not be proven of both at once: the checker's bounds are coarser then.
    """
    joined = [
        stretch
        for stretch, after in itertools.pairwise(stretches)
        if stretch.normals != after.normals or stretch.end not in ends
    ]
    return (*joined, stretches[-1])


def _segment(part: Piece, pose: ExactPose) -> Segment:
    """The part in floating point, θ from where it starts."""
    breaks = (0.0, float(part.duration))
    turn_rate, speed = (Profile(breaks, (tuple(map(float, own)),)) for own in (part.turn_rate, part.speed))
    position = pose.position
    return Segment(turn_rate, speed, Pose(float(pose.heading), float(position.real.mid()), float(position.imag.mid())))
