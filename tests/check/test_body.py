"""Dynamics that are those of a body beside its path, and some that nearly are."""

import math
from collections.abc import Callable

import pytest

from cfcheck.claims.assumptions import closes
from cfcheck.exact.graph import Graph, Node
from cfcheck.exact.symbolic import symbolic
from cfcheck.vehicle.body import is_a_body, looks_at_one_angle, slopes_by_timing_alone, turns_by_timing_alone
from cfjax.certificate.trace import trace_deviation
from cfjax.exact import exact_course
from cfjax.problem import KinematicBicycle, Vehicle, circle
from experiments.vehicles.front_axle import FrontAxleCar
from experiments.vehicles.steered_car import SteeredCar
from experiments.vehicles.unicycle import Unicycle
from tests.check.vehicles import Cart, Crab, SeenAhead, Ship


def one_angle(graph: Graph, vehicle: Vehicle) -> bool:
    states = vehicle.state_names
    return looks_at_one_angle(symbolic(graph, states, ("u0", *vehicle.input_names)), states)


def body(graph: Graph, vehicle: Vehicle) -> bool:
    states = vehicle.state_names
    return is_a_body(symbolic(graph, states, ("u0", *vehicle.input_names)), states)


@pytest.mark.parametrize("vehicle", [KinematicBicycle(), Unicycle(), SteeredCar(), Ship()], ids=lambda v: v.name)
def test_vehicles_that_look_along_their_path_are_bodies(vehicle: Vehicle) -> None:
    assert body(trace_deviation(vehicle), vehicle)


def test_one_whose_reference_looks_away_is_none() -> None:
    assert not body(trace_deviation(FrontAxleCar()), FrontAxleCar())


@pytest.mark.parametrize(
    ("vehicle", "one"),
    [
        (KinematicBicycle(), True),
        (Unicycle(), True),
        (SteeredCar(), True),
        (Ship(), True),
        (Crab(), True),
        (Crab(angle=math.pi), True),  # backwards
        (SeenAhead(), False),
        (FrontAxleCar(), False),
    ],
    ids=lambda v: getattr(v, "name", ""),
)
def test_how_a_reference_looks_is_seen_in_the_dynamics(vehicle: Vehicle, one: bool) -> None:
    assert one_angle(trace_deviation(vehicle), vehicle) is one


@pytest.mark.parametrize("vehicle", [Ship(), Crab()], ids=lambda v: v.name)
def test_an_angle_that_changes_however_little_is_seen(vehicle: Vehicle) -> None:
    graph = trace_deviation(vehicle)
    spoils = (
        added(0, "input:u0"),  # the reference turns at another rate
        added(0, "reference:turn_rate", "input:u0"),
        added(1, "reference:turn_rate", "input:u0"),  # and moves sideways as it turns
        added(1, "reference:turn_rate", "input:u0", "x"),
        added(2, "reference:turn_rate", "input:u0"),
        added(2, "reference:speed", "input:u0"),  # at another speed than the path
        added(2, "reference:speed", "input:u0", "input:u0"),
        added(2, "input:u0", function="sin"),
        added(1, "reference:speed", "input:u0", function="cos"),
    )
    for spoil in spoils:
        assert not one_angle(spoil(graph), vehicle)
    for spoil in (added(3, "x"), added(1, "v", "y"), added(2, "v", function="sin")):
        assert one_angle(spoil(graph), vehicle)


def test_curvature_is_felt_through_the_timing_alone() -> None:
    """What else it does to a reference could be written without u0 where u0 is 1, and would jump with it."""

    def alone(graph: Graph, vehicle: Vehicle) -> bool:
        return turns_by_timing_alone(symbolic(graph, vehicle.state_names, ("u0", *vehicle.input_names)))

    for vehicle in (KinematicBicycle(), Unicycle(), Ship(), Crab()):
        graph = trace_deviation(vehicle)
        assert alone(graph, vehicle)
        assert alone(added(1, "reference:turn_rate", "input:u0", "x", "v")(graph), vehicle)
        for names in (
            ("turn_rate",),
            ("turn_rate", "x"),
            ("turn_rate", "turn_rate", "u0"),
            ("turn_rate", "speed", "u0"),
        ):
            whole = [{"u0": "input:u0", "x": "x"}.get(name, f"reference:{name}") for name in names]
            assert not alone(added(1, *whole)(graph), vehicle)
        assert not alone(added(2, "reference:turn_rate", function="sin")(graph), vehicle)
    assert not alone(trace_deviation(SteeredCar()), SteeredCar())


def test_what_a_reference_does_by_its_slopes_it_does_as_theta_goes_on() -> None:
    """A state that follows acceleration, or the slope of the turning rate, jumps where that does: a term without u0."""

    def by_timing(graph: Graph, vehicle: Vehicle) -> bool:
        return slopes_by_timing_alone(symbolic(graph, vehicle.state_names, ("u0", *vehicle.input_names)))

    for vehicle in (KinematicBicycle(), Unicycle(), Ship(), Crab(), SteeredCar(), Cart()):
        graph = trace_deviation(vehicle)
        assert by_timing(graph, vehicle)
        for slope in ("reference:turn_rate_slope", "reference:speed_slope"):
            spoiled = graph if index_of(graph, slope, -1) >= 0 else with_input(graph, slope)
            assert by_timing(added(3, slope, "input:u0", "x")(spoiled), vehicle)
            for names in ((slope,), (slope, "x"), (slope, "input:u0", "input:u0"), (slope, slope)):
                assert not by_timing(added(3, *names)(spoiled), vehicle)
            assert not by_timing(added(2, slope, function="sin")(spoiled), vehicle)


def with_input(graph: Graph, name: str) -> Graph:
    """The graph, and one more of its inputs that nothing reads."""
    return Graph((*graph.nodes, Node("input", name=name)), graph.outputs)


def test_no_pose_no_angle() -> None:
    dynamics = symbolic(trace_deviation(Unicycle()), Unicycle().state_names, ("u0", "turn", "thrust"))
    assert looks_at_one_angle(dynamics, Unicycle().state_names)
    assert not looks_at_one_angle(dynamics, ("a", "x", "y", "v"))


def index_of(graph: Graph, name: str, missing: int | None = None) -> int:
    found = (index for index, node in enumerate(graph.nodes) if node.name == name)
    return next(found) if missing is None else next(found, missing)


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
