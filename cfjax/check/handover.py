"""Certified tubes in turn along a reference: each holds its pieces, and hands over to the next where they end.

The first tube hands over at a level where {V₁ ≤ level} ⊂ {V₂ < 1}, the matrix inequality level C₂ ≺ C₁, and has so many
metres of reference that V₁ has fallen to it (`cfjax.check.certified`).
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

from flint import fmpq

from cfjax.check.certified import CertifiedTube
from cfjax.check.level import Contracting
from cfjax.check.rational import is_positive_definite
from cfjax.check.reference import Gap, Reference
from cfjax.check.surroundings import Span


@lru_cache(maxsize=4096)
def hands_over(first: CertifiedTube, second: CertifiedTube, level: fmpq) -> bool:
    """Whether {V₁ ≤ level} ⊂ {V₂ < 1}, and still level · V₂ < V₁: level C₂ ≺ C₁."""
    rows = zip(first.shape, second.shape, strict=True)
    return is_positive_definite([[a - level * b for a, b in zip(upper, lower, strict=True)] for upper, lower in rows])


def needed_distance(
    first: CertifiedTube, second: CertifiedTube, level: fmpq, gap: Gap | None = None
) -> tuple[fmpq, fmpq] | None:
    """The level of the first tube at which every deviation is inside the second, and metres of reference to get there.

    `level` is one with level C₂ ≺ C₁ (proven here), as large as can be. With a gap the reference jumps in between:
    V₁ ≤ level (1 − jump)² makes √V₂ < 1 − jump before, and below 1 after. None where it is not proven.
    """
    jump = gap.jump(second.shape, second.inverse) if gap else fmpq(0)
    if jump >= 1 or not level > 0 or not hands_over(first, second, level):
        return None
    # the jump is bounded for deviations inside the second tube, where they are: √V₂ < 1 − jump
    reached = min(level * (1 - jump) ** 2, fmpq(1))
    distance = first.distance_to(reached)
    return None if distance is None else (reached, distance)


class Run(NamedTuple):
    """Pieces begin, …, end − 1 in one tube."""

    begin: int
    end: int
    tube: CertifiedTube

    def span(self, reference: Reference, name: str = "the run") -> Span:
        """Its pieces as one stretch of θ from 0, in the tube as a funnel whose level stays."""
        theta, pieces = fmpq(0), []
        for piece in reference.pieces[self.begin : self.end]:
            pieces.append(replace(piece, segment=0, theta=theta))
            theta += piece.duration
        return Span(name, tuple(pieces), reference.piece_poses[self.begin], self.tube.shape, Contracting(fmpq(0)))

    def length(self, reference: Reference) -> fmpq:
        """Metres of the path."""
        last = reference.pieces[self.end - 1]
        return last.arc + last.length - reference.pieces[self.begin].arc


class ProvenLink(NamedTuple):
    """One tube hands over to the next at the start of a piece: V of the first is at most `level` after `needed` metres,
    of which it has `available`."""

    piece: int
    first: CertifiedTube
    second: CertifiedTube
    level: fmpq
    needed: fmpq
    available: fmpq


def prove_chain(
    reference: Reference, runs: Sequence[Run], levels: Sequence[fmpq], closed: bool
) -> tuple[ProvenLink, ...]:
    """Proves that deviations which start inside the first tube are inside each one along its run.

    `levels[k]` is proposed for the link after run k (`needed_distance`); a closed chain has one more than an open one,
    from the last run to the first, over the gap of the lap: it then holds for ever.

    Raises:
        ValueError: says what is not proven.
    """
    pieces = reference.pieces
    ends = [0, *(run.end for run in runs)]
    if ends[-1] != len(pieces) or any(run.begin != end or run.end <= end for run, end in zip(runs, ends, strict=False)):
        raise ValueError("the runs of a chain have to follow each other from the first piece to the last")
    cars = [(run.tube.vehicle, dict(run.tube.parameters)) for run in runs]
    if any(car != cars[0] for car in cars):
        raise ValueError("the tubes of a chain have to be certified for one vehicle")
    for run in runs:
        for piece in pieces[run.begin : run.end]:
            if not piece.inside(run.tube.bounds):
                raise ValueError(
                    f"segment {piece.segment} at theta = {float(piece.theta):.6g} s leaves tube {run.tube.name}"
                )
    followers = [*runs[1:], *([runs[0]] if closed else [])]
    if len(levels) != len(followers):
        raise ValueError(f"expected {len(followers)} levels of links, got {len(levels)}")
    links = []
    for index, (run, following, level) in enumerate(zip(runs, followers, levels, strict=False)):
        available = run.length(reference)
        around = reference.gap if index == len(runs) - 1 else None
        proven = needed_distance(run.tube, following.tube, level, around)
        if proven is None or proven[1] > available:
            raise ValueError(f"tube {run.tube.name} does not hand over to tube {following.tube.name}")
        links.append(ProvenLink(following.begin, run.tube, following.tube, *proven, available))
    return tuple(links)
