"""Vehicles that the checker knows by name: a certificate that uses the name has to have their dynamics.

Otherwise a file could print "kinematic_bicycle" and prove something about another car. The statement here is the
checker's own, written down from the paper; the certificate's graph comes from the definition of the vehicle in
`cfjax.problem`. The two are compared as polynomials in states, inputs, reference and the symbols sin α, cos α.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from flint import fmpq, fmpq_mpoly

from cfcheck.exact.graph import Graph
from cfcheck.exact.rational import Range
from cfcheck.reader import Broken
from cfcheck.vehicle.symbolic import Symbolic


POSE = ("alpha", "x", "y")  # in the plane, from the reference, in the body frame of that
POSE_UNITS = ("rad", "m", "m")
STATES, UNITS = (*POSE, "v"), (*POSE_UNITS, "m/s")  # of a car


@dataclass(frozen=True)
class VehicleClaim:
    """Whose dynamics: the deviation's rate as a graph over states, `input:…` and `reference:…`."""

    name: str
    parameters: Mapping[str, fmpq]
    states: tuple[str, ...]
    graph: Graph


@dataclass(frozen=True)
class KnownVehicle:
    """What a name stands for: parameters, states, inputs with their limits, and the deviation's rate.

    `state_units` and `said`, what it is, are for people alone.
    `factors(own, other)`: by what the inputs of a vehicle with the parameters `other` are multiplied where one with
    `own` moves as it does. `scaled(parameters, length, speed)`: the parameters of the vehicle whose motion is the same
    with lengths and speeds multiplied by these; `axes(length, speed)` and `units(length, speed)`: by what its states
    and inputs are then.
    """

    parameters: tuple[str, ...]
    said: str
    states: tuple[str, ...]
    state_units: tuple[str, ...]
    limits: Mapping[str, str]  # input: the parameter that bounds its absolute value
    rate: Callable[[Mapping[str, fmpq], Symbolic], list[fmpq_mpoly]]
    factors: Callable[[Mapping[str, fmpq], Mapping[str, fmpq]], dict[str, fmpq]]
    scaled: Callable[[Mapping[str, fmpq], fmpq, fmpq], dict[str, fmpq]]
    axes: Callable[[fmpq, fmpq], tuple[fmpq, ...]]
    units: Callable[[fmpq, fmpq], dict[str, fmpq]]


def _bicycle(parameters: Mapping[str, fmpq], dynamics: Symbolic) -> list[fmpq_mpoly]:
    """Eq. (bicycle-model) in the body frame of the reference, with w = tan γ."""
    s = dynamics.symbols
    speed = s["v"] + s["reference:speed"]
    turning = s["reference:turn_rate"] * s["input:u0"]
    return [
        speed * s["input:w"] / parameters["wheelbase"] - turning,
        -speed * dynamics.of("sin", "alpha") + turning * s["y"],
        speed * dynamics.of("cos", "alpha") - s["reference:speed"] * s["input:u0"] - turning * s["x"],
        s["input:thrust"] - s["reference:speed_slope"] * s["input:u0"],
    ]


def _bicycle_factors(own: Mapping[str, fmpq], other: Mapping[str, fmpq]) -> dict[str, fmpq]:
    """Only w / wheelbase enters: what one car does with w, the other does with w in the ratio of their wheelbases."""
    return {"u0": fmpq(1), "w": own["wheelbase"] / other["wheelbase"], "thrust": fmpq(1)}


def _bicycle_scaled(parameters: Mapping[str, fmpq], length: fmpq, speed: fmpq) -> dict[str, fmpq]:
    """The same car in other units: angles and their tangents keep, an acceleration is speed² over length."""
    units = _bicycle_units(length, speed)
    return {
        "wheelbase": parameters["wheelbase"] * length,
        "max_tan_steering": parameters["max_tan_steering"] * units["w"],
        "max_thrust": parameters["max_thrust"] * units["thrust"],
    }


def _bicycle_axes(length: fmpq, speed: fmpq) -> tuple[fmpq, ...]:
    return fmpq(1), length, length, speed


def _bicycle_units(length: fmpq, speed: fmpq) -> dict[str, fmpq]:
    return {"u0": fmpq(1), "w": fmpq(1), "thrust": speed**2 / length}


KNOWN_VEHICLES = {
    "kinematic_bicycle": KnownVehicle(
        ("wheelbase", "max_tan_steering", "max_thrust"),
        "a car by its rear axle, without slip; w is the tangent of its steering angle, thrust is v' in m/s^2",
        STATES,
        UNITS,
        {"w": "max_tan_steering", "thrust": "max_thrust"},
        _bicycle,
        _bicycle_factors,
        _bicycle_scaled,
        _bicycle_axes,
        _bicycle_units,
    )
}


def check_known_vehicle(vehicle: VehicleClaim, inputs: Mapping[str, Range], dynamics: Symbolic) -> None:
    """Hold a file against what a name that the checker knows stands for; `inputs` is the box, u0 first.

    Raises:
        Broken: the file says something else under a known name.
    """
    name, parameters = vehicle.name, vehicle.parameters
    if name not in KNOWN_VEHICLES:
        return
    known = KNOWN_VEHICLES[name]
    if (
        set(parameters) != set(known.parameters)
        or vehicle.states != known.states
        or tuple(inputs) != ("u0", *known.limits)
    ):
        raise Broken(f"vehicle: parameters, states or inputs are not those of a {name}")
    if any(value <= 0 for value in parameters.values()):
        raise Broken(f"vehicle: the parameters of a {name} are positive")
    for label, parameter in known.limits.items():
        lower, upper = inputs[label]
        if lower < -parameters[parameter] or upper > parameters[parameter]:
            raise Broken(f"vehicle: the limits of {label} are wider than its {parameter}")
    if dynamics.rates != tuple(known.rate(parameters, dynamics)):
        raise Broken(f"vehicle: the dynamics in the file are not those of a {name}")
