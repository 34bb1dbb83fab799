"""certificate.json as typed claims: question, funnels, legs and joints, with the hints or the witness for them.

`docs/certificate-format.md` describes the format. Reading checks shapes, sizes and that numbers are exact; whether
anything stated is true is not decided here (`cfcheck.replay`).
"""

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from flint import fmpq

from cfcheck.claims.hints import MOST_GRAM_ENTRIES, DecreaseHints, Room, read_decrease
from cfcheck.claims.problem import MOST_PIECES, ProblemClaim, problem_of, read_inputs, read_vehicle
from cfcheck.clearance.surroundings import ClearanceHints, read_clearance
from cfcheck.exact.definite import symmetric
from cfcheck.exact.rational import Matrix
from cfcheck.kernel.funnel import FunnelClaim, Model
from cfcheck.kernel.legs import Leg
from cfcheck.kernel.level import LEVELS
from cfcheck.path.bounds import MOST_EXTREMES, Bounds
from cfcheck.reader import Broken, Item, Unreadable


FORMAT = "cfjax-certificate"
VERSION = 4
CLAIMS = ("funnel", "refutation")
HINTS, WITNESS = "hints", "witness"  # the last field, by claim
MOST_FUNNELS = 128


class LegClaim(NamedTuple):
    """Pieces begin, …, end − 1 of the path, and the funnel along them, by its number."""

    begin: int
    end: int
    funnel: int


@dataclass(frozen=True)
class Witness:
    """A deviation x at θ (s) of a leg at which its funnel violates a condition (a, b, c or d).

    `reference` says at which of the extreme ones, where every path within bounds is meant.
    """

    condition: str
    leg: int
    theta: fmpq
    reference: int
    x: tuple[fmpq, ...]


@dataclass(frozen=True)
class Claims:
    """What a file states: the question, funnels with the cars that they are proven for, legs and joints.

    Where every path within bounds is meant there are no legs, and one funnel. `parts` are the legs as the file has
    them; `ratios[k]` is that of the joint after leg k (`cfcheck.kernel.legs`).
    """

    problem: ProblemClaim
    funnels: tuple[FunnelClaim, ...]
    models: tuple[Model, ...]
    parts: tuple[LegClaim, ...]
    ratios: tuple[fmpq, ...]

    @cached_property
    def driven(self) -> tuple[FunnelClaim, ...]:
        """The funnels as the vehicle that drives has them."""
        return tuple(model.driven(funnel) for model, funnel in zip(self.models, self.funnels, strict=True))

    @cached_property
    def legs(self) -> tuple[Leg, ...]:
        """The path with its funnels; none where every path within bounds is meant."""
        course = self.problem.course
        if isinstance(course, Bounds):
            return ()
        return tuple(
            Leg(course.reference, begin, end, self.driven[funnel], index)
            for index, (begin, end, funnel) in enumerate(self.parts)
        )

    def legs_of(self, funnel: int) -> tuple[Leg, ...]:
        """Those along which the funnel with this number holds."""
        return tuple(leg for leg, part in zip(self.legs, self.parts, strict=False) if part.funnel == funnel)

    @property
    def first(self) -> int:
        """The funnel in which a car starts, by its number."""
        return self.parts[0].funnel if self.parts else 0

    @property
    def last(self) -> int:
        """The one in which it arrives."""
        return self.parts[-1].funnel if self.parts else 0


@dataclass(frozen=True)
class Certificate:
    """A whole file: hints for each funnel and half-planes for each leg, or a witness where it refutes a candidate."""

    claims: Claims
    hints: tuple[DecreaseHints, ...]
    clearance: ClearanceHints
    witness: Witness | None


def document_hash(document: dict) -> str:
    """Of everything but the hash itself, independent of the order of fields and of white space."""
    content = {name: value for name, value in document.items() if name != "hash"}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return "sha256:" + hashlib.sha256(text.encode("ascii")).hexdigest()


def read_certificate(document: object, skip_hash: bool = False) -> Certificate:
    """Typed claims of a parsed file, with what it has to prove or refute them.

    Raises:
        Unreadable: says what was expected where.
        Broken: the hash is not that of the content.
    """
    claims, last = _claims(document, skip_hash)
    if last.where == WITNESS:
        return Certificate(claims, (), (), _witness(last, claims))
    decrease, clearance = last.record("decrease", "clearance")
    room, count = Room(MOST_GRAM_ENTRIES), len(claims.funnels)
    states, inputs = len(claims.problem.vehicle.states), len(claims.problem.inputs)
    hints = tuple(read_decrease(item, states, inputs, room) for item in decrease.items(count, count))
    return Certificate(claims, hints, read_clearance(clearance, claims.problem.surroundings, len(claims.parts)), None)


def read_claims(document: object) -> Claims:
    """What a parsed file of claim `funnel` states, its hints left aside: for a file that was replayed before.

    Raises:
        Unreadable: says what was expected where.
    """
    claims, last = _claims(document, skip_hash=True)
    if last.where == WITNESS:
        raise Unreadable("claim: expected funnel, got refutation")
    return claims


def read_header(
    document: object, claims: tuple[str, ...], names: tuple[str, ...], skip_hash: bool = False
) -> list[Item]:
    """The claim of a file of this format, and then its other fields.

    Raises:
        Unreadable, Broken: it is none, or its hash is not that of its content.
    """
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise Unreadable(f"not a certificate: expected an object with format {FORMAT}")
    version = document.get("version")
    if version != VERSION or isinstance(version, bool):
        earlier = isinstance(version, int) and version < VERSION
        hint = ": an earlier release made the file, and it has to be made again" if earlier else ""
        raise Unreadable(f"this checker reads version {VERSION} of the format{hint}")
    Item(document.get("claim"), "claim").choice(*claims)
    fields = Item(document, "").record("format", "version", "claim", "hash", *names)
    if not skip_hash and fields[3].value != document_hash(document):
        raise Broken("hash: the content has changed since the hash was taken")
    return fields[4:]


def _claims(document: object, skip_hash: bool) -> tuple[Claims, Item]:
    """What is stated, and the last field: hints or witness."""
    refutes = isinstance(document, dict) and document.get("claim") == CLAIMS[1]
    names = "problem", "funnels", "legs", "joints", WITNESS if refutes else HINTS
    question, funnels, legs, joints, last = read_header(document, CLAIMS, names, skip_hash)
    problem = problem_of(question)
    read = [_funnel(item, problem) for item in funnels.items(MOST_FUNNELS)]
    parts = _legs(legs, problem, len(read))
    if len(read) != max((part.funnel for part in parts), default=0) + 1:
        funnels.refuse("one for each number that legs name, or a single one for every path within bounds")
    count = 0 if refutes else max(len(parts) - 1, 0) + problem.is_lap
    ratios = tuple(item.record("ratio")[0].positive() for item in joints.items(count, count))
    return Claims(problem, tuple(one for one, _ in read), tuple(model for _, model in read), parts, ratios), last


def _legs(item: Item, problem: ProblemClaim, funnels: int) -> tuple[LegClaim, ...]:
    """They follow each other from the first piece to the last; speed is continuous along each."""
    if isinstance(problem.course, Bounds):
        item.items(0, 0)
        return ()
    pieces, found, begin = problem.course.reference.pieces, [], 0
    for entry in item.items(MOST_PIECES):
        end, funnel = entry.record("end", "funnel")
        part = LegClaim(begin, end.integer(begin + 1, len(pieces)), funnel.integer(0, funnels - 1))
        if part.funnel > max((before.funnel for before in found), default=-1) + 1:
            funnel.refuse("funnels numbered as they appear")
        for index in range(begin + 1, part.end):
            if pieces[index - 1].end_speed != pieces[index].speed[0]:
                raise Broken(f"path: the speed jumps at piece {index}, inside leg {len(found)}")
        found.append(part)
        begin = part.end
    if begin != len(pieces):
        raise Unreadable(f"{item.where}: expected the last one to end with piece {len(pieces)}, got {begin}")
    return tuple(found)


def _funnel(item: Item, problem: ProblemClaim) -> tuple[FunnelClaim, Model]:
    template, shape, rate, beta, beta_lower, beta_inner, margin, per_metre, model = item.record(
        "template", "shape", "rate", "beta", "beta_lower", "beta_inner", "margin", "margin_per_metre", "model"
    )
    if beta.rational() != 1:
        beta.refuse("1, to which V is normalised")
    inner = beta_lower.positive()
    if not inner < 1:
        beta_lower.refuse("a rational between 0 and 1")
    innermost = beta_inner.positive()
    if innermost > inner:
        beta_inner.refuse("a rational above 0, at most beta_lower")
    claim = FunnelClaim(
        level=LEVELS[template.choice(*LEVELS)](rate.rational()),
        shape=_symmetric(shape, len(problem.vehicle.states)),
        beta_lower=inner,
        beta_inner=innermost,
        margin=margin.rational(),
        margin_per_metre=None if per_metre.value is None else per_metre.rational(),
    )
    if model.value is not None and claim.margin_per_metre is None:
        model.refuse("no model for a funnel that changes with theta")
    if model.value is not None and problem.law is not None:
        model.refuse("no model where a law is part of the problem")
    return claim, problem.car if model.value is None else _model(model, problem)


def _model(item: Item, problem: ProblemClaim) -> Model:
    vehicle, inputs, length, speed = item.record("vehicle", "inputs", "length", "speed")
    claim = read_vehicle(vehicle)
    if (claim.name, claim.states) != (problem.vehicle.name, problem.vehicle.states):
        vehicle.refuse("name and states of the problem's vehicle")
    return Model(claim, read_inputs(inputs, claim.states), length.positive(), speed.positive())


def _symmetric(item: Item, size: int) -> Matrix:
    """From the lower triangle, row by row, in one list."""
    length = size * (size + 1) // 2
    return symmetric([entry.rational() for entry in item.items(length, length)])


def _witness(item: Item, claims: Claims) -> Witness:
    condition, leg, theta, reference, x = item.record("condition", "leg", "theta", "reference", "x")
    size = len(claims.problem.vehicle.states)
    return Witness(
        condition=condition.choice("a", "b", "c", "d"),
        leg=leg.integer(0, max(len(claims.parts) - 1, 0)),
        theta=theta.rational(),
        reference=reference.integer(0, MOST_EXTREMES - 1),
        x=tuple(entry.rational() for entry in x.items(size, size)),
    )
