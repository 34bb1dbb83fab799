"""Intervals with their derivatives by the unknowns of a search, many at once, in floating point: hints, not proofs.

The counterpart of `cfcheck.margin.dual`, with the same operations: what is decided here is shown there again.
"""

from dataclasses import dataclass

import numpy as np
from flint import fmpq
from jaxtyping import Float


Range = tuple[np.ndarray, np.ndarray]


def _times(a: Range, b: Range) -> Range:
    one, two, three, four = a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]
    return (
        np.minimum(np.minimum(one, two), np.minimum(three, four)),
        np.maximum(np.maximum(one, two), np.maximum(three, four)),
    )


@dataclass(frozen=True)
class Interval:
    """Lower and upper ends: of a value, and of its derivative by each unknown (first axis of `slopes`)."""

    value: Range
    slopes: Range

    def __add__(self, other: "Interval") -> "Interval":
        (a, b), (c, d) = self.value, other.value
        (e, f), (g, h) = self.slopes, other.slopes
        return Interval((a + c, b + d), (e + g, f + h))

    def __neg__(self) -> "Interval":
        return Interval((-self.value[1], -self.value[0]), (-self.slopes[1], -self.slopes[0]))

    def __sub__(self, other: "Interval") -> "Interval":
        return self + -other

    def __mul__(self, other: "Interval") -> "Interval":
        one, two = _times(self.value, other.slopes), _times(other.value, self.slopes)
        return Interval(_times(self.value, other.value), (one[0] + two[0], one[1] + two[1]))

    def _monotone(self, value: Range, slope: Range) -> "Interval":
        return Interval(value, _times(slope, self.slopes))

    def square(self) -> "Interval":
        low, high = self.value
        near = np.where((low <= 0) & (high >= 0), 0.0, np.minimum(abs(low), abs(high)))
        far = np.maximum(abs(low), abs(high))
        return self._monotone((near * near, far * far), (2 * low, 2 * high))

    def sqrt(self) -> "Interval":
        low, high = np.sqrt(self.value[0]), np.sqrt(self.value[1])
        return self._monotone((low, high), (0.5 / high, 0.5 / low))

    def inverse(self) -> "Interval":
        """Of a number above zero."""
        low, high = 1 / np.where(self.value[0] > 0, self.value, np.nan)[::-1]
        return self._monotone((low, high), (-high * high, -low * low))

    def sin(self) -> "Interval":
        return self._monotone(_sine(self.value), _sine(_shifted(self.value)))

    def cos(self) -> "Interval":
        low, high = _sine(self.value)
        return self._monotone(_sine(_shifted(self.value)), (-high, -low))


def _shifted(value: Range) -> Range:
    return value[0] + np.pi / 2, value[1] + np.pi / 2


def _sine(value: Range) -> Range:
    low, high = np.sin(value[0]), np.sin(value[1])
    # the first peak or trough at or after the lower end
    peak = np.ceil((value[0] - np.pi / 2) / (2 * np.pi)) * 2 * np.pi + np.pi / 2
    trough = np.ceil((value[0] + np.pi / 2) / (2 * np.pi)) * 2 * np.pi - np.pi / 2
    return (
        np.where(trough <= value[1], -1.0, np.minimum(low, high)),
        np.where(peak <= value[1], 1.0, np.maximum(low, high)),
    )


def unknowns(low: Float[np.ndarray, "b u"], high: Float[np.ndarray, "b u"]) -> list[Interval]:
    """Those of boxes, by their lower and upper ends: box by box along the first axis of values."""
    one = np.eye(low.shape[1])[:, :, None, None]
    return [Interval((low[:, i, None], high[:, i, None]), (one[i], one[i])) for i in range(low.shape[1])]


@dataclass(frozen=True)
class Lift:
    """Makes a constant of a rational number or an array, of which no unknown's derivative is other than zero."""

    count: int  # of unknowns

    def __call__(self, value: fmpq | int | np.ndarray) -> Interval:
        number = np.atleast_1d(np.asarray(float(value) if isinstance(value, fmpq | int) else value))
        zero = np.zeros((self.count, 1, 1))
        return Interval((number, number), (zero, zero))
