"""Numbers with their derivatives by a few unknowns, in arb balls: forward differentiation over boxes."""

from collections.abc import Sequence
from dataclasses import dataclass

from flint import arb, fmpq


@dataclass(frozen=True)
class Dual:
    """A ball, and a ball for its derivative by each unknown; without unknowns `partials` is empty."""

    value: arb
    partials: tuple[arb, ...]

    def __add__(self, other: "Dual") -> "Dual":
        return Dual(self.value + other.value, tuple(map(arb.__add__, self.partials, other.partials)))

    def __sub__(self, other: "Dual") -> "Dual":
        return Dual(self.value - other.value, tuple(map(arb.__sub__, self.partials, other.partials)))

    def __neg__(self) -> "Dual":
        return Dual(-self.value, tuple(map(arb.__neg__, self.partials)))

    def __mul__(self, other: "Dual") -> "Dual":
        a, b = self.value, other.value
        return Dual(a * b, tuple(a * d + b * c for c, d in zip(self.partials, other.partials, strict=True)))

    def square(self) -> "Dual":
        """Not below zero where the ball holds zero, other than a product with itself."""
        near, far = self.value.abs_lower(), self.value.abs_upper()
        return self._chain((near * near).union(far * far), 2 * self.value)

    def _chain(self, value: arb, slope: arb) -> "Dual":
        return Dual(value, tuple(slope * partial for partial in self.partials))

    def sqrt(self) -> "Dual":
        """Not finite where the ball holds a number that is not above zero."""
        root = self.value.sqrt()
        return self._chain(root, 1 / (2 * root))

    def inverse(self) -> "Dual":
        """Not finite where the ball holds zero."""
        inverse = 1 / self.value
        return self._chain(inverse, -inverse * inverse)

    def sin(self) -> "Dual":
        return self._chain(self.value.sin(), self.value.cos())

    def cos(self) -> "Dual":
        return self._chain(self.value.cos(), -self.value.sin())

    def least(self, half_widths: Sequence[fmpq], middle: arb) -> arb:
        """A lower bound of the number over the box, of which it is the value; `middle` is its value in the middle.

        The mean value theorem where there are derivatives, which the other bound is worse than in a small box.
        """
        swing = sum((arb(half) * abs(d) for half, d in zip(half_widths, self.partials, strict=True)), arb(0))
        by_slope, direct = (middle - swing).lower(), self.value.lower()
        return by_slope if by_slope > direct else direct


def unknowns(box: Sequence[tuple[fmpq, fmpq]]) -> list[Dual]:
    """Those of a box, each with derivative one by itself."""
    balls = [arb(low).union(arb(high)) for low, high in box]
    return [Dual(ball, tuple(arb(int(i == j)) for j in range(len(balls)))) for i, ball in enumerate(balls)]


def constant(value: fmpq, count: int) -> Dual:
    """A number that depends on none of so many unknowns."""
    return Dual(arb(value), (arb(0),) * count)
