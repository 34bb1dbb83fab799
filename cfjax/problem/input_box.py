"""The inputs that a law may use, as arrays: a box, u0 first."""

import itertools
from collections.abc import Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from jaxtyping import Array, Float

from cfjax.problem.vehicle import Interval


Numbers = TypeVar("Numbers", Array, np.ndarray)


class InputBox(NamedTuple, Generic[Numbers]):
    """{lower ≤ v ≤ upper} of v = (u0, *vehicle inputs); a pytree, of NumPy's arrays or JAX's."""

    lower: Numbers  # (1 + m,)
    upper: Numbers

    @staticmethod
    def of(intervals: Sequence[Interval]) -> "InputBox[np.ndarray]":
        """The box with these sides, `Problem.inputs`."""
        return InputBox(np.array([side.lower for side in intervals]), np.array([side.upper for side in intervals]))

    @property
    def middle(self) -> Numbers:
        """Of each side."""
        return 0.5 * (self.lower + self.upper)

    @property
    def half(self) -> Numbers:
        """Half-widths; zero where there is no choice."""
        return 0.5 * (self.upper - self.lower)

    @property
    def vertices(self) -> Float[np.ndarray, "v m"]:
        """All of them, a row each."""
        return np.array(list(itertools.product(*zip(self.lower, self.upper, strict=True))))

    def extreme_point(self, direction: Numbers) -> Numbers:
        """The point v of the box with the largest direction · v, along the last axis; of a zero the side's middle."""
        return self.middle + self.half * ((direction > 0) - 1.0 * (direction < 0))
