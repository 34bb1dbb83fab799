"""What a file asks: vehicle, method, inputs, path, and the sets I, G and S with what has to be cleared.

Reading checks shapes, sizes and that numbers are exact; whether anything stated is true is not decided here.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from flint import acb, arb, fmpq

from cfcheck.clearance.surroundings import SurroundingsClaim, read_surroundings
from cfcheck.exact.graph import ARITY, MOST_INPUTS, MOST_NODES, MOST_STATES, Graph, Node
from cfcheck.exact.polynomial import Coefficients
from cfcheck.exact.rational import bits
from cfcheck.kernel.containment import Sets
from cfcheck.kernel.funnel import Inputs, Model
from cfcheck.kernel.law import READABLE, LawClaim
from cfcheck.path.bounds import Bounds, read_bounds
from cfcheck.path.piece import Piece, are_steady
from cfcheck.path.reference import ExactPose, Reference
from cfcheck.reader import Broken, Item, Unreadable
from cfcheck.vehicle.model import VehicleClaim


MOST_PARAMETERS = 32  # of a vehicle
MOST_PIECES = 4096  # of a path: a lap of a race track for a car of full size
LONGEST = 600  # bits of a path's coefficient; exact sums along a path take some hundred
LONGEST_SUM = 8 * LONGEST  # bits of θ and arc length
MOST_POWERS = 8  # of a path's polynomials


class PlacedPath(NamedTuple):
    """A path that lies somewhere; closed: one lap, driven again and again."""

    reference: Reference
    closed: bool


@dataclass(frozen=True)
class ProblemClaim:
    """The question that the file answers; sets and limits by state and by input.

    `course` is the path, or bounds: every path within them is meant then.
    """

    vehicle: VehicleClaim
    method: str
    inputs: Inputs
    path: str
    course: PlacedPath | Bounds
    inlet: tuple[fmpq, ...] | None  # half-axes of I; where there is none, every start in V < 1 is meant
    goal: tuple[fmpq, ...] | None  # half-axes of G
    safe: tuple[fmpq, ...] | None  # half-widths of the box S
    surroundings: SurroundingsClaim
    law: LawClaim | None = None  # without one some input of the box has to do

    @property
    def reference(self) -> Reference:
        """That of a path that lies somewhere.

        Raises:
            Broken: every path within bounds is meant.
        """
        if isinstance(self.course, Bounds):
            raise Broken("path: expected one that lies somewhere, got bounds")
        return self.course.reference

    @property
    def is_steady(self) -> bool:
        """Whether it speaks of one turning rate and speed alone."""
        course = self.course
        return course.is_single if isinstance(course, Bounds) else are_steady(course.reference.pieces)

    @property
    def is_lap(self) -> bool:
        """Whether the path is driven again and again."""
        return isinstance(self.course, PlacedPath) and self.course.closed

    def sets(self, *, is_first: bool, is_last: bool) -> Sets:
        """The sets with which a funnel of its path is compared."""
        return Sets(self.inlet if is_first else None, self.goal if is_last else None, self.safe)

    @property
    def fastest(self) -> fmpq:
        """The largest u0."""
        return self.inputs["u0"][1]

    @cached_property
    def car(self) -> Model:
        """The vehicle as a car that funnels are proven for."""
        return Model(self.vehicle, self.inputs, law=self.law)


def read_problem(question: Mapping[str, object]) -> ProblemClaim:
    """The question of a file, by itself: for whoever is about to write one.

    Raises:
        Unreadable, Broken: says what was expected where.
    """
    return problem_of(Item(dict(question), "problem"))


def problem_of(item: Item) -> ProblemClaim:
    """The question of a file.

    Raises:
        Unreadable, Broken: says what was expected where.
    """
    vehicle, method, inputs, path, sets, *law = item.record(
        "vehicle", "method", "inputs", "path", "sets", *item.optional("law")
    )
    inlet, goal, safe, obstacles, footprint = sets.record("inlet", "goal", "safe", "obstacles", "footprint")
    claim = read_vehicle(vehicle)
    label, course = _path(path)
    box = read_inputs(inputs, claim.states)

    def by_state(entry: Item, field: str) -> tuple[fmpq, ...] | None:
        if entry.value is None:
            return None
        size = len(claim.states)
        return tuple(value.positive() for value in entry.record(field)[0].items(size, size))

    return ProblemClaim(
        vehicle=claim,
        method=method.choice("pf", "tt"),
        inputs=box,
        path=label,
        course=course,
        inlet=by_state(inlet, "half_axes"),
        goal=by_state(goal, "half_axes"),
        safe=by_state(safe, "half_widths"),
        surroundings=read_surroundings(obstacles, footprint),
        law=read_law(law[0], claim.states, len(box) - 1) if law else None,
    )


def read_law(item: Item, states: tuple[str, ...], count: int) -> LawClaim:
    """A law of so many inputs; it reads states and reference alone.

    Raises:
        Unreadable: says what was expected where.
    """
    name, nodes, outputs = item.record("name", "nodes", "outputs")
    graph = _graph(item, nodes, outputs, count)
    known = {*states, *(f"reference:{label}" for label in READABLE)}
    if unknown := [label for label in graph.inputs() if label not in known]:
        raise Unreadable(f"{item.where}: a law reads states and the reference, not {unknown[0]!a}")
    return LawClaim(name.text(), graph)


def read_vehicle(item: Item) -> VehicleClaim:
    """Name, parameters, states and dynamics.

    Raises:
        Unreadable: says what was expected where.
    """
    name, parameters, states, dynamics = item.record("name", "parameters", "states", "dynamics")
    nodes, outputs = dynamics.record("nodes", "outputs")
    labels = tuple(state.label() for state in states.items(MOST_STATES))
    if len(set(labels)) != len(labels):
        states.refuse("distinct plain names")
    graph = _graph(dynamics, nodes, outputs, len(labels))
    return VehicleClaim(
        name.text(), {k: value.rational() for k, value in parameters.entries(MOST_PARAMETERS, least=0)}, labels, graph
    )


def _graph(item: Item, nodes: Item, outputs: Item, count: int) -> Graph:
    """With so many outputs."""
    operations = nodes.items(MOST_NODES)
    try:
        return Graph(
            tuple(_node(node) for node in operations),
            tuple(output.integer(0, len(operations) - 1) for output in outputs.items(count, count)),
        )
    except (Unreadable, Broken):
        raise
    except ValueError as error:
        raise Unreadable(f"{item.where}: {error}") from None


def _node(item: Item) -> Node:
    op, *args = item.items(3)
    kind = op.choice(*ARITY)
    if kind in ("constant", "input"):
        if len(args) != 1:
            item.refuse("one value")
        return Node(kind, value=args[0].rational()) if kind == "constant" else Node(kind, name=args[0].text())
    return Node(kind, tuple(arg.integer(0, MOST_NODES) for arg in args))


def read_inputs(item: Item, states: tuple[str, ...]) -> Inputs:
    """A box by name, u0 first; no input has the name of a state.

    Raises:
        Unreadable: says what was expected where.
    """
    box = {}
    for entry in item.items(MOST_INPUTS):
        name, lower, upper = entry.record("name", "lower", "upper")
        if name.label() in (*box, *states):
            name.refuse("a name that stands for nothing else")
        box[name.label()] = lower.rational(), upper.rational()
    if next(iter(box)) != "u0":
        item.refuse("u0 first")
    return box


def _path(item: Item) -> tuple[str, PlacedPath | Bounds]:
    if isinstance(item.value, dict) and "bounds" in item.value:
        name, bounds = item.record("name", "bounds")
        return name.text(), read_bounds(bounds)
    name, closed, start, pieces = item.record("name", "closed", "start", "pieces")
    if not isinstance(closed.value, bool):
        closed.refuse("true or false")
    return name.text(), PlacedPath(_reference(start, pieces), closed.value is True)


def _reference(start: Item, pieces: Item) -> Reference:
    heading, x, y = (entry.rational() for entry in start.items(3, 3))
    found: list[Piece] = []
    arc = theta = fmpq(0)
    for item in pieces.items(MOST_PIECES):
        duration, turn_rate, speed = item.record("duration", "turn_rate", "speed")
        piece = Piece(0, theta, duration.positive(), _powers(turn_rate), _powers(speed), arc)
        found.append(piece)
        theta, arc = theta + piece.duration, arc + piece.length
        if max(bits(theta), bits(arc)) > LONGEST_SUM:  # with unlike denominators they would grow from piece to piece
            item.refuse(f"sums along the path of at most {LONGEST_SUM} bits")
    return Reference(tuple(found), ExactPose(heading, acb(arb(x), arb(y))))


def _powers(item: Item) -> Coefficients:
    """Of a polynomial in ascending powers."""
    found = tuple(entry.rational() for entry in item.items(MOST_POWERS))
    if max(map(bits, found)) > LONGEST:
        item.refuse(f"coefficients of at most {LONGEST} bits")
    return found
