"""Where a path leaves the bounds of tubes, and by how much: the line that says why no tube holds along it.

That a piece leaves a tube is decided exactly (`Piece.keeps`); where it is furthest out is found nearly.
"""

from collections.abc import Sequence
from typing import NamedTuple

from flint import acb, fmpq, fmpq_poly

from cfcheck.exact.polynomial import evaluate, integral
from cfcheck.exact.rational import upper_bound
from cfcheck.path.bounds import Bounds
from cfcheck.path.piece import Piece
from cfjax.tubes.certified import CertifiedTube


UNITS = {"curvature": "1/m", "speed": "m/s", "acceleration": "m/s²"}


class InTheWay(ValueError):
    """An obstacle or a wall that the body may reach in every tube that holds the path there."""


class BoundViolation(NamedTuple):
    """Where a piece leaves a tube by most: value and bound in the quantity's unit.

    θ in s from the segment's start, arc in m from the path's start.
    """

    quantity: str
    value: fmpq
    bound: fmpq
    segment: int
    theta: fmpq
    arc: fmpq

    @property
    def excess(self) -> fmpq:
        return abs(self.value - self.bound)

    def __str__(self) -> str:
        # a value beyond its bound by less than it shows is printed with what it is beyond
        beyond = "above" if self.value > self.bound else "below"
        unit = UNITS[self.quantity]
        return (
            f"{self.quantity} reaches {float(self.value):.6g} {unit} at theta = {float(self.theta):.6g} s of segment "
            f"{self.segment} (after {float(self.arc):.6g} m): {float(self.excess):.3g} {beyond} {float(self.bound):.6g}"
        )


def violations(piece: Piece, bounds: Bounds) -> list[BoundViolation]:
    """Where each quantity that leaves its interval does so by most: places rounded, values exact."""
    found = []
    for quantity in UNITS:
        places = [at for at in _extremes(piece, quantity) if quantity != "curvature" or evaluate(piece.speed, at) > 0]
        values = [(_value(piece, quantity, at), at) for at in places]
        lower, upper = bounds.intervals[quantity]
        lowest = min(values, default=None)  # the first place of each
        highest = max(values, default=None, key=lambda found: (found[0], -found[1]))
        for extreme, bound, is_upper in ((lowest, lower, False), (highest, upper, True)):
            if extreme is not None and not piece.keeps(quantity, is_upper, bound):
                value, at = extreme
                arc = piece.arc + evaluate(integral(piece.speed), at)
                found.append(BoundViolation(quantity, value, bound, piece.segment, piece.theta + at, arc))
    return found


def _value(piece: Piece, quantity: str, at: fmpq) -> fmpq:
    above, below = piece.fraction(quantity)
    return evaluate(above, at) / evaluate(below, at)


def _extremes(piece: Piece, quantity: str) -> list[fmpq]:
    """Ends of the piece and, nearly, the places between where the quantity's slope vanishes."""
    above, below = (fmpq_poly(list(c)) for c in piece.fraction(quantity))
    slope = above.derivative() * below - above * below.derivative()
    inner: list[fmpq] = []
    if slope.degree() > 0:
        roots: list[tuple[acb, int]] = slope.complex_roots()  # pyright: ignore[reportAssignmentType]
        real = (root.real for root, _ in roots if root.imag.contains(0))
        inner = [at for root in real if 0 < (at := upper_bound(root.mid())) < piece.duration]
    return [fmpq(0), *inner, piece.duration]


def furthest_out(pieces: Sequence[Piece], tubes: Sequence[CertifiedTube]) -> str:
    """Where pieces that no tube holds are furthest from the tube that is nearest to them, and what tubes hold there."""
    found: list[_Out] = []
    for piece in pieces:
        out = ((tube, [v for v in violations(piece, tube.bounds) if v.excess]) for tube in tubes)
        nearest = [
            _Out(
                max(map(_relative, beyond)),
                sum(map(_relative, beyond), fmpq(0)),
                max(beyond, key=_relative),
                tube,
                piece,
            )
            for tube, beyond in out
            if beyond
        ]
        found += [min(nearest, key=_distance)] if nearest else []
    if not found:
        return "no tube holds along it"
    *_, violation, tube, piece = max(found, key=_distance)
    held = _held(piece, violation.quantity, tubes)
    return f"{violation}, where tube {tube.name} ends" + (f"; {held}" if held else "")


class _Out(NamedTuple):
    """How far a piece is out of a tube: by the quantity that is out by most, and by all of them together."""

    most: fmpq
    together: fmpq
    violation: BoundViolation
    tube: CertifiedTube
    piece: Piece


def _relative(violation: BoundViolation) -> fmpq:
    return violation.excess / max(abs(violation.value), abs(violation.bound))


def _distance(out: _Out) -> tuple[fmpq, fmpq]:
    return out.most, out.together


def _held(piece: Piece, quantity: str, tubes: Sequence[CertifiedTube]) -> str:
    """What the quantity may be where nothing else of the piece has to change, in words; empty where that is nothing."""
    alone = [tube for tube in tubes if {v.quantity for v in violations(piece, tube.bounds)} == {quantity}]
    joined: list[list[fmpq]] = []
    for lower, upper in sorted(tube.bounds.intervals[quantity] for tube in alone):
        if joined and lower <= joined[-1][1]:
            joined[-1][1] = max(joined[-1][1], upper)
        else:
            joined.append([lower, upper])
    ranges = " or ".join(f"from {float(lower):.6g} to {float(upper):.6g}" for lower, upper in joined)
    return f"tubes hold it there with a {quantity} {ranges} {UNITS[quantity]}" if joined else ""
