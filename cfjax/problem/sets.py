"""Sets of deviations: where the car may start, must end, and has to stay.

All are centred on the reference and closed. I and G are ellipsoids {xᵀ P x ≤ 1}; S is a box.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cfjax.errors import InputError


def _all_positive(label: str, values: tuple[float, ...]) -> None:
    if not values or not all(0 < value < float("inf") for value in values):
        raise InputError(f"{label}: expected positive finite numbers, got {list(values)}")


@dataclass(frozen=True)
class Ellipsoid:
    """{Σ (x_i / half_axes_i)² ≤ 1}, one half-axis per state, in the state's unit."""

    half_axes: tuple[float, ...]

    def __post_init__(self) -> None:
        _all_positive("half-axes of an ellipsoid", self.half_axes)

    @property
    def shape(self) -> Float[np.ndarray, "n n"]:
        """P with {xᵀ P x ≤ 1}."""
        return np.diag(1.0 / np.square(self.half_axes))


@dataclass(frozen=True)
class Box:
    """{|x_i| ≤ half_widths_i}, one half-width per state, in the state's unit."""

    half_widths: tuple[float, ...]

    def __post_init__(self) -> None:
        _all_positive("half-widths of a box", self.half_widths)


def ball(radius: float, dimension: int = 4) -> Ellipsoid:
    """The ball of the given radius (mixed units, as in the paper: rad, m, m, m/s)."""
    return Ellipsoid((float(radius),) * dimension)
