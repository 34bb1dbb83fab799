"""Vehicles that the checker knows by name: a certificate that uses the name has to have their dynamics.

Otherwise a file could print "kinematic_bicycle" and prove something about another car. The statement here is the
checker's own, written down from the paper; the certificate's graph comes from the definition of the vehicle in
`cfjax.problem`. The two are compared as polynomials in states, inputs, reference and the symbols sin α, cos α.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from flint import fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from cfjax.check.enclosure import Domain, Enclosure
from cfjax.check.graph import Graph
from cfjax.check.reader import Broken


REFERENCE = ("turn_rate", "speed", "turn_rate_slope", "speed_slope")
Symbols = Mapping[str, fmpq_mpoly]


@dataclass(frozen=True)
class KnownVehicle:
    """What a name stands for: parameters, states, inputs with their limits, and the deviation's rate."""

    parameters: tuple[str, ...]
    states: tuple[str, ...]
    limits: Mapping[str, str]  # input: the parameter that bounds its absolute value
    rate: Callable[[Mapping[str, fmpq], Symbols], list[fmpq_mpoly]]


def _bicycle(parameters: Mapping[str, fmpq], s: Symbols) -> list[fmpq_mpoly]:
    """Eq. (bicycle-model) in the body frame of the reference, with w = tan γ."""
    speed = s["v"] + s["reference:speed"]
    turning = s["reference:turn_rate"] * s["input:u0"]
    return [
        speed * s["input:w"] / parameters["wheelbase"] - turning,
        -speed * s["sin alpha"] + turning * s["y"],
        speed * s["cos alpha"] - s["reference:speed"] * s["input:u0"] - turning * s["x"],
        s["input:thrust"] - s["reference:speed_slope"] * s["input:u0"],
    ]


KNOWN_VEHICLES = {
    "kinematic_bicycle": KnownVehicle(
        ("wheelbase", "max_tan_steering", "max_thrust"),
        ("alpha", "x", "y", "v"),
        {"w": "max_tan_steering", "thrust": "max_thrust"},
        _bicycle,
    )
}


def check_known_vehicle(
    name: str,
    parameters: Mapping[str, fmpq],
    states: tuple[str, ...],
    inputs: Mapping[str, tuple[fmpq, fmpq]],
    graph: Graph,
) -> bool:
    """Whether the name is one that the checker knows; the file is then held against what it stands for.

    Raises:
        Broken: the file says something else under a known name.
    """
    if name not in KNOWN_VEHICLES:
        return False
    known = KNOWN_VEHICLES[name]
    if set(parameters) != set(known.parameters) or states != known.states or tuple(inputs) != ("u0", *known.limits):
        raise Broken(f"vehicle: parameters, states or inputs are not those of a {name}")
    if any(value <= 0 for value in parameters.values()):
        raise Broken(f"vehicle: the parameters of a {name} are positive")
    for label, parameter in known.limits.items():
        lower, upper = inputs[label]
        if lower < -parameters[parameter] or upper > parameters[parameter]:
            raise Broken(f"vehicle: the limits of {label} are wider than its {parameter}")
    names = [*states, *(f"input:{label}" for label in inputs), *(f"reference:{label}" for label in REFERENCE)]
    functions = ["sin alpha", "cos alpha"]
    ring = fmpq_mpoly_ctx.get([f"z{k}" for k in range(len(names) + len(functions))], "degrevlex")
    symbols = dict(zip([*names, *functions], ring.gens(), strict=True))
    domain = Domain(ring, fmpq(1))  # every polynomial here is exact: the ball bounds nothing

    def apply(_: int, function: str, argument: Enclosure) -> Enclosure:
        if function not in ("sin", "cos") or argument.polynomial != symbols["alpha"]:
            raise Broken(f"vehicle: the dynamics in the file are not those of a {name}")
        return domain.exact(symbols[f"{function} alpha"])

    values = {label: domain.exact(symbols[label]) for label in names}
    given = [value.polynomial for value in graph.evaluate(values, domain.constant, apply)]
    if given != known.rate(parameters, symbols):
        raise Broken(f"vehicle: the dynamics in the file are not those of a {name}")
    return True
