"""From the one definition of the vehicle to an expression graph: JAX traces the deviation dynamics.

Only operations that the exact arithmetic knows are taken; anything else is refused by name.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core

from cfcheck.exact.graph import Graph, Node
from cfcheck.exact.rational import rational
from cfcheck.vehicle.symbolic import Symbolic, symbolic
from cfjax.errors import InputError
from cfjax.problem import FeedbackLaw, ReferencePoint, Vehicle, deviation_rate


PROFILE_INPUTS = ReferencePoint._fields
BINARY = {"add": "add", "add_any": "add", "sub": "sub", "mul": "mul"}
UNARY = {"neg": "neg", "sin": "sin", "cos": "cos", "tan": "tan", "sqrt": "sqrt"}
FUNCTIONS = {"sin": np.sin, "cos": np.cos, "tan": np.tan, "sqrt": np.sqrt}  # of a constant: a constant, as JAX has it
TRANSPARENT = ("copy", "stop_gradient")
CAST = "convert_element_type"
POWERS = ("div", "integer_pow", "square")
EXACT = (*BINARY, *UNARY, *POWERS, *TRANSPARENT)
NESTED = ("pjit", "jit", "closed_call", "custom_jvp_call", "custom_vjp_call")


Value = TypeVar("Value")


def interpreted(
    function: Callable[..., Sequence],
    arguments: Sequence[Value],
    constant: Callable[[Any], Value],
    operation: Callable[[core.JaxprEqn, list[Value]], Value],
) -> list[Value]:
    """What a function of scalars comes to in another arithmetic, by its primitives as JAX traces them, in float64.

    `constant` lifts a number into that arithmetic, `operation` applies a primitive that is no call of other ones.
    """

    def run(jaxpr: core.Jaxpr, consts: Sequence[Any], arguments: Sequence[Value]) -> list[Value]:
        where: dict[Any, Value] = dict(zip(jaxpr.invars, arguments, strict=True))
        where.update(zip(jaxpr.constvars, map(constant, consts), strict=True))

        def read(atom: Any) -> Value:
            return constant(atom.val) if isinstance(atom, core.Literal) else where[atom]

        for equation in jaxpr.eqns:
            given = [read(atom) for atom in equation.invars]
            if equation.primitive.name in NESTED:
                inner = equation.params.get("jaxpr") or equation.params["call_jaxpr"]
                values = run(inner.jaxpr, inner.consts, given)
            else:
                values = [operation(equation, given)]
            where.update(zip(equation.outvars, values, strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    closed = jax.make_jaxpr(lambda *scalars: [jnp.asarray(value, float) for value in function(*scalars)])(
        *(0.0 for _ in arguments)
    )
    return run(closed.jaxpr, closed.consts, arguments)


def trace_deviation(vehicle: Vehicle) -> Graph:
    """Graph of ẋ_R over the deviation's states, the inputs (u0, …) and the reference's profile.

    Raises:
        InputError: names the first operation of the vehicle that has no exact arithmetic.
    """
    states, inputs = vehicle.state_names, ("u0", *vehicle.input_names)
    names = (*states, *(f"input:{name}" for name in inputs), *(f"reference:{name}" for name in PROFILE_INPUTS))

    def rate(*scalars: Any) -> Sequence:
        x = scalars[: len(states)]
        u = scalars[len(states) : len(states) + len(inputs)]
        reference = ReferencePoint(*scalars[len(states) + len(inputs) :])
        return deviation_rate(vehicle, x, u, reference)

    builder = _Builder(vehicle.name)
    inputs_read = [builder.add(Node("input", name=name)) for name in names]
    outputs = interpreted(rate, inputs_read, builder.constant, builder.equation)
    return Graph(tuple(builder.nodes), tuple(outputs))


def trace_law(vehicle: Vehicle, law: FeedbackLaw) -> Graph:
    """Graph of a law's inputs, before they are limited, over the deviation's states and the reference's profile.

    Raises:
        InputError: names the first operation of the law that has no exact arithmetic.
    """
    states = vehicle.state_names

    def inputs(*scalars: Any) -> Sequence:
        return law.inputs(vehicle, scalars[: len(states)], ReferencePoint(*scalars[len(states) :]))

    builder = _Builder(f"{vehicle.name}, law {law.name}")
    names = (*states, *(f"reference:{name}" for name in PROFILE_INPUTS))
    read = [builder.add(Node("input", name=name)) for name in names]
    outputs = interpreted(inputs, read, builder.constant, builder.equation)
    return without_unread(Graph(tuple(builder.nodes), tuple(outputs)))


def without_unread(graph: Graph) -> Graph:
    """The same outputs from those nodes alone that they depend on."""
    needed = set(graph.outputs)
    for index in reversed(range(len(graph.nodes))):
        if index in needed:
            needed.update(graph.nodes[index].args)
    place = {index: k for k, index in enumerate(sorted(needed))}
    nodes = (replace(graph.nodes[index], args=tuple(place[arg] for arg in graph.nodes[index].args)) for index in place)
    return Graph(tuple(nodes), tuple(place[output] for output in graph.outputs))


def dynamics_of(vehicle: Vehicle) -> Symbolic:
    """The same in polynomials, to see their structure.

    Raises:
        InputError: as `trace_deviation`.
    """
    return symbolic(trace_deviation(vehicle), vehicle.state_names, ("u0", *vehicle.input_names))


class _Builder:
    def __init__(self, vehicle: str) -> None:
        self.vehicle = vehicle
        self.nodes: list[Node] = []
        self.known: dict[Node, int] = {}

    def add(self, node: Node) -> int:
        if node not in self.known:
            self.known[node] = len(self.nodes)
            self.nodes.append(node)
        return self.known[node]

    def constant(self, value: Any) -> int:
        if np.ndim(value):
            raise InputError(f"vehicle {self.vehicle}: expected functions of scalars, got a constant array")
        if not np.isfinite(value):
            raise InputError(f"vehicle {self.vehicle}: expected finite constants, got {value}")
        if float(value) != np.asarray(value).item():  # compared as Python's numbers, which is exact
            raise InputError(f"vehicle {self.vehicle}: the constant {value} is no 64-bit floating-point number")
        return self.add(Node("constant", value=rational(float(value))))

    def inverse(self, node: int) -> int:
        """1/node: a rational where the node is a constant, else the function `inv`, enclosed away from its pole."""
        value = self.nodes[node].value
        if value is None:
            return self.add(Node("inv", (node,)))
        if not value:
            raise InputError(f"vehicle {self.vehicle}: division by zero")
        return self.add(Node("constant", value=1 / value))

    def require_reals(self, equation: Any, args: list[int]) -> None:
        """Raises InputError unless everything is a 64-bit number, which stands for a real one, or such a constant.

        Whole numbers wrap around and are cut off, shorter floating-point numbers are coarse: neither is the real
        arithmetic of the graph. `constant` has seen to it that constants of other types mean the same number.
        """
        given = [str(atom.aval.dtype) for atom in equation.invars]
        (made,) = {str(variable.aval.dtype) for variable in equation.outvars}
        if equation.primitive.name == CAST:
            if made != "float64" or (given != ["float64"] and self.nodes[args[0]].value is None):
                raise InputError(
                    f"vehicle {self.vehicle}: no exact arithmetic for the cast from {given[0]} to {made}; "
                    "expected float64 throughout"
                )
        elif equation.primitive.name in EXACT and {*given, made} != {"float64"}:
            raise InputError(
                f"vehicle {self.vehicle}: no exact arithmetic for {equation.primitive.name!r} of {', '.join(given)}; "
                "expected float64 throughout"
            )

    def equation(self, equation: core.JaxprEqn, args: list[int]) -> int:
        name = equation.primitive.name
        self.require_reals(equation, args)
        if name == CAST or name in TRANSPARENT:
            return args[0]
        if name in BINARY:
            return self.add(Node(BINARY[name], tuple(args)))
        if name in FUNCTIONS and (value := self.nodes[args[0]].value) is not None:
            with np.errstate(invalid="ignore"):  # what is not a number is refused as a constant
                return self.constant(FUNCTIONS[name](float(value)))
        if name in UNARY:
            return self.add(Node(UNARY[name], tuple(args)))
        if name == "div":
            return self.add(Node("mul", (args[0], self.inverse(args[1]))))
        if name == "square" or (name == "integer_pow" and equation.params["y"]):
            exponent = 2 if name == "square" else equation.params["y"]
            power = args[0]
            for _ in range(abs(exponent) - 1):
                power = self.add(Node("mul", (power, args[0])))
            return power if exponent > 0 else self.inverse(power)
        raise InputError(
            f"vehicle {self.vehicle}: no exact arithmetic for the operation {name!r}; "
            f"known are {', '.join(sorted({*BINARY, *UNARY, *POWERS}))}"
        )
