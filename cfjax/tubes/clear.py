"""Tubes beside obstacles: which of them, and where along the path, leave the body room."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool

from cfjax.certificate.clearance import NotClear, find_clearance, least_clearances, samples_along
from cfjax.check.clearance import Shadow
from cfjax.check.reference import Reference
from cfjax.check.surroundings import Clearance, Surroundings
from cfjax.tubes.certified import CertifiedTube, Run


SAMPLES = 9  # of each piece: a touch between them is seen when half-planes are looked for

Holds = Bool[np.ndarray, "tubes pieces"]
Chain = list[tuple[int, int, int]]  # first piece, piece after the last, tube


class InTheWay(ValueError):
    """An obstacle that the body may reach in every tube that holds the path there."""


def choose_clear(
    reference: Reference,
    tubes: Sequence[CertifiedTube],
    holds: Holds,
    surroundings: Surroundings,
    choose: Callable[[Holds], Chain],
) -> tuple[Chain, Clearance]:
    """A chain in whose tubes the body clears all obstacles, with half-planes that prove it.

    `choose` finds the best chain among the places that are left to each tube. Where half-planes are not found the place
    is taken away, and it chooses again.

    Raises:
        InTheWay: which obstacle is in the way, and where.
    """
    holds = _clear_places(reference, tubes, holds, surroundings)
    obstacle = None
    while True:
        try:
            chain = choose(holds)
        except ValueError as error:
            beside = "" if obstacle is None else f", where obstacle {obstacle} leaves room"
            raise InTheWay(f"{error}{beside}") from None
        legs = [Run(begin, end, tubes[index]).leg(reference) for begin, end, index in chain]
        try:
            return chain, find_clearance(surroundings, legs)
        except NotClear as error:
            begin, _, tube = chain[error.leg]
            begins = [float(piece.theta) for piece in legs[error.leg].pieces]
            holds[tube, begin + int(np.searchsorted(begins, error.theta, side="right")) - 1] = False
            obstacle = error.obstacle
            _require_way(reference, holds, obstacle)


def _clear_places(
    reference: Reference, tubes: Sequence[CertifiedTube], holds: Holds, surroundings: Surroundings
) -> Holds:
    """Where each tube holds the path and, as far as samples tell, the body is clear."""
    holds = holds.copy()
    whole = [Run(0, len(reference.pieces), tube).leg(reference) for tube in tubes]
    along = samples_along(whole[0].pieces, reference.start, SAMPLES)
    for number, obstacle in enumerate(surroundings.obstacles):
        for index, leg in enumerate(whole):
            for disc in surroundings.footprint:
                found = least_clearances(along, Shadow(leg.funnel.shape, leg.funnel.level, disc), obstacle)
                holds[index] &= found.reshape(-1, SAMPLES).min(axis=1) > 0
        _require_way(reference, holds, number)
    return holds


def _require_way(reference: Reference, holds: Holds, obstacle: int) -> None:
    """Raises InTheWay where no tube is left."""
    blocked = np.flatnonzero(~holds.any(axis=0))
    if blocked.size:
        piece, position = reference.pieces[blocked[0]], reference.piece_poses[blocked[0]].position
        x, y = float(position.real.mid()), float(position.imag.mid())
        raise InTheWay(
            f"obstacle {obstacle} is in the way: from theta = {float(piece.theta):.6g} s of segment {piece.segment}, "
            f"({x:.4g}, {y:.4g}) m, on the body may reach it in every tube that holds the path there"
        )
