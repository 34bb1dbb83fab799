"""A car that is steered by where its front axle is, as Stanley's law has it: the body looks to the outside of a bend.

    python -m cfjax.train +path=circle vehicle=custom vehicle.target=experiments.vehicles.front_axle.FrontAxleCar

The front wheels roll along the path; the body's heading is the path's tangent less the steering angle γ, and v is the
speed of the rear axle: on a path at speed v_r and turning rate ω, v = v_r cos γ and l ω = v_r sin γ.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import jax.numpy as jnp

from cfjax.problem import Interval, Twist, Vehicle


@dataclass(frozen=True)
class FrontAxleCar(Vehicle):
    """The kinematic bicycle, v̇ = thrust and w = tan γ; its position is that of the front axle."""

    wheelbase: float = 0.34  # m
    max_tan_steering: float = 1.0
    max_thrust: float = 4.0  # m/s²

    name: ClassVar[str] = "front_axle_car"
    internal_names: ClassVar[tuple[str, ...]] = ("v",)
    internal_units: ClassVar[tuple[str, ...]] = ("m/s",)
    input_names: ClassVar[tuple[str, ...]] = ("w", "thrust")

    @property
    def input_box(self) -> tuple[Interval, ...]:
        w, thrust = self.max_tan_steering, self.max_thrust
        return Interval(-w, w), Interval(-thrust, thrust)

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        (v,), (w, _) = internal, inputs
        return Twist(turn=v * w / self.wheelbase, lateral=-v * w, forward=v)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        _, thrust = inputs
        return (thrust,)

    def reference(self, turn_rate: Any, speed: Any) -> tuple[Twist, tuple]:
        across = self.wheelbase * turn_rate
        forward = jnp.sqrt(speed**2 - across**2)
        return Twist(turn=turn_rate, lateral=-across, forward=forward), (forward,)
