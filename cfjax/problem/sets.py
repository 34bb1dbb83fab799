"""Sets of deviations: where the car may start, must end, and has to stay.

All are centred on the reference and closed. I and G are ellipsoids {xᵀ P x ≤ 1}; S is a box.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cfjax.coerce import Number, Numbers, keep, listed, number, numbers, real, refuse, whole


NO_LIMIT = 100  # of a position in m, or a speed in m/s: to be written where S has no limit
MOST_STATES = 100  # of a ball: far more than any proof takes


@dataclass(frozen=True)
class Ellipsoid:
    """{Σ (x_i / half_axes_i)² ≤ 1}, one half-axis per state, in the state's unit."""

    half_axes: tuple[float, ...]

    def __init__(self, half_axes: Numbers) -> None:
        keep(self, half_axes=_positive("half-axes of an ellipsoid", half_axes))

    @property
    def shape(self) -> Float[np.ndarray, "n n"]:
        """P with {xᵀ P x ≤ 1}."""
        return np.diag(1.0 / np.square(self.half_axes))


@dataclass(frozen=True)
class Box:
    """{|x_i| ≤ half_widths_i}, one half-width per state, in the state's unit."""

    half_widths: tuple[float, ...]

    def __init__(self, half_widths: Numbers) -> None:
        keep(self, half_widths=_positive("half-widths of a box", half_widths))


def ball(radius: Number, dimension: int = 4) -> Ellipsoid:
    """The ball of the given radius (mixed units, as in the paper: rad, m, m, m/s), one half-axis per state.

    >>> ball(0.5)
    Ellipsoid(half_axes=(0.5, 0.5, 0.5, 0.5))

    Raises:
        InputError: for a radius that is not positive, or no number of states.
    """
    return Ellipsoid(
        (number("radius of a ball", radius, above=0),) * whole("dimension of a ball", dimension, 1, MOST_STATES)
    )


def ellipsoid(name: str, value: object, states: Sequence[str]) -> Ellipsoid:
    """A set of deviations in these states: an ellipsoid, one half-axis per state, or a number, the radius of a ball.

    Raises:
        InputError: for anything else.
    """
    return Ellipsoid(_per_state(name, value.half_axes if isinstance(value, Ellipsoid) else value, states))


def box(name: str, value: object, states: Sequence[str]) -> Box:
    """Likewise a box, by its half-widths."""
    given = listed(value)
    if given is not None and None in given:
        refuse(name, f"{len(states)} numbers, a large one, such as {NO_LIMIT}, where there is no limit", value)
    return Box(_per_state(name, value.half_widths if isinstance(value, Box) else value, states))


def _per_state(name: str, value: object, states: Sequence[str]) -> tuple[float, ...]:
    given = listed(value)
    if given is None and real(value) is not None:
        return (number(name, value, above=0),) * len(states)
    if given is None or len(given) != len(states):
        refuse(name, f"a number or {len(states)} numbers, one per state ({', '.join(states)})", value)
    return numbers(name, given, above=0)


def _positive(name: str, value: object) -> tuple[float, ...]:
    return numbers(name, value, above=0) or refuse(name, "positive finite numbers, one per state", value)
