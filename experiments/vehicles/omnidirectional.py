"""A robot on omnidirectional wheels: it moves in any direction while it turns; the pose is all of its state.

    python -m cfjax.train +path=circle sets.safe=null \
        vehicle=custom vehicle.target=experiments.vehicles.omnidirectional.Omnidirectional
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from cfjax.problem import Interval, Twist, Vehicle


@dataclass(frozen=True)
class Omnidirectional(Vehicle):
    """α̇ = turn; the velocity along both of its own axes is an input."""

    max_turn: float = 3.0  # rad/s
    max_speed: float = 3.0  # m/s, along each axis

    name: ClassVar[str] = "omnidirectional"
    internal_names: ClassVar[tuple[str, ...]] = ()
    input_names: ClassVar[tuple[str, ...]] = ("turn", "lateral", "forward")

    @property
    def input_box(self) -> tuple[Interval, ...]:
        speed = Interval(-self.max_speed, self.max_speed)
        return Interval(-self.max_turn, self.max_turn), speed, speed

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        turn, lateral, forward = inputs
        return Twist(turn=turn, lateral=lateral, forward=forward)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        return ()

    def reference(self, turn_rate: Any, speed: Any) -> tuple[Twist, tuple]:
        return Twist(turn=turn_rate, lateral=0.0, forward=speed), ()
