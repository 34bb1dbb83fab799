"""Dynamics that are those of a body beside its path, and some that nearly are."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import jax.numpy as jnp
import pytest

from cfjax.certificate.trace import trace_deviation
from cfjax.check.body import is_a_body
from cfjax.check.graph import Graph, Node
from cfjax.check.proof import closes
from cfjax.check.symbolic import symbolic
from cfjax.exact import exact_course
from cfjax.problem import KinematicBicycle, Twist, Vehicle, circle
from experiments.vehicles.front_axle import FrontAxleCar
from experiments.vehicles.steered_car import SteeredCar
from experiments.vehicles.unicycle import Unicycle


@dataclass(frozen=True)
class Ship(Unicycle):
    """It drifts sideways, by a state, and its reference does not; nested functions of no pose."""

    name: ClassVar[str] = "ship"
    internal_names: ClassVar[tuple[str, ...]] = ("v", "drift")

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        v, drift = internal
        turn, _ = inputs
        return Twist(turn=turn * jnp.cos(jnp.sin(drift)), lateral=drift * v, forward=v + drift**2)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        (v, drift), (turn, thrust) = internal, inputs
        return thrust, -drift + turn * v

    def reference(self, turn_rate: Any, speed: Any) -> tuple[Twist, tuple]:
        return Twist(turn=turn_rate, lateral=0.0, forward=speed), (speed, 0.0 * speed)


def body(graph: Graph, vehicle: Vehicle) -> bool:
    states = vehicle.state_names
    return is_a_body(symbolic(graph, states, ("u0", *vehicle.input_names)), states)


@pytest.mark.parametrize("vehicle", [KinematicBicycle(), Unicycle(), SteeredCar(), Ship()], ids=lambda v: v.name)
def test_vehicles_that_look_along_their_path_are_bodies(vehicle: Vehicle) -> None:
    assert body(trace_deviation(vehicle), vehicle)


def test_one_whose_reference_looks_away_is_none() -> None:
    assert not body(trace_deviation(FrontAxleCar()), FrontAxleCar())


def index_of(graph: Graph, name: str) -> int:
    return next(index for index, node in enumerate(graph.nodes) if node.name == name)


def added(output: int, *names: str, function: str = "") -> Callable[[Graph], Graph]:
    """One of the rates, with a product of inputs of the graph, or a function of it, added."""

    def spoil(graph: Graph) -> Graph:
        nodes, last = list(graph.nodes), index_of(graph, names[0])
        for name in names[1:]:
            nodes.append(Node("mul", (last, index_of(graph, name))))
            last = len(nodes) - 1
        if function:
            nodes.append(Node(function, (last,)))
            last = len(nodes) - 1
        nodes.append(Node("add", (graph.outputs[output], last)))
        outputs = (*graph.outputs[:output], len(nodes) - 1, *graph.outputs[output + 1 :])
        return Graph(tuple(nodes), outputs)

    return spoil


def swapped(one: str, other: str) -> Callable[[Graph], Graph]:
    def spoil(graph: Graph) -> Graph:
        names = {one: other, other: one}
        nodes = (
            Node(names.get(n.op, n.op), n.args, n.value, None if n.name is None else names.get(n.name, n.name))
            for n in graph.nodes
        )
        return Graph(tuple(nodes), graph.outputs)

    return spoil


@pytest.mark.parametrize(
    "spoil",
    [
        added(0, "x"),  # turns by where it is
        added(0, "alpha"),
        added(0, "alpha", function="sin"),
        added(0, "input:u0"),
        added(0, "reference:turn_rate_slope"),
        added(1, "input:u0"),  # its reference slides
        added(1, "reference:turn_rate", "input:u0", "y"),
        added(1, "v"),  # moves along an axis that does not turn with it
        added(2, "v"),
        added(2, "y"),
        added(2, "reference:speed", "input:u0"),  # its reference moves at another speed
        added(2, "x", function="sin"),
        swapped("sin", "cos"),
        swapped("x", "y"),
    ],
)
@pytest.mark.parametrize("vehicle", [KinematicBicycle(), Ship()], ids=lambda v: v.name)
def test_what_is_not_quite_one_is_none(spoil: Callable[[Graph], Graph], vehicle: Vehicle) -> None:
    assert not body(spoil(trace_deviation(vehicle)), vehicle)


def test_what_moves_inside_a_body_is_its_own_affair() -> None:
    graph = trace_deviation(Ship())
    for spoil in (added(0, "v", "drift"), added(3, "x"), added(4, "alpha", "y")):
        assert body(spoil(graph), Ship())


def test_a_lap_closes_where_no_other_state_jumps() -> None:
    pieces = exact_course(circle()).pieces
    for vehicle, closed in ((Unicycle(), True), (SteeredCar(), True), (FrontAxleCar(), False)):
        states = vehicle.state_names
        dynamics = symbolic(trace_deviation(vehicle), states, ("u0", *vehicle.input_names))
        assert closes(dynamics, states, pieces) is closed
