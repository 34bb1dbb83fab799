"""A reference: pieces one after the other, the poses between them, and the jump from the end of a lap to its start.

Poses are not stated in a file but integrated here: the heading is a rational, the position a ball.

Frames and units: θ in s, lengths in m, headings in rad; the body frame has x lateral and y forward, and at heading α
its axes are (cos α, sin α) and (−sin α, cos α).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from flint import acb, arb, fmpq, fmpq_mat

from cfcheck.exact.rational import Matrix, sqrt_upper, upper_bound
from cfcheck.path.displacement import TOO_WILD
from cfcheck.path.piece import Piece


LARGEST_POSE_GAP = fmpq(1, 10**6)  # rad and m: what rounding a pose to a file may cost, far below any car's precision
LARGEST_SPEED_GAP = fmpq(1, 10**9)  # m/s: rounding of a spline's coefficients
MOST_OF_PATH = 2**16  # stretches of all pieces together: some seconds; a thousand pieces of a fit take as many


class ExactPose(NamedTuple):
    """A pose in the inertial frame: the heading (rad) exactly, the position x + iy (m) enclosed."""

    heading: fmpq
    position: acb

    def after(self, piece: Piece) -> "ExactPose":
        """The pose where a piece ends that starts here."""
        forward = acb(0, 1) * acb(0, arb(self.heading)).exp()
        return ExactPose(self.heading + piece.turn, self.position + forward * piece.displacement)


class Gap(NamedTuple):
    """The jump of the reference from the end of a lap to its start, in the body frame of the start: upper bounds."""

    heading: fmpq  # rad, modulo 2π
    lateral: fmpq  # m
    forward: fmpq  # m
    speed: fmpq  # m/s

    def jump(self, shape: Matrix, inverse: fmpq_mat) -> fmpq:
        """By how much √V of {V = xᵀ C x ≤ 1} changes at most where the reference jumps, for deviations in there.

        The deviation gets (δ, (R(δ) − 1) p + Δp, Δv) added, and |(R(δ) − 1) p| ≤ |δ| |p|; the norm of a sum is at most
        the sum over the axes, on each of which it is √C_ii. `inverse` is C⁻¹.
        """
        # where the pose does not jump the states need not begin with one
        swing = self.heading * sqrt_upper(inverse[1, 1] + inverse[2, 2]) if self.heading else fmpq(0)
        parts = (self.heading, self.lateral + swing, self.forward + swing, self.speed)
        return sum(
            (sqrt_upper(row[i]) * part for i, (row, part) in enumerate(zip(shape, parts, strict=False))), fmpq(0)
        )


@dataclass(frozen=True, eq=False)
class Reference:
    """The path that is certified: integrated from its first start pose, its speed continuous."""

    pieces: tuple[Piece, ...]
    start: ExactPose

    @cached_property
    def duration(self) -> fmpq:
        """T over all segments, s of reference time."""
        return sum((piece.duration for piece in self.pieces), fmpq(0))

    @cached_property
    def length(self) -> fmpq:
        """Metres."""
        return self.pieces[-1].arc + self.pieces[-1].length

    @cached_property
    def piece_poses(self) -> tuple[ExactPose, ...]:
        """Where each piece starts, and where the last one ends.

        Raises:
            ValueError: for a path that is too wild to be integrated.
        """
        found = [self.start]
        effort = 0
        for piece in self.pieces:
            effort += piece.effort
            if effort > MOST_OF_PATH:
                raise ValueError(TOO_WILD)
            found.append(found[-1].after(piece))
        return tuple(found)

    @cached_property
    def poses(self) -> tuple[ExactPose, ...]:
        """Where each segment starts, and where the last one ends."""
        starts = {piece.segment: index for index, piece in reversed([*enumerate(self.pieces)])}
        return tuple(self.piece_poses[index] for index in (*sorted(starts.values()), -1))

    @cached_property
    def gap(self) -> Gap:
        """How far the end is from the start."""
        end = self.poses[-1]
        speed = abs(self.pieces[-1].end_speed - self.pieces[0].speed[0])
        moved = (end.position - self.start.position) * acb(0, -arb(self.start.heading)).exp()
        heading = heading_gap(end.heading, self.start.heading)
        return Gap(heading, upper_bound(abs(moved.real)), upper_bound(abs(moved.imag)), speed)


def heading_gap(first: fmpq, second: fmpq) -> fmpq:
    """A rational that is at least the difference of two headings (rad) modulo 2π, in absolute value."""
    turn = 2 * arb.pi()
    laps = (arb(first - second) / turn).mid() + arb(fmpq(1, 2))
    whole = laps.floor().unique_fmpz()  # any whole number is right, the nearest one gives the least
    if whole is None:
        raise ValueError("a heading is too large a number for this checker")
    return upper_bound(abs(arb(first - second) - turn * arb(whole)))


def is_closed(gap: Gap) -> bool:
    """Whether the end of a lap meets its start as well as segments have to meet."""
    return max(gap[:3]) <= LARGEST_POSE_GAP and gap.speed <= LARGEST_SPEED_GAP
