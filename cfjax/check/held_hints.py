"""A robustness file, read: what it states, and hints. Shapes and sizes are checked, nothing of it is believed."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import comb
from typing import Generic, NamedTuple, TypeVar

from flint import fmpq

from cfjax.check.amounts import Absorbed, Stated
from cfjax.check.bounds import Bounds, read_bounds
from cfjax.check.document import FORMAT, VERSION, document_hash
from cfjax.check.held import ORDERS
from cfjax.check.hints import (
    MOST_GRAM_ENTRIES,
    MOST_STRETCHES,
    EnclosureHints,
    Room,
    read_enclosures,
    read_gram,
    read_matrix,
)
from cfjax.check.program import Gram, Matrix
from cfjax.check.reader import Broken, Item, Unreadable
from cfjax.check.sampled import RangeHints, SampledClaim
from cfjax.check.sampled_hints import read_sampled


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
    """Where a stretch of θ ends (s), or of a tube a band of speeds (m/s), and the hints for it."""

    end: fmpq
    pieces: tuple[PieceHints, ...]


@dataclass(frozen=True)
class TubeHints:
    """For a tube of a chain: bounds of the path along its runs, in the path's units; bands, in those of the tube."""

    bounds: Bounds
    bands: tuple[HeldStretch, ...]


Hints = TypeVar("Hints")


class RobustnessFile(NamedTuple, Generic[Hints]):
    """A file about a certificate: amounts that it states, and hints for the bounds that allow them.

    `hints` are those of each funnel, or of each tube of a chain. `entries` has for each funnel √γ, V being at most γ
    where another one hands over to it. `sampled` is what a file says of sampled control, with hints, where it does.
    """

    stated: Stated
    hints: tuple[Hints, ...]
    entries: tuple[fmpq, ...] = ()
    sampled: tuple[SampledClaim, tuple[RangeHints, ...]] | None = None


def read_chain_robustness(document: object, certificate: str, tubes: int, states: int) -> RobustnessFile[TubeHints]:
    """Of a parsed file about the chain with that hash: `hints` are `TubeHints`.

    Raises:
        Unreadable, Broken: as `read_robustness`.
    """
    amounts, each = _fields(document, certificate, "tubes")
    room, found = Room(MOST_GRAM_ENTRIES), []
    for entry in each.items(tubes, tubes):
        bounds, bands = entry.record("bounds", "bands")
        stretches = tuple(read_stretch(band, states, room) for band in bands.items(MOST_STRETCHES))
        found.append(TubeHints(read_bounds(bounds), stretches))
    return RobustnessFile(_stated(amounts, states), tuple(found))


def read_robustness(
    document: object, certificate: str, funnels: int, states: int
) -> RobustnessFile[tuple[HeldStretch, ...]]:
    """Of a parsed file about the certificate with that hash: `hints` are the stretches of each of its funnels.

    Raises:
        Unreadable: says what was expected where.
        Broken: the file is about another certificate, or its hash is not that of its content.
    """
    says_more = [SAMPLED] if isinstance(document, dict) and SAMPLED in document else []
    amounts, each, entries, *sampled = _fields(document, certificate, "funnels", "entries", *says_more)
    room = Room(MOST_GRAM_ENTRIES)
    return RobustnessFile(
        _stated(amounts, states),
        tuple(
            tuple(read_stretch(entry, states, room) for entry in item.items(MOST_STRETCHES))
            for item in each.items(funnels, funnels)
        ),
        tuple(map(_amount, entries.items(funnels, funnels))),
        next((read_sampled(item, states, room) for item in sampled), None),
    )


def _fields(document: object, certificate: str, *names: str) -> list[Item]:
    """What follows the header of a file that is about the certificate with that hash: amounts, and these fields."""
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise Unreadable(f"not a certificate: expected an object with format {FORMAT}")
    if document.get("version") != VERSION or isinstance(document["version"], bool):
        raise Unreadable(f"this checker reads version {VERSION} of the format")
    if "amounts" not in document:
        raise Unreadable("expected amounts, which earlier versions did not state; the certificate stands without it")
    fields = Item(document, "").record("format", "version", "claim", "hash", "certificate", "amounts", *names)
    fields[2].choice(CLAIM)
    if fields[3].value != document_hash(document):
        raise Broken("hash: the content has changed since the hash was taken")
    if fields[4].value != certificate:
        raise Broken("certificate: these are hints for another certificate")
    return fields[5:]


def _stated(item: Item, states: int) -> Stated:
    alone, together, by_speed = item.record("alone", "together", "by_speed")
    every, bands = _amounts(alone, states), []
    for entry in by_speed.items(MOST_STRETCHES, 0):
        bands.append(_amounts(entry, states))
        if bands[-1].pose_error != every.pose_error:
            entry.refuse("the pose_error of alone")
    return Stated(every, _amounts(together, states), tuple(bands))


def _amounts(item: Item, states: int) -> Absorbed:
    period, disturbance, pose_error, delay = item.record("period", "disturbance", "pose_error", "delay")

    def by_state(entry: Item) -> tuple[fmpq, ...]:
        return tuple(map(_amount, entry.items(states, states)))

    return Absorbed(_amount(period), by_state(disturbance), by_state(pose_error), _amount(delay))


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
