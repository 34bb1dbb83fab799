"""A robustness file, read: what it states, and hints. Shapes and sizes are checked, nothing of it is believed."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import comb
from typing import NamedTuple

from flint import fmpq

from cfcheck.claims.document import Claims, read_header
from cfcheck.claims.hints import (
    MOST_GRAM_ENTRIES,
    MOST_STRETCHES,
    EnclosureHints,
    Room,
    read_enclosures,
    read_gram,
    read_matrix,
)
from cfcheck.exact.rational import Matrix
from cfcheck.kernel.program import Gram
from cfcheck.path.bounds import Bounds, read_bounds
from cfcheck.reader import Broken, Item
from cfcheck.robustness.amounts import AbsorbedClaim, Stated
from cfcheck.robustness.hold import ORDERS
from cfcheck.robustness.ranges import SampledClaim
from cfcheck.robustness.sampled import RangeHints
from cfcheck.robustness.sampled_hints import read_sampled


CLAIM, SAMPLED = "robustness", "sampled"
DEGREES = (2, 1)  # of the monomials in Gram matrices: of the free square, and of the ranges of levels
MOST_VERTICES = 256  # eight parameters that vary


@dataclass(frozen=True)
class PieceHints:
    """For one range of levels of a stretch; `cells` by order and vertex: margin and Gram matrices."""

    whitening: Matrix
    enclosures: EnclosureHints
    derivatives: EnclosureHints
    cells: Mapping[tuple[int, int], tuple[fmpq, tuple[Gram, ...]]]


@dataclass(frozen=True)
class HeldStretch:
    """Where a stretch of θ (s) or a band of speeds (m/s) ends, and the hints for it."""

    end: fmpq
    pieces: tuple[PieceHints, ...]


@dataclass(frozen=True)
class FunnelHints:
    """For one funnel: stretches of θ or, where it is invariant, bands of speed.

    `bounds` are those of the path along the legs of an invariant funnel, in the path's units; stretches and bands are
    in those of the car that the funnel is proven for.
    """

    bounds: Bounds | None
    stretches: tuple[HeldStretch, ...]


class RobustnessFile(NamedTuple):
    """A file about a certificate: amounts that it states, and for each funnel hints for the bounds that allow them.

    `sampled` is what it says of sampled control, with hints, where it does.
    """

    stated: Stated
    hints: tuple[FunnelHints, ...]
    sampled: tuple[SampledClaim, tuple[RangeHints, ...]] | None = None


def read_robustness(document: object, certificate: str, claims: Claims) -> RobustnessFile:
    """Of a parsed file about the certificate with that hash and these claims.

    Raises:
        Unreadable: says what was expected where.
        Broken: the file is about another certificate, or its hash is not that of its content.
    """
    says_more = (SAMPLED,) if isinstance(document, dict) and SAMPLED in document else ()
    about, amounts, funnels, *sampled = read_header(
        document, (CLAIM,), ("certificate", "amounts", "funnels", *says_more)
    )
    if about.value != certificate:
        raise Broken("certificate: these are hints for another certificate")
    room, states, count = Room(MOST_GRAM_ENTRIES), len(claims.problem.vehicle.states), len(claims.funnels)
    found = []
    for entry, funnel in zip(funnels.items(count, count), claims.funnels, strict=True):
        bounds, stretches = entry.record("bounds", "stretches")
        if (bounds.value is None) != (funnel.margin_per_metre is None):
            bounds.refuse("bounds of the path for a funnel that does not change with theta, and null for others")
        own = tuple(read_stretch(stretch, states, room) for stretch in stretches.items(MOST_STRETCHES))
        found.append(FunnelHints(None if bounds.value is None else read_bounds(bounds), own))
    more = next((read_sampled(item, states, room) for item in sampled), None)
    return RobustnessFile(_stated(amounts, states), tuple(found), more)


def _stated(item: Item, states: int) -> Stated:
    alone, together, by_speed = item.record("alone", "together", "by_speed")
    every, bands = _amounts(alone, states), []
    for entry in by_speed.items(MOST_STRETCHES, 0):
        bands.append(_amounts(entry, states))
        if bands[-1].pose_error != every.pose_error:
            entry.refuse("the pose_error of alone")
    return Stated(every, _amounts(together, states), tuple(bands))


def _amounts(item: Item, states: int) -> AbsorbedClaim:
    period, disturbance, pose_error, delay = item.record("period", "disturbance", "pose_error", "delay")

    def by_state(entry: Item) -> tuple[fmpq, ...]:
        return tuple(map(_amount, entry.items(states, states)))

    return AbsorbedClaim(_amount(period), by_state(disturbance), by_state(pose_error), _amount(delay))


def _amount(item: Item) -> fmpq:
    found = item.rational()
    return found if found >= 0 else item.refuse("a number that is not negative")


def read_stretch(item: Item, states: int, room: Room) -> HeldStretch:
    """One stretch's hints."""
    end, pieces = item.record("end", "levels")
    return HeldStretch(end.positive(), tuple(_piece(entry, states, room) for entry in pieces.items(2)))


def _piece(item: Item, states: int, room: Room) -> PieceHints:
    whitening, enclosures, derivatives, cells = item.record("whitening", "enclosures", "derivatives", "cells")
    rows = [comb(states + degree, degree) for degree in (DEGREES[0], DEGREES[1], DEGREES[1])]
    by_cell = {}
    for entry in cells.items(len(ORDERS) * MOST_VERTICES):
        order, vertex, margin, grams = entry.record("order", "vertex", "margin", "grams")
        key = order.integer(1, len(ORDERS)), vertex.integer(0, MOST_VERTICES - 1)
        if key in by_cell:
            entry.refuse("each cell once")
        tables = grams.items(len(rows), least=len(rows) - 1)
        room.take(sum(size * (size + 1) // 2 for size in rows[: len(tables)]), cells)
        by_cell[key] = (
            margin.rational(),
            tuple(read_gram(table, size) for table, size in zip(tables, rows, strict=False)),
        )
    whitened = read_matrix(whitening, states)
    return PieceHints(whitened, read_enclosures(enclosures), read_enclosures(derivatives), by_cell)
