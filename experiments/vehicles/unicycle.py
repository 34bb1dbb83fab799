"""A unicycle, as a robot with two driven wheels is one: it turns on the spot, and its speed is a state.

python -m cfjax.train +path=circle vehicle=custom vehicle.target=experiments.vehicles.unicycle.Unicycle
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from cfjax.problem import Interval, Twist, Vehicle


@dataclass(frozen=True)
class Unicycle(Vehicle):
    """α̇ = turn, v̇ = thrust, along its own axis."""

    max_turn: float = 3.0  # rad/s
    max_thrust: float = 4.0  # m/s²

    name: ClassVar[str] = "unicycle"
    internal_names: ClassVar[tuple[str, ...]] = ("v",)
    internal_units: ClassVar[tuple[str, ...]] = ("m/s",)
    input_names: ClassVar[tuple[str, ...]] = ("turn", "thrust")

    @property
    def input_box(self) -> tuple[Interval, ...]:
        return Interval(-self.max_turn, self.max_turn), Interval(-self.max_thrust, self.max_thrust)

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        (v,), (turn, _) = internal, inputs
        return Twist(turn=turn, lateral=0.0, forward=v)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        _, thrust = inputs
        return (thrust,)

    def reference(self, turn_rate: Any, speed: Any) -> tuple[Twist, tuple]:
        return Twist(turn=turn_rate, lateral=0.0, forward=speed), (speed,)
