"""Dynamics written as nested tuples (operation, operand, …): a few of their own, and more of what stands in a file."""

from typing import Any

from flint import fmpq

from cfcheck.exact.graph import Graph, Node
from cfcheck.vehicle.symbolic import Symbolic, symbolic


OMEGA, SPEED, SLOPE, ACCELERATION = (
    f"reference:{name}" for name in ("turn_rate", "speed", "turn_rate_slope", "speed_slope")
)
U0, W = "input:u0", "input:w"
TURNING = ("mul", OMEGA, U0)


def dynamics(*rates: Any) -> Symbolic:
    """States a, b with rates given as nested tuples (operation, operand, …)."""
    nodes: list[Node] = []

    def add(expression: Any) -> int:
        if isinstance(expression, tuple):
            operation, *operands = expression
            node = Node(operation, tuple(add(operand) for operand in operands))
        elif isinstance(expression, str):
            node = Node("input", name=expression)
        else:
            node = Node("constant", value=fmpq(expression))
        nodes.append(node)
        return len(nodes) - 1

    outputs = tuple(add(rate) for rate in rates)
    return symbolic(Graph(tuple(nodes), outputs), ("a", "b"), ("u0", "w"))


# ȧ = v w − ω u0, ḃ = v cos a − a_r u0 cos b: (*) holds, and a, w, ω change their signs together
FIRST = ("sub", ("mul", SPEED, W), TURNING)
SECOND = ("sub", ("mul", SPEED, ("cos", "a")), ("mul", ("mul", ACCELERATION, U0), ("cos", "b")))


def add_to_rate(document: dict[str, Any], state: int, expression: Any) -> None:
    """An expression added to the rate of one of the states, by the dynamics of the vehicle in a certificate."""
    dynamics = document["problem"]["vehicle"]["dynamics"]
    nodes, outputs = dynamics["nodes"], dynamics["outputs"]

    def add(expression: Any) -> int:
        if isinstance(expression, tuple):
            operation, *operands = expression
            nodes.append([operation, *(add(operand) for operand in operands)])
        elif isinstance(expression, str):
            nodes.append(["input", expression])
        else:
            nodes.append(["constant", str(expression)])
        return len(nodes) - 1

    more = add(expression)
    nodes.append(["add", outputs[state], more])
    outputs[state] = len(nodes) - 1
