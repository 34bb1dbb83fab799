"""Vehicles: what moves, said once.

A vehicle is equivariant under planar motions: its pose (heading alpha, position x, y) enters the dynamics only through
the rigid motion itself. So a vehicle is its **body twist** (turn rate, lateral and forward velocity, in its own frame)
and the rates of its **internal states** (speed, and whatever else it has), both affine in its inputs. The deviation
dynamics along any path follow from that (`cfjax.problem.deviation`), and so do simulation, falsification and proof.

Frame: at heading alpha the body's forward axis is (−sin α, cos α), its lateral axis (cos α, sin α), as in the paper.
The functions take and return tuples of scalars: one sample, nothing batched, so that the same definition can be traced
into the expression graph on which a proof is built.
"""

import abc
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp

from cfjax.errors import InputError


Scalar = Any  # a float, a traced JAX scalar or any other number: the definition does not care


class Twist(NamedTuple):
    """Velocity of a rigid body in its own frame."""

    turn: Scalar  # rad/s, counter-clockwise
    lateral: Scalar  # m/s, along (cos α, sin α)
    forward: Scalar  # m/s, along (−sin α, cos α)


@dataclass(frozen=True)
class Interval:
    """A closed interval of real numbers, in the unit of what it bounds."""

    lower: float
    upper: float

    def __post_init__(self) -> None:
        if not float("-inf") < self.lower <= self.upper < float("inf"):
            raise InputError(f"an interval needs finite ends, lower first; got [{self.lower}, {self.upper}]")

    @property
    def middle(self) -> float:
        return 0.5 * (self.lower + self.upper)

    @property
    def half(self) -> float:
        return 0.5 * (self.upper - self.lower)

    def __contains__(self, value: float) -> bool:
        return bool(self.lower <= value <= self.upper)


class Vehicle(abc.ABC):
    """A planar vehicle: body twist and internal states, affine in its inputs."""

    name: ClassVar[str]
    internal_names: ClassVar[tuple[str, ...]]
    input_names: ClassVar[tuple[str, ...]]

    @property
    @abc.abstractmethod
    def input_box(self) -> tuple[Interval, ...]:
        """Limits of the inputs, in the order of `input_names`."""

    @abc.abstractmethod
    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        """Body twist at the given internal states and inputs; affine in the inputs."""

    @abc.abstractmethod
    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        """Time derivatives of the internal states; affine in the inputs."""

    @abc.abstractmethod
    def reference(self, turn_rate: Scalar, speed: Scalar) -> tuple[Twist, tuple]:
        """Body twist and internal states of the vehicle that moves along the path (turn rate rad/s, speed m/s)."""

    def command(self, inputs: tuple) -> tuple:
        """What the actuators are told, in the order of `command_names`: the inputs themselves unless a vehicle says."""
        return inputs

    @property
    def command_names(self) -> tuple[str, ...]:
        """Names of the physical command's entries, each with its unit where it is no input itself."""
        return self.input_names

    @property
    def brakes(self) -> tuple[tuple[str, str], ...]:
        """Inputs that bring an internal state to rest, with its name: such an input is that state's very rate.

        A controller that cannot trust what it is told brings them to rest as fast as the box allows, and holds the
        others as they were.
        """
        return ()

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the deviation's coordinates: heading, lateral, longitudinal, then the internal states."""
        return ("alpha", "x", "y", *self.internal_names)


@dataclass(frozen=True)
class KinematicBicycle(Vehicle):
    """The paper's car (eq. bicycle-model): rear axle as reference point, no tyre slip.

    ẋ = −v sin α, ẏ = v cos α, α̇ = (v/l) w, v̇ = T with w = tan γ: affine in (w, T), and |γ| ≤ π/4 is the box |w| ≤ 1.
    """

    wheelbase: float = 0.34  # m, the Parkour car
    max_tan_steering: float = 1.0  # tan of the largest steering angle
    max_thrust: float = 4.0  # m/s²

    name: ClassVar[str] = "kinematic_bicycle"
    internal_names: ClassVar[tuple[str, ...]] = ("v",)
    input_names: ClassVar[tuple[str, ...]] = ("w", "thrust")

    def __post_init__(self) -> None:
        for label in ("wheelbase", "max_tan_steering", "max_thrust"):
            value = getattr(self, label)
            if not 0 < value < float("inf"):
                raise InputError(f"vehicle.{label}: expected a positive finite number, got {value}")

    @property
    def input_box(self) -> tuple[Interval, ...]:
        w, thrust = self.max_tan_steering, self.max_thrust
        return Interval(-w, w), Interval(-thrust, thrust)

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        (v,), (w, _) = internal, inputs
        return Twist(turn=v / self.wheelbase * w, lateral=0.0, forward=v)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        _, (_, thrust) = internal, inputs
        return (thrust,)

    def reference(self, turn_rate: Scalar, speed: Scalar) -> tuple[Twist, tuple]:
        return Twist(turn=turn_rate, lateral=0.0, forward=speed), (speed,)

    def command(self, inputs: tuple) -> tuple:
        """Steering angle γ = atan w in rad, left positive, and thrust in m/s²."""
        w, thrust = inputs
        return jnp.arctan(w), thrust

    @property
    def command_names(self) -> tuple[str, ...]:
        return "steering angle, rad", "thrust, m/s^2"

    @property
    def brakes(self) -> tuple[tuple[str, str], ...]:
        return (("thrust", "v"),)
