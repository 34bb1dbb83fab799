"""Tubes beside obstacles: which of them, and where along the path, leave the body room."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from cfcheck.clearance.surroundings import Body, ClearanceHints, SurroundingsClaim, shadows_of
from cfcheck.clearance.sweep import Nearby
from cfcheck.exact.enclosure import Budget
from cfcheck.path.reference import Reference
from cfjax.certificate.clearance import SAFE, NotClear, SeparationSearch, find_clearance
from cfjax.certificate.hulls import FAN, ROUGH, Along, FunnelDisc, Hulls, levels_of, rows_of
from cfjax.tubes.certified import CertifiedTube, TubeLeg
from cfjax.tubes.violation import InTheWay


SURELY = 0.02  # m: so far into a hull no direction of the fan misses a clearance

Holds = Bool[np.ndarray, "tubes pieces"]
Chain = list[tuple[int, int, int]]  # first piece, piece after the last, tube


def choose_clear(
    reference: Reference,
    tubes: Sequence[CertifiedTube],
    holds: Holds,
    surroundings: SurroundingsClaim,
    choose: Callable[[Holds], Chain],
) -> tuple[Chain, ClearanceHints]:
    """A chain in whose tubes the body is clear of its surroundings, with half-planes that prove it.

    `choose` finds the best chain among the places that are left to each tube. Where half-planes are not found the place
    is taken away, and it chooses again.

    Raises:
        InTheWay: which obstacle is in the way, and where.
    """
    hulls, along = Hulls(surroundings.hulls), Along.path(reference)
    places = _Places(reference, surroundings, hulls, along, holds.copy())
    for index in np.flatnonzero(holds.any(axis=1)).tolist():
        places.leave_out(index, tubes[index])
    places.require_way()
    while True:
        try:
            chain = choose(places.holds)
        except ValueError as error:
            raise InTheWay(f"{error}{places.beside()}") from None
        legs = [
            TubeLeg(begin, end, tubes[index]).leg(reference, number) for number, (begin, end, index) in enumerate(chain)
        ]
        try:
            return chain, find_clearance(surroundings, legs, hulls, along)
        except NotClear as error:
            begin, _, tube = chain[error.leg]
            begins = [float(piece.theta) for piece in legs[error.leg].pieces]
            places.take(tube, begin + int(np.searchsorted(begins, error.theta, side="right")) - 1, error.hull, 0.0)
            places.require_way()


@dataclass(eq=False)
class _Places:
    """Where tubes hold the path and leave the body room; `holds` loses the places where they do not."""

    reference: Reference
    surroundings: SurroundingsClaim
    hulls: Hulls
    along: Along
    holds: Holds
    # the hull that was in the way and by how much (m), by piece: of the tube for which that is least
    taken: dict[int, tuple[float, int]] = field(default_factory=dict)

    def take(self, tube: int, piece: int, hull: int, excess: float) -> None:
        """A tube is of no use on a piece, for the body may reach a hull, or more than that by `excess` m."""
        self.holds[tube, piece] = False
        self.taken[piece] = min(self.taken.get(piece, (np.inf, hull)), (excess, hull))

    def leave_out(self, index: int, tube: CertifiedTube) -> None:
        """Places at which the body may touch something, as far as bounds of first order and samples tell."""
        reference = self.reference
        leg = TubeLeg(0, len(reference.pieces), tube).leg(reference)
        shadows = shadows_of(leg, self.surroundings.footprint)
        search = SeparationSearch(leg, Body(shadows, Nearby(()), Budget()), self.hulls)
        level = levels_of(leg)
        for disc in map(FunnelDisc.of, shadows):
            own = np.flatnonzero(self.holds[index])
            rows = rows_of(self.hulls, self.along.some(own), level[own], disc, ROUGH)
            doubtful = rows.room.max(axis=1) <= SAFE
            pieces, hulls = own[rows.piece[doubtful]], rows.hull[doubtful]
            at, which = np.unique(pieces, return_inverse=True)
            starts = np.column_stack([self._headings[at], self.along.start[at]])
            room = (self.hulls.support[hulls] - disc.reach(starts, level[at], FAN.units)[which]).max(axis=1)
            for row in np.flatnonzero(room < -SURELY).tolist():
                self.take(index, int(pieces[row]), int(hulls[row]), float(-room[row]))
            for piece in dict.fromkeys(pieces[self.holds[index, pieces]].tolist()):
                for look in search.looks(reference.pieces[piece], reference.piece_poses[piece]):
                    least = look.own().min(axis=1)
                    if not least.min() > 0:
                        self.take(index, piece, int(look.hulls[least.argmin()]), float(-least.min()))

    @cached_property
    def _headings(self) -> Float[np.ndarray, " p"]:
        return np.array([float(pose.heading) for pose in self.reference.piece_poses[:-1]])

    def beside(self) -> str:
        """Where a chain may be missing because of what is beside the path."""
        last = next(reversed(self.taken.values()), None)
        return f", where {self.surroundings.name(last[1])} leaves room" if last else ""

    def require_way(self) -> None:
        """Raises InTheWay where no tube is left."""
        blocked = np.flatnonzero(~self.holds.any(axis=0))
        if not blocked.size:
            return
        place = int(blocked[0])
        piece, (x, y) = self.reference.pieces[place], self.along.start[place]
        excess, hull = self.taken[place]
        raise InTheWay(
            f"{self.surroundings.name(hull)} is in the way: from theta = {float(piece.theta):.6g} s of segment "
            f"{piece.segment}, ({x:.4g}, {y:.4g}) m, on the body may reach it in every tube that holds the path there, "
            f"and {excess:.3g} m beyond in the one that comes least near"
        )
