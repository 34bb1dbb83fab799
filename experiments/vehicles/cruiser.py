"""A car at one speed: three states, one input, so that proofs take a second. Numbers are those of a car of full size.

python -m cfjax.train +path=straight path.speed=2.8 path.length=14 law=linear \
    vehicle=custom vehicle.target=experiments.vehicles.cruiser.Cruiser
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from cfjax.problem import Interval, Twist, Vehicle


@dataclass(frozen=True)
class Cruiser(Vehicle):
    """Its rear axle is the reference point; w is the tangent of the steering angle. It follows paths at its speed."""

    speed: float = 2.8  # m/s
    wheelbase: float = 1.75  # m
    max_tan_steering: float = 0.6989  # of 0.61 rad

    name: ClassVar[str] = "cruiser"
    internal_names: ClassVar[tuple[str, ...]] = ()
    input_names: ClassVar[tuple[str, ...]] = ("w",)

    @property
    def input_box(self) -> tuple[Interval, ...]:
        return (Interval(-self.max_tan_steering, self.max_tan_steering),)

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        return Twist(turn=self.speed / self.wheelbase * inputs[0], lateral=0.0, forward=self.speed)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        return ()

    def reference(self, turn_rate: Any, speed: Any) -> tuple[Twist, tuple]:
        return Twist(turn=turn_rate, lateral=0.0, forward=speed), ()
