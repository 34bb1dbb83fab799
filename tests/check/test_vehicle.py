"""A known name stands for known dynamics; affine inputs are seen from the graph."""

import pytest
from flint import fmpq

from cfcheck.claims.refutation import require_affine
from cfcheck.exact.graph import Graph, Node
from cfcheck.reader import Broken
from cfcheck.vehicle.model import VehicleClaim, check_known_vehicle
from cfcheck.vehicle.symbolic import symbolic
from cfjax.certificate.trace import trace_deviation
from cfjax.problem import KinematicBicycle


STATES = ("alpha", "x", "y", "v")
PARAMETERS = {"wheelbase": fmpq(17, 50), "max_tan_steering": fmpq(1), "max_thrust": fmpq(4)}
INPUTS = {"u0": (fmpq(1, 2), fmpq(2)), "w": (fmpq(-1), fmpq(1)), "thrust": (fmpq(-4), fmpq(4))}


def check(graph: Graph, parameters: dict = PARAMETERS, inputs: dict = INPUTS, name: str = "kinematic_bicycle") -> None:
    vehicle = VehicleClaim(name, parameters, STATES, graph)
    check_known_vehicle(vehicle, inputs, symbolic(graph, STATES, tuple(inputs)))


def test_the_traced_bicycle_is_the_bicycle() -> None:
    graph = trace_deviation(KinematicBicycle())
    check(graph)
    check(graph, inputs=INPUTS | {"thrust": (fmpq(-1), fmpq(2))})
    check(graph, parameters={}, name="my_car")


def test_another_car_does_not_pass_under_its_name() -> None:
    graph = trace_deviation(KinematicBicycle())
    other = trace_deviation(KinematicBicycle(wheelbase=0.3401))
    flipped = Graph(tuple(Node("cos", n.args) if n.op == "sin" else n for n in graph.nodes), graph.outputs)
    swapped = Graph(graph.nodes, (graph.outputs[0], *reversed(graph.outputs[1:])))
    # without the sine, or without the cosine, there is no symbol to compare with: that must not read as zero
    parts = [
        Graph(tuple(Node("constant", value=fmpq(0)) if n.op == name else n for n in graph.nodes), graph.outputs)
        for name in ("sin", "cos")
    ]
    tan = Graph(tuple(Node("tan", n.args) if n.op == "sin" else n for n in graph.nodes), graph.outputs)
    for wrong in (other, flipped, swapped, tan, *parts):
        with pytest.raises(Broken, match="dynamics"):
            check(wrong)
    for parameters, inputs in (
        (PARAMETERS | {"wheelbase": fmpq(0)}, INPUTS),
        ({"wheelbase": fmpq(17, 50)}, INPUTS),
        (PARAMETERS, INPUTS | {"w": (fmpq(-1), fmpq(1001, 1000))}),
        (PARAMETERS, {"u0": INPUTS["u0"], "thrust": INPUTS["thrust"], "w": INPUTS["w"]}),
    ):
        with pytest.raises(Broken, match="vehicle"):
            check(graph, parameters, inputs)


def test_affinity_is_read_off_the_graph() -> None:
    require_affine(trace_deviation(KinematicBicycle()), ("u0", "w", "thrust"))
    u, x = Node("input", name="input:u0"), Node("input", name="x")
    w = Node("input", name="input:w")
    for last in (Node("mul", (0, 0)), Node("mul", (0, 2)), Node("sin", (0,)), Node("inv", (2,))):
        with pytest.raises(Broken, match="affine"):
            require_affine(Graph((u, x, w, last), (3,)), ("u0", "w"))
    require_affine(Graph((u, x, w, Node("mul", (0, 1)), Node("sin", (1,)), Node("sub", (3, 4))), (5,)), ("u0", "w"))


def test_graphs_are_checked_when_they_are_made() -> None:
    for node in (("exp", (0,)), ("mul", (0,)), ("constant", ()), ("sin", (0, 1))):
        with pytest.raises(ValueError, match="operation"):
            Node(*node)
    with pytest.raises(ValueError, match="before it"):
        Graph((Node("neg", (0,)),), (0,))
    with pytest.raises(ValueError, match="does not exist"):
        Graph((Node("input", name="x"),), (1,))
    with pytest.raises(ValueError, match="neither state"):
        Graph((Node("input", name="x"),), (0,)).evaluate({}, lambda c: c, lambda *_: None)
