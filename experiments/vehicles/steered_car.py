"""A car whose steering takes time: the tangent of the steering angle is a state, and its rate an input.

    python -m cfjax.train +path=circle vehicle=custom vehicle.target=experiments.vehicles.steered_car.SteeredCar \
        sets.inlet=0.2 sets.goal=0.6 'sets.safe=[1,1,1,3,0.7]'

With w = tan δ the model stays polynomial. A servo with |dδ/dt| <= r can do whatever is asked with |dw/dt| <= r, for
dw/dt = (1 + w²) dδ/dt. The end of the steering's range is a part of S: on a circle of 1.5 m w is 0.23, and
|deviation| <= 0.7 keeps |w| below 0.93.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from cfjax.problem import Interval, Twist, Vehicle


@dataclass(frozen=True)
class SteeredCar(Vehicle):
    """The kinematic bicycle with ẇ = steering rate, v̇ = thrust."""

    wheelbase: float = 0.34  # m
    max_steering_rate: float = 8.0  # 1/s, of w
    max_thrust: float = 4.0  # m/s²

    name: ClassVar[str] = "steered_car"
    internal_names: ClassVar[tuple[str, ...]] = ("v", "w")
    internal_units: ClassVar[tuple[str, ...]] = ("m/s", "")
    input_names: ClassVar[tuple[str, ...]] = ("thrust", "steering_rate")

    @property
    def input_box(self) -> tuple[Interval, ...]:
        thrust, rate = self.max_thrust, self.max_steering_rate
        return Interval(-thrust, thrust), Interval(-rate, rate)

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        v, w = internal
        return Twist(turn=v * w / self.wheelbase, lateral=0.0, forward=v)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        return inputs

    def reference(self, turn_rate: Any, speed: Any) -> tuple[Twist, tuple]:
        return Twist(turn=turn_rate, lateral=0.0, forward=speed), (speed, self.wheelbase * turn_rate / speed)
