"""Plants: what the controller drives, in SI units of the world frame.

A plant starts from a car's state (α, x, y, ξ…): heading in rad (0 looks along +y), position of the reference point in
m, internal states; of a bicycle the reference point is the middle of the rear axle and ξ = v, its forward speed in m/s.
It is told physical commands, `Vehicle.command`: of a bicycle the steering angle in rad, left positive, and the thrust
in m/s². What lies between, servos, tyres, bodies, is its own.

There are two kinds. A `Plant` is a differential equation, pure functions of one car that the loop batches and
integrates. A `HostPlant` (`cfjax.plants.host`) is somebody else's simulator, which is told how long a command is held.
"""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from cfjax.coerce import instance, numbers, objects, real
from cfjax.coerce import number as finite
from cfjax.errors import InputError
from cfjax.problem import KinematicBicycle, Vehicle


def number(value: Any) -> Array:
    """An array: what is changed from run to run must not be compiled in.

    Raises:
        InputError: for what is no number, and no array of numbers.
    """
    if isinstance(value, Array):
        return jnp.asarray(value, float)
    if real(value) is None:
        return jnp.asarray(numbers("plant", value, "a finite number or a list of finite numbers"), float)
    return jnp.asarray(finite("plant", value), float)


def vehicle_of(value: Any) -> Vehicle:
    """A vehicle; raises InputError for anything else."""
    return instance("vehicle", value, Vehicle)


class Scene(NamedTuple):
    """What a hostile world knows: the reference's heading α_r (rad), and ∂V/∂x at the car's deviation in its frame."""

    heading: Float[Array, ""]
    gradient: Float[Array, " n"]


class Plant(eqx.Module):
    """A plant as a differential equation. Its numbers are leaves of a pytree: changing them compiles nothing."""

    @property
    @abc.abstractmethod
    def longest_step(self) -> float:
        """s: of an explicit method of fifth order with constant steps; infinite where nothing is stiff."""

    @abc.abstractmethod
    def start(self, state: Float[Array, " n"]) -> Float[Array, " z"]:
        """The plant's own state where the car is put down: servos at rest, straight ahead."""

    @abc.abstractmethod
    def draw(self, key: PRNGKeyArray, time: Float[Array, ""]) -> Float[Array, " d"]:
        """What chance holds for the coming control period; `key` is the car's, the same all along, `time` in s."""

    @abc.abstractmethod
    def rate(
        self, z: Float[Array, " z"], command: Float[Array, " m"], draw: Float[Array, " d"], scene: Scene
    ) -> Float[Array, " z"]:
        """dz/dt."""

    @abc.abstractmethod
    def observe(self, z: Float[Array, " z"]) -> Float[Array, " n"]:
        """The car's state (α, x, y, ξ…) as it is."""


def bicycle(vehicle: Vehicle, plant: str) -> KinematicBicycle:
    """The vehicle, which has to be one that is steered by an angle and a thrust.

    Raises:
        InputError: for any other.
    """
    objects(vehicle=(vehicle, Vehicle))
    if not isinstance(vehicle, KinematicBicycle):
        raise InputError(f"plant: expected a run of a kinematic_bicycle for {plant}, got one of {vehicle.name}")
    return vehicle
