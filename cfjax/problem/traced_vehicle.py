"""A vehicle as JAX traces it: all that compiled programs may know of it.

Its functions are evaluated from their jaxprs, not by the code of the class. So a program that was compiled for a traced
vehicle is the right one wherever the jaxprs are the same, whatever modules the class imports (`cfjax.identity`).
"""

from collections.abc import Callable, Sequence
from functools import cache

import jax
import jax.numpy as jnp
from jax.extend import core

from cfjax.coerce import keep
from cfjax.problem.deviation import ReferencePoint
from cfjax.problem.feedback import Steered
from cfjax.problem.vehicle import Interval, Scalar, Twist, Vehicle


@cache
def traced_vehicle(vehicle: Vehicle) -> "TracedVehicle":
    """The same one for equal vehicles, so that programs for it are found again."""
    return TracedVehicle(vehicle)


class TracedVehicle(Vehicle):
    """Twist, rates of the internal states, reference and, where it has one, law of a vehicle.

    Scalars may be arrays of one shape.
    """

    _box: tuple[Interval, ...]
    _twist: core.ClosedJaxpr
    _internal_rate: core.ClosedJaxpr
    _reference: core.ClosedJaxpr
    _feedback: core.ClosedJaxpr | None

    def __init__(self, vehicle: Vehicle) -> None:
        states, inputs = vehicle.internal_names, vehicle.input_names
        count = len(states)

        def split(function: Callable) -> Callable[..., Sequence[Scalar]]:
            return lambda *scalars: function(scalars[:count], scalars[count:])

        def reference(*scalars: Scalar) -> Sequence[Scalar]:
            twist, internal = vehicle.reference(*scalars)
            return *twist, *internal

        keep(self, name=vehicle.name, internal_names=states, input_names=inputs)
        self._box = vehicle.input_box
        self._twist = _jaxpr(split(vehicle.twist), count + len(inputs))
        self._internal_rate = _jaxpr(split(vehicle.internal_rate), count + len(inputs))
        self._reference = _jaxpr(reference, 2)
        self._feedback = None
        if isinstance(vehicle, Steered):
            size = len(vehicle.state_names)
            self._feedback = _jaxpr(
                lambda *scalars: vehicle.feedback(scalars[:size], ReferencePoint(*scalars[size:])),
                size + len(ReferencePoint._fields),
            )

    @property
    def input_box(self) -> tuple[Interval, ...]:
        return self._box

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        return Twist(*_evaluated(self._twist, (*internal, *inputs)))

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        return _evaluated(self._internal_rate, (*internal, *inputs))

    def reference(self, turn_rate: Scalar, speed: Scalar) -> tuple[Twist, tuple]:
        turn, lateral, forward, *internal = _evaluated(self._reference, (turn_rate, speed))
        return Twist(turn, lateral, forward), tuple(internal)

    def feedback(self, x: Sequence[Scalar], reference: ReferencePoint) -> tuple[Scalar, ...] | None:
        return None if self._feedback is None else _evaluated(self._feedback, (*x, *reference))


def _jaxpr(function: Callable[..., Sequence[Scalar]], count: int) -> core.ClosedJaxpr:
    """Of a function of so many scalars, which returns scalars."""
    scalar = jax.ShapeDtypeStruct((), float)
    return jax.make_jaxpr(lambda *scalars: [jnp.asarray(each, float) for each in function(*scalars)])(*[scalar] * count)


def _evaluated(jaxpr: core.ClosedJaxpr, scalars: Sequence[Scalar]) -> tuple:
    function = jnp.vectorize(lambda *each: tuple(core.jaxpr_as_fun(jaxpr)(*each)))
    return function(*(jnp.asarray(scalar, float) for scalar in scalars))
