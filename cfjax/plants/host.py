"""Plants of other people: simulators that are stepped, one car after another, outside of JAX."""

import abc
import importlib
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from cfjax.errors import InputError


WHEELBASE_ERROR = 0.1  # relative: what a run's wheelbase may differ by from the car's


class HostPlant(abc.ABC):
    """Somebody else's simulator: called car by car from Python, so it takes some tens of cars, not thousands."""

    name: ClassVar[str]

    @abc.abstractmethod
    def start(self, states: Float[np.ndarray, "k n"]) -> list[Any]:
        """One state of its own for each car."""

    @abc.abstractmethod
    def hold(self, own: Any, command: Float[np.ndarray, " m"], duration: float) -> Any:
        """The state of one car after `duration` seconds at this command; anything may be raised, or not be finite."""

    @abc.abstractmethod
    def observe(self, own: Any) -> Float[np.ndarray, " n"]:
        """The car's state (α, x, y, v) as it is."""


def extra(module: str, package: str) -> Any:
    """A module of an optional package.

    Raises:
        InputError: where it is not installed; says what to install.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise InputError(
            f"plant: expected the package {package}, which is not installed (pip install {package}, or cfjax[plants])"
        ) from error


def fits(wheelbase: float, own: float, plant: str) -> None:
    """Raises InputError where a run is about a car of another size than the plant's (m)."""
    if not abs(wheelbase - own) <= WHEELBASE_ERROR * own:
        raise InputError(
            f"plant: expected a run with vehicle.wheelbase within {100 * WHEELBASE_ERROR:g} % of {own:.4g} m for "
            f"{plant}, whose car has that size, got {wheelbase:g} m"
        )
