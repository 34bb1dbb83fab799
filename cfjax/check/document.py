"""certificate.json as typed claims: what the file states, and the hints with which it says that this can be proven.

`docs/certificate-format.md` describes the format. Reading checks shapes, sizes and that numbers are exact; whether
anything stated is true is not decided here (`cfjax.check.replay`).
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import comb

from flint import fmpq

from cfjax.check.decrease import Extreme, Matrix
from cfjax.check.graph import ARITY, Graph, Node
from cfjax.check.reader import Broken, Item, Unreadable
from cfjax.check.tube import TubeClaim


FORMAT = "cfjax-certificate"
VERSION = 2
CLAIMS = ("funnel", "refutation")
PROOFS, WITNESS = "proofs", "witness"  # the last field, by claim
TEMPLATES = {"paper": "c0", "contracting": "rate"}
MOST_STATES = 6
MOST_INPUTS = 4  # u0 among them
MOST_NODES = 400
MOST_FUNCTIONS = 32  # nodes that apply sin, cos, …
MOST_MONOMIALS = 128  # rows of a Gram matrix
MOST_EXTREMES = 8  # references of a tube: ends of curvature, speed, acceleration
MOST_CELLS = 32 * MOST_EXTREMES  # two pieces, sixteen patterns of the signs of four inputs
MOST_GRAM_ENTRIES = 300_000  # of the whole proof; a circle's takes about 20 000
MOST_COEFFICIENTS = 12  # of a polynomial that stands for a function
LARGEST_GRAM_ENTRY = 2**64  # a circle's reach 2^36


CellKey = tuple[int, int, tuple[int, ...]]  # reference, piece, signs


@dataclass(frozen=True)
class VehicleClaim:
    """Whose dynamics: the deviation's rate as a graph over states, `input:…` and `reference:…`."""

    name: str
    parameters: Mapping[str, fmpq]
    states: tuple[str, ...]
    graph: Graph


@dataclass(frozen=True)
class SegmentClaim:
    """A stretch of reference at constant turning rate (rad/s) and speed (m/s), θ from 0 to the duration (s)."""

    duration: fmpq
    turn_rate: fmpq
    speed: fmpq

    @property
    def profile(self) -> dict[str, fmpq]:
        """What the dynamics see of it, by the graph's names."""
        zero = fmpq(0)
        return {"turn_rate": self.turn_rate, "speed": self.speed, "turn_rate_slope": zero, "speed_slope": zero}

    def extremes(self) -> list[Extreme]:
        """The references that have to be proven: there is but one."""
        return [Extreme(self.profile, self.profile)]


@dataclass(frozen=True)
class ProblemClaim:
    """The question that the file answers; sets and limits by state and by input."""

    vehicle: VehicleClaim
    method: str
    inputs: Mapping[str, tuple[fmpq, fmpq]]  # u0 first
    path: str
    segments: tuple[SegmentClaim | TubeClaim, ...]
    inlet: tuple[fmpq, ...]  # half-axes of I
    goal: tuple[fmpq, ...]  # half-axes of G
    safe: tuple[fmpq, ...] | None  # half-widths of the box S


@dataclass(frozen=True)
class FunnelClaim:
    """V of a template on one segment, β = 1, and the margin λ (1/s) claimed for it; of a tube, per metre too."""

    template: str
    shape: Matrix
    rate: fmpq
    beta_lower: fmpq
    beta_inner: fmpq
    margin: fmpq
    margin_per_metre: fmpq | None


@dataclass(frozen=True)
class SteadyHints:
    """What the prover found for condition (d) on a steady segment or tube; nothing of it is believed.

    `enclosures` gives (function, coefficients, lower, upper, bound) by node, `cells` (margin, Gram matrices) by
    extreme reference, level piece and signs.
    """

    whitening: Matrix
    degrees: tuple[int, ...]
    enclosures: Mapping[int, tuple[str, tuple[fmpq, ...], fmpq, fmpq, fmpq]]
    cells: Mapping[CellKey, tuple[fmpq, tuple[Matrix, ...]]]


@dataclass(frozen=True)
class Witness:
    """A deviation x at θ (s) at which a candidate violates a condition (a, b, c or d); of a tube, at a reference."""

    condition: str
    theta: fmpq
    reference: int  # which of the extreme ones
    x: tuple[fmpq, ...]


@dataclass(frozen=True)
class Certificate:
    """A whole file: hints for each funnel where it claims one, a witness where it refutes one."""

    problem: ProblemClaim
    funnels: tuple[FunnelClaim, ...]
    hints: tuple[SteadyHints, ...]
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
        return Certificate(problem, funnels, (), _witness(last, len(problem.vehicle.states)))
    hints = tuple(_steady_hints(item, problem) for item in last.items(len(funnels), len(funnels)))
    return Certificate(problem, funnels, hints, None)


def read_claims(document: object) -> tuple[ProblemClaim, tuple[FunnelClaim, ...]]:
    """What a parsed file of claim `funnel` states, its proofs left aside: for a file that was replayed before.

    Raises:
        Unreadable: says what was expected where.
    """
    problem, funnels, last = _claims(document, skip_hash=True)
    if last.where == WITNESS:
        raise Unreadable("claim: expected funnel, got refutation")
    return problem, funnels


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
    funnels = tuple(_funnel(item, len(problem.vehicle.states)) for item in fields[5].items(len(problem.segments)))
    if len(funnels) != len(problem.segments):
        raise Unreadable(f"funnels: expected {len(problem.segments)}, one per segment, got {len(funnels)}")
    return problem, funnels, fields[6]


def _problem(item: Item) -> ProblemClaim:
    vehicle, method, inputs, path, sets = item.record("vehicle", "method", "inputs", "path", "sets")
    claim = _vehicle(vehicle)
    size = len(claim.states)
    inlet, goal, safe = sets.record("inlet", "goal", "safe")
    name, segments = path.record("name", "segments")
    box = [_input(entry) for entry in inputs.items(MOST_INPUTS)]
    if len(dict(box)) != len(box) or box[0][0] != "u0":
        raise Unreadable("problem.inputs: expected distinct names, u0 first")
    return ProblemClaim(
        vehicle=claim,
        method=method.choice("pf", "tt"),
        inputs=dict(box),
        path=name.text(),
        segments=tuple(_segment(entry) for entry in segments.items(1)),  # chains: not in this version
        inlet=tuple(axis.positive() for axis in inlet.record("half_axes")[0].items(size, size)),
        goal=tuple(axis.positive() for axis in goal.record("half_axes")[0].items(size, size)),
        safe=None
        if safe.value is None
        else tuple(width.positive() for width in safe.record("half_widths")[0].items(size, size)),
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
        name.text(), {k: value.rational() for k, value in parameters.entries(32, least=0)}, labels, graph
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


def _segment(item: Item) -> SegmentClaim | TubeClaim:
    if isinstance(item.value, dict) and "curvature" in item.value:
        return _tube(item)
    duration, turn_rate, speed = item.record("duration", "turn_rate", "speed")
    length = duration.positive()
    return SegmentClaim(length, _constant(turn_rate, length), _constant(speed, length))


def _tube(item: Item) -> TubeClaim:
    bounds = item.record("curvature", "speed", "acceleration")
    ranges = []
    for entry in bounds:
        lower, upper = (end.rational() for end in entry.items(2, 2))
        if lower > upper:
            entry.refuse("an interval, lower end first")
        ranges.append((lower, upper))
    if not ranges[1][0] > 0:
        bounds[1].refuse("speeds above zero")
    return TubeClaim(*ranges)


def _constant(item: Item, duration: fmpq) -> fmpq:
    """The value of a profile (piecewise polynomial) that is constant; others are not in this version."""
    breaks, coefficients = item.record("breaks", "coefficients")
    start, end = (entry.rational() for entry in breaks.items(2, 2))
    if start != 0 or end != duration:
        breaks.refuse("0 and the duration")
    return coefficients.items(1)[0].items(1)[0].rational()


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
        template=template.choice(*TEMPLATES),
        shape=_symmetric(shape, size),
        rate=rate.rational(),
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


def _witness(item: Item, size: int) -> Witness:
    condition, theta, reference, x = item.record("condition", "theta", "reference", "x")
    return Witness(
        condition=condition.choice("a", "b", "c", "d"),
        theta=theta.rational(),
        reference=reference.integer(0, MOST_EXTREMES - 1),
        x=tuple(entry.rational() for entry in x.items(size, size)),
    )


def _steady_hints(item: Item, problem: ProblemClaim) -> SteadyHints:
    kind, whitening, degrees, enclosures, cells = item.record("kind", "whitening", "degrees", "enclosures", "cells")
    kind.choice("steady")
    size = len(problem.vehicle.states)
    orders = tuple(degree.integer(0, 8) for degree in degrees.items(MOST_INPUTS + 3, 3))
    sizes = [comb(size + degree, degree) for degree in orders]
    if max(sizes) > MOST_MONOMIALS:
        degrees.refuse(f"degrees with at most {MOST_MONOMIALS} monomials")
    by_node, by_cell = {}, {}
    for entry in enclosures.items(MOST_FUNCTIONS, least=0):
        fields = entry.record("node", "function", "coefficients", "lower", "upper", "bound")
        node = fields[0].integer(0, MOST_NODES)
        if node in by_node:
            fields[0].refuse("each node once")
        by_node[node] = (
            fields[1].text(),
            tuple(value.rational() for value in fields[2].items(MOST_COEFFICIENTS)),
            fields[3].rational(),
            fields[4].rational(),
            fields[5].rational(),
        )
    entries = cells.items(MOST_CELLS)
    if len(entries) * sum(rows * (rows + 1) // 2 for rows in sizes) > MOST_GRAM_ENTRIES:
        cells.refuse(f"Gram matrices with at most {MOST_GRAM_ENTRIES} entries together")
    for entry in entries:
        reference, piece, signs, margin, grams = entry.record("reference", "piece", "signs", "margin", "grams")
        key = (
            reference.integer(0, MOST_EXTREMES - 1),
            piece.integer(0, MOST_CELLS),
            tuple(sign.integer(-1, 1) for sign in signs.items(MOST_INPUTS, least=0)),
        )
        if key in by_cell:
            entry.refuse("each cell once")
        tables = grams.items(len(sizes), len(sizes))
        by_cell[key] = (
            margin.rational(),
            tuple(_gram(table, rows) for table, rows in zip(tables, sizes, strict=True)),
        )
    rows = [[entry.rational() for entry in row.items(size, size)] for row in whitening.items(size, size)]
    return SteadyHints(rows, orders, by_node, by_cell)


def _gram(item: Item, size: int) -> Matrix:
    """Whole numbers over a common power of two."""
    exponent, lower = item.record("exponent", "lower")
    scale = fmpq(1, 2 ** exponent.integer(0, 200))
    length = size * (size + 1) // 2
    entries = [scale * entry.integer(-LARGEST_GRAM_ENTRY, LARGEST_GRAM_ENTRY) for entry in lower.items(length, length)]
    return unpack_triangle(entries, size)
