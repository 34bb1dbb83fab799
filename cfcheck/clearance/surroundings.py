"""What the body has to clear, as a file says it, and the proof along every leg of a path.

All of it are hulls: the corners of an obstacle, grown by a radius, or two points of a wall that follow each other. A
leg is cut into stretches of θ, each with a few normals. On every part of a piece that lies in a stretch, each disc of
the body and each hull near it, one of the normals separates the two: by a bound of first order on how far the disc gets
(`cfcheck.clearance.sweep`), which serves all hulls, or by a close look (`cfcheck.clearance.half_plane`).
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from flint import fmpq

from cfcheck.clearance.half_plane import FootprintClaim, ObstacleClaim, Shadow, prove_half_plane
from cfcheck.clearance.sweep import BITS, Hull, Nearby, Normal, Sweep, length_of
from cfcheck.exact.enclosure import Budget, TooLarge
from cfcheck.exact.rational import about, bits, decimal_text
from cfcheck.kernel.legs import Leg
from cfcheck.path.piece import Piece
from cfcheck.path.reference import ExactPose
from cfcheck.reader import Broken, Item, Unreadable


MOST_OBSTACLES, MOST_CORNERS, MOST_DISCS = 4096, 32, 8
MOST_POINTS = 2**15  # of one wall, and of all walls together
MOST_STRETCHES, MOST_NORMALS = 2**14, 16  # of one leg, of one stretch
LARGEST_NORMAL = 2**20
LONGEST_NUMBER = 2**11  # bits of what clearance is proven from
CLEARANCE_EFFORT = 2**23  # of all half-planes of a file: half a minute at most
DISC_EFFORT = 4  # of a disc on a part, before anything is near
REACH_EFFORT = 2  # of a bound of first order; looking at 64 obstacles costs as much


class WallClaim(NamedTuple):
    """A polyline (m) through two points or more."""

    points: tuple[tuple[fmpq, fmpq], ...]


class SurroundingsClaim(NamedTuple):
    """Obstacles and walls, and the discs of the vehicle's body; none of them where nothing is to be cleared."""

    obstacles: tuple[ObstacleClaim, ...] = ()
    footprint: tuple[FootprintClaim, ...] = ()
    walls: tuple[WallClaim, ...] = ()

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to clear."""
        return not (self.obstacles or self.walls)

    @property
    def hulls(self) -> tuple[ObstacleClaim, ...]:
        """All that there is to clear, obstacles first."""
        between = (pair for wall in self.walls for pair in itertools.pairwise(wall.points))
        return (*self.obstacles, *(ObstacleClaim(pair, fmpq(0)) for pair in between))

    def name(self, hull: int) -> str:
        """What is meant by one of the hulls, by its number."""
        if hull < len(self.obstacles):
            return f"obstacle {hull}"
        hull -= len(self.obstacles)
        for index, wall in enumerate(self.walls):
            if hull < len(wall.points) - 1:
                x, y = wall.points[hull]
                return f"wall {index} at ({decimal_text(x)}, {decimal_text(y)}) m"
            hull -= len(wall.points) - 1
        raise ValueError(f"expected the number of a hull, got {hull} too many")


class ClearStretch(NamedTuple):
    """Directions from the vehicle to what is beside it, in whole numbers, that serve until θ = `end` (s) of a leg."""

    end: fmpq
    normals: tuple[Normal, ...]


ClearanceHints = tuple[tuple[ClearStretch, ...], ...]  # by leg


class Blocked(ValueError):
    """What is not proven, of the hull with that number."""

    def __init__(self, message: str, hull: int) -> None:
        super().__init__(message)
        self.hull = hull


class Body(NamedTuple):
    """Discs with the funnel that holds, hulls that may be near, and what a proof that they stay apart may take."""

    shadows: tuple[Shadow, ...]
    nearby: Nearby
    budget: Budget

    def clear(self, piece: Piece, start: ExactPose, end: ExactPose, normals: Sequence[Normal]) -> None:
        """Proves that no disc touches a hull while the reference is on this part of a piece, from `start` to `end`.

        Raises:
            Blocked: which hull no normal separates from a disc, as far as bounds tell.
        """
        for shadow, left in zip(self.shadows, self.left_open(piece, start, end, normals), strict=True):
            for normal, hulls in left.items():
                self.budget.spend(sum(len(hull.corners) for hull in hulls))
                try:
                    prove_half_plane(piece, start, shadow, [hull.claim for hull in hulls], normal, self.budget)
                except TooLarge:
                    raise
                except ValueError as error:
                    length = length_of(normal)
                    worst = min(hulls, key=lambda hull: hull.nearest(normal, length))
                    raise Blocked(str(error), worst.number) from None

    def left_open(
        self, piece: Piece, start: ExactPose, end: ExactPose, normals: Sequence[Normal]
    ) -> list[dict[Normal, list[Hull]]]:
        """For each disc the hulls that bounds of first order do not tell apart from it, by the normal that is nearest.

        Raises:
            Blocked: a hull is near, and no normal is stated.
        """
        lengths = {normal: length_of(normal) for normal in normals}
        numbers = (*piece.turn_rate, *piece.speed)
        squares = len(piece.turn_rate) ** 2 + len(piece.speed) ** 2
        self.budget.spend(squares * _longer(max(map(bits, numbers))))
        self.budget.spend(sum(DISC_EFFORT * _longer(shadow.longest) for shadow in self.shadows))
        return [self._left_open(Sweep(piece, start, end, shadow), lengths) for shadow in self.shadows]

    def _left_open(self, sweep: Sweep, lengths: Mapping[Normal, int]) -> dict[Normal, list[Hull]]:
        """Hulls that bounds of first order do not tell apart from the disc, by the normal that comes closest to it."""
        found: dict[Normal, list[Hull]] = {}
        reaches: dict[Normal, int | None] = {}
        box = sweep.box
        if box is None:
            raise Broken("the place of the reference is not known")
        self.budget.spend(len(self.nearby.candidates(box)) // 64)
        for hull in self.nearby.meeting(box):
            room: dict[Normal, int] = {}
            for normal, length in lengths.items():
                self.budget.spend(len(hull.corners))
                if normal not in reaches:
                    self.budget.spend(REACH_EFFORT)
                    reaches[normal] = sweep.reach(normal)
                if (reach := reaches[normal]) is None:
                    continue
                room[normal] = (hull.nearest(normal, length) - reach << BITS) // length
                if room[normal] > 0:
                    break
            else:
                if not room:
                    theta = decimal_text(sweep.piece.theta)
                    raise Blocked(f"clearance is not proven at theta = {theta} s: no half-plane is stated", hull.number)
                found.setdefault(max(room, key=room.__getitem__), []).append(hull)
        return found


def prove_surroundings(surroundings: SurroundingsClaim, legs: Sequence[Leg], clearance: ClearanceHints) -> None:
    """Proves that no disc of the body touches a hull at any θ of a leg, wherever in its funnel the vehicle is.

    Raises:
        Broken: says what is not proven.
    """
    if not surroundings.footprint:
        raise Broken("condition (c): there are obstacles, and no footprint that could clear them")
    _check_numbers(surroundings, legs)
    nearby, budget = Nearby(surroundings.hulls), Budget(CLEARANCE_EFFORT)
    known: dict[int, tuple[Shadow, ...]] = {}  # by funnel: many legs may have one
    for leg, stretches in zip(legs, clearance, strict=True):
        try:
            if id(leg.funnel) not in known:
                known[id(leg.funnel)] = shadows_of(leg, surroundings.footprint)
                budget.spend(sum(shadow.longest for shadow in known[id(leg.funnel)]))
            shadows = known[id(leg.funnel)]
            _require_until_end(shadows, leg)
            body = Body(shadows, nearby, budget)
            poses = leg.reference.piece_poses[leg.begin : leg.end + 1]
            prove_clear(body, leg.pieces, poses, stretches)
        except Blocked as error:
            raise Broken(f"condition (c), leg {leg.index}, {surroundings.name(error.hull)}: {error}") from None
        except ValueError as error:
            raise Broken(f"condition (c), leg {leg.index}: {error}") from None


def _longer(size: int) -> int:
    """How many times as much work numbers of so many bits are."""
    return 1 + size // 512


def shadows_of(leg: Leg, footprint: Sequence[FootprintClaim]) -> tuple[Shadow, ...]:
    """Each disc of the body, wherever in the leg's funnel the vehicle is.

    Raises:
        ValueError: the funnel is none, or empty before the leg ends.
    """
    shadows = tuple(Shadow(leg.funnel.shape, leg.funnel.level, disc) for disc in footprint)
    _require_until_end(shadows, leg)
    return shadows


def _require_until_end(shadows: Sequence[Shadow], leg: Leg) -> None:
    for shadow in shadows if leg.funnel.level.rate else ():  # else the funnel stays as it is
        shadow.check_end(leg.duration)


def prove_clear(
    body: Body, pieces: Sequence[Piece], poses: Sequence[ExactPose], stretches: Sequence[ClearStretch]
) -> None:
    """Proves that the body is clear all along the pieces of a leg, θ from 0; `poses` are those at their ends.

    The first stretch begins at θ = 0, each of the others where the one before ended; the last one ends with the leg.

    Raises:
        Blocked: where it is not proven.
        ValueError: says what is not as it has to be.
    """
    duration = pieces[-1].theta + pieces[-1].duration
    ends = [fmpq(0), *(stretch.end for stretch in stretches)]
    if ends[-1] != duration or not all(begin < end for begin, end in itertools.pairwise(ends)):
        raise ValueError(f"clearance: expected stretches whose ends increase up to {about(duration)} s")
    index = 0
    for piece, start, end in zip(pieces, poses, poses[1:], strict=False):
        for part, first, last in parts_of(piece, start, end, ends[index + 1 :]):
            body.clear(part, first, last, stretches[index].normals)
            index += part.theta + part.duration == stretches[index].end


def parts_of(
    piece: Piece, start: ExactPose, end: ExactPose, ends: Sequence[fmpq]
) -> Iterator[tuple[Piece, ExactPose, ExactPose]]:
    """The piece, cut at those of the increasing ends (s) that lie inside it, with the poses of each part."""
    until = piece.theta + piece.duration
    inner = [at - piece.theta for at in itertools.takewhile(lambda at: at < until, ends)]
    if not inner:
        yield piece, start, end
        return
    *firsts, last = piece.split(inner)
    for part in firsts:
        after = start.after(part)
        yield part, start, after
        start = after
    yield last, start, end


def _check_numbers(surroundings: SurroundingsClaim, legs: Sequence[Leg]) -> None:
    """Raises Broken for numbers that are too long to compute with."""

    def numbers() -> Iterator[fmpq]:
        for points in (
            *(each.corners for each in surroundings.obstacles),
            *(wall.points for wall in surroundings.walls),
        ):
            yield from itertools.chain.from_iterable(points)
        yield from (obstacle.round for obstacle in surroundings.obstacles)
        for disc in surroundings.footprint:
            yield from (disc.radius, disc.offset)
        for leg in legs:
            yield from (leg.start.heading, leg.funnel.level.rate)
            yield from itertools.chain.from_iterable(leg.funnel.shape)
            for piece in leg.pieces:
                yield from (piece.theta, piece.duration, *piece.turn_rate, *piece.speed)

    if any(bits(number) > LONGEST_NUMBER for number in numbers()):
        raise Broken(f"clearance: expected numbers of at most {LONGEST_NUMBER} bits")


# --- reading


def read_surroundings(obstacles: Item, footprint: Item) -> SurroundingsClaim:
    """From two lists.

    Raises:
        Unreadable: says what was expected where.
    """
    hulls, walls = [], []
    for item in obstacles.items(MOST_OBSTACLES, least=0):
        if isinstance(item.value, dict) and "wall" in item.value:
            walls.append(WallClaim(_points(item.record("wall")[0], MOST_POINTS, 2)))
        else:
            corners, rounding = item.record("corners", "round")
            hulls.append(ObstacleClaim(_points(corners, MOST_CORNERS, 1), rounding.rational()))
    if sum(len(wall.points) for wall in walls) > MOST_POINTS:
        obstacles.refuse(f"walls with at most {MOST_POINTS} points together")
    return SurroundingsClaim(tuple(hulls), tuple(map(_disc, footprint.items(MOST_DISCS, least=0))), tuple(walls))


def _points(item: Item, most: int, least: int) -> tuple[tuple[fmpq, fmpq], ...]:
    pairs = (point.items(2, 2) for point in item.items(most, least))
    return tuple((x.rational(), y.rational()) for x, y in pairs)


def _disc(item: Item) -> FootprintClaim:
    radius, offset = item.record("radius", "offset")
    return FootprintClaim(radius.rational(), offset.rational())


def read_clearance(item: Item, surroundings: SurroundingsClaim, legs: int) -> ClearanceHints:
    """Stretches for so many legs; an empty list where there is nothing to clear.

    Raises:
        Unreadable: says what was expected where.
    """
    if surroundings.is_empty:
        item.items(0, 0)
        return ()
    return tuple(tuple(map(_stretch, leg.items(MOST_STRETCHES))) for leg in item.items(legs, legs))


def _stretch(item: Item) -> ClearStretch:
    if isinstance(item.value, list):
        raise Unreadable(
            f"{item.where}: half-planes stand by obstacle, as an earlier release wrote them: make it again"
        )
    end, normals = item.record("end", "normals")
    found = [normal.integers(2, -LARGEST_NORMAL, LARGEST_NORMAL) for normal in normals.items(MOST_NORMALS, least=0)]
    if (0, 0) in found or len(set(found)) < len(found):
        normals.refuse("normals that are not zero, each once")
    return ClearStretch(end.rational(), tuple((x, y) for x, y in found))
