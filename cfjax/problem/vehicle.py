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
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp

from cfjax.coerce import Number, keep, listed, number, refuse
from cfjax.errors import InputError


SHORTEST_WHEELBASE, LONGEST_WHEELBASE = 0.005, 25.0  # m: beyond, a number is in mm or cm
LONG_WHEELBASE = 10.0  # m: beyond, there are no cars, but long lorries
MOST_STEERING, LARGE_STEERING = 70.0, 50.0  # degrees: beyond, no wheel turns, and few do
MOST_THRUST, LARGE_THRUST = 100.0, 30.0  # m/s², ten times gravity and three: beyond, a number is a force

Scalar = Any  # a float, a traced JAX scalar or any other number: the definition does not care


class Twist(NamedTuple):
    """Velocity of a rigid body in its own frame."""

    turn: Scalar  # rad/s, counter-clockwise
    lateral: Scalar  # m/s, along (cos α, sin α)
    forward: Scalar  # m/s, along (−sin α, cos α)


@dataclass(frozen=True)
class Interval:
    """A closed interval of real numbers, in the unit of what it bounds.

    Raises:
        InputError: for ends that are no finite numbers, or the larger one first.
    """

    lower: float
    upper: float

    def __init__(self, lower: Number, upper: Number) -> None:
        low, high = number("lower end of an interval", lower), number("upper end of an interval", upper)
        if low > high:
            raise InputError(f"interval: expected finite ends, the lower first, got [{lower}, {upper}]")
        keep(self, lower=low, upper=high)

    @property
    def middle(self) -> float:
        return 0.5 * (self.lower + self.upper)

    @property
    def half(self) -> float:
        return 0.5 * (self.upper - self.lower)

    def __contains__(self, value: float) -> bool:
        return bool(self.lower <= value <= self.upper)

    def __str__(self) -> str:
        return f"[{self.lower:g}, {self.upper:g}]"


def interval(name: str, value: object, unit: str = "") -> Interval:
    """An interval, or the two numbers of one.

    Raises:
        InputError: for anything else.
    """
    if isinstance(value, Interval):
        return value
    ends = listed(value)
    if ends is None or len(ends) != 2:
        refuse(name, f"an interval [lower, upper]{f' ({unit})' if unit else ''}", value)
    try:
        return Interval(*ends)
    except InputError:
        refuse(name, "an interval of finite numbers, the lower one first", value)


class Vehicle(abc.ABC):
    """A planar vehicle: body twist and internal states, affine in its inputs."""

    name: ClassVar[str]
    internal_names: ClassVar[tuple[str, ...]]
    internal_units: ClassVar[tuple[str, ...]] = ()  # of `internal_names`, "" for none; (): not known
    input_names: ClassVar[tuple[str, ...]]

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "internal_names" in vars(cls) and "internal_units" not in vars(cls):
            cls.internal_units = ()  # those of other states, else

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

    def feedback(self, x: Sequence[Scalar], reference: Any) -> tuple[Scalar, ...] | None:
        """The inputs that a law gives at a deviation beside a `ReferencePoint`, before they are limited.

        None: no law is part of the question, and inputs are free within their limits (`cfjax.problem.feedback`).
        """
        return None

    def command(self, inputs: tuple) -> tuple:
        """What the actuators are told, in the order of `command_names`: the inputs themselves unless a vehicle says."""
        return inputs

    @property
    def command_names(self) -> tuple[str, ...]:
        """Names of the physical command's entries, each with its unit where it is no input itself."""
        return self.input_names

    def beyond(self, name: str, value: float, limits: Interval) -> str:
        """An input that leaves its limits, as people know it: for messages."""
        return f"{name} = {value:.4g}, but the vehicle's {name} lies in {limits}"

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

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the deviation's coordinates; "" where none is known."""
        return ("rad", "m", "m", *(self.internal_units or [""] * len(self.internal_names)))

    @property
    def rate_units(self) -> tuple[str, ...]:
        """Units of their rates."""
        return tuple(f"{unit}²" if unit.endswith("/s") else f"{unit or '1'}/s" for unit in self.state_units)


@dataclass(frozen=True)
class KinematicBicycle(Vehicle):
    """The paper's car (eq. bicycle-model): rear axle as reference point, no tyre slip.

    ẋ = −v sin α, ẏ = v cos α, α̇ = (v/l) w, v̇ = T with w = tan γ: affine in (w, T), and |γ| ≤ π/4 is the box |w| ≤ 1.

    Args:
        wheelbase: l, m; the Parkour car's unless given.
        max_tan_steering: the tangent of the largest steering angle, not the angle: of 25 degrees it is 0.466.
        max_thrust: the largest |T|, m/s².

    Raises:
        InputError: for numbers that are not positive, or that only another unit explains. What another unit explains
            better is named where something is searched for (`cfjax.search`).
    """

    wheelbase: float = 0.34  # m
    max_tan_steering: float = 1.0
    max_thrust: float = 4.0  # m/s²

    name: ClassVar[str] = "kinematic_bicycle"
    internal_names: ClassVar[tuple[str, ...]] = ("v",)
    internal_units: ClassVar[tuple[str, ...]] = ("m/s",)
    input_names: ClassVar[tuple[str, ...]] = ("w", "thrust")

    def __post_init__(self) -> None:
        units = {"wheelbase": "m", "max_tan_steering": "", "max_thrust": "m/s²"}
        found = {
            label: number(f"vehicle.{label}", getattr(self, label), unit, above=0) for label, unit in units.items()
        }
        length, steering, thrust = found.values()
        if not SHORTEST_WHEELBASE <= length <= LONGEST_WHEELBASE:
            raise InputError(
                f"vehicle.wheelbase: expected m, from {SHORTEST_WHEELBASE:g} to {LONGEST_WHEELBASE:g}, got {length:g}"
                + _shorter(length)
            )
        if steering > (most := math.tan(math.radians(MOST_STEERING))):
            raise InputError(
                f"vehicle.max_tan_steering: expected the tangent of the largest steering angle, at most {most:.3g} "
                f"({MOST_STEERING:g} degrees), got {_steering(steering)}"
            )
        if thrust > MOST_THRUST:
            raise InputError(
                f"vehicle.max_thrust: expected m/s², at most {MOST_THRUST:g}, got {thrust:g}: no force in N"
            )
        keep(self, **found)

    @property
    def doubts(self) -> list[str]:
        """Numbers that another unit explains better, a line each."""
        length, steering, thrust = self.wheelbase, self.max_tan_steering, self.max_thrust
        lines = []
        if length > LONG_WHEELBASE:
            lines.append(f"vehicle.wheelbase: {length:g} m are more than cars have{_shorter(length)}")
        if steering > math.tan(math.radians(LARGE_STEERING)):
            lines.append(f"vehicle.max_tan_steering: more than cars have, {_steering(steering)}")
        if thrust > LARGE_THRUST:
            lines.append(f"vehicle.max_thrust: {thrust:g} m/s² are more than cars have; is it a force in N?")
        return lines

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

    def beyond(self, name: str, value: float, limits: Interval) -> str:
        if name != "w":
            return super().beyond(name, value, limits)
        limit = limits.lower if value < limits.lower else limits.upper
        angle, most = (math.degrees(math.atan(tangent)) for tangent in (value, limit))
        return f"steering angle {angle:.4g}°, limit {most:.4g}° (w = tan = {value:.4g})"

    @property
    def brakes(self) -> tuple[tuple[str, str], ...]:
        return (("thrust", "v"),)


def _shorter(length: float) -> str:
    """A length in m as it would be in smaller units, for messages about those that are too large."""
    if length <= LONG_WHEELBASE:
        return ""
    unit, metres = ("mm", 1e-3) if length >= 100 else ("cm", 1e-2)
    return f"; {length:g} {unit} are {length * metres:g} m"


def _steering(tangent: float) -> str:
    """The tangent of a steering angle with its angle, and what it would be if it were an angle, for messages."""
    text = f"{tangent:g}, an angle of {math.degrees(math.atan(tangent)):.3g} degrees"
    if tangent < 90:
        text += f"; {tangent:g} degrees have the tangent {math.tan(math.radians(tangent)):.4g}"
    return text


def numbers_of(vehicle: Vehicle) -> dict[str, Any]:
    """A vehicle's own numbers by name, where it is a dataclass."""
    return {field.name: getattr(vehicle, field.name) for field in fields(vehicle)} if is_dataclass(vehicle) else {}
