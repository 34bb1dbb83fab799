"""Hints of a certificate: a prover's findings are read with their shapes and sizes checked, and none is believed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import comb
from typing import NamedTuple

from flint import fmpq

from cfcheck.claims.references import read_stretch_bounds
from cfcheck.exact.graph import MOST_FUNCTIONS, MOST_INPUTS, MOST_NODES
from cfcheck.exact.rational import Matrix
from cfcheck.kernel.decrease import by_boundary
from cfcheck.kernel.program import Gram
from cfcheck.path.bounds import MOST_EXTREMES, Bounds
from cfcheck.reader import Item


MOST_STRETCHES = 64  # of one funnel's proof
MOST_CELLS = 32 * MOST_EXTREMES  # of a stretch: two pieces, sixteen patterns of the signs of four inputs
MOST_MONOMIALS = 128  # rows of a Gram matrix
MOST_GRAM_ENTRIES = 1_500_000  # of the whole file; a circle's takes about 20 000
MOST_COEFFICIENTS = 12  # of a polynomial that stands for a function
LARGEST_GRAM_ENTRY = 2**64  # a circle's reach 2^36

UnaryHint = tuple[str, tuple[fmpq, ...], fmpq, fmpq, fmpq]  # function, coefficients, lower, upper, bound
EnclosureHints = Mapping[int, UnaryHint]  # by node of the graph
CellKey = tuple[int, int, tuple[int, ...]]  # reference, piece, signs


class CellHints(NamedTuple):
    """A margin (1/s), e and e' with ε ≤ e + e' |y|², and Gram matrices (`cfcheck.kernel.decrease`)."""

    margin: fmpq
    remainder: tuple[fmpq, fmpq]
    grams: tuple[Gram, ...]


@dataclass(frozen=True)
class StretchHints:
    """A stretch of θ that ends at `end` (s), bounds of its references, and what the prover found there.

    Without an end it is all there is: the funnel does not change with θ, and holds wherever the bounds do. `cells` are
    by extreme reference, level piece and signs.
    """

    end: fmpq | None
    bounds: Bounds
    whitening: Matrix
    enclosures: EnclosureHints
    cells: Mapping[CellKey, CellHints]


@dataclass(frozen=True)
class DecreaseHints:
    """What the prover found for condition (d) of one funnel; `degrees` are those of the Gram matrices.

    `mirror` are signs of states and inputs under which everything is its own mirror image; None: no use is made of any.
    `law_degree` is that of the polynomials that stand for a law, where there is one.
    """

    degrees: tuple[int, ...]
    mirror: tuple[int, ...] | None
    stretches: tuple[StretchHints, ...]
    law_degree: int | None = None

    @property
    def duration(self) -> fmpq | None:
        """T of the legs that it is for, s; None where these are of any length."""
        return self.stretches[-1].end


class Room:
    """How many entries of Gram matrices a file may still have."""

    def __init__(self, entries: int) -> None:
        self.left = entries

    def take(self, entries: int, item: Item) -> None:
        self.left -= entries
        if self.left < 0:
            item.refuse(f"Gram matrices with at most {MOST_GRAM_ENTRIES} entries together")


def read_decrease(item: Item, states: int, inputs: int, room: Room) -> DecreaseHints:
    """For condition (d) of one funnel; the vehicle has that many states and inputs.

    Raises:
        Unreadable: says what was expected where.
    """
    degrees, mirror, stretches, *law = item.record("degrees", "mirror", "stretches", *item.optional("law_degree"))
    orders = tuple(degree.integer(0, 8) for degree in degrees.items(MOST_INPUTS + 3, 3))
    sizes = [comb(states + degree, degree) for degree in orders]
    if max(sizes) > MOST_MONOMIALS:
        degrees.refuse(f"degrees with at most {MOST_MONOMIALS} monomials")
    found = tuple(_stretch_hints(stretch, states, sizes, room) for stretch in stretches.items(MOST_STRETCHES))
    if len(found) > 1 and any(stretch.end is None for stretch in found):
        stretches.refuse("an end of every stretch, or a single one without")
    signs = None if mirror.value is None else mirror.integers(states + inputs, -1, 1)
    return DecreaseHints(orders, signs, found, law[0].integer(1, 8) if law else None)


def _stretch_hints(item: Item, states: int, sizes: list[int], room: Room) -> StretchHints:
    end, bounds, whitening, enclosures, cells = item.record("end", "bounds", "whitening", "enclosures", "cells")
    by_node, by_cell = read_enclosures(enclosures), {}
    entries, least = cells.items(MOST_CELLS), _entries(sizes)
    room.take(len(entries) * least, cells)
    for entry in entries:
        reference, piece, signs, margin, remainder, grams = entry.record(
            "reference", "piece", "signs", "margin", "remainder", "grams"
        )
        key = (
            reference.integer(0, MOST_EXTREMES - 1),
            piece.integer(0, MOST_CELLS),
            tuple(sign.integer(-1, 1) for sign in signs.items(MOST_INPUTS, least=0)),
        )
        if key in by_cell:
            entry.refuse("each cell once")
        own = by_boundary(sizes, key[2])
        room.take(_entries(own) - least, entry)
        tables, (constant, square) = grams.items(len(own), len(own)), remainder.items(2, 2)
        by_cell[key] = CellHints(
            margin.rational(),
            (constant.rational(), square.rational()),
            tuple(read_gram(table, rows) for table, rows in zip(tables, own, strict=True)),
        )
    rows = read_matrix(whitening, states)
    until = None if end.value is None else end.positive()
    return StretchHints(until, read_stretch_bounds(bounds), rows, by_node, by_cell)


def _entries(sizes: Sequence[int]) -> int:
    """Of Gram matrices of these sizes."""
    return sum(rows * (rows + 1) // 2 for rows in sizes)


def read_enclosures(item: Item) -> EnclosureHints:
    """Polynomials that stand for functions, by node of the graph."""
    found = {}
    for entry in item.items(MOST_FUNCTIONS, least=0):
        node, hint = _unary(entry)
        if node in found:
            entry.refuse("each node once")
        found[node] = hint
    return found


def _unary(item: Item) -> tuple[int, UnaryHint]:
    """A node of the graph, and the enclosure that the file states for the function it applies."""
    node, function, coefficients, lower, upper, bound = item.record(
        "node", "function", "coefficients", "lower", "upper", "bound"
    )
    powers = tuple(value.rational() for value in coefficients.items(MOST_COEFFICIENTS))
    hint = function.text(), powers, lower.rational(), upper.rational(), bound.rational()
    return node.integer(0, 2 * MOST_NODES), hint  # of vehicle and law


def read_matrix(item: Item, size: int) -> Matrix:
    """Square, by rows."""
    return [[entry.rational() for entry in row.items(size, size)] for row in item.items(size, size)]


def read_gram(item: Item, size: int) -> Gram:
    """Whole numbers over a common power of two."""
    exponent, lower = item.record("exponent", "lower")
    entries = lower.integers(size * (size + 1) // 2, -LARGEST_GRAM_ENTRY, LARGEST_GRAM_ENTRY)
    return Gram(exponent.integer(0, 200), entries)
