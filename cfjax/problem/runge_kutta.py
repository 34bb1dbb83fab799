"""One step of classical Runge–Kutta of fourth order, of NumPy's arrays and JAX's alike."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jax import Array


State = TypeVar("State", Array, np.ndarray)


def runge_kutta(rate: Callable[[State], State], z: State, h: Array | float) -> State:
    """z after h along dz = rate(z), an array of any shape; its error is of fifth order in h."""
    first = rate(z)
    second = rate(z + 0.5 * h * first)
    third = rate(z + 0.5 * h * second)
    fourth = rate(z + h * third)
    return z + h / 6 * (first + 2 * (second + third) + fourth)
