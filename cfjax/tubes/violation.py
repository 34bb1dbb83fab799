"""Where a path leaves the bounds of tubes, and by how much: the line that says why no tube holds along it.

That a piece leaves a tube is decided exactly (`Piece.keeps`); where it is furthest out is found nearly.
"""

from collections.abc import Sequence
from typing import NamedTuple

from flint import acb, fmpq, fmpq_poly

from cfjax.check.certified import CertifiedTube
from cfjax.check.piece import Piece
from cfjax.check.polynomial import evaluate, integral
from cfjax.check.rational import upper_bound


UNITS = {"curvature": "1/m", "speed": "m/s", "acceleration": "m/s²"}


class Violation(NamedTuple):
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


def violations(piece: Piece, tube: CertifiedTube) -> list[Violation]:
    """Where each quantity that leaves the tube's interval does so by most: places rounded, values exact."""
    found = []
    for quantity in UNITS:
        places = [at for at in _extremes(piece, quantity) if quantity != "curvature" or evaluate(piece.speed, at) > 0]
        values = [(_value(piece, quantity, at), at) for at in places]
        lower, upper = getattr(tube, quantity)
        lowest = min(values, default=None)  # the first place of each
        highest = max(values, default=None, key=lambda found: (found[0], -found[1]))
        for extreme, bound, is_upper in ((lowest, lower, False), (highest, upper, True)):
            if extreme is not None and not piece.keeps(quantity, is_upper, bound):
                value, at = extreme
                arc = piece.arc + evaluate(integral(piece.speed), at)
                found.append(Violation(quantity, value, bound, piece.segment, piece.theta + at, arc))
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
    """Where pieces that no tube holds are furthest from the tube that is nearest to them."""
    found: list[tuple[float, str]] = []
    for piece in pieces:
        nearest = []
        for tube in tubes:
            relative = [
                (float(v.excess / max(abs(v.bound), upper - lower, v.excess)), f"{v}, where tube {tube.name} ends")
                for v in violations(piece, tube)
                for lower, upper in [getattr(tube, v.quantity)]
                if v.excess
            ]
            nearest += [max(relative, key=_excess)] if relative else []
        found += [min(nearest, key=_excess)] if nearest else []
    return max(found, key=_excess)[1] if found else "no tube holds along it"


def _excess(entry: tuple[float, str]) -> float:
    return entry[0]
