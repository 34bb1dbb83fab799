"""certificate.json as typed claims: what the file states, with the hints (`cfjax.check.hints`) that it comes with.

`docs/certificate-format.md` describes the format. Reading checks shapes, sizes and that numbers are exact; whether
anything stated is true is not decided here (`cfjax.check.replay`).
"""

import hashlib
import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass

from flint import acb, arb, fmpq

from cfjax.check.bounds import MOST_EXTREMES, Bounds, read_bounds
from cfjax.check.containment import Asked
from cfjax.check.graph import ARITY, MOST_INPUTS, MOST_NODES, MOST_STATES, Graph, Node
from cfjax.check.hints import MOST_GRAM_ENTRIES, DecreaseHints, Room, read_decrease
from cfjax.check.level import LEVELS, Level
from cfjax.check.piece import Piece, are_steady
from cfjax.check.polynomial import Coefficients
from cfjax.check.program import Matrix
from cfjax.check.rational import bits
from cfjax.check.reader import Broken, Item, Unreadable
from cfjax.check.reference import ExactPose, Reference
from cfjax.check.surroundings import Clearance, Surroundings, read_clearance, read_surroundings


FORMAT = "cfjax-certificate"
VERSION = 3
CLAIMS = ("funnel", "refutation")
PROOFS, WITNESS = "proofs", "witness"  # the last field, by claim
MOST_PARAMETERS = 32  # of a vehicle
MOST_PIECES = 4096  # of a path: a lap of a race track for a car of full size
LONGEST = 600  # bits of a path's coefficient; exact sums along a path take some hundred
LONGEST_SUM = 8 * LONGEST  # bits of θ and arc length
MOST_POWERS = 8  # of a path's polynomials


@dataclass(frozen=True)
class VehicleClaim:
    """Whose dynamics: the deviation's rate as a graph over states, `input:…` and `reference:…`."""

    name: str
    parameters: Mapping[str, fmpq]
    states: tuple[str, ...]
    graph: Graph


@dataclass(frozen=True)
class SegmentClaim:
    """A stretch of reference in exact pieces, θ from 0 to the duration (s)."""

    pieces: tuple[Piece, ...]

    @property
    def duration(self) -> fmpq:
        return sum((piece.duration for piece in self.pieces), fmpq(0))

    @property
    def is_steady(self) -> bool:
        """Whether it is written so that turning rate and speed are one number each."""
        return are_steady(self.pieces)

    @property
    def course(self) -> tuple[tuple[fmpq, Coefficients, Coefficients], ...]:
        """What the dynamics see of it, wherever it lies: segments with the same are the same problem."""
        return tuple((piece.duration, piece.turn_rate, piece.speed) for piece in self.pieces)

    def profile(self, theta: fmpq) -> dict[str, fmpq]:
        """What the dynamics see of it at θ (s), by the graph's names; of two pieces that meet there, the later one."""
        piece = [piece for piece in self.pieces if piece.theta <= theta][-1]
        return piece.profile(theta - piece.theta)


@dataclass(frozen=True)
class Course:
    """A path: its segments, of which each repeats one of the distinct ones, and where they lie in the plane."""

    reference: Reference
    closed: bool
    segments: tuple[SegmentClaim, ...]
    kinds: tuple[int, ...]  # for each segment, the funnel along it


@dataclass(frozen=True)
class ProblemClaim:
    """The question that the file answers; sets and limits by state and by input."""

    vehicle: VehicleClaim
    method: str
    inputs: Mapping[str, tuple[fmpq, fmpq]]  # u0 first
    path: str
    course: Course | Bounds
    inlet: tuple[fmpq, ...]  # half-axes of I
    goal: tuple[fmpq, ...] | None  # half-axes of G; None of a tube of which none is asked
    safe: tuple[fmpq, ...] | None  # half-widths of the box S
    surroundings: Surroundings

    @property
    def is_steady(self) -> bool:
        """Whether it speaks of one turning rate and speed alone."""
        course = self.course
        return course.is_single if isinstance(course, Bounds) else are_steady(course.reference.pieces)

    @property
    def kinds(self) -> tuple[int, ...]:
        """For each segment, the funnel along it; a tube is one."""
        return self.course.kinds if isinstance(self.course, Course) else (0,)

    @property
    def distinct(self) -> tuple[SegmentClaim | Bounds, ...]:
        """One for each funnel: the tube, or the first segment of each kind."""
        course = self.course
        if isinstance(course, Bounds):
            return (course,)
        return tuple(course.segments[self.kinds.index(kind)] for kind in range(max(self.kinds) + 1))

    def asked(self, kind: int) -> Asked:
        """What is asked of the funnel along segments of that kind."""
        first, last = kind == self.kinds[0], kind == self.kinds[-1]
        return Asked(self.inlet if first else None, self.goal if last else None, self.safe)


@dataclass(frozen=True)
class FunnelClaim:
    """V of a template on segments of one kind, β = 1, and the margin λ (1/s) claimed; of a tube, per metre too."""

    level: Level
    shape: Matrix
    beta_lower: fmpq
    beta_inner: fmpq
    margin: fmpq
    margin_per_metre: fmpq | None


@dataclass(frozen=True)
class Witness:
    """A deviation x at θ (s) at which a candidate violates a condition (a, b, c or d); of a tube, at a reference."""

    condition: str
    funnel: int
    theta: fmpq
    reference: int  # which of a tube's extreme ones
    x: tuple[fmpq, ...]


@dataclass(frozen=True)
class Certificate:
    """A whole file: hints for each funnel where it claims one, a witness where it refutes one.

    `clearance` has, for each segment, for each obstacle, for each disc of the footprint, half-planes along θ.
    """

    problem: ProblemClaim
    funnels: tuple[FunnelClaim, ...]
    hints: tuple[DecreaseHints, ...]
    clearance: Clearance
    witness: Witness | None


def document_hash(document: Mapping[str, object]) -> str:
    """SHA-256 of the canonical JSON (sorted keys, no spaces, ASCII) of everything but the hash itself."""
    content = {name: value for name, value in document.items() if name != "hash"}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return "sha256:" + hashlib.sha256(text.encode("ascii")).hexdigest()


def read_certificate(document: object, skip_hash: bool = False) -> Certificate:
    """Typed claims of a parsed file, with what it has to prove or refute them.

    Raises:
        Unreadable: says what was expected where.
        Broken: the hash is not that of the content.
    """
    problem, funnels, last = _claims(document, skip_hash)
    if last.where == WITNESS:
        return Certificate(problem, funnels, (), (), _witness(last, problem))
    proofs, clearance = last.record("decrease", "clearance")
    room, states = Room(MOST_GRAM_ENTRIES), len(problem.vehicle.states)
    hints = tuple(read_decrease(item, states, room) for item in proofs.items(len(funnels), len(funnels)))
    spans = 0 if isinstance(problem.course, Bounds) else len(problem.course.segments)
    return Certificate(problem, funnels, hints, read_clearance(clearance, problem.surroundings, spans), None)


def read_claims(document: object) -> tuple[ProblemClaim, tuple[FunnelClaim, ...]]:
    """What a parsed file of claim `funnel` states, its proofs left aside: for a file that was replayed before.

    Raises:
        Unreadable: says what was expected where.
    """
    problem, funnels, last = _claims(document, skip_hash=True)
    if last.where == WITNESS:
        raise Unreadable("claim: expected funnel, got refutation")
    return problem, funnels


def read_problem(question: Mapping[str, object]) -> ProblemClaim:
    """The question of a file, by itself: for whoever is about to write one.

    Raises:
        Unreadable, Broken: says what was expected where.
    """
    return _problem(Item(dict(question), "problem"))


def _claims(document: object, skip_hash: bool) -> tuple[ProblemClaim, tuple[FunnelClaim, ...], Item]:
    """The question, the funnels and the last field: proofs or witness."""
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise Unreadable(f"not a certificate: expected an object with format {FORMAT}")
    if document.get("version") != VERSION or isinstance(document["version"], bool):
        raise Unreadable(f"this checker reads version {VERSION} of the format")
    claim = Item(document.get("claim"), "claim").choice(*CLAIMS)
    last = PROOFS if claim == "funnel" else WITNESS
    fields = Item(document, "").record("format", "version", "claim", "hash", "problem", "funnels", last)
    if not skip_hash and fields[3].value != document_hash(document):
        raise Broken("hash: the content has changed since the hash was taken")
    problem = _problem(fields[4])
    count = len(problem.distinct)
    funnels = tuple(_funnel(item, len(problem.vehicle.states)) for item in fields[5].items(count))
    if len(funnels) != count:
        raise Unreadable(f"funnels: expected {count}, one for each kind of segment, got {len(funnels)}")
    return problem, funnels, fields[6]


def _problem(item: Item) -> ProblemClaim:
    vehicle, method, inputs, path, sets = item.record("vehicle", "method", "inputs", "path", "sets")
    claim = _vehicle(vehicle)
    size = len(claim.states)
    inlet, goal, safe, obstacles, footprint = sets.record("inlet", "goal", "safe", "obstacles", "footprint")
    label, course = _path(path)
    box = [_input(entry) for entry in inputs.items(MOST_INPUTS)]
    if len(dict(box)) != len(box) or box[0][0] != "u0":
        raise Unreadable("problem.inputs: expected distinct names, u0 first")
    return ProblemClaim(
        vehicle=claim,
        method=method.choice("pf", "tt"),
        inputs=dict(box),
        path=label,
        course=course,
        inlet=tuple(axis.positive() for axis in inlet.record("half_axes")[0].items(size, size)),
        goal=None
        if goal.value is None and isinstance(course, Bounds)  # a path has an end
        else tuple(axis.positive() for axis in goal.record("half_axes")[0].items(size, size)),
        safe=None
        if safe.value is None
        else tuple(width.positive() for width in safe.record("half_widths")[0].items(size, size)),
        surroundings=read_surroundings(obstacles, footprint),
    )


def _vehicle(item: Item) -> VehicleClaim:
    name, parameters, states, dynamics = item.record("name", "parameters", "states", "dynamics")
    nodes, outputs = dynamics.record("nodes", "outputs")
    labels = tuple(state.label() for state in states.items(MOST_STATES))
    if len(set(labels)) != len(labels):
        states.refuse("distinct plain names")
    operations = nodes.items(MOST_NODES)
    try:
        graph = Graph(
            tuple(_node(node) for node in operations),
            tuple(output.integer(0, len(operations) - 1) for output in outputs.items(len(labels), len(labels))),
        )
    except (Unreadable, Broken):
        raise
    except ValueError as error:
        raise Unreadable(f"{dynamics.where}: {error}") from None
    return VehicleClaim(
        name.text(), {k: value.rational() for k, value in parameters.entries(MOST_PARAMETERS, least=0)}, labels, graph
    )


def _node(item: Item) -> Node:
    op, *args = item.items(3)
    kind = op.choice(*ARITY)
    if kind in ("constant", "input"):
        if len(args) != 1:
            item.refuse("one value")
        return Node(kind, value=args[0].rational()) if kind == "constant" else Node(kind, name=args[0].text())
    return Node(kind, tuple(arg.integer(0, MOST_NODES) for arg in args))


def _input(item: Item) -> tuple[str, tuple[fmpq, fmpq]]:
    name, lower, upper = item.record("name", "lower", "upper")
    return name.label(), (lower.rational(), upper.rational())


def _path(item: Item) -> tuple[str, Course | Bounds]:
    if isinstance(item.value, dict) and "tube" in item.value:
        name, tube = item.record("name", "tube")
        return name.text(), read_bounds(tube)
    name, closed, start, pieces, kinds = item.record("name", "closed", "start", "pieces", "kinds")
    if not isinstance(closed.value, bool):
        closed.refuse("true or false")
    reference = read_reference(start, pieces)
    count = reference.pieces[-1].segment + 1
    own = (tuple(group) for _, group in itertools.groupby(reference.pieces, lambda piece: piece.segment))
    segments = tuple(map(SegmentClaim, own))
    order = tuple(kind.integer(0, count - 1) for kind in kinds.items(count, count))
    first: list[SegmentClaim] = []
    for kind, segment in zip(order, segments, strict=True):
        if kind > len(first):
            kinds.refuse("kinds numbered as they appear")
        if kind == len(first):
            first.append(segment)
        elif first[kind].course != segment.course:
            kinds.refuse("segments of one kind to have the same pieces")
    return name.text(), Course(reference, closed.value is True, segments, order)


def read_reference(start: Item, pieces: Item) -> Reference:
    """A path in exact pieces, whose speed is continuous along each segment; θ counts from each segment's start.

    Raises:
        Unreadable, Broken: says what was expected where.
    """
    heading, x, y = (entry.rational() for entry in start.items(3, 3))
    found: list[Piece] = []
    arc = theta = fmpq(0)
    for item in pieces.items(MOST_PIECES):
        segment, duration, turn_rate, speed = item.record("segment", "duration", "turn_rate", "speed")
        before = found[-1] if found else None
        first = before.segment if before else 0
        index = segment.integer(first, first + (1 if before else 0))
        theta = theta if before is None or index == before.segment else fmpq(0)
        turning, moving = _powers(turn_rate), _powers(speed)
        piece = Piece(index, theta, duration.positive(), turning, moving, arc)
        if before is not None and index == before.segment and before.end_speed != moving[0]:
            raise Broken(f"path: the speed jumps at piece {len(found)}")
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


def _funnel(item: Item, size: int) -> FunnelClaim:
    template, shape, rate, beta, beta_lower, beta_inner, margin, per_metre = item.record(
        "template", "shape", "rate", "beta", "beta_lower", "beta_inner", "margin", "margin_per_metre"
    )
    if beta.rational() != 1:
        beta.refuse("1, to which V is normalised")
    inner = beta_lower.positive()
    if not inner < 1:
        beta_lower.refuse("a rational between 0 and 1")
    innermost = beta_inner.positive()
    if innermost > inner:
        beta_inner.refuse("a rational above 0, at most beta_lower")
    return FunnelClaim(
        level=LEVELS[template.choice(*LEVELS)](rate.rational()),
        shape=_symmetric(shape, size),
        beta_lower=inner,
        beta_inner=innermost,
        margin=margin.rational(),
        margin_per_metre=None if per_metre.value is None else per_metre.rational(),
    )


def _symmetric(item: Item, size: int) -> Matrix:
    """From the lower triangle, row by row, in one list."""
    length = size * (size + 1) // 2
    return unpack_triangle([entry.rational() for entry in item.items(length, length)], size)


def unpack_triangle(entries: list[fmpq], size: int) -> Matrix:
    """The symmetric matrix whose lower triangle, row by row, is the list."""
    return [[entries[max(i, j) * (max(i, j) + 1) // 2 + min(i, j)] for j in range(size)] for i in range(size)]


def _witness(item: Item, problem: ProblemClaim) -> Witness:
    condition, funnel, theta, reference, x = item.record("condition", "funnel", "theta", "reference", "x")
    size = len(problem.vehicle.states)
    return Witness(
        condition=condition.choice("a", "b", "c", "d"),
        funnel=funnel.integer(0, len(problem.distinct) - 1),
        theta=theta.rational(),
        reference=reference.integer(0, MOST_EXTREMES - 1),
        x=tuple(entry.rational() for entry in x.items(size, size)),
    )
