"""The hints of a robustness file, read: shapes and sizes are checked, nothing of it is believed."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import comb

from flint import fmpq

from cfjax.check.bounds import Bounds
from cfjax.check.document import (
    FORMAT,
    MOST_FUNCTIONS,
    MOST_GRAM_ENTRIES,
    MOST_STRETCHES,
    VERSION,
    Room,
    UnaryHint,
    document_hash,
    read_bounds,
    read_gram,
    read_unary,
)
from cfjax.check.held import ORDERS
from cfjax.check.program import Gram, Matrix
from cfjax.check.reader import Broken, Item, Unreadable


CLAIM = "robustness"
DEGREES = (2, 1)  # of the monomials in Gram matrices: of the free square, and of the ranges of levels
MOST_VERTICES = 256  # eight parameters that vary

Unary = Mapping[int, UnaryHint]


@dataclass(frozen=True)
class PieceHints:
    """For one range of levels of a stretch; `cells` by order and vertex: margin and Gram matrices."""

    whitening: Matrix
    enclosures: Unary
    derivatives: Unary
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


def read_chain_hints(document: object, certificate: str, tubes: int, states: int) -> list[TubeHints]:
    """Of a parsed file about the chain with that hash: hints for each of its tubes.

    Raises:
        Unreadable, Broken: as `read_hints`.
    """
    room, entries = Room(MOST_GRAM_ENTRIES), _entries(document, certificate, "tubes").items(tubes, tubes)
    found = []
    for entry in entries:
        bounds, bands = entry.record("bounds", "bands")
        stretches = tuple(read_stretch(band, states, room) for band in bands.items(MOST_STRETCHES))
        found.append(TubeHints(read_bounds(bounds), stretches))
    return found


def read_hints(document: object, certificate: str, funnels: int, states: int) -> list[tuple[HeldStretch, ...]]:
    """Of a parsed file about the certificate with that hash: the stretches of each of its funnels.

    Raises:
        Unreadable: says what was expected where.
        Broken: the file is about another certificate, or its hash is not that of its content.
    """
    room, each = Room(MOST_GRAM_ENTRIES), _entries(document, certificate, "funnels").items(funnels, funnels)
    return [tuple(read_stretch(entry, states, room) for entry in item.items(MOST_STRETCHES)) for item in each]


def _entries(document: object, certificate: str, name: str) -> Item:
    """The last field of a file that is about the certificate with that hash."""
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise Unreadable(f"not a certificate: expected an object with format {FORMAT}")
    if document.get("version") != VERSION or isinstance(document["version"], bool):
        raise Unreadable(f"this checker reads version {VERSION} of the format")
    fields = Item(document, "").record("format", "version", "claim", "hash", "certificate", name)
    fields[2].choice(CLAIM)
    if fields[3].value != document_hash(document):
        raise Broken("hash: the content has changed since the hash was taken")
    if fields[4].value != certificate:
        raise Broken("certificate: these are hints for another certificate")
    return fields[5]


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
    whitened = [[entry.rational() for entry in row.items(states, states)] for row in whitening.items(states, states)]
    return PieceHints(whitened, _unary(enclosures), _unary(derivatives), by_cell)


def _unary(item: Item) -> Unary:
    found = {}
    for entry in item.items(MOST_FUNCTIONS, least=0):
        node, hint = read_unary(entry)
        if node in found:
            entry.refuse("each node once")
        found[node] = hint
    return found
