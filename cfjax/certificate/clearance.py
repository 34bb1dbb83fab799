"""Half-planes that prove a funnel's clearance from an obstacle: sought in floating point, judged by the checker.

At one θ the clearance along a unit normal n is min_c n·c − R − r − h(n), h how far the disc's centre reaches. As a
function of n it is concave and homogeneous, and so is its least value over a stretch of θ: where it is positive for
some direction it has one peak, which a fan of directions finds.

A half-plane holds as long as it keeps a share of the clearance that each θ has by itself: then the proof is short, and
so are the numbers of its normal.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from flint import fmpq
from jaxtyping import Float

from cfjax.check.clearance import (
    STRETCH_EFFORT,
    HalfPlane,
    ObstacleClaim,
    Shadow,
    prove_half_plane,
)
from cfjax.check.enclosure import Budget
from cfjax.check.legs import Leg
from cfjax.check.piece import Piece, between
from cfjax.check.reference import ExactPose
from cfjax.check.surroundings import Clearance, Surroundings, prove_surroundings
from cfjax.funnel.template import template_named
from cfjax.problem.path import Pose, Profile, Segment


SAMPLES = 65  # poses along a stretch; a touch between them is the checker's to see
DIRECTIONS = 128  # of the fan, which is narrowed around its best one: to a milliradian
NARROWINGS, NARROW_DIRECTIONS = 2, 17
AT_ONCE = 4096  # poses whose clearances are looked at together: some MB
SHARE = 0.5  # of the clearance: what a half-plane has to keep
BISECTIONS = 4  # of the length at which its share is spent
END_BITS = 5  # of that length as it is written down
NORMAL_SCALE = 4096  # a normal's entries are whole numbers up to that
SHORTEST = 2.0**-14  # of the segment's duration: where no half-plane holds for longer there is no clearance
LARGEST_EFFORT = 2**9 * STRETCH_EFFORT  # of one half-plane's proof: a longer one is better cut


class NotClear(ValueError):
    """The body may touch an obstacle, as far as half-planes tell: at `theta` (s) of a leg; both by their numbers."""

    def __init__(self, message: str, theta: float, leg: int = 0, obstacle: int = 0) -> None:
        super().__init__(message)
        self.theta, self.leg, self.obstacle = theta, leg, obstacle

    def at(self, leg: int, obstacle: int) -> "NotClear":
        """The same, said of that leg and obstacle."""
        return NotClear(f"obstacle {obstacle}: {self}", self.theta, leg, obstacle)


def find_clearance(surroundings: Surroundings, legs: Sequence[Leg]) -> Clearance:
    """Half-planes along every leg that `prove_surroundings` accepts; none where there are no obstacles.

    Raises:
        NotClear: where the body may touch an obstacle.
        Broken: all proofs together are more than the checker takes.
    """
    obstacles, footprint = surroundings
    if not obstacles:
        return ()
    found = []
    for index, leg in enumerate(legs):
        along = samples_along(leg.pieces, leg.start)
        shadows = [Shadow(leg.funnel.shape, leg.funnel.level, disc) for disc in footprint]
        by_obstacle = []
        for number, obstacle in enumerate(obstacles):
            try:
                planes = [find_half_planes(leg.pieces, leg.start, each, obstacle, along) for each in shadows]
            except NotClear as error:
                raise error.at(index, number) from None
            by_obstacle.append(tuple(map(tuple, planes)))
        found.append(tuple(by_obstacle))
    prove_surroundings(surroundings, legs, tuple(found))
    return tuple(found)


def find_half_planes(
    pieces: Sequence[Piece],
    start: ExactPose,
    shadow: Shadow,
    obstacle: ObstacleClaim,
    along: "Samples | None" = None,
) -> list[HalfPlane]:
    """Half-planes along one segment, few and long, each of them proven; arguments as of `prove_clearance`.

    `along` are samples of the segment, where the caller has them.

    Raises:
        NotClear: where the body may touch the obstacle.
        ValueError: for what is no claim at all: a funnel that ends before the segment does.
    """
    duration = sum((piece.duration for piece in pieces), fmpq(0))
    shadow.check_end(duration)
    along = samples_along(pieces, start) if along is None else along
    own = least_clearances(along, shadow, obstacle)
    worst = int(np.argmin(own))
    if not own[worst] > 0:  # cheaper than to come there by half-planes
        at = float(along.theta[worst])
        raise NotClear(f"the body may reach {-own[worst]:.3g} m into the obstacle at theta = {at:.6g} s", at)
    planes: list[HalfPlane] = []
    begin, pose = fmpq(0), start
    while begin < duration:
        plane, pose = _longest(pieces, pose, along, shadow, obstacle, begin, duration)
        planes.append(plane)
        begin = plane.end
    return planes


class Samples(NamedTuple):
    """Places of a segment: θ (s) from its start, and the reference's poses there."""

    theta: Float[np.ndarray, " t"]
    poses: Float[np.ndarray, "t 3"]

    def between(self, begin: float, end: float) -> "Samples":
        """As many places of a stretch as there are of a piece, by interpolation."""
        theta = np.linspace(begin, end, SAMPLES)
        return Samples(theta, np.stack([np.interp(theta, self.theta, each) for each in self.poses.T], axis=1))

    def level(self, shadow: Shadow) -> Float[np.ndarray, " t"]:
        """ρ there."""
        return np.asarray(template_named(shadow.level.name).level(float(shadow.level.rate), self.theta))


def samples_along(pieces: Sequence[Piece], pose: ExactPose, samples: int = SAMPLES) -> Samples:
    """So many places of each piece, both ends among them."""
    ends = np.array([float(piece.theta) for piece in pieces] + [float(pieces[-1].theta + pieces[-1].duration)])
    theta = np.linspace(ends[:-1], ends[1:], samples, axis=1).ravel()
    return Samples(theta, _segment(pieces, pose).poses(theta - ends[0]))


def least_clearances(along: Samples, shadow: Shadow, obstacle: ObstacleClaim) -> Float[np.ndarray, " t"]:
    """The clearance (m) of a disc of the body at each place, along its own best direction; less where it is far."""
    level = along.level(shadow)
    corners = np.array([[float(x), float(y)] for x, y in obstacle.corners])
    middle = corners.mean(axis=0)
    spread = np.array([[float(shadow.inverse[i, j]) for j in (1, 2)] for i in (1, 2)])
    around = np.linalg.norm(corners - middle, axis=1).max() + float(obstacle.round) + float(shadow.disc.radius)
    reach = np.sqrt(level * np.linalg.eigvalsh(spread)[-1]) + abs(float(shadow.disc.offset))
    found = np.linalg.norm(along.poses[:, 1:] - middle, axis=1) - around - reach
    fan = np.linspace(-np.pi, np.pi, DIRECTIONS, endpoint=False)
    near = np.flatnonzero(found <= 0)
    for some in np.split(near, range(AT_ONCE, len(near), AT_ONCE)):
        found[some] = _clearances(fan, along.poses[some], level[some], shadow, obstacle).max(axis=0)
    return found


def _longest(
    pieces: Sequence[Piece],
    pose: ExactPose,
    along: Samples,
    shadow: Shadow,
    obstacle: ObstacleClaim,
    begin: fmpq,
    duration: fmpq,
) -> tuple[HalfPlane, ExactPose]:
    """A half-plane from θ = begin that is proven, nearly as long as can be, and the pose where it ends."""
    reason = "they would hold for ever shorter stretches"
    for end, angle in _candidates(along, shadow, obstacle, begin, duration):
        plane, stretch = HalfPlane(end, _short(angle)), between(pieces, begin, end)
        try:
            return plane, prove_half_plane(stretch, pose, shadow, obstacle, plane.normal, Budget(LARGEST_EFFORT))
        except ValueError as error:  # a touch between samples, or more effort than for a shorter one
            reason = str(error)
    raise NotClear(f"no half-plane leads on from theta = {float(begin):.6g} s: {reason}", float(begin))


def _candidates(
    along: Samples, shadow: Shadow, obstacle: ObstacleClaim, begin: fmpq, duration: fmpq
) -> Iterator[tuple[fmpq, float]]:
    """Ends up to which a direction keeps its share of the clearance: the farthest one first, then by half as far."""

    def seen(length: float) -> tuple[fmpq, float] | None:
        end = _end(begin, length, duration)
        own, shared, angle = _view(along.between(float(begin), float(end)), shadow, obstacle)
        return (end, angle) if own > 0 and shared >= SHARE * own else None

    whole = length = float(duration - begin)
    shortest = min(SHORTEST * float(duration), whole)
    while (found := seen(length)) is None:
        length /= 2
        if length < shortest:
            return
    if length < whole:  # twice as far the share is spent
        step = length
        for _ in range(BISECTIONS):
            step /= 2
            if farther := seen(length + step):
                length, found = length + step, farther
    yield found
    while (length := length / 2) >= shortest:
        if found := seen(length):
            yield found


def _end(begin: fmpq, length: float, duration: fmpq) -> fmpq:
    """A short rational at about begin + length, after begin; the segment's duration where that is reached."""
    if not begin + fmpq(*length.as_integer_ratio()) < duration - fmpq(*(SHORTEST * length).as_integer_ratio()):
        return duration
    bits = END_BITS - math.floor(math.log2(length))
    return fmpq(math.floor(math.ldexp(float(begin) + length, bits))) * fmpq(2) ** -bits


def _short(angle: float) -> tuple[fmpq, fmpq]:
    """A direction in small whole numbers."""
    entries = [round(NORMAL_SCALE * part) for part in (math.cos(angle), math.sin(angle))]
    divisor = math.gcd(*entries)
    return fmpq(entries[0] // divisor), fmpq(entries[1] // divisor)


def _view(along: Samples, shadow: Shadow, obstacle: ObstacleClaim) -> tuple[float, float, float]:
    """Clearances (m) that samples of a stretch tell, without the higher orders of the body's turn.

    The least over θ of what each θ has along its own best direction; the least along the one direction that is best for
    all; and that direction (rad).
    """
    level = along.level(shadow)
    fan = np.linspace(-np.pi, np.pi, DIRECTIONS, endpoint=False)
    table = _clearances(fan, along.poses, level, shadow, obstacle)
    own = table.max(axis=0).min()
    for _ in range(NARROWINGS):
        width = fan[1] - fan[0]
        fan = fan[np.argmax(table.min(axis=1))] + np.linspace(-width, width, NARROW_DIRECTIONS)
        table = _clearances(fan, along.poses, level, shadow, obstacle)
    shared = table.min(axis=1)
    best = int(np.argmax(shared))
    return float(own), float(shared[best]), float(fan[best])


def _clearances(
    angles: Float[np.ndarray, " k"],
    poses: Float[np.ndarray, "t 3"],
    level: Float[np.ndarray, " t"],
    shadow: Shadow,
    obstacle: ObstacleClaim,
) -> Float[np.ndarray, "k t"]:
    """Clearances (m) along directions at reference poses, of the letters in `cfjax.check.clearance`."""
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    corners = np.array([[float(x), float(y)] for x, y in obstacle.corners])
    near = (normals @ corners.T).min(axis=1) - float(obstacle.round) - float(shadow.disc.radius)
    facing = angles[:, None] - poses[None, :, 0]
    a, b = np.cos(facing), np.sin(facing)
    offset = float(shadow.disc.offset)
    spread = np.array([[float(shadow.inverse[i, j]) for j in range(3)] for i in range(3)])
    m = np.stack([-offset * a, a, b])
    reach = normals @ poses[:, 1:].T + offset * b + np.sqrt(level * np.einsum("ikt,ij,jkt->kt", m, spread, m))
    return near[:, None] - reach


def _segment(stretch: Sequence[Piece], pose: ExactPose) -> Segment:
    """The stretch in floating point, θ from where it starts."""
    begin, last = stretch[0].theta, stretch[-1]
    ends = (*(piece.theta for piece in stretch), last.theta + last.duration)
    breaks = tuple(float(end - begin) for end in ends)
    turn_rate, speed = (
        Profile(breaks, tuple(tuple(map(float, coefficients)) for coefficients in profile))
        for profile in ([piece.turn_rate for piece in stretch], [piece.speed for piece in stretch])
    )
    position = pose.position
    return Segment(turn_rate, speed, Pose(float(pose.heading), float(position.real.mid()), float(position.imag.mid())))
