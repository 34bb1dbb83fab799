"""A piece of a reference, on which turning rate ω_r(θ) and speed v_r(θ) are polynomials over the rationals.

Whether it stays inside bounds (`cfcheck.path.bounds`) is decided exactly: one such as κ = ω_r/v_r ≤ κ_hi is the
polynomial inequality κ_hi v_r − ω_r ≥ 0 on the piece (`cfcheck.exact.polynomial`). Turn and length are integrals and
rational, the displacement is enclosed in balls (`cfcheck.path.displacement`).
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from flint import acb, acb_series, arb, arb_poly, fmpq, fmpq_poly

from cfcheck.exact.enclosure import Budget
from cfcheck.exact.polynomial import (
    Coefficients,
    bernstein,
    derivative,
    evaluate,
    integral,
    is_nonnegative,
    shifted,
)
from cfcheck.exact.rational import Range, bits
from cfcheck.path.bounds import Bounds
from cfcheck.path.displacement import along_arc, along_curve, series


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch on which ω_r and v_r are polynomials of t = θ − theta, 0 ≤ t ≤ duration.

    `theta` (s) counts from the segment's start, `arc` (m) from the path's.
    """

    segment: int
    theta: fmpq
    duration: fmpq
    turn_rate: Coefficients
    speed: Coefficients
    arc: fmpq

    @cached_property
    def length(self) -> fmpq:
        """Metres of reference, where the speed is positive."""
        return evaluate(integral(self.speed), self.duration)

    def profile(self, at: fmpq) -> dict[str, fmpq]:
        """What the dynamics see of it at t (s), by the names of a vehicle's graph."""
        return {
            "turn_rate": evaluate(self.turn_rate, at),
            "speed": evaluate(self.speed, at),
            "turn_rate_slope": evaluate(derivative(self.turn_rate), at),
            "speed_slope": evaluate(derivative(self.speed), at),
        }

    @property
    def is_constant(self) -> bool:
        """Whether turning rate and speed are."""
        return len(self.turn_rate) == len(self.speed) == 1

    @property
    def end_speed(self) -> fmpq:
        """v_r where the piece ends, m/s."""
        return evaluate(self.speed, self.duration)

    @cached_property
    def halves(self) -> tuple["Piece", "Piece"]:
        """Its two halves, which keep what is computed of them."""
        first, second = self.split([self.duration / 2])
        return first, second

    @cached_property
    def turn(self) -> fmpq:
        """By how much the heading changes, in rad."""
        return evaluate(integral(self.turn_rate), self.duration)

    @cached_property
    def turns(self) -> Range:
        """Rationals between which the turn since its start stays, in rad."""
        control = bernstein(integral(self.turn_rate), self.duration)
        return min(control), max(control)

    @cached_property
    def way(self) -> fmpq:
        """Metres that the reference moves at most, forwards and backwards together."""
        control = bernstein(self.speed, self.duration)
        return self.length if min(control) >= 0 else max(map(abs, control)) * self.duration

    # --- bounds that it keeps

    def inside(self, bounds: Bounds, effort: Budget | None = None) -> bool:
        """Whether speed, curvature, acceleration and, if bounded, the curvature's rate stay inside: decided exactly.

        Decisions that are not cheap are paid for out of the budget, if one is given.
        """
        # speed first: the inequalities of curvature and of its rate need a positive one
        ordered = ("speed", "curvature", "acceleration", "curvature_rate")
        found = ((name, bounds.intervals[name]) for name in ordered if name in bounds.intervals)
        return all(
            self.keeps(name, False, lower, effort) and self.keeps(name, True, upper, effort)
            for name, (lower, upper) in found
        )

    def keeps(self, quantity: str, is_upper: bool, bound: fmpq, effort: Budget | None = None) -> bool:
        """Whether the quantity stays on its side of the bound all along: exactly; of curvature at positive speed.

        above − bound · below has the sign of quantity − bound (`fraction`). Its Bernstein coefficients decide, or where
        they do not, its roots.
        """
        sign = -1 if is_upper else 1

        def slack(above: Sequence[fmpq], below: Sequence[fmpq]) -> list[fmpq]:
            return [sign * (a - bound * b) for a, b in zip(above, below, strict=True)]

        control = slack(*self._controls(quantity))
        if min(control) >= 0:
            return True
        if control[0] < 0 or control[-1] < 0:  # at one of the ends
            return False
        key = quantity, is_upper, bound
        if key not in self._decided:
            if effort is not None:
                effort.spend(self.effort_of_decision)
            self._decided[key] = is_nonnegative(slack(*self.fraction(quantity)), self.duration)
        return self._decided[key]

    @cached_property
    def _decided(self) -> dict[tuple[str, bool, fmpq], bool]:
        return {}

    @cached_property
    def effort_of_decision(self) -> int:
        """What deciding an inequality along it costs, in products of coefficients."""
        numbers = (*self.turn_rate, *self.speed, self.duration)
        return max(len(self.turn_rate), len(self.speed)) ** 2 * (8 + max(map(bits, numbers))) // 2

    def fraction(self, quantity: str) -> tuple[Coefficients, Coefficients]:
        """The quantity as a quotient of two polynomials with equally many coefficients."""
        above, below = self.speed, (fmpq(1),)
        if quantity == "curvature":
            above, below = self.turn_rate, self.speed
        elif quantity == "acceleration":
            above = derivative(self.speed)
        elif quantity == "curvature_rate":  # of ω/v along θ
            turn_rate, speed = (fmpq_poly(list(c)) for c in (self.turn_rate, self.speed))
            above = tuple((turn_rate.derivative() * speed - turn_rate * speed.derivative()).coeffs())
            below = tuple((speed * speed).coeffs())
        size = max(len(above), len(below))
        return _padded(above, size), _padded(below, size)

    def _controls(self, quantity: str) -> tuple[list[fmpq], list[fmpq]]:
        """Bernstein coefficients of both polynomials of `fraction`."""
        if quantity not in self._known_controls:
            above, below = self.fraction(quantity)
            self._known_controls[quantity] = bernstein(above, self.duration), bernstein(below, self.duration)
        return self._known_controls[quantity]

    @cached_property
    def _known_controls(self) -> dict[str, tuple[list[fmpq], list[fmpq]]]:
        return {}

    # --- parts of it, and the reference's motion along it

    def split(self, inner: Sequence[fmpq]) -> "Iterator[Piece]":
        """The same stretch, cut at these t (s), increasing and inside it."""
        ends = [fmpq(0), *inner, self.duration]
        travelled = integral(self.speed)
        for begin, end in itertools.pairwise(ends):
            yield Piece(
                self.segment,
                self.theta + begin,
                end - begin,
                shifted(self.turn_rate, begin),
                shifted(self.speed, begin),
                self.arc + evaluate(travelled, begin),
            )

    @cached_property
    def displacement(self) -> acb:
        """∫ v_r e^{iP} dt over the piece, P the turn since its start: metres forward + i metres to the left."""
        return self._displaced[0]

    @cached_property
    def _displaced(self) -> tuple[acb, int]:
        """The displacement, and how many stretches it took to enclose it."""
        if self.is_constant:
            return along_arc(self.turn_rate[0], self.speed[0], self.duration), 1
        return along_curve(*self._polynomials, self.duration)

    @property
    def effort(self) -> int:
        """Stretches that the enclosure of its displacement takes."""
        return self._displaced[1]

    def motion(self, at: arb, terms: int) -> tuple[acb_series, acb_series]:
        """e^{iP} and v_r e^{iP} at t = at + u in powers of u (s), for every number in the ball `at`; P as above."""
        return series(*self._polynomials, arb_poly([at, 1]), terms)

    @cached_property
    def _polynomials(self) -> tuple[arb_poly, arb_poly]:
        """P and v_r."""
        turn, speed = (arb_poly(fmpq_poly(list(c))) for c in (integral(self.turn_rate), self.speed))
        return turn, speed


def _padded(coefficients: Coefficients, size: int) -> Coefficients:
    return (*coefficients, *[fmpq(0)] * (size - len(coefficients)))


def are_steady(pieces: Sequence[Piece]) -> bool:
    """Whether they are written so that turning rate and speed are one number each in all of them."""
    first = pieces[0]
    return all(
        piece.is_constant and (piece.turn_rate, piece.speed) == (first.turn_rate, first.speed) for piece in pieces
    )


def turning_jumps(pieces: Sequence[Piece]) -> bool:
    """Whether the turning rate does between two of them that follow each other."""
    return any(jumps_in_turning(one, other) for one, other in itertools.pairwise(pieces))


def jumps_in_turning(before: Piece, after: Piece) -> bool:
    """Whether the turning rate is another one where the second piece begins than where the first one ends."""
    return evaluate(before.turn_rate, before.duration) != after.turn_rate[0]


def between(pieces: Sequence[Piece], begin: fmpq, end: fmpq, effort: Budget | None = None) -> list[Piece]:
    """What the pieces of a leg have between two θ (s, from its start), cut exactly there; paid for as decisions are."""
    found = []
    for piece in pieces:
        inner = sorted(at for at in {begin - piece.theta, end - piece.theta} if 0 < at < piece.duration)
        if inner and effort is not None:
            effort.spend(8 * piece.effort_of_decision)  # its coefficients grow by the length of the cut
        found += [part for part in piece.split(inner) if begin <= part.theta < end] if inner else []
        if not inner and begin <= piece.theta < end:
            found.append(piece)
    return found
