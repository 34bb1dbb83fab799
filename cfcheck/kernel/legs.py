"""Legs and joints: funnels in turn along a path, each of which leads into the next one.

A leg is a part of a path with the funnel that holds there. Its θ counts from where it begins. At its end V is at most
what the funnel's margin per metre makes of 1 (`FunnelClaim.level_after`), and at most 1 where it has none. A joint says
that from there a car is in the next funnel. With q₂ < q₁/ratio, the matrix inequality C₁ ≻ ratio C₂, and a reference
that jumps by so little that √V₂ changes by at most J,

    √V₂ < √(q₁/ratio) + J        at the start of the next leg, where q₁ is at most that of V₁ at the end of the leg.

A closed path has a joint from its last leg to the first one, over the gap that integration leaves: it holds for ever.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from flint import fmpq

from cfcheck.exact.definite import exact_matrix, is_positive_definite
from cfcheck.exact.rational import Matrix, Range
from cfcheck.kernel.funnel import FunnelClaim
from cfcheck.path.piece import Piece
from cfcheck.path.reference import ExactPose, Gap, Reference, is_closed
from cfcheck.reader import Broken


@dataclass(frozen=True, eq=False)
class Leg:
    """Pieces begin, …, end − 1 of a path, and the funnel along them; `index` is that of the leg in its path."""

    reference: Reference
    begin: int
    end: int
    funnel: FunnelClaim
    index: int = 0

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """Its part of the path, θ from 0 (s)."""
        return from_zero(self.reference.pieces[self.begin : self.end])

    @property
    def start(self) -> ExactPose:
        """The reference's pose where it begins."""
        return self.reference.piece_poses[self.begin]

    @property
    def duration(self) -> fmpq:
        """T, s."""
        return self.pieces[-1].theta + self.pieces[-1].duration

    @property
    def length(self) -> fmpq:
        """Metres."""
        last = self.reference.pieces[self.end - 1]
        return last.arc + last.length - self.reference.pieces[self.begin].arc

    def end_level(self, fastest: fmpq) -> fmpq:
        """A rational that V is at most at its end, where u0 ≤ `fastest`."""
        return self.funnel.level_after(self.length, fastest)

    def end_form(self, level: fmpq) -> Range:
        """Rationals below and above the q of V = level at its end."""
        return self.funnel.level.form_bounds(level, self.duration)


@dataclass(frozen=True)
class Joint:
    """Where one leg leads into another one: the reference jumps by `gap`, and q₂ < q₁/ratio."""

    before: Leg
    after: Leg
    gap: Gap
    ratio: fmpq

    @property
    def name(self) -> str:
        """Which joint is spoken of."""
        return f"joint, from leg {self.before.index} to leg {self.after.index}"

    @cached_property
    def jump(self) -> fmpq:
        """J: how much √V of the next funnel changes at most where the reference jumps."""
        return self.gap.jump(self.after.funnel.shape, self.after.funnel.inverse)

    def is_entered(self, level: fmpq, root: fmpq = fmpq(1)) -> bool:
        """Whether V₁ ≤ level at the end makes √V₂ < root at the start, C₁ ≻ ratio C₂ being proven."""
        room = root - self.jump
        return room > 0 and self.before.end_form(level)[1] <= self.ratio * room**2


def from_zero(pieces: Sequence[Piece]) -> tuple[Piece, ...]:
    """Pieces that follow each other, with θ counted from where the first of them begins."""
    theta, found = fmpq(0), []
    for piece in pieces:
        found.append(piece if piece.theta == theta else replace(piece, theta=theta))
        theta += piece.duration
    return tuple(found)


def different(legs: Sequence[Leg]) -> list[Leg]:
    """Those among them that the dynamics can tell apart."""
    found: dict[tuple, Leg] = {}
    for leg in legs:
        found.setdefault(tuple((piece.duration, piece.turn_rate, piece.speed) for piece in leg.pieces), leg)
    return list(found.values())


def is_wider(first: Matrix, second: Matrix, ratio: fmpq) -> bool:
    """Whether C₁ ≻ ratio C₂, so that q₂ < q₁/ratio wherever q₁ > 0."""
    return is_positive_definite(exact_matrix(first) - ratio * exact_matrix(second))


def gaps(legs: Sequence[Leg], closed: bool) -> Iterator[tuple[Leg, Leg, Gap]]:
    """Legs that follow each other, and how the reference jumps between them: in speed, after a lap by its gap."""
    zero = fmpq(0)
    for before, after in itertools.pairwise(legs):
        jump = abs(before.pieces[-1].end_speed - after.pieces[0].speed[0])
        yield before, after, Gap(zero, zero, zero, jump)
    if closed:
        yield legs[-1], legs[0], legs[0].reference.gap


def joints_of(legs: Sequence[Leg], closed: bool, ratios: Sequence[fmpq]) -> tuple[Joint, ...]:
    """As they are claimed."""
    return tuple(Joint(*meeting, ratio) for meeting, ratio in zip(gaps(legs, closed), ratios, strict=True))


def prove_joints(legs: Sequence[Leg], closed: bool, ratios: Sequence[fmpq], fastest: fmpq) -> tuple[Joint, ...]:
    """Proves that deviations which start inside the first funnel are inside each one along its leg; u0 ≤ `fastest`.

    Raises:
        Broken: says what is not proven.
    """
    if closed and not is_closed(legs[0].reference.gap):
        raise Broken("path: the end of the lap is not its start")
    joints = joints_of(legs, closed, ratios)
    proven: set[tuple[int, int, fmpq]] = set()
    for joint in joints:
        first, second = joint.before.funnel, joint.after.funnel
        key = id(first), id(second), joint.ratio
        if key not in proven and not is_wider(first.shape, second.shape, joint.ratio):
            raise Broken(f"{joint.name}: the next funnel is not as wide as is claimed")
        proven.add(key)
        if joint.jump >= 1:
            raise Broken(f"{joint.name}: the reference jumps by more than the next funnel is wide")
        if not joint.is_entered(joint.before.end_level(fastest)):
            raise Broken(f"{joint.name}: the end of the funnel does not lie inside the start of the next")
    return joints
