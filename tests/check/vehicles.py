"""Vehicles that the checker does not know, for its tests: what their references do differs."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import jax.numpy as jnp

from cfjax.problem import Interval, KinematicBicycle, Twist, Vehicle
from experiments.vehicles.steered_car import SteeredCar
from experiments.vehicles.unicycle import Unicycle


@dataclass(frozen=True)
class Ship(Unicycle):
    """It drifts sideways, by a state, and its reference does not; nested functions of no pose."""

    name: ClassVar[str] = "ship"
    internal_names: ClassVar[tuple[str, ...]] = ("v", "drift")

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        v, drift = internal
        turn, _ = inputs
        return Twist(turn=turn * jnp.cos(jnp.sin(drift)), lateral=drift * v, forward=v + drift**2)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        (v, drift), (turn, thrust) = internal, inputs
        return thrust, -drift + turn * v

    def reference(self, turn_rate: Any, speed: Any) -> tuple[Twist, tuple]:
        return Twist(turn=turn_rate, lateral=0.0, forward=speed), (speed, 0.0 * speed)


@dataclass(frozen=True)
class SeenAhead(KinematicBicycle):
    """The car by a point ahead of its rear axle: to keep that on a path it looks away from it where it turns."""

    name: ClassVar[str] = "seen_ahead"
    ahead: float = 0.02  # m

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        turn, _, forward = super().twist(internal, inputs)
        return Twist(turn, -self.ahead * turn, forward)

    def reference(self, turn_rate: Any, speed: Any) -> tuple[Twist, tuple]:
        across = self.ahead * turn_rate
        forward = jnp.sqrt(speed**2 - across**2)
        return Twist(turn_rate, -across, forward), (forward,)


@dataclass(frozen=True)
class Crab(Unicycle):
    """It looks away from where it moves, by one angle."""

    name: ClassVar[str] = "crab"
    angle: float = 0.3  # rad

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        turn, _, forward = super().twist(internal, inputs)
        return Twist(turn, jnp.sin(self.angle) * forward, jnp.cos(self.angle) * forward)

    def reference(self, turn_rate: Any, speed: Any) -> tuple[Twist, tuple]:
        return Twist(turn_rate, math.sin(self.angle) * speed, math.cos(self.angle) * speed), (speed,)


@dataclass(frozen=True)
class Cart(Vehicle):
    """Its speed is an input and its steering a state: the reference's changes with the path's curvature."""

    max_speed: float = 2.0  # m/s
    max_rate: float = 8.0  # 1/s

    name: ClassVar[str] = "cart"
    internal_names: ClassVar[tuple[str, ...]] = ("w",)
    input_names: ClassVar[tuple[str, ...]] = ("speed", "rate")

    @property
    def input_box(self) -> tuple[Interval, ...]:
        return Interval(0.0, self.max_speed), Interval(-self.max_rate, self.max_rate)

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        (w,), (speed, _) = internal, inputs
        return Twist(turn=speed * w, lateral=0.0, forward=speed)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        return inputs[1:]

    def reference(self, turn_rate: Any, speed: Any) -> tuple[Twist, tuple]:
        return Twist(turn=turn_rate, lateral=0.0, forward=speed), (turn_rate / speed,)


@dataclass(frozen=True)
class Rooted(SteeredCar):
    """Five states, and a square root of one among the factors of its rates."""

    name: ClassVar[str] = "rooted"

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        v, w = internal
        forward = v * jnp.sqrt(1 + w**2)
        return Twist(turn=forward * w / self.wheelbase, lateral=0.0, forward=forward)

    def reference(self, turn_rate: Any, speed: Any) -> tuple[Twist, tuple]:
        w = self.wheelbase * turn_rate / speed
        return Twist(turn=turn_rate, lateral=0.0, forward=speed), (speed / jnp.sqrt(1 + w**2), w)


@dataclass(frozen=True)
class Dragged(SteeredCar):
    """Five states, and a square root of one added to its rates."""

    name: ClassVar[str] = "dragged"
    drag: float = 0.1  # m/s²

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        (v, _), (thrust, rate) = internal, inputs
        return thrust - self.drag * (jnp.sqrt(v**2 + 1.0) - 1.0), rate


@dataclass(frozen=True)
class Hauler(Unicycle):
    """What it has is power: its acceleration is that over its speed, so that a rate divides by a state."""

    name: ClassVar[str] = "hauler"
    input_names: ClassVar[tuple[str, ...]] = ("turn", "power")  # rad/s, m²/s³

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        (v,), (_, power) = internal, inputs
        return (power / v,)
