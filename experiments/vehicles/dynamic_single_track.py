"""A car with tyres: they slip sideways, and what they push with follows from the angle at which they do.

    python -m cfjax.train +path=circle vehicle=custom \
        vehicle.target=experiments.vehicles.dynamic_single_track.DynamicSingleTrack \
        'sets.inlet=[0.2,0.2,0.2,0.2,0.1,0.5]' 'sets.goal=[0.5,0.5,0.5,0.5,0.5,2]' 'sets.safe=[1,1,1,1,0.5,3]'

The single-track (bicycle) model with linear tyres, about the centre of gravity, as in Rajamani, Vehicle Dynamics and
Control, ch. 2: with the speeds v_x along the body and v_y across it (m/s, to the left), the yaw rate r (rad/s) and the
steering angle δ (rad)

    m (v̇_y + v_x r) = F_f + F_r,      I_z ṙ = l_f F_f − l_r F_r,
    F_f = C_f (δ − (v_y + l_f r)/v_x),      F_r = −C_r (v_y − l_r r)/v_x,

and v̇_x = thrust + v_y r. Small angles are taken for their tangents, and the front tyres push across the body. The
numbers are those of the F1TENTH car. A tyre that slides is no part of the model: its force grows with the slip angle
without end.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import jax.numpy as jnp

from cfjax.problem import Interval, Twist, Vehicle


@dataclass(frozen=True)
class DynamicSingleTrack(Vehicle):
    """States v_x, v_y and yaw rate beside the pose; inputs are the steering angle and the thrust over the mass."""

    mass: float = 3.74  # kg
    inertia: float = 0.04712  # kg m², about the vertical axis
    front: float = 0.15875  # m, from the centre of gravity to the front axle
    rear: float = 0.17145  # m, to the rear axle
    front_stiffness: float = 94.3  # N/rad, of both tyres of the axle
    rear_stiffness: float = 100.9  # N/rad
    max_steering: float = 0.4189  # rad
    max_thrust: float = 4.0  # m/s²

    name: ClassVar[str] = "dynamic_single_track"
    internal_names: ClassVar[tuple[str, ...]] = ("v_x", "v_y", "yaw_rate")
    internal_units: ClassVar[tuple[str, ...]] = ("m/s", "m/s", "rad/s")
    input_names: ClassVar[tuple[str, ...]] = ("steering", "thrust")

    @property
    def input_box(self) -> tuple[Interval, ...]:
        steering, thrust = self.max_steering, self.max_thrust
        return Interval(-steering, steering), Interval(-thrust, thrust)

    @property
    def wheelbase(self) -> float:
        return self.front + self.rear

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        v_x, v_y, yaw_rate = internal
        return Twist(turn=yaw_rate, lateral=-v_y, forward=v_x)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        (v_x, v_y, yaw_rate), (steering, thrust) = internal, inputs
        front = self.front_stiffness * (steering - (v_y + self.front * yaw_rate) / v_x)
        rear = -self.rear_stiffness * ((v_y - self.rear * yaw_rate) / v_x)
        return (
            thrust + v_y * yaw_rate,
            (front + rear) / self.mass - v_x * yaw_rate,
            (self.front * front - self.rear * rear) / self.inertia,
        )

    def reference(self, turn_rate: Any, speed: Any) -> tuple[Twist, tuple]:
        """The steady turn: the rear axle carries l_f/l of m v_x ω, which says what v_y is; v_x² solves a quadratic."""
        give = self.mass * self.front / (self.wheelbase * self.rear_stiffness)  # s²/m
        linear, rest = 1 - 2 * self.rear * give * turn_rate**2, speed**2 - (self.rear * turn_rate) ** 2
        square = 2 * rest / (linear + jnp.sqrt(linear**2 + (2 * give * turn_rate) ** 2 * rest))
        v_x, v_y = jnp.sqrt(square), turn_rate * (self.rear - give * square)
        return Twist(turn=turn_rate, lateral=-v_y, forward=v_x), (v_x, v_y, turn_rate)
