"""A path with the tubes that hold along it, replayed from one file.

The file states the path, piece by piece in exact numbers, and brings the whole certificate of every tube. Each of them
is replayed; then the path has to be a path (speed continuous, pose and heading by integration), to stay inside the
bounds of the tube that holds there, and each tube has to hand over to the next (`cfjax.check.handover`). A closed path
hands over to its own beginning, over the gap that integration leaves. Where the file names sets, I lies in the first
tube, every tube in S, and what is left of the last one at the end in G. Where it names obstacles, the body clears them
anywhere in each tube.
"""

import itertools
from dataclasses import dataclass, replace
from typing import NamedTuple

from flint import fmpq

from cfjax.check.bounds import Bounds
from cfjax.check.certified import CertifiedTube
from cfjax.check.containment import Asked, broken_containments
from cfjax.check.document import (
    FORMAT,
    MOST_PARAMETERS,
    MOST_PIECES,
    VERSION,
    VehicleClaim,
    document_hash,
    read_claims,
    read_reference,
)
from cfjax.check.graph import MOST_STATES
from cfjax.check.handover import ProvenLink, Run, prove_chain
from cfjax.check.level import STILL
from cfjax.check.meaning import require_body, require_path
from cfjax.check.reader import Broken, Item, Unreadable
from cfjax.check.reference import Reference, is_closed
from cfjax.check.similarity import scaled, served
from cfjax.check.surroundings import (
    Clearance,
    Surroundings,
    prove_surroundings,
    read_clearance,
    read_surroundings,
)
from cfjax.check.symbolic import Symbolic, symbolic
from cfjax.check.vehicle import KNOWN_VEHICLES, POSE


CHAIN = "chain"
MOST_TUBES = 12


class SetsClaim(NamedTuple):
    """Half-axes of I and G and half-widths of S (or None), by state."""

    inlet: tuple[fmpq, ...]
    goal: tuple[fmpq, ...]
    safe: tuple[fmpq, ...] | None


@dataclass(frozen=True)
class ChainClaim:
    """The path and the tubes along it, tubes not proven yet; `levels[k]` is that of the link after run k."""

    name: str
    closed: bool
    vehicle: str
    parameters: dict[str, fmpq]
    reference: Reference
    tubes: tuple[tuple[object, fmpq, fmpq], ...]  # certificate, scales of length and speed
    runs: tuple[tuple[int, int, int], ...]  # first piece, piece after the last, tube
    levels: tuple[fmpq, ...]
    sets: SetsClaim | None
    surroundings: Surroundings = Surroundings()
    clearance: Clearance = ()  # by run


def tube_of(document: object, name: str) -> CertifiedTube:
    """The tube that a certificate claims, unproven.

    Raises:
        Unreadable: no certificate, or one of something else.
    """
    problem, (funnel, *_) = read_claims(document)
    bounds = problem.course
    if not isinstance(bounds, Bounds) or funnel.margin_per_metre is None:
        raise Unreadable("expected the certificate of a tube, got one of something else")
    return CertifiedTube(
        name=name,
        vehicle=problem.vehicle.name,
        parameters=problem.vehicle.parameters,
        method=problem.method,
        bounds=bounds,
        shape=funnel.shape,
        beta_lower=funnel.beta_lower,
        beta_inner=funnel.beta_inner,
        margin=funnel.margin,
        margin_per_metre=funnel.margin_per_metre,
        inputs=problem.inputs,
        states=problem.vehicle.states,
    )


def prove_between_sets(claim: ChainClaim) -> tuple[tuple[Run, ...], tuple[ProvenLink, ...], fmpq]:
    """What `prove_runs` gives, and a level that V is at most at the end of the path; with the sets kept that are asked.

    Raises:
        Unreadable, Broken, ValueError: says what is not as it has to be.
    """
    runs, links = prove_runs(claim)
    last = runs[-1]
    finish = last.tube.level_after(last.length(claim.reference))
    if claim.sets:
        _check_sets(claim.sets, runs, finish)
    if claim.surroundings.obstacles:
        require_body(*vehicle_of(claim), claim.surroundings)
        spans = [run.span(claim.reference, f"run {index}") for index, run in enumerate(runs)]
        prove_surroundings(claim.surroundings, spans, claim.clearance)
    return tuple(runs), links, finish


def prove_runs(claim: ChainClaim) -> tuple[list[Run], tuple[ProvenLink, ...]]:
    """The runs in tubes as the path's own car has them, each handing over to the next; tubes not proven.

    Raises:
        Unreadable, Broken, ValueError: says what is not as it has to be.
    """
    tubes = []
    for index, (certificate, length, speed) in enumerate(claim.tubes):
        tube = tube_of(certificate, str(index))  # refuses everything that is none, a chain in a chain too
        if tube.vehicle != claim.vehicle or not _is_alike(claim, certificate):
            raise Broken(f"tube {index}: it is proven for another vehicle")
        if claim.sets and any(len(axes) != len(tube.states) for axes in claim.sets if axes is not None):
            raise Broken(f"sets: expected {len(tube.states)} numbers each, one for each state of the vehicle")
        own = served(scaled(tube, length, speed), claim.parameters)
        if own is None:
            raise Broken(f"tube {index}: its vehicle can do what this one cannot")
        tubes.append(own)
    require_path(*vehicle_of(claim), claim.reference.pieces, claim.closed)
    runs = [Run(begin, end, tubes[index]) for begin, end, index in claim.runs]
    links = prove_chain(claim.reference, runs, claim.levels, claim.closed)  # bounds first: a wild path has no gap
    if claim.closed and not is_closed(claim.reference.gap):
        raise Broken("path: the end of the lap is not its start")
    return runs, links


def vehicle_of(claim: ChainClaim) -> tuple[VehicleClaim, Symbolic]:
    """The vehicle that drives, with the dynamics in the certificate of the first tube."""
    problem, _ = read_claims(claim.tubes[0][0])
    dynamics = symbolic(problem.vehicle.graph, problem.vehicle.states, tuple(problem.inputs))
    return replace(problem.vehicle, parameters=claim.parameters), dynamics


def _is_alike(claim: ChainClaim, certificate: object) -> bool:
    """Whether a tube speaks of the chain's vehicle: as its name has it, or, where that is not known, as the first one.

    Inputs of one tube are held into the next, so that of an unknown vehicle their limits are the same too.
    """
    (one, _), (other, _) = read_claims(claim.tubes[0][0]), read_claims(certificate)
    if known := KNOWN_VEHICLES.get(claim.vehicle):
        return other.vehicle.states == known.states
    if other.vehicle.states[: len(POSE)] != POSE:
        return False  # of what has no pose a path says nothing
    limits = [{name: ends for name, ends in problem.inputs.items() if name != "u0"} for problem in (one, other)]
    return one.vehicle == other.vehicle and limits[0] == limits[1]


def _check_sets(sets: SetsClaim, runs: list[Run], finish: fmpq) -> None:
    """Raises Broken unless I is in the first tube, every tube in S, and {V ≤ finish} of the last one in G."""
    states = runs[0].tube.states
    broken = broken_containments(states, runs[0].tube.shape, STILL, Asked(sets.inlet, None, sets.safe))
    for run in runs[1:]:
        broken += broken_containments(states, run.tube.shape, STILL, Asked(None, None, sets.safe))
    broken += broken_goal(sets, runs[-1].tube, finish)
    if broken:
        raise Broken("; ".join(dict.fromkeys(broken)))


def broken_goal(sets: SetsClaim, tube: CertifiedTube, level: fmpq) -> list[str]:
    """Why {V ≤ level} = {xᵀ (C/level) x ≤ 1} does not lie in G; nothing where it does."""
    end = [[entry / level for entry in row] for row in tube.shape]
    return broken_containments(tube.states, end, STILL, Asked(None, sets.goal, None))


def _sets(item: Item, states: tuple[str, ...] | None) -> SetsClaim | None:
    """Of so many states, or as many as stand there."""
    if item.value is None:
        return None
    inlet, goal, safe = item.record("inlet", "goal", "safe")

    def axes(entry: Item) -> tuple[fmpq, ...]:
        least, most = (1, MOST_STATES) if states is None else (len(states), len(states))
        return tuple(value.positive() for value in entry.items(most, least))

    return SetsClaim(axes(inlet), axes(goal), None if safe.value is None else axes(safe))


def read_chain(document: dict, skip_hash: bool) -> ChainClaim:
    """Typed claims of a parsed file.

    Raises:
        Unreadable, Broken: as for other certificates.
    """
    open_space = {"surroundings": {"obstacles": [], "footprint": []}, "clearance": []}  # where the file names neither
    fields = Item({**open_space, **document}, "").record(
        *("format", "version", "claim", "hash", "vehicle", "path", "sets", "tubes", "runs", "levels"), *open_space
    )
    if fields[0].value != FORMAT or fields[1].value != VERSION or isinstance(fields[1].value, bool):
        raise Unreadable(f"this checker reads version {VERSION} of the format")
    if not skip_hash and fields[3].value != document_hash(document):
        raise Broken("hash: the content has changed since the hash was taken")
    vehicle, parameters = fields[4].record("name", "parameters")
    name, closed, start, pieces = fields[5].record("name", "closed", "start", "pieces")
    if not isinstance(closed.value, bool):
        closed.refuse("true or false")
    tubes = []
    for entry in fields[7].items(MOST_TUBES):
        certificate, length, speed = entry.record("certificate", "length", "speed")
        tubes.append((certificate.value, length.positive(), speed.positive()))
    reference = read_reference(start, pieces)
    for before, piece in itertools.pairwise(reference.pieces):
        if before.end_speed != piece.speed[0]:
            raise Broken("path: the speed jumps between segments")
    runs, begin = [], 0
    for entry in fields[8].items(MOST_PIECES):
        end, tube = entry.record("end", "tube")
        runs.append((begin, end.integer(begin + 1, len(reference.pieces)), tube.integer(0, len(tubes) - 1)))
        begin = runs[-1][1]
    kind, known = vehicle.text(), KNOWN_VEHICLES.get(vehicle.text())
    numbers = parameters.entries(MOST_PARAMETERS, least=0)
    own = {label: value.positive() if known else value.rational() for label, value in numbers}
    if known and set(own) != set(known.parameters):
        parameters.refuse(f"the parameters of a {kind}")
    levels = tuple(level.positive() for level in fields[9].items(MOST_PIECES, least=0))
    sets = _sets(fields[6], known.states if known else None)
    surroundings = read_surroundings(*fields[10].record("obstacles", "footprint"))
    return ChainClaim(
        name=name.text(),
        closed=closed.value is True,
        vehicle=kind,
        parameters=own,
        reference=reference,
        tubes=tuple(tubes),
        runs=tuple(runs),
        levels=levels,
        sets=sets,
        surroundings=surroundings,
        clearance=read_clearance(fields[11], surroundings, len(runs)),
    )
