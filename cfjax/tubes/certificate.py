"""The proof that a path is followed, as a file: the path in exact numbers, its legs, and every tube with its proof."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cfcheck.claims.document import LegClaim
from cfcheck.exact.rational import Range, rational
from cfcheck.reader import read_json
from cfcheck.vehicle.model import KNOWN_VEHICLES
from cfjax.coerce import file, instance, optional
from cfjax.errors import InputError
from cfjax.exact import exact_surroundings, write_clearance, write_path, write_surroundings
from cfjax.problem import Problem, Vehicle
from cfjax.tubes.certified import CertifiedTube
from cfjax.tubes.follow import Following


def chain_document(following: Following, problem: Problem | None = None) -> dict[str, Any]:
    """What `python -m cfjax.check FILE` replays: tubes, bounds along the path, joints and closure.

    With a problem the file claims its sets too: from I, inside S, to G.

    Raises:
        InputError: where a tube came without its certificate, or the path was not followed beside the problem's
            obstacles.
    """
    from cfjax.certificate.writing import seal, write_inputs, write_sets  # here, as JAX comes with it

    instance("following", following, Following)
    optional("problem", problem, Problem)
    if problem and exact_surroundings(problem.obstacles, problem.footprint) != following.surroundings:
        raise InputError("following: expected a path that was followed beside the problem's obstacles")
    tubes = list(dict.fromkeys(run.tube for run in following.runs))
    sources = [_source(tube) for tube in tubes]
    open_ends = {"inlet": None, "goal": None, "safe": None, **write_surroundings(following.surroundings)}
    question = {
        "vehicle": _vehicle(following.vehicle if problem is None else problem.vehicle, tubes, sources),
        "method": "tt" if all(tube.method == "tt" for tube in tubes) else "pf",
        "inputs": write_inputs(_inputs(following, tubes, problem)),
        "path": write_path(following.path, following.reference.pieces, following.closed),
        "sets": open_ends if problem is None else write_sets(problem),
    }
    return seal(
        "funnel",
        question,
        [_funnel(question, *each) for each in zip(tubes, sources, strict=True)],
        {
            "decrease": [source["hints"]["decrease"][0] for source in sources],
            "clearance": write_clearance(following.clearance),
        },
        [LegClaim(run.begin, run.end, tubes.index(run.tube)) for run in following.runs],
        following.ratios,
    )


def _source(tube: CertifiedTube) -> dict[str, Any]:
    """The tube's certificate."""
    if tube.origin is None:
        raise InputError(f"certificate: expected tubes with their certificates, {tube.name} has none")
    source = tube.origin.source
    found = source if isinstance(source, dict) else read_json(Path(source))
    assert isinstance(found, dict)  # it was read before
    return found


def _vehicle(vehicle: Vehicle | None, tubes: Sequence[CertifiedTube], sources: Sequence[dict]) -> dict[str, Any]:
    """The car that drives: as a certificate has it, where that is proven for the same car, else from its equations."""
    own = {name: str(value) for name, value in tubes[0].parameters.items()}
    for source in sources:
        found = source["problem"]["vehicle"]
        if found["parameters"] == own:
            return found
    from cfjax.certificate.trace import trace_deviation  # here, as JAX comes with it
    from cfjax.certificate.writing import write_vehicle

    if vehicle is None:
        raise InputError("certificate: expected the vehicle that drives, follow(…, vehicle=…), beside tubes of another")
    return write_vehicle(vehicle, trace_deviation(vehicle))


def _inputs(following: Following, tubes: Sequence[CertifiedTube], problem: Problem | None) -> dict[str, Range]:
    """The problem's, or all that the car can do where it is known; u0 as all tubes together have it."""
    if problem is not None:
        from cfjax.certificate.writing import exact_inputs

        return exact_inputs(problem) | {"u0": following.timing}
    box = {
        name: (min(tube.inputs[name][0] for tube in tubes), max(tube.inputs[name][1] for tube in tubes))
        for name in tubes[0].inputs
    }
    if known := KNOWN_VEHICLES.get(tubes[0].vehicle):
        limits = {name: tubes[0].parameters[label] for name, label in known.limits.items()}
        box |= {name: (-limit, limit) for name, limit in limits.items()}
    return box | {"u0": following.timing}


def _funnel(question: Mapping[str, Any], tube: CertifiedTube, source: Mapping[str, Any]) -> dict[str, Any]:
    """The tube's funnel, and the car that it is proven for where that is another one or has other inputs."""
    assert tube.origin is not None  # its certificate was found
    (funnel,), problem = source["funnels"], source["problem"]
    model = funnel["model"] or {"vehicle": problem["vehicle"], "inputs": problem["inputs"], "length": "1", "speed": "1"}
    scales = {
        "length": str(rational(model["length"]) * tube.origin.length),
        "speed": str(rational(model["speed"]) * tube.origin.speed),
    }
    model = model | scales
    same = {"vehicle": question["vehicle"], "inputs": question["inputs"], "length": "1", "speed": "1"}
    return funnel | {"model": None if model == same else model}


def write_chain(following: Following, path: str | Path) -> None:
    """Write the proof that the path is followed; the file says PROVEN to the checker, or is none of ours.

    Raises:
        InputError: as `chain_document`; OSError where the file cannot be written.
    """
    from cfjax.certificate.writing import dump  # here, as JAX comes with it

    file("path", path).write_text(dump(chain_document(following)), encoding="ascii")
